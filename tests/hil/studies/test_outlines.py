"""Facts about outlines as farm programs export them, and their plans."""

from __future__ import annotations

import pytest
import shapely

from hil.studies.outlines import KINDS, outline, planned
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
