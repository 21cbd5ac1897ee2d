"""Makes faults happen when they are due: on wires, serial lines, pictures, fixes and the host."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.firmware import signal_wires
from hil.firmware.real_board import Controller
from hil.firmware.signal_wires import Mode, Signal
from hil.firmware.targets import ResetCause
from hil.firmware.wiring import ESTOP_OPEN_MV
from hil.scenario.faults import At, Component, Failure, Fault
from host.pilot.phase import Doing
from sim_plant.gyro import Sample

RANGE_RADPS: Final = math.radians(2000.0)
"""Of a phone's gyroscope."""
BLOCKED_N: Final = 1e5
"""Drag of wheels that cannot turn."""


MOVING_MPS: Final = 0.1
"""From this speed on the machine counts as moving that way."""


OUTAGE_S: Final = 0.3
"""An intermittent source is there and gone for this long on average."""


_WIRES: Final[dict[tuple[str, str], tuple[Signal, Mode]]] = {
    ("pot", "off"): (Signal.POT, Mode.FIXED),
    ("pot", "stuck"): (Signal.POT, Mode.HELD),
    ("pot", "garbage"): (Signal.POT, Mode.NOISY),
    ("pot", "wrong"): (Signal.POT, Mode.SHIFTED),
    ("pot", "slow"): (Signal.POT, Mode.LAGGING),
    ("pot", "delayed"): (Signal.POT, Mode.LATE),
    ("pot", "intermittent"): (Signal.POT, Mode.FLICKERING),
    ("steering_motor", "off"): (Signal.STEER_DUTY, Mode.FIXED),
    ("steering_motor", "wrong"): (Signal.STEER_DUTY, Mode.SCALED),
    ("steering_motor", "slow"): (Signal.STEER_DUTY, Mode.SCALED),
    ("steering_motor", "intermittent"): (Signal.STEER_DUTY, Mode.FLICKERING),
    ("steering_bridge", "off"): (Signal.STEER_DUTY, Mode.FIXED),
    ("steering_bridge", "stuck"): (Signal.STEER_DUTY, Mode.HELD),
    ("steering_bridge", "garbage"): (Signal.STEER_DUTY, Mode.NOISY),
    ("steering_bridge", "wrong"): (Signal.STEER_DUTY, Mode.SCALED),
    ("steering_bridge", "slow"): (Signal.STEER_DUTY, Mode.SCALED),
    ("steering_bridge", "delayed"): (Signal.STEER_DUTY, Mode.LATE),
    ("steering_bridge", "intermittent"): (Signal.STEER_DUTY, Mode.FLICKERING),
    ("drive_motor", "off"): (Signal.DRIVE_DUTY, Mode.FIXED),
    ("drive_motor", "wrong"): (Signal.DRIVE_DUTY, Mode.SCALED),
    ("drive_motor", "slow"): (Signal.DRIVE_DUTY, Mode.SCALED),
    ("drive_motor", "intermittent"): (Signal.DRIVE_DUTY, Mode.FLICKERING),
    ("blade_relay", "off"): (Signal.BLADE, Mode.FIXED),
    ("blade_relay", "stuck"): (Signal.BLADE, Mode.HELD),
    ("blade_relay", "delayed"): (Signal.BLADE, Mode.LATE),
    ("blade_relay", "intermittent"): (Signal.BLADE, Mode.FLICKERING),
    ("battery", "stuck"): (Signal.BATTERY_SENSE, Mode.HELD),
    ("battery", "garbage"): (Signal.BATTERY_SENSE, Mode.NOISY),
    ("battery", "wrong"): (Signal.BATTERY_SENSE, Mode.FIXED),
    ("hall", "off"): (Signal.HALL, Mode.FIXED),
    ("hall", "stuck"): (Signal.HALL, Mode.HELD),
    ("hall", "garbage"): (Signal.HALL, Mode.NOISY),
    ("hall", "intermittent"): (Signal.HALL, Mode.FLICKERING),
    ("estop", "off"): (Signal.ESTOP, Mode.FIXED),
    ("estop", "stuck"): (Signal.ESTOP, Mode.FIXED),
    ("estop", "intermittent"): (Signal.ESTOP, Mode.FLICKERING),
}


_COUNT_MV: Final = 5000.0 / 1023.0
"""A step of the board's converter."""


_NOISE: Final = {
    Signal.POT: (0.0, 5000.0),
    Signal.BATTERY_SENSE: (0.0, 5000.0),
    Signal.STEER_DUTY: (-1.0, 1.0),
    Signal.HALL: (0.0, 1.0),
}


_WIRE_VALUES: Final[dict[tuple[str, str], float]] = {
    ("pot", "intermittent"): 5000.0,
    ("steering_motor", "wrong"): -1.0,
    ("steering_bridge", "wrong"): -1.0,
    ("drive_motor", "wrong"): -1.0,
    ("estop", "off"): ESTOP_OPEN_MV,
    ("estop", "stuck"): 0.0,
    ("estop", "intermittent"): ESTOP_OPEN_MV,
}


_SCALE: Final[dict[tuple[str, str], float]] = {
    ("pot", "off"): 1000.0,
    ("pot", "wrong"): _COUNT_MV,
    ("battery", "wrong"): 250.0,
}
"""From a fault's `value` to its wire's unit."""


@dataclass(frozen=True, slots=True)
class Event:
    """A fault began or ended, at `stamp`."""

    stamp: float
    index: int
    """Into the scenario's faults."""
    begins: bool


class Line:
    """One direction of the serial cable."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._late: deque[tuple[float, bytes]] = deque()
        self._backlog = bytearray()
        self._credit = 0.0
        self._past: float | None = None

    def carry(self, now: float, data: bytes, faults: list[Fault]) -> bytes:
        """What comes out at `now` when `data` goes in. Time must not run backwards."""
        delay = 0.0
        rate = math.inf
        for fault in faults:
            match fault.failure:
                case "off":
                    data = b""
                case "garbage":
                    data = self._flip(data, fault.amount)
                case "wrong":
                    if self._rng.random() < 0.1:
                        data += self._rng.bytes(round(fault.amount))
                case "intermittent":
                    if self._rng.random() < fault.amount:
                        data = b""
                case "slow":
                    rate = fault.amount
                case "delayed":
                    delay += fault.amount
        if data:
            self._late.append((now + delay - 1e-9, data))
        while self._late and self._late[0][0] <= now:
            self._backlog += self._late.popleft()[1]
        step = 0.0 if self._past is None else now - self._past
        self._past = now
        if math.isinf(rate):
            count, self._credit = len(self._backlog), 0.0
        else:
            self._credit += rate * step
            count = min(len(self._backlog), int(self._credit))
            self._credit = min(self._credit - count, rate * 0.01 + 1)
        out = bytes(self._backlog[:count])
        del self._backlog[:count]
        return out

    def _flip(self, data: bytes, share: float) -> bytes:
        out = bytearray(data)
        for k in np.flatnonzero(self._rng.random(len(out)) < share):
            out[k] ^= 1 << int(self._rng.integers(8))
        return bytes(out)


Picture = tuple[float, bytes]
"""(time of the shutter as the host believes it, JPEG file)."""


def spoiled(jpeg: bytes, kind: str) -> bytes:
    """A picture that is black, overexposed, or shows the leaf that covers the lens."""
    bgr = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    out: NDArray[Any]
    match kind:
        case "black":
            out = np.zeros_like(bgr)
        case "overexposed":
            out = cv2.convertScaleAbs(bgr, alpha=3.0, beta=120.0)
        case "covered":
            out = cv2.convertScaleAbs(cv2.blur(bgr, (151, 151)), alpha=0.25, beta=8.0)
        case _:
            raise ValueError(f"no picture is known that is {kind}")
    return cv2.imencode(".jpg", out)[1].tobytes()


class Injector:
    """Makes a scenario's faults happen. Deterministic by (faults, seed)."""

    def __init__(self, faults: tuple[Fault, ...], seed: int) -> None:
        self.faults = faults
        self.taps = signal_wires.honest()
        """For the inner loop."""
        self.events: list[Event] = []
        self.phase: str | None = None
        """The pilot's state, where the bench can see it;"""
        self.doing: Doing | None = None
        """and which of its behaviours."""
        self.host_restarts = 0
        self._rng = [np.random.default_rng([seed, 0xFA17, k]) for k in range(len(faults))]
        self._seed = seed
        self._since: list[float | None] = [None] * len(faults)
        self._begun: list[float | None] = [None] * len(faults)
        self._ended = [False] * len(faults)
        self._to_firmware = Line(np.random.default_rng([seed, 0xFA18]))
        self._to_host = Line(np.random.default_rng([seed, 0xFA19]))
        self._pictures: deque[tuple[float, Picture]] = deque()
        self._frozen_jpeg: bytes | None = None
        self._picture_at = -math.inf
        self._sentences: deque[tuple[float, list[str]]] = deque()
        self._frozen_antenna: tuple[float, float, float, float] | None = None
        self._epoch_at = -math.inf
        self._felt_samples: deque[tuple[float, Sample]] = deque()
        self._frozen_rate: tuple[float, float, float] | None = None
        self._answered_at = -math.inf
        self._host_at = -math.inf
        self._outages: dict[int, tuple[float, bool]] = {}
        self._reset_at: dict[int, float] = {}

    # ---- time ------------------------------------------------------------------------------------

    def begins_before(self, until: float) -> bool:
        """Whether the first fault, not begun yet, begins before `until` by what has happened so
        far."""
        since = self._since[0]
        return since is not None and since + self.faults[0].at.after_s < until - 1e-9

    def replace(self, faults: tuple[Fault, ...]) -> None:
        """Other faults instead, which begin when these would have; before any has."""
        if self.events or [fault.at for fault in faults] != [fault.at for fault in self.faults]:
            raise ValueError("only faults that have not begun, by others that begin alike")
        self.faults = faults

    def add(self, fault: Fault) -> None:
        """One fault more, while it runs."""
        self._rng.append(np.random.default_rng([self._seed, 0xFA17, len(self.faults)]))
        self.faults = (*self.faults, fault)
        self._since.append(None)
        self._begun.append(None)
        self._ended.append(False)

    @property
    def active(self) -> list[Fault]:
        """What is broken now."""
        begun = zip(self.faults, self._begun, self._ended, strict=True)
        return [fault for fault, since, ended in begun if since is not None and not ended]

    def end_all(self, now: float) -> None:
        """All that has begun is over, and what has not begun never does."""
        for index, fault in enumerate(self.faults):
            if self._begun[index] is not None and not self._ended[index]:
                self.events.append(Event(now, index, False))
                self._end(fault)
            self._begun[index] = now if self._begun[index] is None else self._begun[index]
            self._ended[index] = True

    def step(
        self,
        now: float,
        pose: tuple[float, float, float],
        speed_mps: float,
        target: Controller,
        given: Any,
    ) -> None:
        """Before each slice: begins and ends faults, and does to the target and to the plant's
        inputs (a (1,) machine.INPUTS record) what the active ones do."""
        if not self.faults:
            return
        for index, fault in enumerate(self.faults):
            begun = self._begun[index]
            if begun is None:
                if self._due(index, fault.at, now, pose, speed_mps):
                    self._begun[index] = now
                    self.events.append(Event(now, index, True))
                    self._begin(index, fault, target)
            elif self._ended[index] or fault.for_s is None:
                continue
            elif now - begun >= fault.for_s - 1e-9:
                self._ended[index] = True
                self.events.append(Event(now, index, False))
                self._end(fault)
        given[0]["steer_jam"] = int(self._has("steering_motor", "stuck"))
        given[0]["load_n"] = BLOCKED_N if self._has("drive_motor", "stuck") else 0.0
        self._power(now, target)

    def _due(
        self, index: int, at: At, now: float, pose: tuple[float, float, float], speed_mps: float
    ) -> bool:
        way = {"forward": 1.0, "backward": -1.0, None: 0.0}[at.moving]
        moves = not way or way * speed_mps >= MOVING_MPS
        if not moves:
            self._since[index] = None
        elif self._since[index] is None:
            if at.time_s is not None:
                here = now >= at.time_s - 1e-9
            elif at.state is not None:
                here = self.phase == at.state
            elif at.doing is not None:
                here = self.doing is at.doing
            else:
                assert at.place is not None
                away = math.hypot(pose[0] - at.place.x_m, pose[1] - at.place.y_m)
                here = away <= at.place.radius_m
            if not here:
                return False
            self._since[index] = now
        since = self._since[index]
        return since is not None and now - since >= at.after_s - 1e-9

    def _begin(self, index: int, fault: Fault, target: Controller) -> None:
        key = (fault.component, fault.failure)
        wire = _WIRES.get(key)
        if wire is not None:
            signal, mode = wire
            tap = self.taps[signal]
            value = fault.amount * _SCALE.get(key, 1.0)
            if fault.pair.value is None:
                value = _WIRE_VALUES.get(key, 0.0)
            low = 0.0
            if mode is Mode.NOISY:
                low, value = _NOISE[signal]
            tap["mode"], tap["value"], tap["low"] = mode, value, low
            tap["seed"], tap["shown_us"] = self._seed + index, signal_wires.NEVER
        elif fault.component == "firmware":
            if fault.failure == "stuck":
                target.hang()
            else:
                target.reset(ResetCause.EXTERNAL)
                self._reset_at[index] = self._begun[index] or 0.0
        elif fault.component == "host":
            self._host_at = -math.inf

    def _end(self, fault: Fault) -> None:
        wire = _WIRES.get((fault.component, fault.failure))
        if wire is not None:
            self.taps[wire[0]]["mode"] = Mode.HONEST
        if fault.component == "host" and fault.failure == "off":
            self.host_restarts += 1

    def _power(self, now: float, target: Controller) -> None:
        """Without power the controller is in reset and nothing turns."""
        dark = False
        for index, fault in self._active("battery"):
            if fault.failure == "off":
                dark = True
            elif fault.failure == "intermittent":
                dark = dark or self._out(index, now)
        if dark:
            target.reset(ResetCause.BROWN_OUT)
        for index, fault in self._active("firmware"):
            if fault.failure == "intermittent" and now - self._reset_at[index] >= fault.amount:
                self._reset_at[index] = now
                target.reset(ResetCause.EXTERNAL)

    def _active(self, component: Component) -> list[tuple[int, Fault]]:
        return [
            (k, fault)
            for k, fault in enumerate(self.faults)
            if fault.component == component and self._begun[k] is not None and not self._ended[k]
        ]

    def _has(self, component: Component, failure: Failure) -> bool:
        return any(fault.failure == failure for _, fault in self._active(component))

    def _out(self, index: int, now: float) -> bool:
        """Whether an intermittent thing is gone now: first gone, then there and gone by chance."""
        until, gone = self._outages.get(index, (-math.inf, False))
        if now >= until:
            until = now + float(self._rng[index].uniform(0.3, 1.7)) * OUTAGE_S
            gone = not gone
            self._outages[index] = (until, gone)
        return gone

    def shown_at(self, index: int) -> float | None:
        """When a fault first made a difference; None while it has not."""
        fault = self.faults[index]
        begun = self._begun[index]
        if begun is None:
            return None
        wire = _WIRES.get((fault.component, fault.failure))
        if wire is not None:
            shown = int(self.taps[wire[0]]["shown_us"])
            return None if shown < 0 else shown / 1e6
        return begun

    # ---- serial bytes ----------------------------------------------------------------------------

    def to_firmware(self, now: float, data: bytes) -> bytes:
        """What reaches the firmware's UART at `now` when the host sends `data`; to be called in
        every slice, with nothing to send as well."""
        if not self.faults:
            return data
        return self._to_firmware.carry(now, data, [f for _, f in self._active("serial")])

    def to_host(self, now: float, data: bytes) -> bytes:
        """The other direction."""
        if not self.faults:
            return data
        return self._to_host.carry(now, data, [f for _, f in self._active("serial")])

    # ---- the phone -------------------------------------------------------------------------------

    def camera(self, now: float, picture: Picture | None) -> Picture | None:
        """What the host gets at `now` when `picture` is due; to be called at every step of the
        host. A picture that comes late is believed to be as old as ever."""
        if not self.faults:
            return picture
        delay = 0.0
        for index, fault in [*self._active("phone"), *self._active("camera")]:
            match fault.failure:
                case "off":
                    picture = None
                case "intermittent":
                    if self._out(index, now):
                        picture = None
                case "delayed":
                    delay += fault.amount
                case _ if picture is not None:
                    picture = self._spoil(now, picture, index)
        if picture is not None:
            self._pictures.append((now + delay, (picture[0] + delay, picture[1])))
        if not self._has("camera", "stuck"):
            self._frozen_jpeg = picture[1] if picture is not None else self._frozen_jpeg
        out = None
        while self._pictures and self._pictures[0][0] <= now + 1e-9:
            out = self._pictures.popleft()[1]
        return out

    def _spoil(self, now: float, picture: Picture, index: int) -> Picture | None:
        stamp, jpeg = picture
        fault, rng = self.faults[index], self._rng[index]
        match fault.failure:
            case "stuck":
                return stamp, self._frozen_jpeg or jpeg
            case "wrong":
                return stamp, spoiled(jpeg, fault.kind)
            case "garbage":
                data = np.frombuffer(jpeg, np.uint8).copy()
                at = rng.integers(len(data), size=max(1, round(fault.amount * len(data))))
                data[at] = rng.integers(256, size=len(at))
                return stamp, data.tobytes()
            case "slow":
                if now - self._picture_at < fault.amount - 1e-9:
                    return None
                self._picture_at = now
        return picture

    def gyro(self, now: float, samples: list[Sample]) -> list[Sample]:
        """What the phone's app has of the gyroscope at `now`, when these are new; to be called at
        every step of the host."""
        if not self.faults:
            return samples
        delay, silent = 0.0, False
        for index, fault in [*self._active("phone"), *self._active("gyro")]:
            match fault.failure:
                case "off":
                    samples = []
                case "intermittent":
                    samples = [] if self._out(index, now) else samples
                case "delayed":
                    delay += fault.amount
                case "slow":
                    silent = now - self._answered_at < fault.amount - 1e-9
                case _:
                    samples = [self._felt(sample, index) for sample in samples]
        if not self._has("gyro", "stuck") and samples:
            self._frozen_rate = samples[-1].rate_radps
        self._felt_samples += [(now + delay, sample) for sample in samples]
        out: list[Sample] = []
        while not silent and self._felt_samples and self._felt_samples[0][0] <= now + 1e-9:
            out.append(self._felt_samples.popleft()[1])
        if out:
            self._answered_at = now
        return out

    def _felt(self, sample: Sample, index: int) -> Sample:
        fault, rng = self.faults[index], self._rng[index]
        x, y, z = sample.rate_radps
        match fault.failure:
            case "stuck":
                x, y, z = self._frozen_rate or sample.rate_radps
            case "wrong":
                more = math.radians(fault.amount)
                x, y, z = x + more, y + more, z + more
            case "garbage" if rng.random() < fault.amount:
                x, y, z = rng.uniform(-RANGE_RADPS, RANGE_RADPS, 3).tolist()
        return sample._replace(rate_radps=(x, y, z))

    def antenna(
        self, now: float, x: float, y: float, vx: float, vy: float
    ) -> tuple[float, float, float, float]:
        """Where the receiver believes to be, before its own errors."""
        for index, fault in self._active("gnss"):
            begun = self._begun[index] or 0.0
            if fault.failure == "stuck":
                return self._frozen_antenna or (x, y, vx, vy)
            if fault.failure == "wrong":
                x += fault.amount * (1.0 if fault.kind == "jump" else (now - begun) / 60)
        self._frozen_antenna = (x, y, vx, vy)
        return x, y, vx, vy

    def nmea(self, now: float, lines: list[str]) -> list[str]:
        """What the host gets of an epoch's sentences."""
        if not self.faults:
            return lines
        delay = 0.0
        for index, fault in [*self._active("phone"), *self._active("gnss")]:
            match fault.failure:
                case "off":
                    lines = []
                case "intermittent":
                    if self._out(index, now):
                        lines = []
                case "garbage":
                    lines = [self._mistype(line, index) for line in lines]
                case "slow":
                    if now - self._epoch_at < fault.amount - 1e-9:
                        lines = []
                    else:
                        self._epoch_at = now
                case "delayed":
                    delay += fault.amount
        self._sentences.append((now + delay, lines))
        out: list[str] = []
        while self._sentences and self._sentences[0][0] <= now + 1e-9:
            out += self._sentences.popleft()[1]
        return out

    def _mistype(self, line: str, index: int) -> str:
        letters, rng = list(line), self._rng[index]
        for k in np.flatnonzero(rng.random(len(letters)) < self.faults[index].amount):
            letters[k] = chr(int(rng.integers(32, 127)))
        return "".join(letters)

    # ---- the host --------------------------------------------------------------------------------

    def host_runs(self, now: float) -> bool:
        """Whether the host gets to make a step at `now`."""
        if not self.faults:
            return True
        pause = 0.0
        for _, fault in self._active("host"):
            if fault.failure in ("off", "stuck"):
                return False
            pause = max(pause, fault.amount)
        if now - self._host_at < pause - 1e-9:
            return False
        self._host_at = now
        return True
