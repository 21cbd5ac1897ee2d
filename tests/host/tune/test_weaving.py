"""Facts about the weaving drive: it finds the camera's delay, or says why not, and stops."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from host.core.errors import FaultError, UserError
from host.core.messages import State
from host.core.vehicle import Vehicle
from host.link import protocol
from host.tune.camera_delay import Delay
from host.tune.weaving import LOST_S, WEAVE_M, WEAVE_MPS, WEAVE_S, measured_delay
from tests.helpers.yard import Bgr, YardLens, YardMachine

VEHICLE = Vehicle()


def measured(
    machine: YardMachine, lens: YardLens, tell: Callable[[float], None] = lambda _: None
) -> Delay:
    """The drive; whatever ends it, the machine was stopped, and its blade never on."""
    try:
        return measured_delay(machine, "the yard", VEHICLE, lens, tell)
    finally:
        assert not any(isinstance(m, protocol.Drive) and m.blade for m in machine.heard)
        if any(isinstance(m, protocol.Arm) for m in machine.heard):
            assert isinstance(machine.heard[-1], protocol.Stop)


@pytest.mark.parametrize("delay_s", [0.0, 0.13, 0.5, 1.1])
@pytest.mark.parametrize(("fps", "pulse_m"), [(10.0, 0.02), (30.0, 0.02), (10.0, 0.1)])
def test_it_finds_the_delay(delay_s: float, fps: float, pulse_m: float) -> None:
    machine = YardMachine(pulse_m=pulse_m)
    found = measured(machine, YardLens(machine, delay_s, fps))
    assert found.delay_s == pytest.approx(delay_s, abs=0.015)
    assert 0.02 <= found.sigma_s < 0.06


def test_it_weaves_ahead_and_ends_there_as_it_began() -> None:
    machine = YardMachine()
    shares: list[float] = []
    measured(machine, YardLens(machine), shares.append)
    assert machine.way == pytest.approx(WEAVE_M, rel=0.05)
    assert abs(machine.yaw) < math.radians(3)
    assert shares == sorted(shares)
    assert shares[0] < 0.01
    assert shares[-1] > 0.99


def dark(bgr: Bgr) -> Bgr:
    return (bgr // 64).astype(np.uint8)


def broken(bgr: Bgr) -> Bgr:
    return bgr[:0]


@pytest.mark.parametrize(
    ("develop", "said"),
    [(dark, "shows nothing: dark, blinded or covered"), (broken, "its files are damaged")],
)
def test_a_camera_that_shows_nothing_is_told_before_anything_moves(
    develop: Callable[[Bgr], Bgr], said: str
) -> None:
    machine = YardMachine()
    with pytest.raises(UserError, match=f"{said}; nothing has moved"):
        measured(machine, YardLens(machine, develop=develop))
    assert machine.heard == []


def test_a_camera_that_sends_nothing_is_told_before_anything_moves() -> None:
    machine = YardMachine()
    lens = YardLens(machine)
    lens.ends_at_s = 0.0
    with pytest.raises(UserError, match="silent for 3 s; nothing has moved"):
        measured(machine, lens)
    assert machine.heard == []


def test_a_picture_from_before_is_none_to_begin_with() -> None:
    """A camera that was lost while the operator was asked."""
    machine = YardMachine()
    lens = YardLens(machine, delay_s=0.0)
    for _ in range(100):
        machine.poll()
    old = lens.take()
    assert old is not None
    for _ in range(100):
        machine.poll()
    lens.ends_at_s = 0.0
    lens.take = iter([old, *1000 * [None]]).__next__  # type: ignore[method-assign]
    with pytest.raises(UserError, match="nothing has moved"):
        measured(machine, lens)
    assert machine.heard == []


class Still:
    """Shows for ever what it has shown first; with the sensor's noise, or without."""

    def __init__(self, noise: int) -> None:
        self._noise = noise
        self._first: Bgr | None = None
        self._rng = np.random.default_rng(2)

    def __call__(self, bgr: Bgr) -> Bgr:
        first = self._first = bgr if self._first is None else self._first
        noise = self._rng.integers(-self._noise, self._noise + 1, first.shape)
        return np.clip(first + noise, 0, 255).astype(np.uint8)


def test_a_still_picture_ends_the_drive_within_half_a_metre() -> None:
    machine = YardMachine()
    with pytest.raises(FaultError, match=r"the camera is lost on the way: .* repeats its picture"):
        measured(machine, YardLens(machine, develop=Still(0)))
    assert machine.way <= WEAVE_MPS * (LOST_S + 0.2)


def test_a_still_picture_with_noise_does_not_turn_as_the_machine_does() -> None:
    machine = YardMachine()
    with pytest.raises(UserError, match="do not turn as the machine does"):
        measured(machine, YardLens(machine, develop=Still(6)))


def test_a_mirrored_picture_turns_to_the_other_side() -> None:
    machine = YardMachine()
    flip = lambda bgr: np.asarray(cv2.flip(bgr, 1), np.uint8)  # noqa: E731
    with pytest.raises(UserError, match="to the other side"):
        measured(machine, YardLens(machine, develop=flip))


def test_a_camera_that_is_lost_on_the_way_ends_the_drive() -> None:
    machine = YardMachine()
    lens = YardLens(machine)
    lens.ends_at_s = 5.0
    with pytest.raises(FaultError, match="the camera is lost on the way: silent for 3 s"):
        measured(machine, lens)
    assert machine.now <= 5.0 + LOST_S + 0.2


def test_a_drive_that_was_broken_off_can_be_made_again() -> None:
    """The firmware arms only when the last command asks it to stand."""
    machine = YardMachine()
    lens = YardLens(machine)
    lens.ends_at_s = 5.0
    with pytest.raises(FaultError):
        measured(machine, lens)
    assert measured(machine, YardLens(machine)).delay_s == pytest.approx(0.1, abs=0.015)


def test_a_camera_that_is_slow_is_too_few_pictures() -> None:
    machine = YardMachine()
    with pytest.raises(UserError, match=r"only 1\d pictures came"):
        measured(machine, YardLens(machine, fps=1.0))


def test_a_machine_that_faults_ends_the_drive_and_says_why() -> None:
    machine = YardMachine()
    machine.fault_at_s = 4.0
    with pytest.raises(FaultError, match=r"the machine stopped: .*current"):
        measured(machine, YardLens(machine))
    assert machine.now < 4.1


def test_a_board_that_falls_silent_ends_the_drive() -> None:
    machine = YardMachine()
    machine.mute_at_s = 4.0
    with pytest.raises(FaultError, match="no telemetry for 1 s"):
        measured(machine, YardLens(machine))
    assert machine.now < 5.2


def test_a_machine_that_does_not_steer_is_told() -> None:
    machine = YardMachine()
    machine.steers = False
    with pytest.raises(UserError, match="turned by 0 degrees"):
        measured(machine, YardLens(machine))
    assert machine.now > WEAVE_S


def test_a_machine_that_does_not_arm_is_told() -> None:
    machine = YardMachine()
    machine.fault_at_s = 0.0
    with pytest.raises(UserError, match="the machine is FAULT"):
        measured(machine, YardLens(machine))
    assert machine.state is State.FAULT
    assert not machine.driven
