"""The pages in a real browser: Debian's Chromium as a phone and as a laptop, in both languages."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

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


def opened(browser: Browser, panel: Served, size: str, language: str) -> Page:
    width, height = SIZES[size]
    phone = size == "phone"
    context = browser.new_context(
        viewport={"width": width, "height": height},
        is_mobile=phone,
        has_touch=phone,
        locale={"en": "en-GB", "ur": "ur-PK"}[language],
    )
    page = context.new_page()
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
