"""The pilot: frames, fixes and telemetry in, one command out; an explicit state machine.

No clock, thread or I/O in here: the field application, the lockstep rig and a replay feed it alike.
Paper, II: align at the first picture, follow the outer edge of the uncut crop on the right, detect
the end of the field, turn left, go inward by the blade's width, finish.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import shapely

from host.core.messages import Command, Fix, Frame, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.course_check import DirectionCheck
from host.estimate.crop_ahead import (
    CONFIDENT,
    EDGE_SURE,
    END_CLEAR_M,
    END_SURE,
    NEAR_CROP_M,
    Ahead,
    EndOfField,
)
from host.estimate.dusty_edge import CONFIDENCE, DustyEdge
from host.estimate.lane import Lane
from host.estimate.last_round import Trails
from host.estimate.odometry import Motion, Odometry
from host.estimate.position import Position
from host.field.areas import GAP_MARGIN_M, Geofence, Level, Verdict, areas_of, outline_of, placed
from host.pilot import steering_law
from host.pilot.stop_and_look import LONG_LOOK_S, LOOK_S, Look
from host.pilot.turn_progress import Turning
from host.route.plan import SEEN_SHARE, Plan, Side
from host.route.turn_choice import ROOM_M, next_turn, room_along
from host.route.turn_legs import Follow, Turn
from host.vision.view import CropView, Detector

END_PAST_M = 0.15
"""Beyond the plan's end of a side, from where on clear ground is more likely than dust."""
DOUBTED_M = 0.3
"""Before the first sure picture without crop, at most: what a detector waits for, at full speed."""
EARLY_M = 0.8
LATE_M = 0.9
"""How far before or after the plan's end of a side vision may end it; less than a gap."""
LAST_EARLY_M = 0.3
"""On the last side: no turn needs the room, and what seemed clear is cut on the way to its end."""
SLOW_AFTER_S = 0.4
STOP_AFTER_S = 0.8
RESUME_AFTER_S = 0.5
LANE_SIGMA_M = 0.3
"""Uncertainty of the edge at the blade beyond which the pilot does not cut on. Over a patch of
weeds or thin crop, or where no edge line shows (short remnants, slanting ends), dead reckoning does
for some metres."""
DUST_SIGMA_M = 0.12
"""From here on it is worth a stop to look without the blade's dust."""
UNSEEN_M = 0.3
"""Travelled without an edge: not a puff that is gone at the next picture."""
LOOK_EVERY_M = 1.0
END_LOOK_EVERY_M = 0.3
"""Between looks for an end where the plan has one: crop beyond the last look is cut meanwhile."""
BARE_LOOKS = 2
"""Looks in a row at bare ground where the plan has crop, after which the next is one too many."""
SPIN_S = 0.6
"""Before it goes on in crop, for the blade to spin up."""
BLADE_ON_M = 0.6
"""Before the crop of a side."""
SKIP_SIDE_M = 3.0
"""A side up to this long without any crop is driven along to the next."""
REMNANT = 0.015
"""Share of the plan that may be given up as done where nothing shows it."""
GIVE_UP_S = 60.0
"""A hesitation that lasts this long needs a person."""
BACK_AFTER_S, BACK_M, BACKS = 6.0, 0.6, 3
"""After so long the machine backs so far, less than clear ground that ends a side, at most so often
on a side."""
CREEP_MPS = 0.15
"""Near the geofence."""
ANCHOR_EVERY_M = 0.5
MOVED_M = 0.01
"""The same view again from the same place is no second measurement."""
HEADING_SIGMA_RAD = math.radians(4)
CROP_SEEN_M = 0.1
CORNER_M = 0.3
"""How far along a side a slanting border's corner may lie from where dead reckoning has it."""
SQUARE_M = 0.1
"""A border that crosses the strip over less is no slanting one."""
NO_CROP_M = 1.2
"""Crop this much farther after a turn than the plan says is somebody else's, or none."""
STEER_READY_RAD = math.radians(6.0)
STEER_TIMEOUT_S = 4.0
STOPPED_MPS = 0.03
CREEPING_MPS = 0.12
STAND_S = 1.5
"""On a slope a braked machine creeps: after so long told to stand, that counts as standing."""
SEARCH_PICTURES = 5
TRUST_AFTER_S = 3.0
"""An edge that stays hidden is where the operator has put the blade; where the crop's border slants
across the strip, what is seen is not the edge, and that holds at once."""
PLACE_SIGMA_M = 0.12
PLACE_SIGMA_RAD = math.radians(2.5)
"""Of the pose after a turn by dead reckoning, besides what a wrong speed adds."""
LEAP_M = 0.35
"""An edge that leaps farther inside, but no farther than the blade is wide, is a patch of weeds' in
the crop's face or the border of the blade's dust."""
LEAP_STAYS_S = 2.0
"""It is believed when it stays that long after the machine was told to stand."""
INWARD_M = 0.06
"""In dust an edge that has moved inside by more is the dust's."""
TURN_KNOWN_M = 4.0
"""Of a side, until the lane filter has found its direction."""
TURN_LEAST_RAD = 0.5
CORNER_SIGMA_M = 0.1
"""Uncertainty of the lane from which on the corner at a slanting border is taken for what it
tells."""
CORNER_SIGMAS = 3.0
"""How far beside the lane a corner may be, in the lane's own uncertainty."""
LEARN_AFTER_M = 2.0
"""Of a side, until what the turn left askew is straightened: then the steering's bias shows."""
SHUTTLE_LEARN_M = 6.0
"""A shorter strip of a shuttle ends while it is being straightened still, and the next is begun by
the same turn: strip after strip would teach the bias what that leaves."""
ALIGNED = (0.03, math.radians(3.0))
"""Offset of the blade, m, and heading, rad, with which a side is begun."""
ALIGN_ROOM_M = (0.5, 1.0)
"""How much farther than planned the vehicle may back to get into line with the edge: into the gap,
and at most, over what has been cut."""
ARM_RETRY_S = 0.5
PAUSED = "paused by the operator"
LOOKING = "looking without the blade's dust"


class Phase(enum.Enum):
    """What the pilot is doing; each transition carries its reason."""

    CONNECT = "connect"
    ALIGN = "align"
    FOLLOW = "follow"
    TURN = "turn"
    SEARCH = "search"
    HESITATE = "hesitate"
    FINISHED = "finished"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Transition:
    """One change of phase, for the record and the operator."""

    stamp: float
    phase: Phase
    reason: str


class Steady:
    """Since when something holds. After a gap of STOP_AFTER_S it has to prove itself anew."""

    def __init__(self) -> None:
        self.stamp = -math.inf
        """When it last held."""
        self.broken = -math.inf

    @property
    def held_s(self) -> float:
        """For how long without a break."""
        return self.stamp - self.broken

    def note(self, stamp: float, holds: bool) -> None:
        """What a picture says of it."""
        if not holds or stamp - self.stamp > STOP_AFTER_S:
            self.broken = stamp
        if holds:
            self.stamp = stamp


class Pilot:
    """See the module. `detector` turns pictures into CropViews; everything else is arithmetic."""

    def __init__(self, vehicle: Vehicle, detector: Detector, plan: Plan | None = None) -> None:
        self._vehicle = vehicle
        self._detector = detector
        self._plan = plan or Plan()
        self._odometry = Odometry(vehicle)
        self._lane = Lane(vehicle.blade_x_m)
        self._position = Position(vehicle)
        self._trails = Trails(vehicle)
        self._direction = DirectionCheck()
        self._dusty = DustyEdge()
        self._dust_doubts = False
        """Whether pictures in the dust together show the edge elsewhere than it is believed."""
        self._anchored: Motion | None = None
        self._outline = outline_of(vehicle)
        self._fence: Geofence | None = None
        if self._plan.boundary and self._plan.gap_m is not None:
            field = shapely.Polygon(self._plan.boundary, self._plan.keep_outs)
            margin = min(GAP_MARGIN_M, self._plan.gap_m)
            self._fence = Geofence(areas_of(field, self._plan.gap_m, margin_m=margin))
        self.paused = False
        """Set from outside: stand still with the blade off until it is cleared, then go on."""
        self.phase = Phase.CONNECT
        self.reason = "waiting for the firmware's telemetry"
        self.view: CropView | None = None
        self.transitions: list[Transition] = []
        self.ends: list[EndOfField] = []
        self.turns = 0
        self._telemetry: Telemetry | None = None
        self._asked = -math.inf
        self._phase_stamp = -math.inf
        self._cleared = False
        self._view_stamp = -math.inf
        self._seen = Steady()
        """The edge, or what stands ahead, is in view."""
        self._usable = Steady()
        """Pictures are to be believed."""
        self._fix_stamp = -math.inf
        self._ahead = Ahead()
        self._turn: Turning | None = None
        self._turned_from: tuple[float, float] | None = None
        """Before the last turn: dead reckoning's yaw, and the vehicle's direction in the field."""
        self._by_plan = False
        """Whether the last end was the plan's alone: twice in a row it is none."""
        self._tries = 0
        self._empty = 0
        self._run_from: Motion | None = None
        self._look = Look()
        self._bare = 0
        """Looks in a row that showed bare ground where the plan has crop."""
        self._search_m = math.inf
        self._corrected_m = math.inf
        self._back_from: Motion | None = None
        self._backed_stamp = -math.inf
        self._backs = 0

    # ---- what others may read --------------------------------------------------------------------

    @property
    def motion(self) -> Motion:
        """Dead reckoning since the start."""
        return self._odometry.now

    @property
    def trim_rad(self) -> float:
        """True steering angle minus the pot's, as learned."""
        return self._odometry.trim_rad

    @property
    def lane(self) -> Lane:
        """The estimate that steers."""
        return self._lane

    @property
    def position(self) -> Position:
        """Where the machine is in the field frame, once the plan's first corner is known."""
        return self._position

    @property
    def cut_m(self) -> float:
        """How far the blade has come along the side since it met its crop; 0 before that."""
        if self._turn is not None or not self._ahead.entered:
            return 0.0
        return max(0.0, self._cut_m(self.motion))

    @property
    def backing(self) -> bool:
        """Whether this is a turn's last leg, back along the next side."""
        return self.phase is Phase.TURN and self._turn is not None and self._turn.backing

    @property
    def done(self) -> bool:
        """Nothing more will be commanded: the field is finished, or a fault needs a person."""
        return self.phase in (Phase.FINISHED, Phase.FAULT)

    # ---- the step --------------------------------------------------------------------------------

    def step(
        self, now: float, frame: Frame | None, fix: Fix | None, telemetry: Telemetry | None
    ) -> Command:
        """One decision. `frame` and `fix` are given once each, when new; `telemetry` the latest."""
        if telemetry is not None:
            fresh = self._telemetry is None or telemetry.stamp > self._telemetry.stamp
            self._telemetry = telemetry
            if fresh:
                motion = self._odometry.update(telemetry)
                self._lane.predict(motion)
                self._position.predict(motion, cutting=telemetry.blade)
                self._direction.move(motion)
        backwards, askew_rad = False, 0.0
        if fix is not None and telemetry is not None:
            if self._position.known and self.phase in (Phase.FOLLOW, Phase.TURN):
                yaw = self._position.pose[2]
                backwards = self._direction.contradicted(fix, self.motion, yaw)
                askew_rad = self._direction.askew_rad
                if self._direction.off_rad is not None:
                    self._position.course(self._direction.off_rad, self.motion.speed_mps)
            self._odometry.learn(fix, telemetry, min(2.0, fix.stamp - self._fix_stamp))
            self._fix_stamp = fix.stamp
        if frame is not None:
            self._see(frame)
        if self._telemetry is None:
            return Command(Request.STOP, reason=self.reason)
        state = self._telemetry.state if self.phase is not Phase.CONNECT and not self.done else None
        if state is State.FAULT:
            self._go(now, Phase.FAULT, "the firmware reports a fault")
        elif state is State.SAFE:
            self._go(now, Phase.FAULT, "the firmware has disarmed: it was stopped or restarted")
        elif state is not None and self._odometry.impossible:
            self._go(now, Phase.FAULT, "the wheels' sensor counts faster than it can drive")
        elif backwards:
            self._go(
                now,
                Phase.FAULT,
                "it moves the other way: downhill, or by drive motors wired the wrong way",
            )
        elif state is not None and askew_rad != 0.0:
            self._go(
                now,
                Phase.FAULT,
                f"the receiver's courses show it {abs(math.degrees(askew_rad)):.0f} deg askew of "
                "the plan: its strips have turned, put it on a corner of what stands",
            )
        if self.paused and not self.done:
            self._phase_stamp = self._seen.stamp = now  # nothing runs out
            if self._turn is not None:
                self._turn.since = now
            return replace(self._hold(), reason=PAUSED)
        command = {
            Phase.CONNECT: self._connect,
            Phase.ALIGN: self._align,
            Phase.FOLLOW: self._follow,
            Phase.TURN: self._drive_turn,
            Phase.SEARCH: self._search,
            Phase.HESITATE: self._hesitate,
            Phase.FINISHED: self._rest,
            Phase.FAULT: self._rest,
        }[self.phase](now, self._telemetry)
        return self._fenced(now, command)

    def _fenced(self, now: float, command: Command) -> Command:
        """The command as the geofence lets it pass, whatever vision says. What leads away from the
        border (a clear place has no clearance, NaN) is let pass slowly: a machine that stands too
        near must be able to leave."""
        if command.request is not Request.DRIVE or command.speed_mps == 0.0:
            return command
        verdict = self._verdict(command.speed_mps)
        if verdict is None or verdict.level is Level.CLEAR:
            return command
        slow = math.copysign(min(abs(command.speed_mps), CREEP_MPS), command.speed_mps)
        slowly = replace(command, speed_mps=slow, reason=f"{command.reason}; {verdict.reason}")
        creeping = self._verdict(slow) or verdict
        if creeping.level is not Level.STOP:
            return slowly
        later = self._verdict(command.speed_mps, ahead_s=0.5)
        if later is not None and not later.clearance_m <= verdict.clearance_m + 1e-3:
            return slowly
        if self.phase is Phase.TURN and self._turn is not None:
            # What is left of the turn goes the other way.
            self._next_leg(now, self._turn)
            return self._hold()
        if self.phase is Phase.HESITATE:
            self._back_from = None
            return self._hold()
        self._go(now, Phase.FAULT, verdict.reason)
        return Command(Request.STOP, reason=self.reason)

    def _verdict(self, speed_mps: float, ahead_s: float = 0.0) -> Verdict | None:
        """The geofence's answer for the place reached in ahead_s; None without fence or place."""
        if self._fence is None or not self._position.known:
            return None
        x, y, yaw = self._position.pose
        vx, vy = speed_mps * math.cos(yaw), speed_mps * math.sin(yaw)
        outline = placed(self._outline, x + vx * ahead_s, y + vy * ahead_s, yaw)
        return self._fence.check(outline, self._position.covariance_of(outline), (vx, vy))

    def _go(self, now: float, phase: Phase, reason: str) -> None:
        if phase is not self.phase:
            self.transitions.append(Transition(now, phase, reason))
            self._phase_stamp = now
        self.phase, self.reason = phase, reason

    def _drive(self, steer_rad: float, speed_mps: float, blade: bool) -> Command:
        return Command(Request.DRIVE, steer_rad, speed_mps, blade, self.reason)

    def _hold(self) -> Command:
        steer = self._telemetry.angle_rad if self._telemetry else 0.0
        return self._drive(steer, 0.0, False)

    # ---- vision ----------------------------------------------------------------------------------

    def _see(self, frame: Frame) -> None:
        if self.phase in (Phase.FINISHED, Phase.FAULT):
            return
        then = self._odometry.at(frame.stamp)
        side = self._side()
        at_end = side is not None and self._along_m(then) > side.length_m + END_PAST_M
        if self.phase is not Phase.FOLLOW or at_end:
            # Nothing is being cut, or soon nothing will be: what seems clear is not dust.
            turned = self._turn is not None or self.phase not in (Phase.FOLLOW, Phase.HESITATE)
            self._detector.restart(turned=turned)
        turn = self._turn
        blind = turn is not None and turn.leg is not None and not turn.backing
        # a turn is driven by dead reckoning until it backs along the next side
        view = self._detector.glance(frame.bgr) if blind else self._detector.see(frame.bgr)
        self.view = view
        self._view_stamp = frame.stamp
        self._usable.note(frame.stamp, view.usable)
        since = (self.motion.distance_m - then.distance_m, self.motion.yaw_rad - then.yaw_rad)
        sure = view.confidence >= CONFIDENT
        self._seen.note(frame.stamp, sure or view.ahead_confidence >= CONFIDENT)
        cutting = self.phase is Phase.FOLLOW and then.speed_mps > STOPPED_MPS
        if (
            cutting
            and not view.crop_ahead_m >= END_CLEAR_M
            and self._shows_edge(self._along_m(then))
        ):
            self._ahead.sure.append(sure)
        moved = abs(then.distance_m - self._corrected_m) > MOVED_M
        # A contradiction that lasts while the machine stands is believed in the end.
        sure = sure and (not self._look.active or self._look.settled(frame.stamp))
        if sure and (moved or self._lane.contradicted) and self._on_lane(then):
            edge, heading = self._edge_m(view, then), view.edge_heading_rad
            if not self._leaps(edge, then):
                self._corrected_m = then.distance_m
                cut_m = self._cut_m(then) if self._ahead.entered else 0.0
                learn = self._teaches and cut_m > LEARN_AFTER_M
                seen = (edge, heading, view.confidence, since)
                self._lane.correct(*seen, ahead_m=view.edge_ahead_m, learn=learn)
                self._odometry.turn_trim(self._lane.take_bias())
                if moved and not self._lane.contradicted:
                    self._believe_heading()
                    self._search_on(view, then)
        elif sure and (moved or self._lane.contradicted):
            self._take_corner(view, then, since)
        self._take_dusty_edge(view, then)
        self._watch_ahead(view, then, frame.stamp)

    def _search_on(self, view: CropView, then: Motion) -> None:
        """A side whose first metres have gone with its neighbours: its edge was seen beside the
        lane, and so far at least it is looked for."""
        side = self._side()
        if side is not None and self._along_m(then) + view.crop_ahead_m < side.length_m:
            seen_m = self._cut_m(then) + view.crop_ahead_m + NEAR_CROP_M
            self._search_m = max(self._search_m, seen_m)

    def _take_dusty_edge(self, view: CropView, then: Motion) -> None:
        """Where no picture is sure for a while, what many show together."""
        unseen = abs(then.distance_m - self._corrected_m) > UNSEEN_M
        if self.phase is not Phase.FOLLOW or not self._ahead.entered or not unseen:
            self._dusty.clear()
            self._dust_doubts = False
            return
        edge = self._edge_m(view, then)
        seen = math.isfinite(edge) and view.confidence > 0.0
        if not seen or view.edge_ahead_m > NEAR_CROP_M or not self._on_lane(then):
            return
        self._dusty.note(then.stamp, edge + self._lane.blade_offset_m)
        line = self._dusty.take()
        if line is None:
            return
        # What lies inside may be the dust's border all the time.
        self._dust_doubts = line > INWARD_M and self._ahead.in_dust(*EDGE_SURE)
        if not self._dust_doubts:
            here = line - self._lane.blade_offset_m
            self._lane.correct(here, math.nan, CONFIDENCE, (0.0, 0.0), learn=self._teaches)
            self._believe_heading()

    def _edge_m(self, view: CropView, then: Motion) -> float:
        """The edge's offset from its place beside this side's lane, its bends taken off: those that
        the machine itself has driven a round earlier."""
        side = self._side()
        if side is None:
            return view.edge_offset_m
        bend = self._trails.bend_m(self._along_m(then) + view.edge_ahead_m, side)
        return view.edge_offset_m - side.shift_m - bend

    def _leaps(self, edge_m: float, then: Motion) -> bool:
        """Whether an edge lies so far inside that it is rather a patch of weeds' or the dust's."""
        settling = then.stamp - self._phase_stamp < LEAP_STAYS_S
        dusty = self.phase is Phase.FOLLOW or (self.phase is Phase.HESITATE and settling)
        known = self._side() is not None and self._position.known
        leap = edge_m + self._lane.blade_offset_m
        least = INWARD_M if self._ahead.in_dust(*EDGE_SURE) else LEAP_M
        return dusty and known and least < leap < self._vehicle.blade_width_m

    def _believe_heading(self) -> None:
        if self._side() is not None and self._position.known:
            _, heading, _, sigma = self._position.against_lane()
            sigma = max(HEADING_SIGMA_RAD, sigma)
            self._lane.correct_heading(heading, sigma, learn=self._teaches)

    @property
    def _teaches(self) -> bool:
        """Whether the present side is one that shows the steering's bias."""
        side = self._side()
        long = side is None or side.length_m > SHUTTLE_LEARN_M
        return long or self.turns == 0 or self._plan.corner_rad(self.turns - 1) != 0.0

    def _on_lane(self, then: Motion) -> bool:
        """Whether the edge in the picture taken then is the lane's: on a side, or backing along the
        next once the crop begins ahead of the blade; before that the picture shows the crop's
        flank, and so it does where the crop's border slants across the strip."""
        side = self._side()
        turning = self._turn is not None and self._turn.leg is not None
        if turning and not (self.backing and self._crop_expected_m() > CROP_SEEN_M):
            return False
        if side is None or not self._position.known:
            return True
        return self._shows_edge(self._along_m(then))

    def _shows_edge(self, along_m: float) -> bool:
        """Whether the side's outer edge, and no slanting border, is what a picture shows there."""
        side = self._side()
        if side is None:
            return True
        begin, end = side.edge_begin_m + CORNER_M, side.length_m - side.edge_end_m - CORNER_M
        return (side.edge_begin_m <= SQUARE_M or along_m >= begin) and (
            side.edge_end_m <= SQUARE_M or along_m <= end
        )

    def _take_corner(self, view: CropView, then: Motion, since: tuple[float, float]) -> None:
        """Where the crop's border slants across the strip, the right end that a picture shows is
        the corner from which the outer edge runs: a line of sight from the rear axle, near which
        the cameras sit. It tells a lane that is doubtful more than dead reckoning does."""
        side = self._side()
        turning = self._turn is not None and self._turn.leg is not None
        if side is None or turning or not self._position.known:
            return
        blade, ahead = self._vehicle.blade_x_m, view.edge_ahead_m
        corner = side.edge_begin_m - self._along_m(then)
        near = ahead < NEAR_CROP_M or corner <= ahead  # in the blade's dust, or past the corner
        if near or self._lane.offset_sigma_m < CORNER_SIGMA_M:
            return
        inset = self._vehicle.inset_m
        edge = (view.edge_offset_m - inset) * (blade + corner) / (blade + ahead) + inset
        edge -= side.shift_m
        if abs(edge + self._lane.blade_offset_m) > CORNER_SIGMAS * self._lane.offset_sigma_m:
            return  # another corner's: of what a round before has left, or of the next crop
        self._corrected_m = then.distance_m
        self._lane.correct(edge, math.nan, CONFIDENT, since, ahead_m=corner, learn=False)

    def _watch_ahead(self, view: CropView, then: Motion, stamp: float) -> None:
        """Notes where the side's crop begins and where it ends."""
        self._ahead.note(view, then)
        looking = self._look.for_end and self._look.settled(stamp)
        watches = self.phase in (Phase.SEARCH, Phase.FOLLOW) or looking
        if not watches or view.ahead_confidence < CONFIDENT:
            return
        self._ahead.sight(view, then)
        if self.phase is Phase.SEARCH:
            return
        begins = self._ahead.follow(view, EndOfField(stamp, then, self.turns))
        side = self._side()
        if begins and side is not None and self._position.known:
            ago = self.motion.distance_m - then.distance_m
            self._position.at_begin(side, ago - view.crop_ahead_m)

    # ---- phases ----------------------------------------------------------------------------------

    def _connect(self, now: float, telemetry: Telemetry) -> Command:
        if telemetry.state in (State.ARMED, State.RUNNING):
            self._go(now, Phase.ALIGN, "armed; waiting for a sure view of the edge")
            return self._hold()
        if now - self._asked < ARM_RETRY_S:
            return Command(Request.DRIVE, telemetry.angle_rad, reason=self.reason)
        self._asked = now
        if telemetry.state is State.FAULT:
            if self._cleared:
                self._go(now, Phase.FAULT, "the firmware's fault does not clear")
                return Command(Request.STOP, reason=self.reason)
            self._cleared = True
            return Command(Request.CLEAR, reason="clearing what the last run left")
        return Command(Request.ARM, reason="asking the firmware to arm")

    def _align(self, now: float, telemetry: Telemetry) -> Command:
        del telemetry
        view = self.view
        if view is None or view.ahead_confidence < CONFIDENT:
            return self._hold()
        waited = now - self._phase_stamp
        side = self._side()
        slanting = side is not None and side.edge_begin_m > SQUARE_M
        seen = view.confidence >= CONFIDENT and not slanting
        if not (seen or slanting) and (waited < TRUST_AFTER_S or side is None):
            return self._hold()
        if not seen:
            self._lane.place(0.0, 0.0, 0.05, math.radians(2))
        else:
            self._lane.place(0.0, 0.0, 0.15, math.radians(8))
            edge, heading = self._edge_m(view, self.motion), view.edge_heading_rad
            ahead = view.edge_ahead_m
            self._lane.correct(edge, heading, view.confidence, (0.0, 0.0), ahead_m=ahead)
        if side is not None:
            ahead = view.crop_ahead_m if view.ahead_confidence >= CONFIDENT else 0.0
            self._position.place(side, -ahead, self._lane.offset_m, self._lane.heading_rad)
        self._start_side(now, "the edge is in view" if seen else "on the operator's alignment")
        return self._hold()

    def _start_side(self, now: float, reason: str) -> None:
        self._turn = None
        self._ahead.begin()
        self._look = Look()  # shuttles drive the same way again: the last look's place says nothing
        self._run_from = self.motion
        self._backs = self._bare = 0
        self._go(now, Phase.FOLLOW, reason)

    def _follow(self, now: float, telemetry: Telemetry) -> Command:
        del telemetry
        clear = self._ahead.end
        if clear is not None:
            due = self._end_due(clear.motion)
            if due and not (self._plan.sides and self._ahead.in_dust(*END_SURE)):
                self._by_plan = False
                self._begin_turn(now, clear)
                return self._hold()
            again_m, since_m = END_LOOK_EVERY_M, self._look.at_m
            if not due:
                again_m, since_m = LOOK_EVERY_M, max(since_m, clear.motion.distance_m)
            if self.motion.distance_m - since_m > again_m:
                self._look_for_crop(now, LOOK_S if due else LONG_LOOK_S)
                return self._hold()
        side = self._side()
        if side is not None and side.blind_end and self._to_blind_end_m(side) <= 0:
            self._begin_turn(now, EndOfField(now, self.motion, self.turns))
            return self._hold()
        searched = not self._ahead.entered and self._cut_m(self.motion) > self._search_m
        if searched and self._ahead.crop_at_m - self.motion.distance_m > NO_CROP_M:
            return self._nothing_found(now)
        if self._overrun():
            if self._fence is None or self._by_plan:
                self._go(now, Phase.FAULT, "the side is longer than the boundary allows")
                return Command(Request.STOP, reason=self.reason)
            self._by_plan = True
            self._begin_turn(now, EndOfField(now, self.motion, self.turns))
            return self._hold()
        lane, vehicle = self._lane, self._vehicle
        self._anchor()
        if side is not None and self._ahead.entered:
            self._trails.note(self._along_m(self.motion), self.motion)
            self._learn_turn(side)
        quiet = now - self._seen.stamp
        if quiet > STOP_AFTER_S or lane.offset_sigma_m > LANE_SIGMA_M:
            why = self.view.reason if self.view is not None and self.view.reason else "no sure view"
            self._seen.broken = now
            self._go(now, Phase.HESITATE, f"the edge is lost: {why}")
            return self._hold()
        if self._worth_a_look():
            self._look.begin(now, self.motion.distance_m)
            self._go(now, Phase.HESITATE, f"the edge is unsure: {LOOKING}")
            return self._hold()
        steer = steering_law.follow(lane, self.motion, vehicle) - self._odometry.trim_rad
        if self._ahead.entered and now - self._phase_stamp < SPIN_S:
            return self._drive(steer, 0.0, True)
        slow = quiet > SLOW_AFTER_S or not self._ahead.entered or self._ahead.clear_count > 0
        speed = vehicle.manoeuvre_speed_mps if slow else vehicle.cutting_speed_mps
        return self._drive(steer, speed, self._crop_is_near())

    def _look_for_crop(self, now: float, time_s: float) -> None:
        """What seems clear ground may be dust before crop."""
        self._look.begin(now, self.motion.distance_m, time_s, for_end=True)
        self._ahead.clear_count = 0
        self._go(now, Phase.HESITATE, f"the crop seems to end: {LOOKING}")

    def _crop_is_near(self) -> bool:
        """Whether the blade must turn. On the way to a side's crop it would only raise dust, just
        where the edge is to be found."""
        if self._ahead.entered or self._side() is None or not self._position.known:
            return True
        here = self.motion
        seen = self._ahead.crop_at_m - here.distance_m
        return min(seen, -self._along_m(here)) < BLADE_ON_M

    def _worth_a_look(self) -> bool:
        """Whether the lane has become doubtful where its edge might be seen but for dust."""
        side, here = self._side(), self.motion
        if side is None or not self._ahead.entered or self._ahead.clear_count > 0:
            return False
        along = self._along_m(here)
        return (
            (self._lane.offset_sigma_m > DUST_SIGMA_M or self._dust_doubts)
            and abs(here.distance_m - self._corrected_m) > UNSEEN_M
            and abs(here.distance_m - self._look.at_m) > LOOK_EVERY_M
            and self._shows_edge(along - UNSEEN_M)
            and self._shows_edge(along + END_CLEAR_M)
        )

    def _learn_turn(self, side: Side) -> None:
        """Once on each side, where the lane is known again."""
        if self._turned_from is None or self._cut_m(self.motion) < TURN_KNOWN_M:
            return
        yaw, direction = self._turned_from
        self._turned_from = None
        reckoned = self.motion.yaw_rad - yaw
        true = self._direction_rad(side) - direction
        true = reckoned + math.remainder(true - reckoned, math.tau)
        if abs(reckoned) > TURN_LEAST_RAD:
            self._odometry.turned(reckoned, true)

    def _direction_rad(self, side: Side) -> float:
        """The vehicle's in the field frame, by the lane that it follows."""
        return side.heading_rad + self._lane.heading_rad

    def _nothing_found(self, now: float) -> Command:
        """Where the plan's crop does not stand: a short side may have gone with its neighbours."""
        side = self._side()
        if self._remnant:
            self._go(now, Phase.FINISHED, "nothing found of the plan's last remnant")
        elif side is not None and side.length_m < SKIP_SIDE_M:
            self._begin_turn(now, EndOfField(now, self.motion, self.turns))
            return self._hold()
        else:
            self._go(now, Phase.FAULT, "the crop that the plan has here is not to be found")
        return Command(Request.STOP, reason=self.reason)

    @property
    def _remnant(self) -> bool:
        """Whether what the plan has left is next to nothing."""
        areas = [side.length_m * side.width_m for side in self._plan.sides]
        return sum(areas[self.turns :]) < REMNANT * sum(areas)

    def _anchor(self) -> None:
        """Once per half metre cut along a side: its line is a known place."""
        side = self._side()
        here = self.motion
        since = self._anchored
        if side is None or not self._ahead.entered or not self._position.known:
            return
        if since is not None and abs(here.distance_m - since.distance_m) < ANCHOR_EVERY_M:
            return
        self._anchored = here
        self._position.follow(self._lane.blade_offset_m, self._lane.offset_sigma_m)

    def _cut_m(self, motion: Motion) -> float:
        """How far the blade has come along this side since it met the crop."""
        start = self._ahead.entered_at or self._run_from
        return motion.distance_m - start.distance_m if start is not None else 0.0

    def _along_m(self, motion: Motion) -> float:
        """How far the blade has come past the side's beginning: by the position, in which what was
        seen of that beginning has its part; without one, from where the crop was met."""
        side = self._side()
        if side is None or not self._position.known:
            return self._cut_m(motion)
        return self._position.along(side) - (self.motion.distance_m - motion.distance_m)

    def _to_blind_end_m(self, side: Side) -> float:
        """From where the blade will stop to where the side ends before a keep-out."""
        coast = self.motion.speed_mps * self._vehicle.drive_lag_s
        return side.length_m - self._along_m(self.motion) - coast

    def _side(self) -> Side | None:
        """The plan's side that is being cut, if there is a plan."""
        return self._plan.sides[self.turns] if self._plan.sides else None

    def _end_due(self, motion: Motion) -> bool:
        """Whether the plan lets the side end here. Clear ground well before is a bare patch: the
        machine creeps on over it. A slanting border's tip is too narrow to be seen. A side that is
        shorter than that allows does not end before it begins."""
        side = self._side()
        if side is None:
            return True
        doubt = 2 * self._odometry.scale_sigma
        last = self.turns + 1 == len(self._plan.sides)
        early = LAST_EARLY_M if last else EARLY_M + 2 * side.end_seen_m
        return self._along_m(motion) > max(0.0, (1 - doubt) * side.length_m - early)

    def _overrun(self) -> bool:
        """Whether the blade has passed the field's boundary, whatever vision says."""
        side = self._side()
        if side is None:
            return False
        farthest = (1 + self._odometry.scale_sigma) * self._along_m(self.motion)
        return farthest > side.fence_m + LATE_M

    def _blind(self, now: float) -> bool:
        """Whether a turn is to be broken off: it is driven by dead reckoning, but not without eyes,
        which everything after it depends on."""
        if now - self._usable.stamp <= STOP_AFTER_S:
            return False
        view = self.view
        why = view.reason if view is not None and not view.usable else "no pictures come"
        self._go(now, Phase.HESITATE, f"nothing is seen: {why}")
        return True

    def _hesitate(self, now: float, telemetry: Telemetry) -> Command:
        del telemetry
        if now - self._phase_stamp > GIVE_UP_S:
            if self._remnant:
                self._go(now, Phase.FINISHED, f"the last remnant shows nothing: {self.reason}")
            else:
                self._go(now, Phase.FAULT, f"gave up after {GIVE_UP_S:.0f} s: {self.reason}")
            return Command(Request.STOP, reason=self.reason)
        if self._turn is not None:
            steady = self._usable.held_s > RESUME_AFTER_S
            if steady and now - self._usable.stamp < SLOW_AFTER_S:
                self._turn.wait(now)
                self._go(now, Phase.TURN, "the camera sees again")
            return self._hold()
        if self._look.active:
            told = now - self._phase_stamp
            if told < STAND_S and not self._standing(told):
                # a blade that stops first pushes the last crop over instead of cutting it
                return replace(self._hold(), blade=True)
            if self._look.for_end:
                return self._look_at_end(now)
            seen = abs(self.motion.distance_m - self._corrected_m) < UNSEEN_M
            if seen or self._look.over(now):
                self._look.end()
                what = "the edge is in view again" if seen else "no clearer view: by dead reckoning"
                self._go(now, Phase.FOLLOW, what)
            return self._hold()
        steady = self._seen.held_s > RESUME_AFTER_S
        known = self._lane.offset_sigma_m < LANE_SIGMA_M
        if known and steady and now - self._seen.stamp < SLOW_AFTER_S:
            self._back_from = None
            self._go(now, Phase.FOLLOW, "the edge is in view again")
            return self._hold()
        return self._back_off(now)

    def _look_at_end(self, now: float) -> Command:
        """Without dust: no crop before the blade is the side's end, and so is what shows none in
        all the time of a look. Where the plan has no end it is a bare patch, or no lane at all."""
        if self._ahead.clear_since is None:
            self._look.crop_goes_on()
            self._bare = 0
        elif self._look.over(now) or self._ahead.end is not None:
            over, due = self._look.over(now), self._end_due(self._ahead.clear_since.motion)
            if due:
                self._look.end()
                self._by_plan = False
                self._begin_turn(now, self._ahead.clear_since, looked=True)
            elif over or not self._lane.contradicted:
                self._go_on_beyond(now)
        return self._hold()

    def _go_on_beyond(self, now: float) -> None:
        """After a look that showed no crop where the plan has some. An edge beside the lane that
        stayed in view is the lane's."""
        clear = self._ahead.end is not None
        self._ahead.go_on()
        self._look.end()
        seen = self._corrected_m > self._look.at_m
        self._bare = 0 if seen else self._bare + clear
        if self._bare > BARE_LOOKS and self.turns + 1 >= len(self._plan.sides):
            self._go(now, Phase.FINISHED, "no crop left on the last side")
        elif self._bare > BARE_LOOKS:
            self._go(now, Phase.FAULT, "the crop that the plan has here is not to be found")
        else:
            self._go(now, Phase.FOLLOW, "the edge is in view again" if seen else "bare ground")

    def _back_off(self, now: float) -> Command:
        """Nothing sure to be seen from here: some way back over the swath, the blade off, crop that
        filled the picture is a face again. Once for each hesitation, a few times for each side."""
        sees = now - self._usable.stamp < SLOW_AFTER_S
        if self._back_from is None:
            due = now - self._phase_stamp > BACK_AFTER_S and self._backed_stamp < self._phase_stamp
            clear = self.cut_m > BACK_M or self._fence is not None
            if due and sees and self._backs < BACKS and clear:
                self._back_from, self._backed_stamp = self.motion, now
                self._backs += 1
            return self._hold()
        coast = abs(self.motion.speed_mps) * self._vehicle.drive_lag_s
        if not sees or self._back_from.distance_m - self.motion.distance_m + coast > BACK_M:
            self._back_from = None
            return self._hold()
        steer = steering_law.reverse(self._lane.offset_m, self._lane.heading_rad, self._vehicle)
        steer -= self._odometry.trim_rad
        backing = self._drive(steer, -self._vehicle.manoeuvre_speed_mps, False)
        return replace(backing, reason=f"backing off to look again: {self.reason}")

    def _begin_turn(self, now: float, end: EndOfField, *, looked: bool = False) -> None:
        if self._plan.sides and self.turns + 1 >= len(self._plan.sides):
            self.ends.append(end)
            self._go(now, Phase.FINISHED, "the last side of the plan is cut")
            return
        side = self._side()
        seen = self._ahead.entered and not self._by_plan
        blind = side is not None and side.blind_end
        if side is not None and seen and not blind and self._position.known:
            first = self._ahead.seems_clear_since or end.motion
            ended_m = max(first.distance_m, end.motion.distance_m - DOUBTED_M)
            doubt = 0.0
            if looked:
                # Somewhere between where dust began to look like clear ground and here.
                doubt = (self.motion.distance_m - ended_m) / 2
            ago = self.motion.distance_m - ended_m - doubt
            drift = self._odometry.scale_sigma * self._cut_m(end.motion)
            share = self.view.tip_share if self.view is not None else math.nan
            share = share / SEEN_SHARE if math.isfinite(share) else 1.0
            as_seen = replace(side, end_seen_m=share * side.end_seen_m)
            self._position.at_end(as_seen, ago, drift, doubt)
        origin = self._end_of_lane(end)
        if side is not None:
            self._trails.end(side)
            known = self._ahead.entered and self._cut_m(self.motion) > TURN_KNOWN_M
            self._turned_from = (self.motion.yaw_rad, self._direction_rad(side)) if known else None
            self._trails.begin(self._plan.sides[self.turns + 1])
            self._position.begin(self._plan.sides[self.turns + 1])
        turn = next_turn(self._plan, self.turns, self._vehicle, self._room_m)
        self._turn = Turning(now, turn, origin)
        if seen:
            self.ends.append(end)
        self.turns += 1
        self._begin_leg(self._turn)
        self._search_m = math.inf
        self._ahead.turn()
        why = "the keep-out's margin" if blind else "no crop before the blade"
        why = "the plan's, which vision has not seen" if self._by_plan else why
        self._go(now, Phase.TURN, f"end of {self._plan.name(self.turns - 1)}: {why}")

    def _end_of_lane(self, end: EndOfField) -> tuple[float, float, float]:
        """The turn's frame in dead reckoning's (x, y, direction): the rear axle's place on the lane
        when the blade stands at the side's end. By the position, in which that end has its part;
        without one, where the end was declared."""
        here, side = self.motion, self._side()
        if side is not None and self._position.known:
            x, y, yaw = self._position.pose
            c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
            dx, dy = x - side.x_m, y - side.y_m
            along = c * dx + s * dy + self._vehicle.blade_x_m - side.length_m
            across = c * dy - s * dx - self._vehicle.inset_m + side.shift_m
            direction = here.yaw_rad - math.remainder(yaw - side.heading_rad, math.tau)
            c, s = math.cos(direction), math.sin(direction)
            x0 = here.x_m - c * along + s * across
            return x0, here.y_m - s * along - c * across, direction
        # The lane's direction, not the vehicle's momentary heading, is what the corner adds to.
        return end.motion.x_m, end.motion.y_m, here.yaw_rad - self._lane.heading_rad

    def _room_m(self, turn: Turn) -> float:
        """The least clearance to the geofence along a turn from the end of this side's lane."""
        side = self._side()
        if self._fence is None or side is None or not self._position.known:
            return ROOM_M
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        along = side.length_m - self._vehicle.blade_x_m
        inside = self._vehicle.inset_m - side.shift_m
        x, y = side.x_m + c * along - s * inside, side.y_m + s * along + c * inside
        return room_along(turn, (x, y, side.heading_rad), self._vehicle, self._fence)

    def _drive_turn(self, now: float, telemetry: Telemetry) -> Command:
        turn = self._turn
        assert turn is not None
        if self._blind(now):
            return self._hold()
        leg = turn.leg
        if leg is None:
            self._tries = self._empty = 0
            turn.since = now
            self._go(now, Phase.SEARCH, "turned; looking for the crop's edge")
            return self._hold()
        if self._leg_done(turn):
            self._next_leg(now, turn)
            return self._drive(leg.steer_rad, 0.0, False)
        steer = leg.steer_rad
        if leg.follow is not Follow.NOTHING:
            steer = steering_law.reverse(self._lane.offset_m, self._lane.heading_rad, self._vehicle)
            steer -= self._odometry.trim_rad
        if not turn.running:
            standing = self._standing(now - turn.since)
            ready = standing and abs(telemetry.angle_rad - steer) < STEER_READY_RAD
            if not ready:
                if now - turn.since > STEER_TIMEOUT_S:
                    self._go(now, Phase.FAULT, "the steering did not reach its angle")
                return self._drive(steer, 0.0, False)
            turn.running = True
        speed = self._vehicle.manoeuvre_speed_mps
        return self._drive(steer, -speed if leg.reverse else speed, False)

    def _standing(self, told_s: float) -> bool:
        """Whether the machine stands, as far as it can, told_s after it was told to."""
        speed = abs(self.motion.speed_mps)
        return speed < (STOPPED_MPS if told_s < STAND_S else CREEPING_MPS)

    def _leg_done(self, turn: Turning) -> bool:
        """Whether the goal is reached, or will be by coasting on. Backing along the new side goes
        on for a while until the machine is in line with it."""
        to_go = turn.to_go(self.motion, self._vehicle.drive_lag_s)
        side = self._side()
        cut = side.back_m if side is not None else 0.0
        room = min(ALIGN_ROOM_M[0] + cut, ALIGN_ROOM_M[1])
        if turn.backing and -room < to_go <= 0:
            lane = self._lane
            return abs(lane.blade_offset_m) < ALIGNED[0] and abs(lane.heading_rad) < ALIGNED[1]
        return to_go <= 0

    def _next_leg(self, now: float, turn: Turning) -> None:
        turn.next(now)
        self._begin_leg(turn)

    def _begin_leg(self, turn: Turning) -> None:
        """From here on the lane filter speaks of the new lane, where the leg follows that."""
        if not turn.backing:
            return
        scale = self._odometry.scale_sigma
        offset, turned = turn.against_lane(self.motion)
        offset_sigma = PLACE_SIGMA_M + 2 * scale
        heading_sigma = PLACE_SIGMA_RAD + turn.turn.lane_rad * scale
        if self._side() is not None and self._position.known:
            offset, turned, *sigmas = self._position.against_lane()
            offset_sigma = max(offset_sigma, sigmas[0])
            heading_sigma = max(heading_sigma, sigmas[1])
        self._lane.place(offset, turned, offset_sigma, heading_sigma)

    def _crop_expected_m(self) -> float:
        assert self._turn is not None
        return self._turn.crop_expected_m(self.motion, self._vehicle.blade_x_m)

    def _search(self, now: float, telemetry: Telemetry) -> Command:
        """Standing still after the turn: is there crop where it should be?"""
        if self._blind(now):
            return self._hold()
        view, turn = self.view, self._turn
        assert turn is not None
        standing = self._standing(now - self._phase_stamp)
        if not standing or self._view_stamp <= turn.since:
            return self._hold()
        turn.since = self._view_stamp
        self._tries += 1
        if view is None or view.ahead_confidence < CONFIDENT:
            if self._tries > 10 * SEARCH_PICTURES:
                self._go(now, Phase.FAULT, "nothing to be made out after the turn")
            return self._hold()
        if view.crop_ahead_m > self._crop_expected_m() + NO_CROP_M:
            self._empty += 1
            if self._empty >= SEARCH_PICTURES:
                self._nothing_there(now)
            return self._hold()
        # What the lane does not believe at once it learns here, where no dust is in the air.
        contradicted = self._lane.contradicted
        agreed = view.confidence >= CONFIDENT and not contradicted
        if agreed or self._tries >= SEARCH_PICTURES * (3 if contradicted else 1):
            self._start_side(
                now, f"{self._plan.name(self.turns)}: crop {view.crop_ahead_m:.1f} m ahead"
            )
        del telemetry
        return self._hold()

    def _nothing_there(self, now: float) -> None:
        """No crop in view after a turn: the end, unless the plan still has a long side here. Then
        the machine may be out of line, and looks for it along the lane."""
        side = self._side()
        if side is None or self._remnant:
            self._go(now, Phase.FINISHED, "no crop left beside the last swath")
        else:
            reach = side.length_m if side.length_m < SKIP_SIDE_M else NO_CROP_M
            self._search_m = self._crop_expected_m() + reach
            self._start_side(now, f"{self._plan.name(self.turns)}: no crop in view, looking for it")

    def _rest(self, now: float, telemetry: Telemetry) -> Command:
        del now, telemetry
        return Command(Request.STOP, reason=self.reason)
