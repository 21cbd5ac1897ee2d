"""What a machine's drive does, worked out from its physics: what a measurement should find."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from sim_plant.machine import DRIVE_PWM_HZ, GRAVITY, MachineSpec

RATED_V: Final = 12.0
"""Of a lead battery of six cells: at which a drive's speed is stated."""


@dataclass(frozen=True, slots=True)
class DriveResponse:
    """On level ground without crop: the ground speed v at a duty u is full * (u - dead) / (1 -
    dead), reached with a first-order lag."""

    full_mps: float
    dead: float
    """Share of the full duty."""
    lag_s: float


def drive_response(
    spec: MachineSpec, battery_v: float = RATED_V, pwm_hz: float = DRIVE_PWM_HZ
) -> DriveResponse:
    """At a battery voltage, under load."""
    d = spec.drive
    ohm = d.r_ohm + d.bridge.r_ohm
    volts = battery_v - d.bridge.drop_v
    drag_n = d.rolling * d.mass_kg * GRAVITY
    dead = d.bridge.dead_time_s * pwm_hz + ohm * drag_n / d.k_vspm / volts
    slips = 1.0 - drag_n / d.slip_n
    full = slips * volts * (1.0 - dead) / d.k_vspm
    return DriveResponse(full, dead, d.mass_kg * ohm / d.k_vspm**2)
