"""How wide the gap to the neighbour's crop is: said with a tape, and seen at the ends of the sides
that are cut along the boundary.

What is seen only narrows it: a tape that was laid elsewhere, or read wrongly, must not lead the
machine into another's crop.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import median_high
from typing import Final

from host.estimate.crop_ahead import END_CLEAR_M

TAPE_M: Final = 0.2
"""What a taped gap errs: no border is straight."""
SEEN_M: Final = 0.2
"""What is seen errs, looked at until it is known."""
TELLS_M: Final = 0.3
"""What is seen contradicts what was said by more."""
OWN_SIGMAS: Final = 2.0
RECKONED_M: Final = 0.5
"""What a machine keeps off the next crop besides while it goes to what it has left standing: it is
on its way across the field by dead reckoning, and its place against the border was 0.3 to 0.7 m
wrong then where it said 0.2 (belief "a little of all", outline 304)."""
SQUARE_RAD: Final = math.radians(30.0)
"""Against the edge's normal, at most, under which a side's end tells of the gap: the last tip of
the one crop and the first of the other stand at opposite ends of the blade."""


def across(way_m: float, askew_rad: float, wide_m: float) -> float:
    """The gap, m, of which a machine that leaves one crop has `way_m` to the next, heading
    `askew_rad` from the edge's normal; it looks over a way of `wide_m`."""
    return way_m * math.cos(askew_rad) + wide_m * math.sin(abs(askew_rad))


def along(gap_m: float, askew_rad: float, wide_m: float) -> float:
    """The way to the next crop over a gap: what `across` is the gap of."""
    return (gap_m - wide_m * math.sin(abs(askew_rad))) / math.cos(askew_rad)


class Gaps:
    """Of one field."""

    def __init__(self, said_m: float) -> None:
        self.said_m = said_m
        self._seen: dict[int, float] = {}
        """By the boundary's edges that they lie beyond."""
        self.room_m = math.inf
        """From the side's end that was left last to the next crop, as seen there."""
        self._nearer: dict[int, float] = {}
        self.gathers = False
        """Whether the machine is on its way to what it has left standing."""

    def leave(self) -> None:
        """The side's end is left behind."""
        self.room_m, self._nearer = math.inf, {}

    def note(self, edge: int, gap_m: float) -> None:
        """So wide it was seen to be beyond an edge of the boundary."""
        self._seen[edge] = gap_m

    def at_end(self, edges: Sequence[int], room_m: float, *, sure: bool) -> float:
        """At the end of a side, beyond which the first of these edges lies, so much room was seen
        to the next crop; if not `sure`, to what may be the side's own. Returns the gap that the
        turn is to reckon with along all edges."""
        if sure:
            self.room_m = room_m
            return min(self.beside(edges), self.narrowed(room_m))
        self._nearer = {edges[0]: max(0.0, room_m)}
        return self.beside(edges)

    def knows(self, edge: int) -> bool:
        """Whether the gap beyond an edge has been seen."""
        return edge in self._seen

    def narrowed(self, gap_m: float) -> float:
        """What was said, where that is not surely more than was seen; else no more than was surely
        seen."""
        return max(0.0, gap_m - SEEN_M) if self.contradicts(gap_m) else self.said_m

    def contradicts(self, gap_m: float) -> bool:
        """Whether one that was seen is too narrow for what was said."""
        return gap_m < self.said_m - TELLS_M

    def too_narrow(self, way_m: float, sigma_m: float) -> bool:
        """Whether crop that stands so far, give or take sigma_m, beyond what was taken for a side's
        end is surely no next crop, but the side's own: a gap that was said to be twice as wide as
        the clear ground that ends a side is not narrower than that."""
        return way_m + OWN_SIGMAS * sigma_m < END_CLEAR_M <= self.said_m / 2

    def beside(self, edges: Iterable[int]) -> float:
        """What a turn between these edges is to reckon with: what was seen beyond them, too."""
        return min([self.field_m, *(self.narrowed(self._seen.get(e, math.inf)) for e in edges)])

    @property
    def field_m(self) -> float:
        """What to reckon with beside an edge that has not been looked at: what was said, or the
        median of what was seen where that is less. With 0.3 m too much of it the machine's rear
        would stand in the next crop."""
        return min(self.narrowed(self._seen_m), self._seen_m)

    @property
    def gathering_m(self) -> float:
        """What to reckon with everywhere while the machine gathers what it has left standing, which
        may lead it along any edge."""
        narrowest_m = min(self.field_m, self.least_m, self.narrowed(self.room_m))
        return max(0.0, narrowest_m - RECKONED_M)

    @property
    def nearer(self) -> dict[int, float]:
        """By the boundary's edge: how far beyond the side's end that was left last something stands
        there, where that is less clear ground than ends a side. It may be the side's own, and tells
        of no gap."""
        doubt_m = RECKONED_M if self.gathers else 0.0
        return {edge: max(0.0, room_m - doubt_m) for edge, room_m in self._nearer.items()}

    @property
    def least_m(self) -> float:
        """The narrowest, by what was said and by every edge that has been looked at."""
        return self.narrowed(min(self._seen.values(), default=math.inf))

    @property
    def _seen_m(self) -> float:
        """What most edges show; inf where fewer than two have been seen."""
        seen = self._seen.values()
        return median_high(seen) if len(seen) > 1 else math.inf

    @property
    def wrong(self) -> str:
        """What pictures show to be wrong of what was said, in words; empty where nothing is."""
        said = f"the gap was said to be {self.said_m:.1f} m"
        if self.narrowed(self._seen_m) != self.said_m:
            return f"{said}, pictures show {self._seen_m:.1f} m"
        least_m = min(self._seen.values(), default=math.inf)
        if self.contradicts(least_m):
            return f"{said}, pictures show {least_m:.1f} m at one side"
        room_m = min([self.room_m, *self._nearer.values()])
        if self.contradicts(room_m):
            return f"{said}, something stands {max(0.0, room_m):.1f} m beyond the side's end"
        return ""
