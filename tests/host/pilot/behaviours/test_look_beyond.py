"""At the end of a side at the boundary: what pictures show of the ground beyond it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from host.core.vehicle import Vehicle
from host.estimate.crop_beyond import HEIGHT_M
from host.estimate.cut_guard import CutGuard
from host.estimate.gaps import SEEN_M
from host.estimate.measurements.end import EARLY_M
from host.estimate.prior import START_SIGMA
from host.field.areas import GAP_MARGIN_M, Level, Verdict
from host.pilot.behaviours.lay_out import LayOut
from host.pilot.behaviours.look_beyond import APART_M, PICTURES, PLACES, STAND_M, LookBeyond
from host.pilot.behaviours.look_beyond import Why as Beyond
from host.pilot.behaviours.wait_for_camera import WaitForCamera
from host.pilot.behaviours.wait_for_camera import Why as Waited
from host.pilot.context import FARTHEST_M, Context
from host.pilot.endings import Blind, Elsewhere, SideEnd, end_side
from host.pilot.gaze import STOP_AFTER_S
from host.pilot.phase import Doing, Go, Reason
from host.pilot.planned_strip import PlannedStrip
from host.route.anew import Anew
from host.route.plan import Plan, spiral
from host.vision.view import CropView
from tests.helpers.behaving import NOW, clear_ahead, moved, on_side, seeing, stands

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
PLAN = spiral(SQUARE, 1, VEHICLE, gap_m=2.0)


def at_end(cut_m: float = 10.0, plan: Plan = PLAN) -> Context:
    """At the end of the first side, by pictures, having cut so far by the wheels."""
    context = on_side(plan=plan, cut_m=cut_m)
    go = end_side(context, NOW, clear_ahead(context))
    assert go.reason is Elsewhere.AT_BOUNDARY
    assert go.reason.to is Doing.LOOK_BEYOND
    return context


def room_m(context: Context, edge: int) -> float:
    """How far beyond the middle of an edge of the square the machine may be, with the margin that
    it keeps."""
    permitted = context.guard.permitted
    assert permitted is not None
    west, south, east, north = permitted.bounds
    reach = {0: -south, 1: east - 10.0, 2: north - 10.0, 3: -west}[edge]
    return float(reach) + GAP_MARGIN_M


def pictures(context: Context, behaviour: LookBeyond, ahead_m: float, count: int) -> Go | None:
    """So many, taken without dust from where the machine stands, of crop so far ahead."""
    go = None
    for k in range(count):
        stamp = NOW + 1.5 + 0.1 * k
        seeing(context, CropView(0.0, crop_ahead_m=ahead_m, ahead_confidence=1.0), stamp=stamp)
        command, go = behaviour.step(stamp)
        assert stands(command)
    return go


def look(
    context: Context,
    shows: Callable[[float], float],
    by_height_m: Callable[[float], float] = lambda _: math.nan,
    why: Reason = SideEnd.SEEN,
) -> list[float]:
    """Drives the behaviour to its end, which is `why`. `shows(at_m)`: how far before the blade
    pictures from at_m beyond the side's end show crop, and `by_height_m(at_m)` the same by how high
    that looks. Returns the places that it looked from."""
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    end_m, now = context.motion.distance_m, NOW
    at_m, places, go = 0.0, [0.0], None
    while go is None:
        now += 0.1
        ahead_m, high_m = shows(at_m), by_height_m(at_m)
        view = CropView(0.0, crop_ahead_m=ahead_m, ahead_by_height_m=high_m, ahead_confidence=1.0)
        seeing(context, view, stamp=now)
        command, go = behaviour.step(now)
        assert not command.blade
        if command.speed_mps == 0.0 and abs(at_m - places[-1]) > 0.1:
            places.append(at_m)
        at_m += 0.1 * command.speed_mps
        moved(context, end_m + at_m, command.speed_mps, stamp=now)
        assert now < NOW + 60.0
    assert go.reason is why
    assert at_m == pytest.approx(0.0, abs=0.05), "it comes back"
    return places[:-1] if len(places) > 1 else places


def stands_at(crop_m: float, pitch_deg: float = 0.0) -> Callable[[float], float]:
    """What pictures show of crop so far beyond the end, by a low camera that looks so much lower
    than is believed."""

    def shows(at_m: float) -> float:
        ahead_m = crop_m - at_m
        from_axle_m = VEHICLE.blade_x_m + ahead_m
        return ahead_m - math.radians(pitch_deg) * from_axle_m**2 / HEIGHT_M

    return shows


def test_enough_pictures_are_looked_at_before_it_goes_on() -> None:
    for count, decided in ((PICTURES - 1, False), (PICTURES, True)):
        context = at_end()
        behaviour = LookBeyond(context)
        behaviour.enter(NOW)
        go = pictures(context, behaviour, FARTHEST_M, count)
        assert (go is not None) is decided


def test_it_goes_nearer_until_the_next_crop_is_known_and_no_nearer_than_is_clear() -> None:
    for crop_m in (1.0, 1.5, 2.0):
        places = look(at_end(), stands_at(crop_m))
        assert 1 < len(places) <= PLACES
        assert max(places) < crop_m - STAND_M


@pytest.mark.parametrize("pitch_deg", [1.5, 2.0])
def test_a_camera_that_looks_lower_than_is_believed_narrows_no_gap(pitch_deg: float) -> None:
    """Its first look shows crop half a metre too near, or more."""
    context = at_end()
    shows = stands_at(2.0, pitch_deg)
    assert shows(0.0) < 2.0 - 0.5
    look(context, shows)
    assert context.plan.gap_m == 2.0


@pytest.mark.parametrize("pitch_deg", [-1.5, 0.0, 1.5])
def test_a_gap_narrower_than_was_said_is_found_whatever_the_camera_s_pitch(
    pitch_deg: float,
) -> None:
    context = at_end()
    look(context, stands_at(1.2, pitch_deg))
    assert context.plan.gap_m == pytest.approx(1.2 - EARLY_M - SEEN_M, abs=0.3)


@pytest.mark.parametrize(("every", "place_m"), [(1, 0.78), (PICTURES, 0.33)])
def test_how_high_the_next_crop_looks_counts_where_most_pictures_tell_it(
    every: int, place_m: float
) -> None:
    """The machine stands nose-down: the foot seems 0.9 m nearer than the crop is."""
    shown = itertools.count()

    def by_height_m(at_m: float) -> float:
        return 2.0 - at_m if next(shown) % every == 0 else math.nan

    _, second, *_ = look(at_end(), lambda at_m: 1.1 - at_m, by_height_m)
    assert second == pytest.approx(place_m, abs=0.1)


def test_by_what_was_said_the_next_crop_comes_nearer_with_the_blade() -> None:
    """The last crop of the side is no more seen a decimetre before the blade meets its end."""
    context = at_end()
    assert context.next_crop_m() == pytest.approx(2.0 + EARLY_M, abs=0.01)
    moved(context, context.motion.distance_m + 0.3, stamp=NOW)
    assert context.next_crop_m() == pytest.approx(1.7 + EARLY_M, abs=0.01)
    assert on_side(8, PLAN, cut_m=6.0).next_crop_m() == math.inf, "ground that is cut"


def test_beyond_an_edge_it_looks_once() -> None:
    context = on_side(plan=PLAN, cut_m=10.0)
    context.gaps.note(2, 2.0)
    assert end_side(context, NOW, clear_ahead(context)).reason is SideEnd.SEEN


def test_pictures_from_before_the_dust_has_settled_do_not_count() -> None:
    context = at_end()
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    for k in range(2 * PICTURES):
        stamp = NOW + 0.01 * k
        seeing(context, CropView(0.0, crop_ahead_m=0.3, ahead_confidence=1.0), stamp=stamp)
        assert behaviour.step(stamp)[1] is None


def test_a_look_that_shows_nothing_ends_all_the_same() -> None:
    context = at_end()
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    go = behaviour.step(NOW + 10.0)[1]
    assert go is not None and go.reason is SideEnd.SEEN
    assert context.plan.gap_m == 2.0


def test_where_no_crop_is_in_view_one_look_is_enough() -> None:
    context = on_side(plan=replace(PLAN, gap_m=4.0), cut_m=10.0)
    end_side(context, NOW, clear_ahead(context))
    assert look(context, lambda _: FARTHEST_M + 1.0) == [0.0]


def test_crop_right_before_the_blade_is_looked_at_from_farther_back() -> None:
    places = look(at_end(), stands_at(0.5))
    assert places == pytest.approx([-k * APART_M for k in range(PLACES)], abs=0.1)


def test_crop_that_stands_nearer_than_any_next_crop_is_the_sides_own_and_is_cut() -> None:
    """It had left the turn no room at all (model field 11455). And where the blade's guard had
    refused to go on, that ended the side at once again (11926)."""
    context = at_end()
    context.estimate.cut.refused = True
    sure_m = context.estimate.position.end_sigma_m(PLAN.sides[0])
    look(context, stands_at(0.1), why=Beyond.END_WAS_NONE)
    assert context.plan.gap_m == 2.0
    here = context.motion
    assert not context.strip.end_due(replace(here, distance_m=here.distance_m + 0.1))
    assert context.strip.end_due(replace(here, distance_m=here.distance_m + 0.4))
    assert context.sight.ahead.end is None
    assert not context.estimate.cut.refused
    assert not context.gaps.knows(2), "the end that is one is looked at"
    assert context.estimate.position.end_sigma_m(PLAN.sides[0]) > sure_m + 0.1


def test_a_side_is_not_said_twice_to_go_on() -> None:
    """A tuft that the blade does not cut must not hold the machine there."""
    context = at_end()
    look(context, stands_at(0.1), why=Beyond.END_WAS_NONE)
    end_side(context, NOW, clear_ahead(context))
    look(context, stands_at(0.1))


def test_behind_clear_ground_as_long_as_a_gap_crop_is_not_the_sides_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Wherever the side was taken to end on it: the blade's guard counts all of it."""
    monkeypatch.setattr(CutGuard, "clear_m", 0.9)
    look(at_end(), stands_at(0.1))


def test_one_look_does_not_show_that_a_side_goes_on() -> None:
    context = at_end()
    context.sight.ahead.entered_at = context.motion
    assert look(context, stands_at(0.1)) == [0.0]


def test_a_short_strip_leaves_no_room_for_that() -> None:
    context = at_end()
    context.sight.ahead.entered_at = context.motion
    assert look(context, stands_at(0.5)) == [0.0]


def test_a_tuft_before_the_crop_narrows_no_gap_where_the_other_looks_contradict_it() -> None:
    context = at_end()
    look(context, lambda at_m: 0.5 if abs(at_m) < 0.1 else 2.0 - at_m)
    assert context.plan.gap_m == 2.0


def test_what_the_geofence_stops_is_judged_by_what_was_seen() -> None:
    context = at_end()
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    assert pictures(context, behaviour, 1.2, PICTURES) is None
    stop = Verdict(Level.STOP, "too near", 0.1)
    assert behaviour.blocked(NOW, stop) is None, "it goes back to the side's end"
    moved(context, context.motion.distance_m - 0.1, -0.3, stamp=NOW + 5.0)
    go = behaviour.blocked(NOW + 5.0, stop)
    assert go is not None and go.reason is SideEnd.SEEN
    assert context.plan.gap_m == pytest.approx(1.2 - EARLY_M - SEEN_M, abs=0.05)


def test_on_its_way_nearer_the_geofence_is_told_what_is_seen_to_be_clear() -> None:
    context = at_end()
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    assert behaviour.seen_free(NOW + 5.0).clear_m == math.inf, "an old picture tells nothing"
    seeing(context, CropView(0.0, crop_ahead_m=1.2, ahead_confidence=1.0), stamp=NOW)
    assert behaviour.seen_free(NOW).clear_m == pytest.approx(1.2)


def test_crop_where_it_should_stand_narrows_nothing() -> None:
    context = at_end()
    before = context.guard
    look(context, stands_at(2.0))
    assert context.plan.gap_m == 2.0
    assert context.guard is before


@pytest.mark.parametrize("cut_m", [9.0, 8.8])
def test_an_end_that_is_seen_without_dust_is_believed_against_the_wheels(cut_m: float) -> None:
    """A sensor that loses a tenth of its pulses: by it the machine is a metre before the end."""
    context = at_end(cut_m)
    strip = context.strip
    assert isinstance(strip, PlannedStrip)
    look_from = strip.along_m(context.motion)
    context.saw_beyond(2.0)
    assert strip.along_m(context.motion) > look_from
    assert strip.along_m(context.motion) == pytest.approx(10.0, abs=0.15)


def test_ground_without_any_crop_beyond_proves_no_end() -> None:
    """So dust before a fallow looks, and what is believed of a sensor must not hang on it."""
    context = at_end(9.0)
    before = context.strip.along_m(context.motion)
    context.saw_beyond(FARTHEST_M)
    assert context.strip.along_m(context.motion) == before


def test_without_clear_ground_an_end_proves_nothing() -> None:
    context = at_end(9.0)
    before = context.strip.along_m(context.motion)
    context.saw_beyond(0.4)
    assert context.strip.along_m(context.motion) == before
    assert not context.gaps.knows(2)
    assert context.plan.gap_m == 2.0


@pytest.mark.parametrize(("ahead_m", "gap_m"), [(0.7, 0.7 - EARLY_M), (0.1, 2.0)])
def test_crop_closer_than_an_end_leaves_the_turn_that_room_unless_it_is_misread(
    ahead_m: float, gap_m: float
) -> None:
    """The pictures that ended the side showed 0.8 m of clear ground, or more: 0.7 m agrees with
    that, 0.1 m does not."""
    context = at_end()
    context.sight.ahead.clear_count, context.sight.ahead.clear_since = 3, clear_ahead(context)
    context.saw_beyond(ahead_m)
    assert room_m(context, 2) == pytest.approx(gap_m, abs=0.05)
    assert not context.gaps.knows(2)


def test_an_end_that_a_look_has_shown_leaves_the_turn_no_more_room_than_that_look() -> None:
    context = at_end()
    context.sight.ahead.go_on()
    context.saw_beyond(0.3)
    assert room_m(context, 2) == pytest.approx(0.3 - EARLY_M, abs=0.05)
    assert "beyond the side's end" in context.gaps.wrong


def test_what_stands_close_beyond_an_end_leaves_the_other_edges_their_room() -> None:
    """What stands there may be the side's own. With so little room all around a machine would not
    even be let back along its own swath (random field 10638)."""
    context = at_end()
    context.sight.ahead.go_on()
    context.saw_beyond(0.3)
    assert [room_m(context, edge) for edge in (0, 1, 3)] == pytest.approx([2.0] * 3)
    context.begin_strip()
    assert room_m(context, 2) == pytest.approx(2.0), "it is the turn's alone"


def test_what_stands_close_beyond_counts_still_when_the_rest_has_been_laid_out_anew() -> None:
    """Which is done between the look and the turn."""
    context = at_end(plan=spiral(SQUARE, 1, VEHICLE, gap_m=2.0, sigma_m=0.5))
    context.sight.ahead.go_on()
    context.saw_beyond(0.3)
    before, now, go = context.plan, NOW, None
    corners = context.estimate.position.outline.corners
    context.anew = Anew(before, corners, before.cut_along(1), VEHICLE)
    behaviour = LayOut(context)
    while go is None:
        now += 0.05
        assert now < NOW + 10.0
        _, go = behaviour.step(now)
    assert context.plan is not before
    assert room_m(context, 2) == pytest.approx(0.3 - EARLY_M, abs=0.1)
    assert room_m(context, 1) == pytest.approx(2.0, abs=0.1)


def test_crop_right_beyond_an_end_that_may_be_none_may_be_the_sides_own_and_proves_no_gap() -> None:
    """It had left the turn no room at all (model field 10304)."""
    context = on_side(plan=PLAN, cut_m=8.5)
    context.strip.ends_at(8.5)
    end_side(context, NOW, clear_ahead(context))
    assert context.estimate.position.likely > 0.0
    context.sight.ahead.go_on()
    context.saw_beyond(0.3)
    assert context.plan.gap_m == 2.0
    context.saw_beyond(2.0)
    assert context.strip.along_m(context.motion) == pytest.approx(10.0, abs=0.3), "it was one"


def test_a_side_that_ends_at_cut_ground_shows_nothing_of_the_gap() -> None:
    inner = on_side(8, PLAN, cut_m=6.0).strip
    assert inner.gap_beyond() is None
    assert on_side(0, replace(PLAN, gap_m=None), cut_m=10.0).strip.gap_beyond() is None


@pytest.mark.parametrize(("gap_m", "inside_m"), [(3.0, 0.0), (1.0, 0.95)])
def test_a_machine_without_room_in_the_gap_stands_in_its_crop(
    gap_m: float, inside_m: float
) -> None:
    """It is 1.75 m long behind its blade's line, and keeps 0.2 m to the neighbour's crop."""
    strip = on_side(0, spiral(SQUARE, 1, VEHICLE, gap_m=gap_m), cut_m=None).strip
    assert isinstance(strip, PlannedStrip)
    along_m, sigma_m = strip.put_down(0.0)
    assert along_m == pytest.approx(inside_m, abs=0.01)
    assert (sigma_m > START_SIGMA[0]) is (inside_m > 0.0)
    assert strip.put_down(0.5) == (-0.5, START_SIGMA[0]), "there its beginning is seen"


def test_on_the_way_from_the_end_the_blade_comes_nearer_to_the_next_crop() -> None:
    context = at_end()
    beyond = context.strip.gap_beyond()
    assert beyond is not None
    moved(context, 10.3, stamp=NOW)
    later = context.strip.gap_beyond()
    assert later is not None
    assert later.ago_m - beyond.ago_m == pytest.approx(0.3)
    assert later.past_m - beyond.past_m == pytest.approx(0.3, abs=0.01)
    assert math.degrees(abs(later.askew_rad)) < 0.1


@pytest.mark.parametrize("back", [False, True])
def test_between_its_places_it_goes_nowhere_without_eyes(back: bool) -> None:
    """Nor back to the end: it stands, and once it sees again it looks anew."""
    context = at_end()
    behaviour = LookBeyond(context)
    behaviour.enter(NOW)
    pictures(context, behaviour, 1.5, PICTURES)
    if back:
        moved(context, context.motion.distance_m + 0.3)
        behaviour.blocked(NOW + 3.0, Verdict(Level.STOP, "too near", 0.1))
    sees = NOW + 3.0
    seeing(context, CropView(0.0, crop_ahead_m=1.5, ahead_confidence=1.0), stamp=sees)
    assert math.copysign(1.0, behaviour.step(sees)[0].speed_mps) == (-1.0 if back else 1.0)
    command, go = behaviour.step(sees + STOP_AFTER_S + 0.1)
    assert stands(command)
    assert go is not None and go.reason is Blind.NOTHING_SEEN
    waiting = WaitForCamera(context)
    assert waiting.step(sees + 2.0)[1] is None
    seeing(context, CropView(0.0), stamp=sees + 3.0)
    go = waiting.step(sees + 3.0)[1]
    assert go is not None and go.reason is Waited.LOOKS_AGAIN
