"""A step of the steering: how it went, what it costs, and whether it is good enough."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEADY_DEG: Final = 0.5
"""Steady error that the figures allow; what lies below is the potentiometer's noise."""
OVERSHOOT: Final = 0.05
"""Share of the step that a response may overshoot."""
SETTLE_S: Final = 0.8
"""Within which a quick actuator has settled."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the setpoint, and what counts as having followed it."""

    size_deg: float = 30.0
    start_deg: float = 0.0
    duration_s: float = 2.5
    rest_s: float = 0.6
    """The end of the response that is judged for steady error and chatter."""

    @property
    def band_deg(self) -> float:
        """Within this it has settled: 2 % of the step, or the steady error allowed if larger."""
        return max(0.02 * abs(self.size_deg), STEADY_DEG)


@dataclass(frozen=True, slots=True)
class Response:
    """How a step went, by the angle that the loop can know."""

    settle_s: float
    """From the command until it stays within the band; the duration where it never does."""
    overshoot: float
    """Beyond the target, as a share of the step."""
    steady_error_deg: float
    """Largest, at rest."""
    true_error_deg: float
    """Mean, at rest, of the wheel itself, where that is known: with the potentiometer's bend."""
    starts: int
    """How often the motor was switched on at rest."""
    error_s: float
    """Integral of |error| over the step's size."""
    energy_j: float
    """Drawn by the motor, where that is known."""
    reversals: int
    """Changes of the duty's sign during the whole response."""
    largest_deg: float
    """Of the wheel's angle."""
    faults: int
    """Bits of protocol.Fault at the end."""


def judge(
    angle_deg: Floats,
    duty: Floats,
    dt: float,
    step: Step,
    *,
    truly_deg: Floats | None = None,
    energy_j: float = 0.0,
    faults: int = 0,
) -> Response:
    """The figures of a response: (n,) samples every `dt` seconds from the command on. duty in any
    unit; `truly_deg` the wheel's own angle."""
    truly = angle_deg if truly_deg is None else truly_deg
    size = abs(step.size_deg)
    target = step.start_deg + step.size_deg
    error = math.copysign(1.0, step.size_deg) * (target - angle_deg)
    outside = np.nonzero(np.abs(error) > step.band_deg)[0]
    settled = 0 if len(outside) == 0 else int(outside[-1]) + 1
    rest = max(1, round(step.rest_s / dt))
    on = duty[-rest:] != 0
    signs = np.sign(duty[duty != 0])
    return Response(
        settle_s=min(step.duration_s, settled * dt),
        overshoot=max(0.0, float(-error.min()) / size),
        steady_error_deg=float(np.abs(error[-rest:]).max()),
        true_error_deg=abs(float(np.mean(target - truly[-rest:]))),
        starts=int(np.count_nonzero(on[1:] & ~on[:-1])) + int(on[0]),
        error_s=float(np.abs(error).sum()) * dt / size,
        energy_j=energy_j,
        reversals=int(np.count_nonzero(signs[1:] != signs[:-1])),
        largest_deg=float(np.abs(truly).max()),
        faults=faults,
    )


def deadline_s(slew_degps: float, lag_s: float, step: Step) -> float:
    """By when a step must have settled: 0.8 s, or what the motor needs at full duty to travel to
    the band, spin up and brake, where that is longer. 30 degrees in 0.8 s takes some 50 deg/s."""
    travel = abs(step.size_deg) - step.band_deg
    return max(SETTLE_S, travel / slew_degps + 2.5 * lag_s)


def meets(response: Response, step: Step, deadline: float) -> bool:
    """Whether a response holds the step figures: settled by the deadline, overshoot at most 5 % (or
    half a degree), steady error at most half a degree, the motor off at rest, no fault."""
    size = abs(step.size_deg)
    return (
        response.settle_s <= deadline
        and response.overshoot * size <= max(OVERSHOOT * size, STEADY_DEG)
        and response.steady_error_deg <= STEADY_DEG
        and response.starts == 0
        and response.faults == 0
    )


@dataclass(frozen=True, slots=True)
class Weights:
    """What a response costs."""

    tracking: float = 1.0
    """Per second of the normalised error's integral."""
    settling: float = 2.0
    """Per second after the deadline."""
    overshoot: float = 10.0
    """Per share of the step beyond what `meets` allows, and a tenth of it below."""
    steady: float = 2.0
    """Per degree beyond half a degree, and a tenth of it below."""
    chatter: float = 0.05
    """Per start of the motor at rest, and a fifth of it per reversal."""
    energy: float = 0.005
    """Per joule."""
    fault: float = 10.0


def cost(response: Response, step: Step, deadline: float, weights: Weights | None = None) -> float:
    """The weighted sum; smaller is better. Comparable on one plant and step only."""
    w = weights or Weights()
    size = abs(step.size_deg)
    over = max(0.0, response.overshoot - max(OVERSHOOT, STEADY_DEG / size))
    late = max(0.0, response.settle_s - deadline)
    beyond = max(0.0, response.steady_error_deg - STEADY_DEG)
    return (
        w.tracking * response.error_s
        + w.settling * late
        + w.overshoot * (over + 0.1 * response.overshoot)
        + w.steady * (beyond + 0.1 * response.steady_error_deg)
        + w.chatter * (response.starts + 0.2 * response.reversals)
        + w.energy * response.energy_j
        + w.fault * (response.faults != 0)
    )
