"""Connect alone: a context that a test sets, one step after the other."""

from __future__ import annotations

from dataclasses import replace

from host.core.messages import Request, State
from host.pilot.behaviours.connect import ARM_RETRY_S, Connect
from host.pilot.behaviours.connect import Why as Connected
from tests.helpers.behaving import NOW, is_for, standing, told


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
