"""The harvest of a field before anything moves: length, time, turns, what stays
standing, the room that the turns need, and a picture of it.

Kinematics without error: the blade is on along the sides and off in the turns, as the pilot has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import shapely
import shapely.ops
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as MplPath
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.frames import Pose2
from host.core.output_place import check_file
from host.core.vehicle import Vehicle
from host.core.whole_file import saved
from host.field.areas import Areas, Geofence, areas_of, outline_of, placed
from host.route.plan import Plan
from host.route.put_down import moved_up_m
from host.route.side import Side, lane_pose
from host.route.turn_choice import ROOM_M, next_turn, room_along, turn_origin
from host.route.turn_legs import Turn, driven

mpl.use("Agg")

STEER_DPS = 40.0
"""Slew of a usual steering actuator; each leg of a turn waits for it at standstill."""
LOOK_S = 0.6
"""Standing still after a turn until the crop is seen."""
SPECK_M2 = 0.01
"""Smaller pieces are rounding."""

Pose = tuple[float, float, float]
"""x, y in metres of the field frame, heading in radians; the rear axle's middle."""


@dataclass(frozen=True)
class Preview:
    """What a plan comes to."""

    plan: Plan
    areas: Areas
    sides: list[NDArray[np.float64]]
    """(n, 2) ways of the rear axle along each side, m."""
    turns: list[NDArray[np.float64]]
    """(n, 3) poses through each turn."""
    shuttles: int
    """How many of the turns back up to take the same edge again."""
    cutting_m: float
    turning_m: float
    time_s: float
    cut: shapely.Geometry
    leftover: shapely.Geometry
    """Crop to be cut that no side reaches."""
    room_m: float
    """How far beyond the field's edge the turns swing some part of the machine."""
    warnings: list[str]

    @property
    def coverage(self) -> float:
        """Share of all that the field bears that is cut; the inset's price is in it."""
        return float(self.cut.intersection(self.areas.field).area / self.areas.field.area)


# ---- kinematics ----------------------------------------------------------------------------------


def drive_turn(turn: Turn, vehicle: Vehicle) -> tuple[NDArray[np.float64], float, float]:
    """(poses (n, 3) in the turn's frame, way in m, time in s) of a turn driven without error."""
    poses = [Pose2(0.0, 0.0, 0.0)]
    way = seconds = steered = 0.0
    for leg, length, along in driven(vehicle, turn):
        poses += along
        way += length
        seconds += abs(math.degrees(leg.steer_rad - steered)) / STEER_DPS
        seconds += length / vehicle.manoeuvre_speed_mps
        steered = leg.steer_rad
    seconds += math.degrees(abs(steered)) / STEER_DPS
    return np.array(poses), way, seconds


def _placed_poses(poses: NDArray[np.float64], at: Pose) -> NDArray[np.float64]:
    return np.column_stack([placed(poses[:, :2], *at), poses[:, 2] + at[2]])


def _along(side: Side, begin_m: float, left_m: float) -> list[tuple[float, float]]:
    """The line left_m left of a side's edge from begin_m on."""
    edge = shapely.LineString(side.edge_line())
    if left_m != 0.0:
        edge = edge.offset_curve(left_m, join_style="mitre")
    points = list(shapely.ops.substring(edge, begin_m, edge.length).coords)
    if not points:
        # Bends that follow each other within less than left_m leave no line there.
        points = [side.pose(begin_m, left_m)[:2]]
    return points if len(points) > 1 else [*points, points[0]]


def _swath(side: Side, begin_m: float, vehicle: Vehicle) -> shapely.Polygon:
    """What the blade cuts on a side from begin_m on."""
    right, left = -vehicle.overlap_m - side.shift_m, vehicle.pass_m - side.shift_m
    middle = shapely.LineString(_along(side, begin_m, (left + right) / 2))
    return middle.buffer((left - right) / 2, cap_style="flat", join_style="mitre")


def _guarded(plan: Plan, areas: Areas) -> Areas:
    """The areas, with the permitted one as the pilot's geofence has it: around the plan's corners,
    which may be fewer than were recorded."""
    if areas.permitted is None or plan.gap_m is None or not plan.boundary:
        return areas
    field = shapely.Polygon(plan.boundary, plan.keep_outs)
    return replace(areas, permitted=areas_of(field, plan.gap_m).permitted)


def preview(plan: Plan, areas: Areas, vehicle: Vehicle) -> Preview:
    """Drives the plan on paper."""
    areas = _guarded(plan, areas)
    outline = outline_of(vehicle)
    fence = Geofence(areas) if areas.permitted is not None else None
    sides: list[NDArray[np.float64]] = []
    turns: list[NDArray[np.float64]] = []
    swaths: list[shapely.Polygon] = []
    cutting = turning = seconds = late = 0.0
    shuttles = 0
    for number, side in enumerate(plan.sides):
        begin = min(late, side.length_m)
        swaths.append(_swath(side, begin, vehicle))
        alongs = [begin, *(b for b, _ in side.bends if begin < b < side.length_m), side.length_m]
        ends = [lane_pose(side, along, vehicle) for along in alongs]
        sides.append(np.array(ends)[:, :2])
        cutting += side.length_m - begin
        seconds += (side.length_m - begin) / vehicle.cutting_speed_mps
        if number + 1 == len(plan.sides):
            break

        origin = turn_origin(side, plan.sides[number + 1], vehicle)

        def room_m(turn: Turn, at: Pose = origin) -> float:
            return ROOM_M if fence is None else room_along(turn, at, vehicle, fence)

        turn = next_turn(plan, number, vehicle, room_m)
        shuttles += plan.corner_rad(number) == 0.0
        poses, way, spent = drive_turn(turn, vehicle)
        turning += way
        seconds += spent + LOOK_S
        # Beyond 0 the blade comes down late: the corner behind stays. Below 0 it runs in.
        blade = turn.along(*poses[-1][:2]) + vehicle.blade_x_m
        late = max(0.0, blade - turn.crop_begins_m)
        seconds += max(0.0, turn.crop_begins_m - blade) / vehicle.cutting_speed_mps
        following = plan.sides[number + 1]
        if side.bends and following.takes_again(side):
            # Back to the first bend it goes on the way that it came.
            straight_m = side.bends[0][0] + vehicle.blade_x_m - side.length_m
            poses = poses[poses[:, 0] <= straight_m]
        turns.append(_placed_poses(poses, origin))
    cut = shapely.union_all(swaths)
    pieces = shapely.get_parts(areas.crop.difference(cut))
    outlines = [np.array([placed(outline, *pose) for pose in turn.tolist()]) for turn in turns]
    edge = shapely.Polygon(areas.field.exterior)
    return Preview(
        plan,
        areas,
        sides,
        turns,
        shuttles,
        cutting,
        turning,
        seconds,
        cut,
        shapely.union_all([piece for piece in pieces if piece.area > SPECK_M2]),
        max((_beyond(edge, swept) for swept in outlines), default=0.0),
        _warnings(plan, areas, vehicle, swaths, outlines),
    )


def _beyond(area: shapely.Polygon, outlines: NDArray[np.float64]) -> float:
    """How far (..., 2) corners lie outside an area at most, m."""
    shapely.prepare(area)
    return float(shapely.distance(area, shapely.points(outlines.reshape(-1, 2))).max())


def _warnings(
    plan: Plan,
    areas: Areas,
    vehicle: Vehicle,
    swaths: list[shapely.Polygon],
    outlines: list[NDArray[np.float64]],
) -> list[str]:
    """What the machine would touch or leave; `outlines` (n, 8, 2) through each turn."""
    warnings: list[str] = []
    permitted = areas.permitted
    if permitted is not None:
        outside = {
            number: beyond
            for number, swept in enumerate(outlines, start=1)
            if (beyond := _beyond(permitted, swept)) > 0
        }
        if outside:
            warnings.append(
                f"{len(outside)} turns leave the permitted area, first at the end of side "
                f"{min(outside)}, by up to {max(outside.values()):.2f} m: the gap is too narrow"
            )
        if plan.sides:
            start = placed(outline_of(vehicle), *lane_pose(plan.sides[0], 0.0, vehicle))
            beyond = _beyond(permitted, start)
            if beyond > 0:
                up_m = moved_up_m(plan, plan.sides[0], vehicle)
                warnings.append(
                    f"at the start the machine stands {beyond:.2f} m outside the permitted area; "
                    f"put its blade {up_m:.1f} m into the crop, or choose another corner"
                )
    return warnings + _at_keep_outs(areas.keep_outs, swaths, outlines)


def _at_keep_outs(
    keep_outs: tuple[shapely.Polygon, ...],
    swaths: list[shapely.Polygon],
    outlines: list[NDArray[np.float64]],
) -> list[str]:
    """What of `_warnings` is about keep-outs."""
    if not keep_outs:
        return []
    tree = shapely.STRtree(keep_outs)
    sides, cut = tree.query(np.array(swaths, object), predicate="intersects")
    hulls = [shapely.convex_hull(shapely.multipoints(swept)) for swept in outlines]
    turns = np.repeat(np.arange(len(hulls)), np.array([len(turn) for turn in hulls], int))
    every = np.array([hull for turn in hulls for hull in turn], object)
    poses, met = tree.query(every, predicate="intersects")
    warnings: list[str] = []
    for number in range(len(keep_outs)):
        hit, touched = sides[cut == number], np.unique(turns[poses[met == number]])
        if len(hit):
            warnings.append(f"side {hit.min() + 1} would cut into keep-out {number + 1}")
        if len(touched):
            warnings.append(
                f"{len(touched)} turns would touch keep-out {number + 1}, first at the end of side "
                f"{touched.min() + 1}: the geofence would stop the machine there"
            )
    return warnings


# ---- what the operator sees ----------------------------------------------------------------------


def check_picture(path: Path) -> None:
    """UserError where a picture can never be written to this path: better before the work."""
    known = Figure().canvas.get_supported_filetypes()
    if path.suffix.lower().removeprefix(".") not in known:
        raise UserError(
            f"cannot write the picture {path}: its suffix names no format; use .png, .svg or .pdf"
        )
    check_file(path)


def draw_preview(path: Path, shown: Preview, title: str) -> None:
    """The spiral over the three areas; red is what stays standing."""
    figure = Figure(figsize=(10, 10), layout="constrained")
    axes = figure.subplots()
    areas = shown.areas
    if areas.permitted is not None:
        xy = areas.permitted.exterior.xy
        axes.plot(*xy, "--", color="0.4", lw=1.2, label="permitted area")
    outer = np.array(areas.field.exterior.coords)
    axes.fill(*outer.T, color="#f2e3a0", label="field")
    axes.plot(*outer.T, color="#a08020", lw=1.5)
    for number, (x, y) in enumerate(outer[:-1]):
        axes.annotate(str(number), (x, y), (6, 6), textcoords="offset points", weight="bold")
    if areas.price > 0:
        crop = np.array(areas.crop.exterior.coords)
        axes.plot(*crop.T, color="tab:green", lw=1.2, label="crop to be cut")
    for number, keep_out in enumerate(areas.keep_outs):
        label = "keep-outs, with their margin" if number == 0 else ""
        axes.fill(*np.array(keep_out.exterior.coords).T, color="0.25", label=label)
    colours = mpl.colormaps["viridis"](np.linspace(0, 0.9, max(1, len(shown.sides))))
    for way, colour in zip(shown.sides, colours, strict=True):
        axes.plot(*way.T, color=colour, lw=1.3)
    for number, turn in enumerate(shown.turns):
        label = "turns, rear axle" if number == 0 else ""
        axes.plot(*turn[:, :2].T, color="tab:purple", lw=0.5, alpha=0.7, label=label)
    if not shown.leftover.is_empty:
        rings = [
            MplPath(np.array(ring.coords), closed=True)
            for piece in shapely.get_parts(shown.leftover)
            for ring in _rings(piece)
        ]
        path_of_all = MplPath.make_compound_path(*rings)
        axes.add_patch(PathPatch(path_of_all, color="tab:red", lw=0, label="stays standing"))
    if shown.sides:
        (x, y), (u, v) = shown.sides[0][:2]
        axes.annotate(
            "", (u, v), (x, y), arrowprops={"arrowstyle": "->", "color": "black", "lw": 1.5}
        )
        axes.plot(x, y, "ko", ms=7, label="start")
    axes.set_aspect("equal")
    axes.set(xlabel="east of corner 0 (m)", ylabel="north of corner 0 (m)", title=title)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=110)


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    """Turned as a filled path needs them: holes against the outer ring."""
    turned = shapely.geometry.polygon.orient(polygon)
    return [turned.exterior, *turned.interiors]


def hours(seconds: float) -> str:
    """H:MM h."""
    return f"{int(seconds) // 3600:d}:{int(seconds) % 3600 // 60:02d} h"
