"""The pages in a real browser: Debian's Chromium as a phone and as a laptop, in both languages."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, Route, WebSocketRoute, expect, sync_playwright

from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.field.boundary_file import Boundary, load_field, save_field
from host.field.walk import read_fixes
from host.link import protocol
from host.panel.texts import LANGUAGES, text
from host.sensors.nmea import Receiver
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.served_panel import Served, served
from tests.helpers.walker import Place, around, walk

CHROMIUM = shutil.which("chromium")
ARGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
SIZES = {"phone": (390, 844), "laptop": (1280, 800)}
TABS = ("check", "field", "harvest", "tune", "runs")
PICTURES = os.environ.get("PANEL_PICTURES")
"""A folder for screenshots, to be looked at."""

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: tools/debian.sh")


@pytest.fixture(scope="module")
def board() -> Iterator[FakeFirmware]:
    firmware = FakeFirmware()
    yield firmware
    firmware.unplug()


@pytest.fixture(scope="module")
def panel(board: FakeFirmware, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("p")
    frame = LocalFrame(31.5, 74.3)
    corners = tuple(frame.to_wgs84(x, y) for x, y in ((0, 0), (30, 2), (28, 24), (-2, 20)))
    save_field(folder / "field.geojson", Boundary(corners, name="field"))
    (folder / "panel.json").write_text('{"name": "field.geojson", "gap_m": 2.0, "corner": 0}')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        with served(board.port, folder) as found:
            yield found


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=ARGS)
        yield opened
        opened.close()


Json = dict[str, Any]


class Line:
    """The page's socket, on which more is said than the panel says."""

    def __init__(self) -> None:
        self.more: Json = {}
        """What is put into each snapshot."""
        self.keeps: frozenset[str] = frozenset()
        """What the page asks for that the panel shall not hear,"""
        self.kept: list[Json] = []
        """and what it asked for."""
        self.mutes: frozenset[str] = frozenset()
        """Kinds of the panel's messages that the page shall not hear."""
        self.say: Callable[[Json], None] = lambda _: None
        self.close: Callable[[], None] = lambda: None
        self.opened = 0
        """How many sockets so far,"""
        self.hung = 0
        """and how many of them lead nowhere, as over a Wi-Fi that is lost: each stays open."""

    def through(self, page_end: WebSocketRoute) -> None:
        """Between a page and the panel."""
        panel_end = page_end.connect_to_server()
        self.opened += 1
        number = self.opened

        def pass_on(message: str | bytes) -> None:
            told = json.loads(message) if isinstance(message, str) else {}
            if told.get("kind") in self.mutes or number <= self.hung:
                return
            page_end.send(json.dumps(told | self.more) if told.get("kind") == "now" else message)

        def pass_in(message: str | bytes) -> None:
            wish = json.loads(message)
            if number <= self.hung:
                return
            if wish["do"] in self.keeps:
                wish.pop("seen", None)  # when it was asked: another each time
                self.kept.append(wish)
            else:
                panel_end.send(message)

        panel_end.on_message(pass_on)
        page_end.on_message(pass_in)
        self.say = lambda message: page_end.send(json.dumps(message))
        self.close = page_end.close


def opened(
    browser: Browser, panel: Served, size: str, language: str, line: Line | None = None
) -> Page:
    width, height = SIZES[size]
    phone = size == "phone"
    context = browser.new_context(
        viewport={"width": width, "height": height},
        is_mobile=phone,
        has_touch=phone,
        locale={"en": "en-GB", "ur": "ur-PK"}[language],
    )
    page = context.new_page()
    if line is not None:
        page.route_web_socket("**/live", line.through)
    page.set_default_timeout(30_000)
    page.goto(f"http://{panel.host}/")
    expect(page.locator("#signal-board")).to_contain_text(
        text(language, "board.SAFE"), timeout=60_000
    )
    return page


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("size", SIZES)
def test_every_page_stands_fits_and_can_be_used_by_everybody(
    browser: Browser, panel: Served, size: str, language: str
) -> None:
    page = opened(browser, panel, size, language)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "request",
        lambda request: None if panel.host in request.url else wrong.append(request.url),
    )
    assert page.locator("html").get_attribute("dir") == ("rtl" if language == "ur" else "ltr")
    for tab in TABS:
        page.click(f"#tabs button[data-tab={tab}]")
        expect(page.locator(f"#page-{tab} h1")).to_have_text(
            text(language, f"{tab}.title"), ignore_case=True
        )
        if tab == "field":
            expect(page.locator("#plan-said")).not_to_have_text(text(language, "plan.none"))
        if PICTURES:
            page.screenshot(path=Path(PICTURES) / f"{tab}-{language}-{size}.png")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), tab
        stop = page.locator("#stop").bounding_box()
        assert stop is not None
        assert stop["y"] >= 0
        assert stop["y"] + stop["height"] <= SIZES[size][1]
        assert stop["height"] >= 60
        found = Axe().run(page, options={"runOnly": ["wcag2a", "wcag2aa", "wcag21aa", "wcag2aaa"]})
        assert found.violations_count == 0, found.generate_report()
        unsaid = page.evaluate(
            "[...document.querySelectorAll('[data-t]')].filter(e => e.textContent === e.dataset.t)"
            ".map(e => e.dataset.t)"
        )
        assert unsaid == []
    assert wrong == []
    page.context.close()


def test_stop_is_acknowledged_by_the_board_on_the_screen(
    browser: Browser, panel: Served, board: FakeFirmware
) -> None:
    page = opened(browser, panel, "phone", "en")
    said = page.locator("#stop-said")
    board.telemetry = replace(RESTING, state=protocol.State.RUNNING, drive_duty=90)
    page.wait_for_timeout(300)
    page.locator("#stop").dispatch_event("pointerdown")
    expect(said).to_contain_text("NOT CONFIRMED", timeout=10_000)
    board.telemetry = RESTING
    expect(said).to_contain_text("The board confirms", timeout=10_000)
    page.context.close()


def test_a_fault_is_shown_with_its_remedy_and_heard(
    browser: Browser, panel: Served, board: FakeFirmware
) -> None:
    page = opened(browser, panel, "phone", "ur")
    page.click("#tabs button[data-tab=harvest]")  # a touch, without which browsers allow no sound
    page.evaluate("window.tones = []; addEventListener('tone', (e) => tones.push(e.detail))")
    board.telemetry = replace(
        RESTING, state=protocol.State.FAULT, faults=protocol.Fault.BATTERY_LOW
    )
    expect(page.locator("#faults")).to_contain_text(text("ur", "remedy.BATTERY_LOW"))
    assert page.evaluate("tones.length") >= 8
    board.telemetry = RESTING
    page.context.close()


def test_what_a_device_lacks_is_said_in_the_pages_language(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "ur", line)
    page.click("#tabs button[data-tab=harvest]")
    port = "serial port /dev/ttyACM0 does not exist; ports there now: none"
    line.more = {
        "link": {"port": "", "problem": port, "firmware": None, "refusal": ""},
        "camera": {"there": True, "problem": "[Errno 111] Connection refused", "age_s": None},
    }
    refused = text("ur", "said.[Errno {number}] Connection refused")
    expect(page.locator("#picture-said")).to_contain_text(refused, timeout=10_000)
    why = page.inner_text("#state-why")
    assert "/dev/ttyACM0" in why
    assert "serial" not in why
    expect(page.locator("#start-why")).to_have_text(text("ur", "why.no_board"))
    expect(page.locator("#start")).to_be_disabled()
    page.context.close()


SQUARE = ((0, 0), (20, 0), (20, 20), (0, 20))
STRIP = ((0, 0), (20, 0), (20, 5), (0, 5))
PLAN = {
    "kind": "plan",
    "boundary": SQUARE,
    "keep_outs": [],
    "gap_m": 2.0,
    "sides": [[[20, 0], [20, 20]]],
}
SHARE_OF_COLOUR = """
(colour) => {
  const canvas = document.getElementById("map");
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let found = 0;
  for (let k = 0; k < pixels.length; k += 4)
    if (colour.every((value, c) => Math.abs(pixels[k + c] - value) < 3)) found += 1;
  return found / (pixels.length / 4);
}
"""
CUT, STANDING = [230, 200, 110], [46, 125, 50]


def test_the_map_shows_what_earlier_runs_have_cut(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")

    def shares() -> tuple[float, float]:
        page.evaluate("new Promise(requestAnimationFrame)")
        cut, standing = (page.evaluate(SHARE_OF_COLOUR, one) for one in (CUT, STANDING))
        return cut, standing

    def settled(plan: Json) -> tuple[float, float]:
        line.say(plan)
        page.wait_for_timeout(400)
        return shares()

    nothing, whole = settled(PLAN | {"anew": False, "cut": []})
    assert nothing < 0.005
    cut, left = settled(PLAN | {"anew": False, "cut": [STRIP]})
    assert cut == pytest.approx(whole / 4, rel=0.15)
    assert left == pytest.approx(whole * 3 / 4, rel=0.05)
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / "cut-before.png")
    line.say({"kind": "trail", "places": [[5.0, 8.0, 0.0], [5.5, 8.0, 0.0], [6.0, 8.0, 0.0]]})
    cut_now, _ = settled(PLAN | {"anew": True, "cut": [STRIP]})
    assert cut_now > cut, "a plan that is laid out anew leaves the trail"
    page.context.close()


def test_the_words_of_a_stop_go_when_something_begins(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.locator("#stop").dispatch_event("pointerdown")
    said = page.locator("#stop-said")
    expect(said).to_contain_text("STOPPED", timeout=10_000)
    page.wait_for_timeout(800)
    expect(said).to_contain_text("STOPPED")  # they stay for as long as it stands
    line.more = {"mode": "countdown", "countdown_s": 4.0}
    expect(said).to_be_empty(timeout=5_000)
    page.context.close()


@pytest.mark.parametrize("language", LANGUAGES)
def test_why_it_did_not_start_is_seen_beside_the_button_that_was_held(
    browser: Browser, panel: Served, language: str
) -> None:
    """On a phone that button is a screen below the page's head."""
    line = Line()
    line.more = {"driver": True, "driven": True}
    page = opened(browser, panel, "phone", language, line)
    page.click("#tabs button[data-tab=harvest]")
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    line.say({"kind": "failed", "what": "prepare", "why": "the board does not answer"})
    notice = page.locator("#notice")
    expect(notice).to_contain_text(text(language, "said.the board does not answer"))
    box, head, foot = (page.locator(one).bounding_box() for one in ("#notice", "header", "footer"))
    assert box is not None
    assert head is not None
    assert foot is not None
    assert page.evaluate("scrollY") > 300
    assert head["y"] + head["height"] <= box["y"]
    assert box["y"] + box["height"] <= foot["y"]
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"notice-{language}.png")
    page.context.close()


HIDDEN = """
() => {
  const one = document.activeElement, box = one.getBoundingClientRect();
  if (one === document.body || one.closest("header, footer")) return "";
  const top = document.querySelector("header").getBoundingClientRect().bottom;
  const bottom = document.querySelector("footer").getBoundingClientRect().top;
  const name = one.id || one.textContent || one.tagName;
  if (box.height > bottom - top) return box.top < bottom && box.bottom > top ? "" : name;
  return box.top >= top - 1 && box.bottom <= bottom + 1 ? "" : `${name} ${box.top} ${box.bottom}`;
}
"""
NAME = "document.activeElement.id || document.activeElement.outerHTML"
MOST_STOPS = 80


@pytest.mark.parametrize("size", SIZES)
def test_what_has_the_focus_is_never_under_the_bars(
    browser: Browser, panel: Served, size: str
) -> None:
    """Forwards and backwards through each page by the keyboard: WCAG 2.2, 2.4.12."""
    line = Line()
    line.more = {"driver": True}
    page = opened(browser, panel, size, "en", line)
    for tab in TABS:
        page.click(f"#tabs button[data-tab={tab}]")
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        for key in ("Tab", "Shift+Tab"):
            page.locator("#tabs button").first.focus()
            page.evaluate("scrollTo(0, 0)")
            seen = set()
            for _ in range(MOST_STOPS):
                page.keyboard.press(key)
                assert page.evaluate(HIDDEN) == "", (tab, key)
                name = page.evaluate(
                    "document.activeElement.id || document.activeElement.outerHTML"
                )
                if name in seen:
                    break
                seen.add(name)
            assert "stop" in seen
            assert len(seen) >= 8
    page.context.close()


def test_a_run_that_ended_is_gone_on_with_before_another_is_begun(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    line.more = {"driver": True, "green": True}
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")
    expect(page.locator("#start-word")).to_have_text(text("en", "harvest.start"))
    line.say({"kind": "ended", "outcome": "stopped", "reason": "", "resume": "x"})
    expect(page.locator("#start-word")).to_have_text(text("en", "harvest.start_anew"))
    places = [page.locator(one).bounding_box() for one in ("#resume", "#start")]
    assert places[0] is not None
    assert places[1] is not None
    assert places[0]["y"] < places[1]["y"]
    line.say({"kind": "goal", "place": None, "stuck": True})
    expect(page.locator("#goal-said")).to_have_text(text("en", "harvest.stuck"))
    expect(page.locator("#resume")).to_be_hidden()
    expect(page.locator("#start-word")).to_have_text(text("en", "harvest.start"))
    page.context.close()


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_cannot_be_begun_says_why(browser: Browser, panel: Served, language: str) -> None:
    line = Line()
    page = opened(browser, panel, "phone", language, line)
    begins = {"check": "#check-go", "field": "#walk-begin", "tune": "#pid-go", "harvest": "#start"}
    reasons = {"check": "#check-why", "field": "#walk-why", "tune": "#pid-why"}
    for more, why in (
        ({"driven": True, "driver": False}, "why.other_drives"),
        ({"driver": True, "mode": "jog"}, "why.busy"),
    ):
        line.more = more
        for tab, said in reasons.items():
            page.click(f"#tabs button[data-tab={tab}]")
            expect(page.locator(said)).to_have_text(text(language, why))
            expect(page.locator(begins[tab])).to_be_disabled()
    line.more = {"driver": False, "driven": False}
    page.click("#tabs button[data-tab=field]")
    expect(page.locator("#walk-why")).to_have_text(text(language, "why.no_gnss"))
    page.click("#tabs button[data-tab=harvest]")
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator("#start-why")).to_have_text(text(language, "why.not_driver"))
    page.context.close()


# ---- the field, walked ---------------------------------------------------------------------------

FOUR: list[Place] = [(0, 0), (14, 1), (13, 12), (-1, 11)]
ROUND: list[Place] = [
    (12 * math.cos(k * math.tau / 60), 12 * math.sin(k * math.tau / 60)) for k in range(60)
]
ANGLE: list[Place] = [(0, 0), (14, 0), (14, 6), (6, 6), (6, 14), (0, 14)]
"""An L: no first strip ends on open ground along the edges at its inner corner."""
LATIN = re.compile(r"[A-Za-z]{2}")


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A panel whose receiver is connected and silent: a test says what was walked."""
    folder = tmp_path_factory.mktemp("w")
    firmware = FakeFirmware()
    with (
        pytest.MonkeyPatch.context() as patch,
        socket.create_server(("127.0.0.1", 0)) as phone,
    ):
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        address = f"tcp://127.0.0.1:{phone.getsockname()[1]}"
        with served(firmware.port, folder, gnss=address) as found:
            yield found
    firmware.unplug()


def fixes(corners: list[Place]) -> list[Fix]:
    """Of two laps."""
    lines = [f"{line}\r\n".encode() for line in walk(around(corners, laps=2))]
    return read_fixes(lines, Receiver())


def walk_around(page: Page, panel: Served, corners: list[Place]) -> None:
    """From the button to the plan."""
    page.click("#tabs button[data-tab=field]")
    page.click("#walk-begin")
    expect(page.locator("#walk-end")).to_be_visible()
    walk = panel.panel.fields.walk
    assert walk is not None
    walk.fixes += fixes(corners)
    page.click("#walk-end")
    expect(page.locator("#walk-end")).to_be_hidden(timeout=60_000)


def on_disk(panel: Served) -> Boundary:
    """The field as the panel has written it."""
    path = panel.panel.fields.path
    assert path is not None
    return load_field(path)


def filled(language: str, key: str) -> re.Pattern[str]:
    """A text with whatever its figures are."""
    parts = re.split(r"\{\w+\}", text(language, key))
    return re.compile(".*".join(map(re.escape, parts)))


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_says_what_it_took_a_walk_for_and_takes_the_other(
    browser: Browser, walked: Served, language: str
) -> None:
    page = opened(browser, walked, "phone", language)
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    walk_around(page, walked, FOUR)
    said = page.locator("#field-said")
    straight, recorded = page.locator("#form-straight"), page.locator("#form-walked")
    expect(said).to_have_text(filled(language, "field.said"))
    expect(straight).to_have_attribute("aria-pressed", "true")
    assert on_disk(walked).recorded is False
    page.evaluate("scrollTo(0, 0)")
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"walked-{language}.png")
    for one in (straight, recorded):
        box = one.bounding_box()
        assert box is not None
        assert box["height"] >= 44
    recorded.click()
    expect(said).to_have_text(filled(language, "field.said.recorded"), timeout=60_000)
    expect(recorded).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#plan-said")).to_have_text(filled(language, "plan.said"))
    assert on_disk(walked).recorded is True
    found = Axe().run(page, options={"runOnly": ["wcag2a", "wcag2aa", "wcag21aa", "wcag2aaa"]})
    assert found.violations_count == 0, found.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    straight.press("Enter")
    expect(said).to_have_text(filled(language, "field.said"), timeout=60_000)
    assert on_disk(walked).recorded is False
    assert wrong == []
    page.context.close()


def test_keep_outs_stay_when_a_walk_is_taken_for_the_other(
    browser: Browser, walked: Served
) -> None:
    page = opened(browser, walked, "phone", "en")
    walk_around(page, walked, FOUR)
    page.click("#field-keep-out")
    middle = page.locator("#field-map")
    for x, y in ((120, 160), (160, 160), (160, 200), (120, 200)):
        middle.click(position={"x": x, "y": y})
    page.click("#field-keep-out")
    expect(page.locator("#field-said")).to_contain_text("1 keep-out", timeout=60_000)
    was = on_disk(walked)
    page.click("#form-walked")
    expect(page.locator("#form-walked")).to_have_attribute("aria-pressed", "true", timeout=60_000)
    now = on_disk(walked)
    assert (was.recorded, now.recorded) == (False, True)
    before, after = (one.polygon(was.frame).interiors for one in (was, now))
    assert [list(hole.bounds) for hole in after] == [
        pytest.approx(hole.bounds, abs=0.01) for hole in before
    ]
    page.context.close()


def asked_corners(page: Page, panel: Served, language: str, every: int = 1) -> Iterator[str]:
    """Chooses one point of the boundary after the other to begin at, and waits for its plan."""
    for asked in map(str, range(0, len(on_disk(panel).crop), every)):
        page.locator("#field-corner").select_option(asked)
        expect(page.locator("#field-problem")).not_to_have_text(
            text(language, "field.working"), timeout=60_000
        )
        yield asked


@pytest.mark.parametrize("language", LANGUAGES)
def test_where_the_machine_cannot_begin_the_page_takes_another_corner_and_says_so(
    browser: Browser, walked: Served, language: str
) -> None:
    """Along an edge that ends at an inner corner no first strip ends on open ground."""
    page = opened(browser, walked, "phone", language)
    walk_around(page, walked, ANGLE)
    wrong = page.locator("#field-problem")
    told = 0
    for asked in asked_corners(page, walked, language):
        expect(page.locator("#plan-said")).to_have_text(filled(language, "plan.said"))
        expect(wrong).not_to_have_text(LATIN if language == "ur" else re.compile("--corner"))
        if page.locator("#field-corner").input_value() != asked:
            told += 1
            expect(wrong).to_have_text(filled(language, "field.begins"))
    assert told > 0
    page.context.close()


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_round_field_is_begun_at_any_of_its_points_in_standing_crop(
    browser: Browser, walked: Served, language: str
) -> None:
    page = opened(browser, walked, "phone", language)
    walk_around(page, walked, ROUND)
    page.click("#form-walked")
    expect(page.locator("#form-walked")).to_have_attribute("aria-pressed", "true", timeout=60_000)
    for asked in asked_corners(page, walked, language, every=8):
        expect(page.locator("#field-problem")).to_have_text(filled(language, "field.inside"))
        assert page.locator("#field-corner").input_value() == asked
    page.context.close()


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_walk_that_leads_around_nothing_is_said_to(
    browser: Browser, walked: Served, language: str
) -> None:
    page = opened(browser, walked, "phone", language)
    page.click("#tabs button[data-tab=field]")
    page.click("#walk-begin")
    expect(page.locator("#walk-end")).to_be_visible()
    walk = walked.panel.fields.walk
    assert walk is not None
    walk.fixes += fixes(FOUR)[:20]
    page.click("#walk-end")
    wrong = page.locator("#field-problem")
    expect(wrong).to_have_text(re.compile("1[0-9] m|1[0-9].? میٹر"), timeout=20_000)
    expect(wrong).not_to_have_text(LATIN if language == "ur" else re.compile("--"))
    expect(page.locator("#walk-end")).to_be_visible()  # it can be walked on
    page.click("#walk-drop")
    expect(page.locator("#walk-end")).to_be_hidden(timeout=20_000)
    page.context.close()


def test_done_that_is_pressed_twice_makes_one_field(browser: Browser, walked: Served) -> None:
    page = opened(browser, walked, "phone", "en")
    page.click("#tabs button[data-tab=field]")
    page.click("#walk-begin")
    expect(page.locator("#walk-end")).to_be_visible()
    walk = walked.panel.fields.walk
    assert walk is not None
    walk.fixes += fixes(FOUR)
    before = walked.panel.fields.files()
    page.click("#walk-end")
    expect(page.locator("#field-problem")).to_have_text(text("en", "field.working"))
    page.wait_for_timeout(1100)  # a field is named by its second
    page.evaluate("document.getElementById('walk-end').click()")
    expect(page.locator("#walk-end")).to_be_hidden(timeout=60_000)
    page.wait_for_timeout(3000)
    assert len(walked.panel.fields.files()) == len(before) + 1
    page.context.close()


FIELD = {
    "kind": "field",
    "name": "field.geojson",
    "files": ["field.geojson"],
    "gap_m": 0.0,
    "corner": 0,
    "problem": "",
    "asked": None,
    "walk": None,
    "summary": None,
    "here": None,
    "walked": None,
    "recorded": True,
    "boundary": SQUARE,
    "keep_outs": [],
    "area_m2": 400.0,
    "plan": {"sides": [[[2, 5], [15, 10], [2, 15]]]},
}
SCALE = 700 / 24
"""Of SQUARE with its 2 m of room, in pixels of the map."""


def test_a_strip_that_bends_is_drawn_along_its_bend(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=field]")
    page.wait_for_timeout(500)
    line.say(FIELD)
    page.wait_for_timeout(300)
    colours = page.evaluate(
        """(places) => places.map(([u, v]) => [...document.getElementById("field-map")
             .getContext("2d").getImageData(u, v, 1, 1).data].slice(0, 3))""",
        [[(x + 2) * SCALE, 700 - (y + 2) * SCALE] for x, y in ((8.5, 7.5), (8.5, 12.5), (2, 10))],
    )
    white = [min(colour) > 150 for colour in colours]
    assert white == [True, True, False], colours
    page.context.close()


def test_a_corner_lands_where_the_finger_left_it(browser: Browser, walked: Served) -> None:
    """Whatever comes meanwhile: the receiver's next position, or a map that has to grow."""
    line = Line()
    page = opened(browser, walked, "phone", "en", line)
    walk_around(page, walked, FOUR)
    before = on_disk(walked)
    told = json.loads(json.dumps(walked.panel.field))
    page.click("#field-move")
    page.locator("#field-map").scroll_into_view_if_needed()
    page.evaluate("scrollTo(0, 0)")
    box = page.locator("#field-map").bounding_box()
    assert box is not None
    xs, ys = zip(*told["boundary"], strict=True)
    room = 2.0
    scale = box["width"] / (max(max(xs) - min(xs), max(ys) - min(ys)) + 2 * room)
    spare = (box["width"] - (max(xs) - min(xs) + 2 * room) * scale) / 2
    sunk = (box["height"] - (max(ys) - min(ys) + 2 * room) * scale) / 2

    def on_screen(x: float, y: float) -> tuple[float, float]:
        right = spare + (x - min(xs) + room) * scale
        up = sunk + (y - min(ys) + room) * scale
        return box["x"] + right, box["y"] + box["height"] - up

    east = xs.index(max(xs))
    x, y = told["boundary"][east]
    target = (x + 1.6, y + 0.5)
    page.mouse.move(*on_screen(x, y))
    page.mouse.down()
    for share in (0.25, 0.5, 0.75, 0.9, 1.0, 1.0, 1.0):
        page.mouse.move(*on_screen(x + 1.6 * share, y + 0.5 * share))
    line.say(told)
    page.wait_for_timeout(200)
    page.mouse.up()
    expect(page.locator("#field-problem")).not_to_have_text(
        text("en", "field.working"), timeout=60_000
    )
    deadline = 50
    while on_disk(walked) == before and deadline:
        page.wait_for_timeout(100)
        deadline -= 1
    there = [before.frame.to_local(*corner) for corner in on_disk(walked).crop]
    assert min(math.dist(one, target) for one in there) < 0.3, there
    page.context.close()


NUMBERS = """
() => {
window.numbers = [];
const fillText = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (said, u, v) {
  if (/^\\d+$/.test(said)) window.numbers.push([Number(said), u, v]);
  return fillText.call(this, said, u, v);
};
}
"""


def test_the_numbers_of_many_points_do_not_cover_each_other(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=field]")
    page.wait_for_timeout(500)
    page.evaluate(NUMBERS)
    many = [
        (10 + 10 * math.cos(k * math.tau / 90), 10 + 10 * math.sin(k * math.tau / 90))
        for k in range(90)
    ]
    page.evaluate("numbers.length = 0")
    line.say(FIELD | {"boundary": many, "corner": 41})
    page.wait_for_timeout(300)
    numbers = page.evaluate("numbers")
    assert 42 in {number for number, _, _ in numbers}, "where the machine begins"
    drawn = {(u, v) for _, u, v in numbers}
    apart = [math.dist(one, other) for one in drawn for other in drawn if one != other]
    assert len(drawn) > 20
    assert min(apart) > 34
    page.context.close()


# ---- by keyboard ---------------------------------------------------------------------------------

FOCUSED = "document.activeElement.getAttribute('aria-label')"
RING = "parseFloat(getComputedStyle(document.activeElement).outlineWidth)"


def by_keys(browser: Browser, panel: Served, line: Line, tool: str) -> Page:
    """A page that shows FIELD, one of its tools chosen with a key; what it asks of the field stays
    with the line."""
    line.more = {"driver": True, "driven": True}
    line.keeps = frozenset({"move_corner", "add_corner", "drop_corner", "keep_out"})
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=field]")
    expect(page.locator("#plan-said")).not_to_have_text(text("en", "plan.none"))
    line.mutes = frozenset({"field"})
    line.say(FIELD)
    expect(page.locator("#field-said")).to_contain_text("4 points, 400 m²")
    page.locator(tool).press("Enter")
    return page


def keys(page: Page, *names: str) -> None:
    """Pressed one after the other."""
    for name in names:
        page.keyboard.press(name)


def asked(page: Page, line: Line, count: int) -> list[Json]:
    """So many wishes, when they have come."""
    for _ in range(100):
        if len(line.kept) >= count:
            break
        page.wait_for_timeout(50)
    assert len(line.kept) == count, line.kept
    return line.kept


def test_a_corner_is_moved_by_keys_and_told_once(browser: Browser, panel: Served) -> None:
    line = Line()
    page = by_keys(browser, panel, line, "#field-move")
    assert page.evaluate(FOCUSED) == "Corner 1 of 4: 20.0 m to corner 4, 20.0 m to corner 2"
    keys(page, "Tab")
    assert page.evaluate(FOCUSED).startswith("Corner 2 of 4")
    assert page.evaluate(HIDDEN) == ""
    assert page.evaluate(RING) >= 3
    keys(page, "ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft", "Shift+ArrowDown")
    assert page.evaluate(FOCUSED) == "Corner 2 of 4: 20.2 m to corner 1, 21.0 m to corner 3"
    expect(page.locator("#field-moved")).to_contain_text("0.2 m east + 1.0 m south")
    assert line.kept == [], "the plan is not made anew at each key"
    (told,) = asked(page, line, 1)  # nobody presses Enter
    assert told == {"do": "move_corner", "index": 1, "x": pytest.approx(20.2), "y": -1}
    keys(page, "ArrowUp", "Enter")
    told = asked(page, line, 2)[1]
    assert (told["x"], told["y"]) == (pytest.approx(20.2), pytest.approx(-0.9))
    keys(page, "ArrowUp", "Escape")
    assert page.evaluate("document.activeElement.id") == "field-move"
    assert asked(page, line, 3)[2]["y"] == pytest.approx(-0.8), "what was moved is not lost"
    keys(page, "Enter")
    expect(page.locator(".handle")).to_have_count(0)
    page.context.close()


def test_keys_that_come_while_the_plan_is_made_move_on_from_where_the_corner_is(
    browser: Browser, panel: Served
) -> None:
    """The panel counts from the first corner: when that has moved, all its places are others."""
    line = Line()
    page = by_keys(browser, panel, line, "#field-move")
    keys(page, "Shift+ArrowRight", "Enter", "Shift+ArrowRight")
    line.say(FIELD | {"boundary": [[0, 0], [19, 0], [19, 20], [-1, 20]], "area_m2": 390.0})
    expect(page.locator("#field-said")).to_contain_text("390 m²")
    keys(page, "Enter")
    first, second = asked(page, line, 2)
    assert (first["x"], second["x"]) == (1, 1)
    page.context.close()


def test_corners_are_added_and_removed_by_keys(browser: Browser, panel: Served) -> None:
    line = Line()
    page = by_keys(browser, panel, line, "#field-move")
    keys(page, "Insert", "Insert", "Delete")
    assert asked(page, line, 1) == [{"do": "add_corner", "index": 0}], "numbers change: one by one"
    line.say(FIELD | {"boundary": [[0, 0], [10, 0], *SQUARE[1:]]})
    expect(page.locator(".handle")).to_have_count(5)
    assert page.evaluate(FOCUSED).startswith("Corner 2 of 5"), "the new one"
    keys(page, "Tab", "Tab", "Tab", "Delete")
    assert asked(page, line, 2)[1] == {"do": "drop_corner", "index": 4}
    line.say(FIELD)
    expect(page.locator(".handle")).to_have_count(4)
    assert page.evaluate(FOCUSED).startswith("Corner 4 of 4"), "the focus is not lost"
    page.context.close()


def test_a_keep_out_is_marked_by_keys(browser: Browser, panel: Served) -> None:
    line = Line()
    page = by_keys(browser, panel, line, "#field-keep-out")
    assert page.evaluate(FOCUSED).startswith("Cross: 14.1 m to corner 1; 0 points set")
    keys(page, "Enter", "Shift+ArrowRight", "Enter", "Shift+ArrowUp", "Enter", "Enter", "Delete")
    assert "3 points set" in page.evaluate(FOCUSED)
    keys(page, "Escape", "Enter")
    (told,) = asked(page, line, 1)
    assert told == {"do": "keep_out", "ring": [[10, 10], [11, 10], [11, 11]]}
    page.context.close()


def test_the_panel_adds_and_removes_the_corners_that_keys_ask_for(
    browser: Browser, walked: Served
) -> None:
    page = opened(browser, walked, "phone", "en")
    walk_around(page, walked, FOUR)
    planned = page.locator("#field-problem")
    page.locator("#field-move").press("Enter")
    for key, corners in (("Insert", 5), ("Delete", 4), ("Delete", 3)):
        keys(page, key)
        expect(planned).not_to_have_text(text("en", "field.working"), timeout=60_000)
        expect(page.locator(".handle")).to_have_count(corners)
        assert len(on_disk(walked).crop) == corners
    keys(page, "Delete")
    expect(planned).to_contain_text(text("en", "said.a field has three corners at least"))
    page.context.close()


# ---- by finger and mouse -------------------------------------------------------------------------


def by_hand(browser: Browser, panel: Served, line: Line, tool: str, size: str = "phone") -> Page:
    """As `by_keys`, the tool chosen by a finger, or on the laptop by the mouse."""
    line.more = {"driver": True, "driven": True}
    line.keeps = frozenset({"move_corner", "add_corner", "drop_corner", "keep_out"})
    page = opened(browser, panel, size, "en", line)
    page.click("#tabs button[data-tab=field]")
    expect(page.locator("#plan-said")).not_to_have_text(text("en", "plan.none"))
    line.mutes = frozenset({"field"})
    line.say(FIELD)
    expect(page.locator("#field-said")).to_contain_text("4 points, 400 m²")
    button = page.locator(tool)
    button.tap() if size == "phone" else button.click()
    page.locator("#field-map").evaluate("map => map.scrollIntoView({ block: 'center' })")
    return page


def spot(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where on the screen FIELD's map has a place."""
    box = page.locator("#field-map").bounding_box()
    assert box is not None
    right, up = ((each + 2) * SCALE / 700 for each in (x, y))
    return box["x"] + right * box["width"], box["y"] + (1 - up) * box["height"]


def finger(page: Page, kind: str, *places: tuple[float, float]) -> None:
    """Down at the first place and on to the others; then up, or whatever `kind` ends it."""
    session = page.context.new_cdp_session(page)
    for k, place in enumerate(places):
        u, v = spot(page, *place)
        event = {"type": "touchMove" if k else "touchStart", "touchPoints": [{"x": u, "y": v}]}
        session.send("Input.dispatchTouchEvent", event)
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": []})


def mouse(page: Page, *places: tuple[float, float]) -> None:
    """The same with the mouse."""
    page.mouse.move(*spot(page, *places[0]))
    page.mouse.down()
    for place in places[1:]:
        page.mouse.move(*spot(page, *place))
    page.mouse.up()


FIVE = [[0, 0], [10, -1], *SQUARE[1:]]


@pytest.mark.parametrize("size", ["phone", "laptop"])
def test_a_side_s_middle_becomes_a_corner_where_it_is_dragged_and_goes_again(
    browser: Browser, panel: Served, size: str
) -> None:
    line = Line()
    page = by_hand(browser, panel, line, "#field-move", size)
    way = [(10.2, 0.1), (10, -0.2), (10, -0.6), (10, -1)]
    finger(page, "touchEnd", *way) if size == "phone" else mouse(page, *way)
    (told,) = asked(page, line, 1)
    assert (told["do"], told["index"]) == ("add_corner", 0)
    assert (told["x"], told["y"]) == pytest.approx((10, -1), abs=0.1)
    drop = page.locator("#field-drop")
    expect(drop).to_be_disabled()  # the plan is being made: numbers may change
    line.say(FIELD | {"boundary": FIVE})
    expect(drop).to_have_text("Remove corner 2")
    expect(drop).to_be_enabled()
    box = drop.bounding_box()
    assert box is not None
    assert min(box["width"], box["height"]) >= 44
    drop.tap() if size == "phone" else drop.click()
    assert asked(page, line, 2)[1] == {"do": "drop_corner", "index": 1}
    expect(drop).to_be_hidden()
    page.context.close()


def test_a_touch_chooses_a_corner_and_moves_none(browser: Browser, panel: Served) -> None:
    line = Line()
    page = by_hand(browser, panel, line, "#field-move")
    drop = page.locator("#field-drop")
    expect(drop).to_be_hidden()
    for corner, place in ((3, (20.3, 19.8)), (4, (0.2, 20))):
        finger(page, "touchEnd", place, (place[0] + 0.2, place[1]))  # 3 px: no finger holds still
        expect(drop).to_have_text(f"Remove corner {corner}")
        expect(page.locator("#field-moved")).to_contain_text(f"Corner {corner} of 4")
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / "corner-chosen.png")
    finger(page, "touchEnd", (10, 10))
    expect(drop).to_be_hidden()
    finger(page, "touchEnd", (20, 10))
    assert asked(page, line, 1) == [{"do": "add_corner", "index": 1, "x": 20, "y": 10}]
    expect(drop).to_have_text("Remove corner 3")
    line.say(FIELD | {"name": "other.geojson"})
    expect(drop).to_be_hidden()
    page.context.close()


def test_a_finger_that_the_browser_takes_away_adds_and_moves_nothing(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = by_hand(browser, panel, line, "#field-move")
    finger(page, "touchCancel", (10, 0), (10, 3))
    finger(page, "touchCancel", (20, 20), (18, 18))
    page.mouse.move(*spot(page, 5, 5))
    finger(page, "touchEnd", (0, 0), (0, 1))
    (told,) = asked(page, line, 1)
    assert (told["do"], told["index"]) == ("move_corner", 0)
    page.context.close()


def test_a_short_side_has_no_handle_in_the_way_of_its_corners(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = by_hand(browser, panel, line, "#field-move")
    line.say(FIELD | {"boundary": [[0, 0], [16, 0], [20, 0], [20, 20], [0, 20]]})
    expect(page.locator(".handle")).to_have_count(5)
    finger(page, "touchEnd", (17.9, 0), (17.9, 1))
    (told,) = asked(page, line, 1)
    assert (told["do"], told["index"]) == ("move_corner", 1)
    page.context.close()


def test_the_last_point_of_a_keep_out_is_taken_back_by_a_finger(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = by_hand(browser, panel, line, "#field-keep-out")
    drop = page.locator("#field-drop")
    expect(drop).to_be_hidden()
    for place in ((5, 5), (8, 5), (8, 8), (2, 2)):
        finger(page, "touchEnd", place)
    expect(drop).to_have_text("Take the last point back")
    drop.tap()
    page.locator("#field-keep-out").tap()
    (told,) = asked(page, line, 1)
    assert told["ring"] == [pytest.approx(place, abs=0.05) for place in ([5, 5], [8, 5], [8, 8])]
    expect(drop).to_be_hidden()
    page.context.close()


def test_the_button_that_removes_a_corner_is_reached_by_keys_and_loses_no_focus(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = by_keys(browser, panel, line, "#field-move")
    keys(page, "Tab", "Tab", "Tab", "Tab")
    assert page.evaluate("document.activeElement.id") == "field-drop"
    expect(page.locator("#field-drop")).to_have_text("Remove corner 4")
    keys(page, "Enter")
    assert asked(page, line, 1) == [{"do": "drop_corner", "index": 3}]
    assert page.evaluate("document.activeElement.id") == "field-move"
    page.context.close()


def test_the_panel_adds_the_corner_that_a_finger_drags(browser: Browser, walked: Served) -> None:
    page = opened(browser, walked, "phone", "en")
    walk_around(page, walked, FOUR)
    page.locator("#field-move").tap()
    page.locator("#field-map").scroll_into_view_if_needed()
    page.evaluate("scrollTo(0, 0)")
    before = on_disk(walked)
    local = [before.frame.to_local(*corner) for corner in before.crop]
    box = page.locator("#field-map").bounding_box()
    assert box is not None
    (xs, ys), room = zip(*local, strict=True), 2.0
    spans = [max(each) - min(each) + 2 * room for each in (xs, ys)]
    scale = box["width"] / max(spans)
    aside = [(max(spans) - span) / 2 for span in spans]
    x, y = ((a + b) / 2 for a, b in zip(local[0], local[1], strict=True))
    u = box["x"] + (aside[0] + x - min(xs) + room) * scale
    v = box["y"] + box["height"] - (aside[1] + y - min(ys) + room) * scale
    page.touchscreen.tap(u, v)
    problem = page.locator("#field-problem")
    expect(page.locator(".handle")).to_have_count(len(local) + 1)
    expect(problem).not_to_have_text(text("en", "field.working"), timeout=60_000)
    assert len(on_disk(walked).crop) == len(local) + 1
    page.locator("#field-drop").tap()
    expect(page.locator(".handle")).to_have_count(len(local), timeout=60_000)
    assert len(on_disk(walked).crop) == len(local)
    page.context.close()


@pytest.mark.parametrize("language", LANGUAGES)
def test_everybody_can_use_the_corners(browser: Browser, panel: Served, language: str) -> None:
    line = Line()
    line.more = {"driver": True, "driven": True}
    page = opened(browser, panel, "phone", language, line)
    page.click("#tabs button[data-tab=field]")
    expect(page.locator("#plan-said")).not_to_have_text(text(language, "plan.none"))
    for tool in ("#field-keep-out", "#field-move"):
        page.locator(tool).press("Enter")
        expect(page.locator("#field-keys")).to_be_visible()
        found = Axe().run(page, options={"runOnly": ["wcag2a", "wcag2aa", "wcag21aa", "wcag2aaa"]})
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    keys(page, "ArrowRight")
    expect(page.locator("#field-drop")).to_be_visible()
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / f"corners-{language}.png")
    page.context.close()


def test_a_key_that_the_focus_leaves_moves_and_starts_nothing(
    browser: Browser, panel: Served
) -> None:
    """The key comes up elsewhere then, or in another window, and the page never hears of it."""
    line = Line()
    line.more = {"driver": True, "driven": True, "green": True}
    line.keeps = frozenset({"jog", "start", "let_go"})
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")
    page.click("#jog summary")
    page.locator("#jog-keys button[data-jog='1,0']").focus()
    page.keyboard.down(" ")
    assert asked(page, line, 1)[0]["speed"] == 1
    page.locator("#jog summary").focus()
    page.keyboard.up(" ")
    page.evaluate("new Promise((done) => setTimeout(done, 400))")
    assert [wish["speed"] for wish in line.kept][-1] == 0, line.kept
    line.kept.clear()
    expect(page.locator("#start")).to_be_enabled()
    page.locator("#start").focus()
    page.keyboard.down(" ")
    expect(page.locator("#start")).to_have_class("hold down")
    page.locator("#jog summary").focus()
    expect(page.locator("#start")).to_have_class("hold")
    page.keyboard.up(" ")
    assert [wish["do"] for wish in asked(page, line, 1)] == ["let_go"]
    page.context.close()


# ---- in Urdu -------------------------------------------------------------------------------------

LEFT_ENGLISH = """
(names) => {
  const said = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const { parentElement, data } = texts.currentNode;
    if (parentElement.offsetParent) said.push(data);
  }
  const labelled = document.querySelectorAll("[aria-label]");
  for (const one of labelled) said.push(one.getAttribute("aria-label"));
  const bare = (text) => text.replace(/`[^`]*`|--[a-z]+/g, "").split(/[^A-Za-z_/]+/);
  return said.flatMap(bare).filter((word) => word.length > 1 && !names.includes(word));
}
"""
NAMES = ["STOP", "English", "USB", "paper", "E_outer", "kp", "ki", "kd", "/dev/ttyACM", "/dev/pts/"]
NAMES += ["HDOP", "Shift", "Enter", "Tab", "Insert", "Delete", "Esc", "BTS", "VNH"]
"""What is called so in Urdu, too."""
TOO_SMALL = """
() => [...document.querySelectorAll("button:not(.handle), summary, input, select")]
  .filter((one) => one.offsetParent)
  .filter((one) => {
    const { width, height, left, right } = one.getBoundingClientRect();
    const cut = left < 0 || right > innerWidth || one.scrollWidth > one.clientWidth + 1;
    return cut || width < 44 || height < 44;
  })
  .map((one) => one.id || one.textContent)
"""
DRIVING: Json = {
    "mode": "drive",
    "paused": False,
    "driver": True,
    "driven": True,
    "pilot": {
        **{"phase": "follow", "code": "SEEN", "words": {}, "reason": "", "place": [5, 5, 0.3]},
        **{"done": 0.42, "left_s": 400, "side": 3, "sides": 20},
        "view": {"confidence": 0.8, "o_map_px": 9, "e_outer_px": 8, "edge_px": [], "offset_m": -1},
    },
    "board": {"state": "RUNNING", "battery_v": 12, "blade": True, "speed_mps": 0.5, "faults": []},
    "steps": {"slow": 0, "count": 9, "longest_ms": 12},
}
CHECKED: Json = {
    "kind": "check",
    "done": False,
    "green": False,
    "question": {
        **{"id": 1, "key": "rolled_m", "number": True, "choices": []},
        "values": {"reported": 1.02},
    },
    "lines": [
        {
            **{"name": "port", "verdict": "bad", "finding": "port.silent"},
            "values": {
                "why": "serial port /dev/ttyACM0 does not exist; ports there now: none",
            },
        },
        {"name": "steering", "verdict": "bad", "finding": "steering.frozen", "values": {}},
    ],
}
TUNED: Json = {
    **{"kind": "pid", "kp": 1, "ki": 2, "kd": 3, "overshoot_deg": 4, "rise_s": 5},
    **{"asked": [[0, 0], [2, 20]], "got": [[0, 0], [2, 18]]},
}
DRAWN = """
() => {
window.drawn = [];
const fillText = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (said, u, v) {
  drawn.push(said);
  return fillText.call(this, said, u, v);
};
}
"""


def test_a_small_phone_in_urdu_says_all_in_urdu_and_every_button_is_large_enough(
    browser: Browser, panel: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SIZES, "phone", (360, 740))
    line = Line()
    page = opened(browser, panel, "phone", "ur", line)
    line.more = dict(DRIVING)
    page.evaluate(DRAWN)
    seen = set()
    for tab in (*TABS, "idle harvest"):
        if tab == "idle harvest":
            line.more = {"driver": True, "driven": True, "green": True}
            line.say({"kind": "ended", "outcome": "stopped", "reason": "", "resume": "x"})
        page.click(f"#tabs button[data-tab={tab.split()[-1]}]")
        line.say(CHECKED)
        line.say(TUNED)
        if tab == "idle harvest":
            expect(page.locator("#resume")).to_be_visible()
            page.click("#jog summary")
        expect(page.locator(f"#page-{tab.split()[-1]}")).to_be_visible()
        page.evaluate("new Promise(requestAnimationFrame)")
        seen.add(page.locator("main").inner_text())
        assert page.evaluate(LEFT_ENGLISH, NAMES) == [], tab
        assert page.evaluate(TOO_SMALL) == [], tab
        if PICTURES:
            page.screenshot(path=Path(PICTURES) / f"{tab}-ur-small.png", full_page=True)
    assert len(seen) == 6
    said = " ".join(seen)
    for unit in ("centimetres", "metres_a_second", "volts", "percent", "milliseconds", "none"):
        assert re.sub(r"{\w+}", "", text("ur", unit)).strip() in said, unit
    assert [one for one in page.evaluate("drawn") if re.search("[A-Za-z]", one)] == []
    page.context.close()


# ---- a link that fails ---------------------------------------------------------------------------

FOR_GOOD = 10**6
IDLE: Json = {"mode": "idle", "driver": True, "driven": True, "green": True}


def test_what_is_not_known_now_is_not_shown_as_it_was(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")
    line.more = dict(DRIVING) | {"mode": "countdown", "countdown_s": 3.0}
    expect(page.locator("#countdown")).to_be_visible()
    expect(page.locator("#facts")).to_contain_text("42 %")
    line.hung = FOR_GOOD
    expect(page.locator("#state-word")).to_have_text(text("en", "state.no_laptop"))
    # At once, and not only when another socket is opened.
    assert page.locator("#countdown").is_hidden()
    assert page.locator("#facts").inner_text() == ""
    for signal in ("board", "battery", "camera", "gnss"):
        assert page.locator(f"#signal-{signal}").is_hidden(), signal
    assert page.locator("#signal-laptop").inner_text() == text("en", "signal.no_laptop")
    assert page.locator("#pause").is_disabled()
    assert page.locator("#take").is_hidden()
    if PICTURES:
        page.screenshot(path=Path(PICTURES) / "no-link.png")
    page.click("#tabs button[data-tab=check]")
    expect(page.locator("#check-go")).to_be_disabled()
    expect(page.locator("#check-why")).to_have_text(text("en", "why.no_laptop"))
    page.context.close()


def test_a_link_that_is_lost_while_it_drives_is_heard_once(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")  # a touch, without which browsers allow no sound
    page.evaluate("window.tones = []; addEventListener('tone', (e) => tones.push(e.detail))")
    line.more = {"mode": "idle"}
    page.wait_for_timeout(700)
    line.hung = line.opened  # while it stands, nobody has to look up
    expect(page.locator("#state-word")).to_have_text(text("en", "state.no_laptop"))
    expect(page.locator("#state-word")).to_have_text(text("en", "state.idle"), timeout=15_000)
    assert page.evaluate("tones.length") == 0
    line.more = dict(DRIVING)
    expect(page.locator("#facts")).to_contain_text("42 %")
    page.wait_for_timeout(700)
    line.hung = FOR_GOOD
    expect(page.locator("#state-word")).to_have_text(text("en", "state.no_laptop"))
    page.wait_for_timeout(700)
    heard = page.evaluate("tones.length")
    assert heard >= 8
    page.wait_for_timeout(2500)
    assert page.evaluate("tones.length") == heard
    page.context.close()


def test_a_board_that_is_silent_has_no_battery(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    expect(page.locator("#signal-battery")).to_contain_text("12")
    line.more = {"link": {"port": "x", "problem": "silent", "firmware": None, "refusal": ""}}
    expect(page.locator("#signal-board")).to_have_text(text("en", "signal.no_board"))
    expect(page.locator("#signal-battery")).to_have_text(text("en", "signal.no_battery"))
    page.context.close()


def test_a_program_of_the_machine_that_is_gone_is_not_taken_for_a_link_that_is_lost(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "ur", line)
    page.click("#tabs button[data-tab=harvest]")
    line.mutes = frozenset({"now"})
    line.keeps = frozenset({"stop"})
    line.say({"kind": "alone"})
    expect(page.locator("#state-word")).to_have_text(text("ur", "state.no_machine"))
    expect(page.locator("#state-why")).to_contain_text("machine.log")
    line.say({"kind": "alone", "why": "timed out"})
    expect(page.locator("#state-why")).to_have_text(text("ur", "said.timed out"))
    line.say({"kind": "alone"})
    expect(page.locator("#signal-laptop")).to_have_text(text("ur", "signal.laptop"))
    expect(page.locator("#start-why")).to_have_text(text("ur", "why.no_machine"))
    page.locator("#stop").dispatch_event("pointerdown")
    expect(page.locator("#stop-said")).to_have_text(text("ur", "stop.no_board"))
    page.context.close()


def test_a_stop_goes_round_a_socket_that_leads_nowhere_and_another_is_opened(
    browser: Browser, panel: Served, board: FakeFirmware
) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    assert line.opened == 1
    line.hung = line.opened
    board.received.clear()
    page.locator("#stop").dispatch_event("pointerdown")
    for _ in range(40):
        page.wait_for_timeout(50)
        if any(isinstance(one, protocol.Stop) for one in list(board.received)):
            break
    assert any(isinstance(one, protocol.Stop) for one in list(board.received))
    for _ in range(300):
        if line.opened > 1:
            break
        page.wait_for_timeout(50)
    assert line.opened > 1
    expect(page.locator("#state-word")).to_have_text(text("en", "state.idle"), timeout=15_000)
    expect(page.locator("#stop-said")).to_contain_text("The board confirms", timeout=10_000)
    page.context.close()


def test_a_page_that_drove_drives_on_after_a_moment_without_a_link(
    browser: Browser, panel: Served
) -> None:
    """And only it: whoever watched watches on."""
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    watching = opened(browser, panel, "laptop", "en")
    for one in (page, watching):
        one.click("#tabs button[data-tab=harvest]")
    page.click("#take")
    expect(page.locator("#take")).to_be_hidden()
    expect(watching.locator("#take")).to_have_text(text("en", "harvest.watching"))
    page.wait_for_timeout(1000)
    sockets = line.opened
    line.close()
    for _ in range(100):
        page.wait_for_timeout(50)
        if line.opened > sockets:
            break
    assert line.opened > sockets
    # What it still lacks is a check, and no longer the wheel.
    expect(page.locator("#start-why")).to_have_text(text("en", "why.no_check"))
    expect(watching.locator("#take")).to_be_disabled()
    page.context.close()
    expect(watching.locator("#take")).to_be_enabled(timeout=15_000)
    watching.context.close()


def test_a_pause_says_on_a_page_that_watches_how_to_drive(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    line.more = DRIVING | {"paused": True, "paused_why": "away", "driver": False, "driven": False}
    expect(page.locator("#state-why")).to_contain_text(text("en", "why.not_driver"))
    line.more["driven"] = True
    expect(page.locator("#state-why")).to_contain_text(text("en", "why.other_drives"))
    line.more["driver"] = True
    expect(page.locator("#state-why")).to_have_text(text("en", "paused.away"))
    page.context.close()


def stops(page: Page, line: Line) -> list[Json]:
    """The STOPs that came, by their names."""
    page.wait_for_timeout(300)
    names = dict.fromkeys(wish["id"] for wish in line.kept if wish["do"] == "stop")
    return list(names)


def test_stop_is_pressed_by_a_finger_a_key_and_a_screen_reader_once_each(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    line.keeps = frozenset({"stop"})
    page.tap("#stop")
    assert len(stops(page, line)) == 1, "the click that follows the finger is none of its own"
    page.locator("#stop").focus()
    for _ in range(5):
        page.keyboard.down("Enter")  # a key that stays down repeats
    page.keyboard.up("Enter")
    assert len(stops(page, line)) == 2
    page.wait_for_timeout(800)
    page.evaluate("document.getElementById('stop').click()")  # as a screen reader does it
    assert len(stops(page, line)) == 3
    assert page.url == f"http://{panel.host}/"
    page.context.close()


def test_stop_works_where_the_pages_script_never_came(
    browser: Browser, panel: Served, board: FakeFirmware
) -> None:
    page = browser.new_context().new_page()
    page.route("**/static/field.js", lambda route: route.abort())
    page.goto(f"http://{panel.host}/")
    board.received.clear()
    page.unroute("**/static/field.js")
    page.click("#stop")
    assert board.wait_for(protocol.Stop)
    expect(page.locator("#signal-board")).to_contain_text(text("en", "board.SAFE"))
    page.context.close()


def test_texts_that_do_not_come_at_first_are_asked_for_again(
    browser: Browser, panel: Served
) -> None:
    page = browser.new_context(locale="en-GB").new_page()
    tries: list[str] = []

    lost = True

    def answer(route: Route) -> None:
        tries.append(route.request.url)
        if lost:
            route.abort()
        else:
            route.continue_()

    page.route("**/texts/en.json", answer)
    page.goto(f"http://{panel.host}/")
    for _ in range(400):
        if len(tries) >= 3:
            break
        page.wait_for_timeout(50)
    assert len(tries) >= 3
    said = page.locator("#state").inner_text()
    assert "load the page again" in said, "and no names of texts"
    lost = False
    expect(page.locator("#tabs button")).to_have_count(len(TABS))
    expect(page.locator("#state-why")).to_be_empty()
    page.context.close()


def at_harvest(browser: Browser, panel: Served, line: Line, *keeps: str) -> Page:
    """A page that drives, on HARVEST, its keys in view; of what it asks, `keeps` stay with the
    line."""
    line.more = dict(IDLE)
    line.keeps = frozenset(keeps)
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")
    page.click("#jog summary")
    return page


def test_a_finger_that_lifts_from_a_key_that_was_disabled_moves_nothing_later(
    browser: Browser, panel: Served
) -> None:
    """A disabled button hears no finger go."""
    line = Line()
    page = at_harvest(browser, panel, line, "jog", "hold", "start", "let_go")
    for button in ("#jog-keys button[data-jog='1,0']", "#start"):
        line.more = dict(IDLE)
        expect(page.locator(button)).to_be_enabled()
        page.locator(button).dispatch_event("pointerdown")
        asked(page, line, 1)
        line.more = IDLE | {"driver": False}
        expect(page.locator(button)).to_be_disabled()
        page.wait_for_timeout(300)
        line.kept.clear()
        line.more = dict(IDLE)  # it drives again, and nobody has a finger there
        expect(page.locator(button)).to_be_enabled()
        page.wait_for_timeout(2200)
        assert line.kept == []
    page.context.close()


def test_a_finger_on_a_page_that_is_hidden_holds_nothing(browser: Browser, panel: Served) -> None:
    """A call comes in, the screen goes dark."""
    line = Line()
    page = at_harvest(browser, panel, line, "jog", "hold", "start", "let_go")
    for button, last in (
        ("#jog-keys button[data-jog='1,0']", {"do": "jog", "speed": 0, "steer_deg": 0}),
        ("#start", {"do": "let_go"}),
    ):
        expect(page.locator(button)).to_be_enabled()
        page.locator(button).dispatch_event("pointerdown")
        asked(page, line, 1)
        page.evaluate("Object.defineProperty(document, 'hidden', { value: true, writable: true })")
        page.wait_for_timeout(400)
        assert line.kept[-1] == last
        line.kept.clear()
        page.evaluate("document.hidden = false")
        page.wait_for_timeout(2200)
        assert line.kept == []
    page.context.close()


def test_a_stop_ends_what_another_finger_holds(browser: Browser, panel: Served) -> None:
    line = Line()
    page = at_harvest(browser, panel, line, "hold", "start", "let_go", "stop")
    expect(page.locator("#start")).to_be_enabled()
    page.locator("#start").dispatch_event("pointerdown")
    asked(page, line, 1)
    page.locator("#stop").dispatch_event("pointerdown")
    page.wait_for_timeout(2200)
    assert [wish["do"] for wish in line.kept if wish["do"] != "stop"] == ["hold", "let_go"]
    page.context.close()


def test_a_compass_figure_is_of_one_start(browser: Browser, panel: Served) -> None:
    line = Line()
    line.more = dict(IDLE)
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=harvest]")
    line.say({"kind": "ended", "outcome": "stopped", "reason": "", "resume": "x"})
    page.fill("#compass", "90")
    line.more = dict(DRIVING)
    expect(page.locator("#compass")).to_be_hidden()
    line.more = dict(IDLE)
    expect(page.locator("#compass")).to_be_visible()
    expect(page.locator("#compass")).to_have_value("")
    page.context.close()


def test_a_gap_that_is_emptied_is_none_of_nothing(browser: Browser, panel: Served) -> None:
    line = Line()
    line.more = dict(IDLE)
    page = opened(browser, panel, "phone", "en", line)
    page.click("#tabs button[data-tab=field]")
    line.keeps = frozenset({"gap"})
    box = page.locator("#field-gap")
    expect(box).to_have_value("2")
    box.fill("")
    box.blur()
    expect(box).to_have_value("2")
    assert line.kept == []
    box.fill("-3")
    box.blur()
    assert asked(page, line, 1) == [{"do": "gap", "gap_m": -3}]
    page.context.close()


def test_a_look_at_the_sliders_takes_the_wheel_from_nobody(browser: Browser, panel: Served) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    line.keeps = frozenset({"take", "colour_begin"})
    page.click("#tabs button[data-tab=tune]")
    expect(page.locator("#pid-go")).to_be_enabled()
    assert line.kept == []
    line.more = dict(IDLE)
    assert asked(page, line, 1) == [{"do": "colour_begin"}]
    page.context.close()


def test_a_question_and_the_sliders_are_said_in_the_language_that_is_chosen_meanwhile(
    browser: Browser, panel: Served
) -> None:
    line = Line()
    page = opened(browser, panel, "phone", "en", line)
    line.say(CHECKED)
    slider = {"name": "a", "min": 0, "max": 2, "step": 0.05}
    line.say({"kind": "colour", "sliders": [slider], "params": {"a": 0.5}})
    line.say(TUNED)
    page.click("#tabs button[data-tab=runs]")
    page.click("#languages button[lang=ur]")
    expect(page.locator("html")).to_have_attribute("lang", "ur")
    page.click("#tabs button[data-tab=check]")
    said = text("ur", "ask.rolled_m").split("(")[0].strip()
    expect(page.locator("#question-text")).to_contain_text(said)
    page.click("#tabs button[data-tab=tune]")
    expect(page.locator("#sliders label")).to_contain_text(text("ur", "slider.a"))
    expect(page.locator("#sliders input")).to_have_value("0.5")
    assert page.evaluate(LEFT_ENGLISH, NAMES) == []
    page.context.close()


def test_a_phone_whose_pairing_ended_with_the_panel_is_asked_for_the_code(
    browser: Browser, tmp_path: Path
) -> None:
    """A panel that is started again knows no phone of before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        with served("/dev/null-port", tmp_path, lan=True) as found:
            line = Line()
            page = browser.new_context(locale="en-GB").new_page()
            page.route_web_socket("**/live", line.through)
            page.goto(f"http://{found.host}/")
            expect(page.locator("#page-pair")).to_be_visible()
            page.route("**/pair", lambda route: route.abort())
            page.fill("#pair-code", found.panel.pairing.code)
            page.click("#pair-form button")
            expect(page.locator("#pair-said")).to_have_text(text("en", "why.no_laptop"))
            page.unroute("**/pair")
            page.click("#pair-form button")
            expect(page.locator("#signal-laptop")).to_have_text(
                text("en", "signal.laptop"), timeout=30_000
            )
            expect(page.locator("#signal-board")).to_be_visible(timeout=60_000)
            found.panel.pairing._known.clear()
            line.close()
            expect(page.locator("#page-pair")).to_be_visible()
            page.context.close()
