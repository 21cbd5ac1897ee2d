"""Identification and tuning against actuators whose truth is known, the firmware in the loop."""

from __future__ import annotations

from dataclasses import replace
from statistics import mean

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
)
from hil.studies.identification import StandWire, compare, defaults, identify_plant, verdict
from host.core.errors import UserError
from host.core.messages import State, Telemetry
from host.link import protocol
from host.tune import closed_loop, experiments, on_machine
from host.tune.actuator_model import ActuatorModel, Findings
from host.tune.pot_calibration import calibrate_pot
from host.tune.step_response import Step

LIMIT_S = 15.0
"""Of the stand's time."""
PLANT = replace(population(1, 3, ranges=NOMINAL_RANGES)[0], slew_degps=55.0)


@pytest.fixture(scope="module")
def identified() -> tuple[Findings, ActuatorModel, float]:
    return identify_plant(PLANT)


def test_an_unknown_actuator_is_found_within_the_figures(
    identified: tuple[Findings, ActuatorModel, float],
) -> None:
    _, model, largest = identified
    found = verdict(PLANT, model, largest)
    assert found.good, found
    assert largest < 45.0
    assert model.fit_rms_deg < 0.3


def test_the_experiments_are_reproducible(
    identified: tuple[Findings, ActuatorModel, float],
) -> None:
    assert identify_plant(PLANT)[0] == identified[0]


def test_the_law_on_the_model_behaves_as_the_firmware_on_the_machine(
    identified: tuple[Findings, ActuatorModel, float],
) -> None:
    """On average: the noise of a potentiometer moves a small step's error by a twentieth."""
    _, model, _ = identified
    seeds = range(8)
    for law in (closed_loop.defaults(), closed_loop.defaults() | {"steer_kp": 25.0}):
        for step in (Step(), Step(size_deg=-12.0)):
            guessed = [closed_loop.respond(model, law, step, seed)[0] for seed in seeds]
            plants = [replace(PLANT, seed=PLANT.seed + seed) for seed in seeds]
            real = [step_response(plant, law, step)[0] for plant in plants]
            assert mean(one.settle_s for one in guessed) == pytest.approx(
                mean(one.settle_s for one in real), abs=0.1
            )
            assert mean(one.error_s for one in guessed) == pytest.approx(
                mean(one.error_s for one in real), rel=0.08
            )


def test_tuned_gains_meet_the_figures_and_cost_least(
    identified: tuple[Findings, ActuatorModel, float],
) -> None:
    row = compare(PLANT, identified[1])
    assert row["optimise_meets"]
    for rival in ("defaults", "agopen", "ziegler-nichols"):
        assert row["optimise_cost"] < row[f"{rival}_cost"] * 1.05, (
            rival
        )  # on one plant; the mean of many is lower
    assert row["sensitivity"] < 2.0


def test_an_armed_experiment_ends_in_stop_whatever_happens() -> None:
    with Stand(PLANT.machine(), log_s=10.0) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        with (
            pytest.raises(KeyboardInterrupt),
            experiments.armed(wire, "stand", defaults()) as running,
        ):
            running.drive(120, 0.3)
            assert stand.target.pwm(9) == 120
            raise KeyboardInterrupt
        for _ in range(40):
            wire.poll()
        assert stand.target.pwm(9) == 0
        assert wire.session.telemetry is not None
        assert wire.session.telemetry.state is State.SAFE


def test_a_motor_wired_the_wrong_way_is_told_before_it_runs_far() -> None:
    spec = PLANT.machine()
    with Stand(spec, log_s=20.0) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        ends = calibration(spec.steering)
        exchanged = ends | {"pot_left": ends["pot_right"], "pot_right": ends["pot_left"]}
        set_params(stand, wire.session, exchanged)
        with (
            pytest.raises(UserError, match="motor and potentiometer disagree"),
            experiments.armed(wire, "stand", defaults()) as running,
        ):
            running.identify()
        assert np.degrees(np.abs(stand.log()["steer_angle"]).max()) < 15.0


def test_a_board_that_is_no_longer_heard_ends_the_experiment() -> None:
    """Its wire to the laptop is broken, and it takes what is sent: waiting would never end."""

    class Deaf(StandWire):
        def poll(self) -> list[Telemetry]:
            heard = super().poll()
            assert self.now < LIMIT_S, "it waits for ever"
            return heard if self.now < 1.0 else []

    with Stand(PLANT.machine(), log_s=20.0) as stand:
        wire = Deaf(stand)
        stand.advance(0.02)
        with (
            pytest.raises(UserError, match="no telemetry for 1 s"),
            experiments.armed(wire, "stand", defaults()) as running,
        ):
            running.identify()


def test_a_jammed_steering_is_told() -> None:
    with Stand(PLANT.machine(), log_s=20.0) as stand:
        stand.given["steer_jam"] = 1
        wire = StandWire(stand)
        stand.advance(0.02)
        with (
            pytest.raises(UserError, match=r"does not move|stalled|frozen"),
            experiments.armed(wire, "stand", defaults()) as running,
        ):
            running.identify()


def test_a_steering_that_creeps_is_not_called_stuck_alone() -> None:
    with pytest.raises(UserError, match=r"or by less than 1\.5 degrees in 0\.25 s: .* its gear"):
        identify_plant(replace(PLANT, slew_degps=8.0))


def test_a_machine_in_fault_is_not_armed() -> None:
    with Stand(replace(PLANT, battery_v=8.0).machine()) as stand:
        wire = StandWire(stand)
        stand.advance(1.5)
        with (
            pytest.raises(UserError, match="battery below its limit"),
            experiments.armed(wire, "stand", defaults()),
        ):
            pass


def test_the_stops_calibrate_the_potentiometer() -> None:
    spec = Plant(slew_degps=40.0, pot_counts_per_deg=4.2).machine()
    moved = spec.steering.model_copy(update={"pot_centre_counts": 525.0})
    spec = spec.model_copy(update={"steering": moved})
    wide = {"angle_left": 10.0, "angle_right": -10.0}
    with Stand(spec, log_s=100.0) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        set_params(stand, wire.session, wide)
        wire.request(protocol.Clear())  # the reading jumped with its calibration
        stand.advance(0.05)
        with experiments.armed(wire, "stand", defaults()) as running:
            found = calibrate_pot(running, defaults() | wide, spec.steering.stop_deg)
    assert found.centre_counts == pytest.approx(525.0, abs=2.0)
    assert found.left_counts == pytest.approx(525 + 4.2 * 54, abs=3.0)
    assert set(found.params()) <= set(protocol.PARAMS)


def test_a_step_is_verified_over_the_link() -> None:
    with Stand(PLANT.machine(), log_s=20.0) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        set_params(stand, wire.session, calibration(PLANT.machine().steering))
        step = Step(size_deg=30.0, start_deg=-15.0, duration_s=3.0)
        response, trace = on_machine.verify(wire, "stand", step)
        truly, _ = step_response(PLANT, {}, Step(duration_s=3.0))
        assert response.settle_s == pytest.approx(truly.settle_s, abs=0.1)
        assert trace[0, -1] == pytest.approx(15.0, abs=0.6)
