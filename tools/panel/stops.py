"""From a tap on STOP to the board's outputs off, in every state of a machine that works.

    python -m tools.panel.stops --taps 200 --out out/stops

The rig, the unmodified panel, its machine process and Chromium share the processor. A tap counts
from the finger's event in the page to the rig's slice in which the last output went off; where the
outputs were off already, to the board's word on the page. The finger taps where the machine passes:
each ride has a state that it waits for, and takes another that still lacks taps where that one does
not come. After a STOP the person puts the machine where the page says that it has to stand, and the
run goes on; a field that is cut is followed by a new one.

Each tap is printed and written to OUT/taps.jsonl as it comes, and OUT/summary.json with it; the
same command goes on where it was broken off. Exits with 1 where the 99th percentile passes 300 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from playwright.sync_api import Error as PlaywrightError

from host.core.frames import LocalFrame
from host.core.number_range import NumberRange, WholeRange, argument
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
    small_field,
)

Pose = tuple[float, float, float]
BOUND_MS: Final = 300.0
SHARES: Final = {
    "check": 12,
    "pid": 4,
    "idle": 6,
    "fault": 6,
    "jog": 36,
    "prepare": 10,
    "countdown": 18,
    "connect": 12,
    "align": 18,
    "follow": 32,
    "pause": 14,
    "hesitate": 12,
    "turn": 16,
    "search": 4,
}
"""Of 200 taps, by what the machine does: all that a page can show of it but a finished field."""
BEFORE_GREEN: Final = ("check", "pid")
"""Tapped before the check that lets the harvest start, for a check that is stopped is none."""
WITHIN_S: Final = {"check": 20.0, "pid": 6.0, "prepare": 2.0, "countdown": 4.0, "follow": 5.0}
"""How long a state that lasts has gone on at the tap, at most; evenly drawn."""
PASSING_S: Final = 0.7
"""Likewise, of one that passes."""
EARLY: Final = ("prepare", "countdown")
"""Before it drives."""
RIDE_S: Final = 15.0
"""Of a drive, after which another state is as good as the one that was waited for."""
LONGEST_S: Final = 30.0
"""Of a drive, after which any is."""
MOVES: Final = ("follow", "pause", "turn", "hesitate", "search")
"""States of a machine that found its place."""
WAITS_S: Final = 6.0
"""Of waiting for a person, after which it is not put right by another ride."""
GOAL_S: Final = 5.0
"""For the page to find where the machine has to stand."""
TRIES: Final = 8
"""In a row without a tap, after which a new machine is taken."""
NO_WORD_MS: Final = 10_000.0
"""Stands for a page that says nothing."""
DOING: Final = """() => {
  const now = window.last.now ?? {};
  return now.mode !== "drive" ? now.mode ?? "" : now.paused ? "pause" : now.pilot?.phase ?? "";
}"""


def beyond(frame: Pose, place: Pose) -> Pose:
    """A place that is given in a frame, outside of it."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    x, y = frame[0] + c * place[0] - s * place[1], frame[1] + s * place[0] + c * place[1]
    return x, y, frame[2] + place[2]


def inverse(place: Pose) -> Pose:
    """The frame that it is given in, seen from it."""
    x, y, _ = beyond((0.0, 0.0, -place[2]), (-place[0], -place[1], 0.0))
    return x, y, -place[2]


def summary_of(taps: list[Json]) -> Json:
    """Figures per state and over all."""
    by_state: dict[str, list[Json]] = defaultdict(list)
    for one in taps:
        by_state[one["state"]].append(one)
    out: Json = {}
    for name, found in [*by_state.items(), ("all", taps)]:
        off = np.array([one["off_ms"] for one in found])
        word = np.array([one["word_ms"] for one in found])
        out[name] = {
            "taps": len(found),
            "something_on": sum(one["was_on"] for one in found),
            "off_median_ms": round(float(np.median(off))),
            "off_p99_ms": round(float(np.percentile(off, 99))),
            "off_worst_ms": round(float(off.max())),
            "word_p99_ms": round(float(np.percentile(word, 99))),
        }
    out["states"] = len(by_state)
    return out


class Tally:
    """All taps so far and which are still lacking."""

    def __init__(self, taps: int, out: Path) -> None:
        kept = out / "taps.jsonl"
        lines = kept.read_text(encoding="utf-8").splitlines() if kept.exists() else []
        self.taps: list[Json] = [json.loads(line) for line in lines]
        self._whole = taps
        self._out = out
        self._wanted = {name: math.ceil(share * taps / 200) for name, share in SHARES.items()}

    @property
    def full(self) -> bool:
        """Whether there are as many as were asked for."""
        return len(self.taps) >= self._whole

    def lacking(self, *states: str) -> dict[str, int]:
        """How many taps each state still lacks; of these states, or of all."""
        seen = Counter(one["state"] for one in self.taps)
        left = {name: self._wanted[name] - seen[name] for name in states or self._wanted}
        return {name: count for name, count in left.items() if count > 0}

    def add(self, tap: Json) -> None:
        """One more, told and kept at once."""
        self.taps.append(tap)
        with (self._out / "taps.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(tap) + "\n")
        found = summary_of(self.taps)
        (self._out / "summary.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
        sofar = found["all"]
        print(
            f"{tap['at']} {len(self.taps):4d} {tap['state']:<10}off {tap['off_ms']:6.0f} ms, "
            f"word {tap['word_ms']:6.0f} ms; so far median {sofar['off_median_ms']}, "
            f"p99 {sofar['off_p99_ms']}, worst {sofar['off_worst_ms']}",
            flush=True,
        )


class Finger:
    """One machine, the person beside it, and the finger on its STOP."""

    def __init__(self, rig: Rig, screen: Screen, field: Path, tally: Tally) -> None:
        self.rig, self.screen, self.tally = rig, screen, tally
        self._random = random.Random()
        x, y = LocalFrame(*ORIGIN).to_local(*load_field(field).frame.to_wgs84(0.0, 0.0))
        self._field: Pose = (x, y, 0.0)
        """Where the field's frame lies in the world, by the machine that was last seen driving:
        what it cut is there, whatever it believes of the boundary."""
        self._begun: Pose = tuple(rig.do()["pose"])
        """Where it stood at first."""
        self.waited = 0
        """Rides in a row that ended in waiting for a person."""

    # ---- the tap ---------------------------------------------------------------------------------

    def doing(self) -> str:
        """What the page shows: the mode, or what a drive does."""
        return str(self.screen.page.evaluate(DOING))

    def tap(self, state: str) -> None:
        """One, and what it took."""
        page = self.screen.page
        page.evaluate("delete document.body.dataset.stopMs")
        before, now = self.rig.do(), self.screen.last()
        place = (now.get("pilot") or {}).get("place")
        if place is not None and (now.get("pilot") or {}).get("phase") in MOVES:
            self._field = beyond(tuple(before["pose"]), inverse(tuple(place)))
        tapped = page.evaluate(
            "() => { const at = Date.now(); document.getElementById('stop')"
            ".dispatchEvent(new PointerEvent('pointerdown', {bubbles: true})); return at; }"
        )
        self.screen.until(lambda: page.evaluate("document.body.dataset.stopMs"), 10, 20)
        word = float(page.evaluate("document.body.dataset.stopMs") or NO_WORD_MS)
        after = self.rig.do()
        was_on = bool(before["driven"]) and after["off_at"] * 1e3 >= tapped
        self.tally.add(
            {
                "at": time.strftime("%H:%M:%S"),
                "state": state,
                "off_ms": round(after["off_at"] * 1e3 - tapped if was_on else word, 1),
                "word_ms": word,
                "was_on": was_on,
            }
        )
        self.screen.until(lambda: self.doing() == "idle", 20)

    def linger(self, state: str) -> None:
        """As long as it may be in a state before the tap."""
        within_s = WITHIN_S.get(state, PASSING_S)
        self.screen.page.wait_for_timeout(self._random.uniform(0, within_s) * 1e3)

    def tap_if_still(self, state: str) -> bool:
        """A tap somewhere within a state; False where it was over before."""
        self.linger(state)
        if self.doing() != state:
            return False
        self.tap(state)
        return True

    # ---- what is tapped --------------------------------------------------------------------------

    def clear(self) -> None:
        """The board's faults, as the page tells to."""
        page, screen = self.screen.page, self.screen
        if (screen.last().get("board") or {}).get("faults"):
            screen.tab("harvest")
            page.click("#clear")
            screen.until(lambda: not screen.last()["board"]["faults"], 10)

    def check(self) -> None:
        """In the midst of the list."""
        end = time.monotonic() + self._random.uniform(0.5, WITHIN_S["check"])
        Person(self.rig, self.screen).through_the_check(until=lambda: time.monotonic() > end)
        if self.doing() == "check":
            self.tap("check")
        self.rig.do("release")
        self.screen.page.wait_for_timeout(500)
        self.clear()

    def pid(self) -> None:
        """While the steering is identified."""
        self.screen.tab("tune")
        self.screen.page.click("#pid-go")
        if self.screen.until(lambda: self.doing() == "pid", 10, 20):
            self.tap_if_still("pid")
        self.screen.until(lambda: self.doing() == "idle", 60)

    def idle(self) -> None:
        """Where nothing goes on."""
        self.tap("idle")

    def fault(self) -> None:
        """While the board holds one."""
        self.rig.do("press")
        self.screen.until(lambda: (self.screen.last().get("board") or {}).get("faults"), 10)
        self.rig.do("release")
        self.screen.page.wait_for_timeout(300)
        self.tap("fault")
        self.clear()

    def jog(self) -> None:
        """While a finger leads it."""
        page = self.screen.page
        page.wait_for_timeout(1100)  # what is asked so soon after a STOP begins nothing
        if not page.evaluate("document.getElementById('jog').open"):
            page.click("#jog summary")
        way = self._random.choice(("-1,0", "-1,15", "-1,-15"))
        page.locator(f"#jog-keys button[data-jog='{way}']").dispatch_event("pointerdown")
        if self.screen.until(lambda: self.rig.do()["driven"], 8, 30):
            self.linger("jog")
            self.tap("jog")

    def ride(self, wanted: str) -> None:
        """A start, and the tap in the state that is wanted, or in another that lacks one."""
        screen, page = self.screen, self.screen.page
        self.clear()
        self.put()
        button = "#resume" if page.locator("#resume").is_visible() else "#start"
        if button == "#resume":
            read_the_compass(self.rig, screen)
        before = screen.last("failed")
        screen.hold(button)
        if not screen.until(lambda: self.doing() != "idle" or screen.last("failed") != before, 5):
            print(f"{time.strftime('%H:%M:%S')} {button} begins nothing", flush=True)
        begin: float | None = None
        waits_since = math.inf
        while (doing := self.doing()) != "idle":
            if doing not in EARLY:
                begin = begin or time.monotonic()
            ridden = time.monotonic() - begin if begin is not None else 0.0
            if doing == "follow" and wanted == "pause":
                page.wait_for_timeout(1000)
                page.click("#pause", timeout=3000)
                screen.until(lambda: self.doing() in ("pause", "idle"), 5, 20)
            elif (waits_since := self._waits_since(waits_since)) < time.monotonic() - WAITS_S:
                self.waited += 1
                self.tap(doing)
                return
            elif doing == wanted or (ridden > RIDE_S and self.tally.lacking(doing)):
                if self.tap_if_still(doing):
                    self.waited = 0 if doing in MOVES else self.waited
                    return
            elif ridden > LONGEST_S:
                self.tap(doing)
                return
            page.wait_for_timeout(20)
        failed = screen.last("failed")
        why = screen.last("ended") if failed == before else failed
        print(f"{time.strftime('%H:%M:%S')} no {wanted}: {why}", flush=True)

    def _waits_since(self, since: float) -> float:
        """When it began to wait for a person, by what it says; never, where it does not."""
        pilot = self.screen.last().get("pilot") or {}
        waits = str(pilot.get("code", "")).startswith("Wait.")
        return min(since, time.monotonic()) if waits else math.inf

    def put(self) -> None:
        """Pushes the machine to where the page says that it has to stand. A person goes by what
        stands there and was cut, not by a place in metres."""
        if self.screen.last("ended").get("resume"):
            self.screen.until(lambda: self.screen.last("goal").get("place"), GOAL_S)
        goal = self.screen.last("goal").get("place")
        if goal is None or not self.screen.last("ended").get("resume"):
            x, y, yaw = self._begun
            self.rig.do("put", x=x, y=y, yaw=yaw)
            return
        x, y, yaw = beyond(beyond(self._field, tuple(goal)), (-BLADE_M[0], BLADE_M[1], 0.0))
        self.rig.do("put", x=x, y=y, yaw=yaw, beside=True)

    @property
    def at_the_end(self) -> bool:
        """Whether the run can go on no more: the field is cut, what is left has no place, or the
        machine waits for a person again and again."""
        ended = self.screen.last("ended")
        stuck = bool(self.screen.last("goal").get("stuck")) or self.waited > 1
        return ended.get("outcome") == "finished" or (bool(ended) and stuck)

    def one(self) -> None:
        """The next tap, by what is lacking."""
        left = self.tally.lacking(*(name for name in SHARES if name not in BEFORE_GREEN))
        left = left or {"follow": 1}
        wanted = self._random.choices(list(left), list(left.values()))[0]
        deeds: dict[str, Callable[[], None]] = {
            "idle": self.idle,
            "fault": self.fault,
            "jog": self.jog,
        }
        deeds.get(wanted, lambda: self.ride(wanted))()


def session(tally: Tally, out: Path, end: float) -> None:
    """One machine on one field: what is tapped before the check, the check, and then taps until
    there are enough, the field is cut, or the time is over."""
    rig = Rig(str(small_field(out / "stops.yaml", (9.0, 7.0), belief="exact")), out)
    folder = out / f"panel-{time.strftime('%H%M%S')}"
    folder.mkdir()
    boundary = rig.about["boundary"]
    panel = Panel(rig, folder, "--boundary", boundary, "--gap", rig.about["gap"])
    try:
        with a_browser() as browser:
            screen = Screen(a_phone(browser), panel)
            screen.until(lambda: screen.last().get("link", {}).get("problem") == "", 60)
            screen.tab("field")
            screen.at_the_nearest_corner()
            screen.drive_from_here()
            finger = Finger(rig, screen, Path(boundary), tally)
            for deed, name in ((finger.check, "check"), (finger.pid, "pid")):
                for _ in range(2 * tally.lacking(name).get(name, 0)):
                    if tally.lacking(name) and time.monotonic() < end:
                        deed()
            found = Person(rig, screen).through_the_check()
            if not found["green"]:
                bad = [line["finding"] for line in found["lines"] if line["verdict"] == "bad"]
                print(f"the check is not green: {bad}", flush=True)
                return
            screen.drive_from_here()
            tries = 0
            while not (tally.full or finger.at_the_end or tries > TRIES):
                if time.monotonic() > end:
                    return
                before = len(tally.taps)
                finger.one()
                tries = 0 if len(tally.taps) > before else tries + 1
    finally:
        panel.close()
        rig.close()


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--taps", type=argument(WholeRange(1)), default=200)
    parser.add_argument("--minutes", type=argument(NumberRange(0, min_open=True)), default=90.0)
    parser.add_argument("--out", type=Path, default=Path("out/stops"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tally = Tally(given.taps, given.out)
    end = time.monotonic() + 60 * given.minutes
    while not tally.full and time.monotonic() < end:
        try:
            session(tally, given.out, end)
        except (RuntimeError, PlaywrightError) as error:
            print(f"again with a new machine: {str(error).splitlines()[0]}", flush=True)
    if not tally.taps:
        return 1
    found = summary_of(tally.taps)
    for name, figures in found.items():
        print(f"{name:<12}{figures}")
    print(f"lacking     {tally.lacking() or 'none'}")
    return 0 if found["all"]["off_p99_ms"] <= BOUND_MS else 1


if __name__ == "__main__":
    sys.exit(main())
