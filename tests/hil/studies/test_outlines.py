"""Facts about outlines as farm programs export them, and their plans."""

from __future__ import annotations

import pytest
import shapely

from hil.studies.campaign import scenarios_of
from hil.studies.outlines import KINDS, SMALL_M2, outline, outline_field, planned
from host.core.vehicle import Vehicle
from host.route.standing import inner_corners

VEHICLE = Vehicle()


@pytest.mark.parametrize("seed", [2, 4, 8, 11, 21, 28, 33, 35])
def test_an_exported_outline_is_planned_whole(seed: int) -> None:
    drawn = planned(outline(seed), VEHICLE)
    assert drawn.error == ""
    assert drawn.stays < 0.006
    if drawn.outline.kind != "inner":
        assert drawn.turning < 0.25


def test_outlines_are_of_the_kind_that_they_say() -> None:
    for seed in range(5):
        drawn = outline(seed)
        assert drawn.kind == KINDS[seed]
        field = shapely.Polygon(drawn.ring)
        assert field.is_valid
        assert 0.09 < drawn.area_ha < 61
        assert bool(len(inner_corners(field))) is (drawn.kind == "inner")


@pytest.mark.parametrize("seed", [45, 49])
def test_an_outline_that_is_driven_is_small_and_walked_by_its_owner(seed: int) -> None:
    """Its shape is the drawn one's; the host is told of fewer corners, roughly there."""
    field = outline_field(seed)
    true, drawn = shapely.Polygon(field.world.corners), shapely.Polygon(outline(seed).ring)
    assert SMALL_M2[0] <= true.area <= SMALL_M2[1]
    assert true.length**2 / true.area == pytest.approx(drawn.length**2 / drawn.area, rel=0.01)
    assert not field.field.keep_outs
    told = field.told
    assert len(told.boundary) < len(outline(seed).ring)
    assert shapely.Polygon(told.boundary).area == pytest.approx(true.area, rel=0.1)


def test_a_campaign_drives_the_outlines_of_its_seeds() -> None:
    chosen = scenarios_of((), [45, 49], ["weather.hour=9"], "model", outlines=True)
    assert [one.name for one in chosen] == ["outline bent", "outline inner"]
    assert {one.weather.hour for one in chosen} == {9.0}
    assert [one.field.polygon for one in chosen] == [
        outline_field(seed).field.polygon for seed in (45, 49)
    ]
    assert {one.eyes for one in chosen} == {"model"}
