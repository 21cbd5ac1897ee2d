"""The machine against closed forms and, where it is linear, against python-control's model."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from sim_plant.machine import (
    STEER_PWM_HZ,
    STEP_S,
    BatterySpec,
    BridgeSpec,
    DriveSpec,
    MachineSpec,
    SteeringSpec,
    initial,
    inputs,
    parameters,
    step,
)

IDEAL = BridgeSpec(drop_v=0, r_ohm=0, dead_time_s=0)
STIFF = BatterySpec(full_v=12.0, empty_v=12.0, r_ohm=0.0)
LOOSE = SteeringSpec(
    bridge=IDEAL, static_nm=0, coulomb_nm=0, viscous_nms=0, backlash_deg=0, stop_deg=84
)
"""A steering motor without friction or play: linear."""


@njit
def run(state: Any, params: Any, given: Any, steps: int) -> None:
    for _ in range(steps):
        step(state, params, given, STEP_S)


class Bench:
    """One machine at hand: set inputs by name, run, read the state by name."""

    def __init__(
        self,
        spec: MachineSpec,
        seed: int = 0,
        steer_pwm_hz: float = STEER_PWM_HZ,
        **start: float,
    ) -> None:
        self.state, self.params, self.inputs = (
            initial(spec, **start),
            parameters(spec, seed, steer_pwm_hz=steer_pwm_hz),
            inputs(),
        )

    def run(self, seconds: float, **given: float) -> Bench:
        for name, value in given.items():
            self.inputs[name] = value
        run(self.state, self.params, self.inputs, round(seconds / STEP_S))
        return self

    def __getattr__(self, name: str) -> float:
        return float(self.state[name][0])


def test_stalled_current_rises_with_the_electrical_time_constant_to_ohms_law() -> None:
    bench = Bench(MachineSpec(steering=LOOSE, battery=STIFF))
    final = 0.5 * 12.0 / LOOSE.r_ohm
    tau_steps = round(LOOSE.l_h / LOOSE.r_ohm / STEP_S * 4) / 4
    bench.run(STEP_S, steer_duty=0.5, steer_jam=1)
    assert bench.steer_a == pytest.approx(final * (1 - math.exp(-1 / tau_steps)), rel=1e-9)
    assert bench.run(0.1).steer_a == pytest.approx(final, rel=1e-9)


def test_without_load_the_motor_turns_until_its_back_emf_meets_the_voltage() -> None:
    bench = Bench(MachineSpec(steering=LOOSE, battery=STIFF)).run(1.0, steer_duty=0.5)
    assert bench.steer_speed == pytest.approx(6.0 / LOOSE.k_vs, rel=1e-3)
    assert bench.steer_a == pytest.approx(0.0, abs=0.02)


def test_the_linear_motor_follows_python_controls_model() -> None:
    m = LOOSE.model_copy(update={"viscous_nms": 2e-4})
    electric = control.tf([1], [m.l_h, m.r_ohm])
    mechanic = control.tf([1], [m.inertia_kgm2, m.viscous_nms])
    motor = control.feedback(m.k_vs * electric * mechanic, m.k_vs)
    time = np.arange(0, 0.4, STEP_S)
    volts = 6.0 * np.sign(np.sin(2 * np.pi * 4 * time))
    expected = control.forced_response(motor, time, volts).outputs
    bench = Bench(MachineSpec(steering=m, battery=STIFF))
    got = []
    for v in volts:
        got.append(bench.steer_speed)
        bench.run(STEP_S, steer_duty=float(v) / 12.0, steer_brake=1)
    assert np.abs(got - expected).max() < 0.02 * np.abs(expected).max()


@settings(max_examples=25, deadline=None)
@given(slew=st.floats(20, 60), lag=st.floats(0.05, 0.1), stiction=st.floats(25, 90))
def test_a_steering_made_from_its_response_shows_it(
    slew: float, lag: float, stiction: float
) -> None:
    steering = SteeringSpec.from_response(
        slew_degps=slew, lag_s=lag, stiction_counts=stiction, stop_deg=80
    )
    spec = MachineSpec(steering=steering, battery=STIFF)
    at_rest = Bench(spec).run(0.5, steer_duty=(stiction - 1) / 255)
    assert at_rest.steer_speed == 0.0
    assert Bench(spec).run(0.5, steer_duty=(stiction + 1) / 255).steer_speed > 0.0
    bench = Bench(spec, steer=-1.0)
    rate = math.radians(slew) * steering.gear
    bench.run(lag, steer_duty=1.0)
    # Exponential in the mean; the electrical lag of about 1 ms comes on top.
    assert bench.steer_speed / rate == pytest.approx(1 - math.exp(-1), abs=0.04)
    assert bench.run(10 * lag).steer_speed == pytest.approx(rate, rel=0.01)


def test_the_wheel_stays_while_the_gear_crosses_its_backlash() -> None:
    spec = MachineSpec(steering=SteeringSpec(backlash_deg=2.0))
    bench = Bench(spec).run(0.5, steer_duty=0.6).run(0.6, steer_duty=0.0)
    angle, shaft = bench.steer_angle, bench.steer_shaft
    while bench.steer_shaft > shaft - math.radians(1.95):
        bench.run(STEP_S, steer_duty=-0.6)
        assert bench.steer_angle == angle
    bench.run(0.1)
    assert bench.steer_angle < angle
    assert bench.steer_angle - bench.steer_shaft == pytest.approx(math.radians(1.0))


def test_the_stops_hold_and_stall_the_motor() -> None:
    spec = MachineSpec(battery=STIFF)
    bench = Bench(spec).run(3.0, steer_duty=1.0)
    s = spec.steering
    assert bench.steer_angle == pytest.approx(math.radians(s.stop_deg))
    volts = (12.0 - s.bridge.drop_v) * (1 - s.bridge.dead_time_s * STEER_PWM_HZ)
    assert bench.steer_a == pytest.approx(volts / (s.r_ohm + s.bridge.r_ohm), rel=1e-6)
    assert bench.steer_sense_mv == pytest.approx(2500 + 100 * bench.steer_a)


def test_the_pot_reads_the_wheel_within_its_bend_and_noise() -> None:
    steering = SteeringSpec(pot_bend_counts=2.0, pot_noise_counts=2.0)
    readings = []
    for degrees in range(-50, 51, 5):
        bench = Bench(MachineSpec(steering=steering), seed=degrees, steer=math.radians(degrees))
        for _ in range(20):
            bench.run(STEP_S)
            readings.append(bench.pot_mv * 1023 / 5000 - (512 + 4.5 * degrees))
    assert np.abs(readings).max() <= 4.0
    assert np.std(readings) > 0.5


def test_speed_at_full_duty_is_about_a_metre_per_second_and_half_of_it_at_half_duty() -> None:
    assert Bench(MachineSpec()).run(4.0, drive_duty=1.0).v == pytest.approx(1.05, abs=0.05)
    assert Bench(MachineSpec()).run(4.0, drive_duty=0.53, cutting=1).v == pytest.approx(
        0.5, abs=0.05
    )


def test_coasting_slows_by_rolling_resistance_alone() -> None:
    spec = MachineSpec(drive=DriveSpec(rolling=0.05))
    bench = Bench(spec).run(3.0, drive_duty=0.8).run(0.01, drive_duty=0.0)
    before = bench.wheel_v
    assert bench.drive_a == 0.0
    assert bench.run(0.5).wheel_v == pytest.approx(before - 0.5 * 0.05 * 9.81, rel=1e-6)


def test_friction_ends_a_motion_and_does_not_reverse_it() -> None:
    bench = Bench(MachineSpec()).run(1.0, drive_duty=0.8, steer_duty=0.5)
    bench.run(5.0, drive_duty=0.0, steer_duty=0.0)
    assert (bench.wheel_v, bench.v, bench.steer_speed) == (0.0, 0.0, 0.0)


def test_braking_stops_sooner_than_coasting() -> None:
    coasting, braking = (Bench(MachineSpec()).run(3.0, drive_duty=0.8) for _ in range(2))
    coasting.run(0.3, drive_duty=0.0)
    braking.run(0.3, drive_duty=0.0, drive_brake=1)
    assert braking.wheel_v < 0.7 * coasting.wheel_v


def test_a_slope_beyond_rolling_resistance_moves_the_machine_and_one_below_does_not() -> None:
    spec = MachineSpec(drive=DriveSpec(rolling=0.05))
    assert Bench(spec).run(1.0, pitch=math.atan(0.049)).v == 0.0
    assert Bench(spec).run(1.0, pitch=math.atan(0.06)).v > 0.0
    assert Bench(spec).run(1.0, pitch=-math.atan(0.06)).v < 0.0


def test_mud_slows_the_machine_and_raises_its_current() -> None:
    dry, muddy = (Bench(MachineSpec()).run(4.0, drive_duty=0.6, load_n=n) for n in (0, 60))
    assert muddy.v < dry.v - 0.1
    assert (muddy.drive_a - dry.drive_a) * DriveSpec().k_vspm == pytest.approx(60, rel=1e-3)


def test_cutting_takes_its_force() -> None:
    free, cutting = (Bench(MachineSpec()).run(4.0, drive_duty=0.6, cutting=c) for c in (0, 0.5))
    force = (cutting.drive_a - free.drive_a) * DriveSpec().k_vspm
    assert force == pytest.approx(0.5 * DriveSpec().cutting_n, rel=1e-3)


@pytest.mark.parametrize("duty", [0.6, -0.6])
def test_the_wheels_slip_by_the_share_of_their_driving_force(duty: float) -> None:
    spec = DriveSpec(slip_n=500.0)
    bench = Bench(MachineSpec(drive=spec)).run(4.0, drive_duty=duty)
    lost = spec.k_vspm * abs(bench.drive_a) / spec.slip_n
    assert lost > 0.05
    assert bench.v == pytest.approx(bench.wheel_v * (1 - lost), rel=1e-3)


def test_a_turn_pushes_the_rear_outward() -> None:
    spec = MachineSpec(cornering_rear_n=800.0, cornering_front_n=800.0)
    bench = Bench(spec, steer=0.3).run(4.0, drive_duty=0.9)
    outward = spec.drive.mass_kg * bench.v * bench.yaw_rate * (1 - spec.front_load)
    assert bench.yaw_rate > 0
    assert bench.slip_rear == pytest.approx(-outward / 800.0, rel=0.01)
    assert bench.slip_rear < -0.02


def test_the_battery_sags_under_current_and_the_rail_browns_out() -> None:
    weak = BatterySpec(r_ohm=0.6, idle_a=0.0)
    bench = Bench(MachineSpec(battery=weak))
    bench.run(STEP_S)
    assert (bench.battery_v, bench.rail_v) == (pytest.approx(12.6, abs=0.01), 5.0)
    bench.run(0.05, drive_duty=1.0)
    assert bench.battery_v == pytest.approx(12.6 - 0.6 * bench.drive_a, abs=0.5)
    assert bench.run(0.05, blade_on=1).rail_v < 2.7


def test_the_pins_see_the_contract_s_voltages() -> None:
    """12 V reads 3.0 V through the divider; an ACS712-20A gives 100 mV/A, an ACS758-050B 40."""
    bench = Bench(MachineSpec(battery=STIFF)).run(0.2, drive_duty=0.5, steer_duty=0.5)
    assert bench.battery_sense_mv == pytest.approx(3000)
    assert bench.drive_sense_mv == pytest.approx(2500 + 40 * bench.drive_a)
    assert bench.steer_sense_mv == pytest.approx(2500 + 100 * bench.steer_a)
    assert Bench(MachineSpec(battery=STIFF)).run(0.02, drive_duty=1.0).drive_sense_mv > 4000


def test_the_bridge_loses_its_drop_and_its_dead_time() -> None:
    bridge = BridgeSpec(drop_v=2.0, r_ohm=0.2, dead_time_s=4e-6)
    steering = SteeringSpec(bridge=bridge)
    bench = Bench(MachineSpec(steering=steering, battery=STIFF), steer_pwm_hz=10_000.0)
    bench.run(0.1, steer_duty=0.5, steer_jam=1)
    assert bench.steer_a == pytest.approx((0.5 - 0.04) * 10.0 / (steering.r_ohm + 0.2), rel=1e-6)
    assert Bench(MachineSpec(steering=steering)).run(0.1, steer_duty=0.03).steer_a == 0.0


def test_the_charge_taken_lowers_the_battery() -> None:
    small = BatterySpec(capacity_ah=0.01, idle_a=0.36, r_ohm=0.0)
    assert Bench(MachineSpec(battery=small)).run(50.0).battery_v == pytest.approx(12.1, abs=0.01)


@pytest.mark.parametrize("degrees", [-40.0, -10.0, 5.0, 50.0])
def test_without_slip_the_rear_axle_turns_on_the_tricycles_circle(degrees: float) -> None:
    grip = {"cornering_front_n": 1e12, "cornering_rear_n": 1e12}
    spec = MachineSpec(**grip, drive=DriveSpec(slip_n=1e12))
    bench = Bench(spec, steer=math.radians(degrees)).run(3.0, drive_duty=0.5)
    radius = spec.wheelbase_m / math.tan(math.radians(degrees))
    turned = bench.distance / radius
    assert bench.yaw == pytest.approx(turned, rel=1e-6)
    assert (bench.x, bench.y) == pytest.approx(
        (radius * math.sin(turned), radius * (1 - math.cos(turned))), abs=1e-4
    )


def test_a_side_slope_makes_the_machine_crab_downhill() -> None:
    spec = MachineSpec()
    roll = math.radians(8)
    bench = Bench(spec).run(4.0, drive_duty=0.5, roll=roll)
    across = spec.drive.mass_kg * 9.81 * math.sin(roll)
    rear = -across * (1 - spec.front_load) / spec.cornering_rear_n
    assert bench.slip_rear == pytest.approx(rear, rel=0.02)
    assert bench.y < -0.01
    assert bench.yaw_rate / bench.v == pytest.approx(
        math.tan(bench.slip_front) - math.tan(rear), abs=1e-3
    )


def test_the_machine_drives_back_where_it_came_from() -> None:
    spec = MachineSpec(cornering_front_n=1e12, cornering_rear_n=1e12)
    bench = Bench(spec, steer=0.4).run(2.0, drive_duty=0.5).run(1.0, drive_duty=0.0)
    assert bench.x > 0.3
    while bench.distance > 0.0:
        bench.run(0.01, drive_duty=-0.5)
    assert (bench.x, bench.y, bench.yaw) == pytest.approx((0, 0, 0), abs=0.02)


def test_the_hall_sensor_counts_the_wheels_way() -> None:
    bench = Bench(MachineSpec(drive=DriveSpec(hall_pulses_per_m=40)))
    edges, last = 0, bench.hall
    for _ in range(3000):
        bench.run(STEP_S, drive_duty=0.5)
        edges, last = edges + (bench.hall != last), bench.hall
    assert edges == pytest.approx(2 * 40 * bench.distance, abs=2)


@pytest.mark.parametrize("left_m", [0.35, -0.35, 0.0])
@pytest.mark.parametrize("degrees", [50.0, -50.0])
@pytest.mark.parametrize("duty", [0.5, -0.5])
def test_the_hall_sensor_counts_the_way_of_the_wheel_that_it_sits_at(
    left_m: float, degrees: float, duty: float
) -> None:
    """By the wheels' circles about the turn's middle, which lies on the rear axle."""
    grip = {"cornering_front_n": 1e12, "cornering_rear_n": 1e12}
    drive = DriveSpec(slip_n=1e12, hall_pulses_per_m=100, hall_left_m=left_m)
    bench = Bench(MachineSpec(**grip, drive=drive), steer=math.radians(degrees))
    edges, last = 0, bench.hall
    for _ in range(3000):
        bench.run(STEP_S, drive_duty=duty)
        edges, last = edges + (bench.hall != last), bench.hall
    radius = MachineSpec().wheelbase_m / math.tan(math.radians(degrees))
    way_m = abs((radius - left_m) * bench.yaw)
    assert edges == pytest.approx(2 * 100 * way_m, abs=2)
    assert abs(bench.distance) == pytest.approx(abs(radius * bench.yaw), rel=1e-6)


def test_the_blade_takes_time_to_spin_up_and_down() -> None:
    bench = Bench(MachineSpec(blade_spin_up_s=0.4)).run(0.05, blade_on=1)
    assert bench.blade_spinning == 0
    assert bench.run(0.4).blade_spinning == 1
    assert bench.run(0.5, blade_on=0).blade_spinning == 0


def test_the_outline_holds_body_and_blade() -> None:
    spec = MachineSpec()
    corners = spec.outline(1.0, 2.0, math.pi / 2)
    assert corners[:, 1].max() == pytest.approx(2.0 + spec.blade_x_m)
    assert corners[:, 1].min() == pytest.approx(2.0 - spec.rear_overhang_m)
    assert np.ptp(corners[:, 0]) == pytest.approx(spec.blade_width_m)


def test_traces_repeat_bit_for_bit_and_differ_by_seed() -> None:
    def trace(seed: int) -> bytes:
        bench = Bench(MachineSpec(), seed)
        bench.run(0.5, steer_duty=0.4, drive_duty=0.6, blade_on=1).run(0.5, steer_duty=-0.7)
        return bench.state.tobytes()

    assert trace(1) == trace(1)
    assert trace(1) != trace(2)
