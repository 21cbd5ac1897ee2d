"""The steering stand: the firmware and one actuator, and how step responses are judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.scenario.drawn_machine import NOMINAL_RANGES
from hil.studies.actuators import (
    Plant,
    Stand,
    calibration,
    population,
    set_params,
    step_response,
    truth,
)
from host.core.errors import UserError
from host.link import protocol
from host.link.session import Session
from host.tune.step_response import Step, judge, meets
from sim_plant import machine

GAINS = {"steer_kp": 75.0, "steer_ki": 55.0, "steer_kd": 3.0}
FAST = Plant(slew_degps=57.0)


def test_the_same_step_gives_the_same_bits() -> None:
    first, log = step_response(FAST, GAINS)
    again, log_again = step_response(FAST, GAINS)
    assert first == again
    assert log.tobytes() == log_again.tobytes()
    other, _ = step_response(replace(FAST, seed=1), GAINS)
    assert other != first


def test_an_actuator_that_is_fast_enough_meets_the_step_figures() -> None:
    response, _ = step_response(FAST, GAINS)
    assert response.settle_s <= 0.8
    assert response.overshoot <= 0.05
    assert response.steady_error_deg <= 0.5
    assert response.starts == 0
    assert response.faults == 0


@pytest.mark.parametrize("size", [30.0, -30.0])
def test_the_figures_do_not_depend_on_the_side(size: float) -> None:
    response, _ = step_response(FAST, GAINS, Step(size_deg=size))
    assert meets(response, Step(size_deg=size), 0.8)


def test_with_hardly_any_gain_the_wheel_stays_away_from_its_target() -> None:
    response, _ = step_response(FAST, {"steer_kp": 1.0, "steer_ki": 0.0, "steer_min_duty": 0.0})
    assert response.settle_s == Step().duration_s
    assert response.steady_error_deg > 5.0


def test_a_parameter_that_the_firmware_lacks_or_refuses_is_an_error() -> None:
    with pytest.raises(UserError, match="no parameter 'steer_magic'"):
        step_response(FAST, {"steer_magic": 1.0})
    with pytest.raises(UserError, match="steer_kp must be 0 to 100"):
        step_response(FAST, {"steer_kp": 101.0})


def test_parameters_are_refused_while_the_machine_is_armed() -> None:
    with Stand(FAST.machine()) as stand:
        session = Session()
        stand.advance(0.01)
        stand.write(session.request(protocol.Arm(protocol.VERSION)))
        stand.advance(0.02)
        with pytest.raises(UserError, match="took 0 of 3"):
            set_params(stand, session, calibration(FAST.machine().steering))


def test_truth_is_what_the_plant_does_at_constant_duty() -> None:
    """At rest voltage; the sag of the battery under current takes a little."""
    plant = Plant(backlash_deg=0.0, pot_noise_counts=0.0)
    spec = plant.machine()
    true = truth(spec)
    state, params, given = machine.initial(spec), machine.parameters(spec), machine.inputs()
    duty = 150.0
    given["steer_duty"] = duty / 255
    angles = []
    for _ in range(700):
        machine.step(state, params, given, 0.001)
        angles.append(float(np.degrees(state["steer_angle"][0])))
    speed = (angles[-1] - angles[-200]) / 0.199
    assert speed == pytest.approx(true.gain_degps * (duty - true.friction_duty), rel=0.03)
    rise = np.diff(angles) / 0.001
    lag = float(np.argmax(rise > (1 - np.exp(-1)) * speed)) * 0.001
    assert lag == pytest.approx(true.lag_s, rel=0.05)


def test_the_minimum_duty_divides_rest_from_motion() -> None:
    spec = Plant(backlash_deg=0.0).machine()
    moved = []
    for duty in (truth(spec).min_duty - 1.0, truth(spec).min_duty + 1.0):
        state, params, given = machine.initial(spec), machine.parameters(spec), machine.inputs()
        given["steer_duty"] = duty / 255
        for _ in range(300):
            machine.step(state, params, given, 0.001)
        moved.append(bool(state["steer_angle"][0] > 0))
    assert moved == [False, True]


def test_a_population_is_reproducible_and_within_its_ranges() -> None:
    plants = population(30, 4)
    assert plants == population(30, 4)
    assert plants != population(30, 5)
    for name, (low, high) in NOMINAL_RANGES.items():
        values = [getattr(plant, name) for plant in plants]
        assert low <= min(values) < max(values) <= high


def test_chatter_overshoot_and_late_settling_are_seen() -> None:
    step = Step(size_deg=10.0, duration_s=2.0, rest_s=0.5)
    time = np.arange(400) * 0.005
    angle = 10.0 * (1 - np.exp(-time / 0.1)) + np.where((time > 0.9) & (time < 1.0), 1.5, 0.0)
    duty = np.where(time < 0.6, 100.0, 0.0)
    duty[-50:-40] = 60.0
    seen = judge(angle, duty, 0.005, step)
    assert seen.settle_s == pytest.approx(1.0, abs=0.01)
    assert seen.overshoot == pytest.approx(0.15, abs=0.01)
    assert seen.starts == 1
    assert not meets(seen, step, 0.8)
