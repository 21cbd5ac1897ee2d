"""The steering actuator alone under the firmware's control: step responses by the thousand.

A `Stand` is firmware and machine in lockstep without field, camera or host; a `Plant` is one
steering actuator of a population (battery, bridge, wear, load, temperature); `step_response` arms
the firmware, sets its parameters over the serial protocol, commands a step and judges what the
wheel did. Everything is a function of its arguments: same inputs, same bits, in any process.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.firmware import coupling, provision
from hil.scenario.drawn_machine import NOMINAL_RANGES
from host.core.errors import UserError
from host.link import protocol
from host.link.session import Session
from host.tune import step_response as step_figures
from host.tune.step_response import Response, Step
from sim_plant import machine
from sim_plant.machine import BatterySpec, BridgeSpec, MachineSpec, SteeringSpec

Firmware = Literal["desk", "avr"]
LOG_S: Final = coupling.LOG_US * 1e-6
"""Between rows of the log."""
KEEPALIVE_S: Final = 0.1
"""Between commands; the firmware's link watchdog takes 250 ms."""


# ---- plants --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Plant:
    """One actuator as a data sheet would have it, and the day it has: a row of a sweep's table.

    slew, lag and stiction hold at 12 V, 20 degrees, no load and no wear.
    """

    slew_degps: float = 45.0
    lag_s: float = 0.07
    stiction_counts: float = 45.0
    backlash_deg: float = 1.0
    pot_counts_per_deg: float = 4.5
    pot_noise_counts: float = 2.0
    bridge_drop_v: float = 1.8
    battery_v: float = 12.4
    load: float = 1.0
    """Factor on the friction: soil under the wheel."""
    wear: float = 0.0
    """0 new, 1 worn out: half more backlash, a fifth more friction."""
    temperature_c: float = 20.0
    """Of the motor: copper gains 0.39 % per kelvin, a ferrite magnet loses 0.2 %."""
    seed: int = 0
    """Of the pot's noise."""

    def machine(self) -> MachineSpec:
        """The whole machine with this steering."""
        warmer = self.temperature_c - 20.0
        new = SteeringSpec.from_response(
            slew_degps=self.slew_degps,
            lag_s=self.lag_s,
            stiction_counts=self.stiction_counts,
            backlash_deg=self.backlash_deg * (1 + 0.5 * self.wear),
            bridge=BridgeSpec(drop_v=self.bridge_drop_v),
        )
        friction = self.load * (1 + 0.2 * self.wear)
        steering = new.model_copy(
            update={
                "r_ohm": new.r_ohm * (1 + 0.0039 * warmer),
                "k_vs": new.k_vs * (1 - 0.002 * warmer),
                "coulomb_nm": new.coulomb_nm * friction,
                "static_nm": new.static_nm * friction,
                "pot_counts_per_deg": self.pot_counts_per_deg,
                "pot_noise_counts": self.pot_noise_counts,
            }
        )
        battery = BatterySpec(full_v=self.battery_v, empty_v=self.battery_v - 1.0)
        return MachineSpec(steering=steering, battery=battery)


@dataclass(frozen=True, slots=True)
class Truth:
    """What an identification should find, worked out from the plant's physics at rest voltage.

    speed = gain * (|duty| - friction_duty), reached with time constant lag_s; from rest it takes
    min_duty to move.
    """

    gain_degps: float
    """deg/s per count of duty."""
    lag_s: float
    min_duty: float
    friction_duty: float

    @property
    def slew_degps(self) -> float:
        """At full duty."""
        return self.gain_degps * (255.0 - self.friction_duty)


def truth(spec: MachineSpec) -> Truth:
    """The figures of a machine's steering at its present battery voltage."""
    s = spec.steering
    b = spec.battery
    volts = b.full_v - b.r_ohm * b.idle_a - s.bridge.drop_v
    ohms = s.r_ohm + s.bridge.r_ohm
    dead = s.bridge.dead_time_s * machine.STEER_PWM_HZ
    # Friction torque as duty; friction and back-EMF share the circuit's drop.
    per_nm = 255.0 * ohms / (s.k_vs * volts)
    damping = s.k_vs + s.viscous_nms * ohms / s.k_vs
    return Truth(
        gain_degps=math.degrees(volts / damping / s.gear) / 255.0,
        lag_s=s.inertia_kgm2 * ohms / (s.k_vs * damping),
        min_duty=255.0 * dead + per_nm * s.static_nm,
        friction_duty=255.0 * dead + per_nm * s.coulomb_nm,
    )


DAY_RANGES: Final[Mapping[str, tuple[float, float]]] = {
    "battery_v": (11.5, 12.9),
    "load": (0.8, 1.2),
    "wear": (0.0, 1.0),
    "temperature_c": (0.0, 70.0),
}
"""What varies about one actuator from day to day."""


def population(
    count: int,
    seed: int,
    *,
    ranges: Mapping[str, tuple[float, float]] = NOMINAL_RANGES,
) -> list[Plant]:
    """`count` plants whose properties are drawn uniformly and independently from `ranges`; the
    others are as by default."""
    base = Plant()
    random = np.random.default_rng(seed)
    plants = []
    for number in range(count):
        drawn = {name: float(random.uniform(*limits)) for name, limits in ranges.items()}
        plants.append(_replace(base, drawn | {"seed": seed * 100_003 + number}))
    return plants


def _replace(plant: Plant, changes: Mapping[str, Any]) -> Plant:
    fields = {name: getattr(plant, name) for name in Plant.__slots__}
    return Plant(**(fields | dict(changes)))


# ---- stand ---------------------------------------------------------------------------------------


class Stand(contextlib.AbstractContextManager["Stand"]):
    """Firmware and machine in lockstep, and a log of what the steering truly did."""

    def __init__(
        self, spec: MachineSpec, *, seed: int = 0, log_s: float = 4.0, firmware: Firmware = "desk"
    ) -> None:
        """`log_s`: how long the log is; later rows are not kept."""
        self.spec = spec
        self._state = machine.initial(spec)
        self._params = machine.parameters(spec, seed)
        self.given = machine.inputs()
        """What moves the machine besides the firmware: sim_plant.machine.INPUTS."""
        self._log = np.zeros(round(log_s / LOG_S), coupling.LOG)
        self._firmware = firmware
        self.target = provision.fitted(firmware)
        self._run = coupling.bind(self.target, self._state, self._params, self.given, self._log)
        self._now_us = 0

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return self._now_us * 1e-6

    @property
    def state(self) -> Any:
        """The machine's true state: a record of sim_plant.machine.STATE."""
        return self._state[0]

    def write(self, data: bytes) -> None:
        """Bytes to the firmware."""
        self.target.write(data)

    def advance(self, seconds: float) -> bytes:
        """Runs on, in whole milliseconds; returns what the firmware sent meanwhile."""
        end = (
            self._now_us
            + math.ceil(seconds * 1e6 / coupling.PHYSICS_US - 1e-6) * coupling.PHYSICS_US
        )
        status = self._run(self._now_us, end)
        if status != 0:
            raise UserError(
                f"the {self._firmware} firmware crashed after {self.now:.2f} s (status {status})"
            )
        self._now_us = end
        return self.target.read()

    def log(self) -> NDArray[Any]:
        """coupling.LOG rows of every LOG_S from the start to now."""
        return self._log[: self._now_us // coupling.LOG_US]

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the target."""
        self.target.close()


def calibration(spec: SteeringSpec) -> dict[str, float]:
    """The firmware's parameters for a pot whose calibration points were taken exactly."""
    limit = protocol.PARAMS["angle_left"]
    angle = limit.from_raw(limit.default_raw)
    ends = {}
    for name, side in (("pot_left", 1.0), ("pot_right", -1.0)):
        bend = spec.pot_bend_counts * math.sin(math.radians(side * angle) * 3.6)
        ends[name] = spec.pot_centre_counts + spec.pot_counts_per_deg * side * angle + bend
    return {"pot_centre": spec.pot_centre_counts, **ends}


def set_params(stand: Stand, session: Session, values: Mapping[str, float]) -> None:
    """Sets firmware parameters, in their units, and waits for every answer. Raises UserError for a
    name or a value that the firmware does not take."""
    session.answers.clear()
    for name, value in values.items():
        if name not in protocol.PARAMS:
            raise UserError(f"the firmware has no parameter {name!r}; `daranti params list` has")
        spec = protocol.PARAMS[name]
        try:
            raw = spec.to_raw(value)
        except ValueError as error:
            raise UserError(str(error)) from error
        stand.write(session.request(protocol.ParamSet(spec.id, raw)))
    session.feed(stand.now, stand.advance(0.005 + 0.0035 * len(values)))
    taken = [a for a in session.answers if isinstance(a, protocol.Ack)]
    refused = [a for a in taken if a.result is not protocol.Result.OK]
    if len(taken) != len(values) or refused:
        raise UserError(
            f"the firmware took {len(taken) - len(refused)} of {len(values)} parameters"
        )


# ---- step response -------------------------------------------------------------------------------


def step_response(
    plant: Plant,
    gains: Mapping[str, float],
    step: Step | None = None,
    firmware: Firmware = "desk",
) -> tuple[Response, NDArray[Any]]:
    """Boots the firmware, sets the plant's calibration and `gains` (parameters by name), arms, and
    commands the step. Returns the verdict and the coupling.LOG rows since the command."""
    step = step or Step()
    spec = plant.machine()
    session = Session()
    log_s = step.duration_s + 1.0
    with Stand(spec, seed=plant.seed, log_s=log_s, firmware=firmware) as stand:
        stand.advance(0.01)
        set_params(stand, session, calibration(spec.steering) | dict(gains))
        stand.write(session.request(protocol.Arm(protocol.VERSION)))
        stand.advance(LOG_S)
        begin = len(stand.log())
        target = math.radians(step.start_deg + step.size_deg)
        said = b""
        for _ in range(round(step.duration_s / KEEPALIVE_S)):
            stand.write(session.request(protocol.Drive(target, 0.0, 0)))
            said = stand.advance(KEEPALIVE_S)
        session.feed(stand.now, said)
        telemetry = session.telemetry
        faults = 0 if telemetry is None else telemetry.faults
        log = stand.log()[begin:].copy()
    return judge(log, spec, step, faults), log


def judge(log: NDArray[Any], spec: MachineSpec, step: Step, faults: int = 0) -> Response:
    """The figures of a response: `log` from the command on. The angle is the wheel's as a
    potentiometer of the same bend, but without noise, would show it: what the loop can know."""
    s = spec.steering
    truly = np.degrees(log["steer_angle"])
    bend = s.pot_bend_counts / s.pot_counts_per_deg * np.sin(log["steer_angle"] * 3.6)
    duty = log["steer_duty"]
    volts = np.abs(duty) * np.maximum(0.0, log["battery_v"])
    energy = float((volts * np.abs(log["steer_a"])).sum()) * LOG_S
    return step_figures.judge(
        truly + bend, duty, LOG_S, step, truly_deg=truly, energy_j=energy, faults=faults
    )


def deadline_s(spec: MachineSpec, step: Step) -> float:
    """By when this machine must have settled."""
    actuator = truth(spec)
    return step_figures.deadline_s(actuator.slew_degps, actuator.lag_s, step)
