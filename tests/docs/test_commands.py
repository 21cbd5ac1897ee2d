"""Every command line that the documents name is one: its verb is there, and its options are."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from hil.commands.cli import cli as bench
from host.commands.cli import daranti as field
from host.link.session import RESULT_TEXTS

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
CODE = re.compile(r"```\w*\n(.*?)```|`([^`]+)`", re.DOTALL)
COMMAND = re.compile(r"(?<![\w./-])(daranti(?:-hil)?|make) (?=[a-z])[^;&|#`\n]*")
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
PROGRAMS = {"daranti": field, "daranti-hil": bench}


def commands_of(text: str) -> list[str]:
    """The command lines in a page's code, continued lines joined and brackets of optional words
    taken off."""
    code = "\n".join(block or inline.replace("\n", " ") for block, inline in CODE.findall(text))
    code = re.sub(r"\\\n", " ", code)
    return [m.group(0).translate(str.maketrans("[]…", "   ")) for m in COMMAND.finditer(code)]


def wrong_with(line: str) -> str:
    """What a command line has that its program does not know; empty where it has nothing such."""
    program, *words = shlex.split(line)
    if program == "make":
        unknown = [w for w in words if re.fullmatch(r"[a-z-]+", w) and w not in TARGETS]
        return f"make has no target {unknown[0]}" if unknown else ""
    command: click.Command = PROGRAMS[program]
    context = click.Context(command, info_name=program)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(context, words[0])
        if found is None:
            return f"{command.name} has no {words[0]}"
        command, words = found, words[1:]
        context = click.Context(command, parent=context)
    try:
        given, _, _ = command.make_parser(context).parse_args(words)
    except click.BadOptionUsage as error:  # an option that is named without its value
        return "" if error.message.endswith("requires an argument.") else error.format_message()
    except click.UsageError as error:
        return error.format_message()
    asked = [p for p in command.params if isinstance(p, click.Argument) and p.required]
    lacks = [p for p in asked if p.value_is_missing(given.get(p.name or ""))]
    return f"it lacks its {lacks[0].name}" if 0 < len(lacks) < len(asked) else ""


def test_every_command_line_in_a_refusal_is_one() -> None:
    lines = [line for text in RESULT_TEXTS.values() for line in commands_of(text)]
    assert len(lines) >= 1
    assert [f"{line}: {wrong}" for line in lines if (wrong := wrong_with(line))] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_line_is_one(page: Path) -> None:
    lines = commands_of(page.read_text("utf-8"))
    assert [f"{line}: {wrong}" for line in lines if (wrong := wrong_with(line))] == []


def test_what_is_measured_on_the_board_is_stored_there() -> None:
    """Opening the port resets most boards: what is not stored is lost before the next command."""
    pages = [ROOT / "README.md", ROOT / "docs/build/first-power-up.md"]
    lines = [line for page in pages for line in commands_of(page.read_text("utf-8"))]
    told = [line for line in lines if re.match(r"daranti (identify|tune pid) ", line)]
    assert len(told) == 4
    assert [line for line in told if "--save" not in line] == []


@pytest.mark.parametrize(
    "text",
    [
        "`daranti plough`",
        "```sh\ndaranti plan field.geojson \\\n  --gapp 2\n```",
        "`daranti tune everything`",
        "`daranti-hil harvest --sceanrio default`",
        "`make havest`",
        "`daranti params set steer_driver=1`",
    ],
)
def test_a_command_line_that_is_none_is_found(text: str) -> None:
    assert [wrong for line in commands_of(text) if (wrong := wrong_with(line))]
