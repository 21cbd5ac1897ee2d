"""What the steering actuator is: the model that explains the experiments, and its fit.

Pure arithmetic on what `host.tune.experiments` recorded.

Model, with the duty u in counts, the motor's speed v and the wheel's angle behind the backlash:
    moves off when |u| > min_duty;  lag_s * dv/dt = gain * (u - friction_duty * sign(v)) - v
The motor coasts at zero duty, so runs are fitted from rest to their release only.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.whole_file import save_text

Floats = NDArray[np.float64]

TICK_S: Final = 0.005
"""Of the firmware (firmware/src/core/controller.h): a duty changes on this grid."""
_STEP_S: Final = 0.001
"""Of the simulation; a fifth of the firmware's tick."""
_STARTS: Final = ((0.05, 0.5), (0.05, 2.0), (0.1, 0.5), (0.1, 2.0))
"""Lag (s) and backlash (deg) that a fit starts from: the ends of what steering motors have."""


@dataclass(frozen=True, slots=True)
class Run:
    """One excitation from rest to its release. Times are the firmware's, from the first edge on."""

    kind: str
    edges_s: tuple[float, ...]
    """When each duty began; the last entry is the release."""
    duties: tuple[int, ...]
    slack: bool
    """Whether the backlash was open: the last motion went the other way."""
    time_s: tuple[float, ...]
    """Of the samples."""
    angle_deg: tuple[float, ...]
    start_deg: float
    """Mean at rest before."""


@dataclass(frozen=True, slots=True)
class Findings:
    """All that the experiments recorded."""

    runs: tuple[Run, ...]
    min_left: float
    min_right: float
    noise_deg: float
    """Standard deviation of the resting angle."""
    battery_v: float
    relay_gain: float
    """Duty per degree: describing-function estimate of the ultimate gain; 0 where it failed."""
    relay_period_s: float
    duration_s: float


def speed_of(run: Run) -> float:
    """deg/s over the second half of a step, at least 1."""
    half = len(run.time_s) // 2
    slope = np.polyfit(run.time_s[half:], run.angle_deg[half:], 1)[0]
    return max(1.0, abs(float(slope)))


def relay_figures(run: Run) -> tuple[float, float]:
    """Ultimate gain (duty/deg) and period (s) by the relay's describing function (Åström and
    Hägglund 1984) from the oscillation's second half; zeros where there is none."""
    edges = np.array(run.edges_s[1:-1])
    if len(edges) < 6:
        return 0.0, 0.0
    late = edges[len(edges) // 2 :]
    period = 2 * float(np.mean(np.diff(late)))
    time, angle = np.array(run.time_s), np.array(run.angle_deg)
    tail = angle[time >= late[0]]
    if len(tail) == 0:
        return 0.0, 0.0
    swing = float(np.percentile(tail, 97) - np.percentile(tail, 3)) / 2
    if swing <= 0:
        return 0.0, 0.0
    return 4 * abs(run.duties[0]) / (math.pi * swing), period


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its standard deviation."""

    value: float
    sd: float

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} ± {self.sd:{spec}}"


@dataclass(frozen=True, slots=True)
class ActuatorModel:
    """The steering actuator. Duties in counts of 255."""

    gain_degps: Estimate
    """deg/s per count."""
    lag_s: Estimate
    """Time constant of the speed."""
    dead_time_s: Estimate
    """From the firmware's tick to the motor; the sampling of the angle counts against it."""
    friction_duty: Estimate
    """What friction costs in motion."""
    backlash_deg: Estimate
    min_left: float
    """Duty that just moves the wheel, either way."""
    min_right: float
    noise_deg: float
    battery_v: float
    relay_gain: float
    relay_period_s: float
    fit_rms_deg: float
    duration_s: float

    @property
    def slew_degps(self) -> float:
        """At full duty: the actuator's rate limit."""
        return self.gain_degps.value * (255.0 - self.friction_duty.value)

    def save(self, path: Path) -> None:
        """Writes JSON."""
        save_text(path, json.dumps(asdict(self), indent=1))

    @classmethod
    def load(cls, path: Path) -> ActuatorModel:
        """Reads what `save` wrote. Raises UserError where it is not that."""
        check_input(path, "the model")
        try:
            raw: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            pairs = {k: Estimate(**v) if isinstance(v, dict) else float(v) for k, v in raw.items()}
            return cls(**pairs)  # type: ignore[arg-type]
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}; run `daranti identify` first") from error
        except (ValueError, TypeError, AttributeError) as error:
            raise UserError(f"{path} is no actuator model: {error}") from error


@njit(cache=True, nogil=True)
def next_speed(
    speed: float,
    duty: float,
    gain: float,
    friction: float,
    breakaway: float,
    decay: float,
    share: float,
) -> float:
    """The motor's speed (deg/s) a step later. `share`: the step's share of the lag; `decay`: its
    exponential, exp(-share)."""
    if speed == 0.0:
        if abs(duty) <= breakaway:
            return 0.0
        return gain * (duty - math.copysign(friction, duty)) * (1.0 - decay)
    if duty == 0.0:
        new = speed - math.copysign(gain * friction * share, speed)
    else:
        final = gain * (duty - math.copysign(friction, speed))
        new = final + (speed - final) * decay
    return 0.0 if speed * new < 0.0 else new


@njit(cache=True, nogil=True)
def _simulate(
    edges: Floats,
    duties: Floats,
    times: Floats,
    gain: float,
    lag: float,
    dead: float,
    friction: float,
    breakaway: float,
    gap: float,
    slack: float,
) -> Floats:
    """The wheel's angle, from 0 at rest, at `times`. slack: how far the motor runs before it
    carries the wheel the way of the first duty."""
    out = np.zeros(len(times))
    way = 1.0 if duties[0] > 0 else -1.0
    shaft = 0.0
    # The wheel stays between the shaft's two flanks, `low` and `high` from it.
    low = -slack if way > 0 else -(gap - slack)
    high = gap - slack if way > 0 else slack
    wheel = 0.0
    speed = 0.0
    decay = math.exp(-_STEP_S / lag)
    now = 0.0
    row = 0
    last_wheel = 0.0
    edge = -1
    while row < len(times) and now < 20.0:
        # The step's mean duty: the model is smooth in the dead time.
        duty = 0.0
        begun = now
        while edge + 1 < len(duties) and edges[edge + 1] + dead < now + _STEP_S:
            changed = max(now, edges[edge + 1] + dead)
            duty += (changed - begun) * (duties[edge] if edge >= 0 else 0.0)
            begun = changed
            edge += 1
        duty += (now + _STEP_S - begun) * (duties[edge] if edge >= 0 else 0.0)
        duty /= _STEP_S
        while row < len(times) and times[row] <= now:
            share = 1.0 - (now - times[row]) / _STEP_S
            out[row] = last_wheel + max(0.0, share) * (wheel - last_wheel)
            row += 1
        new = next_speed(speed, duty, gain, friction, breakaway, decay, _STEP_S / lag)
        shaft += 0.5 * (speed + new) * _STEP_S
        speed = new
        last_wheel = wheel
        wheel = min(max(wheel, shaft + low), shaft + high)
        now += _STEP_S
    return out


def predict(run: Run, model: ActuatorModel) -> Floats:
    """The angle that the model gives at the run's samples, degrees, less the run's start."""
    values = (
        model.gain_degps.value,
        model.lag_s.value,
        model.dead_time_s.value,
        model.friction_duty.value,
        model.backlash_deg.value,
    )
    return _predict(run, np.array(values), model.min_left, model.min_right)


def _predict(run: Run, values: Floats, min_left: float, min_right: float) -> Floats:
    gain, lag, dead, friction, gap = values.tolist()
    breakaway = min_left if run.duties[0] > 0 else min_right
    angles: Floats = _simulate(
        np.array(run.edges_s[:-1]),
        np.array(run.duties, float),
        np.array(run.time_s),
        gain,
        lag,
        dead,
        friction,
        breakaway,
        gap,
        gap if run.slack else 0.0,
    )
    return angles


def fit(findings: Findings) -> ActuatorModel:
    """Least squares over all runs at once. Raises UserError where the runs tell too little."""
    runs = [run for run in findings.runs if len(run.time_s) >= 5]
    if len(runs) < 4:
        raise UserError(f"only {len(runs)} usable runs: too few to fit a model")
    low = min(findings.min_left, findings.min_right)
    lower = np.array([1e-3, 0.005, -0.01, 0.0, 0.0])
    upper = np.array([5.0, 1.0, 0.1, max(2.0, low), 6.0])
    scale = np.array([0.1, 0.05, 0.01, 20.0, 1.0])

    def residuals(values: Floats) -> Floats:
        parts = []
        for run in runs:
            error = _predict(run, values, findings.min_left, findings.min_right)
            parts.append(error + run.start_deg - np.array(run.angle_deg))
        return np.concatenate(parts)

    def solve(lag: float, gap: float) -> Any:
        start = np.array([_first_gain(runs, low), lag, 0.002, 0.8 * low, gap])
        return least_squares(
            residuals, np.clip(start, lower + 1e-4, upper - 1e-4), bounds=(lower, upper),
            x_scale=scale, diff_step=1e-3, loss="soft_l1", f_scale=0.5,
        )  # fmt: skip

    # Lag and backlash delay alike: from one start only, one may be taken for the other.
    best = min((solve(*start) for start in _STARTS), key=lambda solution: float(solution.cost))
    errors = residuals(best.x)
    variance = float(errors @ errors) / max(1, len(errors) - len(lower))
    try:
        sd = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)) * variance)
    except np.linalg.LinAlgError as error:
        raise UserError("the runs do not determine the model: the steering hardly moved") from error
    gain, lag, dead, friction, gap = (
        Estimate(float(value), float(error)) for value, error in zip(best.x, sd, strict=True)
    )
    return ActuatorModel(
        gain_degps=gain,
        lag_s=lag,
        dead_time_s=dead,
        friction_duty=friction,
        backlash_deg=gap,
        min_left=findings.min_left,
        min_right=findings.min_right,
        noise_deg=findings.noise_deg,
        battery_v=findings.battery_v,
        relay_gain=findings.relay_gain,
        relay_period_s=findings.relay_period_s,
        fit_rms_deg=math.sqrt(variance),
        duration_s=findings.duration_s,
    )


def _first_gain(runs: Sequence[Run], friction: float) -> float:
    """deg/s per count from the fastest stretch of each step."""
    gains = []
    for run in runs:
        if run.kind == "step" and len(run.time_s) >= 8:
            gains.append(speed_of(run) / max(10.0, abs(run.duties[0]) - 0.8 * friction))
    return float(np.median(gains)) if gains else 0.2
