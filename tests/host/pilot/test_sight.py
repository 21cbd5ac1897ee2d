"""What a picture tells, depending on what the machine is doing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Frame
from host.estimate.crop_ahead import EDGE_SURE
from host.estimate.edges_together import PICTURES
from host.pilot.behaviours import BEHAVIOURS
from host.pilot.behaviours.back_off import BackOff
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.look_at_end import LookAtEnd
from host.pilot.behaviours.search import Search
from host.pilot.behaviours.turn import DriveTurn
from host.pilot.gaze import Gaze
from host.pilot.leaps import LEAP_PICTURES
from host.pilot.phase import Doing
from host.pilot.planned_strip import PlannedStrip
from host.pilot.sight import ASIDE_M, LOST_M
from host.pilot.turn_progress import Turning
from host.pilot.whose_edge import WhoseEdge
from host.route.turn_legs import shuttle
from host.vision.view import BESIDE_AHEAD_M, CropView
from tests.helpers.behaving import (
    CUTTING,
    NOW,
    PLAN,
    VEHICLE,
    Shown,
    backing,
    moved,
    on_side,
    told,
    turned,
)
from tests.helpers.places import wandered


@pytest.mark.parametrize(
    ("early_m", "from_m", "seen"), [(0.0, -0.1, True), (0.4, -0.1, False), (0.0, 1.5, False)]
)
def test_where_a_strip_begins_shows_while_the_machine_backs_away_from_it(
    early_m: float, from_m: float, seen: bool
) -> None:
    """Not over what its wheels have pressed down, nor with the blade inside the strip."""
    context = on_side(cut_m=None, eye=Shown(replace(CUTTING, crop_ahead_m=0.5)))
    turning = backing(context, early_m)
    for k in range(10):
        stamp = NOW + 0.1 * k
        moved(context, from_m - 0.03 * k, -0.3, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, context.look.settled)
    assert math.isfinite(context.sight.ahead.begins_at_m) is seen


@pytest.mark.parametrize("turns", [True, False])
def test_what_a_turning_machine_sees_against_its_lane_makes_that_no_more_doubtful(
    turns: bool,
) -> None:
    """Crop that stands elsewhere passes before it; what lasts beside a machine on its lane does."""
    elsewhere = replace(CUTTING, edge_offset_m=1.2, crop_ahead_m=0.5, edge_ahead_m=0.5)
    context = on_side(cut_m=None, eye=Shown(elsewhere))
    turning = backing(context, 0.0) if turns else None
    lane = context.estimate.lane
    context.estimate.position.place(context.strip.planned_piece, 0.0, 0.0, 0.0)
    before = lane.offset_sigma_m
    for k in range(10):
        stamp = NOW + 0.1 * k
        moved(context, -1.0 - 0.06 * k, -0.6, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, context.look.settled)
        if k == LEAP_PICTURES - 1:
            assert lane.contradicted
    assert (lane.offset_sigma_m < 1.1 * before) is turns


@pytest.mark.parametrize(("askew_deg", "taken"), [(0.0, True), (50.0, True), (75.0, False)])
@pytest.mark.parametrize("gaze", [DriveTurn.gaze, Search.gaze])
def test_standing_across_the_next_lane_no_edge_is_its(
    monkeypatch: pytest.MonkeyPatch, gaze: Gaze, askew_deg: float, taken: bool
) -> None:
    """Between two legs of a turn that the geofence has broken off."""
    monkeypatch.setattr(WhoseEdge, "is_lanes", lambda *_: True)
    context = turned()
    assert context.turning is not None
    against = (0.0, math.radians(askew_deg))
    monkeypatch.setattr(context.turning, "against_lane", lambda _: against)
    context.sight.edge_at_m = 0.0
    frame = Frame(NOW + 0.1, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, gaze, context.strip, context.turning, lambda _: True)
    assert (context.sight.edge_at_m > 0.0) is taken


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "tells", "goes_on"),
    [(1.4, 0.3, True, True), (1.6, 0.3, False, True), (1.6, 0.6, False, False)],
)
def test_an_edge_far_ahead_tells_that_the_strip_goes_on_and_nothing_of_the_lane(
    ahead_m: float, aside_m: float, *, tells: bool, goes_on: bool
) -> None:
    """Of sure ones one in five is another's, in every picture on the way there."""
    shown = replace(
        CUTTING, edge_offset_m=aside_m, edge_ahead_m=ahead_m, crop_ahead_m=ahead_m, confidence=0.95
    )
    context = on_side(cut_m=None, eye=Shown(shown))
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.05)
    context.strip.search_m = 0.0
    for k in range(LEAP_PICTURES):
        moved(context, 0.1 + 0.05 * k, 0.3, stamp=NOW + 0.1 * k)
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Search.gaze, context.strip, None, context.look.settled)
    assert (context.estimate.lane.blade_offset_m < -0.05) is tells
    assert (context.strip.search_m > ahead_m) is goes_on


@pytest.mark.parametrize("inside_m", [0.1, 0.3])
def test_a_sure_edge_inside_is_believed_in_the_dust_too(inside_m: float) -> None:
    """Of the detector's sure pictures in dust 5 % err inside and 13 % outside. Edges inside that
    were refused as the dust's were right in nine of ten, and the machine drove on beside its crop
    (model field 23)."""
    context = on_side(cut_m=3.0, eye=Shown(replace(CUTTING, edge_offset_m=inside_m)))
    context.estimate.lane.place(0.0, 0.0, 0.2, 0.02)
    context.sight.ahead.sure.extend([False] * EDGE_SURE[1])
    telemetry = context.telemetry
    assert telemetry is not None
    context.sight.edge_at_m = 0.0
    for k in range(LEAP_PICTURES):
        stamp = NOW + 0.1 * k
        blade = replace(telemetry, stamp=stamp, blade=True)
        context.estimate.cut.take_telemetry(blade)
        moved(context, 3.0 + 0.05 * k, 0.5, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, context.look.settled)
    assert context.sight.edge_at_m > 0.0
    assert context.estimate.lane.blade_offset_m < -0.05


@pytest.mark.parametrize(("turned_s", "taken"), [(1.0, False), (3.0, True)])
@pytest.mark.parametrize("gaze", [Follow.gaze, BackOff.gaze])
def test_an_edge_far_inside_is_the_dusts_only_while_the_blade_has_turned_of_late(
    gaze: Gaze, turned_s: float, taken: bool
) -> None:
    """A machine that the guard of its blade held in place saw its edge 0.6 m inside, surely, for
    four seconds, and believed none of it (model field 12379)."""
    context = on_side(cut_m=3.0, eye=Shown(replace(CUTTING, edge_offset_m=0.6)))
    telemetry = context.telemetry
    assert telemetry is not None
    context.estimate.cut.take_telemetry(replace(telemetry, stamp=NOW + 0.01, blade=True))
    context.sight.edge_at_m = 0.0
    for k in range(2 * LEAP_PICTURES):
        stamp = NOW + turned_s + 0.01 * k
        moved(context, 3.0 + 0.02 * k, 0.2, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, gaze, context.strip, None, lambda _: True)
    assert (context.sight.edge_at_m > 0.0) is taken


@pytest.mark.parametrize(("stood_s", "tells"), [(3.0, True), (0.5, False)])
def test_where_its_beginning_slants_a_standing_machine_takes_the_corner_for_its_edge(
    stood_s: float, tells: bool
) -> None:
    """At the blade, once its dust has settled, where the lane is doubtful (random field 10133)."""
    slanting = replace(PLAN.sides[0], edge_begin_m=1.5)
    plan = replace(PLAN, sides=(slanting, *PLAN.sides[1:]))
    at_blade = replace(CUTTING, confidence=0.9, edge_offset_m=0.1, crop_ahead_m=0.0)
    context = on_side(plan=plan, cut_m=0.3, eye=Shown(at_blade))
    for _ in range(45):
        wandered(context.estimate.position, 1.0, context.motion)
    moved(context, 0.2, stamp=NOW)
    lane = context.estimate.lane
    before_m = lane.offset_sigma_m
    context.estimate.cut.blade_stamp = NOW - stood_s
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    settled = context.look.settled
    context.sight.take(frame, BackOff.gaze, context.strip, None, settled)
    assert (lane.offset_sigma_m < 0.8 * before_m) is tells


@pytest.mark.parametrize(
    ("lost_m", "aside"),
    [(LOST_M - 0.2, False), (LOST_M + 0.5, True), (LOST_M + ASIDE_M + 0.2, False)],
)
@pytest.mark.parametrize("shown", [CropView(0.0, crop_right=True), CropView(0.0)])
def test_crop_on_the_right_leads_aside_for_as_far_as_an_edge_may_lie(
    lost_m: float, aside: bool, shown: CropView
) -> None:
    """Without a look before that; and no farther without one."""
    context = on_side(cut_m=0.5, eye=Shown(shown))
    edge_at_m = context.sight.edge_at_m
    for k in range(12):
        now = NOW + 0.1 * k
        moved(context, edge_at_m + lost_m - 0.01 * (11 - k), 0.5, stamp=now)
        frame = Frame(now, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, context.look.settled)
    assert context.moves_aside(now) is (aside and shown.crop_right)
    assert not context.moves_aside(now + 10.0), "without eyes"


@pytest.mark.parametrize("doing", Doing)
def test_only_pictures_of_the_cut_itself_say_how_dusty_it_is(doing: Doing) -> None:
    context = on_side()
    moved(context, 5.1, 0.4)
    kind = BEHAVIOURS[doing]
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, kind.gaze, context.strip, None, context.look.settled)
    assert list(context.sight.ahead.sure) == ([True] if kind is Follow else [])


def test_over_a_slanting_border_no_edge_is_missed() -> None:
    """None is to be seen there: that says nothing of dust."""
    slanting = replace(PLAN.sides[0], edge_begin_m=3.0)
    plan = replace(PLAN, sides=(slanting, *PLAN.sides[1:]))
    for along_m, sure in ((2.0, []), (4.0, [True])):
        context = on_side(plan=plan, cut_m=along_m)
        moved(context, along_m, 0.4)
        frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, context.look.settled)
        assert list(context.sight.ahead.sure) == sure


# ---- crop beside the machine ---------------------------------------------------------------------


BESIDE = replace(
    CUTTING, confidence=0.0, edge_offset_m=math.nan, crop_ahead_m=math.inf, edge_beside_m=0.6
)
"""Nothing stands ahead, and crop beside the way."""


@pytest.mark.parametrize(("cut_m", "is_lane"), [(5.0, True), (9.5, False)])
def test_where_nothing_stands_ahead_the_edge_beside_the_way_is_the_lanes(
    cut_m: float, is_lane: bool
) -> None:
    """But where the side is about to end, what stands there is another's."""
    eye = Shown(BESIDE)
    context = on_side(cut_m=cut_m, eye=eye)
    context.estimate.position.less_sure(0.3, 0.0)
    before = context.estimate.lane.blade_offset_m
    context.sight.edge_at_m = cut_m - 0.5
    for k in range(LEAP_PICTURES):
        frame = Frame(context.motion.stamp + 0.1 * k, np.zeros((1, 1, 3), np.uint8))
        context.sight.take(frame, LookAtEnd.gaze, context.strip, None, lambda _: True)
    moved_m = context.estimate.lane.blade_offset_m - before
    assert (moved_m < -0.3) is is_lane, "the lane lies left of the machine"
    assert context.sight.beside(context.motion) is is_lane


@pytest.mark.parametrize(("backed_m", "is_lane"), [(0.0, True), (0.9, True), (2.1, False)])
def test_beside_what_the_machine_has_cut_the_next_strip_stands(
    backed_m: float, is_lane: bool
) -> None:
    """It went back over that to look again, took the edge of what stood beside it for its lane's,
    and left its strip half standing (picture field 10458)."""
    context = on_side(cut_m=5.0, eye=Shown(BESIDE))
    cut, stamp = context.estimate.cut, NOW
    for k in range(1, 11):
        cut.take_picture(NOW - 0.5 + 0.01 * k, CUTTING)
    assert cut.over_cut_m == 0.0
    for k in range(1, round(backed_m / 0.03) + 1):
        stamp = NOW + 0.1 * k
        back = replace(told(-0.3, 5.0 - 0.03 * k), stamp=stamp, drive_duty=-60)
        context.estimate.take_telemetry(back)
    assert cut.over_cut_m == pytest.approx(backed_m, abs=0.3)
    context.estimate.position.less_sure(0.3, 0.0)
    before = context.estimate.lane.blade_offset_m
    context.sight.edge_at_m = 4.5 - backed_m
    for k in range(LEAP_PICTURES):
        frame = Frame(stamp + 0.1 * k, np.zeros((1, 1, 3), np.uint8))
        context.sight.take(frame, LookAtEnd.gaze, context.strip, None, lambda _: True)
    assert (context.estimate.lane.blade_offset_m - before < -0.3) is is_lane
    assert context.sight.beside(context.motion) is is_lane


@pytest.mark.parametrize("blade", [True, False])
@pytest.mark.parametrize(("beside_m", "mown"), [(0.6, True), (0.95, True), (1.3, False)])
def test_beside_where_the_blade_has_turned_what_it_has_left_stands_and_tells_nothing_of_the_lane(
    beside_m: float, mown: bool, blade: bool
) -> None:
    """No picture had shown the lodged crop that it cut there at the blade: it took the face that
    it had left for its strip's edge, a blade's width inside (picture field 10571)."""
    context = on_side(cut_m=3.0, eye=Shown(replace(BESIDE, edge_beside_m=beside_m)))
    stamp, at_m = NOW, 3.0
    for step_m, spins in ((0.03, blade), (-0.03, False)):
        for _ in range(60):
            stamp, at_m = stamp + 0.1, at_m + step_m
            told_now = replace(
                told(10 * step_m, at_m), stamp=stamp, drive_duty=round(2000 * step_m)
            )
            context.estimate.take_telemetry(replace(told_now, blade=spins))
    context.estimate.position.less_sure(0.5, 0.0)
    before = context.estimate.lane.blade_offset_m
    context.sight.edge_at_m = 2.0
    for k in range(LEAP_PICTURES):
        frame = Frame(stamp + 0.1 * k, np.zeros((1, 1, 3), np.uint8))
        context.sight.take(frame, LookAtEnd.gaze, context.strip, None, lambda _: True)
    is_lane = not (mown and blade)
    assert (context.estimate.lane.blade_offset_m - before < -0.3) is is_lane
    assert context.sight.beside(context.motion) is is_lane


@pytest.mark.parametrize(
    ("ahead_m", "end_m", "beside_m", "unsure_m", "taken_m"),
    [
        pytest.param(3.0, math.nan, 0.2, 0.5, 0.2, id="crop is seen beside the way alone"),
        pytest.param(3.0, -0.3, 0.2, 0.5, 0.2, id="what stands far ahead is another's"),
        pytest.param(3.0, -0.3, math.nan, 0.5, 0.0, id="and tells nothing"),
        pytest.param(0.0, -0.3, 0.2, 0.5, -0.3, id="it reaches before the blade"),
        pytest.param(0.0, -0.05, 0.2, 0.5, 0.0, id="it ends at the picture's border"),
        pytest.param(
            0.0, -0.6, 0.2, 0.02, 0.0, id="it reaches farther than the machine can be off"
        ),
        pytest.param(3.0, math.nan, 0.6, 0.5, 0.6, id="it has left its swath unawares"),
        pytest.param(3.0, math.nan, 0.6, 0.02, 0.0, id="it is too sure of its lane for that"),
    ],
)
def test_backing_beside_the_next_strip_a_machine_sees_how_far_off_that_is(
    ahead_m: float, end_m: float, beside_m: float, unsure_m: float, taken_m: float
) -> None:
    """Its crop's right end, against where it should be beside a whole swath: in the machine's way,
    or beside that. The detector looks for what stands beside the way from the way's border on, so
    it is wrong where the crop reaches into the way."""
    next_m = VEHICLE.pass_m
    flank = replace(
        CUTTING,
        crop_ahead_m=ahead_m,
        edge_offset_m=next_m + end_m,
        edge_beside_m=next_m + beside_m,
    )
    context = on_side(cut_m=5.0, eye=Shown(flank))
    assert isinstance(context.strip, PlannedStrip)
    context.estimate.lane.place(-next_m, 0.0, 0.05, 0.02)
    context.strip.place(5.0)
    turn = shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0)
    turning = Turning(NOW, turn, (0.0, 0.0, 0.0))
    assert turning.beside
    context.strip.begin_leg(turning)
    context.estimate.position.less_sure(unsure_m, 0.0)
    before = context.estimate.lane.blade_offset_m
    for k in range(PICTURES):
        stamp = NOW + 0.1 * k
        moved(context, 5.0 - 0.03 * k, -0.3, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, context.look.settled)
    left_m = before - context.estimate.lane.blade_offset_m
    assert left_m == pytest.approx(taken_m, rel=0.1, abs=0.01)


def test_a_machine_that_backs_askew_sees_the_next_strip_before_it_elsewhere() -> None:
    """That is no other place: turned left of the lane by 5 degrees, it has a point 1.2 m before the
    blade a decimetre farther left."""
    next_m, turned_rad = VEHICLE.pass_m, math.radians(5.0)
    seen_m = next_m - BESIDE_AHEAD_M * math.sin(turned_rad)
    view = replace(BESIDE, crop_ahead_m=3.0, ahead_confidence=1.0, edge_beside_m=seen_m)
    context = on_side(cut_m=5.0, eye=Shown(view))
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(5.0)
    turning = Turning(NOW, shuttle(VEHICLE, -8.0, next_m, 3.0), (0.0, 0.0, 0.0))
    context.strip.begin_leg(turning)
    context.estimate.lane.place(-next_m, turned_rad, 0.3, 0.001)
    before = context.estimate.lane.blade_offset_m
    for k in range(PICTURES):
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, context.look.settled)
    aside_m = VEHICLE.blade_x_m * math.sin(turned_rad)
    assert before == pytest.approx(aside_m - next_m, abs=0.02)
    moved_m = context.estimate.lane.blade_offset_m - before
    assert moved_m == pytest.approx(-aside_m, abs=0.03), "its edge is a swath left of the blade"


def test_what_most_pictures_show_beside_the_way_back_is_right() -> None:
    """One in fifty, and some after it, shows half a metre of crop where there is none."""
    next_m = VEHICLE.pass_m
    right = replace(BESIDE, crop_ahead_m=3.0, ahead_confidence=1.0, edge_beside_m=next_m)
    eye = Shown(right)
    context = on_side(cut_m=5.0, eye=eye)
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(5.0)
    turning = Turning(NOW, shuttle(VEHICLE, -8.0, next_m, 3.0), (0.0, 0.0, 0.0))
    context.strip.begin_leg(turning)
    context.estimate.lane.place(-next_m, 0.0, 0.3, 0.001)
    for k in range(PICTURES):
        eye.view = replace(right, edge_beside_m=next_m - 0.5) if k < PICTURES // 2 - 1 else right
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, context.look.settled)
    assert context.sight.edge_at_m < math.inf
    assert context.estimate.lane.blade_offset_m == pytest.approx(-next_m, abs=0.01)


def test_beside_an_edge_that_teaches_no_rates_pictures_are_surer() -> None:
    """Along straight ones what they err alike turned the machine (random fields 11666, 11747)."""
    next_m, unsure_m = VEHICLE.pass_m, {}
    view = replace(BESIDE, crop_ahead_m=3.0, ahead_confidence=1.0, edge_beside_m=next_m)
    for recorded in (False, True):
        plan = replace(PLAN, sigma_m=0.3, recorded=recorded)
        context = on_side(plan=plan, cut_m=5.0, eye=Shown(view))
        assert isinstance(context.strip, PlannedStrip)
        context.strip.place(5.0)
        turning = Turning(NOW, shuttle(VEHICLE, -8.0, next_m, 3.0), (0.0, 0.0, 0.0))
        context.strip.begin_leg(turning)
        context.estimate.lane.place(-next_m, 0.0, 0.3, 0.001)
        frames = [Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8)) for k in range(PICTURES)]
        for frame in frames:
            gaze, settled = DriveTurn.gaze, context.look.settled
            context.sight.take(frame, gaze, context.strip, turning, settled)
        unsure_m[recorded] = context.estimate.lane.offset_sigma_m
    assert unsure_m[True] < 0.9 * unsure_m[False]


def test_what_was_seen_beside_one_way_back_tells_nothing_of_the_next() -> None:
    next_m = VEHICLE.pass_m
    view = replace(BESIDE, crop_ahead_m=3.0, ahead_confidence=1.0, edge_beside_m=next_m + 0.2)
    context = on_side(cut_m=5.0, eye=Shown(view))
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(5.0)
    back = Turning(NOW, shuttle(VEHICLE, -8.0, next_m, 3.0), (0.0, 0.0, 0.0))
    context.strip.begin_leg(back)
    context.estimate.lane.place(-next_m, 0.0, 0.3, 0.02)
    before = context.estimate.lane.blade_offset_m
    for k in range(PICTURES + 1):
        turning = None if k == PICTURES - 1 else back
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, lambda _: False)
    assert context.estimate.lane.blade_offset_m == before


@pytest.mark.parametrize(
    ("side", "left_m", "ahead_m"),
    [(3, 6.0, 0.0), (3, 2.5, math.inf), (3, 0.3, math.inf), (0, 2.5, 0.0), (0, 0.3, 0.0)],
)
def test_what_seems_to_lie_is_crop_only_where_the_plan_has_crop_beyond_doubt_or_no_swath_lies(
    side: int, left_m: float, ahead_m: float
) -> None:
    """The first round's last side ends at its first one's swath, and a gap behind it."""
    view = replace(BESIDE, ahead_confidence=1.0, edge_beside_m=math.nan, lies_confidence=0.8)
    context = on_side(side, cut_m=PLAN.sides[side].length_m - left_m, eye=Shown(view))
    frame = Frame(context.motion.stamp, np.zeros((1, 1, 3), np.uint8))
    context.sight.take(frame, Follow.gaze, context.strip, None, lambda _: True)
    assert context.sight.view is not None
    assert context.sight.view.crop_ahead_m == ahead_m
