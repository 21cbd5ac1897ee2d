"""The pages in a real browser: Debian's Chromium as a phone and as a laptop, in both languages."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, WebSocketRoute, expect, sync_playwright

from host.core.frames import LocalFrame
from host.field.boundary_file import Boundary, save_field
from host.link import protocol
from host.panel.texts import LANGUAGES, text
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.served_panel import Served, served

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
        self.say: Callable[[Json], None] = lambda _: None

    def through(self, page_end: WebSocketRoute) -> None:
        """Between a page and the panel."""
        panel_end = page_end.connect_to_server()

        def pass_on(message: str | bytes) -> None:
            told = json.loads(message) if isinstance(message, str) else {}
            page_end.send(json.dumps(told | self.more) if told.get("kind") == "now" else message)

        panel_end.on_message(pass_on)
        self.say = lambda message: page_end.send(json.dumps(message))


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
    "sides": [[20, 0, 20, 20, 1.0]],
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
