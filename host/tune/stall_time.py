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
JUDGED_DUTY: Final = 40.0
"""Above steer_min_duty, from which on the firmware judges (kDrivenHard)."""
FULL_DUTY: Final = 255.0
LEAST_SHARE: Final = 0.5
"""So that a potentiometer that sticks is found after twice the time at most, however stiff the
motor seems: the wheel turns until then."""


def share_at_least_duty(least_duty: float, friction_duty: float, breakaway_duty: float) -> float:
    """How much of the speed that the firmware expects a good motor shows at the least duty that is
    judged, 1 at most. The firmware takes speed for proportional to what duty is above least_duty,
    its steer_min_duty, which is less than friction takes: more would make the loop swing."""
    duty = min(FULL_DUTY - 1.0, max(least_duty + JUDGED_DUTY, breakaway_duty))
    expected = (duty - least_duty) / (FULL_DUTY - least_duty)
    shown = (duty - friction_duty) / (FULL_DUTY - friction_duty)
    return min(1.0, max(LEAST_SHARE, shown / expected))


def stall_time_ms(slew_degps: float, backlash_deg: float, share: float = 1.0) -> float:
    """For a motor of this speed at full duty, within the parameter's range. `share`: of
    `share_at_least_duty`."""
    way_deg = (max(PLAY_DEG, backlash_deg) + SURE_DEG) / share
    spec = protocol.PARAMS["stall_time"]
    held = round((LAG_MS + 1000.0 * way_deg / (SLOWER * slew_degps)) / spec.scale)
    return spec.from_raw(min(spec.max_raw, max(spec.min_raw, held)))
