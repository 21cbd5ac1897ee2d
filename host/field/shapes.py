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
REACHES_IN = 0.1
"""Share of a small polygon that lies in a field: with less it stands beside it, drawn inexactly."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Something in a field that its file has, and not as a keep-out."""

    name: str
    """And its kind of geometry."""
    longitude: float
    latitude: float
    """A place of it in the field, degrees of WGS 84."""


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
    mark: shapely.Geometry | None = None
    """A point, a line or the like that the file has, and no field; its polygon is empty then."""
    left_out: tuple[Mark, ...] = ()
    """What lies in the field besides its keep-outs."""


def shape_of(geometry: shapely.Geometry, name: str = "") -> Shape:
    """A polygon as it is, anything else as a mark."""
    if isinstance(geometry, shapely.Polygon):
        return Shape(geometry, name)
    return Shape(shapely.Polygon(), name, mark=geometry)


def parts_of(geometry: shapely.Geometry | None) -> list[shapely.Geometry]:
    """The polygons, lines and points that a geometry is made of, not empty."""
    if geometry is None or geometry.is_empty:
        return []
    if not hasattr(geometry, "geoms"):
        return [geometry]
    return [part for each in geometry.geoms for part in parts_of(each)]


def chosen(found: Sequence[Shape], wanted: str = "") -> Shape:
    """One field: `wanted` by its name or number (from 1), or the only one that does not lie inside
    another; its holes are its own and the polygons inside it. A field that is there twice, as of
    two seasons, is one. What else lies in it is no keep-out, and said in `left_out`. UserError
    where it is none, or one of several and none is named."""
    marks = [shape for shape in found if shape.mark is not None]
    shapes = [shape for shape in found if shape.mark is None]
    outlines = [shapely.make_valid(shapely.Polygon(shape.polygon.exterior)) for shape in shapes]
    outer = [
        k
        for k, outline in enumerate(outlines)
        if not any(_holds(other, outline, j < k) for j, other in enumerate(outlines) if j != k)
    ]
    large = [k for k in outer if shapes[k].fault or area_m2(outlines[k]) >= MIN_AREA_M2]
    outer = large or outer
    if not outer:
        kinds = sorted({mark.mark.geom_type for mark in marks if mark.mark is not None})
        what = f"its type is {', '.join(kinds)}, not Polygon" if kinds else "it holds no polygon"
        raise UserError(f"{what}; draw the field's outline as a polygon")
    names = [shapes[k].name or f"field {number}" for number, k in enumerate(outer, start=1)]
    index = _index(names, wanted)
    own = outlines[outer[index]]
    if shapes[outer[index]].fault:
        raise UserError(shapes[outer[index]].fault)
    _check(
        [shape for shape, outline in zip(shapes, outlines, strict=True) if outline.intersects(own)]
    )
    others = [k for k in range(len(shapes)) if not own.equals(outlines[k])]
    inside = [k for k in others if k not in outer and own.contains(outlines[k])]
    holes = [*shapes[outer[index]].polygon.interiors, *(outlines[k].exterior for k in inside)]
    left_out = [shapes[k] for k in others if k not in inside and _reaches_in(outlines[k], own)]
    left_out += [mark for mark in marks if shapely.relate_pattern(own, mark.mark, "T********")]
    return replace(
        shapes[outer[index]],
        polygon=shapely.Polygon(own.exterior, holes),
        left_out=(*shapes[outer[index]].left_out, *(_mark(shape, own) for shape in left_out)),
    )


def _reaches_in(other: shapely.Geometry, own: shapely.Polygon) -> bool:
    """Whether so much of a polygon lies in a field that what it stands for may stand there."""
    if not own.intersects(other):
        return False
    inside_m2 = area_m2(own.intersection(other))
    return inside_m2 > min(MIN_AREA_M2, REACHES_IN * area_m2(other))


def _mark(shape: Shape, own: shapely.Polygon) -> Mark:
    """Of a shape that reaches into a field."""
    geometry = shape.mark or shape.polygon
    place = shapely.intersection(own, geometry).representative_point()
    return Mark(f"{shape.name!r} ({geometry.geom_type})", place.x, place.y)


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
