"""What every behaviour is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from host.core.messages import Command
from host.field.areas import Verdict
from host.pilot.context import FARTHEST_M, SLOW_AFTER_S, Context
from host.pilot.endings import or_elsewhere
from host.pilot.gaze import Gaze
from host.pilot.guard import SeenFree, Watched
from host.pilot.phase import Doing, Go, Phase, Reason

Step = tuple[Command, Go | None]
"""What to do now, and whether another behaviour takes over."""


class Behaviour(ABC):
    """One thing that the machine does. It is made anew each time it is begun; what outlives it is
    in the context."""

    phase: ClassVar[Phase]
    """What the operator and the record call it."""
    gaze: ClassVar[Gaze] = Gaze()
    """What pictures may tell meanwhile."""
    reasons: ClassVar[tuple[type[Reason], ...]]
    """All reasons for which it gives way to another, besides those of `host.pilot.guard`."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def enter(self, now: float) -> None:  # noqa: B027 (most have nothing to do)
        """Before the first step."""

    @abstractmethod
    def step(self, now: float) -> Step:
        """Called at every command's time, after telemetry and picture have been taken."""

    def exit(self) -> None:  # noqa: B027
        """After the last step, whatever follows."""

    def gives_way(self, go: Go) -> Step:
        """The machine stands, and is off where a person is needed."""
        context = self.context
        return context.stop() if go.reason.to is Doing.FAULT else context.hold(), go

    def paused(self, now: float) -> None:
        """The operator has paused the machine: nothing runs out."""
        self.context.since = self.context.sight.seen.stamp = now

    def seen_free(self, now: float) -> SeenFree:
        """What pictures say of the way ahead."""
        del now
        return (
            SeenFree(crop_m=self.context.strip.sure_ahead_m()) if self.gaze.on_side else SeenFree()
        )

    def clear_ahead(self, now: float) -> SeenFree:
        """Beyond an end that has just been found for the first time, the next crop ahead."""
        sight, motion = self.context.sight, self.context.motion
        view = sight.view
        if view is None or not sight.sees_ahead() or now - sight.stamp > SLOW_AFTER_S:
            return SeenFree()
        since = motion.distance_m - self.context.estimate.odometry.at(sight.stamp).distance_m
        return SeenFree(clear_m=min(view.crop_ahead_m, FARTHEST_M) - max(0.0, since))

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """The geofence lets the last command not pass. Without a transition the machine stands and
        the behaviour does something else next."""
        del now
        return or_elsewhere(self.context, Watched.GEOFENCE.go(why=verdict.reason))
