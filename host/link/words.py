"""What the firmware says, in words."""

from __future__ import annotations

import dataclasses
import json
import math

from host.core.messages import Telemetry
from host.link import protocol

BUILDS = {0: "uno", 1: "desk", 2: "uno_hil", 3: "nano", 4: "mega2560"}


def greeting(version: protocol.Version) -> str:
    """Who answered, and why it last started."""
    texts = protocol.RESETCAUSE_TEXTS
    causes = [text for bit, (text, _) in texts.items() if bit & version.reset_cause]
    changed = " and changes" if version.modified else ""
    built = f", commit {version.commit:08x}{changed}" if version.commit else ""
    return (
        f"firmware {version.firmware_major}.{version.firmware_minor} "
        f"({BUILDS.get(version.build, f'build {version.build}')}{built}), protocol "
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


def sensors(readings: protocol.Readings) -> str:
    """What the sensors read in one line: counts are of 1023 for 5 V."""
    r = readings
    return (
        f"pot {r.pot:6.1f}  battery {r.battery:6.1f}  e-stop {r.estop:6.1f} counts"
        f"  steering {r.steer_current:5.2f} A ({r.steer_sense:.1f})"
        f"  drive {r.drive_current:5.2f} A ({r.drive_sense:.1f})"
        f"  wheel {r.hall}  blade {r.blade_turns} pulses"
        f"  late ticks {r.overruns}  line errors {r.line_errors}  stale {r.stale}"
    )


def as_json(telemetry: Telemetry) -> str:
    """One telemetry message as a JSON object, SI units, faults also in words."""
    fields = dataclasses.asdict(telemetry)
    fields["state"] = telemetry.state.name
    fields["fault_texts"] = protocol.fault_texts(protocol.Fault(telemetry.faults))
    return json.dumps(fields)
