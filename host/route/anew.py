"""The rest of a plan, laid out anew around a boundary whose corners were found to lie elsewhere.

A pilot has 250 ms between two commands and no thread, and the strips of a large field take seconds
to compute. So they are laid out some at a time, while the machine stands. Of a field that would
keep it standing for long, they are laid out only as far as the machine gets before it stands at an
end again; from there on the plan is as it was until then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.route.plan import Plan, strip_by_strip
from host.route.side import NO_EDGE, Side

ENOUGH_STRIPS: Final = 300
"""Laid out in one go at most, where more are not needed: with three in each 50 ms, the machine
stands for 5 s."""
AS_MUCH: Final = 0.95
"""Of what the old plan still cuts, for another to take its place: corners that moved by decimetres
may let a field fall into parts to which no turn leads."""
ELSEWHERE_M: Final = 3.0
"""Between the ends of a side that was cut and of the one in its place: corners move by less.
Smaller: the old plan stays where another fits; larger: the machine goes so far to begin a turn."""
AHEAD: Final = 2
"""Sides that are needed after the one that was just cut: to turn to the next is to know where that
one ends and which way it goes on."""


class Anew:
    """One laying out. `boundary`: where the corners were found to lie, metres, once the strips of
    the field along its edges `cut` were cut; the keep-outs go with them."""

    def __init__(
        self,
        plan: Plan,
        boundary: list[tuple[float, float]],
        cut: Sequence[int],
        vehicle: Vehicle,
    ) -> None:
        self._outs = [moved_with(plan.boundary, boundary, ring) for ring in plan.keep_outs]
        self._boundary = tuple(boundary)
        ends = [side.edges[-1] if side.edges else NO_EDGE for side in plan.sides]
        cut_to = [*(NO_EDGE for _ in plan.before), *ends][: len(cut)]
        self._steps = strip_by_strip(boundary, 0, vehicle, plan, self._outs, cut, cut_to)
        self._sides: Sequence[Side] = ()
        self._whole: Plan | None = None
        self._strips = 0
        self.over = False
        """Whether nothing is left to lay out."""
        self.taken = False
        """Whether the machine drives by it already."""

    def enough(self, plan: Plan, index: int) -> bool:
        """Whether the machine can go on from the end of `plan.sides[index]`."""
        known = len(self._sides) > plan.done + index + AHEAD
        return self.over or (known and self._strips >= ENOUGH_STRIPS)

    def lay(self, strips: int) -> None:
        """So many strips more, at most."""
        for _ in range(strips):
            if self.over:
                return
            try:
                self._sides = next(self._steps)
            except StopIteration as whole:
                self.over, self._whole = True, whole.value
            except UserError:
                self.over = True
            self._strips += 1

    def plan(self, old: Plan, index: int) -> Plan | None:
        """`old` with what has been laid out, as far as that goes; None where no plan has the sides
        up to `index` as they were cut, or where what is found would leave crop that the old one,
        whose sides move with the corners too, still cuts."""
        if self.over and self._whole is None:
            return None
        if self._whole is not None:
            sides = self._whole.sides[old.done :]
            found = replace(self._whole, done=old.done, before=old.before)
            if _share(sides[index + 1 :], found) < AS_MUCH * _share(old.sides[index + 1 :], old):
                return None
        else:
            sides = tuple(self._sides[old.done :])
            sides += old.sides[len(sides) :]
            outs = tuple(map(tuple, self._outs))
            found = replace(old, boundary=self._boundary, keep_outs=outs)
        off = old.recorded and any(map(_elsewhere, sides[: index + 1], old.sides))
        if len(sides) <= index or off:
            return None
        return replace(found, sides=sides)


def _elsewhere(side: Side, cut: Side) -> bool:
    """Whether a side of a recorded boundary ends far from where the one in its place that was cut
    has ended: the way to the next begins there."""
    ends = (one.pose(one.length_m - one.edge_end_m)[:2] for one in (side, cut))
    return math.dist(*ends) > ELSEWHERE_M


def _share(sides: Sequence[Side], plan: Plan) -> float:
    """Of the field that is cut by these sides."""
    return sum(s.length_m * s.width_m for s in sides) / plan.area_m2


def around(
    plan: Plan, boundary: list[tuple[float, float]], cut: Sequence[int], vehicle: Vehicle
) -> Plan | None:
    """The whole of a plan anew, in one go."""
    anew = Anew(plan, boundary, cut, vehicle)
    while not anew.over:
        anew.lay(ENOUGH_STRIPS)
    return anew.plan(plan, len(cut) - plan.done - 1)


def moved_with(
    corners: Sequence[tuple[float, float]],
    found: Sequence[tuple[float, float]],
    ring: Sequence[tuple[float, float]],
) -> list[tuple[float, float]]:
    """A ring moved and turned as corners were (Kabsch, Acta Crystallographica A32, 1976)."""
    a, b = np.array(corners), np.array(found)
    u, _, v = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v
    moved = (np.array(ring) - a.mean(0)) @ turn + b.mean(0)
    return [(float(x), float(y)) for x, y in moved]


def displaced(
    corners: Sequence[tuple[float, float]], found: Sequence[tuple[float, float]]
) -> tuple[int, float]:
    """(k, m): the corner that lies farthest, against the others, from where it was believed: the
    ring as a whole may have been moved and turned."""
    off = np.hypot(*(np.array(found) - moved_with(corners, found, corners)).T)
    worst = int(np.argmax(off))
    return worst, float(off[worst])
