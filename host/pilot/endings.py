"""How a side ends, how a hesitation ends, and what a turn without eyes leads to: transitions that
several behaviours share."""

from __future__ import annotations

import math
from dataclasses import replace

from host.estimate.crop_ahead import EndOfField
from host.pilot.context import SLOW_AFTER_S, Context, Ended
from host.pilot.guard import Watched
from host.pilot.phase import Doing, Go, Reason
from host.pilot.strip import Strip, little_m2
from host.pilot.turn_progress import Turning
from host.route.plan import Plan
from host.route.turn_choice import next_turn

LEFT_M2 = 1.0
"""That stays standing besides what the plan had shown: of more the owner is told."""
LEFT_SHARE = 0.05
"""Of the field: with more than that it is not harvested."""
GIVE_UP_S = 60.0
"""A hesitation that lasts this long needs a person."""
REGAINS, GAIN_M = 2, 1.5
"""Times, at most, that the machine goes back to the crop beside it on a side without having cut so
much farther: one that has did not go back in vain."""


class SideEnd(Reason):
    """A side is cut."""

    LAST = Doing.FINISH, "the last side of the plan is cut"
    SEEN = Doing.TURN, "end of {side}: no crop before the blade"
    KEEP_OUT = Doing.TURN, "end of {side}: the keep-out's margin"
    BENT = Doing.RETRACE, "end of {side}: back along its bends, to where the next strip begins"
    BY_PLAN = Doing.TURN, "end of {side}: the plan's, which vision has not seen"


class Over(Reason):
    """The plan is cut, and the field is not."""

    BROKEN_OFF = Doing.FINISH, "{reason}; not all that it left standing could be gathered: {why}"
    SOME_LEFT = (
        Doing.FINISH,
        "{reason}; some {left} m2 stand where it could not reach, or beside keep-outs",
    )
    MUCH_LEFT = (
        Doing.FAULT,
        "{reason}, but some {left} m2 stand where it could not reach, or beside keep-outs: plan "
        "them as a field of their own",
    )


class Elsewhere(Reason):
    """A side is cut, and before the turn something is to be found out or done at its end."""

    FOUND = Doing.LAY_OUT, "end of {side}: laying out the rest around the boundary as found"
    AT_BOUNDARY = Doing.LOOK_BEYOND, "end of {side}: looking how far the next crop stands"


class Beside(Reason):
    """The machine has come off its crop, or is led off it."""

    REGAIN = Doing.REGAIN, "the crop stands beside the machine: going back to drive along it"
    AGAIN = (
        Doing.REGAIN,
        "clear ground for {clear} m where the plan has crop: going back to look from there",
    )
    PAST = Doing.TURN, "{side}: past what stands beside it, to where it goes on"


class Standing(Reason):
    """The plan is at its end, and by the blade's way some of its crop still stands."""

    LEFT = Doing.GATHER, "{reason}; looking for what is left standing"
    ANOTHER = Doing.GATHER, "{reason}; on to what else is left standing"


class Patience(Reason):
    """A hesitation has lasted too long."""

    REMNANT = Doing.FINISH, "the last remnant shows nothing: {reason}"
    GAVE_UP = Doing.FAULT, "gave up after {seconds} s: {reason}"


class Blind(Reason):
    """A turn is driven by dead reckoning, but not without eyes, which everything after it depends
    on."""

    NOTHING_SEEN = Doing.WAIT_FOR_CAMERA, "nothing is seen: {why}"


def end_side(
    context: Context, now: float, end: EndOfField, *, looked: bool = False, refused: bool = False
) -> Go:
    """Ends the present side, and lays out what comes next; `looked`: the end was seen after the
    machine had stopped to look; `refused`: no picture shows one, the geofence lets it go no
    farther."""
    strip, sight = context.strip, context.sight
    if looked:
        context.by_plan = False
    if strip.last:
        context.ends.append(end)
        return SideEnd.LAST.go()
    seen = sight.ahead.entered and not (context.by_plan or refused)
    ended = Ended(end, seen, refused)
    if seen and not strip.blind_end:
        strip.met_end(end, sight.view, looked=looked)
        beyond = strip.gap_beyond()
        if beyond is not None and not context.gaps.knows(beyond.edge):
            context.ended = ended
            return Elsewhere.AT_BOUNDARY.go(side=strip.name)
    return leave_side(context, now, ended)


def leave_side(context: Context, now: float, ended: Ended) -> Go:
    """From the side that has ended to the next, once all is known that its end shows."""
    strip = context.strip
    if context.to_lay_anew():
        context.ended = ended
        return Elsewhere.FOUND.go(side=strip.name)
    return turn_on(context, now, ended)


def leave_strip(context: Context, now: float) -> Go:
    """Ends the present side beside a keep-out. What is left of it stays standing."""
    context.left_standing_m2 += context.strip.left_m2
    end = EndOfField(now, context.motion)
    return end_side(context, now, end, refused=True)


def end_by_plan(context: Context, now: float) -> Go | None:
    """Ends the present side where the plan has next to nothing more of it, or nothing, though no
    picture shows an end; not twice in a row. What is left of it stays standing."""
    if context.by_plan:
        return None
    context.by_plan = True
    context.left_standing_m2 += context.strip.left_m2
    return end_side(context, now, EndOfField(now, context.motion))


def may_regain(context: Context) -> bool:
    """Whether the machine has come off its strip's crop, which is seen beside it or with its edge
    elsewhere, and has not come back to it in vain."""
    beside = context.sight.beside(context.motion) or context.estimate.cut.beside
    return beside and back_in_vain(context) < REGAINS


def back_in_vain(context: Context) -> int:
    """How often it has gone back on this side without having cut on since."""
    least_m = context.estimate.cut.cut_m - GAIN_M
    return sum(at_m > least_m for at_m in context.regained)


def little_left(context: Context) -> bool:
    """Whether so little of the plan is left, from the present side on, that the harvest may end
    without it."""
    return context.left_m2 + _rest_m2(context) < little_m2(context.plan)


def leave_rest(context: Context) -> bool:
    """The same. Then that stays standing."""
    little = little_left(context)
    if little:
        context.left_standing_m2 += _rest_m2(context)
    return little


def _rest_m2(context: Context) -> float:
    """Of the plan, from the present side on."""
    strip, sides = context.strip, context.plan.sides
    if not strip.placed:
        return math.inf
    whole_m2 = sides[strip.index].length_m * sides[strip.index].width_m
    return strip.rest_m2 + (strip.left_m2 if context.turning is None else whole_m2)


def or_gather(context: Context, go: Go) -> Go:
    """Where the harvest would end with `go`, it goes on to what is left standing. With a doubt that
    is for a person to decide it may go elsewhere first, and again once that has gained
    something."""
    strip, position = context.strip, context.estimate.position
    remains, cut_m = context.remains, context.estimate.swaths.cut_m
    placed = strip.placed and position.known and context.guard.fenced
    if remains.over or not placed:
        return go
    if go.reason.to is Doing.FAULT:
        if not (context.place_known and remains.gives_up(cut_m)):
            return go
        if context.gathering:
            return Standing.ANOTHER.go(reason=go.text)
        context.left_standing_m2 += _rest_m2(context)
    if not remains.ended_by:
        remains.begins(cut_m, go.text, context.plan.unreached_m2 + context.left_standing_m2)
    return Standing.LEFT.go(reason=go.text)


def or_elsewhere(context: Context, go: Go) -> Go:
    """The same where no gap lies beside the strip, or others have left it: what the machine cannot
    do there may be left, and the rest gone to, before a person must see."""
    stays = context.strip.outermost and not context.gathering
    return go if stays else or_gather(context, go)


def _of_the_machine(reason: Reason) -> bool:
    """Whether something is wrong with it, and not with what it believes of the field."""
    return isinstance(reason, Watched) and reason is not Watched.GEOFENCE


def over(context: Context, go: Go) -> Go:
    """What the harvest ends with, where a transition would finish it. Around corners that were
    found elsewhere a plan may reach less than the one that the owner saw."""
    if go.reason.to is Doing.FINISH:
        go = or_gather(context, go)
    if go.reason.to is Doing.FAULT and context.gathering and not _of_the_machine(go.reason):
        context.end_gathering()
        go = Over.BROKEN_OFF.go(reason=context.remains.ended_by, why=go.text)
    left_m2 = context.left_m2
    if go.reason.to is not Doing.FINISH or left_m2 <= LEFT_M2:
        return go
    much = left_m2 > LEFT_SHARE * context.plan.area_m2
    return (Over.MUCH_LEFT if much else Over.SOME_LEFT).go(reason=go.text, left=f"{left_m2:.0f}")


def turn_on(context: Context, now: float, ended: Ended, *, retraced: bool = False) -> Go:
    """Lays out the turn from the side that has ended to the next; `retraced`: the machine has
    backed along its bends."""
    strip, sight, end = context.strip, context.sight, ended.end
    if strip.last:
        context.ends.append(end)
        return SideEnd.LAST.go()
    shuttles = context.plan.corner_rad(strip.index) == 0.0
    if strip.bent and shuttles and not retraced:
        context.ended = ended
        return SideEnd.BENT.go(side=strip.name)
    following = context.planned(strip.index + 1)
    origin = strip.leave(following, end, shuttles=shuttles)
    room_from = strip.end_pose(shuttles=shuttles)
    doubt_m = following.begin_doubt_m if shuttles else 0.0
    turn = next_turn(
        outward(context.plan, following),
        strip.index,
        context.vehicle,
        lambda t: context.guard.room_m(t, room_from) - doubt_m,
    )
    turning = context.turning = Turning(now, turn, origin)
    if ended.seen:
        context.ends.append(end)
    context.strip = following
    if turning.backing or turning.beside:
        following.begin_leg(turning)
    sight.ahead.turn()
    if context.by_plan:
        return SideEnd.BY_PLAN.go(side=strip.name)
    at_keep_out = strip.blind_end or ended.refused
    return (SideEnd.KEEP_OUT if at_keep_out else SideEnd.SEEN).go(side=strip.name)


def outward(plan: Plan, following: Strip) -> Plan:
    """The plan as the turn to the following strip has to take it: its lane where the turn is to
    lead, and no more room at its beginning than is sure."""
    if following.outward_m == 0.0 and following.begin_doubt_m == 0.0:
        return plan
    sides, at = list(plan.sides), following.index
    sides[at] = replace(sides[at], shift_m=sides[at].shift_m + following.outward_m)
    gap_m = None if plan.gap_m is None else max(0.0, plan.gap_m - following.begin_doubt_m)
    return replace(plan, sides=tuple(sides), gap_m=gap_m)


def gave_up(context: Context, now: float) -> Go | None:
    """Whether it has hesitated for too long."""
    if now - context.since <= GIVE_UP_S:
        return None
    if little_left(context):
        return Patience.REMNANT.go(reason=context.reason)
    go = Patience.GAVE_UP.go(seconds=f"{GIVE_UP_S:.0f}", reason=context.reason)
    # With nothing to be made out here, nothing will be elsewhere, but for stems before the lens.
    sees = now - context.sight.seen.stamp < SLOW_AFTER_S
    return or_gather(context, go) if sees or context.hidden else go


def blind(context: Context, now: float) -> Go | None:
    """Whether a turn is to be broken off."""
    if not context.blind(now):
        return None
    view = context.sight.view
    why = view.reason if view is not None and not view.usable else "no pictures come"
    return Blind.NOTHING_SEEN.go(why=why)
