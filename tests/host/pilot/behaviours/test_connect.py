"""Connect alone: a context that a test sets, one step after the other."""

from __future__ import annotations

import math
from dataclasses import replace

from host.core.messages import Request, State, Turned
from host.pilot.behaviours.connect import ARM_RETRY_S, CREPT_M, SETTLE_S, SETTLED, Connect
from host.pilot.behaviours.connect import Why as Connected
from host.pilot.context import Context
from tests.helpers.behaving import NOW, is_for, moved, standing, told


def test_connect_asks_to_arm_and_asks_again() -> None:
    context = standing()
    connect = Connect(context)
    context.telemetry = told(state=State.SAFE)
    assert connect.step(NOW)[0].request is Request.ARM
    assert connect.step(NOW + ARM_RETRY_S / 2)[0].request is Request.DRIVE
    assert connect.step(NOW + 1.1 * ARM_RETRY_S)[0].request is Request.ARM
    context.telemetry = told(state=State.ARMED)
    assert is_for(connect.step(NOW + 2.0)[1], Connected.ARMED)


def test_connect_says_why_the_firmware_does_not_arm() -> None:
    context = standing()
    refusal = "Arm refused: this machine is not set up"
    context.telemetry = replace(told(state=State.SAFE), refusal=refusal)
    Connect(context).step(NOW)
    assert context.reason == refusal


def test_connect_clears_a_fault_once() -> None:
    context = standing()
    connect = Connect(context)
    context.telemetry = told(state=State.FAULT)
    assert connect.step(NOW)[0].request is Request.CLEAR
    command, go = connect.step(NOW + 1.0)
    assert command.request is Request.STOP
    assert is_for(go, Connected.FAULT_STAYS)


def told_of_turning(*, known_to_radps: float) -> Context:
    """An armed machine whose gyroscope has spoken, its offset as well known as that."""
    context = standing()
    context.telemetry = told(state=State.ARMED)
    gyroscope = context.estimate.odometry.gyroscope
    gyroscope.take(Turned(NOW, 0.0, NOW), None, None)
    gyroscope.offset_sigma = known_to_radps
    return context


def test_connect_stands_until_the_gyroscopes_offset_is_known() -> None:
    context = told_of_turning(known_to_radps=1.1 * SETTLED)
    connect = Connect(context)
    command, go = connect.step(NOW)
    assert go is None
    assert command.request is Request.DRIVE
    assert (command.speed_mps, command.blade) == (0.0, False)
    context.estimate.odometry.gyroscope.offset_sigma = 0.9 * SETTLED
    assert is_for(connect.step(NOW + 0.1)[1], Connected.ARMED)


def test_connect_does_not_wait_for_ever_for_a_gyroscope_that_is_shaken() -> None:
    connect = Connect(told_of_turning(known_to_radps=math.inf))
    assert connect.step(NOW)[1] is None
    assert connect.step(NOW + 0.9 * SETTLE_S)[1] is None
    assert is_for(connect.step(NOW + 1.1 * SETTLE_S)[1], Connected.ARMED)


def test_connect_does_not_wait_on_a_slope_that_lets_the_machine_creep() -> None:
    context = told_of_turning(known_to_radps=math.inf)
    connect = Connect(context)
    assert connect.step(NOW)[1] is None
    moved(context, -0.9 * CREPT_M, stamp=NOW + 0.5)
    assert connect.step(NOW + 0.5)[1] is None
    moved(context, -1.1 * CREPT_M, stamp=NOW + 0.6)
    assert is_for(connect.step(NOW + 0.6)[1], Connected.ARMED)


def test_connect_waits_for_no_gyroscope_that_says_nothing() -> None:
    context = standing()
    context.telemetry = told(state=State.ARMED)
    assert not math.isfinite(context.estimate.odometry.gyroscope.stamp)
    assert is_for(Connect(context).step(NOW)[1], Connected.ARMED)
