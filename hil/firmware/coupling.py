"""The compiled inner loop of every bench: firmware and machine in turn, a millisecond at a time.

It reads the pins that the firmware drives, moves the machine, sets the voltages that the firmware
will read, and lets the firmware run that millisecond. What a pin is wired to says hil/firmware/
wiring.py.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, Final

import numba
import numpy as np
from numba import njit, types
from numba.core.typing import ctypes_utils
from numba.extending import typeof_impl

from hil.firmware import signal_wires, wiring
from hil.firmware.signal_wires import Mode, Signal, tap
from hil.firmware.targets import Target
from sim_plant import machine

PHYSICS_US: Final = 1000
"""The plant's step; currents within it are solved exactly."""
LOG_US: Final = 5000
"""Period of the log's rows: the firmware's tick."""

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
"""For whoever needs none."""

POT: Final = int(Signal.POT)
BATTERY_SENSE: Final = int(Signal.BATTERY_SENSE)
STEER_SENSE: Final = int(Signal.STEER_SENSE)
DRIVE_SENSE: Final = int(Signal.DRIVE_SENSE)
STEER_DUTY: Final = int(Signal.STEER_DUTY)
DRIVE_DUTY: Final = int(Signal.DRIVE_DUTY)
BLADE_WIRE: Final = int(Signal.BLADE)
HALL_WIRE: Final = int(Signal.HALL)
ESTOP_WIRE: Final = int(Signal.ESTOP)
HALL_B_WIRE: Final = int(Signal.HALL_B)
BLADE_TURN_WIRE: Final = int(Signal.BLADE_TURN)
FIXED: Final = int(Mode.FIXED)
ESTOP_CLOSED_MV: Final = wiring.ESTOP_CLOSED_MV


class Native:
    """A function of a shared library for the compiled loop. Numba asks a ctypes pointer for its
    address at every call, which takes as long as three simulated milliseconds."""

    def __init__(self, function: Any) -> None:
        self.address = ctypes.cast(function, ctypes.c_void_p).value or 0
        self.signature = ctypes_utils.make_function_type(function).sig  # type: ignore[no-untyped-call]


def _address(native: Native) -> int:
    return native.address


@typeof_impl.register(Native)
def _type_of(native: Native, _: Any) -> Any:
    return types.ExternalFunctionPointer(native.signature, get_pointer=_address)


@njit(cache=True, nogil=True)
def _level(output: Any, handle: int, pin: int, loose: float) -> float:
    """Mean level 0..1 of a wire at an output pin; `loose` where the pin is an input."""
    duty = output(handle, pin)
    return duty / 255.0 if duty >= 0 else loose


@njit(cache=True, nogil=True)
def _bridge(
    output: Any, handle: int, loose: float, two_pwm: int, pwm: int, lpwm: int, in1: int, in2: int
) -> tuple[float, float, int]:
    """Signed duty -1..1 of a bridge, the share of the time for which it shorts its motor at no
    duty, and whether it drives one way only.

    A BTS7960 or L298N (its enables wired high) has one switch of each half closed at any time: the
    motor gets the difference of the halves and is shorted at no difference. A VNH5019 takes the
    direction from its inputs, shorts where these are both low and its PWM is high, and opens its
    low sides where that is low."""
    first = _level(output, handle, pwm, loose)
    if two_pwm:
        return first - _level(output, handle, lpwm, loose), 1.0, 0
    forward = _level(output, handle, in1, loose) > 0.5
    backward = _level(output, handle, in2, loose) > 0.5
    if forward == backward:
        return 0.0, first, 1
    return first if forward else -first, 0.0, 1


@njit(cache=True, nogil=True)
def _millivolt(volts_mv: float) -> int:
    return int(min(5000.0, max(0.0, volts_mv)) + 0.5)


@njit(cache=True, nogil=True)
def _sensed(now: int, state: Any, wires: Any) -> tuple[int, int, int, int, int, int, int, int]:
    """What arrives at the board: pot, battery, steering and drive current and the e-stop's loop in
    mV, then the levels of the two hall sensors and of the blade's."""
    s = state[0]
    return (
        _millivolt(tap(wires, POT, s.pot_mv, now)),
        _millivolt(tap(wires, BATTERY_SENSE, s.battery_sense_mv, now)),
        _millivolt(tap(wires, STEER_SENSE, s.steer_sense_mv, now)),
        _millivolt(tap(wires, DRIVE_SENSE, s.drive_sense_mv, now)),
        _millivolt(tap(wires, ESTOP_WIRE, ESTOP_CLOSED_MV, now)),
        round(tap(wires, HALL_WIRE, float(s.hall), now)),
        round(tap(wires, HALL_B_WIRE, float(s.hall_b), now)),
        round(tap(wires, BLADE_TURN_WIRE, float(s.blade_turn), now)),
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
    # Through an open wire no bridge brakes, be it open for a moment only.
    if wires[STEER_DUTY].mode == FIXED or given[0].steer_duty != steer:
        given[0].steer_brake = 0.0
    if wires[DRIVE_DUTY].mode == FIXED or given[0].drive_duty != drive:
        given[0].drive_brake = 0.0
    machine.step(state, params, given, PHYSICS_US * 1e-6)


@njit(cache=True, nogil=True)
def run(
    run_until: Any,
    set_analog: Any,
    set_pin: Any,
    output: Any,
    handle: int,
    begin_us: int,
    end_us: int,
    state: Any,
    params: Any,
    given: Any,
    wires: Any,
    log: Any,
    layout: Any,
) -> int:
    """Machine and firmware from begin_us to end_us. Returns the target's status."""
    w = layout[0]
    now = begin_us
    while now < end_us:
        now += PHYSICS_US
        steer, given[0].steer_brake, given[0].steer_one_way = _bridge(
            output, handle, w.loose, w.steer_two_pwm,
            w.steer_pwm, w.steer_lpwm, w.steer_in1, w.steer_in2,
        )  # fmt: skip
        drive, given[0].drive_brake, given[0].drive_one_way = _bridge(
            output, handle, w.loose, w.drive_two_pwm,
            w.drive_pwm, w.drive_lpwm, w.drive_in1, w.drive_in2,
        )  # fmt: skip
        relay = _level(output, handle, w.blade, w.loose) > 0.5
        blade = 1.0 if relay != (w.relay_low != 0) else 0.0
        _move(steer, drive, blade, now, state, params, given, wires)
        pot, battery, steer_sense, drive_sense, estop, hall, hall_b, turn = _sensed(
            now, state, wires
        )
        set_analog(handle, 0, pot)
        set_analog(handle, 1, battery)
        set_analog(handle, 2, steer_sense)
        set_analog(handle, 3, drive_sense)
        set_analog(handle, 4, estop)
        set_pin(handle, w.hall, hall)
        set_pin(handle, w.hall_b, hall_b)
        set_pin(handle, w.blade_turn, turn)
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
    layout: Any,
) -> None:
    """The machine alone from begin_us to end_us, for a firmware that is told of it now and then. Of
    its pins only the duties are known: a bridge with two duty wires shorts its motor at none, and a
    VNH5019 is taken to open."""
    now, w = begin_us, layout[0]
    while now < end_us:
        now += PHYSICS_US
        given[0].steer_brake, given[0].drive_brake = w.steer_two_pwm, w.drive_two_pwm
        given[0].steer_one_way = 1 - w.steer_two_pwm
        given[0].drive_one_way = 1 - w.drive_two_pwm
        _move(outputs[0], outputs[1], outputs[2], now, state, params, given, wires)
        pot, battery, steer_sense, drive_sense, estop, hall, hall_b, turn = _sensed(
            now, state, wires
        )
        sensors[0], sensors[1] = pot, battery
        sensors[2], sensors[3] = steer_sense, drive_sense
        sensors[4] = estop
        sensors[5] += hall < sensors[6]
        if hall_b != 0:
            sensors[7] += sensors[6] - hall
        sensors[6] = hall
        sensors[8] += turn < sensors[9]
        sensors[9] = turn


SENSORS: Final = 10
"""Of `_apart`: pot, battery, steering current, drive current, e-stop loop (mV); pulses of the hall
sensor since the start, and its level; those of both hall sensors, forward less backward; pulses of
the blade's sensor, and its level."""


def bind_apart(
    outputs: np.ndarray[Any, Any],
    sensors: np.ndarray[Any, Any],
    state: machine.Record,
    params: machine.Record,
    given: machine.Record,
    wires: machine.Record,
    layout: machine.Record,
) -> Callable[[int, int], None]:
    """The machine without firmware: `run(begin_us, end_us)` moves it at `outputs` (steering and
    drive duty -1..1, blade; float64) and leaves what its sensors give in `sensors` (int64).
    `layout`: which bridges take the duties."""
    records = (outputs, sensors, state, params, given, wires, layout)
    entry = entry_point(_apart, (0, 0, *records))

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
    layout: machine.Record | None = None,
) -> Callable[[int, int], int]:
    """The loop for these (1,) records: `run(begin_us, end_us)` returns the target's status.
    `wires`: the taps of every signal (hil/firmware/signal_wires.py), honest ones where none are
    given. `layout`: what the pins are wired to; None: an Uno's default wiring.
    """
    f = target.pointers
    functions = tuple(Native(k) for k in (f.run_until, f.set_analog_mv, f.set_pin, f.output))
    handle = target.handle
    taps = signal_wires.honest() if wires is None else wires
    records = (state, params, given, taps, log, wiring.layout() if layout is None else layout)
    entry = entry_point(run, (*functions, handle, 0, 0, *records))

    def bound(begin_us: int, end_us: int) -> int:
        return int(entry(*functions, handle, begin_us, end_us, *records))

    return bound


_compiled: dict[Any, Any] = {}
"""A loop's compiled code, once there: the arguments' types are always the same."""


def entry_point(dispatcher: Any, arguments: tuple[Any, ...]) -> Any:
    """The compiled code of a loop, which has been called once with these arguments by then.
    Numba's dispatcher would work out the records' types at every call, which costs more than ten
    simulated milliseconds."""
    if dispatcher not in _compiled:
        dispatcher(*arguments)
        types = tuple(numba.typeof(value) for value in arguments)  # type: ignore[no-untyped-call]
        _compiled[dispatcher] = dispatcher.overloads[types].entry_point
    return _compiled[dispatcher]
