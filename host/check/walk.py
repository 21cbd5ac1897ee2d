"""The list that the machine walks itself before its blade may be armed.

Each line looks at one thing, and says what was seen; what it means and what to do stand in the
texts of each language under the finding's name. Lines that move the machine come last, and only
where those before them allow it. The blade is switched once, with its own supply off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from host.check.lines import Hands, Line, Question, Values, Verdict
from host.check.rolling_view import Rolled, delay_s, mounted
from host.core.errors import UserError
from host.core.messages import Command, Fix, Request, State, Telemetry
from host.field.boundary_file import Boundary, load_field
from host.field.fence import nearest_corner
from host.link import protocol
from host.route.field_plan import plan_of
from host.runs.drive import fits, fitted
from host.sensors.jpeg import JpegDecoder
from host.sensors.picture_watch import PictureWatch
from host.vision.mounted.detector import make_detector

BYTES_AN_HOUR: Final = 2.4e9
"""A record's, pictures included."""
LEAST_BYTES: Final = 2 * BYTES_AN_HOUR
LEAST_POWER: Final = 30
BOARD_S: Final = 8.0
PICTURE_S: Final = 6.0
WATCH_S: Final = 2.5
FIX_S: Final = 12.0
LEAST_RATE: Final = 5.0
SLOWEST_S: Final = 0.045
"""Processor time for one picture, of the step's 50 ms."""
SURE: Final = 0.6
SURER: Final = 0.25
"""By so much a turned picture must be clearer for the camera to count as turned."""
POOR_HDOP: Final = 4.0
FEW_SATELLITES: Final = 5
FAR_M: Final = 30.0
CORNER_M: Final = 8.0
"""What a phone's position may be off by."""
REST_V: Final = 0.965
"""Of the nominal voltage: below it a resting lead battery is nearly empty."""
DROP_V: Final = 0.5
"""From rest to a rolling machine: the blade takes several times as much."""
SAG_V: Final = 0.4
"""Above the board's own limit, under load."""
HELD_S: Final = 40.0
STEP_DEG: Final = 25.0
STEP_S: Final = 1.8
OFF_DEG: Final = 3.0
OVERSHOOT: Final = 0.35
STOP_ROOM_DEG: Final = 3.0
STOP_S: Final = 3.0
ROLL_M: Final = 1.0
ROLL_MPS: Final = 0.2
ROLL_S: Final = 8.0
STANDS_S: Final = 1.2
"""Before it rolls, for pictures of the machine at rest."""
SCALE: Final = (0.8, 1.25)
LATE_S: Final = 0.3
"""A camera's delay may be off by so much."""
TILTED_DEG: Final = 3.5
BLURRED_PX: Final = 0.8
"""Ground that moves otherwise than any mount explains tells nothing of it."""
ASKEW_DEG: Final = 5.0
"""Of the yaw: a way that is not quite straight looks like it."""
ROLLED_DEG: Final = 7.0
"""Of the roll, which the ground on one side tells less well."""
BLADE_S: Final = 1.2
POT_COUNTS: Final = 60.0
"""From the centre to either calibration point, at least."""
SAME: Final = 0.02


@dataclass(frozen=True, slots=True)
class Target:
    """Which field, from which corner."""

    boundary: Path | None
    gap_m: float | None
    corner: int


class Walk:
    """One check, from its beginning to its end."""

    def __init__(self, hands: Hands, target: Target) -> None:
        self._hands = hands
        self._target = target
        self.lines: list[Line] = []
        self._boundary: Boundary | None = None
        self._values: dict[str, float] = {}
        self._rest_v = 0.0
        self._pictures: list[tuple[float, NDArray[np.uint8]]] = []
        self._fix: Fix | None = None
        self._fixes: list[Fix] = []

    def run(self) -> list[Line]:
        """All lines."""
        self._note("vehicle", "ok", "vehicle.ok")
        self._field()
        self._laptop()
        board = self._board()
        picture = self._camera()
        self._receiver()
        safe = board and self._estop() and self._steering() and self._stops()
        if safe and self._roll(picture):
            self._blade()
        for name in ("estop", "steering", "gains", "stops", "drive", "hall", "load", "course"):
            self._skip(name)
        for name in ("delay", "mount", "blade"):
            self._skip(name)
        return self.lines

    # ---- saying ----------------------------------------------------------------------------------

    def _note(self, name: str, verdict: Verdict, finding: str, **values: object) -> bool:
        tidy: Values = {
            key: round(value, 2) if isinstance(value, float) else value
            for key, value in values.items()
        }
        self.lines.append(Line(name, verdict, finding, tidy))
        self._hands.show(self.lines)
        return verdict != "bad"

    def _skip(self, name: str) -> None:
        if all(line.name != name for line in self.lines):
            self._note(name, "skipped", "")

    def _ask(
        self, key: str, *choices: str, until: Callable[[], bool] | None = None, **values: object
    ) -> str | float | None:
        return self._hands.operator(Question(key, choices, dict(values)), until)

    # ---- files and laptop ------------------------------------------------------------------------

    def _field(self) -> None:
        target = self._target
        if target.boundary is None:
            self._note("field", "bad", "field.none")
            return
        try:
            boundary = load_field(target.boundary)
            _, plan = plan_of(
                boundary, target.corner, self._hands.vehicle, "three_point", target.gap_m
            )
        except UserError as error:
            self._note("field", "bad", "field.unusable", why=str(error))
            return
        self._boundary = boundary
        if target.gap_m is None:
            self._note("field", "bad", "field.no_gap")
            return
        area = boundary.polygon(boundary.frame).area
        self._note("field", "ok", "field.ok", area=round(area), sides=len(plan.sides))

    def _laptop(self) -> None:
        free = self._hands.free_bytes()
        enough = free >= LEAST_BYTES
        hours = round(free / BYTES_AN_HOUR, 1)
        values = {"free": round(free / 1e9, 1), "hours": hours}
        self._note(
            "disk", "ok" if enough else "bad", "disk.ok" if enough else "disk.full", **values
        )
        power = self._hands.power()
        if power is None:
            self._note("power", "ok", "power.mains")
        elif power[0] < LEAST_POWER and not power[1]:
            self._note("power", "bad", "power.low", percent=power[0])
        else:
            self._note("power", "ok", "power.ok", percent=power[0])

    # ---- the board at rest -----------------------------------------------------------------------

    def _until(self, seconds: float, holds: Callable[[], bool]) -> bool:
        end = self._hands.clock() + seconds
        while not holds():
            if self._hands.clock() > end:
                return False
            self._hands.pump(0.05)
        return True

    def _board(self) -> bool:
        hands = self._hands
        there = self._until(BOARD_S, lambda: hands.version is not None and not hands.board_problem)
        if not there:
            why = hands.board_problem
            if "protocol version" in why:
                self._note("port", "ok", "port.ok")
                return self._note("firmware", "bad", "firmware.other", why=why)
            return self._note("port", "bad", "port.silent", why=why)
        self._note("port", "ok", "port.ok")
        version, last = hands.version, hands.telemetry
        assert version is not None
        assert last is not None
        number = f"{version.firmware_major}.{version.firmware_minor}"
        if version.build == 2:
            return self._note("firmware", "bad", "firmware.hil", version=number)
        self._note("firmware", "ok", "firmware.ok", version=number)
        return all([self._faults(), self._parameters(), self._battery(last.battery_v)])

    def _faults(self) -> bool:
        hands = self._hands
        if self._state() is State.FAULT:
            hands.send(Command(Request.CLEAR, reason="check"))
            hands.pump(0.5)
        faults = self._names()
        if faults == ["ESTOP_OPEN"]:
            return self._note("faults", "bad", "faults.estop")
        if faults:
            return self._note(
                "faults", "bad", "faults.there", faults=[f"fault.{f}" for f in faults]
            )
        return self._note("faults", "ok", "faults.ok")

    def _state(self) -> State | None:
        last = self._hands.telemetry
        return None if last is None else last.state

    def _names(self) -> list[str]:
        last = self._hands.telemetry
        faults = protocol.Fault(0 if last is None else last.faults)
        return [str(bit.name) for bit in protocol.Fault if bit in faults]

    def _parameters(self) -> bool:
        try:
            for name, spec in protocol.PARAMS.items():
                answer = self._hands.ask_board(protocol.ParamGet(spec.id))
                assert isinstance(answer, protocol.ParamValue)
                self._values[name] = spec.from_raw(answer.value)
        except UserError as error:
            return self._note("parameters", "bad", "parameters.unread", why=str(error))
        vehicle, held = self._hands.vehicle, self._values
        differ = [
            f"{name} {held[name]:g} / {believed:g}"
            for name, believed, fine in (
                (
                    "hall_per_metre",
                    vehicle.hall_pulses_per_m,
                    math.isclose(held["hall_per_metre"], vehicle.hall_pulses_per_m, rel_tol=SAME),
                ),
                (
                    "steer_limit",
                    vehicle.steer_limit_deg,
                    held["steer_limit"] >= vehicle.steer_limit_deg - 0.5,
                ),
                (
                    "speed_max",
                    vehicle.cutting_speed_mps,
                    held["speed_max"] >= vehicle.cutting_speed_mps,
                ),
                (
                    "battery_nominal",
                    vehicle.nominal_battery_v,
                    held["battery_nominal"] in (0.0, vehicle.nominal_battery_v),
                ),
            )
            if not fine
        ]
        if differ:
            return self._note("parameters", "bad", "parameters.differ", pairs=differ)
        self._note("parameters", "ok", "parameters.ok", count=len(held))
        styles = {"steer": round(held["steer_driver"]), "drive": round(held["drive_driver"])}
        if 0 in styles.values():
            self._skip("pot")
            return self._note("bridge", "bad", "bridge.unset", **styles)
        self._note("bridge", "ok", "bridge.ok", **styles)
        left, centre, right = (held[f"pot_{side}"] for side in ("left", "centre", "right"))
        apart = (left - centre) * (centre - right) > 0
        wide = min(abs(left - centre), abs(centre - right)) > POT_COUNTS
        counts = {"left": round(left), "centre": round(centre), "right": round(right)}
        fine = apart and wide
        return self._note(
            "pot", "ok" if fine else "bad", "pot.ok" if fine else "pot.unset", **counts
        )

    def _battery(self, volts: float) -> bool:
        self._rest_v = volts
        nominal = self._hands.vehicle.nominal_battery_v
        least = max(REST_V * nominal, self._values.get("battery_low", 0.0) + 0.7)
        if volts < least:
            return self._note("battery", "bad", "battery.low", volts=volts, least=least)
        if volts > self._values.get("battery_high", math.inf) - 0.3:
            return self._note("battery", "bad", "battery.high", volts=volts)
        return self._note("battery", "ok", "battery.ok", volts=volts, least=least)

    # ---- camera ----------------------------------------------------------------------------------

    def _camera(self) -> bool:
        """Whether its pictures can be used while rolling."""
        hands = self._hands
        taken: list[tuple[float, bytes | None, NDArray[np.uint8]]] = []
        decoder = JpegDecoder()
        shape: tuple[int, int] | None = None
        end = hands.clock() + PICTURE_S
        while len(taken) < 2 and hands.clock() < end:
            hands.pump(0.05)
            picture = hands.picture()
            if picture is not None:
                frame = fitted(picture, decoder, hands.mount, 0.0)
                shape = (frame.bgr.shape[1], frame.bgr.shape[0])
                if not fits(frame, hands.mount) and frame.bgr.size:
                    return self._wrong_size(shape)
                taken.append((picture.stamp, picture.jpeg, frame.bgr))
        if len(taken) < 2:
            why = hands.camera_problem or "-"
            for name in ("picture", "laptop"):
                self._skip(name)
            return self._note("camera", "bad", "camera.none", why=why)
        begin = hands.clock()
        count, same = 0, 0
        while hands.clock() - begin < WATCH_S:
            hands.pump(0.03)
            picture = hands.picture()
            if picture is not None:
                count += 1
                same += picture.jpeg is not None and picture.jpeg == taken[-1][1]
                taken.append(
                    (picture.stamp, picture.jpeg, fitted(picture, decoder, hands.mount, 0.0).bgr)
                )
        rate = count / WATCH_S
        if count in (0, same):
            self._skip("picture")
            self._skip("laptop")
            return self._note("camera", "bad", "camera.frozen")
        if rate < LEAST_RATE:
            self._note("camera", "bad", "camera.slow", rate=round(rate, 1), least=LEAST_RATE)
        else:
            width, height = shape or (0, 0)
            self._note("camera", "ok", "camera.ok", width=width, height=height, rate=round(rate, 1))
        frames = [bgr for _, _, bgr in taken if bgr.size][-12:]
        return self._looks(frames)

    def _wrong_size(self, shape: tuple[int, int]) -> bool:
        mount = self._hands.mount
        sizes = {"width": shape[0], "height": shape[1]}
        wanted = {"wide": mount.width_px, "high": mount.height_px}
        self._skip("picture")
        self._skip("laptop")
        if shape[0] < shape[1] and mount.width_px > mount.height_px:
            return self._note("camera", "bad", "camera.upright", **sizes, **wanted)
        return self._note("camera", "bad", "camera.size", **sizes, **wanted)

    def _looks(self, frames: list[NDArray[np.uint8]]) -> bool:
        hands = self._hands
        watch = PictureWatch(hands.mount.width_px, hands.mount.height_px)
        problem = ""
        for bgr in frames[-4:]:
            problem = watch.problem(bgr)
        if problem and "repeats" not in problem:
            self._skip("laptop")
            return self._note("picture", "bad", "picture.bad", why=problem)
        clear = self._confidence(frames, lambda bgr: bgr)
        values = {"confidence": clear}
        if clear >= SURE:
            self._note("picture", "ok", "picture.ok", **values)
        else:
            ways: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
                "picture.upside_down": lambda bgr: _u8(cv2.rotate(bgr, cv2.ROTATE_180)),
                "picture.mirrored": lambda bgr: _u8(cv2.flip(bgr, 1)),
                "picture.turned": lambda bgr: _quarter(bgr, cv2.ROTATE_90_CLOCKWISE),
                "picture.turned_left": lambda bgr: _quarter(bgr, cv2.ROTATE_90_COUNTERCLOCKWISE),
            }
            found = {name: self._confidence(frames, way) for name, way in ways.items()}
            best = max(found, key=lambda name: found[name])
            if found[best] > max(SURE, clear + SURER):
                self._skip("laptop")
                return self._note(
                    "picture", "bad", best.removesuffix("_left"), confidence=found[best]
                )
            self._note("picture", "bad", "picture.no_edge", **values)
        return self._speed(frames)

    def _confidence(
        self,
        frames: list[NDArray[np.uint8]],
        way: Callable[[NDArray[np.uint8]], NDArray[np.uint8]],
    ) -> float:
        hands = self._hands
        detector = make_detector(hands.mode, hands.vehicle, hands.mount)
        sure = [detector.see(np.ascontiguousarray(way(bgr))).confidence for bgr in frames]
        return float(np.median(sure[len(sure) // 3 :]))

    def _speed(self, frames: list[NDArray[np.uint8]]) -> bool:
        hands = self._hands
        detector = make_detector(hands.mode, hands.vehicle, hands.mount)
        took = []
        for bgr in frames:
            begin = hands.busy_s()
            detector.see(bgr)
            took.append(hands.busy_s() - begin)
        step = float(np.median(took))
        slow = step > SLOWEST_S
        self._note(
            "laptop",
            "bad" if slow else "ok",
            "laptop.slow" if slow else "laptop.ok",
            ms=round(step * 1e3, 1),
            most=round(SLOWEST_S * 1e3),
        )
        return True

    # ---- receiver --------------------------------------------------------------------------------

    def _receiver(self) -> None:
        hands = self._hands
        heard: list[Fix] = []
        end = hands.clock() + FIX_S
        while hands.clock() < end and len([f for f in heard if f.quality > 0]) < 4:
            hands.pump(0.1)
            fix = hands.fix()
            if fix is not None:
                heard.append(fix)
        good = [fix for fix in heard if fix.quality > 0]
        if not heard:
            self._note("receiver", "bad", "receiver.none", why=hands.gnss_problem or "-")
        elif not good:
            self._note("receiver", "bad", "receiver.no_fix")
        elif good[-1].hdop > POOR_HDOP or good[-1].satellites < FEW_SATELLITES:
            last = good[-1]
            self._note(
                "receiver", "bad", "receiver.poor", satellites=last.satellites, hdop=last.hdop
            )
        elif len(good) < 4:
            self._note("receiver", "bad", "receiver.slow", count=len(good), seconds=FIX_S)
        else:
            self._note("receiver", "ok", "receiver.ok", satellites=good[-1].satellites)
        if not good or self._boundary is None:
            self._skip("place")
            return
        self._fix = good[-1]
        self._place(good)

    def _place(self, fixes: list[Fix]) -> None:
        boundary = self._boundary
        assert boundary is not None
        frame = boundary.frame
        lat = float(np.median([fix.lat_deg for fix in fixes]))
        lon = float(np.median([fix.lon_deg for fix in fixes]))
        here = frame.to_local(lat, lon)
        away = float(boundary.polygon(frame).distance(shapely.Point(here)))
        if away > FAR_M:
            self._note("place", "bad", "place.other_field", metres=round(away))
            return
        corner = frame.to_local(*boundary.crop[self._target.corner])
        nearest = nearest_corner(boundary.crop, lat, lon)
        other = frame.to_local(*boundary.crop[nearest])
        wrong = math.dist(here, corner)
        numbers = {"asked": self._target.corner + 1, "nearest": nearest + 1, "metres": round(wrong)}
        if nearest != self._target.corner and wrong > math.dist(here, other) + CORNER_M:
            self._note("place", "bad", "place.corner", **numbers)
        elif wrong > FAR_M / 2:
            self._note("place", "bad", "place.far", **numbers)
        else:
            self._note("place", "ok", "place.ok", **numbers)

    # ---- moving ----------------------------------------------------------------------------------

    def _estop(self) -> bool:
        hands = self._hands

        def open_() -> bool:
            return "ESTOP_OPEN" in self._names()

        answer = self._ask("estop_press", "pressed", until=open_)
        if answer is not None:
            self._until(1.0, open_)
        if not open_():
            return self._note("estop", "bad", "estop.bridged")
        tried = hands.clock()

        def closed() -> bool:
            nonlocal tried
            if self._state() is State.SAFE:
                return True
            if hands.clock() - tried > 0.4:
                tried = hands.clock()
                hands.send(Command(Request.CLEAR, reason="check"))
            return False

        answer = self._ask("estop_release", "released", until=closed)
        if answer is not None:
            self._until(2.0, closed)
        if not closed():
            return self._note("estop", "bad", "estop.stuck")
        return self._note("estop", "ok", "estop.ok")

    def _arm(self) -> bool:
        hands = self._hands
        end = hands.clock() + 2.0
        # The board arms only where the last speed asked for was none.
        hands.send(Command(Request.DRIVE, reason="check"))
        while self._state() is not State.ARMED:
            if hands.clock() > end or self._state() is State.FAULT:
                return False
            hands.send(Command(Request.ARM, reason="check"))
            hands.pump(0.1)
        return True

    def _drive(
        self, seconds: float, *, steer_deg: float = 0.0, speed: float = 0.0, blade: bool = False
    ) -> list[Telemetry]:
        """The same command for a time; ends early where the board gives up."""
        hands = self._hands
        end = hands.clock() + seconds
        seen: list[Telemetry] = []
        while hands.clock() < end:
            hands.send(Command(Request.DRIVE, math.radians(steer_deg), speed, blade, "check"))
            seen += hands.pump(0.05)
            if seen and seen[-1].state in (State.FAULT, State.SAFE):
                break
        return seen

    def _halt(self) -> None:
        hands = self._hands
        for _ in range(20):
            hands.send(Command(Request.STOP, reason="check"))
            hands.pump(0.05)
            if self._state() in (State.SAFE, State.FAULT):
                return

    def _steering(self) -> bool:
        if not self._arm():
            names = [f"fault.{name}" for name in self._names()]
            return self._note("steering", "bad", "steering.not_armed", faults=names)
        first = self._drive(STEP_S, steer_deg=STEP_DEG)
        second = self._drive(STEP_S, steer_deg=-STEP_DEG) if self._names() == [] else []
        third = self._drive(STEP_S, steer_deg=STEP_DEG) if self._names() == [] else []
        names = self._names()
        self._halt()
        findings = {
            "STEER_RUNAWAY": "steering.reversed",
            "POT_FROZEN": "steering.frozen",
            "STEER_STALL": "steering.stalled",
        }
        known = next((findings[name] for name in names if name in findings), None)
        if known is not None:
            return self._note("steering", "bad", known)
        if names or not third:
            faults = [f"fault.{name}" for name in names]
            return self._note("steering", "bad", "steering.fault", faults=faults)
        reached = math.degrees(first[-1].angle_rad)
        if abs(reached - STEP_DEG) > OFF_DEG:
            return self._note("steering", "bad", "steering.short", asked=STEP_DEG, reached=reached)
        answer = self._ask("steered", "left", "right", "not_at_all")
        if answer == "right":
            return self._note("steering", "bad", "steering.mirrored")
        if answer != "left":
            return self._note("steering", "bad", "steering.unseen")
        self._note("steering", "ok", "steering.ok", asked=STEP_DEG, reached=reached)
        angles = np.degrees([t.angle_rad for t in second])
        swing = float(-STEP_DEG - angles.min()) / (2 * STEP_DEG)
        rest = float(np.std(angles[-15:]))
        good = swing < OVERSHOOT and rest < 1.5
        self._note(
            "gains",
            "ok" if good else "bad",
            "gains.ok" if good else "gains.swing",
            percent=round(100 * max(0.0, swing)),
            restless=rest,
        )
        return True

    def _stops(self) -> bool:
        limit = self._hands.vehicle.steer_limit_deg - STOP_ROOM_DEG
        for side, angle in (("left", limit), ("right", -limit)):
            seen = self._drive(STOP_S, steer_deg=angle) if self._arm() else []
            names = self._names()
            if names or not seen:
                self._halt()
                faults = [f"fault.{name}" for name in names]
                return self._note(
                    "stops", "bad", "stops.blocked", side=f"word.{side}", asked=angle, faults=faults
                )
            reached = math.degrees(seen[-1].angle_rad)
            if abs(reached - angle) > OFF_DEG + 1:
                self._halt()
                return self._note(
                    "stops", "bad", "stops.short", side=f"word.{side}", asked=angle, reached=reached
                )
            if side == "left":
                self._halt()
                answer = self._ask("turned_far", "as_drawn", "less", "more", degrees=round(limit))
                if answer != "as_drawn":
                    return self._note("stops", "bad", "stops.scale", answer=f"answer.{answer}")
        self._drive(STOP_S)
        self._halt()
        answer = self._ask("straight", "yes", "points_left", "points_right")
        if answer != "yes":
            return self._note("stops", "bad", "stops.centre", answer=f"answer.{answer}")
        return self._note("stops", "ok", "stops.ok", degrees=round(limit))

    def _roll(self, picture: bool) -> bool:
        """Rolls a metre straight on: drive, hall sensor, battery under load, course and camera."""
        hands = self._hands
        if self._ask("room", "yes", "no") != "yes":
            return False
        if not self._arm():
            names = [f"fault.{name}" for name in self._names()]
            return self._note("drive", "bad", "drive.fault", faults=names)
        begin = hands.telemetry
        assert begin is not None
        hands.picture()
        seen = self._watched(STANDS_S, 0.0)
        start = hands.clock()
        stopped = False
        while hands.clock() - start < ROLL_S and not stopped:
            seen += self._watched(0.05, ROLL_MPS)
            last = hands.telemetry
            assert last is not None
            stopped = (
                last.state in (State.FAULT, State.SAFE)
                or abs(last.distance_m - begin.distance_m) >= ROLL_M
                or (last.speed_mps is None and hands.clock() - start >= ROLL_M / ROLL_MPS)
            )
        names = self._names()
        self._halt()
        self._until(1.5, lambda: not self._moving())
        if "HALL_LOST" in names:
            return self._no_hall()
        if "WRONG_WAY" in names:
            return self._note("drive", "bad", "drive.reversed")
        if names:
            faults = [f"fault.{name}" for name in names]
            return self._note("drive", "bad", "drive.fault", faults=faults)
        answer = self._ask("rolled", "forward", "backward", "not_at_all")
        if answer == "backward":
            return self._note("drive", "bad", "drive.reversed")
        if answer != "forward":
            return self._note("drive", "bad", "drive.dead")
        self._note("drive", "ok", "drive.ok")
        last = hands.telemetry
        assert last is not None
        fine = self._hall(abs(last.distance_m - begin.distance_m), last.speed_mps is not None)
        self._load(seen)
        self._course()
        if picture:
            self._rolling_pictures(seen)
        return fine

    def _moving(self) -> bool:
        last = self._hands.telemetry
        return last is not None and abs(last.speed_mps or 0.0) > 0.02

    def _watched(self, seconds: float, speed: float) -> list[Telemetry]:
        """Drives for a time and keeps what camera and receiver show meanwhile."""
        hands = self._hands
        decoder = JpegDecoder()
        end = hands.clock() + seconds
        seen: list[Telemetry] = []
        while hands.clock() < end:
            hands.send(Command(Request.DRIVE, 0.0, speed, False, "check"))
            seen += hands.pump(min(0.05, max(0.0, end - hands.clock())) or 0.01)
            picture = hands.picture()
            if picture is not None:
                bgr = fitted(picture, decoder, hands.mount, 0.0).bgr
                if bgr.size:
                    self._pictures.append(
                        (picture.stamp, _u8(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)))
                    )
            fix = hands.fix()
            if fix is not None:
                self._fixes.append(fix)
            if seen and seen[-1].state in (State.FAULT, State.SAFE):
                break
        return seen

    def _no_hall(self) -> bool:
        if self._ask("rolled", "forward", "backward", "not_at_all") == "not_at_all":
            return self._note("drive", "bad", "drive.dead")
        return self._note("hall", "bad", "hall.dead")

    def _hall(self, reported: float, fitted_: bool) -> bool:
        if not fitted_:
            return self._note("hall", "ok", "hall.none")
        measured = self._ask("rolled_m", reported=round(reported, 2))
        if not isinstance(measured, int | float) or measured <= 0:
            return self._note("hall", "bad", "hall.unmeasured")
        ratio = measured / max(reported, 1e-3)
        pulses = self._hands.vehicle.hall_pulses_per_m
        values = {"reported": reported, "measured": float(measured), "right": pulses / ratio}
        fine = SCALE[0] <= ratio <= SCALE[1]
        return self._note(
            "hall", "ok" if fine else "bad", "hall.ok" if fine else "hall.scale", **values
        )

    def _load(self, seen: list[Telemetry]) -> None:
        low = min((t.battery_v for t in seen), default=math.nan)
        limit = max(self._values.get("battery_low", 0.0) + SAG_V, self._rest_v - DROP_V)
        fine = low >= limit
        self._note(
            "load",
            "ok" if fine else "bad",
            "load.ok" if fine else "load.sags",
            volts=low,
            least=limit,
        )

    def _course(self) -> None:
        courses = [fix for fix in self._fixes if fix.quality > 0]
        if not courses:
            self._note("course", "bad", "receiver.none", why=self._hands.gnss_problem or "-")
        elif all(fix.speed_mps is None for fix in courses):
            self._note("course", "bad", "course.none")
        else:
            self._note("course", "ok", "course.ok")

    def _rolling_pictures(self, seen: list[Telemetry]) -> None:
        believed = self._hands.vehicle.camera_delay_s
        if all(t.speed_mps is None for t in seen):
            self._note("delay", "warn", "delay.unknown")
            self._note("mount", "warn", "mount.unknown")
            return
        late = delay_s(
            self._pictures, [(t.stamp, t.speed_mps or 0.0) for t in seen], self._hands.mount
        )
        if late is None:
            self._note("delay", "warn", "delay.unknown")
        else:
            fine = abs(late - believed) < LATE_S
            finding = "delay.ok" if fine else "delay.other"
            self._note("delay", "ok" if fine else "bad", finding, seen=late, believed=believed)
        stamps = np.array([t.stamp for t in seen])
        ways = np.abs(np.array([t.distance_m for t in seen]) - seen[0].distance_m)
        rolled = [
            Rolled(at, float(np.interp(at - (late or believed), stamps, ways)), grey)
            for at, grey in self._pictures
        ]
        found = mounted(rolled, self._hands.mount)
        if found is None or found.residual_px > BLURRED_PX:
            self._note("mount", "warn", "mount.unknown")
            return
        off = {"pitch": found.pitch_deg, "yaw": found.yaw_deg, "roll": found.roll_deg}
        fine = (
            abs(off["pitch"]) < TILTED_DEG
            and abs(off["yaw"]) < ASKEW_DEG
            and abs(off["roll"]) < ROLLED_DEG
        )
        self._note("mount", "ok" if fine else "bad", "mount.ok" if fine else "mount.tilted", **off)

    # ---- the blade's switch ----------------------------------------------------------------------

    def _blade(self) -> None:
        if self._ask("blade_supply", "supply_off", "cannot") != "supply_off":
            self._note("blade", "bad", "blade.supply")
            return
        if self._ask("blade_rest", "lamp_off", "lamp_on") != "lamp_off":
            self._note("blade", "bad", "blade.inverted")
            return
        if not self._arm():
            self._note("blade", "bad", "blade.not_armed")
            return
        self._drive(0.4)
        self._drive(BLADE_S, blade=True)
        self._drive(0.3)
        self._halt()
        if self._ask("blade_seen", "clicked", "silent") != "clicked":
            self._note("blade", "bad", "blade.dead")
            return
        self._note("blade", "ok", "blade.ok")


def _u8(picture: object) -> NDArray[np.uint8]:
    return np.asarray(picture, np.uint8)


def _quarter(bgr: NDArray[np.uint8], way: int) -> NDArray[np.uint8]:
    """A picture turned by a quarter, its middle cut out to the old proportions and size."""
    height, width = bgr.shape[:2]
    turned = cv2.rotate(bgr, way)
    keep = round(turned.shape[1] * height / width)
    top = (turned.shape[0] - keep) // 2
    return _u8(cv2.resize(turned[top : top + keep], (width, height)))
