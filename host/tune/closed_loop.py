"""The firmware's steering loop closed round an identified actuator, in floating point.

The law is that of steering.cpp and pid.cpp (firmware/src/core) without their rounding; the bench
compares the two. Used to choose gains on the machine, where there is no bench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numba import njit

from host.link import protocol
from host.tune.actuator_model import TICK_S, ActuatorModel, Estimate, next_speed
from host.tune.step_response import Floats, Response, Step, judge

_SUB: Final = 5
"""Physics steps in a tick."""
LAW: Final = (
    "steer_kp",
    "steer_ki",
    "steer_kd",
    "steer_d_filter",
    "steer_min_duty",
    "steer_deadband",
    "steer_duty_max",
    "steer_duty_slew",
    "steer_slew",
)
"""The firmware's parameters that make the law."""
TUNED: Final = (*LAW, "stall_time")
"""Those that tuning writes."""


def defaults() -> dict[str, float]:
    """The law's parameters as the firmware is delivered."""
    specs = ((name, protocol.PARAMS[name]) for name in LAW)
    return {name: spec.from_raw(spec.default_raw) for name, spec in specs}


@njit(cache=True, nogil=True)
def _loop(law: Floats, plant: Floats, noise: Floats, start: float, target: float) -> Floats:
    """(2, n): angle in degrees and duty, one column per tick."""
    kp, ki, kd, filter_ms, floor, band, ceiling, growth, slew = law
    gain, lag, dead, friction, gap, min_left, min_right = plant
    n = len(noise)
    out = np.zeros((2, n))
    dt = TICK_S
    h = dt / _SUB
    decay = math.exp(-h / lag)
    delay = int(max(0.0, dead) / h + 0.5)
    queue = np.zeros(delay + 1)
    head = 0
    growth *= dt
    headroom = max(0.0, ceiling - floor)
    smooth_share = dt / (filter_ms * 1e-3 + dt)
    track = dt / (0.05 + dt)

    wheel = start
    shaft = start
    speed = 0.0
    setpoint = start
    integral = 0.0
    moved = 0.0
    last = start + noise[0]
    smooth = 0.0
    duty = 0.0
    sign = 0
    resting = True
    for k in range(n):
        # ---- the firmware
        measured = wheel + noise[k]
        step = slew * dt
        setpoint += min(step, max(-step, target - setpoint))
        error = setpoint - measured
        moved += (measured - last - moved) * smooth_share
        last = measured
        total = kp * error + integral - kd * moved / dt
        output = min(headroom, max(-headroom, total))
        grown = integral + ki * error * dt
        back = abs(output - total) * track
        if grown > 0.0:
            integral = max(0.0, grown - (back if total > output else 0.0))
        else:
            integral = min(0.0, grown + (back if total < output else 0.0))
        smooth += (error - smooth) / 8.0
        if abs(smooth) > band:
            resting = False
        if abs(smooth) * 3.0 <= band * 2.0 and abs(moved) / dt < 3.0:
            resting = True
        if resting:
            integral = 0.0
        output = round(output)
        if output >= 3:
            sign = 1
        if output <= -3:
            sign = -1
        if resting or output * sign <= 0:
            sign = 0
        wanted = 0.0 if sign == 0 else output + sign * floor
        base = duty if (duty > 0) == (wanted > 0) else 0.0
        most = abs(base) + growth
        duty = min(most, max(-most, wanted))
        out[0, k] = wheel
        out[1, k] = duty
        # ---- the actuator
        for _ in range(_SUB):
            queue[head] = duty
            head = (head + 1) % (delay + 1)
            u = queue[head] if delay > 0 else duty
            breakaway = min_left if u > 0 else min_right
            new = next_speed(speed, u, gain, friction, breakaway, decay, h / lag)
            shaft += 0.5 * (speed + new) * h
            speed = new
            wheel = min(max(wheel, shaft - 0.5 * gap), shaft + 0.5 * gap)
    return out


def respond(
    model: ActuatorModel, law: Mapping[str, float], step: Step, seed: int = 0
) -> tuple[Response, Floats]:
    """The loop's response to a step, and its (2, n) angle in degrees and duty per tick."""
    random = np.random.default_rng(seed)
    noise = random.normal(0.0, model.noise_deg, round(step.duration_s / TICK_S))
    plant = np.array(
        [
            model.gain_degps.value,
            model.lag_s.value,
            model.dead_time_s.value,
            model.friction_duty.value,
            model.backlash_deg.value,
            model.min_left,
            model.min_right,
        ]
    )
    values = np.array([law[name] for name in LAW])
    target = step.start_deg + step.size_deg
    trace: Floats = _loop(values, plant, noise, step.start_deg, target)
    return judge(trace[0], trace[1], TICK_S, step), trace


def varied(model: ActuatorModel, gain: float, friction: float, lag: float) -> ActuatorModel:
    """The actuator on another day: factors on its gain, friction and lag."""

    def times(estimate: Estimate, factor: float) -> Estimate:
        return Estimate(estimate.value * factor, estimate.sd * factor)

    return replace(
        model,
        gain_degps=times(model.gain_degps, gain),
        friction_duty=times(model.friction_duty, friction),
        lag_s=times(model.lag_s, lag),
        min_left=model.min_left * friction,
        min_right=model.min_right * friction,
    )
