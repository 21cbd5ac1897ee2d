"""What holds of every behaviour, and of their table."""

from __future__ import annotations

import pytest

from host.pilot.behaviours import BEHAVIOURS
from host.pilot.phase import Doing, Phase
from tests.helpers.behaving import NOW, turning


def test_every_behaviour_is_in_the_table_and_can_be_reached() -> None:
    assert set(BEHAVIOURS) == set(Doing)
    reached = {r.to for kind in BEHAVIOURS.values() for reasons in kind.reasons for r in reasons}
    assert reached == set(Doing) - {Doing.CONNECT}


@pytest.mark.parametrize("kind", BEHAVIOURS.values())
def test_a_pause_lets_nothing_run_out(kind: type) -> None:
    context = turning()
    behaviour = kind(context)
    behaviour.paused(NOW + 500.0)
    assert context.since == context.sight.seen.stamp == NOW + 500.0


def test_a_phase_is_what_the_operator_knows() -> None:
    hesitates = {doing for doing, kind in BEHAVIOURS.items() if kind.phase is Phase.HESITATE}
    assert hesitates == {
        Doing.WAIT_FOR_CAMERA,
        Doing.LOOK_AT_EDGE,
        Doing.LOOK_AT_END,
        Doing.BACK_OFF,
        Doing.REGAIN,
    }
