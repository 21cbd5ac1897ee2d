"""`daranti monitor`: what the firmware says, decoded, with faults in words."""

from __future__ import annotations

import dataclasses
import json
import math
import time

import click

from host.commands.options import port_option
from host.core.messages import Telemetry
from host.core.number_range import NumberRange
from host.core.terminal import echo
from host.link import protocol
from host.link.session import Link
from host.link.words import as_json, greeting, line, sensors

LINE_EVERY_S = 0.5
"""Between lines where nothing changes."""
POLL_S = 0.2
"""Longest wait for telemetry."""
SILENT_S = 1.0
"""Without telemetry, of which 50 come in a second, until that is told."""


@click.command()
@port_option
@click.option("--duration", type=NumberRange(0, min_open=True), help="Seconds; else Ctrl-C.")
@click.option("--json", "every", is_flag=True, help="Every message as a line of JSON.")
@click.option("--readings", is_flag=True, help="What the sensors read instead, six times a second.")
def monitor(port: str, duration: float | None, every: bool, readings: bool) -> None:
    """Shows the firmware's telemetry: twice a second, and at once when the state or a fault
    changes."""
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    with Link(port, clock) as link:
        version = link.meet()
        if not every:
            echo(greeting(version))
        shown: Telemetry | None = None
        read: protocol.Readings | None = None
        heard, resets = clock(), link.session.resets
        while duration is None or clock() < duration:
            arrived = link.poll(POLL_S)
            if arrived:
                heard = clock()
            elif clock() - heard > SILENT_S:
                echo(
                    f"no telemetry for {SILENT_S:g} s: the board hangs, or its cable is broken",
                    err=True,
                )
                heard = math.inf  # told once, until it speaks again
            if link.session.resets != resets:
                resets = link.session.resets
                echo("the firmware has restarted", err=True)
            for telemetry in arrived:
                if readings:
                    newest = link.session.readings
                    if newest is not None and newest is not read:
                        echo(json.dumps(dataclasses.asdict(newest)) if every else sensors(newest))
                    read = newest
                elif every:
                    echo(as_json(telemetry))
                else:
                    shown = _show(telemetry, shown)


def _show(telemetry: Telemetry, shown: Telemetry | None) -> Telemetry:
    """Prints what is new since `shown`; returns what is shown now."""
    faults = telemetry.faults
    changed = shown is None or (telemetry.state, faults) != (shown.state, shown.faults)
    if shown is not None and not changed and telemetry.stamp - shown.stamp < LINE_EVERY_S:
        return shown
    echo(line(telemetry))
    if changed:
        for text in protocol.fault_texts(protocol.Fault(faults)):
            echo(f"            fault: {text}")
    return telemetry
