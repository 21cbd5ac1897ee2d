"""`daranti-hil identify`: identification and tuning of simulated actuators, in lockstep.

The experiments, the fit and the gains are host's own; the bench knows the truth and says how far
off they were, and what the tuned firmware does on the very plant that it was tuned on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd

from hil.studies.actuators import (
    Firmware,
    Plant,
    Stand,
    calibration,
    deadline_s,
    set_params,
    step_response,
    truth,
)
from host.core.errors import UserError
from host.core.messages import Telemetry
from host.link import protocol
from host.link.session import Session
from host.tune import actuator_model, closed_loop, experiments, pid_rules
from host.tune.step_response import Step, cost, meets

POLL_S: Final = 0.001
"""The stand advances so far at each look."""
VERDICT: Final = Step(duration_s=3.0)
"""The step by which gains pass or not."""
STEPS: Final = (VERDICT, Step(size_deg=-30.0, duration_s=3.0), Step(size_deg=5.0))
"""What tuned and other gains are compared on; the figures are judged on the first."""
MIN_DUTY_OFF: Final = 3.0
"""Counts of 255 by which the minimum duties may be wrong, ..."""
SHARE_OFF: Final = 0.1
"""... and shares of gain and lag, ..."""
DURATION_S: Final = 60.0
"""... found within so long, for an identification to count as good."""


class StandWire:
    """A stand as a Wire: `poll` runs a millisecond."""

    def __init__(self, stand: Stand) -> None:
        self.session = Session()
        self._stand = stand

    @property
    def now(self) -> float:
        """The stand's time."""
        return self._stand.now

    def request(self, message: protocol.Message) -> None:
        """Sends a message."""
        self._stand.write(self.session.request(message))

    def poll(self) -> list[Telemetry]:
        """What the firmware sent in the next millisecond."""
        data = self._stand.advance(POLL_S)
        return self.session.feed(self._stand.now, data)


def defaults() -> dict[str, float]:
    """The firmware's parameters as it is delivered."""
    return {name: spec.from_raw(spec.default_raw) for name, spec in protocol.PARAMS.items()}


def identify_plant(
    plant: Plant, firmware: Firmware = "desk"
) -> tuple[actuator_model.Findings, actuator_model.ActuatorModel, float]:
    """Experiments and fit on one plant. Also returns the largest angle that the wheel had, deg."""
    spec = plant.machine()
    with Stand(spec, seed=plant.seed, log_s=120.0, firmware=firmware) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        set_params(stand, wire.session, calibration(spec.steering))
        with experiments.armed(wire, "stand", defaults()) as experimenter:
            findings = experimenter.identify()
        largest = float(np.degrees(np.abs(stand.log()["steer_angle"]).max()))
    return findings, actuator_model.fit(findings), largest


@dataclass(frozen=True, slots=True)
class Verdict:
    """How far an identification is off the truth."""

    gain_off: float
    """As a share of the true one."""
    lag_off: float
    min_left_off: float
    """Counts."""
    min_right_off: float
    backlash_off_deg: float
    duration_s: float
    largest_deg: float

    @property
    def good(self) -> bool:
        """Within the project's figures."""
        return (
            max(abs(self.gain_off), abs(self.lag_off)) <= SHARE_OFF
            and max(abs(self.min_left_off), abs(self.min_right_off)) <= MIN_DUTY_OFF
            and self.duration_s <= DURATION_S
        )


def verdict(plant: Plant, model: actuator_model.ActuatorModel, largest_deg: float) -> Verdict:
    """The model against the plant's physics."""
    spec = plant.machine()
    true = truth(spec)
    return Verdict(
        gain_off=model.gain_degps.value / true.gain_degps - 1,
        lag_off=model.lag_s.value / true.lag_s - 1,
        min_left_off=model.min_left - true.min_duty,
        min_right_off=model.min_right - true.min_duty,
        backlash_off_deg=model.backlash_deg.value - spec.steering.backlash_deg,
        duration_s=model.duration_s,
        largest_deg=largest_deg,
    )


def compare(
    plant: Plant, model: actuator_model.ActuatorModel, firmware: Firmware = "desk"
) -> dict[str, Any]:
    """Every rule's law, and the default one, on the plant with the firmware in the loop: mean cost
    over STEPS, whether the first step meets the figures, and the tuned gains. What else tuning
    writes is left out: each further message moves the step against the firmware's ticks."""
    spec = plant.machine()
    laws: dict[str, Mapping[str, float]] = {
        **{name: _law(pid_rules.gains(name, model)) for name in pid_rules.RULES},
        "defaults": closed_loop.defaults(),
    }
    row: dict[str, Any] = {}
    for name, law in laws.items():
        costs = []
        for step in STEPS:
            response, _ = step_response(plant, law, step, firmware)
            costs.append(cost(response, step, deadline_s(spec, step)))
            if step is VERDICT:
                row[f"{name}_meets"] = meets(response, step, deadline_s(spec, step))
                row[f"{name}_settle_s"] = response.settle_s
                row[f"{name}_overshoot"] = response.overshoot
        row[f"{name}_cost"] = float(np.mean(costs))
    margins = pid_rules.margins(model, laws["optimise"])
    row["phase_deg"] = margins.phase_deg
    row["sensitivity"] = margins.sensitivity
    row |= {name: laws["optimise"][name] for name in closed_loop.LAW}
    return row


def _law(gains: Mapping[str, float]) -> dict[str, float]:
    return {name: gains[name] for name in closed_loop.LAW}


def _one(plant: Plant, tune: bool, firmware: Firmware) -> dict[str, Any]:
    row: dict[str, Any] = {f"plant_{name}": getattr(plant, name) for name in Plant.__slots__}
    try:
        _, model, largest = identify_plant(plant, firmware)
    except UserError as error:
        return row | {"good": False, "error": str(error)}
    found = verdict(plant, model, largest)
    row |= {name: getattr(found, name) for name in Verdict.__slots__}
    row |= {"good": found.good, "error": ""}
    for name in ("gain_degps", "lag_s", "dead_time_s", "friction_duty", "backlash_deg"):
        estimate = getattr(model, name)
        row |= {name: estimate.value, f"{name}_sd": estimate.sd}
    return row | (compare(plant, model, firmware) if tune else {})


def campaign(
    plants: Sequence[Plant],
    *,
    tune: bool,
    workers: int = 2,
    firmware: Firmware = "desk",
    progress: Callable[[], None] = lambda: None,
) -> pd.DataFrame:
    """One row per plant, in order."""
    rows = []
    work = partial(_one, tune=tune, firmware=firmware)
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(work, plants):
            rows.append(row)
            progress()
    return pd.DataFrame(rows)


def summary_of(table: pd.DataFrame) -> dict[str, Any]:
    """The campaign's figures, worst cases first."""
    out: dict[str, Any] = {"plants": len(table), "good": int(table["good"].sum())}
    failed = table[table["error"] != ""]
    out["failed"] = len(failed)
    done = table[table["error"] == ""]
    for name in ("gain_off", "lag_off", "min_left_off", "min_right_off", "backlash_off_deg"):
        out[f"{name}_worst"] = round(float(done[name].abs().max()), 4)
        out[f"{name}_rms"] = round(math.sqrt(float((done[name] ** 2).mean())), 4)
    out["duration_s_worst"] = round(float(done["duration_s"].max()), 2)
    out["largest_deg"] = round(float(done["largest_deg"].max()), 2)
    for name in (*pid_rules.RULES, "defaults"):
        if f"{name}_cost" in done:
            out[f"{name}_meets"] = int(done[f"{name}_meets"].sum())
            out[f"{name}_cost_mean"] = round(float(done[f"{name}_cost"].mean()), 4)
            out[f"{name}_beaten"] = int((done["optimise_cost"] < done[f"{name}_cost"]).sum())
    if "phase_deg" in done:
        out["phase_deg_least"] = round(float(done["phase_deg"].min()), 1)
        out["sensitivity_worst"] = round(float(done["sensitivity"].max()), 3)
    return out
