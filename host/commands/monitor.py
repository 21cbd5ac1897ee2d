"""`daranti monitor`: what the firmware says, decoded, with faults in words."""

from __future__ import annotations

import dataclasses
import json
import math
import time

import click

from host.commands.cli import port_option
from host.core.messages import Telemetry
from host.link import protocol
from host.link.session import Link

LINE_EVERY_S = 0.5
POLL_S = 0.2
BUILDS = {0: "uno", 1: "desk", 2: "uno_hil"}
RESET_CAUSES = ("power-on", "external", "brown-out", "watchdog")


def greeting(version: protocol.Version) -> str:
    """Who answered, and why it last started."""
    causes = [name for bit, name in enumerate(RESET_CAUSES) if version.reset_cause >> bit & 1]
    return (
        f"firmware {version.firmware_major}.{version.firmware_minor} "
        f"({BUILDS.get(version.build, f'build {version.build}')}), protocol "
        f"{version.protocol_version}, started by {' and '.join(causes) or 'an unknown cause'}"
    )


def line(telemetry: Telemetry) -> str:
    """One telemetry message in one line."""
    speed = "" if telemetry.speed_mps is None else f"  {telemetry.speed_mps:+.2f} m/s"
    return (
        f"{telemetry.stamp:8.2f} s  {telemetry.state.name:7}"
        f"  steer {math.degrees(telemetry.angle_rad):+6.1f}°"
        f" of {math.degrees(telemetry.setpoint_rad):+6.1f}° duty {telemetry.steer_duty:+4d}"
        f"  drive {telemetry.drive_duty:+4d}{speed}  blade {'on ' if telemetry.blade else 'off'}"
        f"  {telemetry.battery_v:5.2f} V  bad frames {telemetry.frames_bad}"
    )


def as_json(telemetry: Telemetry) -> str:
    """One telemetry message as a JSON object, SI units, faults also in words."""
    fields = dataclasses.asdict(telemetry)
    fields["state"] = telemetry.state.name
    fields["fault_texts"] = protocol.fault_texts(protocol.Fault(telemetry.faults))
    return json.dumps(fields)


@click.command()
@port_option
@click.option("--duration", type=click.FloatRange(0, min_open=True), help="Seconds; else Ctrl-C.")
@click.option("--json", "every", is_flag=True, help="Every message as a line of JSON.")
def monitor(port: str, duration: float | None, every: bool) -> None:
    """Shows the firmware's telemetry: twice a second, and at once when the state or a fault
    changes."""
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    with Link(port, clock) as link:
        version = link.meet()
        if not every:
            click.echo(greeting(version))
        shown: Telemetry | None = None
        while duration is None or clock() < duration:
            for telemetry in link.poll(POLL_S):
                if every:
                    click.echo(as_json(telemetry))
                else:
                    shown = _show(telemetry, shown)


def _show(telemetry: Telemetry, shown: Telemetry | None) -> Telemetry:
    """Prints what is new since `shown`; returns what is shown now."""
    faults = telemetry.faults
    changed = shown is None or (telemetry.state, faults) != (shown.state, shown.faults)
    if shown is not None and not changed and telemetry.stamp - shown.stamp < LINE_EVERY_S:
        return shown
    click.echo(line(telemetry))
    if changed:
        for text in protocol.fault_texts(protocol.Fault(faults)):
            click.echo(f"            fault: {text}")
    return telemetry
