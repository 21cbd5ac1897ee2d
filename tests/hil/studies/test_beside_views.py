"""Facts about the standing views that say how well crop beside the machine is seen."""

from __future__ import annotations

from functools import cache

import pytest

from hil.studies import beside_views

judged = cache(beside_views.judged)
"""Plain views are compared with several others."""


@pytest.mark.parametrize("mount", ["low", "mast"])
def test_crop_beside_the_way_is_seen_and_none_where_it_is_far(mount: str) -> None:
    beside, far = (judged(5, 3, mount, kind) for kind in ("beside", "far"))
    assert beside.views > 0
    assert beside.seen >= beside.views - 1
    assert beside.rms_m < 0.2
    assert far.seen == 0


@pytest.mark.parametrize("mount", ["low", "mast"])
def test_the_flank_of_the_next_strip_is_seen_to_a_few_centimetres(mount: str) -> None:
    """Where a shuttle backs beside it, half a metre off: as far as it is said at all."""
    flank = judged(5, 4, mount, "flank")
    assert flank.views == 4
    assert flank.seen >= 2
    assert flank.rms_m < 0.08


def test_what_an_earlier_strip_has_left_is_not_the_edge_but_makes_it_unsure() -> None:
    remnant, plain = (judged(5, 4, "low", kind) for kind in ("remnant", "plain"))
    assert (remnant.views, plain.views) == (4, 4)
    assert plain.seen >= 3
    assert remnant.sure <= plain.sure


@pytest.mark.parametrize("mount", ["low", "mast"])
def test_a_machine_inside_of_its_edge_sees_crop_on_its_right(mount: str) -> None:
    """And one that cuts along its edge does not."""
    inside, plain = (judged(5, 4, mount, kind) for kind in ("inside", "plain"))
    assert inside.crop_right >= 3
    assert plain.crop_right == 0


def test_the_next_field_beside_a_narrow_gap_is_not_the_edges_crop_to_who_knows_the_gap() -> None:
    """Its stems are seen over the gap from a mast, right of the edge."""
    told, untold = (judged(5, 6, "mast", "narrow", told=told) for told in (True, False))
    assert told.seen == told.views == 6
    assert told.sure > untold.sure
