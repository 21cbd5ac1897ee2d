"""Facts about options that take a number of a range: plain words, in help and in a refusal."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from hil.commands.cli import cli as daranti_hil
from host.commands.cli import daranti
from host.core.number_range import NumberRange, WholeRange, argument
from tests.helpers.spoiled import command_of, commands

CASES = [
    (WholeRange(0, 60), "-1", "0 to 60"),
    (WholeRange(0, 2**31 - 1), "-1", "0 to 2147483647"),
    (WholeRange(1), "0", "1 and above"),
    (WholeRange(max=5), "6", "5 and below"),
    (NumberRange(0, 24, max_open=True), "24", "0 to below 24"),
    (NumberRange(0, min_open=True), "0", "above 0"),
    (NumberRange(0, 1000, min_open=True), "0", "above 0 to 1000"),
    (NumberRange(0.002, 1), "2", "0.002 to 1"),
    (NumberRange(max=5, max_open=True), "5", "below 5"),
]


@pytest.mark.parametrize(("kind", "value", "words"), CASES)
def test_help_and_refusal_say_the_range_in_words(
    kind: click.ParamType, value: str, words: str
) -> None:
    command = click.Command("go", params=[click.Option(["--value"], type=kind)])
    said = CliRunner().invoke(command, ["--help"]).output
    assert f"--value NUMBER  [{words}]" in said
    refused = CliRunner().invoke(command, ["--value", value]).output
    assert f"is not in the range {words}." in refused


@pytest.mark.parametrize("value", ["x", "", "1.5", "1e3", "nan", "inf"])
def test_what_is_no_whole_number_is_called_that(value: str) -> None:
    with pytest.raises(click.BadParameter, match="is not a valid whole number"):
        WholeRange(0, 60).convert(value, None, None)


def test_a_tool_s_argument_has_the_same_range_and_words(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--taps", type=argument(WholeRange(1, 10)))
    assert parser.parse_args(["--taps", "10"]).taps == 10
    with pytest.raises(SystemExit):
        parser.parse_args(["--taps", "0"])
    assert "argument --taps: 0 is not in the range 1 to 10." in capsys.readouterr().err


def ranges() -> Iterator[tuple[str, click.ParamType]]:
    """Every option and argument of both programs that takes a number, and its type."""
    for group in (daranti, daranti_hil):
        for path in commands(group):
            for param in command_of(group, path).params:
                if isinstance(param.type, (type(click.INT), type(click.FLOAT))):
                    yield f"{group.name} {' '.join(path)} {param.name}", param.type


def test_every_range_of_both_programs_is_in_plain_words() -> None:
    found = dict(ranges())
    assert len(found) > 60
    ours = (NumberRange, WholeRange)
    assert [
        name
        for name, kind in found.items()
        if isinstance(kind, (click.IntRange, click.FloatRange)) and not isinstance(kind, ours)
    ] == []
    # A parameter of the firmware has a range of its own, which it says itself.
    assert [name for name, kind in found.items() if not isinstance(kind, ours)] == [
        "daranti params set value"
    ]
