"""The steering set up as an owner does it: `daranti identify --stops`, then `daranti tune pid`, by
the host's own code on the simulated machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final

from hil.bench.lockstep import Bench
from hil.studies.yard_wire import BenchWire
from host.link import protocol
from host.tune import closed_loop, experiments, pid_rules
from host.tune.actuator_model import ActuatorModel, fit
from host.tune.pot_calibration import SEARCH, calibrate_pot

Yard = Callable[[dict[str, float]], Bench]
"""The machine on free ground, its board with these parameters."""
RULE: Final = "optimise"
"""`daranti tune pid`'s default."""


def steering_setup(
    yard: Yard, parameters: Mapping[str, float], stop_deg: float
) -> tuple[dict[str, float], ActuatorModel]:
    """The parameters that the owner's commands write, and the model that they found. `stop_deg`:
    the wheel's angle at its stops as the owner has measured it. UserError as the commands'."""
    found = dict(parameters)
    with _experiments(yard, {**found, **SEARCH}) as (experimenter, held):
        found |= calibrate_pot(experimenter, held, stop_deg).params()
    with _experiments(yard, found) as (experimenter, _):
        model = fit(experimenter.identify())
    law = pid_rules.gains(RULE, model)
    return found | {name: law[name] for name in closed_loop.TUNED}, model


@contextmanager
def _experiments(
    yard: Yard, parameters: dict[str, float]
) -> Iterator[tuple[experiments.Experimenter, dict[str, float]]]:
    held = {name: spec.from_raw(spec.default_raw) for name, spec in protocol.PARAMS.items()}
    held |= parameters
    with yard(parameters) as bench, experiments.armed(BenchWire(bench), "the machine", held) as on:
        yield on, held
