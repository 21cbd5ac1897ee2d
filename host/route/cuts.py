"""What each way to cut a field takes off it, strip by strip, and what that leaves."""

from __future__ import annotations

import numpy as np
import shapely

from host.route.side import Side
from host.route.standing import Edge, edges_of, parts_of, strip_along

SEEN_SHARE = 0.22
"""Vision sees crop where it fills this share of the blade's width."""
BESIDE = 1.5
"""Widths of a strip within which what stands begins beside the end of the strip before."""
MAX_SHIFT_M = 0.35
"""Beyond it the edge would pass under the machine's body."""


class Cuts:
    """What stands in the ways that are tried, with its edges and what each leaves: ways begin
    alike, with what was cut before or as long as they prefer the same edge."""

    def __init__(self, field: shapely.Polygon, width_m: float) -> None:
        self._field, self._width = field, width_m
        self._edges: dict[tuple[shapely.Polygon, tuple[float, float] | None], list[Edge]] = {}
        self._cuts: dict[tuple[Edge, bool], tuple[Side, list[shapely.Polygon]] | None] = {}

    def edges(
        self, standing: shapely.Polygon, here: tuple[float, float] | None = None
    ) -> list[Edge]:
        """`edges_of`, with the machine `here` beside them; the same ones each time."""
        if (standing, here) not in self._edges:
            self._edges[standing, here] = edges_of(standing, here, BESIDE * self._width)
        return self._edges[standing, here]

    def cut(
        self, standing: shapely.Polygon, edge: Edge, *, inside: bool = False
    ) -> tuple[Side, list[shapely.Polygon]] | None:
        """The side along one of these edges, and what stands after it; None for a sliver. `inside`
        as for `strip_along`."""
        if (edge, inside) not in self._cuts:
            self._cuts[edge, inside] = _side(
                standing, self._field, edge, self._width, inside=inside
            )
        return self._cuts[edge, inside]


def _side(
    standing: shapely.Polygon, field: shapely.Polygon, edge: Edge, width_m: float, *, inside: bool
) -> tuple[Side, list[shapely.Polygon]] | None:
    """The side along an edge, and what stands after it; None for a sliver."""
    strip = strip_along(standing, field, edge, width_m, inside=inside)
    if strip is None:
        return None
    begin_seen, end_seen = np.quantile((strip.begins_m, strip.ends_m), SEEN_SHARE, axis=1).tolist()
    side = Side(
        *strip.begin,
        edge.heading,
        strip.length_m,
        strip.width_m,
        strip.fence_m,
        strip.back_m,
        min(strip.narrow_m, MAX_SHIFT_M),
        strip.blind_end,
        begin_seen,
        end_seen,
        strip.begins_m[0],
        strip.ends_m[0],
        strip.bends,
    )
    return side, parts_of(standing.difference(strip.area.buffer(1e-4, join_style="mitre")))
