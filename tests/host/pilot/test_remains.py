"""What is still gone to of all that the plan has left standing, and what of it counts as cut."""

from __future__ import annotations

import pytest

from host.pilot.behaviours.back_off import BackOff
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.context import Context
from host.pilot.endings import GIVE_UP_S, Patience, Standing
from host.pilot.phase import Go
from host.pilot.remains import GETS_ON_M
from tests.helpers.behaving import CUTTING, NOW, chosen, cut_elsewhere, gathering, is_for, seeing


@pytest.mark.parametrize("left_m2", [15.0, 30.0])
def test_more_than_the_plan_has_left_stands_where_the_machine_has_lost_its_place(
    left_m2: float,
) -> None:
    """27 m2 do, by the blade's way."""
    go = chosen(gathering(left_m2))
    assert is_for(go, Gathered.STRIP if left_m2 > 20.0 else Gathered.NOTHING)


def test_what_pictures_do_not_show_of_it_counts_as_cut() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    context.remains.nothing_stands()
    context.end_gathering()
    before_m2 = context.left_m2
    other = gathering()
    assert is_for(chosen(other), Gathered.STRIP)
    other.end_gathering()
    assert other.left_m2 > before_m2 + 3.0


def given_up(context: Context) -> Go | None:
    """A minute in doubt, and something is seen."""
    seeing(context, CUTTING, stamp=NOW + GIVE_UP_S)
    return BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1]


def test_what_it_cannot_do_at_one_place_does_not_end_gathering_while_that_gets_on() -> None:
    """A strip among stems before its lens ended it with 53 m2 standing (model field 11320)."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    cut_elsewhere(context, GETS_ON_M - 0.5)
    assert is_for(given_up(context), Patience.GAVE_UP)
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    for gained_m, goes in ((GETS_ON_M + 0.5, True), (GETS_ON_M + 0.5, True), (0.0, False)):
        cut_elsewhere(context, gained_m)
        go = given_up(context)
        assert is_for(go, Standing.ANOTHER if goes else Patience.GAVE_UP)
        assert go is not None and "gave up" in go.text
