"""The page of the first power-up against the check and the firmware that it speaks of."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Final

import pytest
from click.testing import CliRunner

from hil.studies.building_mistakes import MISTAKES
from host.commands.cli import daranti
from host.link import protocol

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = (ROOT / "docs" / "build" / "first-power-up.md").read_text(encoding="utf-8")
TEXTS: Final = json.loads((ROOT / "host/panel/texts/en.json").read_text(encoding="utf-8"))
FIELD: Final = {"camera", "picture", "mount", "delay", "course", "receiver", "place", "field"}
LAPTOP: Final = {"disk", "laptop", "power"}
WIRING: Final = {
    finding: mistake.name
    for mistake in MISTAKES
    for finding in mistake.findings
    if finding.split(".")[0] not in FIELD | LAPTOP
}


@pytest.mark.parametrize("finding", WIRING)
def test_the_line_that_finds_a_wiring_mistake_is_in_the_table(finding: str) -> None:
    line = TEXTS[f"line.{finding.split('.', maxsplit=1)[0]}"]
    assert re.search(rf"^\| {re.escape(line)} \|", PAGE, re.MULTILINE), WIRING[finding]


def test_every_parameter_that_is_set_is_one() -> None:
    pages = PAGE + (ROOT / "docs" / "build" / "README.md").read_text(encoding="utf-8")
    named = re.findall(r"daranti params set (\w+)", pages)
    assert set(named) <= set(protocol.PARAMS)
    assert len(named) >= 5


def test_every_command_is_one_with_these_options() -> None:
    found = re.findall(r"^daranti ([a-z ]+?)(?: +(?:[-#A-Z]|\w+_\w+|\w+\.yaml).*)?$", PAGE, re.M)
    assert {"flash", "monitor", "params list", "identify", "check"} <= set(found)
    for words in found:
        assert CliRunner().invoke(daranti, [*words.split(), "--help"]).exit_code == 0, words
