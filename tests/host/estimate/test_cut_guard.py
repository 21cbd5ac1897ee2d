"""Facts about the cut guard: the blade crosses a patch, and never a gap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from host.core.messages import Command, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import CLEAR_M, END_CLEAR_M
from host.estimate.cut_guard import ALONGSIDE_M, LOOK_S, PATCH_M, SHOWN_M, CutGuard
from host.vision.view import CropView

STEP_S = 0.05
V = Vehicle()
GO = Command(Request.DRIVE, 0.0, 0.5, True)


def duty_for(speed_mps: float) -> int:
    return next(d for d in range(256) if V.duty_speed(d, 12.0) >= speed_mps)


class Drive:
    """A machine that does as it is told before crop of which `crop_ahead` tells by its place."""

    def __init__(
        self, crop_ahead: Callable[[float], float], *, hall: float = 1.0, sure: bool = True
    ) -> None:
        self.guard = CutGuard(V)
        self.guard.begin()
        self.crop_ahead, self.hall, self.sure = crop_ahead, hall, sure
        self.t = self.x = 0.0
        self.bladed_to = 0.0
        self.last = GO
        self.own = False
        """Whether the plan has crop here beyond doubt."""
        self.swath = False
        """Whether it is right beside what it has cut."""
        self.ends = self.beside = False
        """Whether the side may end here."""
        self.dusty = False
        """Whether crop at the blade may be dust."""
        self.edge_m = math.nan
        """Where pictures surely show an edge; NaN: they show none."""
        self.edge_sure = 0.9
        """How surely."""
        self.beside_m = math.nan
        """The same of crop left of the machine's way."""
        self.asked = False
        """Whether the guard is told what the plan has only where it says that this decides."""

    def run(self, seconds: float, command: Command = GO) -> Command:
        for _ in range(round(seconds / STEP_S)):
            told = not (self.asked and self.guard.passes)
            passed = self.guard.limit(
                self.t,
                command,
                own=told and self.own,
                swath=told and self.swath,
                ends=self.ends,
                beside=self.beside,
            )
            self.last = passed
            self.t += STEP_S
            self.x += passed.speed_mps * STEP_S
            if passed.blade and passed.speed_mps > 0:
                self.bladed_to = self.x
            duty = duty_for(abs(passed.speed_mps)) if passed.speed_mps else 0
            duty = -duty if passed.speed_mps < 0 else duty
            counted = self.hall * passed.speed_mps
            telemetry = Telemetry(
                self.t, State.RUNNING, 0, 0.0, 0.0, 0, duty, passed.blade, counted, 0.0, 12.0, 0, 0
            )
            self.guard.take_telemetry(telemetry)
            ahead = self.crop_ahead(self.x)
            view = CropView(
                0.0 if math.isnan(self.edge_m) else self.edge_sure,
                edge_offset_m=self.edge_m,
                edge_beside_m=self.beside_m,
                crop_ahead_m=ahead,
                ahead_confidence=0.9 if self.sure else 0.2,
            )
            told = not (self.asked and self.guard.cuts_on)
            own, swath = told and self.own, told and self.swath
            self.guard.take_picture(self.t, view, own=own, swath=swath, dusty=self.dusty)
        return self.last


def field(*ends: tuple[float, float]) -> Callable[[float], float]:
    """Crop from the first to the second of each pair; how far the next begins before the blade."""

    def ahead(x: float) -> float:
        return min((max(0.0, a - x) for a, b in ends if x < b), default=math.inf)

    return ahead


def at_clear_ground(*, ends: bool = False, own: bool = False, beside: bool = False) -> Drive:
    """Held to look, after two metres of crop and as much clear ground as ends a side."""
    drive = Drive(lambda x: 0.0 if x < 2.0 else math.inf)
    drive.guard.begin(END_CLEAR_M - PATCH_M)
    drive.ends, drive.own, drive.beside = ends, own, beside
    drive.run(5.8)
    assert drive.last.speed_mps == 0.0
    return drive


@pytest.mark.parametrize(("own", "swath"), [(True, False), (False, True), (True, True)])
@pytest.mark.parametrize("dusty", [False, True])
def test_what_the_plan_has_is_asked_only_where_it_decides(
    own: bool, swath: bool, dusty: bool
) -> None:
    crop = field((0.0, 1.0), (1.3, 2.0), (4.0, 6.0), (7.5, 9.0), (9.4, 10.0))
    drives = [Drive(crop), Drive(crop)]
    drives[1].asked = True
    for edge_m in (0.0, math.nan, 0.1, 0.1, 0.1, math.nan, 0.0, 0.0):
        for drive in drives:
            drive.own, drive.swath, drive.dusty, drive.edge_m = own, swath, dusty, edge_m
            drive.run(4.0)
        always, where_asked = ((d.x, d.bladed_to, d.last, d.guard.refused) for d in drives)
        assert always == where_asked
    assert drives[0].x > 4.0, "it has crossed clear ground"


def look(drive: Drive, edges: Sequence[float], feet_m: Sequence[float] = (0.0,)) -> None:
    """The look's pictures show crop at the blade, or so far before it, and an edge there, in
    turn."""
    for k in range(round((LOOK_S + 1.0) / STEP_S)):
        drive.edge_m, foot_m = edges[k % len(edges)], feet_m[k % len(feet_m)]
        drive.crop_ahead = lambda _, foot_m=foot_m: foot_m
        drive.run(STEP_S)


def test_crop_is_cut_and_a_patch_is_crossed() -> None:
    drive = Drive(field((0.2, 3.0), (3.5, 8.0)))
    assert drive.run(12.0) == GO
    assert drive.x > 5.5


@pytest.mark.parametrize("gap_m", [1.2, 1.5, 2.0, 2.5])
@pytest.mark.parametrize("hall", [1.0, 0.7, 0.5])
def test_a_gap_is_never_crossed_whatever_the_wheels_count(gap_m: float, hall: float) -> None:
    drive = Drive(field((0.2, 3.0), (3.0 + gap_m, 8.0)), hall=hall)
    last = drive.run(20.0)
    assert drive.guard.refused
    assert (last.speed_mps, last.blade) == (0.0, False)
    assert drive.bladed_to < 3.0 + gap_m - 0.1


def test_a_dead_sensor_does_not_carry_the_blade_over_a_gap() -> None:
    drive = Drive(field((0.2, 3.0), (5.0, 8.0)), hall=0.0)
    drive.run(20.0)
    assert drive.guard.refused
    assert drive.bladed_to < 4.7


def test_what_seemed_clear_in_dust_and_is_crop_after_a_look_is_cut() -> None:
    crop = field((0.2, 9.0))
    drive = Drive(lambda x: math.inf if x > 2.0 and drive.last.speed_mps > 0 else crop(x))
    drive.run(5.5)
    assert drive.last.speed_mps == 0.0
    assert 2.0 + PATCH_M < drive.x < 2.0 + PATCH_M + 0.2
    drive.crop_ahead = crop
    assert drive.run(LOOK_S + 2.0) == GO
    assert not drive.guard.refused


@pytest.mark.parametrize(
    ("ends", "own", "edge_m", "goes_on"),
    [
        (False, False, math.nan, True),
        (True, True, math.nan, True),
        (True, False, 0.0, True),
        (True, False, 0.8, False),
        (True, False, math.nan, False),
    ],
)
def test_where_a_side_may_end_crop_after_a_gap_leads_on_only_with_its_edge_in_line(
    ends: bool, own: bool, edge_m: float, goes_on: bool
) -> None:
    """In the look without dust crop stands at the blade: a neighbour's stands across the way."""
    drive = at_clear_ground(ends=ends, own=own)
    look(drive, (edge_m,))
    assert drive.guard.refused is not goes_on


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(("edge_m", "goes_on"), [(0.0, True), (0.8, False), (math.nan, False)])
def test_beside_the_gap_crop_after_clear_ground_leads_on_only_with_its_edge_in_line(
    edge_m: float, goes_on: bool, own: bool
) -> None:
    """Whatever the plan has along the side: the machine may have left it sideways."""
    drive = at_clear_ground(beside=True, own=own)
    look(drive, (edge_m,))
    cuts = drive.last.blade and not drive.guard.refused
    assert cuts is goes_on


@pytest.mark.parametrize(
    ("edges", "sure", "goes_on"),
    [
        ((0.15, 0.15), 0.35, True),
        ((0.15, 0.15), 0.1, False),
        ((0.15, 0.8), 0.35, False),
    ],
)
def test_beside_the_gap_a_look_counts_an_edge_that_is_too_unsure_to_steer_by(
    edges: tuple[float, ...], sure: float, goes_on: bool
) -> None:
    """It was 0.34 to 0.46 sure of crop of which the mast showed few stems (picture field 10427)."""
    drive = at_clear_ground(beside=True, own=True)
    drive.edge_sure = sure
    look(drive, edges)
    assert drive.guard.refused is not goes_on


@pytest.mark.parametrize(
    ("edges", "goes_on"),
    [
        ((0.07, 0.5, -0.07), True),
        ((0.07, 0.5, 0.6, 0.2, 0.3), False),
        ((0.15, 0.15, 0.15), False),
    ],
)
def test_beside_the_gap_a_look_counts_the_least_sure_edge_right_where_it_should_be(
    edges: tuple[float, ...], goes_on: bool
) -> None:
    """A low camera saw the edge within five centimetres of the lane, a tenth sure, and took its
    crop for the neighbour's (model field 12328)."""
    drive = at_clear_ground(beside=True)
    drive.edge_sure = 0.1
    look(drive, edges)
    assert drive.guard.refused is not goes_on


@pytest.mark.parametrize("beside", [False, True])
def test_beside_the_gap_clear_ground_is_crossed_along_an_edge_in_line_only(beside: bool) -> None:
    """Crop that stands somewhere left of the machine does elsewhere: it may be across the gap."""
    for edge_m, beside_m in ((0.0, math.nan), (math.nan, 0.8)):
        drive = Drive(lambda x: 0.0 if x < 2.0 else math.inf)
        drive.guard.begin()
        drive.own, drive.beside = True, beside
        drive.edge_m, drive.beside_m = edge_m, beside_m
        drive.run(12.0)
        assert drive.guard.refused is (beside and math.isnan(edge_m))


def test_where_a_side_does_not_end_clear_ground_is_no_longer_than_a_patch() -> None:
    drive = Drive(lambda x: 0.0 if x < 2.0 else math.inf)
    drive.guard.begin(slack_m=0.9)
    drive.guard.allow(0.0)
    drive.run(8.0)
    assert drive.x == pytest.approx(2.0 + PATCH_M, abs=0.15)


@pytest.mark.parametrize(
    ("edges", "goes_on"),
    [
        ((0.05, math.nan, math.nan), True),
        ((0.05, math.nan, math.nan, math.nan, math.nan), False),
        ((0.05, 0.8, 0.8, math.nan), False),
        ((0.05, 0.05, 0.8, 0.8, 0.8), False),
    ],
)
def test_an_edge_in_line_that_dust_hides_now_and_then_leads_on(
    edges: tuple[float, ...], goes_on: bool
) -> None:
    """Of a look's pictures a quarter, and more than show one elsewhere (random field 10119)."""
    drive = at_clear_ground(ends=True)
    look(drive, edges)
    assert drive.guard.refused is not goes_on


@pytest.mark.parametrize(
    ("foot_m", "edge_m", "goes_on", "beside"),
    [(0.31, 0.05, True, False), (0.31, 0.6, False, True), (0.5, 0.05, False, False)],
)
def test_crop_that_pictures_show_a_hand_ahead_stands_at_the_blade_if_it_is_in_line(
    foot_m: float, edge_m: float, goes_on: bool, beside: bool
) -> None:
    """A machine that has just stopped in its crop (random field 10221), and one that has come off
    it (10238)."""
    drive = at_clear_ground(ends=True)
    look(drive, (edge_m,), (0.0, foot_m, foot_m))
    assert drive.guard.refused is not goes_on
    assert drive.guard.beside is beside
    drive.guard.begin()
    assert not drive.guard.beside, "another side"


def test_an_edge_elsewhere_of_crop_that_stands_off_is_none_to_go_back_to() -> None:
    drive = Drive(lambda x: 0.0 if x < 2.0 else 0.5)
    drive.run(5.8)
    drive.edge_m = 0.6
    drive.run(LOOK_S + 1.0)
    assert drive.guard.refused
    assert not drive.guard.beside


def test_what_is_no_longer_than_a_patch_is_no_gap() -> None:
    drive = Drive(lambda x: 0.0 if x < 2.0 else math.inf)
    drive.ends = True
    drive.run(5.8)
    assert drive.last.speed_mps == 0.0
    drive.crop_ahead = lambda _: 0.0
    drive.run(LOOK_S + 1.0)
    assert not drive.guard.refused


def test_unsure_pictures_neither_end_nor_begin_anything() -> None:
    drive = Drive(field((0.2, 3.0)), sure=False)
    assert drive.run(12.0) == GO


def test_it_may_always_back_off_and_the_next_side_begins_anew() -> None:
    drive = Drive(field((0.2, 3.0)))
    drive.run(20.0)
    back = Command(Request.DRIVE, 0.0, -0.3, False)
    assert drive.run(0.5, back) == back
    drive.guard.begin()
    drive.crop_ahead = field((0.0, 100.0))
    assert drive.run(1.0) == GO


@pytest.mark.parametrize(
    ("edge_m", "beside_m", "crosses"),
    [
        (0.0, math.nan, True),
        (SHOWN_M - 0.1, math.nan, True),
        (SHOWN_M + 0.1, math.nan, False),
        (math.nan, math.nan, False),
        (math.nan, ALONGSIDE_M - 0.1, True),
        (math.nan, ALONGSIDE_M + 0.1, False),
    ],
)
def test_a_plan_leads_over_clear_ground_only_along_an_edge_in_sight(
    edge_m: float, beside_m: float, crosses: bool
) -> None:
    drive = Drive(field((0.2, 3.0), (6.0, 30.0)))
    drive.own, drive.edge_m, drive.beside_m = True, edge_m, beside_m
    drive.run(20.0)
    assert drive.guard.refused is not crosses
    assert (drive.x > 5.5) is crosses
    assert drive.bladed_to < 3.0 + PATCH_M + 0.1 or drive.x > 6.0


@pytest.mark.parametrize("ends", [True, False])
def test_right_beside_what_it_has_cut_clear_ground_is_crossed_and_the_next_crop_is_cut(
    ends: bool,
) -> None:
    """No gap lies there, whatever pictures show of an edge."""
    drive = Drive(field((0.2, 3.0), (6.0, 30.0)))
    drive.swath, drive.ends, drive.beside = True, ends, ends
    drive.run(12.0)
    assert not drive.guard.refused
    assert 4.0 < drive.x < 6.0
    assert drive.bladed_to < 3.0 + PATCH_M + 0.1, "the blade is off on the way"
    assert drive.run(14.0) == GO
    assert drive.x > 7.0


def test_where_what_it_has_cut_ends_it_goes_no_farther_over_clear_ground() -> None:
    drive = Drive(field((0.2, 3.0), (9.0, 30.0)))
    drive.swath = True
    drive.run(14.0)
    here = drive.x
    assert 4.5 < here < 8.0
    drive.swath = False
    drive.run(12.0)
    assert drive.guard.refused
    assert drive.x < here + 0.1


def test_a_crossing_ends_where_the_edge_is_out_of_sight() -> None:
    drive = Drive(field((0.2, 3.0), (12.0, 30.0)))
    drive.own, drive.edge_m = True, 0.0
    drive.run(16.0)
    here = drive.x
    assert 4.0 < here < 9.0
    drive.edge_m = math.nan
    drive.run(20.0)
    assert drive.guard.refused
    assert drive.x < here + 0.8


def test_who_has_gone_back_may_come_as_far_as_before_and_no_farther() -> None:
    drive = Drive(field((0.2, 3.0)))
    drive.run(20.0)
    assert drive.guard.refused
    first, clear_m = drive.x, drive.guard.clear_m
    drive.run(4.0, Command(Request.DRIVE, 0.0, -0.3, False))
    drive.guard.go_back()
    assert not drive.guard.refused
    assert drive.run(0.5) == GO
    drive.run(20.0)
    assert drive.guard.refused
    assert drive.x == pytest.approx(first, abs=0.05)
    assert drive.guard.clear_m == pytest.approx(clear_m, abs=0.05)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_nobody_counts_may_be_faster_than_on_the_level(way: float) -> None:
    """Down 2 degrees: else a machine without a wheel sensor is in the gap before it is stopped."""
    guard = CutGuard(V)
    for k in range(101):
        duty = round(way * duty_for(0.5))
        told = Telemetry(0.01 * k, State.RUNNING, 0, 0.0, 0.0, 0, duty, True, None, 0.0, 12.0, 0, 0)
        guard.take_telemetry(told)
    assert way * guard.driven_m == pytest.approx(0.6, abs=0.02)
    for k in range(101, 201):
        told = Telemetry(0.01 * k, State.RUNNING, 0, 0.0, 0.0, 0, 0, True, None, 0.0, 12.0, 0, 0)
        guard.take_telemetry(told)
    assert way * guard.driven_m == pytest.approx(0.6, abs=0.02), "its drive off, it stands"


def test_what_turned_out_to_be_a_patch_is_driven_on_from_and_the_next_counts_anew() -> None:
    drive = Drive(field((0.2, 3.0)))
    drive.run(20.0)
    assert drive.guard.refused
    here = drive.x
    drive.guard.go_on()
    drive.crop_ahead = field((0.2, here + 2.0))
    assert drive.run(0.5) == GO
    drive.run(20.0)
    assert drive.guard.refused
    assert here + 2.0 + PATCH_M - 0.1 < drive.x < here + 2.0 + PATCH_M + 0.25


def test_what_it_has_cut_is_no_clear_ground_for_a_machine_that_has_backed_over_it() -> None:
    """From farther back it sees a swath before the crop, and then stalks hide where it stands."""
    drive = Drive(lambda _: 0.0)
    drive.run(3.0)
    cut_to = drive.x
    drive.run(3.0, replace(GO, speed_mps=-0.3, blade=False))
    assert drive.x < cut_to - 0.5
    drive.crop_ahead = lambda x: cut_to - x
    drive.run(0.5, replace(GO, speed_mps=0.0, blade=False))
    drive.sure = False
    drive.run(6.0)
    assert cut_to + PATCH_M - 0.1 < drive.x < cut_to + PATCH_M + 0.15


def test_a_slanting_end_is_allowed_its_tip() -> None:
    drive = Drive(field((0.2, 3.0)))
    drive.guard.begin(slack_m=0.5)
    drive.run(20.0)
    assert drive.x == pytest.approx(3.0 + PATCH_M + 0.5, abs=0.1)


def test_before_its_crop_a_side_has_no_clear_ground_to_count() -> None:
    drive = Drive(field((2.5, 5.0)))
    assert drive.run(6.0) == GO
    assert drive.x > 2.8


@pytest.mark.parametrize("hall", [1.0, 0.5])
def test_a_picture_now_and_then_that_takes_the_next_crop_for_crop_at_the_blade_ends_no_gap(
    hall: float,
) -> None:
    """Neither on the way across, nor in the look that follows."""
    count = 0
    true_ahead = field((0.0, 4.0), (5.6, 9.0))

    def shown(x: float) -> float:
        nonlocal count
        count += 1
        ahead = true_ahead(x)
        return 0.0 if ahead < 1.2 and count % 3 == 0 else ahead

    drive = Drive(shown, hall=hall)
    drive.run(30.0)
    assert drive.guard.refused
    assert 4.0 < drive.bladed_to < 5.6


def test_one_picture_of_crop_at_the_blade_begins_no_clear_ground_before_that_is_met() -> None:
    """What was left of its way to the crop counted as clear ground (model field 11025)."""
    shown = iter([0.0])
    drive = Drive(lambda x: next(shown, 0.0) if 0.1 < x < 0.13 else max(0.0, 1.5 - x))
    drive.run(8.0)
    assert drive.bladed_to > 3.0


@pytest.mark.parametrize(("pattern", "ended"), [((0.0, 0.0, 0.5), True), ((0.0, 0.5, 0.5), False)])
def test_a_machine_that_stands_takes_most_of_what_its_pictures_show_for_what_stands_there(
    pattern: tuple[float, ...], ended: bool
) -> None:
    """In the dust after a look that showed crop at the blade, but never three times in a row,
    clear ground grew until the machine gave up (model field 11106)."""
    shown = itertools.cycle(pattern)
    drive = Drive(lambda _: 0.0)
    drive.run(1.0)
    drive.crop_ahead = lambda _: next(shown)
    drive.run(3.0, replace(GO, speed_mps=0.0))
    drive.sure = False
    drive.run(0.5)
    assert (drive.guard.clear_m == 0.0) is ended


def test_clear_ground_that_shows_once_the_dust_has_settled_is_clear_ground() -> None:
    """However long the machine has stood in the dust that looked like crop."""
    drive = Drive(lambda _: 0.0)
    drive.run(1.0)
    drive.run(10.0, replace(GO, speed_mps=0.0))
    drive.crop_ahead = lambda _: 2.0
    drive.run(0.5, replace(GO, speed_mps=0.0))
    drive.sure = False
    drive.run(0.5)
    assert drive.guard.clear_m > 0.1


def through_dust(shown_m: float) -> Drive:
    """Half a metre before its crop dust looks like crop at the blade, lets clear ground be seen for
    so far, once, and then no more."""
    shown = itertools.chain([0.0] * 4, [shown_m])
    drive = Drive(lambda x: next(shown, 0.0) if x > 0.5 else 1.0 - x)
    drive.dusty = drive.beside = True
    return drive


@pytest.mark.parametrize(("shown_m", "through"), [(0.4, True), (1.2, False)])
def test_in_dust_crop_is_crop_where_it_was_seen_to_stand_nearer_than_behind_a_gap(
    shown_m: float, through: bool
) -> None:
    """The machine stopped in its own crop, its blade off (model field 11057)."""
    drive = through_dust(shown_m)
    drive.run(4.0)
    assert (drive.bladed_to > 1.9) is through
    assert through or drive.bladed_to < 0.7 + PATCH_M + 0.1


@pytest.mark.parametrize(("shown_m", "goes_on"), [(0.7, True), (1.2, False)])
def test_beside_the_gap_a_look_at_crop_without_an_edge_leads_on_where_no_gap_can_have_been(
    shown_m: float, goes_on: bool
) -> None:
    """Fifteen pictures of a look showed crop at the blade, three of them its edge (model field
    11106)."""
    drive = through_dust(shown_m)
    drive.run(1.6)
    drive.crop_ahead = lambda _: CLEAR_M - 0.1
    drive.guard.allow(END_CLEAR_M - PATCH_M)
    drive.run(2.0)
    assert drive.last.speed_mps == 0.0
    drive.crop_ahead = lambda _: 0.0
    drive.run(LOOK_S + 1.0)
    assert drive.guard.refused is not goes_on


@pytest.mark.parametrize("own", [True, False])
def test_over_clear_ground_nothing_is_cut_on(own: bool) -> None:
    """Nor on the way back from it."""
    drive = at_clear_ground(own=own)
    assert drive.x > 2.3
    assert drive.guard.cut_m == pytest.approx(2.0, abs=0.3)
    drive.run(2.0, replace(GO, speed_mps=-0.5, blade=False))
    assert drive.guard.cut_m == pytest.approx(2.0, abs=0.3)
    drive.guard.begin()
    assert drive.guard.cut_m == 0.0
    drive.crop_ahead = lambda _: 0.0
    drive.run(2.0, replace(GO, speed_mps=0.3))
    assert drive.guard.cut_m == pytest.approx(0.6, abs=0.2), "of the side that was begun"
