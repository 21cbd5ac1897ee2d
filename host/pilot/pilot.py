"""The pilot: frames, fixes and telemetry in, one command out.

No clock, thread or I/O in here: the field application, the lockstep rig and a replay feed it alike.
Paper, II: align at the first picture, follow the outer edge of the uncut crop on the right, detect
the end of the field, turn left, go inward by the blade's width, finish. What the machine does, and
when it does something else, is in host.pilot.behaviours, one a file.
"""

from __future__ import annotations

from host.core.messages import Command, Fix, Frame, Request, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import CONFIDENT, EDGE_SURE, EndOfField
from host.estimate.kalman import Innovation
from host.estimate.lane import Lane
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.pilot.behaviours import BEHAVIOURS
from host.pilot.context import Context
from host.pilot.endings import over
from host.pilot.guard import watch
from host.pilot.phase import Doing, Go, Phase, Transition
from host.pilot.strip import Strip
from host.route.anew import displaced
from host.route.plan import Plan
from host.vision.view import CropView, Detector

PAUSED = "paused by the operator"
OVER = (Phase.FINISHED, Phase.FAULT)
"""Phases in which nothing more is commanded."""
WORTH_SAYING_M = 0.1
"""A boundary that errs by less was right."""


class Pilot:
    """`detector` turns pictures into CropViews; everything else is arithmetic."""

    def __init__(self, vehicle: Vehicle, detector: Detector, plan: Plan | None = None) -> None:
        self._context = Context(vehicle, detector, plan or Plan())
        self._believed = self._context.plan.boundary
        self.doing = Doing.CONNECT
        """The behaviour that is active."""
        self._behaviour = BEHAVIOURS[self.doing](self._context)
        self.paused = False
        """Set from outside: stand still with the blade off until it is cleared, then go on."""
        self.transitions: list[Transition] = []

    # ---- what others may read --------------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        """What the operator and the record call the active behaviour."""
        return self._behaviour.phase

    @property
    def reason(self) -> str:
        """Why it is active, in words."""
        return self._context.reason

    @property
    def view(self) -> CropView | None:
        """What the last picture shows."""
        return self._context.sight.view

    @property
    def ends(self) -> list[EndOfField]:
        """Where sides were declared ended by pictures."""
        return self._context.ends

    @property
    def turns(self) -> int:
        """How many sides have been left."""
        return self._context.strip.index

    @property
    def strip(self) -> Strip:
        """The strip that is being cut, or turned to."""
        return self._context.strip

    @property
    def motion(self) -> Motion:
        """Dead reckoning since the start."""
        return self._context.motion

    @property
    def trim_rad(self) -> float:
        """True steering angle minus the pot's, as learned."""
        return self._context.estimate.odometry.trim_rad

    @property
    def yaw_gain(self) -> float:
        """True yaw over what the steering angle and the way say, as learned."""
        return self._context.estimate.odometry.yaw_gain

    def take_innovations(self) -> list[Innovation]:
        """What the estimator made of its measurements since the last call; for the record."""
        return self._context.estimate.take_innovations()

    @property
    def lane(self) -> Lane:
        """The estimate that steers."""
        return self._context.estimate.lane

    @property
    def position(self) -> Position:
        """Where the machine is in the field frame, once the plan's first corner is known."""
        return self._context.estimate.position

    @property
    def plan(self) -> Plan:
        """What is left of the field, as it is laid out now."""
        return self._context.plan

    @property
    def believed_wrong(self) -> str:
        """What driving along it has shown of boundary and gap that were entered, in words; empty
        where nothing has. A field that lies or is turned elsewhere as a whole is none: only the
        phone's positions speak of that."""
        return "; ".join(filter(None, (self._boundary_wrong, self._context.gaps.wrong)))

    @property
    def _boundary_wrong(self) -> str:
        found = self.position.outline
        if not len(self._believed) or not found.states:
            return ""
        corner, off_m = displaced(self._believed, found.corners)
        if off_m < WORTH_SAYING_M:
            return ""
        return f"the boundary was wrong by up to {off_m:.1f} m (corner {corner}); found on the way"

    @property
    def cut_m(self) -> float:
        """How far the blade has come along the side since it met its crop; 0 before that."""
        if self._context.turning is not None or not self._context.sight.ahead.entered:
            return 0.0
        return max(0.0, self._context.cut_m)

    @property
    def backing(self) -> bool:
        """Whether this is a turn's last leg, back along the next side."""
        turning = self._context.turning
        return self.doing is Doing.TURN and turning is not None and turning.backing

    @property
    def looks(self) -> bool:
        """Whether it reads the pictures that come now, and does not only glance at them."""
        context = self._context
        glances = context.sight.glances(context.strip, context.turning)
        return self._behaviour.gaze.looks and not glances

    @property
    def done(self) -> bool:
        """Nothing more will be commanded: the field is finished, or a fault needs a person."""
        return self._behaviour.phase in OVER

    # ---- the step --------------------------------------------------------------------------------

    def step(
        self,
        now: float,
        frame: Frame | None,
        fix: Fix | None,
        telemetry: Telemetry | None,
        turned: Turned | None = None,
    ) -> Command:
        """One decision. `frame`, `fix` and `turned` are given once each, when new; `telemetry` the
        latest."""
        return self._context.estimate.wheel.asked_of_the_wheel(
            self._decide(now, frame, fix, telemetry, turned)
        )

    def _decide(
        self,
        now: float,
        frame: Frame | None,
        fix: Fix | None,
        telemetry: Telemetry | None,
        turned: Turned | None,
    ) -> Command:
        """The same, with the speed that the rear axle's middle is to have."""
        context = self._context
        if turned is not None:
            context.estimate.take_turned(turned)
        self._listen(fix, telemetry)
        if frame is not None:
            self._see(frame)
        if context.telemetry is None:
            return Command(Request.STOP, reason=self.reason)
        if self.phase is not Phase.CONNECT and not self.done:
            told = context.telemetry
            self._go(now, watch(told.state, context.estimate, told.faults))
        if self.paused and not self.done:
            self._behaviour.paused(now)
            return context.hold().because(PAUSED)
        keep_clear, lane = context.guard.keep_clear(), context.estimate.lane
        lane.clear_m, lane.holds = keep_clear.aside_m, keep_clear.near
        command, go = self._behaviour.step(now)
        self._go(now, go)
        if self._behaviour.gaze.on_side:
            command = self._in_crop(now, command)
        passed = context.guard.limit(self._explained(command), self._behaviour.seen_free(now))
        if isinstance(passed, Command):
            return passed
        blocked = self._behaviour.blocked(now, passed)
        self._go(now, blocked)
        return self._explained(context.stop() if self.phase is Phase.FAULT else context.hold())

    def _in_crop(self, now: float, command: Command) -> Command:
        """The command as the blade's guard lets it pass."""
        guard, strip = self._context.estimate.cut, self._context.strip
        end_m = strip.along_m(self._context.motion) - guard.clear_m
        ends = guard.clear_m > 0.0 and strip.may_end_at(end_m)
        # Elsewhere than at its end no tip and no earlier round explains it.
        clear_m = strip.clear_end_m if ends else 0.0
        view = self._context.sight.view
        lies = view is not None and view.lies_confidence >= CONFIDENT
        guard.allow(max(clear_m, strip.lying_m if lies else 0.0))
        if guard.passes:  # what follows takes long
            return command
        own, swath, beside = strip.surely_own, strip.beside_swath, strip.outermost
        return guard.limit(now, command, own=own, swath=swath, ends=ends, beside=beside)

    def _listen(self, fix: Fix | None, telemetry: Telemetry | None) -> None:
        context = self._context
        if telemetry is None:
            return
        if context.telemetry is None or telemetry.stamp > context.telemetry.stamp:
            context.telemetry = context.estimate.at_the_middle(telemetry)
            context.estimate.take_telemetry(context.telemetry)
        if fix is not None:
            underway = self.phase in (Phase.FOLLOW, Phase.TURN)
            context.estimate.take_fix(fix, context.telemetry, underway=underway)

    def _see(self, frame: Frame) -> None:
        context = self._context
        context.sight.take(
            frame,
            self._behaviour.gaze,
            context.strip,
            context.turning,
            context.look.settled,
        )
        strip, sight = context.strip, context.sight
        then = context.estimate.odometry.at(sight.stamp)
        shown = sight.to_guard
        if self._behaviour.gaze.on_side and shown is not None and sight.ahead.begun(then):
            told = context.telemetry
            cuts = self._behaviour.gaze.cutting and told is not None and told.blade
            dusty = cuts and sight.ahead.in_dust(*EDGE_SURE)
            cut = context.estimate.cut
            own, swath = False, False
            if not cut.cuts_on:  # they take long
                own, swath = strip.surely_own, strip.beside_swath
            cut.take_picture(sight.stamp, shown, own=own, swath=swath, dusty=dusty)

    def _explained(self, command: Command) -> Command:
        return command if command.reason else command.because(self.reason)

    def _go(self, now: float, go: Go | None) -> None:
        """The transition, if there is one."""
        if go is None:
            return
        context, before = self._context, self._behaviour
        go = over(context, go)
        before.exit()
        code = f"{self.doing.value}: {go.reason.name}"
        self.doing = go.reason.to
        self._behaviour = BEHAVIOURS[self.doing](context)
        if self._behaviour.phase is not before.phase:
            context.since = now
        context.reason = go.text
        self.transitions.append(Transition(now, self.phase, go.text, code))
        self._behaviour.enter(now)
