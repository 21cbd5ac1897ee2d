"""The lockstep bench: firmware, machine, field and sensors under one clock.

The bench alone advances time. The inner loop is compiled: it reads the pins that the firmware
drives, moves the machine by a millisecond, sets the voltages that the firmware will read, and lets
the firmware run that millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from types import TracebackType
from typing import Any, Final, Self

import numba
from numba import njit

from hil import targets
from hil.scenario import Scenario
from host.errors import UserError
from sim_plant import machine
from sim_plant.camera import Camera, Shot
from sim_plant.field import Field
from sim_plant.gnss import Gnss

PHYSICS_US: Final = 1000
SLICE_US: Final = 10_000
"""Serial bytes are stamped to this."""
SLICES_PER_CUT: Final = 2

# Uno pins (firmware/src/pins.h).
ESTOP: Final = 2
BLADE: Final = 6
HALL: Final = 12
STEER_PWM: Final = 9
STEER_PWM_RIGHT: Final = 10
STEER_IN: Final = (7, 8)
DRIVE_PWM: Final = 3
DRIVE_PWM_BACK: Final = 11
DRIVE_IN: Final = (4, 5)


@njit(cache=True, nogil=True)
def _bridge(pwm: Any, pin: Any, handle: int, enable: int, second: int, in1: int, in2: int) -> float:
    """Signed duty -1..1 of a bridge. An L298N's direction pins decide; a BTS7960 leaves them low
    and drives its second PWM input instead."""
    duty: float = pwm(handle, enable) / 255.0
    forward = pin(handle, in1) != 0
    backward = pin(handle, in2) != 0
    if forward and backward:
        return 0.0
    if forward:
        return duty
    if backward:
        return -duty
    return duty - pwm(handle, second) / 255.0


@njit(cache=True, nogil=True)
def _run(
    run_until: Any,
    set_analog: Any,
    set_pin: Any,
    pin: Any,
    pwm: Any,
    handle: int,
    begin_us: int,
    end_us: int,
    state: Any,
    params: Any,
    given: Any,
) -> int:
    """Machine and firmware from begin_us to end_us. Returns the target's status."""
    dt = PHYSICS_US * 1e-6
    now = begin_us
    while now < end_us:
        now += PHYSICS_US
        given[0].steer_duty = _bridge(
            pwm, pin, handle, STEER_PWM, STEER_PWM_RIGHT, STEER_IN[0], STEER_IN[1]
        )
        given[0].drive_duty = _bridge(
            pwm, pin, handle, DRIVE_PWM, DRIVE_PWM_BACK, DRIVE_IN[0], DRIVE_IN[1]
        )
        given[0].blade_on = pin(handle, BLADE)
        machine.step(state, params, given, dt)
        set_analog(handle, 0, int(state[0].pot_mv + 0.5))
        set_analog(handle, 1, int(state[0].battery_sense_mv + 0.5))
        set_analog(handle, 2, int(state[0].steer_sense_mv + 0.5))
        set_analog(handle, 3, int(state[0].drive_sense_mv + 0.5))
        set_pin(handle, HALL, state[0].hall)
        status = run_until(handle, now)
        if status != 0:
            return status
    return 0


def _entry_point(arguments: tuple[Any, ...]) -> Any:
    """_run's compiled code for the types of these arguments."""
    compiled: Any = _run
    compiled(*arguments)
    types = tuple(numba.typeof(value) for value in arguments)  # type: ignore[no-untyped-call]
    return compiled.overloads[types].entry_point


class Bench:
    """One machine on one field with its firmware; time in seconds from 0."""

    def __init__(self, scenario: Scenario, *, camera_threads: int = 1) -> None:
        self.scenario = scenario
        spec = scenario.machine_truth
        seed = scenario.seed
        self.field = Field(scenario.field, seed)
        self.camera = Camera(
            self.field, scenario.lens_truth, scenario.weather, seed, threads=camera_threads
        )
        self.gnss = Gnss(scenario.gnss, seed)
        self.cut_cells = 0
        """Crop cells cut during the last `advance`."""
        self._spec = spec
        self._state = machine.initial(spec, *scenario.start_pose())
        self._params = machine.parameters(spec, seed)
        self._given = machine.inputs()
        self._slices = 0
        self.target = targets.avr() if scenario.firmware == "avr" else targets.desk()
        self.target.set_pin(ESTOP, False)
        self._inner = self._bind()

    def _bind(self) -> Callable[[int, int], int]:
        """The compiled inner loop for this bench's arrays. Numba's dispatcher would work out the
        records' types at every call, which costs more than the call's ten milliseconds of time."""
        f = self.target.pointers
        functions = (f.run_until, f.set_analog_mv, f.set_pin, f.pin, f.pwm)
        records = (self._state, self._params, self._given)
        first = (*functions, self.target.handle, 0, 0, *records)
        entry = _entry_point(first)
        handle = self.target.handle

        def inner(begin_us: int, end_us: int) -> int:
            return int(entry(*functions, handle, begin_us, end_us, *records))

        return inner

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return self._slices * SLICE_US * 1e-6

    @property
    def state(self) -> Any:
        """The machine's true state: a record of sim_plant.machine.STATE."""
        return self._state[0]

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, truly."""
        s = self._state[0]
        return float(s["x"]), float(s["y"]), float(s["yaw"])

    def advance(self, until_s: float) -> list[tuple[float, bytes]]:
        """Runs to `until_s`; returns what the firmware sent, with the time of arrival."""
        received: list[tuple[float, bytes]] = []
        target = self.target
        self.cut_cells = 0
        last = round(until_s * 1e6) // SLICE_US
        while self._slices < last:
            if self._slices % SLICES_PER_CUT == 0:
                self._ground()
            begin = self._slices * SLICE_US
            status = self._inner(begin, begin + SLICE_US)
            if status != 0:
                raise UserError(
                    f"the {self.scenario.firmware} firmware crashed at {begin / 1e6:.2f} s "
                    f"(status {status}); the record up to then is kept"
                )
            self._slices += 1
            data = target.read()
            if data:
                received.append((self.now, data))
            if self._slices % SLICES_PER_CUT == 0:
                self._cut()
        return received

    def _ground(self) -> None:
        roll, pitch = self.field.slopes(*self.pose)
        self._given[0]["roll"], self._given[0]["pitch"] = roll, pitch
        self._before = self.pose

    def _cut(self) -> None:
        cut = 0
        if self.state["blade_spinning"]:
            spec = self._spec
            cut = self.field.cut(
                self._before, self.pose, ahead_m=spec.blade_x_m, width_m=spec.blade_width_m
            )
            self.cut_cells += cut
        step = max(1e-6, abs(float(self.state["v"])) * SLICE_US * 1e-6 * SLICES_PER_CUT)
        full = self._spec.blade_width_m * step / self.field.cell**2
        self._given[0]["cutting"] = min(1.0, cut / full)

    def shutter(self) -> Shot:
        """Freezes what the camera sees now; `camera.develop` makes the picture, in any thread."""
        s = self.state
        x, y, yaw = self.pose
        roll, pitch = self.field.slopes(x, y, yaw)
        return self.camera.shutter(
            self.now,
            x,
            y,
            yaw,
            roll,
            pitch,
            float(s["v"]),
            float(s["yaw_rate"]),
            bool(s["blade_spinning"]),
        )

    def fix(self) -> list[str]:
        """NMEA sentences of this epoch."""
        s = self.state
        x, y, yaw = self.pose
        course = yaw + float(s["slip_rear"])
        v = float(s["v"])
        return self.gnss.epoch(self.now, x, y, v * math.cos(course), v * math.sin(course))

    def close(self) -> None:
        """Ends the target."""
        self.target.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
