"""A machine on a slope, up and down: the firmware holds its speed there, and finds it out where
nothing does. Firmware and machine alone, without a pilot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from hil.firmware import coupling, provision, signal_wires, targets, wiring
from hil.firmware.signal_wires import Mode, Signal
from hil.firmware.wiring import Driver, Wiring
from host.core.messages import Command, Request, State
from host.link.protocol import Fault
from host.link.session import Session
from sim_plant import machine

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the firmware is not built: make build"
)

TOLD = provision.FITTED | {"hall_per_metre": 50.0, "hall_phases": 2.0}
NAMED: dict[Driver, float] = {"l298n": 1.0, "bts7960": 2.0, "vnh5019": 3.0}
"""What the owner calls each bridge."""
OVERSHOOT_MPS: dict[Driver, float] = {"bts7960": 0.2, "vnh5019": 0.21}
"""A VNH5019 slows nothing by itself: the firmware has to see that the wheels turn too fast."""
SLICE_US = 5_000
COMMAND_US = 20_000


@dataclass
class Drive:
    """What became of one."""

    fault: Fault
    fastest_mps: float
    at_end_mps: float
    until_fault_m: float
    """Travelled by then; all of it where there was none."""


def driven(
    nose_down_deg: float,
    speed_mps: float,
    *,
    motor_open_at_s: float = math.inf,
    hall_open: bool = False,
    bridge: Driver = "vnh5019",
    spec: machine.MachineSpec | None = None,
) -> Drive:
    """Eight seconds of a speed that is asked for, from a stand."""
    spec = spec or machine.MachineSpec()
    state, given = machine.initial(spec), machine.inputs()
    given["pitch"] = math.radians(nose_down_deg)
    wires = signal_wires.honest()
    session = Session()
    if hall_open:
        for signal in (Signal.HALL, Signal.HALL_B):
            wires[signal]["mode"] = Mode.FIXED
    found, fastest, way = Fault(0), 0.0, 0.0
    layout = wiring.layout(Wiring(drive=bridge))
    told_of = {"drive_driver": NAMED[bridge], "hall_per_metre": spec.drive.hall_pulses_per_m}
    with provision.target("desk", TOLD | told_of) as target:
        run = coupling.bind(
            target, state, machine.parameters(spec), given, wires=wires, layout=layout
        )
        for now_us in range(0, 8_000_000, SLICE_US):
            now = now_us / 1e6
            if now_us % COMMAND_US == 0:
                told = session.telemetry
                request = Request.ARM if told is None or told.state is State.SAFE else Request.DRIVE
                target.write(session.encode(now, Command(request, speed_mps=speed_mps)))
            if now >= motor_open_at_s:
                wires[Signal.DRIVE_DUTY]["mode"] = Mode.FIXED
            run(now_us, now_us + SLICE_US)
            for telemetry in session.feed(now, target.read()):
                found |= Fault(telemetry.faults)
            fastest = max(fastest, float(state["v"][0]) * math.copysign(1.0, speed_mps))
            if not found:
                way = abs(float(state["distance"][0]))
        return Drive(found, fastest, float(state["v"][0]), way)


def off_from_a_stand(
    nose_up_deg: float, speed_mps: float, firmware: provision.Firmware, *, rolling: float = 0.04
) -> tuple[Fault, float | None, float]:
    """A machine with one hall sensor comes to its brake on level ground, whose end is the slope's
    foot, and is then told to climb: the faults, after how long it moves (s), and its largest speed
    (m/s)."""
    spec = machine.MachineSpec(drive=machine.DriveSpec(rolling=rolling))
    state, given = machine.initial(spec), machine.inputs()
    session = Session()
    found, moves_after, fastest = Fault(0), None, 0.0
    way = math.copysign(1.0, speed_mps)
    go_s = 2.5
    with provision.target(firmware, provision.FITTED | {"hall_per_metre": 50.0}) as target:
        run = coupling.bind(target, state, machine.parameters(spec), given)
        for now_us in range(0, 6_000_000, SLICE_US):
            now = now_us / 1e6
            if now >= 1.5:
                given["pitch"] = -way * math.radians(nose_up_deg)
            if now_us % COMMAND_US == 0:
                told = session.telemetry
                request = Request.ARM if told is None or told.state is State.SAFE else Request.DRIVE
                asked = speed_mps if now >= go_s else way * 0.2 if now < 1.0 else 0.0
                target.write(session.encode(now, Command(request, speed_mps=asked)))
            run(now_us, now_us + SLICE_US)
            for telemetry in session.feed(now, target.read()):
                found |= Fault(telemetry.faults)
            speed = float(state["v"][0]) * way
            if now >= go_s and moves_after is None and speed > 0.03:
                moves_after = now - go_s
            fastest = max(fastest, speed if now >= go_s else 0.0)
    return found, moves_after, fastest


def stands(
    nose_down_deg: float, firmware: provision.Firmware, told: dict[str, float]
) -> tuple[Fault, float, float]:
    """Four seconds armed on a slope, from a stand and never driven: the faults, the largest speed
    (m/s) and the way (m) that it rolled."""
    spec = machine.MachineSpec()
    state, given = machine.initial(spec), machine.inputs()
    session = Session()
    found, fastest = Fault(0), 0.0
    with provision.target(firmware, TOLD | told) as target:
        run = coupling.bind(target, state, machine.parameters(spec), given)
        for now_us in range(0, 4_500_000, SLICE_US):
            now = now_us / 1e6
            if now_us % COMMAND_US == 0:
                told_last = session.telemetry
                safe = told_last is None or told_last.state is State.SAFE
                request = Request.ARM if safe else Request.DRIVE
                target.write(session.encode(now, Command(request)))
            if now >= 0.5:  # the chock is taken away
                given["pitch"] = math.radians(nose_down_deg)
            run(now_us, now_us + SLICE_US)
            for telemetry in session.feed(now, target.read()):
                found |= Fault(telemetry.faults)
            fastest = max(fastest, abs(float(state["v"][0])))
        assert session.telemetry is not None and session.telemetry.state is not State.SAFE
    return found, fastest, abs(float(state["distance"][0]))


@pytest.mark.parametrize("firmware", ["desk", "avr"])
@pytest.mark.parametrize("speed_mps", [0.15, -0.15, -0.3])
@pytest.mark.parametrize(("nose_up_deg", "rolling"), [(0.0, 0.04), (6.0, 0.04), (5.0, 0.08)])
def test_from_a_stand_it_breaks_away_uphill_within_1200_ms_and_not_with_a_leap(
    nose_up_deg: float, rolling: float, speed_mps: float, firmware: provision.Firmware
) -> None:
    fault, moves_after, fastest = off_from_a_stand(
        nose_up_deg, speed_mps, firmware, rolling=rolling
    )
    assert fault == Fault(0)
    assert moves_after is not None and moves_after < 1.2
    assert fastest < abs(speed_mps) + 0.1


@pytest.mark.parametrize("firmware", ["desk", "avr"])
@pytest.mark.parametrize("phases", [1.0, 2.0])
@pytest.mark.parametrize(("nose_down_deg", "creep_mps"), [(4.0, 0.1), (6.0, 0.17), (-6.0, 0.17)])
def test_armed_on_a_slope_before_it_was_ever_driven_it_is_held(
    nose_down_deg: float, creep_mps: float, phases: float, firmware: provision.Firmware
) -> None:
    """Shorted motors are no parking brake: what is left is their creep."""
    fault, fastest, way = stands(nose_down_deg, firmware, {"hall_phases": phases})
    assert fault == Fault(0)
    assert fastest < 0.22
    assert way < creep_mps * 4.0


def test_on_the_level_an_armed_machine_that_was_never_driven_has_nothing_on() -> None:
    """What brakes one driver is full power where another is fitted (test_wiring.py)."""
    assert stands(0.0, "desk", {}) == (Fault(0), 0.0, 0.0)


BRIDGES = pytest.mark.parametrize("bridge", ["vnh5019", "bts7960"])
"""The one slows its motor only where it is told to, the other by itself (test_bridges.py)."""


@BRIDGES
def test_a_creep_downhill_is_braked_where_less_than_no_duty_would_be_needed(bridge: Driver) -> None:
    """The least duty brakes, so none must not let the machine go."""
    drive = driven(6.0, 0.15, bridge=bridge)
    assert drive.fault == Fault(0)
    assert drive.fastest_mps < 0.3


@pytest.mark.parametrize("nose_down_deg", [0.0, 3.0])
@pytest.mark.parametrize("speed_mps", [0.15, 0.3, -0.3, 0.5])
def test_from_a_stand_a_silent_sensor_stops_the_machine_within_half_a_metre(
    speed_mps: float, nose_down_deg: float
) -> None:
    drive = driven(math.copysign(nose_down_deg, speed_mps), speed_mps, hall_open=True)
    assert drive.fault == Fault.HALL_LOST
    assert drive.until_fault_m < 0.5


@pytest.mark.parametrize("speed_mps", [0.12, 0.5])
@pytest.mark.parametrize("pulses_per_m", [2.0, 5.0, 9.9, 10.0, 20.0])
def test_a_wheel_sensor_too_coarse_to_hold_the_speed_never_arms(
    pulses_per_m: float, speed_mps: float
) -> None:
    """Between pulses more than a second apart the loop sees a machine that stands. One of 2 pulses
    a metre went at 0.6 m/s where 0.12 was asked."""
    spec = machine.MachineSpec(drive=machine.DriveSpec(hall_pulses_per_m=pulses_per_m))
    drive = driven(0.0, speed_mps, spec=spec)
    if pulses_per_m < 10.0:
        assert drive.until_fault_m == 0.0
    else:
        assert drive.fault == Fault(0)
        assert drive.at_end_mps == pytest.approx(speed_mps, abs=0.03)
        assert drive.fastest_mps < speed_mps + 0.2


@pytest.mark.parametrize("speed_mps", [0.08, -0.099])
def test_told_to_creep_a_machine_with_a_silent_sensor_does_not_run_away(speed_mps: float) -> None:
    """Its loop has seen no movement, and would drive it at full duty: 1 m/s."""
    drive = driven(0.0, speed_mps, hall_open=True)
    assert drive.fault == Fault.HALL_LOST
    assert drive.fastest_mps < 0.5  # speed_excess, 0.35 m/s, more than asked


@BRIDGES
@pytest.mark.parametrize("speed_mps", [0.5, -0.3])
@pytest.mark.parametrize("nose_down_deg", [6.0, 3.0, -5.0])
def test_up_and_down_a_slope_the_speed_is_held_without_a_fault(
    nose_down_deg: float, speed_mps: float, bridge: Driver
) -> None:
    drive = driven(nose_down_deg, speed_mps, bridge=bridge)
    assert drive.fault == Fault(0)
    assert drive.at_end_mps == pytest.approx(speed_mps, abs=0.05)
    assert drive.fastest_mps < abs(speed_mps) + OVERSHOOT_MPS[bridge]


def test_a_machine_that_rolls_downhill_unheld_is_a_runaway() -> None:
    """Its motor's wire breaks on the way down: the wheels turn faster than asked."""
    assert driven(5.0, 0.5, motor_open_at_s=4.0).fault == Fault.WHEEL_RUNAWAY


def test_a_machine_that_rolls_back_down_a_slope_it_cannot_climb_goes_the_wrong_way() -> None:
    assert Fault.WRONG_WAY in driven(-8.0, 0.3, motor_open_at_s=2.0).fault
