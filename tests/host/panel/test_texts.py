"""Every text that a page or a check names is there, in every language."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from host.check.lines import NAMES
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import State
from host.core.vehicle import Vehicle
from host.field.boundary_file import Boundary, save_field
from host.link import protocol
from host.link.session import Link
from host.panel.fields import FieldDesk
from host.panel.snapshot import code_of, reasons
from host.panel.texts import LANGUAGES, text, texts
from host.pilot.phase import Phase
from host.sensors.camera_stream import camera_feed
from tests.helpers.fake_firmware import FakeFirmware

HOST = Path(__file__).parents[3] / "host"
STATIC = HOST / "panel" / "static"
PLACE = re.compile(r"\{(\w+)\}")
WRITTEN_FOR_ENGINEERS = {"parameters are one JSON object"}
SAME_IN_ALL = 12
"""Texts of figures and signs only."""


ROOMS = {key.split(".")[0] for key in texts(LANGUAGES[0]) if "." in key}
"""What the names of texts begin with."""


def keys_used() -> set[str]:
    """By the page's scripts and by the page, where they are written out whole."""
    found: set[str] = set()
    for file in STATIC.glob("*.js"):
        source = file.read_text(encoding="utf-8")
        found |= set(re.findall(r'\bt\(\s*"([\w.]+)"', source))
        # One of two, as in t(now ? "a.b" : "a.c"): what looks like a text's name is one.
        dotted = set(re.findall(r'"([a-z_]+(?:\.\w+)+)"', source))
        found |= {name for name in dotted if name.split(".")[0] in ROOMS}
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    return found | set(re.findall(r'data-(?:t|label)="([\w.]+)"', page))


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_the_page_says_is_there(language: str) -> None:
    known = texts(language)
    assert keys_used() - set(known) == set()
    for bit in protocol.Fault:
        assert {f"fault.{bit.name}", f"remedy.{bit.name}"} <= set(known)
    for name in NAMES:
        assert {f"line.{name}", f"expected.{name}"} <= set(known)
    refused = re.findall(r'"refused", "what": "(\w+)"', read(HOST / "panel" / "server.py"))
    assert len(refused) > 6
    assert {f"refused.{what}" for what in refused} <= set(known)
    assert {f"board.{state.name}" for state in State} <= set(known)
    assert {f"phase.{phase.value}" for phase in Phase} <= set(known)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_finding_of_the_check_has_its_words_and_its_remedy(language: str) -> None:
    known = texts(language)
    source = "".join(map(read, (HOST / "check").glob("*.py")))
    found = set(re.findall(rf'"((?:{"|".join(NAMES)})\.\w+)"', source))
    assert len(found) > 70
    good = {
        key
        for key in found
        if key.endswith((".ok", ".mains", ".none")) and f"todo.{key}" not in known
    }
    for key in found - {"picture.turned_left"}:
        assert f"found.{key}" in known
        assert key in good or f"todo.{key}" in known, key
    asked = set(re.findall(r'ask\(\s*"(\w+)"', source))
    assert len(asked) > 8
    assert {f"ask.{key}" for key in asked} <= set(known)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_reason_of_the_pilot_and_every_problem_at_the_start_has_its_words(
    language: str,
) -> None:
    known = texts(language)
    assert len(reasons()) > 30
    for reason in reasons():
        words = set(PLACE.findall(known[f"reason.{code_of(reason)}"]))
        assert words <= set(PLACE.findall(reason.text)), reason
    source = (HOST / "runs" / "preflight.py").read_text(encoding="utf-8")
    problems = set(re.findall(r'return Problem\(\s*"(\w+)"', source))
    assert len(problems) > 5
    assert {f"problem.{code}" for code in problems} <= set(known)


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_whole_sentence_of_panel_and_picture_is_known(language: str) -> None:
    known = texts(language)
    whole = [
        *re.findall(r'UserError\("([^"]+)"\)', "".join(map(read, (HOST / "panel").glob("*.py")))),
        *re.findall(r'return "(the [^"]+)"', read(HOST / "sensors" / "picture_watch.py")),
        *re.findall(r'return "([^"]+)"', read(HOST / "vision" / "mounted" / "detector.py")),
    ]
    whole = [one for one in whole if one not in WRITTEN_FOR_ENGINEERS]
    assert len(whole) > 15
    assert {f"said.{sentence}" for sentence in whole} - set(known) == set()


def fits(pattern: str, sentence: str) -> bool:
    parts = PLACE.split(pattern)
    whole = "".join(".*" if k % 2 else re.escape(part) for k, part in enumerate(parts))
    return re.fullmatch(whole, sentence, re.DOTALL) is not None


def refused_port() -> str:
    with pytest.raises(UserError) as refused:
        Link("/dev/ttyNONE", time.monotonic)
    return str(refused.value)


def unplugged_port() -> str:
    board = FakeFirmware()
    link = Link(board.port, time.monotonic)
    board.unplug()
    with pytest.raises(UserError) as vanished:
        while True:
            link.poll(0.1)
    link.close()
    return str(vanished.value)


def closed_phone() -> str:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
    feed = camera_feed(f"http://127.0.0.1:{number}/video", time.monotonic, lambda _: None)
    feed.start()
    end = time.monotonic() + 20
    while feed.problem is None and time.monotonic() < end:
        time.sleep(0.01)
    feed.close()
    return str(feed.problem)


@pytest.mark.parametrize("lacking", [refused_port, unplugged_port, closed_phone])
@pytest.mark.parametrize("language", LANGUAGES)
def test_what_a_device_lacks_has_its_words(language: str, lacking: Callable[[], str]) -> None:
    said = [key.removeprefix("said.") for key in texts(language) if key.startswith("said.")]
    sentence = lacking()
    assert any(fits(one, sentence) for one in said), sentence


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_the_field_refuses_has_its_words(language: str, tmp_path: Path) -> None:
    said = [key.removeprefix("said.") for key in texts(language) if key.startswith("said.")]
    frame = LocalFrame(31.5, 74.3)
    corners = tuple(frame.to_wgs84(*place) for place in ((0, 0), (9, 0), (19, 0.001), (9, 9)))
    save_field(tmp_path / "field.geojson", Boundary(corners, name="field"))
    (tmp_path / "panel.json").write_text('{"name": "field.geojson", "gap_m": 2.0, "corner": 0}')
    desk = FieldDesk(tmp_path, Vehicle(), None, None)
    for wish in (
        {"do": "gap", "gap_m": -1},
        {"do": "open", "name": "x"},
        {"do": "move_corner", "index": 1, "x": 500, "y": 0},
        {"do": "drop_corner", "index": 3},
        {"do": "drop_corner", "index": 7},
    ):
        desk.do(wish)
        assert desk.problem, wish
        assert any(fits(one, desk.problem) for one in said), desk.problem


def read(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def test_all_languages_say_the_same_things() -> None:
    first, *others = (texts(language) for language in LANGUAGES)
    for other in others:
        assert set(other) == set(first)
        for key, english in first.items():
            assert set(PLACE.findall(other[key])) == set(PLACE.findall(english)), key
        same = [key for key in first if other[key] == first[key]]
        assert len(same) <= SAME_IN_ALL, same


LEFT_TO_RIGHT = re.compile(
    r"`[^`]*`|--[a-z]+|(?:\{\w+\}|\d[\d.]*)°|\bk[pid] \{k[pid]\}|\d (?:L298N|BTS7960|VNH5019)"
)


def test_what_reads_from_the_left_is_kept_together_in_urdu() -> None:
    """Else `--gnss` shows as `gnss--`, and a figure stands at another one's name."""
    bare = {
        key: found[0]
        for key, words in texts("ur").items()
        for found in LEFT_TO_RIGHT.finditer(words)
        if words[: found.start()].count("\u2066") == words[: found.start()].count("\u2069")
    }
    assert bare == {}
    for key, words in texts("ur").items():
        assert words.count("\u2066") == words.count("\u2069"), key


def test_a_text_names_a_button_as_the_button_is_named() -> None:
    quoted = re.compile("[“”]([^“”]+)[“”]")
    for language in LANGUAGES:
        said = texts(language)
        for key, english in texts("en").items():
            for name, theirs in zip(
                quoted.findall(english), quoted.findall(said[key]), strict=True
            ):
                buttons = [one for one, words in texts("en").items() if words.startswith(name)]
                if buttons:
                    assert any(said[one].startswith(theirs) for one in buttons), (key, theirs)


def test_texts_are_filled_in() -> None:
    assert text("en", "found.battery.low", volts=10.5) == "10.5 V"
    assert text("en", "no such text") == "no such text"
