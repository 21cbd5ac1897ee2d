"""What the firmware does, on the desk build and on the Uno's binary in simavr alike.

Each scenario holds its facts on either target, and then the two traces are compared: the duties,
blade and LED of every millisecond and every telemetry message (state, faults, angle, setpoint,
duties, times, sequence numbers) must be equal, without tolerance. The input voltages change on
whole milliseconds only, which is what makes both converters see the same samples. The scenarios
that reset the firmware inside are compared up to the reset: the AVR's boot takes about 1 ms.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import pytest

from hil.firmware.targets import Hang, ResetCause
from host.link import protocol
from host.link.protocol import Fault, Result, State
from tests.firmware.conftest import ERASED, Maker, maker_of
from tests.helpers.actuator import ActuatorSpec
from tests.helpers.firmware_bench import (
    BATTERY,
    CLOSED_MV,
    DRIVE_SENSE,
    OPEN_MV,
    SHORT_MV,
    STEER_SENSE,
    Bench,
    drive_mv,
    steer_mv,
)

Scenario = Callable[[Maker], Bench]
SCENARIOS: dict[str, Scenario] = {}


def scenario(function: Scenario) -> Scenario:
    """Registers a scenario under its function's name."""
    SCENARIOS[function.__name__] = function
    return function


def bench_running(make: Maker, **options: object) -> Bench:
    """ARMED, then RUNNING at 0.5 m/s with the blade on for half a second."""
    bench = Bench(make(), **options)  # type: ignore[arg-type]
    bench.arm()
    bench.ask(steer_deg=0.0, speed=0.5)
    bench.run(100)
    bench.ask(steer_deg=0.0, speed=0.5, blade=1)
    bench.run(500)
    assert bench.last.state == State.RUNNING
    assert bench.blade
    assert bench.drive_duty > 0
    return bench


def faulted(bench: Bench, fault: Fault, within_ms: int) -> Bench:
    """The fault latches within the time, everything goes off and stays off."""
    for _ in range(within_ms):
        bench.run(1)
        if bench.off():
            break
    assert bench.off()
    bench.run(60)
    assert bench.last.state == State.FAULT
    assert bench.last.faults == fault
    bench.send(protocol.Arm(protocol.VERSION))
    bench.run(200)
    assert bench.result() == Result.WRONG_STATE
    assert bench.off()
    return bench


@scenario
def boots_safe_and_says_so(make: Maker) -> Bench:
    bench = Bench(make())
    bench.send(protocol.Hello(protocol.VERSION))
    bench.run(500)
    version = bench.answers.pop(0)  # names its build, which differs
    assert isinstance(version, protocol.Version)
    assert version.protocol_version == protocol.VERSION
    assert version.reset_cause == ResetCause.POWER_ON
    assert bench.off()
    assert bench.last.state == State.SAFE
    assert bench.last.faults == 0
    assert bench.last.speed is None
    assert bench.last.battery == pytest.approx(12.0, abs=0.03)
    times = [each.time for each in bench.telemetry]
    assert times == pytest.approx([0.004 + 0.02 * i for i in range(len(times))])
    return bench


@scenario
def steers_both_ways(make: Maker) -> Bench:
    bench = Bench(make(), start_deg=5.0)
    bench.arm()
    for angle in (30.0, -45.0, 80.0, 0.0):
        bench.ask(steer_deg=angle)
        bench.run(2200)
        limited = max(-50.0, min(50.0, angle))
        assert bench.actuator.angle_deg == pytest.approx(limited, abs=0.7)
        assert math.degrees(bench.last.angle) == pytest.approx(bench.actuator.angle_deg, abs=0.5)
        assert math.degrees(bench.last.setpoint) == pytest.approx(limited, abs=0.01)
    assert bench.last.faults == 0
    return bench


@scenario
def drives_forward_and_back_with_a_soft_start(make: Maker) -> Bench:
    bench = bench_running(make)
    duties = [drive for _, drive, _, _ in bench.trace]
    assert max(b - a for a, b in itertools.pairwise(duties)) <= 2
    bench.ask(speed=-0.3, blade=1)
    bench.run(1200)
    assert bench.drive_duty == -77
    assert not bench.blade
    bench.ask(speed=0.5, blade=1)
    bench.run(1200)
    assert bench.drive_duty == 128
    assert bench.blade
    return bench


@scenario
def stop_wins(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.drive_period_ms = 0
    bench.send(protocol.Stop())
    bench.send(protocol.Arm(protocol.VERSION))
    bench.run(7)
    assert bench.off()
    bench.ask(speed=0.5)
    bench.run(100)
    assert bench.off()
    assert bench.last.state == State.SAFE
    return bench


@scenario
def link_loss(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.drive_period_ms = 0
    return faulted(bench, Fault.LINK_LOST, 250)


@scenario
def garbage_is_no_command(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.drive_period_ms = 0
    for k in range(13):
        bench.target.write(bytes((k * 37 + i * 91) % 255 + 1 for i in range(40)) + b"\0")
        bench.run(20)
    assert bench.off()
    bench.run(40)
    assert bench.last.faults == Fault.LINK_LOST
    assert bench.last.frames_bad == 13
    bench.target.write(b"\x11\x22\x33")
    bench.send(protocol.Clear())
    bench.run(30)
    assert bench.result() == Result.OK
    assert bench.last.state == State.SAFE
    return bench


@scenario
def estop_opens(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.estop(OPEN_MV)
    faulted(bench, Fault.ESTOP_OPEN, 10)
    bench.send(protocol.Clear())
    bench.run(20)
    assert bench.result() == Result.NOT_PLAUSIBLE
    bench.estop(CLOSED_MV)
    bench.run(5)
    bench.send(protocol.Clear())
    bench.run(20)
    assert bench.result() == Result.OK
    return bench


@scenario
def pot_opens(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.pot_mv = 5000
    return faulted(bench, Fault.POT_OPEN, 20)


@scenario
def pot_shorts(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.pot_mv = 0
    return faulted(bench, Fault.POT_SHORT, 20)


@scenario
def pot_jumps(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.pot_mv = bench.actuator.pot_mv() + 150
    return faulted(bench, Fault.POT_JUMP, 10)


@scenario
def pot_freezes(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.pot_mv = bench.actuator.pot_mv()
    bench.ask(steer_deg=20.0, speed=0.5)
    return faulted(bench, Fault.POT_FROZEN, 400)


@scenario
def steering_stalls(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.actuator.jammed = True
    bench.target.set_analog_mv(STEER_SENSE, steer_mv(8.0))
    bench.ask(steer_deg=20.0, speed=0.5)
    return faulted(bench, Fault.STEER_STALL, 400)


@scenario
def steering_runs_away(make: Maker) -> Bench:
    bench = bench_running(make, spec=ActuatorSpec(polarity=-1))
    bench.ask(steer_deg=5.0, speed=0.5)
    return faulted(bench, Fault.STEER_RUNAWAY, 900)


@scenario
def steering_draws_too_much(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(STEER_SENSE, steer_mv(21.0))
    return faulted(bench, Fault.STEER_OVERCURRENT, 70)


@scenario
def drive_draws_too_much(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(DRIVE_SENSE, drive_mv(-42.0))
    return faulted(bench, Fault.DRIVE_OVERCURRENT, 70)


@scenario
def battery_falls(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(BATTERY, 2400)
    return faulted(bench, Fault.BATTERY_LOW, 620)


@scenario
def battery_rises(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(BATTERY, 4000)
    return faulted(bench, Fault.BATTERY_HIGH, 120)


def with_hall_sensor(make: Maker, speed: float) -> Bench:
    """20 pulses a metre, driven for 4 s."""
    bench = Bench(make())
    bench.run(10)
    bench.set_param("hall_per_metre", 20)
    bench.hall_per_metre = 20.0
    bench.arm()
    bench.ask(speed=speed)
    bench.run(4000)
    return bench


@scenario
def hall_sensor_closes_the_loop_and_goes_silent(make: Maker) -> Bench:
    bench = with_hall_sensor(make, 0.4)
    assert bench.last.speed == pytest.approx(0.4, abs=0.03)
    assert bench.last.distance == pytest.approx(bench.wheel_m, abs=0.06)
    bench.hall_per_metre = 0.0
    return faulted(bench, Fault.HALL_LOST, 750)


@scenario
def hall_sensor_goes_silent_while_the_machine_creeps(make: Maker) -> Bench:
    bench = with_hall_sensor(make, 0.15)
    bench.hall_per_metre = 0.0
    return faulted(bench, Fault.HALL_LOST, 910)


@scenario
def a_machine_that_rolls_back_as_it_is_driven_may_break_away_late(make: Maker) -> Bench:
    bench = Bench(make())
    bench.run(10)
    bench.set_param("hall_per_metre", 20)
    bench.hall_per_metre = 20.0
    bench.arm()
    for asked, rolls_mps, ms in ((0.0, 0.3, 600), (0.15, 0.12, 420), (0.15, 0.08, 700)):
        bench.ask(speed=asked)
        for _ in range(ms):
            rolled_m = bench.wheel_m + rolls_mps * 1e-3
            bench.run(1)
            bench.wheel_m = rolled_m
    assert bench.drive_duty > 0
    assert bench.last.distance > 0.25
    bench.hall_per_metre = 0.0
    bench.run(1300)
    assert bench.last.faults == 0
    return faulted(bench, Fault.HALL_LOST, 400)


@scenario
def parameters_change_when_safe(make: Maker) -> Bench:
    bench = Bench(make())
    bench.run(10)
    bench.set_param("steer_limit", 12.5)
    spec = protocol.PARAMS["steer_limit"]
    bench.send(protocol.ParamGet(spec.id))
    bench.run(10)
    value = bench.answers[-1]
    assert isinstance(value, protocol.ParamValue)
    assert spec.from_raw(value.value) == 12.5
    bench.send(protocol.ParamSet(spec.id, spec.max_raw + 1))
    bench.run(10)
    assert bench.result() == Result.OUT_OF_RANGE
    bench.save_params()
    bench.arm()
    bench.ask(steer_deg=50.0)
    bench.run(1000)
    assert bench.actuator.angle_deg == pytest.approx(12.5, abs=0.7)
    bench.send(protocol.ParamDefaults())
    bench.run(10)
    assert bench.result() == Result.WRONG_STATE
    return bench


@scenario
def two_pwm_driver(make: Maker) -> Bench:
    first = Bench(make())
    first.run(10)
    for name in ("steer_driver", "drive_driver"):
        first.set_param(name, 2)
    first.set_param("steer_pwm_freq", 4000)
    first.set_param("drive_pwm_freq", 500)
    first.save_params()
    bench = Bench(make(first.target.eeprom()), bts7960=True)
    bench.arm()
    bench.ask(steer_deg=20.0, speed=0.5)
    bench.run(1500)
    assert bench.actuator.angle_deg == pytest.approx(20.0, abs=0.7)
    assert bench.drive_duty == 128
    bench.ask(steer_deg=-20.0, speed=-0.5)
    bench.run(2000)
    assert bench.actuator.angle_deg == pytest.approx(-20.0, abs=0.7)
    assert bench.drive_duty == -128
    assert not any(bench.target.pin(pin) for pin in (4, 5, 7, 8))
    return bench


@scenario
def identification_is_bounded(make: Maker) -> Bench:
    bench = Bench(make())
    bench.send(protocol.Ident(100, 0.1))
    bench.run(20)
    assert bench.result() == Result.WRONG_STATE
    bench.arm()
    bench.send(protocol.Ident(120, 0.1))
    bench.run(10)
    assert bench.steer_duty == 120
    bench.run(100)
    assert bench.off()
    assert bench.actuator.angle_deg > 0.5
    for _ in range(40):
        bench.send(protocol.Ident(200, 0.1))
        bench.run(50)
    assert bench.off()
    assert bench.last.faults == Fault.IDENT_LIMIT
    assert bench.actuator.angle_deg < 35 + 10  # released, it coasts
    return bench


@scenario
def corrupt_parameters_are_reported_and_never_arm(make: Maker) -> Bench:
    first = Bench(make())
    first.run(10)
    eeprom = bytearray(first.target.eeprom())
    for copy in (0, 512):
        eeprom[copy + 10] ^= 0x40
    bench = Bench(make(bytes(eeprom)))
    bench.run(50)
    assert bench.last.state == State.FAULT
    assert bench.last.faults == Fault.PARAMS_BAD
    bench.send(protocol.Clear())
    bench.run(20)
    assert bench.result() == Result.NOT_PLAUSIBLE
    bench.save_params()
    bench.send(protocol.Clear())
    bench.run(20)
    assert bench.result() == Result.OK
    bench.send(protocol.Arm(protocol.VERSION))
    bench.run(20)
    assert bench.result() == Result.NOT_SET_UP
    for name in ("steer_driver", "drive_driver"):
        bench.set_param(name, 1)
    for name, ampere in (
        ("drive_current_cont", 4),
        ("steer_current_max", 5),
        ("drive_current_max", 5),
    ):
        bench.set_param(name, ampere)
    bench.arm()
    return bench


@scenario
def an_erased_memory_never_arms(make: Maker) -> Bench:
    bench = Bench(make(ERASED))
    bench.run(50)
    assert bench.last.state == State.SAFE
    bench.send(protocol.Arm(protocol.VERSION))
    bench.run(20)
    assert bench.result() == Result.NOT_SET_UP
    bench.ask(speed=0.5, steer_deg=20.0, blade=1)
    bench.run(300)
    assert bench.off()
    return bench


@scenario
def a_limit_beyond_driver_or_sensor_never_arms(make: Maker) -> Bench:
    bench = Bench(make())
    bench.run(10)
    for name, bad, good in (
        ("steer_driver", 1, 2),  # an L298N, with a limit of 20 A
        ("steer_current_max", 25.0, 5.0),
        ("steer_driver", 0, 1),
        ("steer_current_cont", 4.5, 4.0),
        ("steer_current_max", 5.5, 5.0),
        ("drive_current_max", 61.0, 40.0),
        ("battery_high", 19.7, 15.5),
    ):
        bench.set_param(name, bad)
        bench.send(protocol.Arm(protocol.VERSION))
        bench.run(20)
        assert bench.result() == Result.NOT_SET_UP, name
        bench.set_param(name, good)
    bench.arm()
    return bench


@scenario
def an_estop_wire_on_the_chassis_is_a_fault(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.estop(SHORT_MV)
    return faulted(bench, Fault.ESTOP_SHORT, 20)


@scenario
def a_repeated_command_keeps_nothing_alive(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.drive_period_ms = 0
    bench.run(20)
    frame = protocol.encode(bench.command, bench.seq)
    for _ in range(12):
        bench.target.write(frame)
        bench.run(20)
    faulted(bench, Fault.LINK_LOST, 20)
    bench.run(200)
    assert bench.readings[-1].stale >= 10
    return bench


@scenario
def old_commands_keep_nothing_alive(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.drive_period_ms = 0
    bench.run(20)
    for back in range(12, 0, -1):
        bench.target.write(protocol.encode(bench.command, (bench.seq - back) & 0xFF))
        bench.run(20)
    return faulted(bench, Fault.LINK_LOST, 20)


@scenario
def the_blade_needs_a_fresh_request(make: Maker) -> Bench:
    bench = Bench(make())
    bench.ask(speed=0.0, blade=1)
    bench.run(100)
    assert not bench.blade
    bench.arm()
    bench.run(1000)
    assert not bench.blade
    bench.ask(speed=0.0, blade=0)
    bench.run(40)
    bench.ask(speed=0.0, blade=1)
    bench.run(40)
    assert bench.blade
    return bench


@scenario
def the_blade_does_not_chatter(make: Maker) -> Bench:
    bench = bench_running(make)
    begin = len(bench.trace)
    for k in range(100):
        bench.ask(speed=0.5, blade=k % 2)
        bench.run(20)
    blade = [row[2] for row in bench.trace[begin:]]
    switched_on = [i for i in range(1, len(blade)) if blade[i] and not blade[i - 1]]
    assert 1 <= len(switched_on) <= 4
    bench.ask(speed=0.5, blade=1)
    bench.run(600)
    assert bench.blade
    bench.ask(speed=0.5, blade=0)
    bench.run(30)
    assert not bench.blade
    return bench


@scenario
def a_wheel_that_runs_away_is_a_fault(make: Maker) -> Bench:
    bench = Bench(make())
    bench.run(10)
    bench.set_param("hall_per_metre", 20)
    bench.hall_per_metre = 20.0
    bench.arm()
    bench.ask(speed=0.0)
    bench.run(200)
    for _ in range(600):
        bench.wheel_m += 2e-3
        bench.run(1)
    assert bench.last.faults == Fault.WHEEL_RUNAWAY
    assert bench.off()
    return bench


def with_sensors(make: Maker) -> Bench:
    """Two hall sensors and the blade's fitted."""
    bench = Bench(make())
    bench.run(10)
    for name, value in (("hall_per_metre", 100), ("hall_phases", 2), ("blade_turn_min", 20)):
        bench.set_param(name, value)
    bench.hall_per_metre = 100.0
    bench.blade_hz = 40.0
    bench.arm()
    bench.ask(speed=0.0)
    bench.run(20)
    bench.ask(speed=0.4, blade=1)
    bench.run(2500)
    assert bench.last.state == State.RUNNING
    assert bench.last.speed == pytest.approx(0.4, abs=0.03)
    return bench


@scenario
def two_hall_sensors_tell_the_direction(make: Maker) -> Bench:
    bench = with_sensors(make)
    forward_m = bench.last.distance
    assert forward_m == pytest.approx(bench.wheel_m, abs=0.05)
    bench.wheel_backward = True
    return faulted(bench, Fault.WRONG_WAY, 900)


@scenario
def a_wheel_that_rocks_on_a_sensor_s_edge_stands(make: Maker) -> Bench:
    bench = with_sensors(make)
    bench.ask(speed=0.0)
    bench.run(1500)
    assert bench.last.speed == 0.0
    stood = bench.last.distance
    # From 2 mm before the edge at which the first sensor changes to 2 mm behind it and back,
    # 20 times a second: as an engine that idles shakes a machine that stands.
    for edge in (0.0, 0.5):
        pulse_m = 1.0 / bench.hall_per_metre
        bench.wheel_m = (round(bench.wheel_m / pulse_m) + edge + 0.2) * pulse_m
        bench.run(1500)
        met = bench.last.distance
        assert met == pytest.approx(stood, abs=2.0 * pulse_m)
        for k in range(120):
            bench.wheel_m += pulse_m * (0.4 if k % 2 else -0.4)
            bench.run(25)
            assert bench.last.speed == 0.0
            assert bench.last.distance == pytest.approx(met, abs=1.01 * pulse_m)
    assert bench.last.state in (State.RUNNING, State.ARMED)
    assert bench.last.faults == 0
    return bench


@scenario
def a_blade_that_does_not_turn_is_a_fault(make: Maker) -> Bench:
    bench = with_sensors(make)
    bench.blade_hz = 0.0
    return faulted(bench, Fault.BLADE_LOST, 250)


@scenario
def a_blade_that_does_not_stop_is_a_fault(make: Maker) -> Bench:
    bench = with_sensors(make)
    bench.blade_welded = True
    bench.ask(speed=0.4, blade=0)
    return faulted(bench, Fault.BLADE_STUCK, 1800)


@scenario
def a_mean_current_beyond_the_driver_s_rating_is_a_fault(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(STEER_SENSE, steer_mv(-5.0))
    return faulted(bench, Fault.STEER_OVERCURRENT, 1800)


@scenario
def the_readings_say_what_the_sensors_read(make: Maker) -> Bench:
    bench = bench_running(make)
    bench.target.set_analog_mv(STEER_SENSE, steer_mv(-2.0))
    bench.target.set_analog_mv(DRIVE_SENSE, drive_mv(7.0))
    bench.run(400)
    last = bench.readings[-1]
    assert last.steer_current == pytest.approx(2.0, abs=0.06)
    assert last.drive_current == pytest.approx(7.0, abs=0.15)
    assert last.estop == pytest.approx(CLOSED_MV / 5000 * 1023, abs=1)
    assert last.battery == pytest.approx(3000 / 5000 * 1023, abs=1)
    assert (last.overruns, last.line_errors, last.stale) == (0, 0, 0)
    return bench


@pytest.mark.parametrize("name", SCENARIOS)
def test_holds(name: str, make_target: Maker) -> None:
    SCENARIOS[name](make_target)


@pytest.mark.parametrize("name", SCENARIOS)
def test_desk_and_avr_agree_tick_for_tick(name: str) -> None:
    desk, avr = (SCENARIOS[name](maker_of(kind)) for kind in ("desk", "avr"))
    assert len(desk.trace) > 100
    assert desk.trace == avr.trace
    assert desk.answers == avr.answers
    # The last message may still be on the line of the one and through on the other's.
    count = min(len(desk.telemetry), len(avr.telemetry))
    assert abs(len(desk.telemetry) - len(avr.telemetry)) <= 1
    assert desk.telemetry[:count] == avr.telemetry[:count]
    count = min(len(desk.readings), len(avr.readings))
    assert desk.readings[:count] == avr.readings[:count]
    for bench in (desk, avr):
        bench.target.close()


@pytest.mark.parametrize(
    ("cause", "fault"),
    [(ResetCause.BROWN_OUT, Fault.BROWN_OUT), (ResetCause.WATCHDOG, Fault.WATCHDOG)],
)
def test_a_bad_reset_boots_into_fault_with_outputs_off(
    cause: ResetCause, fault: Fault, make_target: Maker
) -> None:
    bench = bench_running(make_target)
    bench.cut_frames = 1
    bench.target.reset(cause)
    bench.run(1)
    assert bench.off()
    bench.run(100)
    assert bench.off()
    assert bench.last.state == State.FAULT
    assert bench.last.faults == fault


def test_an_external_reset_boots_safe(make_target: Maker) -> None:
    bench = bench_running(make_target)
    bench.cut_frames = 1
    bench.target.reset(ResetCause.EXTERNAL)
    bench.run(100)
    assert bench.off()
    assert bench.last.state == State.SAFE
    assert bench.last.faults == 0


@pytest.mark.parametrize(("where", "within_ms"), [(Hang.MAIN, 17), (Hang.INTERRUPT, 34)])
def test_a_hang_ends_in_the_watchdog(where: Hang, within_ms: int, make_target: Maker) -> None:
    bench = bench_running(make_target)
    bench.cut_frames = 1
    bench.target.hang(where)
    hung_at = bench.now_us
    while not bench.off():
        bench.run(1)
        assert bench.now_us - hung_at <= within_ms * 1000
    bench.run(100)
    assert bench.off()
    assert bench.last.state == State.FAULT
    assert bench.last.faults == Fault.WATCHDOG
