"""A machine on free ground and its camera, in lockstep and in a few lines: what an experiment of
the host's tells them, and what they tell it. Neither firmware nor field."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.messages import State, Telemetry
from host.link import protocol
from host.link.session import Session
from host.sensors.camera_stream import Picture

Bgr = NDArray[np.uint8]

STEP_S = 0.01
TELEMETRY_STEPS = 2
WIDTH, HEIGHT, FOCAL = 640, 480, 530.0
SLEW_RADPS = math.radians(50.0)
RESTING = Telemetry(
    stamp=0.0,
    state=State.SAFE,
    faults=0,
    setpoint_rad=0.0,
    angle_rad=0.0,
    steer_duty=0,
    drive_duty=0,
    blade=False,
    speed_mps=0.0,
    distance_m=0.0,
    battery_v=12.0,
    last_seq=0,
    frames_bad=0,
)


class YardMachine:
    """A wire: obeys at once, but that the wheel takes its time."""

    def __init__(self, *, pulse_m: float = 0.02, wheelbase_m: float = 1.0) -> None:
        self.session = Session()
        self.now = 0.0
        self.yaw = self.way = self.angle = 0.0
        self.state = State.SAFE
        self.faults = protocol.Fault(0)
        self.fault_at_s = self.mute_at_s = math.inf
        """When it switches itself off; when it falls silent."""
        self.steers = True
        self.heard: list[protocol.Message] = []
        self._pulse_m, self._wheelbase_m = pulse_m, wheelbase_m
        self._drive = protocol.Drive(0.0, 0.0, 0)
        self._steps = 0

    def request(self, message: protocol.Message) -> None:
        """Takes a message."""
        self.heard.append(message)
        match message:
            case protocol.Arm() if self._drive.speed != 0:
                self.session.refusal = "Arm refused: the last command asks for motion"
            case protocol.Arm():
                self.state = State.ARMED
            case protocol.Stop():
                self.state = State.SAFE
            case protocol.Drive():
                self._drive = message

    def poll(self) -> list[Telemetry]:
        """A hundredth of a second, and what was sent in it."""
        self._steps += 1
        self.now = self._steps * STEP_S
        if self.now >= self.fault_at_s:
            self.state, self.faults = State.FAULT, protocol.Fault.DRIVE_OVERCURRENT
        driven = self.state in (State.ARMED, State.RUNNING)
        speed = self._drive.speed if driven else 0.0
        turn = (self._drive.steer if self.steers else 0.0) - self.angle
        self.angle += max(-SLEW_RADPS * STEP_S, min(SLEW_RADPS * STEP_S, turn))
        self.way += speed * STEP_S
        self.yaw += speed * STEP_S * math.tan(self.angle) / self._wheelbase_m
        if self._steps % TELEMETRY_STEPS or self.now >= self.mute_at_s:
            return []
        pulses = math.floor(self.way / self._pulse_m + 1e-9)
        told = replace(
            RESTING,
            stamp=self.now,
            state=self.state,
            faults=int(self.faults),
            angle_rad=self.angle,
            drive_duty=round(255 * speed),
            speed_mps=speed,
            distance_m=pulses * self._pulse_m,
        )
        self.session.telemetry = told
        return [told]

    @property
    def driven(self) -> bool:
        """Whether it was ever told to move."""
        return any(isinstance(m, protocol.Drive) and (m.speed or m.steer) for m in self.heard)


def far_scene(width_px: int) -> Bgr:
    """Spots of all colours."""
    wide = np.random.default_rng(1).integers(0, 255, (HEIGHT, width_px, 3)).astype(np.uint8)
    soft = cv2.GaussianBlur(wide, (0, 0), 6)
    return cv2.normalize(soft, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


class YardLens:
    """Its camera: a wide, far scene, of which it sees the part ahead, with the sensor's noise."""

    def __init__(
        self,
        machine: YardMachine,
        delay_s: float = 0.1,
        fps: float = 10.0,
        develop: Callable[[Bgr], Bgr] = lambda bgr: bgr,
    ) -> None:
        """`develop`: what becomes of a picture."""
        self._scene = far_scene(3 * WIDTH)
        self._rng = np.random.default_rng(2)
        self._machine, self._delay_s, self._fps, self._develop = machine, delay_s, fps, develop
        self._next = 0.0
        self._due: deque[Picture] = deque()
        self.ends_at_s = math.inf
        self.problem: str | None = None

    def take(self) -> Picture | None:
        """The newest picture since."""
        now = self._machine.now
        if now >= self.ends_at_s:
            self.problem = "silent for 3 s"
            return None
        if now >= self._next - 1e-9:
            self._next += 1 / self._fps
            left = WIDTH - round(FOCAL * self._machine.yaw)
            seen = self._scene[:, left : left + WIDTH].astype(np.int16)
            seen += self._rng.integers(-6, 7, seen.shape, np.int16)
            bgr = self._develop(np.clip(seen, 0, 255).astype(np.uint8))
            self._due.append(Picture(now + self._delay_s, None, bgr))
        newest = None
        while self._due and self._due[0].stamp <= now + 1e-9:
            newest = self._due.popleft()
        return newest
