"""The fit and the rules on data that they themselves explain; no machine."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.core.errors import UserError
from host.link import protocol
from host.tune import closed_loop, pid_rules
from host.tune.actuator_model import (
    ActuatorModel,
    Estimate,
    Findings,
    Run,
    fit,
    next_speed,
    predict,
    relay_figures,
)
from host.tune.pot_calibration import PotCalibration, counts_of
from host.tune.stall_time import stall_time_ms
from host.tune.step_response import Step


def actuator(
    gain: float = 0.2, lag: float = 0.07, friction: float = 33.0, backlash: float = 1.0
) -> ActuatorModel:
    return ActuatorModel(
        gain_degps=Estimate(gain, 0.0),
        lag_s=Estimate(lag, 0.0),
        dead_time_s=Estimate(0.002, 0.0),
        friction_duty=Estimate(friction, 0.0),
        backlash_deg=Estimate(backlash, 0.0),
        min_left=friction / 0.75,
        min_right=friction / 0.75,
        noise_deg=0.09,
        battery_v=12.4,
        relay_gain=0.0,
        relay_period_s=0.0,
        fit_rms_deg=0.0,
        duration_s=0.0,
    )


def runs_of(model: ActuatorModel, noise_deg: float) -> tuple[Run, ...]:
    random = np.random.default_rng(0)
    plays = [
        ((0.0, 0.8), (200,), True),
        ((0.0, 0.8), (-200,), True),
        ((0.0, 0.9), (110,), True),
        ((0.0, 0.9), (-110,), False),
        ((0.0, 0.2, 0.45, 0.6, 1.0), (200, -200, 200, -200), True),
        ((0.0, 0.3, 0.4, 0.7, 0.9), (200, -200, 200, -200), False),
    ]
    runs = []
    for edges, duties, slack in plays:
        time = tuple(np.arange(0.004, edges[-1], 0.02).tolist())
        blank = Run("step", edges, duties, slack, time, (0.0,) * len(time), 5.0)
        angle = predict(blank, model) + 5.0 + random.normal(0, noise_deg, len(time))
        runs.append(replace(blank, angle_deg=tuple(angle.tolist())))
    return tuple(runs)


def findings(model: ActuatorModel, noise_deg: float = 0.09) -> Findings:
    runs = runs_of(model, noise_deg)
    return Findings(runs, model.min_left, model.min_right, noise_deg, 12.4, 0.0, 0.0, 30.0)


@pytest.mark.parametrize("gain", [0.08, 0.25])
@pytest.mark.parametrize("lag", [0.05, 0.1])
@pytest.mark.parametrize("backlash", [0.5, 2.0])
def test_the_fit_finds_the_model_that_made_the_data(
    gain: float, lag: float, backlash: float
) -> None:
    found = fit(findings(actuator(gain, lag, 40.0, backlash)))
    assert found.gain_degps.value == pytest.approx(gain, rel=0.04)
    assert found.lag_s.value == pytest.approx(lag, rel=0.1)
    assert found.backlash_deg.value == pytest.approx(backlash, abs=0.2)


def test_the_uncertainty_grows_with_the_noise() -> None:
    calm, loud = fit(findings(actuator(), 0.03)), fit(findings(actuator(), 0.3))
    assert loud.gain_degps.sd > 3 * calm.gain_degps.sd
    assert loud.fit_rms_deg == pytest.approx(0.3, rel=0.2)


def test_too_few_runs_are_refused() -> None:
    some = findings(actuator())
    with pytest.raises(UserError, match="too few"):
        fit(replace(some, runs=some.runs[:2]))


def test_a_run_waits_for_its_breakaway_and_its_backlash() -> None:
    model = actuator(gain=0.2, friction=33.0, backlash=2.0)
    time = tuple(np.arange(0, 1.0, 0.02).tolist())
    weak = Run("step", (0.0, 1.0), (40,), True, time, (0.0,) * len(time), 0.0)
    assert np.all(predict(weak, model) == 0.0)
    strong = replace(weak, duties=(200,))
    closed = replace(strong, slack=False)
    assert predict(closed, model)[-1] - predict(strong, model)[-1] == pytest.approx(2.0, abs=0.01)
    assert predict(replace(strong, duties=(-200,)), model)[-1] < -10


def test_friction_stops_a_motor_and_does_not_turn_it_back() -> None:
    slowing = [next_speed(v, 0.0, 0.2, 30.0, 40.0, math.exp(-0.1), 0.1) for v in (5.0, 0.5, -0.5)]
    assert slowing == [pytest.approx(5.0 - 0.2 * 30.0 * 0.1), 0.0, 0.0]


def test_a_model_survives_its_file(tmp_path: Path) -> None:
    model = actuator()
    model.save(tmp_path / "model.json")
    assert ActuatorModel.load(tmp_path / "model.json") == model
    (tmp_path / "bad.json").write_text('{"gain_degps": 3}', encoding="utf-8")
    with pytest.raises(UserError, match="no actuator model"):
        ActuatorModel.load(tmp_path / "bad.json")
    with pytest.raises(UserError, match="run `daranti identify` first"):
        ActuatorModel.load(tmp_path / "missing.json")


def test_the_relay_gives_the_describing_functions_gain() -> None:
    time = np.arange(0, 4, 0.02)
    angle = 2.0 * np.sin(2 * math.pi * time / 0.5)
    edges = (0.0, *np.arange(0.25, 3.9, 0.25).tolist(), 4.0)
    duties = tuple(100 if k % 2 else -100 for k in range(len(edges) - 1))
    run = Run("relay", edges, duties, False, tuple(time.tolist()), tuple(angle.tolist()), 0.0)
    gain, period = relay_figures(run)
    assert period == pytest.approx(0.5)
    assert gain == pytest.approx(4 * 100 / (math.pi * 2.0), rel=0.05)


@given(
    st.floats(0.05, 0.35), st.floats(0.03, 0.12), st.floats(10.0, 80.0), st.sampled_from(
        [rule for rule in pid_rules.RULES if rule != "optimise"]
    )
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_every_rule_stays_within_the_firmwares_ranges(
    gain: float, lag: float, friction: float, rule: str
) -> None:
    for name, value in pid_rules.gains(rule, actuator(gain, lag, friction)).items():
        spec = protocol.PARAMS[name]
        assert spec.from_raw(spec.to_raw(value)) == value


def test_a_stiff_steering_is_given_more_time_to_show_that_it_turns() -> None:
    stiff = actuator(friction=63.0)
    usual = stall_time_ms(stiff.slew_degps, stiff.backlash_deg.value)
    assert pid_rules.gains("optimise", stiff)["stall_time"] > usual + 20.0
    light = actuator(friction=33.0)
    by_speed = stall_time_ms(light.slew_degps, light.backlash_deg.value)
    assert pid_rules.gains("lambda", light)["stall_time"] == by_speed


def test_at_the_ultimate_gain_the_loop_is_at_the_edge() -> None:
    model = actuator()
    ku, pu = pid_rules.ultimate(model)
    law = closed_loop.defaults() | {"steer_kp": ku, "steer_ki": 0.0, "steer_kd": 0.0}
    opened, _ = pid_rules.loops(model, law)
    gain, _, _, crossing, _, _ = control.stability_margins(opened)
    assert gain == pytest.approx(1.0, rel=0.03)
    assert crossing == pytest.approx(2 * math.pi / pu, rel=0.03)


def test_both_ways_to_the_sensitivity_agree() -> None:
    model, law = actuator(), closed_loop.defaults()
    by_control = pid_rules.margins(model, law).sensitivity
    assert pid_rules.sensitivity(model, law) == pytest.approx(by_control, rel=0.02)


def test_optimised_gains_beat_the_rules_on_the_model() -> None:
    model = actuator()
    law = pid_rules.optimise(model, samples=60)
    best = pid_rules.figure(model, law)
    for rule in ("lambda", "ziegler-nichols", "astrom-hagglund", "agopen"):
        assert best < pid_rules.figure(model, pid_rules.gains(rule, model))


def test_the_loop_rests_without_chatter_and_brakes_before_the_target() -> None:
    response, trace = closed_loop.respond(actuator(), closed_loop.defaults(), Step())
    assert response.starts == 0
    assert response.overshoot < 0.05
    assert trace[1, 10:60].max() == 255.0
    assert np.all(trace[1, -100:] == 0.0)


@given(st.floats(-50, 50))
def test_counts_of_inverts_the_firmwares_calibration(angle: float) -> None:
    params = PotCalibration(740.0, 280.0, 50.0).params()
    counts = counts_of(angle, params)
    side = "left" if angle >= 0 else "right"
    span = params[f"pot_{side}"] - params["pot_centre"]
    back = (counts - params["pot_centre"]) / span * params[f"angle_{side}"]
    assert back == pytest.approx(angle, abs=1e-9)
