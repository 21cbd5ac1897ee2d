"""The firmware's parameter stall_time from what identification finds of the steering motor.

A steering that is driven and shows no movement is a fault once it should have turned through its
play and a degree more. Until then a healthy one may be silent; the faster the motor, the sooner.
"""

from __future__ import annotations

from typing import Final

from host.link import protocol

LAG_MS: Final = 100.0
"""What the firmware gives the motor to come to speed (firmware/src/core/supervisor.cpp)."""
PLAY_DEG: Final = 2.0
"""Of the most worn steering that the design knows: a new one will have it one day."""
SURE_DEG: Final = 1.0
"""Beyond the play: the firmware takes 0.6 degrees for the potentiometer's noise."""
SLOWER: Final = 0.8
"""Of the speed that was identified: what a weak battery, wear and a cold morning leave."""


def stall_time_ms(slew_degps: float, backlash_deg: float) -> float:
    """For a motor of this speed at full duty, within the parameter's range."""
    way_deg = max(PLAY_DEG, backlash_deg) + SURE_DEG
    spec = protocol.PARAMS["stall_time"]
    held = round((LAG_MS + 1000.0 * way_deg / (SLOWER * slew_degps)) / spec.scale)
    return spec.from_raw(min(spec.max_raw, max(spec.min_raw, held)))
