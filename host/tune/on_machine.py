"""The experiments of `experiments` on the machine behind a serial port."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from host.core.errors import UserError
from host.core.messages import State, Telemetry
from host.link import params, protocol
from host.link.session import Link, Session
from host.tune.actuator_model import ActuatorModel, Findings, fit
from host.tune.experiments import armed
from host.tune.pot_calibration import SEARCH, PotCalibration, calibrate_pot
from host.tune.step_response import Floats, Response, Step, deadline_s, judge, meets
from host.tune.wire import Wire

POLL_S: Final = 0.002
"""Longest wait for telemetry: well under the firmware's tick."""
KEEPALIVE_S: Final = 0.1
"""Between repeated commands; the firmware's link watchdog takes 250 ms."""
VERIFY_S: Final = 3.0
"""Of each step by which the new gains are tried."""
TELEMETRY_S: Final = 0.02
"""Between telemetry messages: 50 Hz."""


class LinkWire:
    """A serial port as a Wire."""

    def __init__(self, link: Link) -> None:
        self._link = link

    @property
    def session(self) -> Session:
        """The link's."""
        return self._link.session

    @property
    def now(self) -> float:
        """Seconds on the host's clock."""
        return time.monotonic()

    def request(self, message: protocol.Message) -> None:
        """Sends a message."""
        self._link.request(message)

    def poll(self) -> list[Telemetry]:
        """What has arrived, waiting a little for the first byte."""
        return self._link.poll(POLL_S)


def measure(
    link: Link, name: str, values: Mapping[str, float], say: Callable[[str], None]
) -> tuple[Findings, ActuatorModel]:
    """Experiments and fit on the machine at a link; `values`: its parameters. `say` is told what is
    being done."""
    with armed(LinkWire(link), name, values) as experimenter:
        experimenter.say = say
        findings = experimenter.identify()
    return findings, fit(findings)


def calibrate(
    link: Link, name: str, stop_deg: float, values: Mapping[str, float]
) -> PotCalibration:
    """Drives gently into both stops and writes the calibration."""
    kept = {key: values[key] for key in SEARCH}
    recalibrate(link, SEARCH)
    try:
        with armed(LinkWire(link), name, values) as experimenter:
            found = calibrate_pot(experimenter, {**values, **SEARCH}, stop_deg)
    except BaseException:
        link.request(protocol.Stop())
        recalibrate(link, kept)
        raise
    recalibrate(link, kept | found.params())
    return found


def recalibrate(link: Link, values: Mapping[str, float]) -> None:
    """Another calibration makes the reading jump, which the firmware takes for a fault; a fault
    that has another reason comes back."""
    params.write_all(link, values)
    link.ask(protocol.Clear())


def verify(wire: Wire, name: str, step: Step) -> tuple[Response, Floats]:
    """Makes the step on the machine: first to its start, then the step. The angle is the reading's
    running mean over five samples. Also returns (2, n) angle in degrees and duty, every 20 ms."""
    with armed(wire, name, {"ident_duty_max": 0.0}):
        _hold(wire, step.start_deg, VERIFY_S)
        seen = _hold(wire, step.start_deg + step.size_deg, step.duration_s)
    readings = np.degrees([t.angle_rad for t in seen])
    padded = np.concatenate([np.full(2, readings[0]), readings, np.full(2, readings[-1])])
    angle = np.convolve(padded, np.full(5, 0.2), mode="valid")
    duty = np.array([float(t.steer_duty) for t in seen])
    response = judge(angle, duty, TELEMETRY_S, step, faults=seen[-1].faults)
    return response, np.stack([angle, duty])


def _hold(wire: Wire, angle_deg: float, seconds: float) -> list[Telemetry]:
    """Commands an angle for a time. Raises UserError when the firmware gives up."""
    seen: list[Telemetry] = []
    end = wire.now + seconds
    due = wire.now
    while wire.now < end:
        if wire.now >= due:
            due += KEEPALIVE_S
            wire.request(protocol.Drive(math.radians(angle_deg), 0.0, 0))
        for telemetry in wire.poll():
            if telemetry.state is not State.ARMED:
                texts = protocol.fault_texts(protocol.Fault(telemetry.faults))
                raise UserError(f"the firmware gave up the step: {'; '.join(texts)}")
            seen.append(telemetry)
    if len(seen) < 0.8 * seconds / TELEMETRY_S:
        raise UserError(f"only {len(seen)} telemetry messages in {seconds:g} s: check the cable")
    return seen


def write_verified(
    link: Link,
    name: str,
    model: ActuatorModel,
    law: Mapping[str, float],
    before: Mapping[str, float],
    step: Step,
) -> tuple[Response, Floats]:
    """Writes a steering law's parameters and makes the step with them. UserError where the step
    misses its figures; `before` is restored then, and by whatever else ends it."""
    params.write_all(link, law)
    try:
        response, trace = verify(LinkWire(link), name, step)
        deadline = deadline_s(model.slew_degps, model.lag_s.value, step)
        if not meets(response, step, deadline):
            raise UserError(
                f"the step on the machine misses the figures: settled after "
                f"{response.settle_s:.2f} s (at most {deadline:.2f}), overshoot "
                f"{100 * response.overshoot:.1f} % (5), steady error "
                f"{response.steady_error_deg:.2f} deg (0.5), {response.starts} starts at rest "
                "(0). The old parameters are restored; identify again with the wheel free"
            )
    except BaseException:
        link.request(protocol.Stop())
        params.write_all(link, before)
        raise
    return response, trace
