"""A day from the page alone: pairing, walk, plan, check, harvest to FINISHED, with pause, a page
that is closed, a camera that is lost, STOP, a machine led away and back, resume.

    python -m tools.panel.harvest --out out/day [--size 7 6] [--shots out/day/shots]

Takes as long as it takes, for the rig runs in wall-clock time. Prints a table and writes it to
OUT/summary.json; exits with 1 where the field was not finished.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import BrowserContext
from playwright.sync_api import Error as PlaywrightError

from host.core.frames import LocalFrame
from host.core.number_range import NumberRange, WholeRange, argument
from host.field.boundary_file import load_field
from tools.panel.stack import (
    Json,
    Panel,
    Person,
    Rig,
    Screen,
    a_browser,
    a_phone,
    read_the_compass,
    small_field,
    table,
)

RUN_S = 1500.0
MOST_RESUMES = 60
TRIES = 8
WAITS_S = 20.0
ORIGIN = (31.5, 74.3)
"""Of the rig's field."""
BLADE_M = (1.5, 0.5)
"""From the rear axle to the blade's right end: ahead, and to the right."""


def scenario_of(out: Path, size: tuple[float, float], seed: int, cep_m: float, width: int) -> Path:
    """A small field with room around it; `width`: of the picture in pixels."""
    lens = {"width_px": width, "height_px": width * 3 // 4}
    return small_field(out / "day.yaml", size, cep_m, seed=seed, lens=lens)


class Day:
    """What is done, in order, and what was seen of it."""

    def __init__(self, rig: Rig, panel: Panel, context: BrowserContext, shots: Path | None) -> None:
        self.rig, self.panel, self.context, self.shots = rig, panel, context, shots
        self.screen = Screen(context, panel, shots)
        self.rows: list[tuple[str, Any]] = []
        self.resumed: list[str] = []
        """Why, each time that the operator cleared and went on."""
        self.pushed = 0
        self.waits_since = math.inf

    def note(self, what: str, seen: Any) -> None:
        """A row."""
        print(f"{time.strftime('%H:%M:%S')}  {what}: {seen}", flush=True)
        self.rows.append((what, seen))

    def stands(self, seconds: float = 10.0) -> float:
        """How long until drive and blade are truly off; a person sees the wheels stand."""
        begin = time.monotonic()
        self.screen.until(lambda: not self.rig.do()["rolls_or_cuts"], seconds, 20)
        return round(time.monotonic() - begin, 2)

    def phase(self, *names: str) -> bool:
        """Whether the pilot is in one of these phases, and not paused."""
        now = self.screen.last()
        return (now.get("pilot") or {}).get("phase") in names and not now.get("paused")

    def wait(self, *names: str, seconds: float = 240.0) -> None:
        """For a phase; after a fault the operator clears it and goes on. RuntimeError where the
        field is finished before, or the phase does not come."""
        end = time.monotonic() + seconds
        while not self.phase(*names):
            left = end - time.monotonic()
            self.screen.until(lambda: self.phase(*names) or self.idle(), max(0.0, left))
            if self.phase(*names):
                return
            if left <= 0 or self.screen.last("ended").get("outcome") == "finished":
                raise RuntimeError(f"no {names}: {self.why()}")
            self.go_on()

    def begun(self, button: str) -> bool:
        """Holds a button; whether it drives then, or is told why not."""
        screen = self.screen
        before = screen.last("failed")
        screen.page.wait_for_timeout(500)
        read_the_compass(self.rig, self.screen)
        screen.hold(button)
        screen.until(
            lambda: screen.last().get("mode") == "drive" or screen.last("failed") != before, 60
        )
        return bool(screen.last().get("mode") == "drive")

    def idle(self) -> bool:
        """Whether nothing goes on."""
        return bool(self.screen.last().get("mode") == "idle")

    def go_on(self) -> None:
        """After a fault: clears it and goes on where it ended. Where the machine is told to stand
        elsewhere, the person pushes it there."""
        screen = self.screen
        faults = screen.last()["board"]["faults"]
        self.resumed.append(", ".join(faults) or str(screen.last("ended").get("code")))
        if len(self.resumed) > MOST_RESUMES:
            raise RuntimeError(f"resumed {MOST_RESUMES} times: {self.resumed}")
        screen.drive_from_here()
        if faults:
            screen.shot("fault")
            screen.page.click("#clear")
            screen.until(lambda: not screen.last()["board"]["faults"], 10)
        for _ in range(3):
            if not screen.until(screen.page.locator("#resume").is_visible, 10):
                raise RuntimeError("it cannot go on where it ended")
            if self.begun("#resume"):
                return
            said = screen.last("failed")
            self.note("not gone on", said.get("code") or said.get("why"))
            screen.shot("not-yet")
            screen.until(lambda: screen.last("goal").get("place"), 5)
            goal = screen.last("goal").get("place")
            if said.get("code") and goal:
                self.pushed += 1
                field = load_field(self.panel.folder / str(screen.last("field")["name"])).frame
                x, y = LocalFrame(*ORIGIN).to_local(*field.to_wgs84(goal[0], goal[1]))
                c, s = math.cos(goal[2]), math.sin(goal[2])
                x, y = x - BLADE_M[0] * c - BLADE_M[1] * s, y - BLADE_M[0] * s + BLADE_M[1] * c
                # A person goes by what stands there, not by a place in metres alone.
                self.rig.do("put", x=x, y=y, yaw=goal[2], beside=True)
                screen.page.wait_for_timeout(1500)

    def why(self) -> Json:
        """What the page knows."""
        now, ended = self.screen.last(), self.screen.last("ended")
        return {
            "mode": now.get("mode"),
            "pilot": now.get("pilot"),
            "paused": now.get("paused_why"),
            "ended": ended,
            "failed": self.screen.last("failed"),
            "refused": self.screen.last("refused"),
        }

    # ---- before it moves -------------------------------------------------------------------------

    def pair(self) -> None:
        """The phone, by the code."""
        screen = self.screen
        screen.page.locator("#page-pair").wait_for(state="visible")
        screen.shot("pair")
        screen.pair()
        screen.until(lambda: screen.last().get("link", {}).get("problem") == "", 60)
        self.note("paired with the code", bool(screen.last()))

    def walk(self, gap_m: str) -> None:
        """Around the field with the phone in the hand; then the gap and the corner."""
        screen, rig = self.screen, self.rig
        screen.tab("field")
        screen.page.click("#walk-begin")
        begin = time.monotonic()
        rig.do("walk")
        screen.page.wait_for_timeout(9000)
        screen.shot("walk")
        while rig.do()["walking"]:
            screen.page.wait_for_timeout(500)
        screen.page.click("#walk-end")
        screen.until(lambda: (screen.last("field").get("boundary") or []) != [], 30)
        screen.page.fill("#field-gap", gap_m)
        screen.page.press("#field-gap", "Enter")
        screen.page.locator("#field-gap").blur()
        screen.until(lambda: screen.last("field").get("gap_m") is not None, 20)
        screen.at_the_nearest_corner()
        found = screen.last("field")
        screen.shot("field")
        screen.speak("ur")
        screen.tab("field")
        screen.shot("field-ur")
        screen.speak("en")
        screen.tab("field")
        self.note("walk, two laps (s)", round(time.monotonic() - begin))
        self.note("corners understood", len(found["boundary"]))
        self.note("area understood (m2)", found["area_m2"])
        self.note("plan", found["summary"] and {k: found["summary"][k] for k in ("sides", "turns")})
        warnings = (found["summary"] or {}).get("warnings")
        self.note("field's problem", found["problem"] or warnings or "none")

    def check(self) -> Json:
        """The list."""
        begin = time.monotonic()
        person = Person(self.rig, self.screen)
        found = person.through_the_check()
        self.screen.shot("checked")
        bad = [line["finding"] for line in found["lines"] if line["verdict"] in ("bad", "skipped")]
        self.note("check (s)", round(time.monotonic() - begin))
        self.note("questions answered", len(person.asked))
        self.note("check green", bool(found["green"]))
        self.note("check says", bad or "all well")
        return found

    def start(self, button: str = "#start") -> None:
        """Holds the button; the countdown, then it drives."""
        screen = self.screen
        screen.drive_from_here()
        screen.page.wait_for_timeout(1000)
        if button == "#resume":
            read_the_compass(self.rig, self.screen)
        screen.hold(button)
        screen.page.wait_for_timeout(1500)
        screen.shot("countdown", top=False)
        if not screen.until(lambda: screen.last().get("mode") == "drive", 60):
            raise RuntimeError(f"not started: {self.why()}")

    # ---- while it drives -------------------------------------------------------------------------

    def once(self, trouble: Callable[[], None]) -> None:
        """While it follows an edge; again where the run ended meanwhile."""
        for _ in range(TRIES):
            self.wait("turn", "follow")
            self.wait("follow")
            self.screen.page.wait_for_timeout(1500)
            if self.phase("follow"):
                try:
                    trouble()
                except PlaywrightError as error:
                    self.note("again", str(error).splitlines()[0])
                    continue
                return
        raise RuntimeError(f"no chance in {TRIES} tries for {trouble.__name__}")

    def pause(self) -> None:
        """And on again."""
        page = self.screen.page
        page.click("#pause", timeout=3000)
        self.note("pause until it stands (s)", self.stands())
        self.screen.shot("paused")
        page.wait_for_timeout(2000)
        page.click("#pause", timeout=3000)
        self.screen.until(lambda: not self.screen.last()["paused"], 10)

    def lose_the_page(self) -> None:
        """Closes the page in full drive; opens another one and goes on."""
        self.screen.page.close()
        begin = time.monotonic()
        while self.rig.do()["rolls_or_cuts"] and time.monotonic() - begin < 15:
            time.sleep(0.02)
        self.note("page closed until it stands (s)", round(time.monotonic() - begin, 2))
        time.sleep(3)
        self.screen = Screen(self.context, self.panel, self.shots)
        self.screen.until(lambda: self.screen.last().get("paused"), 20)
        self.screen.drive_from_here()
        self.screen.shot("lost-page")
        self.note("the new page says why", self.screen.last().get("paused_why"))
        self.screen.page.wait_for_timeout(700)
        self.screen.page.click("#pause", timeout=3000)
        self.screen.until(lambda: not self.screen.last()["paused"], 10)

    def lose_the_camera(self) -> None:
        """Pulls its plug for a few seconds."""
        self.rig.do("blind")
        self.note("camera lost until it stands (s)", self.stands())
        self.screen.page.wait_for_timeout(2500)
        self.screen.shot("lost-camera")
        self.note("it says", (self.screen.last().get("pilot") or {}).get("reason"))
        self.rig.do("see")
        back = self.screen.until(lambda: self.rig.do()["rolls_or_cuts"], 40)
        self.note("camera back, goes on by itself", back)

    def stop(self) -> None:
        """In full drive."""
        screen = self.screen
        screen.page.evaluate("delete document.body.dataset.stopMs")
        tapped = time.time()
        screen.page.locator("#stop").dispatch_event("pointerdown")
        screen.until(lambda: screen.page.evaluate("document.body.dataset.stopMs"), 10, 20)
        shown = screen.page.evaluate("document.body.dataset.stopMs")
        off = (self.rig.do()["off_at"] - tapped) * 1e3
        self.note("STOP, tap to outputs off (ms)", round(off))
        self.note("STOP, tap to the page's word (ms)", shown and int(shown))
        screen.shot("stopped")

    def jog(self, speed_steer: str, seconds: float) -> None:
        """A finger on a jog key."""
        page = self.screen.page
        if not page.evaluate("document.getElementById('jog').open"):
            page.click("#jog summary")
        key = page.locator(f"#jog-keys button[data-jog='{speed_steer}']")
        key.scroll_into_view_if_needed()
        key.dispatch_event("pointerdown")
        page.wait_for_timeout(seconds * 1000)
        key.dispatch_event("pointerup")
        page.wait_for_timeout(1000)

    def waits(self) -> bool:
        """Whether the machine has waited for long to be put elsewhere."""
        pilot = self.screen.last().get("pilot") or {}
        waits, now = str(pilot.get("code", "")).startswith("Wait."), time.monotonic()
        self.waits_since = min(self.waits_since, now) if waits else math.inf
        return now - self.waits_since > WAITS_S

    def to_the_end(self, seconds: float) -> str:
        """Until the field is finished, the machine waits for a person, or the time is over."""
        screen, end = self.screen, time.monotonic() + seconds
        while time.monotonic() < end:
            screen.until(lambda: self.idle() or self.waits(), max(0.0, end - time.monotonic()), 500)
            if not self.idle() or screen.last("ended").get("outcome") == "finished":
                break
            self.go_on()
        return str(screen.last("ended").get("outcome"))


def day(arguments: argparse.Namespace) -> int:
    """All of it."""
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    shots: Path | None = arguments.shots
    if shots is not None:
        shots.mkdir(parents=True, exist_ok=True)
    scenario = scenario_of(
        out, tuple(arguments.size), arguments.seed, arguments.cep, arguments.width
    )
    rig = Rig(str(scenario), out)
    folder = out / f"panel-{time.strftime('%H%M%S')}"
    folder.mkdir()
    panel = Panel(rig, folder, "--lan")
    begin = time.monotonic()
    try:
        with a_browser() as browser:
            whole = Day(rig, panel, a_phone(browser), shots)
            try:
                drive(whole, rig)
            except (RuntimeError, PlaywrightError) as error:
                whole.note("broken off", str(error))
            outcome = str(whole.screen.last("ended").get("outcome"))
            whole.note("outcome", outcome)
            whole.note("it says", whole.screen.last("ended").get("reason"))
            whole.screen.shot("finished")
            whole.screen.tab("runs")
            whole.screen.page.wait_for_timeout(700)
            whole.screen.shot("runs")
            truth = rig.do()
            whole.note("coverage, truly", round(truth["coverage"], 4))
            whole.note("neighbour's crop cut (m2)", round(truth["neighbour_cut_m2"], 4))
            whole.note("rig's time given up (s)", round(truth["rig_slipped_s"], 2))
            whole.note("wall time (min)", round((time.monotonic() - begin) / 60, 1))
            whole.note("errors of the page's scripts", len(whole.screen.errors))
            (out / "summary.json").write_text(json.dumps(dict(whole.rows), indent=1))
            print(table(whole.rows))
            return 0 if outcome == "finished" else 1
    finally:
        panel.close()
        rig.close()


def drive(whole: Day, rig: Rig) -> None:
    """From the pairing to the end."""
    whole.pair()
    whole.walk(rig.about["gap"])
    whole.check()
    whole.start()
    whole.wait("follow")
    whole.screen.page.wait_for_timeout(3000)
    whole.screen.shot("cutting")
    for trouble in (whole.pause, whole.lose_the_page, whole.lose_the_camera, whole.stop):
        whole.once(trouble)
    whole.go_on()
    ended = whole.to_the_end(RUN_S)
    steps = whole.screen.last("ended")
    whole.note("steps of the last run, above 50 ms", f"{steps['slow_steps']} of {steps['steps']}")
    whole.note("steps begun late", steps["late_steps"])
    whole.note("ended", ended)
    causes = dict(Counter(whole.resumed))
    whole.note("faults cleared and gone on", causes or "none")
    whole.note("pushed to its place by hand", whole.pushed)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/panel-day"))
    parser.add_argument(
        "--size",
        type=argument(NumberRange(0, min_open=True)),
        nargs=2,
        default=(7.0, 6.0),
        metavar="METRES",
    )
    parser.add_argument("--seed", type=argument(WholeRange(0, 2**31 - 1)), default=1)
    parser.add_argument(
        "--cep", type=argument(NumberRange(0)), default=0.8, help="of the phone's positions (m)"
    )
    parser.add_argument(
        "--width", type=argument(WholeRange(1)), default=640, help="of the picture (px)"
    )
    parser.add_argument("--shots", type=Path, help="folder for screenshots")
    return day(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
