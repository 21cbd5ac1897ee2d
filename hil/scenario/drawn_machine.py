"""Machines as builders make them: lengths, motors, bridges, sensors, and where the phone sits.

No two are alike, and none is the one whose values stand in the host's defaults: what a machine is,
its owner measures (`daranti-hil commission`). Each part has a stream of its own, so that one value
more changes no other part of a seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from hil.scenario.drawn import Drawn
from sim_plant.camera import MOUNTS
from sim_plant.gyro import GyroSpec
from sim_plant.machine import BatterySpec, BridgeSpec, DriveSpec, MachineSpec, SteeringSpec

NOMINAL_RANGES: Final[Mapping[str, tuple[float, float]]] = {
    "slew_degps": (20.0, 60.0),
    "lag_s": (0.05, 0.1),
    "stiction_counts": (25.0, 90.0),
    "backlash_deg": (0.5, 2.0),
    "pot_counts_per_deg": (4.0, 5.0),
    "bridge_drop_v": (0.3, 3.2),
}
"""The steering actuators of the design (docs/build/README.md); the bridge from a BTS7960 to an
L298N at its worst."""

BLADE_AT: Final = (0.82, 0.95)
"""Of the picture's height, from above: where a mast's builder has the blade's line, "at the lower
border" (docs/build/README.md)."""


WHEEL_IN_M: Final = (0.03, 0.08)
"""From a wheel's outside to the middle of its tread, m."""


def drawn_machine(seed: int) -> MachineSpec:
    """The machine of a seed: a tricycle whose blade is wider than its wheels."""
    lengths, within = Drawn(seed, 0x6E0), Drawn(seed, 0x3AC8).within
    blade_m = lengths.within(0.85, 1.25)
    ranges = NOMINAL_RANGES
    steering = SteeringSpec.from_response(
        slew_degps=within(*ranges["slew_degps"]),
        lag_s=within(*ranges["lag_s"]),
        stiction_counts=within(*ranges["stiction_counts"]),
        backlash_deg=within(*ranges["backlash_deg"]),
        bridge=BridgeSpec(drop_v=within(*ranges["bridge_drop_v"])),
        stop_deg=within(52.0, 58.0),
    )
    steering = steering.model_copy(
        update={
            "pot_centre_counts": within(490.0, 535.0),
            "pot_counts_per_deg": within(*ranges["pot_counts_per_deg"]),
            "pot_noise_counts": within(1.0, 3.0),
        }
    )
    drive = DriveSpec(
        bridge=BridgeSpec(drop_v=within(0.3, 2.0), r_ohm=0.03),
        r_ohm=within(0.12, 0.22),
        k_vspm=within(8.0, 13.0),
        mass_kg=within(90.0, 130.0),
        rolling=within(0.03, 0.05),
        hall_pulses_per_m=within(20.0, 100.0),
    )
    battery = BatterySpec(full_v=within(12.4, 12.8), r_ohm=within(0.02, 0.05))
    machine = MachineSpec(
        wheelbase_m=lengths.within(0.85, 1.2),
        half_width_m=round(blade_m / 2 - lengths.within(0.05, 0.15), 3),
        rear_overhang_m=lengths.within(0.15, 0.35),
        blade_width_m=blade_m,
        blade_ahead_m=lengths.within(0.35, 0.65),
        blade_height_m=lengths.within(0.08, 0.15),
        cornering_front_n=lengths.within(2200.0, 4000.0),
        cornering_rear_n=lengths.within(6000.0, 10000.0),
        front_load=lengths.within(0.3, 0.4),
        steering=steering,
        drive=drive,
        battery=battery,
    )
    counted = {"hall_left_m": _counted_left_m(seed, machine.half_width_m)}
    return machine.model_copy(update={"drive": drive.model_copy(update=counted)})


def _counted_left_m(seed: int, half_width_m: float) -> float:
    """Where the sensor's magnets sit: on the left wheel, on the right one, or on the axle before a
    differential (docs/build/README.md, "Parts")."""
    kit = Drawn(seed, 0x3E1)
    tread_m = round(half_width_m - kit.within(*WHEEL_IN_M), 3)
    return float(kit.rng.choice((tread_m, -tread_m, 0.0)))


def drawn_lens(seed: int, camera: str, machine: MachineSpec) -> dict[str, Any]:
    """What of the phone and its mount is not as in the mount's drawing, for `Scenario.lens`: its
    place, its angles by eye, another phone's lens and delay. A mast's phone is tilted so that it
    shows the blade's line, a low one so that it looks along the crop's face."""
    within = Drawn(seed, 0xCA3).within
    drawing = MOUNTS[camera]
    hfov = within(56.0, 70.0)
    x_m = drawing.x_m + within(-0.15, 0.15)
    if camera == "mast":
        z_m = within(1.4, 1.8)
        focal = drawing.width_px / 2 / math.tan(math.radians(hfov) / 2)
        down = math.atan2(z_m, machine.blade_x_m - x_m)
        below = math.atan((within(*BLADE_AT) - 0.5) * drawing.height_px / focal)
        pitch = math.degrees(down - below)
    else:
        z_m, pitch = within(0.5, 0.7), within(2.0, 8.0)
    return {
        "x_m": round(x_m, 3),
        "y_m": within(-0.15, 0.15),
        "z_m": z_m,
        "pitch_deg": round(pitch, 2),
        "yaw_deg": within(-3.0, 3.0),
        "roll_deg": within(-2.0, 2.0),
        "hfov_deg": hfov,
        "k1": within(-0.1, 0.02),
        "k2": within(0.0, 0.02),
    }


def drawn_gyro(kit: Drawn) -> GyroSpec:
    """A phone's gyroscope, by the next numbers of a stream."""
    return GyroSpec(
        noise_dps=kit.within(0.05, 0.3),
        offset_dps=kit.within(0.0, 1.0),
        walk_dps=kit.within(0.0, 0.006),
        scale_error=kit.within(-0.015, 0.015),
        vibration_dps=kit.within(0.1, 1.5),
        delay_s=kit.within(0.04, 0.2),
    )
