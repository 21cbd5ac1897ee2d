"""A metre straight on: drive, hall sensor, battery under load, course, delay and camera's mount."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.check.board import AtRest
from host.check.camera import grey
from host.check.notes import Notes
from host.check.rolling_view import Rolled, delay_s, mounted
from host.core.messages import Command, Fix, Request, State, Telemetry
from host.core.vehicle import Mount
from host.runs.drive import fitted
from host.sensors.jpeg import JpegDecoder

DROP_V: Final = 0.5
"""From rest to a rolling machine: the blade takes several times as much."""
SAG_V: Final = 0.4
"""So far above the board's own limit the loaded battery stays."""
ROLL_M: Final = 1.0
"""Enough to tape to a few per cent, little enough for any headland."""
ROLL_MPS: Final = 0.2
"""A walking person keeps up and can stop it."""
ROLL_S: Final = 8.0
"""A metre at that speed takes 5 s."""
STANDS_S: Final = 1.2
"""Before it rolls, for pictures of the machine at rest."""
SCALE: Final = (0.8, 1.25)
"""Share of the distance reported that the tape may show; a magnet too few differs by more."""
LATE_S: Final = 0.25
"""A camera's delay may be off by so much, and by half a pulse of the wheels: 15 cm at 0.5 m/s."""
TILTED_DEG: Final = 3.75
"""Of the pitch. An owner measures it to 1.5 degrees, and the check errs by 0.7."""
BLURRED_PX: Final = 1.0
"""A picture that moves otherwise than any mount explains tells nothing of it."""
ASKEW_DEG: Final = 3.0
"""Of the yaw: an owner measures it to 1.5 degrees, and the check errs by 0.7."""
FIELD_OF_VIEW: Final = 0.06
"""Share by which a data sheet's focal length may be wrong: 3 degrees of 62."""
BENT: Final = 0.1
"""Of a lens's distortion k1, which a data sheet leaves out, the most."""
ROLLED_DEG: Final = 4.5
"""Of the roll, which the ground on one side tells less well."""


class Roll:
    """One roll, from the question whether there is room to what was seen on the way."""

    def __init__(self, notes: Notes, rest: AtRest) -> None:
        self._notes = notes
        self._hands = notes.hands
        self._rest = rest
        self._seen: list[Telemetry] = []
        self._pictures: list[tuple[float, NDArray[np.uint8]]] = []
        self._fixes: list[Fix] = []

    def run(self, picture: bool) -> bool:
        """Whether the blade may be tried next. `picture`: whether the camera's can be used."""
        hands = self._hands
        if self._notes.ask("room", "yes", "no") != "yes":
            return False
        if not self._notes.arm():
            return self._notes.note("drive", "bad", "drive.fault", faults=self._notes.fault_texts)
        begin = hands.telemetry
        assert begin is not None
        hands.picture()
        self._watched(STANDS_S, 0.0)
        start = hands.clock()
        stopped = False
        while hands.clock() - start < ROLL_S and not stopped:
            self._watched(0.05, ROLL_MPS)
            last = hands.telemetry
            assert last is not None
            stopped = (
                last.state in (State.FAULT, State.SAFE)
                or abs(last.distance_m - begin.distance_m) >= ROLL_M
                or (last.speed_mps is None and hands.clock() - start >= ROLL_M / ROLL_MPS)
            )
        names = self._notes.faults
        self._notes.halt()
        self._notes.until(1.5, lambda: not self._moving())
        if "HALL_LOST" in names:
            return self._no_hall()
        if "WRONG_WAY" in names:
            return self._notes.note("drive", "bad", "drive.reversed")
        if names:
            faults = [f"fault.{name}" for name in names]
            return self._notes.note("drive", "bad", "drive.fault", faults=faults)
        answer = self._notes.ask("rolled", "forward", "backward", "not_at_all")
        if answer == "backward":
            return self._notes.note("drive", "bad", "drive.reversed")
        if answer != "forward":
            return self._notes.note("drive", "bad", "drive.dead")
        self._notes.note("drive", "ok", "drive.ok")
        last = hands.telemetry
        assert last is not None
        fine = self._hall(abs(last.distance_m - begin.distance_m), last.speed_mps is not None)
        self._load()
        self._course()
        if picture:
            self._views()
        return fine

    def _moving(self) -> bool:
        last = self._hands.telemetry
        return last is not None and abs(last.speed_mps or 0.0) > 0.02

    def _watched(self, seconds: float, speed_mps: float) -> None:
        """Drives for a time and keeps what camera and receiver show meanwhile."""
        hands = self._hands
        decoder = JpegDecoder()
        end = hands.clock() + seconds
        while hands.clock() < end:
            hands.send(Command(Request.DRIVE, 0.0, speed_mps, False, "check"))
            self._seen += hands.pump(min(0.05, max(0.0, end - hands.clock())) or 0.01)
            picture = hands.picture()
            if picture is not None:
                bgr = fitted(picture, decoder, hands.mount, 0.0).bgr
                if bgr.size:
                    self._pictures.append((picture.stamp, grey(bgr)))
            fix = hands.fix()
            if fix is not None:
                self._fixes.append(fix)
            if self._seen and self._seen[-1].state in (State.FAULT, State.SAFE):
                break

    def _no_hall(self) -> bool:
        if self._notes.ask("rolled", "forward", "backward", "not_at_all") == "not_at_all":
            return self._notes.note("drive", "bad", "drive.dead")
        return self._notes.note("hall", "bad", "hall.dead")

    def _hall(self, reported: float, fitted_: bool) -> bool:
        if not fitted_:
            return self._notes.note("hall", "bad", "hall.none")
        measured = self._notes.ask("rolled_m", reported=round(reported, 2))
        if not isinstance(measured, int | float) or measured <= 0:
            return self._notes.note("hall", "bad", "hall.unmeasured")
        ratio = measured / max(reported, 1e-3)
        pulses = self._hands.vehicle.hall_pulses_per_m
        values = {"reported": reported, "measured": float(measured), "right": pulses / ratio}
        fine = SCALE[0] <= ratio <= SCALE[1]
        return self._notes.judge("hall", fine, "hall.scale", **values)

    def _load(self) -> None:
        low = min((t.battery_v for t in self._seen), default=math.nan)
        limit = max(
            self._rest.parameters.get("battery_low", 0.0) + SAG_V, self._rest.battery_v - DROP_V
        )
        self._notes.judge("load", low >= limit, "load.sags", volts=low, least=limit)

    def _course(self) -> None:
        courses = [fix for fix in self._fixes if fix.quality > 0]
        if not courses:
            self._notes.note("course", "bad", "receiver.none", why=self._hands.gnss_problem or "-")
        elif all(fix.speed_mps is None for fix in courses):
            self._notes.note("course", "bad", "course.none")
        else:
            self._notes.note("course", "ok", "course.ok")

    def _views(self) -> None:
        seen = self._seen
        believed = self._hands.vehicle.camera_delay_s
        if all(t.speed_mps is None for t in seen):
            self._notes.note("delay", "warn", "delay.unknown")
            self._notes.note("mount", "warn", "mount.unknown")
            return
        stamps = np.array([t.stamp for t in seen])
        ways = np.abs(np.array([t.distance_m for t in seen]) - seen[0].distance_m)
        mount = self._hands.mount
        at_ways = list(zip(stamps.tolist(), ways.tolist(), strict=True))
        late = delay_s(self._pictures, at_ways, mount)
        if late is None:
            self._notes.note("delay", "warn", "delay.unknown")
        else:
            pulses_ps = ROLL_MPS * max(self._hands.vehicle.hall_pulses_per_m, 1.0)
            fine = abs(late - believed) < LATE_S + 0.5 / pulses_ps
            self._notes.judge("delay", fine, "delay.other", seen=late, believed=believed)
        delay = believed if late is None else late
        rolled = [
            Rolled(at, float(np.interp(at - delay, stamps, ways)), shown)
            for at, shown in self._pictures
        ]
        found = mounted(rolled, mount)
        if found is None or found.residual_px > BLURRED_PX:
            self._notes.note("mount", "warn", "mount.unknown")
            return
        off = {"pitch": found.pitch_deg, "yaw": found.yaw_deg, "roll": found.roll_deg}
        straight = abs(off["yaw"]) < ASKEW_DEG and abs(off["roll"]) < ROLLED_DEG
        too_far_deg = abs(off["pitch"]) - TILTED_DEG
        if straight and 0.0 <= too_far_deg < _by_lens_deg(mount):
            self._notes.note("mount", "warn", "mount.lens", **off)
            return
        self._notes.judge("mount", straight and too_far_deg < 0.0, "mount.tilted", **off)


def _by_lens_deg(mount: Mount) -> float:
    """How much of the pitch a lens that was not measured may feign beyond TILTED_DEG: what lies
    straight ahead is seen that far above the picture's middle."""
    if mount.lens_measured:
        return 0.0
    pitch = math.radians(abs(mount.pitch_deg))
    wrong = FIELD_OF_VIEW + BENT * math.tan(pitch) ** 2
    return math.degrees(0.5 * math.sin(2.0 * pitch) * wrong)
