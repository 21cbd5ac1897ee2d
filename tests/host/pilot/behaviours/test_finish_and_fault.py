"""Finish and Fault alone: the machine is stopped."""

from __future__ import annotations

import pytest

from host.core.messages import Command, Request
from host.pilot.behaviours.fault import Fault
from host.pilot.behaviours.finish import Finish
from tests.helpers.behaving import NOW, on_side


@pytest.mark.parametrize("kind", [Finish, Fault])
def test_the_end_stays_stopped(kind: type[Finish] | type[Fault]) -> None:
    context = on_side()
    assert kind(context).step(NOW) == (Command(Request.STOP), None)
    assert not kind.gaze.looks
