"""The rig in wall-clock time with a person beside it: who presses the emergency stop, walks around
the field with the phone, sees what the machine does, and pulls the camera's plug.

    python -m tests.helpers.manned_rig SCENARIO FOLDER

Lines of JSON on stdin are deeds, each answered by a line on stdout: {"do": "press"}, "release",
"walk", "look", "put" (at x, y, yaw; "beside": beside the crop's right end there), "blind", "see",
"end". `look` tells the truth: the wheel's angle, the way rolled, what the outputs drive, in how
many slices they have, and when (time.time()) they last went off.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from hil.bench.eyes import PerfectEye
from hil.bench.rig import Rig
from hil.bench.serving import served
from hil.firmware.signal_wires import Mode, Signal
from hil.firmware.wiring import ESTOP_OPEN_MV
from hil.scenario import scenario

WALKING_MPS = 1.2
LAPS = 2
NEAR_M = 0.6
"""How far a person pushes the machine aside, at most, to have it beside what stands."""


class MannedRig(Rig):
    """Does what stdin says between its slices."""

    def watch(self, deeds: Queue[dict[str, Any]]) -> None:
        """Before it runs."""
        self._deeds = deeds
        self._driven = False
        self.off_at = time.time()
        self.blade_seen = self.driven_seen = 0
        self._steps: Iterator[tuple[float, float]] | None = None
        self._carried_at: tuple[float, float] | None = None
        self._blind = False
        self.ended = False

    def slice(self, number: int, now: float) -> None:
        with suppress(Empty):
            self._do(self._deeds.get_nowait())
        super().slice(number, now)
        driven = any(self.bench.drives)
        if self._driven and not driven:
            self.off_at = time.time()
        self.blade_seen += self.bench.drives[2]
        self.driven_seen += driven
        self._driven = driven

    def _do(self, deed: dict[str, Any]) -> None:
        tap = self.bench.faults.taps[int(Signal.ESTOP)]
        match deed["do"]:
            case "press":
                tap["mode"], tap["value"] = int(Mode.FIXED), ESTOP_OPEN_MV
            case "release":
                tap["mode"] = int(Mode.HONEST)
            case "walk":
                self._steps = around(self.bench.world.corners)
                self._bench_antenna = self.bench.faults.antenna
                self.bench.faults.antenna = self._carried  # type: ignore[method-assign]
            case "blind":
                self._blind = True
            case "see":
                self._blind = False
            case "put":
                for name in ("x", "y", "yaw"):
                    self.bench.state[name] = deed[name]
                if deed.get("beside"):
                    self._beside_what_stands()
            case "end":
                raise KeyboardInterrupt
            case _:
                pass
        print(json.dumps(self._truth()), flush=True)

    def _beside_what_stands(self) -> None:
        """Pushes the machine aside until the blade's right end is at the crop's, as the page asks a
        person to: where that is, eyes say and no plan."""
        right_m = PerfectEye(self.bench).sight().right_m
        aside_m = right_m + self.bench.scenario.machine.blade_width_m / 2
        if abs(aside_m) < NEAR_M:
            x, y, yaw = self.bench.pose
            self.bench.state["x"] = x - aside_m * math.sin(yaw)
            self.bench.state["y"] = y + aside_m * math.cos(yaw)

    def _carried(self, *_: float) -> tuple[float, float, float, float]:
        """The phone in the walker's hand; back on the machine after the last lap."""
        assert self._steps is not None
        try:
            x, y = next(self._steps)
        except StopIteration:
            self.bench.faults.antenna = self._bench_antenna  # type: ignore[method-assign]
            x, y = self.bench.pose[:2]
        past, self._carried_at = self._carried_at or (x, y), (x, y)
        # What Doppler shows at an epoch is the way since the last one, a second ago.
        return x, y, x - past[0], y - past[1]

    def shoot(self, now: float) -> None:
        if not self._blind:
            super().shoot(now)

    def _truth(self) -> dict[str, Any]:
        state = self.bench.state
        return {
            "angle_deg": math.degrees(float(state["steer_angle"])),
            "distance_m": float(state["distance"]),
            "driven": self._driven,
            "rolls_or_cuts": abs(float(state["v"])) > 0.03 or bool(state["blade_spinning"]),
            "off_at": self.off_at,
            "blade_seen": self.blade_seen,
            "driven_seen": self.driven_seen,
            "coverage": float(self.bench.field.coverage()),
            "neighbour_cut_m2": float(self.bench.field.neighbour_cut_m2()),
            "pose": list(self.bench.pose),
            "walking": self._steps is not None and self.bench.faults.antenna == self._carried,
            "rig_slipped_s": self.deadlines.slipped_s,
        }


def around(corners: list[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """Places of a walk along the field's edge, one a second."""
    ring = [*(list(corners) * LAPS), corners[0]]
    for a, b in itertools.pairwise(ring):
        length = math.dist(a, b)
        for k in range(max(1, round(length / WALKING_MPS))):
            share = k * WALKING_MPS / length
            yield a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    yield ring[-1]


def main(name: str, out: Path) -> None:
    """Serves until `end`."""
    chosen = scenario.load(name)
    deeds: Queue[dict[str, Any]] = Queue()

    def listen() -> None:
        for line in sys.stdin:
            deeds.put(json.loads(line))
        deeds.put({"do": "end"})

    with served(chosen, out, MannedRig) as found:
        found.machine.watch(deeds)
        print(json.dumps(found.about), flush=True)
        threading.Thread(target=listen, daemon=True).start()
        with suppress(KeyboardInterrupt):
            found.machine.run()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
