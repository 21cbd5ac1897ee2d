"""The page of the first power-up, done on wrongly wired boards: each mistake is named by the first
row that shows something else than one must see."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import pytest

from hil.firmware import targets
from hil.studies.first_power_up import LOADER, SEEN, Wires, power_up

PAGE: Final = (Path(__file__).parents[3] / "docs" / "build" / "first-power-up.md").read_text(
    "utf-8"
)
STEPS: Final = dict(re.findall(r"^## (\d+)\. .*?\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))

MISTAKES: Final[tuple[tuple[str, dict[str, Any], str, str], ...]] = (
    ("e-stop's wire open", {"estop": "open"}, "loop", '"open": wire, contact'),
    ("e-stop's wire chafed", {"estop": "chafed"}, "loop", '"shorted"'),
    ("470 ohm forgotten", {"estop": "no resistor"}, "loop", "470 Ω missing"),
    ("button not in the loop", {"button": False}, "button", "the button is not in the loop"),
    ("no chassis strap", {"chassis_is_ground": False}, "chassis", "the chassis is not ground"),
    ("pot's 5 V wire open", {"pot_supply": False}, "pot", '"below": 5 V wire open'),
    ("pot's ground wire open", {"pot_ground": False}, "pot", "ground wire open"),
    ("pot's wiper wire open", {"pot_wiper": False}, "pot", "wiper or ground"),
    ("no pull-up at the wiper", {"pot_pull_up": False}, "wiper", "100 kΩ is missing"),
    (
        "pot's outer wires swapped",
        {"pot_turns_left": False},
        "way",
        "outer wires of the pot swapped",
    ),
    ("divider at the board's supply", {"divider": "supply"}, "no battery", "on the board's supply"),
    ("divider of 20 kohm", {"divider_lower_ohm": 20e3}, "volts", "divider's values"),
    ("pull-downs forgotten", {"pull_downs": False}, "twitch", "pull-downs"),
    ("active-low relay", {"relay_active_low": True}, "twitch", "an active-low relay"),
    ("wheel sensor silent", {"wheel": "silent"}, "wheel", "0: wire, pull-up"),
    ("magnet seen twice", {"wheel": "twice"}, "wheel", "a magnet seen twice"),
    ("wheel and blade swapped", {"wheel": "at the blade's pin"}, "wheel", "sensors are swapped"),
    ("wheel's sensors swapped", {"second_swapped": True}, "second", "swap the two sensors' wires"),
    ("sensor unplugged", {"steer_sense": "unplugged"}, "over-current", "wire or plug is out"),
    (
        "sensor in the wrong wire",
        {"drive_sense": "elsewhere"},
        "current",
        "sensor in the wrong wire",
    ),
)
pytestmark = pytest.mark.skipif(
    not (targets.AVR_LIBRARY.exists() and targets.AVR_IMAGE.exists() and LOADER.exists()),
    reason="not built: run `make build`",
)


def row(seen: str) -> str:
    """What the page says of it: a row of its step's table, or a paragraph or item of its text."""
    step, begins = SEEN[seen]
    text = STEPS[str(step)]
    parts = re.split(r"\n(?=[|\n*-])", text)
    found = [part for part in parts if part.strip("\n|- ").startswith(begins)]
    assert len(found) == 1, (begins, found)
    return found[0]


@pytest.mark.parametrize("seen", SEEN)
def test_what_must_be_seen_is_on_the_page(seen: str) -> None:
    assert row(seen)


def test_a_machine_that_is_wired_as_drawn_shows_what_it_must() -> None:
    assert power_up(Wires()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wires", "seen", "words"), [m[1:] for m in MISTAKES], ids=[m[0] for m in MISTAKES]
)
def test_the_first_row_that_differs_names_the_mistake(
    wires: dict[str, Any], seen: str, words: str
) -> None:
    found = power_up(Wires(**wires))
    assert found and found[0] == seen
    assert words in row(seen)
