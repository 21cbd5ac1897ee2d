"""Facts about the figures of merit, on paths whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import pytest

from hil.judge.metrics import MARGIN_M, Truth
from host.estimate.crop_ahead import EndOfField
from host.estimate.odometry import Motion
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from sim_plant.field import Field
from sim_plant.ground import CROP, SOIL
from tests.helpers.oracle import quick

LENGTH_M, WIDTH_M, GAP_M, STEP_M = 6.0, 4.0, 2.0, 0.02
POND = [(2.5, 1.0), (3.5, 1.0), (3.5, 3.0), (2.5, 3.0)]


@dataclass
class Stub:
    """What the truth reads of a pilot."""

    phase: Phase = Phase.FOLLOW
    ends: list[EndOfField] = field(default_factory=list)


class Ride:
    """A machine that is carried along the lower edge, from the left, `aside_m` left of its lane."""

    def __init__(self, aside_m: float = 0.0, **more: object) -> None:
        size = {"size_m": (LENGTH_M, WIDTH_M), "gap_m": GAP_M, "neighbour_depth_m": 2.0}
        self.scenario = quick(field=size | more)
        self.crop = Field(self.scenario.field, 1)
        self.truth = Truth(self.scenario.world, self.crop)
        self.vehicle = self.scenario.vehicle
        self.pilot = Stub()
        self.y = self.vehicle.inset_m + aside_m
        self.x = -self.vehicle.blade_x_m - STEP_M
        self.t = 0.0

    @property
    def blade_m(self) -> float:
        """Of the blade's line along the side."""
        return self.x + self.vehicle.blade_x_m

    def to(self, blade_m: float, *, cut: bool = True) -> None:
        """Forward until the blade's line is there."""
        while self.blade_m < blade_m:
            before = (self.x, self.y, 0.0)
            self.x += STEP_M
            self.t += 0.05
            here = (self.x, self.y, 0.0)
            v = self.vehicle
            cells = 0
            if cut:
                cells = self.crop.cut(before, here, ahead_m=v.blade_x_m, width_m=v.blade_width_m)
            self.truth.step(self.t, here, cells, cast(Pilot, self.pilot))

    def end(self, ago_m: float = 0.0) -> None:
        """The pilot declares the side's end, by a picture that it took `ago_m` before."""
        stamp = self.t - ago_m / STEP_M * 0.05
        self.pilot.ends.append(EndOfField(stamp, Motion(stamp, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0)))
        self.truth.step(self.t, (self.x, self.y, 0.0), 0, cast(Pilot, self.pilot))

    def figures(self) -> dict[str, float | int | None]:
        self.truth.step(self.t, (self.x, self.y, 0.0), 0, cast(Pilot, self.pilot))
        return self.truth.summary()


@pytest.mark.parametrize("aside_m", [-0.05, 0.0, 0.05])
def test_the_lateral_error_is_the_blades_place_beside_its_lane(aside_m: float) -> None:
    """Negative: further out, so that the edge lies further to the left of the blade's end."""
    ride = Ride(aside_m)
    ride.to(5.0)
    figures = ride.figures()
    assert figures["lateral_mean_m"] == pytest.approx(-aside_m, abs=0.03)
    assert figures["lateral_rms_m"] == pytest.approx(abs(aside_m), abs=0.03)


def test_a_ragged_last_row_is_no_edge_that_the_blade_has_left() -> None:
    """The field's end, torn back by a decimetre where the blade's right end comes out of it."""
    ride = Ride()
    columns = [round((x - ride.crop.origin[0]) / ride.crop.cell) for x in (LENGTH_M - 0.1, 9.0)]
    rows = [round((y - ride.crop.origin[1]) / ride.crop.cell) for y in (-0.1, 0.35)]
    ride.crop.kind[slice(*rows), slice(*columns)] = SOIL
    ride.to(LENGTH_M + 0.2)
    assert max(abs(error_m) for error_m in ride.truth.lateral) < 0.1


def test_a_blade_that_leaves_its_edge_before_the_end_is_off_it() -> None:
    ride = Ride()
    ride.to(LENGTH_M - 1.0)
    ride.y += 0.3
    ride.to(LENGTH_M - 0.4)
    assert max(abs(error_m) for error_m in ride.truth.lateral) == pytest.approx(0.3, abs=0.07)


def test_what_passes_in_a_turn_is_no_lateral_error() -> None:
    ride = Ride(0.2)
    ride.pilot.phase = Phase.TURN
    ride.to(5.0)
    assert ride.figures()["lateral_rms_m"] is None


@pytest.mark.parametrize("late_m", [0.0, 0.3, 0.6])
def test_the_ends_error_is_how_far_beyond_the_last_crop_it_was_declared(late_m: float) -> None:
    ride = Ride()
    ride.to(LENGTH_M + late_m)
    ride.end()
    figures = ride.figures()
    assert figures["end_of_field_error_median_m"] == pytest.approx(late_m, abs=0.07)
    assert figures["false_ends"] == 0


@pytest.mark.parametrize(("early_m", "false_ends"), [(0.3, 0), (0.8, 1), (3.0, 1)])
def test_an_end_with_crop_ahead_is_a_false_one(early_m: float, false_ends: int) -> None:
    ride = Ride()
    ride.to(LENGTH_M - early_m)
    ride.end()
    assert ride.figures()["false_ends"] == false_ends


@pytest.mark.parametrize(("long_m", "false_ends"), [(0.05, 0), (0.5, 1)])
def test_a_sliver_that_a_swath_before_has_left_makes_no_false_end(
    long_m: float, false_ends: int
) -> None:
    ride = Ride()
    ride.to(LENGTH_M)
    x, y = LENGTH_M - 1.2, ride.y
    i, j = ((at - o) / ride.crop.cell for at, o in zip((x, y), ride.crop.origin, strict=True))
    columns = slice(round(i), round(i + long_m / ride.crop.cell))
    rows = slice(round(j), round(j + 0.2 / ride.crop.cell))
    ride.crop.kind[rows, columns] = CROP
    ride.x = x - 0.6 - ride.vehicle.blade_x_m
    ride.truth.step(ride.t + 0.05, (ride.x, ride.y, 0.0), 0, cast(Pilot, ride.pilot))
    ride.t += 0.05
    ride.end()
    assert ride.figures()["false_ends"] == false_ends


def test_an_end_counts_where_its_first_picture_was_and_the_worst_keeps_its_sign() -> None:
    ride = Ride()
    ride.to(LENGTH_M)
    ride.end(ago_m=0.4)
    ride.to(LENGTH_M + 0.3)
    ride.end(ago_m=0.1)
    figures = ride.figures()
    assert ride.truth.ends == pytest.approx([-0.4, 0.2], abs=0.07)
    assert figures["end_of_field_error_worst_m"] == pytest.approx(-0.4, abs=0.07)
    assert figures["end_of_field_error_median_m"] == pytest.approx(-0.1, abs=0.07)


@pytest.mark.parametrize("beyond_m", [-0.1, 0.1, 0.5])
def test_outside_is_how_far_any_part_of_the_machine_was_beyond_the_permitted_area(
    beyond_m: float,
) -> None:
    ride = Ride()
    front = ride.vehicle.blade_x_m + 0.05
    ride.to(LENGTH_M)
    ride.to(LENGTH_M + GAP_M - MARGIN_M - (front - ride.vehicle.blade_x_m) + beyond_m, cut=False)
    assert ride.figures()["outside_m"] == pytest.approx(max(0.0, beyond_m), abs=STEP_M)


def test_outside_is_the_worst_even_where_the_machine_came_back() -> None:
    ride = Ride()
    ride.to(LENGTH_M + GAP_M - MARGIN_M - 0.05 + 0.5, cut=False)
    ride.x -= 0.3
    ride.to(ride.blade_m + STEP_M, cut=False)
    assert ride.figures()["outside_m"] == pytest.approx(0.5, abs=STEP_M)


def test_a_keep_out_that_is_touched_is_said_how_deep() -> None:
    ride = Ride(1.5, keep_outs=[POND])
    ride.to(2.0, cut=False)
    assert ride.figures()["keep_out_m"] == 0.0
    ride.to(2.5 + 0.3 - 0.05, cut=False)
    assert ride.figures()["keep_out_m"] == pytest.approx(0.3, abs=0.03)


def test_coverage_is_the_share_that_was_cut() -> None:
    ride = Ride()
    ride.to(LENGTH_M + 0.1)
    share = ride.vehicle.pass_m / WIDTH_M
    figures = ride.figures()
    assert figures["coverage"] == pytest.approx(share, abs=0.02)
    assert figures["missed_m2"] == pytest.approx((1 - share) * LENGTH_M * WIDTH_M, rel=0.03)
    assert figures["neighbour_cut_m2"] == 0.0
