"""What truly stood around the machine at its last decisions, and where it believed its edge: the
first thing to look at where a run has stopped."""

from __future__ import annotations

import math
import textwrap
from collections import deque
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.judge.pictures import GROUND
from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.core.whole_file import saved
from host.field.areas import outline_of, placed
from host.pilot.pilot import Pilot
from sim_plant.field import Field

KEPT: Final = 8
"""Decisions that are drawn, the last ones."""
COLUMNS: Final = 4
AROUND_M: Final = 4.0
"""Of the field, on each side of the rear axle."""
EDGE_M: Final = 4.0
"""Of the believed edge, to either side of the blade's line."""
TRACK_S: Final = 60.0
"""Of the way there."""
LETTERS: Final = 48
"""Of a line of a title."""

Track = list[tuple[float, float, float]]
"""Of the rear axle: (time, x, y), s and m, field frame."""


class _Decision(NamedTuple):
    stamp: float
    pose: Pose2
    origin: tuple[float, float]
    """Of the piece of the grid, m, field frame."""
    kind: NDArray[np.uint8]
    right_m: float
    """The believed edge, right of the blade's middle,"""
    turned_rad: float
    """and its direction, left of the vehicle's."""
    sigma_m: float
    reason: str


class Decisions:
    """Of one run."""

    def __init__(self, field: Field, vehicle: Vehicle) -> None:
        """`vehicle`: as the pilot has it."""
        self._field = field
        self._vehicle = vehicle
        self._last: deque[_Decision] = deque(maxlen=KEPT)
        self._latest: object = None

    def step(self, now: float, pose: tuple[float, float, float], pilot: Pilot) -> None:
        """Notes what the pilot has just decided, if anything; `pose`: the rear axle's true one."""
        if not pilot.transitions or pilot.transitions[-1] is self._latest:
            return
        self._latest = latest = pilot.transitions[-1]
        lane = pilot.lane
        right_m = self._vehicle.inset_m + lane.blade_offset_m
        turned_rad, sigma_m = -lane.heading_rad, lane.offset_sigma_m
        around = self._around(pose)
        self._last.append(
            _Decision(now, Pose2(*pose), *around, right_m, turned_rad, sigma_m, latest.reason)
        )

    def _around(
        self, pose: tuple[float, float, float]
    ) -> tuple[tuple[float, float], NDArray[np.uint8]]:
        """Of the grid around the machine: its origin, and the kinds of its cells."""
        field = self._field
        at = np.array(pose[:2]) - field.origin
        low = np.maximum(np.floor((at - AROUND_M) / field.cell).astype(int), 0)
        high = np.maximum(np.floor((at + AROUND_M) / field.cell).astype(int), 0)
        x, y = np.array(field.origin) + low * field.cell
        return (float(x), float(y)), field.kind[low[1] : high[1], low[0] : high[0]].copy()

    def draw(self, path: Path, track: Track) -> bool:
        """decisions.png: a map for each. False where there were none, and no file is written."""
        if not self._last:
            return False
        rows = -(-len(self._last) // COLUMNS)
        figure = Figure(figsize=(3.3 * COLUMNS, 3.7 * rows), layout="constrained")
        grid = figure.subplots(rows, COLUMNS, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
        for axes, decision in zip(grid.flat, self._last, strict=False):
            axes.set_axis_on()
            self._draw(axes, decision, track)
        with saved(path) as fresh:
            figure.savefig(fresh, dpi=110)
        return True

    def _draw(self, axes: Axes, decision: _Decision, track: Track) -> None:
        (x0, y0), kind, pose = decision.origin, decision.kind, decision.pose
        cell, vehicle = self._field.cell, self._vehicle
        extent = (x0, x0 + kind.shape[1] * cell, y0, y0 + kind.shape[0] * cell)
        axes.imshow(GROUND[kind], origin="lower", extent=extent, interpolation="nearest")
        begin_s = decision.stamp - TRACK_S
        way = [(x, y) for t, x, y in track if begin_s < t <= decision.stamp]
        axes.plot(*zip(*way, strict=True), color="tab:purple", linewidth=0.8)
        outline = placed(outline_of(vehicle), *pose)
        axes.fill(*outline.T, facecolor="none", edgecolor="black", linewidth=0.8)
        half = vehicle.blade_width_m / 2
        blade = [pose.ahead(vehicle.blade_x_m, side) for side in (-half, half)]
        axes.plot([p.x_m for p in blade], [p.y_m for p in blade], color="black", linewidth=2.5)
        at = pose.ahead(vehicle.blade_x_m, -decision.right_m)
        at = at._replace(heading_rad=pose.heading_rad + decision.turned_rad)
        edge = [at.ahead(along) for along in (-EDGE_M, EDGE_M)]
        axes.plot(
            [p.x_m for p in edge], [p.y_m for p in edge], "--", color="tab:blue", linewidth=1.2
        )
        axes.set(
            xlim=(pose.x_m - AROUND_M, pose.x_m + AROUND_M),
            ylim=(pose.y_m - AROUND_M, pose.y_m + AROUND_M),
        )
        axes.tick_params(labelsize=6)
        seconds = math.floor(decision.stamp)
        reason = textwrap.fill(decision.reason, LETTERS, max_lines=2, placeholder=" ...")
        title = f"{seconds} s, edge believed to {decision.sigma_m:.2f} m\n{reason}"
        axes.set_title(title, fontsize=7)
