"""The whole machine with nothing left out: the rig in wall-clock time with a person beside it, the
unmodified `daranti panel`, and Debian's Chromium as a phone.

The person answers the check's questions by what the rig says is true, and everything else happens
by taps on the page.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import yaml
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from hil.bench.bystander import sees
from tests.helpers.rig_process import ROOT, Json, Rig

PHONE: Final = {"width": 390, "height": 844}
ARGS: Final = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
START_S: Final = 90.0


def small_field(
    path: Path, size_m: tuple[float, float], cep_m: float = 0.5, **more: object
) -> Path:
    """Writes a scenario to `path`, and returns that: a field with room around it, the machine a
    metre before its corner, and a phone of that CEP that neither jumps nor falls silent. `more`:
    other fields of the scenario."""
    text = {
        "field": {"size_m": list(size_m), "gap_m": 4.0},
        "start": {"before_m": 1.0},
        "gnss": {"cep_m": cep_m, "jumps_per_hour": 0.0, "outages_per_hour": 0.0},
        **more,
    }
    path.write_text(yaml.safe_dump(text), encoding="utf-8")
    return path


class Panel:
    """`daranti panel` as a process, for the rig's machine."""

    def __init__(self, rig: Rig, folder: Path, *options: str) -> None:
        about = rig.about
        self.folder = folder
        self._runtime = tempfile.TemporaryDirectory(prefix="dp-")
        command = [Path(sys.executable).parent / "daranti", "panel"]
        command += [f"--{name}={about[name]}" for name in ("port", "camera", "gnss", "vehicle")]
        command += ["--mount", about["mount"], "--mode", about["mode"]]
        command += ["--folder", folder, "--web-port", "0", *options]
        self._errors = (folder / "panel.log").open("wb")
        self._process = subprocess.Popen(
            [str(part) for part in command],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=ROOT,
            env=os.environ | {"XDG_RUNTIME_DIR": self._runtime.name, "PYTHONUNBUFFERED": "1"},
        )
        self.url = self._said("panel: (.*)")
        self.code = self._said("code (.*)") if "--lan" in options else ""

    @property
    def pid(self) -> int:
        """Of the server's process."""
        return self._process.pid

    def machine_pid(self) -> int:
        """Of the process that drives: the server's child."""
        children = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split()
        return int(children[0])

    def _said(self, pattern: str) -> str:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            found = re.search(pattern, line)
            if found:
                return found[1].strip()
        raise RuntimeError(f"daranti panel has ended: see {self._errors.name}")

    def close(self) -> None:
        """As by Ctrl-C."""
        self._process.send_signal(2)
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._errors.close()
        self._runtime.cleanup()


@contextlib.contextmanager
def a_browser() -> Iterator[Browser]:
    """Debian's Chromium, headless."""
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("there is no chromium: tools/debian.sh")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium, headless=True, args=list(ARGS)
        )
        yield browser
        browser.close()


def a_phone(browser: Browser, language: str = "en") -> BrowserContext:
    """A phone's browser with its own cookies."""
    context = browser.new_context(
        viewport=PHONE,
        is_mobile=True,
        has_touch=True,
        locale={"en": "en-GB", "ur": "ur-PK"}[language],
    )
    context.set_default_timeout(60_000)
    # What a page's script keeps to itself is read off its socket.
    context.add_init_script(
        """
        window.last = {};
        const Real = window.WebSocket;
        window.WebSocket = class extends Real {
          constructor(...all) {
            super(...all);
            this.addEventListener("message", (event) => {
              if (typeof event.data !== "string") return;
              const message = JSON.parse(event.data);
              window.last[message.kind] = { ...message, heard_ms: performance.now() };
            });
          }
        };
        """
    )
    return context


class Screen:
    """A page and the finger on it."""

    def __init__(self, context: BrowserContext, panel: Panel, shots: Path | None = None) -> None:
        self.page: Page = context.new_page()
        self._panel = panel
        self._shots = shots
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(panel.url)

    def pair(self) -> None:
        """By the code that the laptop shows."""
        self.page.fill("#pair-code", self._panel.code)
        self.page.click("#pair-form button")

    def last(self, kind: str = "now") -> Json:
        """The newest message of a kind; empty before the first."""
        return dict(self.page.evaluate("kind => window.last[kind] ?? {}", kind))

    def tab(self, name: str) -> None:
        """Another page of the panel."""
        self.page.click(f"#tabs button[data-tab={name}]")

    def speak(self, language: str) -> None:
        """The page's language."""
        self.tab("runs")
        self.page.click(f"#languages button[lang={language}]")
        self.page.locator(f"html[lang={language}]").wait_for(state="attached")

    def at_the_nearest_corner(self) -> None:
        """Chooses the corner that the receiver has the machine at."""
        self.until(lambda: self.last("field").get("here") is not None, 20)
        found = self.last("field")
        away = [math.dist(corner, found["here"]) for corner in found["boundary"]]
        nearest = away.index(min(away))
        self.page.select_option("#field-corner", str(nearest))
        self.until(lambda: self.last("field")["corner"] == nearest, 20)

    def drive_from_here(self) -> None:
        """Takes the wheel, if it is free."""
        self.tab("harvest")
        self.until(lambda: not self.last().get("driven") or self.last().get("driver"), 20)
        if not self.last().get("driver"):
            self.page.click("#take")
            self.until(lambda: self.last().get("driver"), 20)

    def until(self, holds: Callable[[], Any], seconds: float = 60.0, every_ms: int = 100) -> bool:
        """Whether it came to hold in time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if holds():
                return True
            self.page.wait_for_timeout(every_ms)
        return False

    def hold(self, button: str, milliseconds: int = 2300) -> None:
        """A finger that stays on a button."""
        element = self.page.locator(button)
        # What lies under the bar with STOP is in the window, but no finger reaches it.
        element.evaluate("element => element.scrollIntoView({ block: 'center' })")
        box = element.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.page.mouse.down()
        self.page.wait_for_timeout(milliseconds)
        self.page.mouse.up()

    def shot(self, name: str, *, top: bool = True) -> None:
        """A screenshot, where they are kept."""
        if self._shots is not None:
            if top:
                self.page.evaluate("scrollTo(0, 0)")
                self.page.wait_for_timeout(150)
            self.page.screenshot(path=self._shots / f"{name}.jpg", type="jpeg", quality=75)


class Person:
    """Beside the machine: does and answers what the check asks."""

    def __init__(self, rig: Rig, screen: Screen) -> None:
        self._rig = rig
        self._screen = screen
        self._rolled_from = 0.0
        self._clicks = 0
        self._answered = 0
        self.asked: list[str] = []

    def through_the_check(
        self, patience_s: float = 900.0, until: Callable[[], bool] = lambda: False
    ) -> Json:
        """From the button to the last line, or `until` something; the check as the page has it."""
        screen = self._screen
        screen.tab("check")
        before = screen.last("check")
        screen.page.click("#check-go")
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            found = screen.last("check")
            if (found.get("done") and found != before) or until():
                return found
            question = found.get("question")
            if question and question["id"] != self._answered:
                self._answer(question)
            screen.page.wait_for_timeout(100)
        raise RuntimeError("the check does not end")

    def _answer(self, question: Json) -> None:
        key = question["key"]
        self.asked.append(key)
        screen, rig = self._screen, self._rig
        screen.page.wait_for_timeout(600)
        if key == "steered":
            screen.shot("check", top=False)
        if key in ("estop_press", "estop_release"):
            rig.do(key.removeprefix("estop_"))
            # The board says so by itself.
            screen.until(lambda: (screen.last("check").get("question") or {}) != question, 10)
            self._answered = question["id"]
            return
        truth = rig.do()
        answer = self._sees(key, question, truth)
        if isinstance(answer, float):
            screen.page.fill("#question-choices input", f"{answer:.2f}")
            screen.page.click("#question-choices button")
        else:
            screen.page.click(f"#question-choices button[data-choice={answer}]")
        self._answered = question["id"]

    def _sees(self, key: str, question: Json, truth: Json) -> str | float:
        angle = truth["angle_deg"]
        rolled = truth["distance_m"] - self._rolled_from
        plain = sees(key, question["values"], angle, rolled)
        if plain is not None:
            return plain
        match key:
            case "room":
                self._rolled_from = truth["distance_m"]
                return "yes"
            case "blade_rest":
                self._clicks = truth["blade_seen"]
                return "lamp_off"
            case "blade_seen":
                return "clicked" if truth["blade_seen"] > self._clicks else "silent"
            case _:
                return str(question["choices"][0])


def read_the_compass(rig: Rig, screen: Screen) -> None:
    """A person lays one on the machine and types what it shows, to five degrees."""
    yaw_deg = math.degrees(rig.do()["pose"][2])
    screen.page.fill("#compass", str(5 * round((90.0 - yaw_deg) / 5) % 360))


def table(rows: list[tuple[str, Any]]) -> str:
    """Two columns."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)
