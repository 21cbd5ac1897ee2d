"""From a tap on STOP to the board's outputs off, in every state of a machine that works.

    python -m tools.panel.stops --taps 200 --out out/stops

The rig, the unmodified panel, its machine process and Chromium share the processor. A tap counts
from the finger's event in the page to the rig's slice in which the last output went off; where the
outputs were off already, to the board's word on the page. After a STOP the person puts the machine
where the page says that it has to stand, and the run goes on. Exits with 1 where the 99th
percentile passes 300 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from host.core.frames import LocalFrame
from host.field.boundary_file import load_field
from tools.panel.harvest import BLADE_M, ORIGIN
from tools.panel.stack import (
    Json,
    Panel,
    Person,
    Rig,
    Screen,
    a_browser,
    a_phone,
    read_the_compass,
)

Pose = tuple[float, float, float]
BOUND_MS = 300.0
STATES = ("jog", "countdown", "connect", "align", "follow", "pause", "hesitate", "turn", "search")
BEGIN_S, REACH_S = 40.0, 60.0


def is_in(now: Json, state: str) -> bool:
    """Whether a snapshot shows a state."""
    if state in ("jog", "countdown"):
        return bool(now.get("mode") == state)
    return now.get("mode") == "drive" and (now.get("pilot") or {}).get("phase") == state


def is_driving(now: Json) -> bool:
    """Whether a snapshot shows a pilot that knows its place."""
    return now.get("mode") == "drive" and (now.get("pilot") or {}).get("phase") != "connect"


def beyond(frame: Pose, place: Pose) -> Pose:
    """A place that is given in a frame, outside of it."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    x, y = frame[0] + c * place[0] - s * place[1], frame[1] + s * place[0] + c * place[1]
    return x, y, frame[2] + place[2]


def inverse(place: Pose) -> Pose:
    """The frame that it is given in, seen from it."""
    x, y, _ = beyond((0.0, 0.0, -place[2]), (-place[0], -place[1], 0.0))
    return x, y, -place[2]


class Taps:
    """One machine and the finger on its STOP."""

    def __init__(self, rig: Rig, screen: Screen, field: Path) -> None:
        self.rig, self.screen = rig, screen
        self.seen: dict[str, list[tuple[float, float, bool]]] = defaultdict(list)
        """Per state: (ms to outputs off, ms to the page's word, whether something was on)."""
        self.missed = 0
        x, y = LocalFrame(*ORIGIN).to_local(*load_field(field).frame.to_wgs84(0.0, 0.0))
        self._field: Pose = (x, y, 0.0)
        """Where the field's frame lies in the world, by the machine that was last seen driving:
        what it cut is there, whatever it believes of the boundary."""

    def tap(self, state: str) -> None:
        """One."""
        page = self.screen.page
        page.evaluate("delete document.body.dataset.stopMs")
        before = self.rig.do()
        place = (self.screen.last().get("pilot") or {}).get("place")
        if place is not None and is_driving(self.screen.last()):
            self._field = beyond(tuple(before["pose"]), inverse(tuple(place)))
        tapped = page.evaluate(
            "() => { const at = Date.now(); document.getElementById('stop')"
            ".dispatchEvent(new PointerEvent('pointerdown', {bubbles: true})); return at; }"
        )
        self.screen.until(lambda: page.evaluate("document.body.dataset.stopMs"), 10, 20)
        word = float(page.evaluate("document.body.dataset.stopMs") or 10_000)
        after = self.rig.do()
        was_on = bool(before["driven"]) and after["off_at"] * 1e3 >= tapped
        off = after["off_at"] * 1e3 - tapped if was_on else word
        self.seen[state].append((off, word, was_on))
        self.screen.until(lambda: self.screen.last().get("mode") == "idle", 20)

    def reach(self, state: str) -> bool:
        """Brings the machine into a state."""
        screen, page = self.screen, self.screen.page
        if (self.screen.last().get("board") or {}).get("faults"):
            page.click("#clear")
            page.wait_for_timeout(600)
        if state == "jog":
            page.wait_for_timeout(1100)  # what is asked so soon after a STOP begins nothing
            if not page.evaluate("document.getElementById('jog').open"):
                page.click("#jog summary")
            key = page.locator("#jog-keys button[data-jog='-1,0']")
            key.dispatch_event("pointerdown")
            return screen.until(lambda: self.rig.do()["driven"], 8, 30)
        self.put()
        button = "#resume" if page.locator("#resume").is_visible() else "#start"
        if button == "#resume":
            read_the_compass(self.rig, screen)
        screen.hold(button)
        wanted = "follow" if state == "pause" else state
        begun = screen.until(
            lambda: is_in(screen.last(), wanted) or screen.last().get("mode") == "drive",
            BEGIN_S,
            20,
        )
        found = begun and screen.until(
            lambda: is_in(screen.last(), wanted) or screen.last().get("mode") == "idle", REACH_S, 20
        )
        if not found or not is_in(screen.last(), wanted):
            return False
        page.wait_for_timeout(int(np.random.default_rng().integers(0, 700)))
        if state == "pause":
            page.wait_for_timeout(1000)
            page.click("#pause")
            return screen.until(lambda: screen.last().get("paused"), 5)
        return is_in(screen.last(), wanted)

    def put(self) -> None:
        """Pushes the machine to where the page says that it has to stand. A person goes by what
        stands there and was cut, not by a place in metres."""
        goal = self.screen.last("goal").get("place")
        if goal is None or not self.screen.last("ended").get("resume"):
            return
        x, y, yaw = beyond(beyond(self._field, tuple(goal)), (-BLADE_M[0], BLADE_M[1], 0.0))
        self.rig.do("put", x=x, y=y, yaw=yaw, beside=True)
        self.screen.page.wait_for_timeout(1500)

    def summary(self) -> Json:
        """Figures per state and over all."""
        out: Json = {}
        both = [one for state in self.seen.values() for one in state]
        for name, found in [*self.seen.items(), ("all", both)]:
            off, word, on = np.array(found, float).T
            out[name] = {
                "taps": len(found),
                "something_on": int(on.sum()),
                "off_median_ms": round(float(np.median(off))),
                "off_p99_ms": round(float(np.percentile(off, 99))),
                "off_worst_ms": round(float(off.max())),
                "word_p99_ms": round(float(np.percentile(word, 99))),
            }
        return out | {"not_reached": self.missed}


def measure(taps: int, minutes: float, out: Path) -> Json:
    """All of it; ends early after so many minutes."""
    out.mkdir(parents=True, exist_ok=True)
    scenario = out / "stops.yaml"
    text: dict[str, Any] = {
        "field": {"size_m": [8.0, 7.0], "gap_m": 4.0},
        "start": {"before_m": 1.0},
        "belief": "exact",
        "gnss": {"cep_m": 0.5, "jumps_per_hour": 0.0, "outages_per_hour": 0.0},
    }
    scenario.write_text(yaml.safe_dump(text), encoding="utf-8")
    rig = Rig(str(scenario), out)
    folder = out / f"panel-{time.strftime('%H%M%S')}"
    folder.mkdir()
    boundary = rig.about["boundary"]
    panel = Panel(rig, folder, "--boundary", boundary, "--gap", rig.about["gap"])
    end = time.monotonic() + 60 * minutes
    try:
        with a_browser() as browser:
            screen = Screen(a_phone(browser), panel)
            screen.until(lambda: screen.last().get("link", {}).get("problem") == "", 60)
            screen.tab("field")
            screen.at_the_nearest_corner()
            found = Person(rig, screen).through_the_check()
            if not found["green"]:
                bad = [line["finding"] for line in found["lines"] if line["verdict"] == "bad"]
                raise SystemExit(f"the check is not green: {bad}")
            screen.drive_from_here()
            person = Taps(rig, screen, Path(boundary))
            for number in range(10 * taps):
                count = sum(map(len, person.seen.values()))
                if count >= taps or time.monotonic() > end:
                    break
                state = STATES[number % len(STATES)]
                if person.reach(state):
                    person.tap(state)
                else:
                    person.missed += 1
                    failed = screen.last("failed")
                    print(f"not reached: {state} {screen.last().get('mode')} {failed}", flush=True)
                    screen.page.locator("#stop").dispatch_event("pointerdown")
                    screen.until(lambda: screen.last().get("mode") == "idle", 20)
                if number % len(STATES) == 0:
                    print(time.strftime("%H:%M:%S"), count, "taps", flush=True)
            return person.summary()
    finally:
        panel.close()
        rig.close()


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--taps", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=90.0)
    parser.add_argument("--out", type=Path, default=Path("out/stops"))
    given = parser.parse_args()
    summary = measure(given.taps, given.minutes, given.out)
    (given.out / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    for name, figures in summary.items():
        print(f"{name:<12}{figures}")
    return 0 if summary["all"]["off_p99_ms"] <= BOUND_MS else 1


if __name__ == "__main__":
    sys.exit(main())
