"""Nothing goes on moving that nobody could stop from the page that drives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from host.core.errors import UserError
from host.core.messages import Command, Request
from host.panel.checking import MachineHands
from host.panel.machine import PRESENCE_S, Machine, Settings, listen
from host.panel.tuning import MachineWire

GONE = "the page that drives is gone"


@dataclass
class Clock:
    ahead_s: float = 0.0

    def __call__(self) -> float:
        return time.monotonic() + self.ahead_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(params=[True, False], ids=["presence", "no presence"])
def machine(request: pytest.FixtureRequest, tmp_path: Path, clock: Clock) -> Iterator[Machine]:
    """Without a board; the page was heard of just now."""
    settings = Settings(port="/dev/none", folder=tmp_path, presence=request.param)
    listener = listen(tmp_path / "m.sock")
    yield Machine(settings, listener, clock)
    listener.close()


MOVING = (
    Command(Request.DRIVE, speed_mps=0.2),
    Command(Request.DRIVE, speed_mps=-0.2),
    Command(Request.DRIVE, steer_rad=0.3),
    Command(Request.DRIVE, blade=True),
)
RESTING = (Command(Request.STOP, speed_mps=0.2), Command(Request.DRIVE), Command(Request.ARM))


@pytest.mark.parametrize("command", MOVING)
def test_a_check_that_moves_ends_when_the_page_is_gone(
    machine: Machine, clock: Clock, command: Command
) -> None:
    hands = MachineHands(machine)
    hands.send(command)
    hands.pump(0.01)
    clock.ahead_s += PRESENCE_S + 0.5
    if machine.settings.presence:
        with pytest.raises(UserError, match=GONE):
            hands.pump(0.01)
    else:
        hands.pump(0.01)


@pytest.mark.parametrize("command", RESTING)
def test_a_check_that_stands_waits_for_who_presses_the_button_on_the_machine(
    machine: Machine, clock: Clock, command: Command
) -> None:
    hands = MachineHands(machine)
    hands.send(MOVING[0])
    hands.send(command)
    clock.ahead_s += PRESENCE_S + 0.5
    assert hands.pump(0.01) == []


def test_the_wheel_turns_to_and_fro_only_for_somebody(machine: Machine, clock: Clock) -> None:
    wire = MachineWire(machine)
    assert wire.poll() == []
    clock.ahead_s += PRESENCE_S + 0.5
    if machine.settings.presence:
        with pytest.raises(UserError, match=GONE):
            wire.poll()
    else:
        assert wire.poll() == []
