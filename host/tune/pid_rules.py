"""The steering loop's gains from an identified actuator, and the loop's margins.

Three ways to gains: lambda tuning (pole placement on gain, lag and dead time), relay rules
(Ziegler-Nichols; Åström and Hägglund 1984 for a phase margin), and direct optimisation of the
step figures on the firmware's law round the model, today's and other days' versions of it.
Margins and the sensitivity's peak are of the loop without friction, backlash and limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import control
import numpy as np
from scipy.optimize import minimize

from host.link import protocol
from host.tune import closed_loop
from host.tune.actuator_model import TICK_S, ActuatorModel
from host.tune.stall_time import share_at_least_duty, stall_time_ms
from host.tune.step_response import Floats, Step, cost, deadline_s, meets

Gains = dict[str, float]

PHASE_MARGIN_DEG: Final = 60.0
"""Of the rule by Åström and Hägglund: 60 degrees give hardly any overshoot."""
SENSITIVITY_MAX: Final = 1.8
"""Beyond it a loop is too lively for the next hot day."""
_FREQUENCIES: Final = np.logspace(-0.5, 2.5, 150)
"""rad/s at which margins are looked for."""
AGOPEN_TAPER_DEG: Final = 3.0
"""Error over which AgOpenGPS's steering reaches full duty."""
DAYS: Final = ((1.0, 1.0, 1.0), (0.85, 1.15, 1.15), (1.15, 0.85, 0.9))
"""Factors on gain, friction and lag: low battery and load; full battery and warm grease."""
STEPS: Final = (Step(), Step(size_deg=-5.0, start_deg=5.0))
"""What gains are judged by: a large step and a small one."""


@dataclass(frozen=True, slots=True)
class Margins:
    """Of the linear loop."""

    gain_db: float
    phase_deg: float
    sensitivity: float
    """Largest |S|: 1.4 is calm, 2 is lively."""
    crossover_radps: float


def ultimate(model: ActuatorModel) -> tuple[float, float]:
    """Ultimate gain (duty/deg) and period (s) of the model: gain, lag and dead time, with the
    firmware's tick as half a tick's delay."""
    k, lag = model.gain_degps.value, model.lag_s.value
    delay = max(0.0, model.dead_time_s.value) + 1.5 * TICK_S
    low, high = 1e-3, math.pi / 2 / delay
    for _ in range(60):
        w = 0.5 * (low + high)
        phase = math.atan(w * lag) + w * delay
        low, high = (w, high) if phase < math.pi / 2 else (low, w)
    w = 0.5 * (low + high)
    return w * math.hypot(1.0, w * lag) / k, 2 * math.pi / w


def _law(model: ActuatorModel, kp: float, ki: float, kd: float, **others: float) -> Gains:
    """The firmware's parameters, within their ranges and as its integers hold them."""
    values = closed_loop.defaults() | {
        "steer_kp": kp,
        "steer_ki": ki,
        "steer_kd": kd,
        "steer_min_duty": 0.85 * min(model.min_left, model.min_right),
        **others,
    }
    held = {}
    for name, value in values.items():
        spec = protocol.PARAMS[name]
        raw = min(spec.max_raw, max(spec.min_raw, round(value / spec.scale)))
        held[name] = spec.from_raw(raw)
    return held


def ziegler_nichols(model: ActuatorModel) -> Gains:
    """The classic PID rule from the ultimate gain and period."""
    ku, pu = ultimate(model)
    return _law(model, 0.6 * ku, 1.2 * ku / pu, 0.075 * ku * pu)


def astrom_hagglund(model: ActuatorModel) -> Gains:
    """PID for a phase margin at the ultimate frequency (Åström and Hägglund 1984, Ti = 4 Td); from
    the relay on the machine where it oscillated, else from the model."""
    ku, pu = ultimate(model)
    if model.relay_gain > 0:
        ku, pu = model.relay_gain, model.relay_period_s
    margin = math.radians(PHASE_MARGIN_DEG)
    kp = ku * math.cos(margin)
    td = pu / (4 * math.pi) * (math.tan(margin) + math.sqrt(1 + math.tan(margin) ** 2))
    return _law(model, kp, kp / (4 * td), kp * td)


def lambda_tuning(model: ActuatorModel, factor: float = 2.0) -> Gains:
    """PD that cancels the lag and closes the loop with time constant `factor` times what delay
    allows; the small integral only carries what friction leaves."""
    k, lag = model.gain_degps.value, model.lag_s.value
    delay = max(0.0, model.dead_time_s.value) + 1.5 * TICK_S
    spec = protocol.PARAMS["steer_d_filter"]
    closed = factor * (delay + spec.from_raw(spec.default_raw) * 1e-3)
    kp = 1.0 / (k * closed)
    return _law(model, kp, kp / (8 * closed), kp * lag)


def agopen(model: ActuatorModel, hand_kp: float = 40.0) -> Gains:
    """Hand gains of AgOpenGPS's shape: P on top of the minimum PWM, its ceiling falling linearly to
    the minimum inside 3 degrees. Within the firmware's law that ceiling is a largest gain."""
    least = max(model.min_left, model.min_right)
    ceiling = (255.0 - least) / AGOPEN_TAPER_DEG
    return _law(model, min(hand_kp, ceiling), 0.0, 0.0, steer_min_duty=least)


def sensitivity(model: ActuatorModel, law: Mapping[str, float]) -> float:
    """Largest |S| of the linear loop."""
    s = 1j * _FREQUENCIES
    delay = max(0.0, model.dead_time_s.value) + 1.5 * TICK_S
    plant = model.gain_degps.value * np.exp(-s * delay) / (s * (model.lag_s.value * s + 1))
    smooth = (law["steer_d_filter"] * 1e-3 + TICK_S) * s + 1
    law_s = law["steer_kp"] + law["steer_ki"] / s + law["steer_kd"] * s / smooth
    return float(np.max(np.abs(1 / (1 + plant * law_s))))


def figure(model: ActuatorModel, law: Mapping[str, float]) -> float:
    """Mean cost of the steps over the days, and what a lively loop costs; smaller is better."""
    total = 0.0
    for day in DAYS:
        actuator = closed_loop.varied(model, *day)
        for step in STEPS:
            response, _ = closed_loop.respond(actuator, law, step)
            deadline = deadline_s(actuator.slew_degps, actuator.lag_s.value, step)
            total += cost(response, step, deadline) + (not meets(response, step, deadline))
    lively = max(0.0, sensitivity(model, law) - SENSITIVITY_MAX)
    return total / (len(DAYS) * len(STEPS)) + lively


_LOW: Final = np.array([math.log(10.0), 0.0, 0.0, 15.0, 0.5])
_HIGH: Final = np.array([math.log(100.0), 100.0, 6.0, 60.0, 1.05])
"""Bounds of the search: logarithm of kp, then ki, kd, filter (ms) and share of the minimum duty."""


def optimise(model: ActuatorModel, samples: int = 250, seed: int = 0) -> Gains:
    """The law that costs least on the model: a random search from the rules' and the default
    gains, refined by Nelder and Mead's simplex. Deterministic."""
    least = min(model.min_left, model.min_right)
    band = min(0.6, max(0.35, 4.5 * model.noise_deg))

    def law(x: Floats) -> Gains:
        log_kp, ki, kd, filter_ms, share = np.clip(x, _LOW, _HIGH).tolist()
        return _law(
            model,
            math.exp(log_kp),
            ki,
            kd,
            steer_d_filter=filter_ms,
            steer_min_duty=share * least,
            steer_deadband=band,
            steer_duty_slew=15000.0,
        )

    def dear(x: Floats) -> float:
        return figure(model, law(x))

    random = np.random.default_rng(seed)
    tries = _LOW + random.random((samples, len(_LOW))) * (_HIGH - _LOW)
    tries[0] = [math.log(75.0), 55.0, 3.0, 35.0, 0.85]
    costs = [dear(x) for x in tries]
    order = np.argsort(costs, kind="stable")[: len(_LOW) + 1]
    best = minimize(
        dear,
        tries[order[0]],
        method="Nelder-Mead",
        options={"initial_simplex": tries[order], "maxfev": samples, "xatol": 1e-2, "fatol": 1e-3},
    )
    return law(best.x)


RULES: Final = ("optimise", "lambda", "astrom-hagglund", "ziegler-nichols", "agopen")


def gains(rule: str, model: ActuatorModel) -> Gains:
    """The law's parameters by one of RULES, and the stall_time of this motor."""
    rules: dict[str, Callable[[ActuatorModel], Gains]] = {
        "optimise": optimise,
        "lambda": lambda_tuning,
        "astrom-hagglund": astrom_hagglund,
        "ziegler-nichols": ziegler_nichols,
        "agopen": agopen,
    }
    law = rules[rule](model)
    breakaway = max(model.min_left, model.min_right)
    share = share_at_least_duty(law["steer_min_duty"], model.friction_duty.value, breakaway)
    watch = stall_time_ms(model.slew_degps, model.backlash_deg.value, share)
    return law | {"stall_time": watch}


def loops(
    model: ActuatorModel, law: Mapping[str, float]
) -> tuple[control.xferfcn, control.xferfcn]:
    """Open loop, and closed loop from setpoint to angle: the derivative is on the measurement."""
    k, lag = model.gain_degps.value, model.lag_s.value
    delay = max(0.0, model.dead_time_s.value) + 1.5 * TICK_S
    plant = control.tf([k], [lag, 1.0, 0.0]) * control.tf(*control.pade(delay, 3))
    kp, ki, kd = (law[f"steer_{name}"] for name in ("kp", "ki", "kd"))
    forward = control.tf([kp, ki], [1.0, 0.0]) if ki > 0 else control.tf([kp], [1.0])
    damping = control.tf([kd, 0.0], [law["steer_d_filter"] * 1e-3 + TICK_S, 1.0])
    opened = control.minreal(plant * (forward + damping), verbose=False)
    inner = control.feedback(plant, damping)
    return opened, control.feedback(control.minreal(inner * forward, verbose=False), 1)


def margins(model: ActuatorModel, law: Mapping[str, float]) -> Margins:
    """Stability margins of the linear loop."""
    opened, _ = loops(model, law)
    gain, phase, _, _, crossover, _ = control.stability_margins(opened)
    peak = float(np.max(np.abs(1.0 / (1.0 + opened(1j * _FREQUENCIES)))))
    return Margins(
        gain_db=20 * math.log10(gain) if 0 < gain < math.inf else math.inf,
        phase_deg=float(phase),
        sensitivity=peak,
        crossover_radps=float(crossover),
    )
