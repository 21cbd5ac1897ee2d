"""What a person beside the machine sees of it, where the check asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def sees(
    key: str, values: Mapping[str, Any], angle_deg: float, rolled_m: float
) -> str | float | None:
    """The answer to the question `key`, which speaks of `values`, by the front wheel's true angle
    (left is positive) and the way rolled since the person looked for room. None where the question
    is about something else."""
    match key:
        case "steered":
            return "left" if angle_deg > 5 else "right" if angle_deg < -5 else "not_at_all"
        case "turned_far":
            asked = float(values["degrees"])
            if abs(angle_deg - asked) < 8:
                return "as_drawn"
            return "less" if angle_deg < asked else "more"
        case "straight":
            if abs(angle_deg) < 6:
                return "yes"
            return "points_left" if angle_deg > 0 else "points_right"
        case "rolled":
            return "forward" if rolled_m > 0.1 else "backward" if rolled_m < -0.1 else "not_at_all"
        case "rolled_m":
            return round(abs(rolled_m), 2)
        case _:
            return None
