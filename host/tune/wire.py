"""The machine as experiments speak to it: a serial port, or the bench in lockstep."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, Protocol

from host.core.errors import UserError
from host.core.messages import State, Telemetry
from host.link import protocol
from host.link.session import Session

CLEAR_S: Final = 0.5
"""Time for the firmware to answer CLEAR, at 20 ms between telemetry."""
ARM_S: Final = 1.0
"""Time for it to arm, and before that to say anything."""


class Wire(Protocol):
    """The machine, as the experiments see it."""

    @property
    def session(self) -> Session:
        """The conversation: answers and refusals."""
        ...

    @property
    def now(self) -> float:
        """Seconds on the host's clock."""
        ...

    def request(self, message: protocol.Message) -> None:
        """Sends a message to the firmware."""
        ...

    def poll(self) -> list[Telemetry]:
        """Waits a few milliseconds at most; returns the telemetry that came."""
        ...


@contextmanager
def armed_wire(wire: Wire, name: str) -> Iterator[None]:
    """Arms the machine and stops it whatever happens. Latched faults whose cause is gone are
    cleared: the operator asked for a new start. Raises UserError where it does not arm."""
    telemetry = _first_telemetry(wire, name)
    if telemetry.state is State.FAULT:
        wire.request(protocol.Clear())
        deadline = wire.now + CLEAR_S
        while telemetry.state is State.FAULT and wire.now < deadline:
            telemetry = (wire.poll() or [telemetry])[-1]
        wire.session.refusal = ""
    if telemetry.state is not State.SAFE:
        raise UserError(f"{name}: the machine is {telemetry.state.name}: {why(telemetry)}")
    try:
        # A board that does not reset when its port is opened may still be asked for motion by who
        # drove it before, and arms only when it is asked to stand.
        wire.request(protocol.Drive(0.0, 0.0, 0))
        wire.request(protocol.Arm(protocol_version=protocol.VERSION))
        deadline = wire.now + ARM_S
        while wire.session.telemetry is None or wire.session.telemetry.state is not State.ARMED:
            wire.poll()
            if wire.session.refusal:
                raise UserError(f"{name}: {wire.session.refusal}")
            if wire.now > deadline:
                raise UserError(f"{name}: the machine does not arm")
        wire.session.answers.clear()
        yield
    finally:
        wire.request(protocol.Stop())


def _first_telemetry(wire: Wire, name: str) -> Telemetry:
    deadline = wire.now + ARM_S
    while wire.now < deadline:
        if came := wire.poll():
            return came[-1]
    raise UserError(f"{name}: no telemetry within {ARM_S:g} s")


def why(telemetry: Telemetry) -> str:
    """Why the firmware left the state that was asked for, in words."""
    texts = protocol.fault_texts(protocol.Fault(telemetry.faults))
    return "; ".join(texts) if texts else f"it went to {telemetry.state.name}"
