"""What the figures of merit are measured in, which way is better, and what they have to keep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_UNITS: Final = {
    "coverage": "of 1",
    "finished": "runs",
    "runs": "runs",
    "crashed": "runs",
    "realtime_factor": "times",
    "deadlines_missed": "slices",
}
_SUFFIXES: Final = {
    "_per_deg": "1/°",
    "_m2": "m²",
    "_mps": "m/s",
    "_degps": "°/s",
    "_deg": "°",
    "_ms": "ms",
    "_m": "m",
    "_s": "s",
    "_j": "J",
}

HIGHER_IS_BETTER: Final = frozenset({"coverage", "finished", "realtime_factor"})
LOWER_IS_BETTER: Final = frozenset(
    {
        "missed_m2",
        "neighbour_cut_m2",
        "outside_m",
        "keep_out_m",
        "lateral_rms_m",
        "lateral_p95_m",
        "lateral_mean_m",
        "end_of_field_error_median_m",
        "end_of_field_error_worst_m",
        "false_ends",
        "crashed",
        "bad",
    }
)


MISSED: Final = ": MISSED"


@dataclass(frozen=True, slots=True)
class Mark:
    """What a figure has to keep, whatever the field."""

    limit: float
    least: bool = False
    """At least the limit, not at most."""

    def __str__(self) -> str:
        return f"{'at least' if self.least else 'at most'} {self.limit:g}" if self.limit else "0"

    def holds(self, value: float) -> bool:
        """Whether a figure keeps it; one that is no number does not."""
        return value >= self.limit if self.least else value <= self.limit


MARKS: Final = {
    "coverage": Mark(0.95, least=True),
    "neighbour_cut_m2": Mark(0.0),
    "outside_m": Mark(0.1),
    "keep_out_m": Mark(0.0),
}
"""Of a run that finished; one that stopped safely keeps all but the coverage."""


def _bare(key: str) -> str:
    """The quantity that a statistic is of."""
    for end in (" median", " worst", "_worst", "_mean"):
        key = key.removesuffix(end)
    return key


def unit_of(key: str) -> str:
    """The unit of a figure of that name; empty for a count."""
    name = _bare(key)
    if name in _UNITS:
        return _UNITS[name]
    return next((unit for end, unit in _SUFFIXES.items() if name.endswith(end)), "")


def mark_of(key: str) -> Mark | None:
    """What a figure of that name has to keep; None where it may be anything. A median tells of half
    the runs only."""
    return None if key.endswith(" median") else MARKS.get(key.removesuffix(" worst"))


def better(key: str, value: float, other: float) -> bool | None:
    """Whether a figure is better than another run's; None where neither is."""
    name = key.removesuffix(" median").removesuffix(" worst")
    if name in HIGHER_IS_BETTER and value != other:
        return value > other
    if name in LOWER_IS_BETTER and abs(value) != abs(other):
        return abs(value) < abs(other)
    return None


def cells_of(key: str, value: float) -> tuple[str, str, str, str]:
    """Name, value, unit and what it has to keep, which says so where it does not."""
    mark = mark_of(key)
    must = "" if mark is None else f"{mark}{'' if mark.holds(value) else MISSED}"
    return key, f"{value:g}", unit_of(key), must
