"""A plane world for pilot tests: ideal tricycle, grid of crop, and a detector that reads the grid.

It is deliberately not the plant: no picture, no firmware, no noise but what a test asks for, so
that a fault in the pilot cannot hide behind them and a harvest takes a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from host.core.messages import Command, Fix, Frame, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.pilot.pilot import Pilot
from host.route.side import Side
from host.vision.view import CropView

CELL = 0.025
STEP = 0.02


@njit(cache=True)
def stands(crop, neighbour, margin, pose, forward, left):  # type: ignore[no-untyped-def]
    """Whether anything does that far before and left of a pose."""
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    i = int((x + forward * c - left * s + margin) / CELL)
    j = int((y + forward * s + left * c + margin) / CELL)
    rows, columns = crop.shape
    return 0 <= i < columns and 0 <= j < rows and (crop[j, i] or neighbour[j, i])


@njit(cache=True)
def first_blocked(crop, neighbour, margin, pose, ahead, left):  # type: ignore[no-untyped-def]
    """Of `ahead`, the first where anything stands on a fifth of `left` or more; -1: none."""
    for n in range(len(ahead)):
        there = 0
        for left_m in left:
            there += stands(crop, neighbour, margin, pose, ahead[n], left_m)
        if there >= 0.2 * len(left):
            return n
    return -1


@njit(cache=True)
def edge_along(crop, neighbour, margin, pose, ahead, left):  # type: ignore[no-untyped-def]
    """Of each `ahead`, the first of `left` where anything stands, up to where there is none, or the
    edge leaves the view or leaps."""
    edge = np.zeros(len(ahead))
    for n in range(len(ahead)):
        k = 0
        while k < len(left) and not stands(crop, neighbour, margin, pose, ahead[n], left[k]):
            k += 1
        if k in (0, len(left)) or (n > 0 and abs(left[k] - edge[n - 1]) >= 0.08):
            return edge[:n]
        edge[n] = left[k]
    return edge


@njit(cache=True)
def cut(crop, neighbour, margin, pose, blade_x, half):  # type: ignore[no-untyped-def]
    """Takes what stands under a blade that reaches `half` to either side."""
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    for left in np.arange(-half + CELL / 4, half, CELL / 2):
        i = int((x + blade_x * c - left * s + margin) / CELL)
        j = int((y + blade_x * s + left * c + margin) / CELL)
        crop[j, i] = False
        neighbour[j, i] = False


def within(
    x: NDArray[np.float64], y: NDArray[np.float64], box: tuple[float, float, float, float]
) -> NDArray[np.bool_]:
    """(len(y), len(x)): which cells' middles lie in a box of (x, y, x, y)."""
    across, up = (x > box[0]) & (x < box[2]), (y > box[1]) & (y < box[3])
    return np.logical_and.outer(up, across)


def contained(
    x: NDArray[np.float64], y: NDArray[np.float64], shape: shapely.Polygon
) -> NDArray[np.bool_]:
    """(len(y), len(x)): which cells' middles lie in a polygon; only those about it are asked."""
    found = np.zeros((len(y), len(x)), np.bool_)
    left, low, right, high = shape.bounds
    columns = slice(*np.searchsorted(x, (left, right)))
    rows = slice(*np.searchsorted(y, (low, high)))
    found[rows, columns] = shapely.contains_xy(shape, *np.meshgrid(x[columns], y[rows]))
    return found


@dataclass
class SimpleWorld:
    vehicle: Vehicle
    width: float = 10.0
    height: float = 10.0
    gap: float = 2.0
    speed_error: float = 1.0
    """True speed over what the duty model says."""
    polygon: list[tuple[float, float]] | None = None
    """The field instead of a rectangle, which must enclose it."""
    keep_out: tuple[float, float, float, float] | None = None
    hall: bool = True
    pot_error: float = 0.0
    """True steering angle minus the reported one, radians."""
    yaw_gain: float = 1.0
    """Of what the steering angle says, how much the vehicle turns."""
    distance: float = 0.0
    counted: float = 0.0
    """Of the wheel with the sensor, which the vehicle file says."""
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    speed: float = 0.0
    angle: float = 0.0
    now: float = 0.0
    state: State = State.SAFE
    command: Command = field(default_factory=lambda: Command(Request.STOP))
    blind: bool = False
    unusable: bool = False
    """The camera shows nothing of now."""

    def __post_init__(self) -> None:
        self.margin = 6.0
        columns = round((self.width + 2 * self.margin) / CELL)
        rows = round((self.height + 2 * self.margin) / CELL)
        x, y = (np.arange(cells) * CELL - self.margin + CELL / 2 for cells in (columns, rows))
        g = self.gap
        if self.polygon is None:
            inside = within(x, y, (0.0, 0.0, self.width, self.height))
            near = within(x, y, (-g, -g, self.width + g, self.height + g))
        else:
            shape = shapely.Polygon(self.polygon)
            inside = contained(x, y, shape)
            near = contained(x, y, shape.buffer(g, join_style="mitre"))
        if self.keep_out is not None:
            inside &= ~within(x, y, self.keep_out)
        self.crop = inside.copy()
        self.neighbour = ~near
        self.field_cells = int(inside.sum())
        self.neighbour_cells = int(self.neighbour.sum())
        v = self.vehicle
        half = v.blade_width_m / 2
        self.ahead = np.arange(v.blade_x_m, v.blade_x_m + 5.0, 0.05)
        self.across = np.arange(-half + 0.01, half, 0.05)
        self.left = np.arange(-half - 0.7, half, 0.01)
        self.x = self.width - v.blade_width_m / 2 + v.overlap_m
        self.y = -v.blade_x_m - 0.3
        self.yaw = math.pi / 2

    def stand_at(self, side: Side) -> None:
        """Puts the vehicle where the operator would for a side: the blade before the crop, its
        right end on the outer edge."""
        v = self.vehicle
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        inside = v.blade_width_m / 2 - v.overlap_m
        back = v.blade_x_m + 0.05
        self.x = side.x_m - back * c - inside * s
        self.y = side.y_m - back * s + inside * c
        self.yaw = side.heading_rad

    # ---- vision ----
    def see(self, bgr: np.ndarray, *, stages: bool = False) -> CropView:
        del bgr, stages
        if self.unusable:
            return CropView(0.0, usable=False, reason="the camera repeats its picture")
        if self.blind:
            return CropView(0.0, reason="dust")
        v = self.vehicle
        place = self.crop, self.neighbour, self.margin, self.pose()
        first = first_blocked(*place, self.ahead, self.across)
        crop_ahead = float(self.ahead[first] - v.blade_x_m) if first >= 0 else math.inf
        nothing = CropView(0.0, crop_ahead_m=crop_ahead, ahead_confidence=1.0, reason="no edge")
        if crop_ahead > 2.5:
            return nothing
        start = v.blade_x_m + crop_ahead + 0.1
        f = np.arange(start, start + 1.5, 0.1)
        edge = edge_along(*place, f, self.left)
        n = len(edge)
        if n < 5:
            return nothing
        along = f[:n] - f[:n].mean()
        slope = float(along @ edge / (along @ along))
        at = float(edge.mean() - slope * (f[:n].mean() - start))
        wanted = -(v.blade_width_m / 2 - v.overlap_m)
        return CropView(
            0.9,
            edge_offset_m=at - wanted,
            edge_ahead_m=start - v.blade_x_m,
            edge_heading_rad=math.atan(slope),
            crop_ahead_m=crop_ahead,
            ahead_confidence=1.0,
        )

    def glance(self, bgr: np.ndarray) -> CropView:
        return replace(self.see(bgr), confidence=0.0, ahead_confidence=0.0)

    def next_crop(self, gap_m: float) -> None:
        pass

    def restart(self, *, turned: bool = True) -> None:
        pass

    # ---- motion ----
    def advance(self) -> None:
        v, c = self.vehicle, self.command
        driving = c.request is Request.DRIVE and self.state in (State.ARMED, State.RUNNING)
        wanted = c.speed_mps if driving else 0.0
        if self.hall:
            wanted /= self.wheel_share
        limit = math.radians(v.steer_limit_deg)
        if driving:
            error = max(-limit, min(limit, c.steer_rad)) - self.angle
            self.angle += (
                max(-1, min(1, error / (math.radians(45) * STEP))) * math.radians(45) * STEP
            )
        self.speed += (wanted * self.speed_error - self.speed) * STEP / v.drive_lag_s
        before = self.pose()
        self.yaw += self.speed * self.curvature * STEP
        self.distance += self.speed * STEP
        self.counted += self.speed * self.wheel_share * STEP
        self.x += self.speed * math.cos(self.yaw) * STEP
        self.y += self.speed * math.sin(self.yaw) * STEP
        if driving and c.blade and self.speed >= 0:
            self._cut(before)
        self.now += STEP

    @property
    def curvature(self) -> float:
        return self.yaw_gain * math.tan(self.angle + self.pot_error) / self.vehicle.wheelbase_m

    @property
    def wheel_share(self) -> float:
        """What the wheel with the sensor goes of the middle's way."""
        return 1.0 - self.vehicle.hall_left_m * self.curvature

    def pose(self) -> tuple[float, float, float]:
        return float(self.x), float(self.y), float(self.yaw)

    def _cut(self, before: tuple[float, float, float]) -> None:
        v = self.vehicle
        half = v.blade_width_m / 2
        for pose in (before, self.pose()):
            cut(self.crop, self.neighbour, self.margin, pose, v.blade_x_m, half)

    def telemetry(self) -> Telemetry:
        request = self.command.request
        if request is Request.ARM and self.state is State.SAFE:
            self.state = State.ARMED
        elif request is Request.STOP:
            self.state = State.SAFE
        vehicle = self.vehicle
        share = abs(self.speed) / self.speed_error / vehicle.full_duty_speed_mps
        duty = 255 * (share * (1 - vehicle.dead_duty) + vehicle.dead_duty) * (share > 1e-3)
        return Telemetry(
            stamp=self.now,
            state=self.state,
            faults=0,
            setpoint_rad=self.command.steer_rad,
            angle_rad=self.angle,
            steer_duty=0,
            drive_duty=round(math.copysign(duty, self.speed)),
            blade=self.command.blade,
            speed_mps=self.speed * self.wheel_share if self.hall else None,
            distance_m=self.counted if self.hall else 0.0,
            battery_v=12.0,
            last_seq=0,
            frames_bad=0,
        )

    @property
    def coverage(self) -> float:
        return 1 - self.crop.sum() / self.field_cells

    @property
    def neighbour_cut(self) -> int:
        return self.neighbour_cells - int(self.neighbour.sum())


BLANK = np.zeros((2, 2, 3), np.uint8)


def drive(
    world: SimpleWorld,
    pilot: Pilot,
    seconds: float,
    log: list[Command] | None = None,
    *,
    until: Callable[[], bool] | None = None,
    fixes: bool = True,
) -> None:
    """Runs for a time, or `until` that holds: telemetry each 20 ms, commands each 40 ms (to `log`),
    pictures at 10 Hz, and with `fixes` one with the true Doppler speed each second."""
    end, tick = world.now + seconds, 0
    while world.now < end - 1e-9 and not (until is not None and until()):
        world.advance()
        tick += 1
        if tick % 2 == 0:
            frame = Frame(world.now, BLANK) if tick % 10 in (0, 6) else None
            fix = None
            if fixes and tick % 50 == 0:
                fix = Fix(world.now, 0.0, 0.0, 1, 1.0, 8, abs(world.speed))
            world.command = pilot.step(world.now, frame, fix, world.telemetry())
            if log is not None:
                log.append(world.command)


def harvest(world: SimpleWorld, pilot: Pilot, limit_s: float = 1500.0) -> None:
    """Until the pilot is done."""
    drive(world, pilot, limit_s - world.now, until=lambda: pilot.done)
