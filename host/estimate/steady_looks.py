"""The edge from looks of which none was sure: a right end that is never clear, of thin or weedy
crop, and still stands in one line from look to look.

One look proves nothing: a machine that stands sees the same patch of weeds in all its pictures. Two
that are a good way apart and have the edge in one line have seen an edge.
"""

from __future__ import annotations

from typing import Final

import numpy as np

PICTURES: Final = 8
"""Of a look, at least, without the blade's dust."""
SPREAD_M: Final = 0.06
"""Within which four fifths of them have the edge."""
APART_M: Final = (0.5, 3.0)
"""Between two looks that are compared: a patch is shorter, and farther on it may be another."""
ASKEW: Final = 0.12
"""By which the edge may lead away from the line that is followed, per metre: 7 degrees, three
standard deviations of a direction after a turn;"""
OFF_M: Final = 0.04
"""and beside that."""
CONFIDENCE: Final = 0.6
"""Of what two looks together tell."""


class SteadyLooks:
    """Edges against a line that stands still in the field, look after look."""

    def __init__(self) -> None:
        self._edges: list[float] = []
        self._last: tuple[float, float] | None = None
        """Where the last look was taken along the line, and where that had the edge."""

    def begin(self) -> None:
        """Along another line."""
        self._edges.clear()
        self._last = None

    def note(self, edge_m: float) -> None:
        """A picture without dust has the edge so far left of the line, sure or not."""
        self._edges.append(edge_m)

    def over(self, at_m: float) -> float | None:
        """The look is over, taken at_m along the line. The edge, m left of the line, where it and
        the one before agree."""
        edges, last = self._edges, self._last
        self._edges, self._last = [], None
        if len(edges) < PICTURES:
            return None
        low, edge, high = np.quantile(edges, [0.1, 0.5, 0.9]).tolist()
        if high - low > SPREAD_M:
            return None
        self._last = at_m, edge
        if last is None or not APART_M[0] <= at_m - last[0] <= APART_M[1]:
            return None
        if abs(edge - last[1]) > ASKEW * (at_m - last[0]) + OFF_M:
            return None
        self._last = at_m, 0.0  # the line moves there
        return float(edge)
