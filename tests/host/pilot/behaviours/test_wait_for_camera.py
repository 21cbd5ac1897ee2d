"""WaitForCamera alone: a turn that sees nothing."""

from __future__ import annotations

from host.pilot.behaviours.turn import DriveTurn
from host.pilot.behaviours.wait_for_camera import WaitForCamera
from host.pilot.behaviours.wait_for_camera import Why as Waited
from host.pilot.endings import Blind
from host.pilot.gaze import STOP_AFTER_S
from tests.helpers.behaving import CUTTING, NOW, is_for, seeing, stands, turning


def test_a_turn_that_sees_nothing_waits_for_the_camera_and_goes_on() -> None:
    context = turning()
    turn = DriveTurn(context)
    command, go = turn.step(NOW + STOP_AFTER_S + 0.1)
    assert stands(command)
    assert is_for(go, Blind.NOTHING_SEEN)
    assert go is not None and "no pictures" in go.text
    waiting = WaitForCamera(context)
    assert is_for(waiting.step(NOW + STOP_AFTER_S + 0.1)[1], None)
    seeing(context, CUTTING, stamp=NOW + 2.0)
    assert is_for(waiting.step(NOW + 2.0)[1], Waited.SEES_AGAIN)
