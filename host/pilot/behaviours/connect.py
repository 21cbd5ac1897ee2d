"""Connect: wait for telemetry, clear what the last run left, arm, and stand until the gyroscope's
offset is known: without it the yaw of the first side is as good as the pot's middle."""

from __future__ import annotations

import math
from typing import Final

from host.core.messages import Command, Request, State
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.phase import Doing, Phase, Reason

ARM_RETRY_S = 0.5
"""Between two requests: ten of the firmware's telemetry frames and more, to see the answer."""
SETTLED: Final = math.radians(0.03)
"""How surely the gyroscope's offset is known before the machine moves, rad/s: a first side of a
minute then turns by 2 degrees (one sigma). A machine that stands still shows it in some
three seconds; half a second shows it to 0.2 degrees/s, with which the gyroscope is not used."""
SETTLE_S: Final = 5.0
"""Armed, the longest that is stood for it: one that is shaken at rest shows no more by waiting."""
CREPT_M: Final = 0.03
"""On a slope the brake lets the machine creep; once it has come so far it stands no longer. It was
put down at the border, and by then the offset is known well enough to be used."""


class Why(Reason):
    """Out of connecting."""

    ARMED = Doing.ALIGN, "armed; waiting for a sure view of the edge"
    FAULT_STAYS = Doing.FAULT, "the firmware's fault does not clear"


class Connect(Behaviour):
    """See the module."""

    phase = Phase.CONNECT
    reasons = (Why,)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._asked = -math.inf
        self._cleared = False
        self._armed = math.inf
        """Since when it is,"""
        self._armed_at_m = math.nan
        """and how far it had come by then."""

    def step(self, now: float) -> Step:
        telemetry = self.context.telemetry
        if telemetry is None:
            return self.context.stop(), None
        if telemetry.state in (State.ARMED, State.RUNNING):
            if now < self._armed:
                self._armed, self._armed_at_m = now, self.context.motion.distance_m
            return self.context.hold(), None if self._settles(now) else Why.ARMED.go()
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

    def _settles(self, now: float) -> bool:
        """Whether the gyroscope speaks, and its offset is still to be found."""
        gyroscope = self.context.estimate.odometry.gyroscope
        speaks = math.isfinite(gyroscope.stamp) and not gyroscope.contradicted
        unknown = gyroscope.offset_sigma > SETTLED
        stands = abs(self.context.motion.distance_m - self._armed_at_m) < CREPT_M
        return speaks and unknown and stands and now - self._armed < SETTLE_S
