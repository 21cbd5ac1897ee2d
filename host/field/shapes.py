"""Polygons of a file, with their names, and which of them is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.frames import LocalFrame

MIN_AREA_M2 = 1.0
"""Less is no field: a slip of the hand, or degrees that were taken for metres."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A polygon in (longitude, latitude), degrees of WGS 84, as a file has it."""

    polygon: shapely.Polygon
    name: str = ""
    sigma_m: float | None = None
    """Standard deviation per axis of a corner against the others, where the file says it."""
    recorded: bool | None = None
    """Whether it was recorded point by point, where the file says it."""
    fault: str = ""
    """Why nobody can use it; its polygon is empty then."""


def chosen(shapes: Sequence[Shape], wanted: str = "") -> Shape:
    """One field: `wanted` by its name or number (from 1), or the only one that does not lie inside
    another; its holes are its own and the polygons inside it. A field that is there twice, as of
    two seasons, is one. UserError where it is none, or one of several and none is named."""
    outlines = [shapely.make_valid(shapely.Polygon(shape.polygon.exterior)) for shape in shapes]
    outer = [
        k
        for k, outline in enumerate(outlines)
        if not any(_holds(other, outline, j < k) for j, other in enumerate(outlines) if j != k)
    ]
    large = [k for k in outer if shapes[k].fault or area_m2(outlines[k]) >= MIN_AREA_M2]
    outer = large or outer
    if not outer:
        raise UserError("it holds no polygon; draw the field's outline as a polygon")
    names = [shapes[k].name or f"field {number}" for number, k in enumerate(outer, start=1)]
    index = _index(names, wanted)
    own = outlines[outer[index]]
    if shapes[outer[index]].fault:
        raise UserError(shapes[outer[index]].fault)
    _check(
        [shape for shape, outline in zip(shapes, outlines, strict=True) if outline.intersects(own)]
    )
    holes = list(shapes[outer[index]].polygon.interiors)
    holes += [
        outlines[k].exterior
        for k in range(len(shapes))
        if k not in outer and own.contains(outlines[k]) and not own.equals(outlines[k])
    ]
    return replace(shapes[outer[index]], polygon=shapely.Polygon(own.exterior, holes))


def _check(shapes: Sequence[Shape]) -> None:
    """UserError where one of them is no polygon."""
    for shape in shapes:
        what = f"of {shape.name!r} " if shape.name else ""
        if not shapely.Polygon(shape.polygon.exterior).is_valid:
            raise UserError(f"its sides {what}cross; walk it again or correct its corners")
        if not shape.polygon.is_valid:
            raise UserError(
                f"its keep-outs {what}cross each other or the field's edge; correct them"
            )


def area_m2(shape: shapely.Geometry) -> float:
    """Of polygons in (longitude, latitude)."""
    if shape.is_empty:
        return 0.0
    lon, lat = shapely.get_coordinates(shape)[0]
    frame = LocalFrame(lat, lon)

    def local(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([frame.to_local(y, x) for x, y in places])

    return float(shapely.transform(shape, local).area)


def _holds(other: shapely.Polygon, outline: shapely.Polygon, earlier: bool) -> bool:
    """Of two equal ones the earlier holds the later."""
    return bool(other.contains(outline)) and (earlier or not outline.contains(other))


def _index(names: list[str], wanted: str) -> int:
    there = ", ".join(f"{number} {name!r}" for number, name in enumerate(names, start=1))
    if not wanted:
        if len(names) > 1:
            raise UserError(
                f"it holds {len(names)} fields side by side: {there}; say which with "
                "--field NAME or NUMBER"
            )
        return 0
    exact = [k for k, name in enumerate(names) if name.casefold() == wanted.casefold()]
    if len(exact) == 1:
        return exact[0]
    if wanted.isdecimal() and 1 <= int(wanted) <= len(names):
        return int(wanted) - 1
    raise UserError(f"--field {wanted}: it holds {there}")
