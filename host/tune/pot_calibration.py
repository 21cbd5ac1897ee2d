"""The steering potentiometer's calibration: creep into both stops and read it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from host.core.errors import UserError
from host.tune.experiments import Experimenter

SEARCH: Final[Mapping[str, float]] = {
    "angle_left": 10.0,
    "angle_right": -10.0,
    "stall_time": 2000.0,
}
"""The firmware's parameters while the stops are looked for. Angles scaled down, so that the angle
limit of the identification mode does not end the search. And 2 s until a stall: at its stop the
wheel stands through four pulses of 0.3 s before the search believes it, and the firmware adds them
up."""


@dataclass(frozen=True, slots=True)
class PotCalibration:
    """The potentiometer at both mechanical stops and half way between."""

    left_counts: float
    right_counts: float
    stop_deg: float

    @property
    def centre_counts(self) -> float:
        """Straight ahead, where the stops are symmetric."""
        return (self.left_counts + self.right_counts) / 2

    def params(self) -> dict[str, float]:
        """As the firmware's parameters."""
        return {
            "pot_left": self.left_counts,
            "pot_centre": self.centre_counts,
            "pot_right": self.right_counts,
            "angle_left": self.stop_deg,
            "angle_right": -self.stop_deg,
        }


def counts_of(angle_deg: float, params: Mapping[str, float]) -> float:
    """The potentiometer's counts where the firmware, with this calibration, reads an angle."""
    side = "left" if angle_deg >= 0 else "right"
    slope = (params[f"pot_{side}"] - params["pot_centre"]) / params[f"angle_{side}"]
    return params["pot_centre"] + slope * angle_deg


def straightened(params: Mapping[str, float], off_deg: float) -> dict[str, float]:
    """The potentiometer's parameters for a wheel that stands so far left of straight where these
    read 0."""
    off = counts_of(off_deg, params) - params["pot_centre"]
    return {name: params[name] - off for name in ("pot_left", "pot_centre", "pot_right")}


def calibrate_pot(
    experimenter: Experimenter, params: dict[str, float], stop_deg: float
) -> PotCalibration:
    """Creeps into both stops, `stop_deg` from straight ahead, and reads the potentiometer there.

    `params`: those that the firmware has now, SEARCH among them.
    """
    scale = max(1.0, stop_deg / abs(params["angle_left"]))
    moving = experimenter.find_direction(1.5 / scale)
    duty = min(experimenter.duty_max, round(1.2 * moving) + 10)
    ends = {way: counts_of(experimenter.find_stop(way, duty, scale), params) for way in (1, -1)}
    if abs(ends[1] - ends[-1]) < 100:
        raise UserError(
            f"the potentiometer moved only {abs(ends[1] - ends[-1]):.0f} counts between the stops: "
            "check its coupling to the steering rod"
        )
    return PotCalibration(ends[1], ends[-1], stop_deg)
