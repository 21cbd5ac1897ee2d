"""`daranti clear`: the firmware's latched faults."""

from __future__ import annotations

import click

from host.commands.options import port_option
from host.core.errors import FaultError
from host.core.messages import State
from host.core.terminal import echo
from host.link import protocol
from host.link.session import Link, connect

SETTLE_S = 0.3
"""A fault whose cause is still there is back by then."""
SILENT_S = 3.0
"""Without telemetry, after which nobody is there."""


@click.command()
@port_option
def clear(port: str) -> None:
    """Shows the latched faults and clears those whose cause is gone. Nothing moves: the machine is
    SAFE then, and `daranti drive` can start."""
    with connect(port) as link:
        for text in _faults(link):
            echo(f"fault: {text}")
        link.ask(protocol.Clear())
        left = _faults(link)
        telemetry = link.session.telemetry
        if left or telemetry is None or telemetry.state is State.FAULT:
            raise FaultError(f"{port}: still there: {'; '.join(left)}")
        echo(f"cleared; the firmware is {telemetry.state.name}")


def _faults(link: Link) -> list[str]:
    """In words, after what a moment's telemetry says."""
    begun = link.clock()
    heard = False
    while (waited := link.clock() - begun) < SETTLE_S or not heard:
        if waited > SILENT_S:
            raise FaultError(f"{link.port}: the firmware sends no telemetry; reset the board")
        heard = bool(link.poll(SETTLE_S)) or heard
    telemetry = link.session.telemetry
    return protocol.fault_texts(protocol.Fault(telemetry.faults)) if telemetry else []
