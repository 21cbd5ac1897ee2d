"""What may stop or slow any behaviour: the geofence, and what telemetry and the receiver say that
must not be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.core.frames import Pose2
from host.core.messages import Command, Request, State
from host.core.vehicle import Vehicle
from host.estimate.borders import Borders
from host.estimate.course_check import ELSEWHERE_RAD
from host.estimate.estimator import Estimator
from host.estimate.moved_place import MOST_M, WAY_M
from host.estimate.position import Position
from host.field import sweep
from host.field.areas import GAP_MARGIN_M, Geofence, Level, Verdict, areas_of, outline_of, placed
from host.link.protocol import Fault, fault_texts
from host.pilot.keep_clear import KeepClear
from host.pilot.phase import Doing, Go, Reason
from host.route.manoeuvre import Room
from host.route.plan import Plan
from host.route.standing import parts_of
from host.route.turn_choice import ROOM_M, room_along
from host.route.turn_legs import Turn

CREEP_MPS = 0.15
"""Near the geofence."""
NEARER = ((1.0, 0.2), (1.0, 0.1), (1.0, 0.0), (0.5, 0.0), (0.0, 0.0))
"""Shares of what is not known of a border, and m, that a way keeps clear of it, if it can: the
first is what a blade sweeps on the lock in a creep until it stands. With a share of less than one
the machine may stand somewhere, and lead away from it."""
ASTRAY_SIGMAS = 5.0
ASTRAY_M = 2.0
"""Of a walked corner: what moves it farther than both is no walk's error."""
INTO_CROP_M = 0.6
"""So far into standing crop the machine may reach on its way elsewhere: where it has just cut, half
of the blade is beside it."""
LEADS_AWAY_S = 0.5
LEADS_AWAY_M = 1e-3
"""Where the machine will be in so long its clearance must be more than now, for a motion near the
geofence to lead away from it."""


class Watched(Reason):
    """What stops the machine whatever it is doing, but for connecting."""

    FIRMWARE_FAULT = Doing.FAULT, "the firmware reports a fault: {why}"
    DISARMED = Doing.FAULT, "the firmware has disarmed: it was stopped or restarted"
    TOO_FAST = Doing.FAULT, "the wheels' sensor counts faster than it can drive"
    BACKWARDS = (
        Doing.FAULT,
        "it moves the other way: downhill, or by drive motors wired the wrong way",
    )
    ASKEW = (
        Doing.FAULT,
        "the receiver's courses show it {deg} deg askew of the plan: its strips have turned, put "
        "it on a corner of what stands",
    )
    ELSEWHERE = (
        Doing.FAULT,
        "the receiver's courses show it {deg} deg askew of the plan: it was put down at another "
        "corner than was said, or the other way round",
    )
    WRONG_SPEED = (
        Doing.FAULT,
        "{why}: it loses pulses or counts false ones, or hall_per_metre is wrong; check sensor, "
        "magnets, cable and calibration",
    )
    WHEEL_PLACE = (
        Doing.FAULT,
        "in one leg of a turn the gyroscope shows {least} times what the wheel's sensor and the "
        "steering say, in the next {most} times: hall_left_m names another wheel than the one that "
        "is counted, or the steering's middle is far off; measure both",
    )
    PICTURES = Doing.FAULT, "the pictures do not move as the machine does: {why}"
    POT_OFF = (
        Doing.FAULT,
        "the machine steers {deg} deg farther to the {side} than its potentiometer says, by what "
        "it has turned: check how that is fastened, and calibrate the steering's middle anew",
    )
    ASTRAY = (
        Doing.FAULT,
        "a corner of the boundary seems to lie {off_m} m from where it was walked: the machine "
        "has lost its place, put it on a corner of what stands",
    )
    MOVED = (
        Doing.FAULT,
        "what it has seen within {way_m} m of way has moved its place by {moved_m} m: it has lost "
        "it, put the machine on a corner of what stands",
    )
    GEOFENCE = Doing.FAULT, "{why}"


def watch(state: State, estimate: Estimator, faults: int = 0) -> Go | None:
    """The reason to stop for good, if there is one; `faults`: the firmware's, bit by bit."""
    if state is State.FAULT:
        return Watched.FIRMWARE_FAULT.go(why="; ".join(fault_texts(Fault(faults))) or "none named")
    if state is State.SAFE:
        return Watched.DISARMED.go()
    if estimate.odometry.impossible:
        return Watched.TOO_FAST.go()
    if estimate.backwards:
        return Watched.BACKWARDS.go()
    if estimate.speed.wrong:
        return Watched.WRONG_SPEED.go(why=estimate.speed.wrong)
    legs = estimate.odometry.wheel_place.wrong
    if legs is not None:
        return Watched.WHEEL_PLACE.go(least=f"{legs[0]:.1f}", most=f"{legs[1]:.1f}")
    if estimate.pictures.wrong:
        return Watched.PICTURES.go(why=estimate.pictures.wrong)
    off_rad = estimate.odometry.pot_off_rad
    if off_rad != 0.0:
        side = "left" if off_rad > 0.0 else "right"
        return Watched.POT_OFF.go(deg=f"{math.degrees(abs(off_rad)):.0f}", side=side)
    if estimate.askew_rad != 0.0:
        askew_rad = abs(estimate.askew_rad)
        why = Watched.ELSEWHERE if askew_rad > ELSEWHERE_RAD else Watched.ASKEW
        return why.go(deg=f"{math.degrees(askew_rad):.0f}")
    astray_m = estimate.position.outline.astray_m
    if astray_m > max(ASTRAY_M, ASTRAY_SIGMAS * estimate.position.sigma_m):
        return Watched.ASTRAY.go(off_m=f"{astray_m:.0f}")
    moved_m = estimate.moved.moved_m
    if moved_m > MOST_M:
        return Watched.MOVED.go(way_m=f"{WAY_M:.0f}", moved_m=f"{moved_m:.1f}")
    return None


@dataclass(frozen=True, slots=True)
class SeenFree:
    """What pictures say of the way ahead."""

    crop_m: float = math.inf
    """The field's end is no nearer than so far before where it is taken to be: that far, the crop
    that is being cut was seen to go on. inf: nothing is known of that."""
    clear_m: float = math.inf
    """On the ground around the field: how far before the blade the next crop stands; inf: nothing
    is known of that."""


class Guard:
    """The geofence of a plan with boundary and gap; without them everything passes."""

    def __init__(
        self,
        plan: Plan,
        vehicle: Vehicle,
        position: Position,
        nearer: Mapping[int, float] = MappingProxyType({}),
    ) -> None:
        self.nearer = dict(nearer)
        """By the boundary's edge: what stands beyond it nearer than the gap is wide, m."""
        self._vehicle = vehicle
        self._position = position
        self._outline = outline_of(vehicle)
        self._fence: Geofence | None = None
        self._clear = KeepClear((), 0.0, vehicle, position)
        if plan.boundary and plan.gap_m is not None:
            field = shapely.Polygon(plan.boundary, plan.keep_outs)
            margin = min(GAP_MARGIN_M, plan.gap_m)
            areas = areas_of(field, plan.gap_m, margin_m=margin, nearer=nearer)
            self._fence = Geofence(areas)
            rings = [list(out.exterior.coords) for out in areas.keep_outs]
            self._clear = KeepClear(rings, self._fence.sigmas, vehicle, position)

    @property
    def fenced(self) -> bool:
        """Whether there is a geofence."""
        return self._fence is not None

    @property
    def permitted(self) -> shapely.Polygon | None:
        """Where the machine may be, keep-outs apart; None without a geofence."""
        return self._fence.permitted if self._fence is not None else None

    def keep_clear(self) -> KeepClear:
        """What the keep-outs near the machine's present place ask for."""
        if self._position.known:
            self._clear.look()
        return self._clear

    def room_m(self, turn: Turn, at: tuple[float, float, float] | None) -> float:
        """The least clearance along a turn that begins at `at` (x, y, heading in the field frame);
        without fence or place as much as is wanted."""
        if self._fence is None or at is None:
            return ROOM_M
        return room_along(turn, at, self._vehicle, self._fence)

    def room_around(self, at: Pose2, standing: Sequence[shapely.Polygon] = ()) -> Room | None:
        """The areas and the machine's uncertain place in a frame in which it is at `at`, and the
        `standing` crop that it is not to drive through; None without fence or place. Where the
        machine may be at two places, the borders lie where they do from either."""
        if self._fence is None or not self._position.known:
            return None
        rooms = [self._room_around(at, borders) for borders in self._position.all_borders]
        rooms += [_crop_around(at, Pose2(*self._position.pose), part) for part in standing]
        return Room(
            np.concatenate([room.sides for room in rooms]),
            np.concatenate([room.margins for room in rooms], axis=1),
        )

    def _room_around(self, at: Pose2, borders: Borders) -> Room:
        """The same of one place."""
        assert self._fence is not None
        x, y, yaw = borders.pose
        axle = np.array([x, y])
        outline = placed(self._outline, x, y, yaw)
        covariance, shifts = borders.against(outline, self._nearest(borders))
        turn = at.heading_rad - yaw
        c, s = math.cos(turn), math.sin(turn)
        into = np.array([[c, s], [-s, c]])
        ends = self._fence.sides.reshape(-1, 2, 2)
        found = ((ends + shifts[:, np.newaxis] - axle) @ into + np.array(at[:2])).reshape(-1, 4)
        normals = self._fence.normals
        each = np.broadcast_to(covariance, (len(ends), *covariance.shape[1:]))
        across = np.einsum("mi,mnij,mj->mn", normals, each, normals)
        doubts = np.sqrt(np.maximum(across.max(axis=1), 0.0))
        sigmas = self._fence.sigmas
        margins = np.array([share * sigmas * doubts + more_m for share, more_m in NEARER])
        return Room(found, margins)

    def limit(self, command: Command, seen: SeenFree = SeenFree()) -> Command | Verdict:
        """The command as the geofence lets it pass, whatever vision says, or why it does not. What
        leads away from the border is let pass slowly: a machine that stands too near must be able
        to leave. What was `seen` makes the border no wider, only the position against it surer. Of
        two places at which the machine may be, neither may be too near."""
        if self._fence is None or not self._position.known:
            return command
        for at, borders in enumerate(self._position.all_borders):
            if command.request is not Request.DRIVE or command.speed_mps == 0.0:
                return command
            limited = self._limit(command, seen, borders)
            if isinstance(limited, Verdict):
                return replace(limited, elsewhere=at > 0)
            command = limited
        return command

    def _limit(self, command: Command, seen: SeenFree, borders: Borders) -> Command | Verdict:
        """The same of one place."""
        verdict = self._verdict(command, seen, borders)
        if verdict.level is Level.CLEAR:
            return command
        slow = math.copysign(min(abs(command.speed_mps), CREEP_MPS), command.speed_mps)
        slowly = replace(command, speed_mps=slow, reason=f"{command.reason}; {verdict.reason}")
        if self._verdict(slowly, seen, borders).level is not Level.STOP:
            return slowly
        return slowly if self._leads_away(command, borders) else verdict

    def _leads_away(self, command: Command, borders: Borders) -> bool:
        """Whether the machine will have more room a little later."""
        assert self._fence is not None
        x, y, yaw = borders.pose
        now = placed(self._outline, x, y, yaw)
        later = np.empty_like(now)
        sweep.moved(now, (x, y), *self._motion(command, yaw), LEADS_AWAY_S, later)
        room, room_later = (
            self._fence.clearance(borders.as_planned(outline)) for outline in (now, later)
        )
        return room_later > room + LEADS_AWAY_M

    def _motion(self, command: Command, yaw_rad: float) -> tuple[tuple[float, float], float]:
        """The rear axle's velocity, m/s, field frame, and the yaw rate, rad/s: on the lock a
        machine's blade swings to where its axle does not go."""
        speed = command.speed_mps
        rate = speed * math.tan(command.steer_rad) / self._vehicle.wheelbase_m
        return (speed * math.cos(yaw_rad), speed * math.sin(yaw_rad)), rate

    def _verdict(self, command: Command, seen: SeenFree, borders: Borders) -> Verdict:
        """The geofence's answer."""
        assert self._fence is not None
        x, y, yaw = borders.pose
        outline = placed(self._outline, x, y, yaw)
        covariance, shifts = borders.against(outline, self._nearest(borders))
        planned = borders.as_planned(outline)
        nearer_m = seen.crop_m
        if math.isfinite(seen.clear_m) and command.speed_mps > 0.0:
            clear = self._fence.clearance(planned)
            nearer_m = min(nearer_m, max(0.0, clear - (seen.clear_m - GAP_MARGIN_M)))
        if math.isfinite(nearer_m):
            flat = covariance.reshape(-1, 2, 2)
            flat = no_farther(flat, yaw, nearer_m / self._fence.sigmas)
            covariance = flat.reshape(covariance.shape)
        motion = self._motion(command, yaw)
        return self._fence.check(
            outline, covariance, *motion, (x, y), shifts=shifts, planned=planned
        )

    def _nearest(self, borders: Borders) -> NDArray[np.float64]:
        """(m, 2) of each side of the geofence, as planned, the place nearest to the machine."""
        assert self._fence is not None
        x, y, _ = borders.pose
        axle = borders.as_planned(np.array([[x, y]]))
        return self._fence.nearest(axle[0])


def _crop_around(at: Pose2, pose: Pose2, part: shapely.Polygon) -> Room:
    """Standing crop in a frame in which the machine, whose pose in the field that is, is at
    `at`: its blade may reach into it beside the way, not more."""
    inner = part.buffer(-INTO_CROP_M, join_style="mitre")
    rings = [left.exterior for left in parts_of(inner) if not left.is_empty]
    sides = [np.zeros((0, 4))]
    for ring in rings:
        seen = [at.ahead(*pose.seen_from(x, y)) for x, y in ring.coords]
        places = np.array([there[:2] for there in seen])
        sides.append(np.hstack([places[:-1], places[1:]]))
    found = np.concatenate(sides)
    return Room(found, np.zeros((len(NEARER), len(found))))


def no_farther(
    covariance: NDArray[np.float64], heading_rad: float, sigma_m: float
) -> NDArray[np.float64]:
    """(n, 2, 2) covariances with no more than that standard deviation along a direction."""
    found = np.empty_like(covariance)
    _squeeze(covariance, math.cos(heading_rad), math.sin(heading_rad), sigma_m, found)
    return found


@compiled("(f8[:, :, ::1], f8, f8, f8, f8[:, :, ::1])")
def _squeeze(
    covariance: NDArray[np.float64], wx: float, wy: float, most: float, out: NDArray[np.float64]
) -> None:
    """`no_farther` along (wx, wy); numpy takes ten times as long for a handful."""
    for k in range(covariance.shape[0]):
        c = covariance[k]
        across = wx * (c[0, 0] * wx + c[0, 1] * wy) + wy * (c[1, 0] * wx + c[1, 1] * wy)
        along = math.sqrt(across) if across > 0.0 else 0.0
        gone = 1.0 - min(1.0, most / along) if along > 0.0 else 0.0
        xx, xy, yy = 1.0 - gone * wx * wx, -gone * wx * wy, 1.0 - gone * wy * wy
        # From the left, then from the right.
        a00, a01 = xx * c[0, 0] + xy * c[1, 0], xx * c[0, 1] + xy * c[1, 1]
        a10, a11 = xy * c[0, 0] + yy * c[1, 0], xy * c[0, 1] + yy * c[1, 1]
        out[k, 0, 0], out[k, 0, 1] = a00 * xx + a01 * xy, a00 * xy + a01 * yy
        out[k, 1, 0], out[k, 1, 1] = a10 * xx + a11 * xy, a10 * xy + a11 * yy
