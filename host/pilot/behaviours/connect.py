"""Connect: wait for telemetry, clear what the last run left, arm."""

from __future__ import annotations

import math

from host.core.messages import Command, Request, State
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.phase import Doing, Phase, Reason

ARM_RETRY_S = 0.5
"""Between two requests: ten of the firmware's telemetry frames and more, to see the answer."""


class Why(Reason):
    """Out of connecting."""

    ARMED = Doing.ALIGN, "armed; waiting for a sure view of the edge"
    FAULT_STAYS = Doing.FAULT, "the firmware's fault does not clear"
    NO_WHEEL_SENSOR = (
        Doing.FAULT,
        "no wheel sensor: on a slope the machine would know its way to a fifth only, and cut what "
        "is not the field's. Fit one and measure it with `daranti calibrate drive`, or drive "
        "without a boundary",
    )


class Connect(Behaviour):
    """See the module."""

    phase = Phase.CONNECT
    reasons = (Why,)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._asked = -math.inf
        self._cleared = False

    def step(self, now: float) -> Step:
        telemetry = self.context.telemetry
        if telemetry is None:
            return self.context.stop(), None
        if telemetry.speed_mps is None and self.context.plan.sides:
            return self.context.stop(), Why.NO_WHEEL_SENSOR.go()
        if telemetry.state in (State.ARMED, State.RUNNING):
            return self.context.hold(), Why.ARMED.go()
        if telemetry.refusal:
            self.context.reason = telemetry.refusal
        if now - self._asked < ARM_RETRY_S:
            return self.context.hold(), None
        self._asked = now
        if telemetry.state is not State.FAULT:
            return Command(Request.ARM, reason="asking the firmware to arm"), None
        if self._cleared:
            return self.context.stop(), Why.FAULT_STAYS.go()
        self._cleared = True
        return Command(Request.CLEAR, reason="clearing what the last run left"), None
