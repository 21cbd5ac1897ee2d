"""`daranti-hil rig`: the machine on the desk in wall-clock time, for the unmodified host.

Firmware and plant run behind a pseudo-terminal, which pyserial opens like /dev/ttyACM0, and a
simulated phone serves picture and positions. The bench is the lockstep one; here the wall clock
advances it, ten milliseconds at a time, each slice at its deadline. A late slice is caught up; a
rig that falls farther behind lets its time slip, and says so.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from hil.bench.lockstep import Bench
from hil.bench.ports import IN_THE_MAKING, Port
from hil.bench.slices import SLICE_US
from hil.scenario.scenario import Scenario
from host.core.frames import LocalFrame
from host.core.vehicle_file import save_vehicle
from host.core.whole_file import save_text
from host.pilot.phase import Phase
from sim_plant.camera import Camera, Shot
from sim_plant.field_spec import FieldSpec
from sim_plant.network import Stream
from sim_plant.phone import Phone

SLICE_S: Final = SLICE_US * 1e-6
FIX_SLICES: Final = round(1.0 / SLICE_S)
"""The phone's receiver speaks once a second."""
TRACK_SLICES: Final = 10
"""Between poses of the track, 50 ms."""
BEHIND_S: Final = 0.05
"""Farther behind than this the rig does not catch up: its time slips. Caught up in a burst, a pause
of the rig would be one of the host, whose commands of all that time arrive at once; the firmware's
watchdog ends that after 0.25 s."""


# ---- the serial port's near end ------------------------------------------------------------------


# ---- time ----------------------------------------------------------------------------------------


@dataclass
class Deadlines:
    """How well the wall clock was kept."""

    late_s: list[float] = field(default_factory=list)
    """Per slice: from its deadline to its beginning."""
    slipped_s: float = 0.0
    """Wall time that was given up."""
    pictures_skipped: int = 0

    def summary(self) -> dict[str, float | int]:
        """Lateness in ms, slices that began more than a slice late, and the time given up."""
        late = np.array(self.late_s or [0.0])
        return {
            "slices": len(self.late_s),
            "late_median_ms": round(float(np.median(late)) * 1e3, 3),
            "late_p99_ms": round(float(np.percentile(late, 99)) * 1e3, 3),
            "late_worst_ms": round(float(late.max()) * 1e3, 3),
            "deadlines_missed": int((late > SLICE_S).sum()),
            "slipped_s": round(self.slipped_s, 3),
            "pictures_skipped": self.pictures_skipped,
        }


# ---- the rig -------------------------------------------------------------------------------------


def develop(camera: Camera, shot: Shot) -> bytes:
    """The JPEG file of what the camera froze."""
    return camera.encode(camera.develop(shot))


class Rig:
    """Bench, ports and phone in wall-clock time. `clock` and `wait` are the wall's; a test may hand
    in its own."""

    def __init__(
        self,
        bench: Bench,
        ports: list[Port],
        phone: Phone,
        *,
        factor: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
        tend: Callable[[], None] = lambda: None,
    ) -> None:
        """`factor`: simulated seconds per second; `tend` is called ten times in one of them."""
        self._tend = tend
        self.bench = bench
        self.deadlines = Deadlines()
        self.track: list[tuple[float, float, float, float, Phase]] = []
        """(t, x, y, yaw, -) of the rear axle, truly; what the pilot does is not known here."""
        self._ports = ports
        self._phone = phone
        self._period = SLICE_S / factor
        self._clock = clock
        self._wait = wait
        self._pool = ThreadPoolExecutor(1)
        self._pictures: deque[tuple[float, float, Future[bytes]]] = deque()
        """(when it is due, its shutter in simulated time, the picture in the making)."""
        fps = bench.world.lens.fps
        self._picture_slices = max(1, round(1 / fps / SLICE_S))
        self._factor = factor
        self._stream = Stream(bench.world.lens, bench.world.seed)

    def run(self, duration_s: float | None = None) -> None:
        """Until `duration_s` of simulated time have passed, or for ever."""
        start = round(self.bench.now / SLICE_S)
        count = None if duration_s is None else round(duration_s / SLICE_S)
        due = self._clock()
        done = 0
        while count is None or done < count:
            done += 1
            due += self._period
            now = self._clock()
            if now < due:
                self._wait(due - now)
                now = self._clock()
            late = now - due
            self.deadlines.late_s.append(late)
            if late > BEHIND_S:
                self.deadlines.slipped_s += late
                due = now
            self.slice(start + done, now)

    def slice(self, number: int, now: float) -> None:
        """One slice of simulated time, the `number`th; `now` by the wall's clock. Whoever stands
        beside the machine does so here, before or after it."""
        bench = self.bench
        for port in self._ports:
            bench.send(port.read())
        for _, data in bench.advance(number * SLICE_S):
            for port in self._ports:
                port.write(data)
        if number % self._picture_slices == 0:
            self.shoot(now)
        if number % FIX_SLICES == 0:
            self._phone.say(bench.fix())
        self._phone.feel(bench.felt())
        if number % TRACK_SLICES == 0:
            self._tend()
            self.track.append((bench.now, *bench.pose, Phase.CONNECT))
        due = None
        if self._pictures and self._pictures[0][0] <= now and self._pictures[0][2].done():
            _, shutter, work = self._pictures.popleft()
            due = (shutter, work.result())
        seen = bench.faults.camera(bench.now, due)
        if seen is not None:
            self._phone.show(seen[1])

    def shoot(self, now: float) -> None:
        """Begins a picture; a machine too slow to develop them all loses some, as a phone does, and
        shows none late."""
        if sum(not work.done() for _, _, work in self._pictures) >= IN_THE_MAKING:
            self.deadlines.pictures_skipped += 1
            return
        work = self._pool.submit(develop, self.bench.camera, self.bench.shutter())
        shutter = self.bench.now
        late = (self._stream.arrives_s(shutter) - shutter) / self._factor
        self._pictures.append((now + late, shutter, work))

    def close(self) -> None:
        """Ends the picture worker."""
        self._pool.shutdown(cancel_futures=True)


def handouts(chosen: Scenario, out: Path) -> dict[str, str]:
    """Writes what the operator of this machine would have: vehicle.yaml and boundary.geojson, as
    the scenario's belief says. Returns the options for `daranti drive`."""
    out.mkdir(parents=True, exist_ok=True)
    told = chosen.told
    save_vehicle(out / "vehicle.yaml", told.vehicle)
    frame = LocalFrame(chosen.gnss.lat_deg, chosen.gnss.lon_deg)
    rings = [
        [frame.to_wgs84(x, y)[::-1] for x, y in (*ring, ring[0])]
        for ring in (told.boundary, *told.keep_outs)
    ]
    polygon = {"type": "Polygon", "coordinates": rings}
    save_text(out / "boundary.geojson", json.dumps(polygon))
    return {
        "vehicle": str(out / "vehicle.yaml"),
        "mount": chosen.camera,
        "mode": chosen.mode,
        "boundary": str(out / "boundary.geojson"),
        "corner": str(told.corner),
        "gap": str(told.gap_m),
    }


def rehearse(chosen: Scenario) -> None:
    """Does once, on a field of its own, all that a run does: what is compiled at its first use
    would halt the clock for seconds."""
    small = FieldSpec(size_m=(3.0, 3.0))
    with Bench(chosen.model_copy(update={"field": small, "faults": ()})) as bench:
        bench.advance(2 * SLICE_S)
        develop(bench.camera, bench.shutter())
        x, y, yaw = 1.0, 1.0, 0.0
        bench.field.cut((x, y, yaw), (x + 0.1, y, yaw), ahead_m=0.5, width_m=1.0)
        develop(bench.camera, bench.shutter())
        bench.fix()
