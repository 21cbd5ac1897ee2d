"""The compiled inner loop of every bench: firmware and machine in turn, a millisecond at a time.

It reads the pins that the firmware drives, moves the machine, sets the voltages that the firmware
will read, and lets the firmware run that millisecond. Pins as in firmware/src/pins.h.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numba
import numpy as np
from numba import njit

from hil.firmware import signal_wires
from hil.firmware.signal_wires import Signal, tap
from hil.firmware.targets import Target
from sim_plant import machine

PHYSICS_US: Final = 1000
LOG_US: Final = 5000
"""Period of the log's rows: the firmware's tick."""

ESTOP: Final = 2
BLADE: Final = 6
HALL: Final = 12
STEER_PWM: Final = 9
STEER_PWM_RIGHT: Final = 10
STEER_IN: Final = (7, 8)
DRIVE_PWM: Final = 3
DRIVE_PWM_BACK: Final = 11
DRIVE_IN: Final = (4, 5)

LOG: Final = np.dtype(
    [
        ("steer_angle", np.float64),  # of the wheel, truly, rad
        ("steer_duty", np.float64),  # -1..1
        ("steer_a", np.float64),  # A
        ("battery_v", np.float64),
    ],
    align=True,
)
"""One row per LOG_US since the target's creation; row i is the state at (i + 1) * LOG_US."""

NO_LOG: Final = np.zeros(0, LOG)

POT: Final = int(Signal.POT)
BATTERY_SENSE: Final = int(Signal.BATTERY_SENSE)
STEER_SENSE: Final = int(Signal.STEER_SENSE)
DRIVE_SENSE: Final = int(Signal.DRIVE_SENSE)
STEER_DUTY: Final = int(Signal.STEER_DUTY)
DRIVE_DUTY: Final = int(Signal.DRIVE_DUTY)
BLADE_WIRE: Final = int(Signal.BLADE)
HALL_WIRE: Final = int(Signal.HALL)
ESTOP_WIRE: Final = int(Signal.ESTOP)


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
    second_duty: float = pwm(handle, second) / 255.0
    return duty - second_duty


@njit(cache=True, nogil=True)
def _shorted(pwm: Any, pin: Any, handle: int, enable: int, in1: int, in2: int) -> int:
    """Whether an L298N's inputs short its motor: both high, and enabled."""
    both = pin(handle, in1) != 0 and pin(handle, in2) != 0
    return 1 if both and pwm(handle, enable) > 0 else 0


@njit(cache=True, nogil=True)
def _millivolt(volts_mv: float) -> int:
    return int(min(5000.0, max(0.0, volts_mv)) + 0.5)


@njit(cache=True, nogil=True)
def _sensed(now: int, state: Any, wires: Any) -> tuple[int, int, int, int, int, int]:
    """What arrives at the board: pot, battery, steering and drive current in mV, then the hall
    sensor's and the e-stop's level."""
    s = state[0]
    return (
        _millivolt(tap(wires, POT, s.pot_mv, now)),
        _millivolt(tap(wires, BATTERY_SENSE, s.battery_sense_mv, now)),
        _millivolt(tap(wires, STEER_SENSE, s.steer_sense_mv, now)),
        _millivolt(tap(wires, DRIVE_SENSE, s.drive_sense_mv, now)),
        round(tap(wires, HALL_WIRE, float(s.hall), now)),
        round(tap(wires, ESTOP_WIRE, 0.0, now)),
    )


@njit(cache=True, nogil=True)
def _move(
    steer: float,
    drive: float,
    blade: float,
    now: int,
    state: Any,
    params: Any,
    given: Any,
    wires: Any,
) -> None:
    """The machine, for one PHYSICS_US up to `now`, at what the firmware drives."""
    given[0].steer_duty = tap(wires, STEER_DUTY, steer, now)
    given[0].drive_duty = tap(wires, DRIVE_DUTY, drive, now)
    given[0].blade_on = round(tap(wires, BLADE_WIRE, blade, now))
    machine.step(state, params, given, PHYSICS_US * 1e-6)


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
    wires: Any,
    log: Any,
) -> int:
    """Machine and firmware from begin_us to end_us. Returns the target's status."""
    now = begin_us
    while now < end_us:
        now += PHYSICS_US
        steer = _bridge(pwm, pin, handle, STEER_PWM, STEER_PWM_RIGHT, STEER_IN[0], STEER_IN[1])
        drive = _bridge(pwm, pin, handle, DRIVE_PWM, DRIVE_PWM_BACK, DRIVE_IN[0], DRIVE_IN[1])
        given[0].drive_brake = _shorted(pwm, pin, handle, DRIVE_PWM, DRIVE_IN[0], DRIVE_IN[1])
        _move(steer, drive, float(pin(handle, BLADE)), now, state, params, given, wires)
        pot, battery, steer_sense, drive_sense, hall, estop = _sensed(now, state, wires)
        set_analog(handle, 0, pot)
        set_analog(handle, 1, battery)
        set_analog(handle, 2, steer_sense)
        set_analog(handle, 3, drive_sense)
        set_pin(handle, HALL, hall)
        set_pin(handle, ESTOP, estop)
        status: int = run_until(handle, now)
        if status != 0:
            return status
        row = now // LOG_US - 1
        if now % LOG_US == 0 and row < len(log):
            log[row].steer_angle = state[0].steer_angle
            log[row].steer_duty = given[0].steer_duty
            log[row].steer_a = state[0].steer_a
            log[row].battery_v = state[0].battery_v
    return 0


@njit(cache=True, nogil=True)
def _apart(
    begin_us: int,
    end_us: int,
    outputs: Any,
    sensors: Any,
    state: Any,
    params: Any,
    given: Any,
    wires: Any,
) -> None:
    """The machine alone from begin_us to end_us, for a firmware that is told of it now and then."""
    now = begin_us
    while now < end_us:
        now += PHYSICS_US
        _move(outputs[0], outputs[1], outputs[2], now, state, params, given, wires)
        pot, battery, steer_sense, drive_sense, hall, estop = _sensed(now, state, wires)
        sensors[0], sensors[1] = pot, battery
        sensors[2], sensors[3] = steer_sense, drive_sense
        sensors[4] = estop
        sensors[5] += hall > sensors[6]
        sensors[6] = hall


SENSORS: Final = 7
"""Of `_apart`: pot, battery, steering current, drive current (mV), e-stop pin; pulses of the hall
sensor since the start, and its pin."""


def bind_apart(
    outputs: np.ndarray[Any, Any],
    sensors: np.ndarray[Any, Any],
    state: machine.Record,
    params: machine.Record,
    given: machine.Record,
    wires: machine.Record,
) -> Callable[[int, int], None]:
    """The machine without firmware: `run(begin_us, end_us)` moves it at `outputs` (steering and
    drive duty -1..1, blade; float64) and leaves what its sensors give in `sensors` (int64)."""
    records = (outputs, sensors, state, params, given, wires)
    entry = _entry_point(_apart, (0, 0, *records))

    def run(begin_us: int, end_us: int) -> None:
        entry(begin_us, end_us, *records)

    return run


def bind(
    target: Target,
    state: machine.Record,
    params: machine.Record,
    given: machine.Record,
    log: machine.Record = NO_LOG,
    wires: machine.Record | None = None,
) -> Callable[[int, int], int]:
    """The loop for these (1,) records: `run(begin_us, end_us)` returns the target's status.
    `wires`: the taps of every signal (hil/wires.py), honest ones where none are given.

    Numba's dispatcher would work out the records' types at every call, which costs more than ten
    simulated milliseconds; the compiled entry point is called directly.
    """
    f = target.pointers
    functions = (f.run_until, f.set_analog_mv, f.set_pin, f.pin, f.pwm)
    handle = target.handle
    records = (state, params, given, signal_wires.honest() if wires is None else wires, log)
    entry = _entry_point(_run, (*functions, handle, 0, 0, *records))

    def run(begin_us: int, end_us: int) -> int:
        return int(entry(*functions, handle, begin_us, end_us, *records))

    return run


_compiled: dict[Any, Any] = {}
"""A loop's compiled code, once there: the arguments' types are always the same."""


def _entry_point(dispatcher: Any, arguments: tuple[Any, ...]) -> Any:
    if dispatcher not in _compiled:
        dispatcher(*arguments)
        types = tuple(numba.typeof(value) for value in arguments)  # type: ignore[no-untyped-call]
        _compiled[dispatcher] = dispatcher.overloads[types].entry_point
    return _compiled[dispatcher]
