"""What is looked at before anything moves: firmware against vehicle file, room on the disk, place
and direction."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import numpy as np

from host.core.errors import UserError
from host.core.frames import LatLon, LocalFrame
from host.core.messages import Fix
from host.core.vehicle import Mount, Vehicle
from host.link import params, protocol
from host.link.session import Link
from host.route.plan import Plan
from host.runs.errand import Errand, compass_deg
from host.sensors.jpeg import Bgr
from host.vision.view import CropView

RECORD_BPS: Final = 2.4e9 / 3600
"""Bytes that a second of record takes, measured with pictures of 640x480 at 15 a second."""
FREE_BYTES: Final = 500e6
"""Less is no room for a run at all."""
USUAL_S: Final = 3600.0
"""Taken for the length of a run without a plan."""
TURN_S: Final = 30.0
"""Of a usual turn, its waits included."""

PLACE_M: Final = 8.0
"""A phone's position is rarely further off (2.5 m CEP, and the boundary was walked with one)."""
CORNERS_M: Final = 4.0
"""By so much nearer to another corner than to the chosen one, it stands at the other."""
HEADING_DEG: Final = 15.0
"""A compass on a machine of steel errs by ten degrees; the pilot straightens the rest."""
EDGE_DOUBT_DEG: Final = 30.0
"""The most that an unsure boundary allows besides: the check is there to find a machine that heads
for another edge."""
OFFSET_M: Final = 0.5
SURE: Final = 0.5
"""The edge must be seen so surely (0..1), and then lie no farther off the blade's right end."""

SKY_WARMTH: Final = 15
"""Red less blue, of 255: sky has less in any weather of the bench, crop and ground more."""
SKY_BRIGHT: Final = 120
"""Of 255, the brightest colour of sky."""
MOSTLY: Final = 0.5
ALL_BUT: Final = 0.95
"""Shares of the picture's upper border that make it sky, or ground."""
HORIZON_IN: Final = 0.15
HORIZON_OUT: Final = -0.05
"""Where the horizon lies, as a share of the picture's height from above, for a mount to see sky, or
surely none."""

Relation = Literal["equal", "at least"]


@dataclass(frozen=True, slots=True)
class Pair:
    """A thing that both firmware and vehicle file speak of."""

    parameter: str
    field: str
    relation: Relation
    """The firmware's value to the vehicle file's."""
    tolerance: float
    """Relative."""
    why: str

    def differs(self, held: float, wanted: float) -> bool:
        """Whether the two values do not go together."""
        if self.relation == "at least":
            return held < wanted * (1 - self.tolerance)
        return abs(held - wanted) > self.tolerance * max(abs(held), abs(wanted))


PAIRS: Final = (
    Pair("hall_per_metre", "hall_pulses_per_m", "equal", 0.01, "speed and distance are counted by"),
    Pair("steer_limit", "steer_limit_deg", "at least", 0.01, "turns are planned with"),
    Pair("speed_max", "cutting_speed_mps", "at least", 0.01, "the machine cuts at"),
    Pair("speed_max", "manoeuvre_speed_mps", "at least", 0.01, "the machine turns at"),
    Pair("battery_nominal", "nominal_battery_v", "equal", 0.02, "drive duties are scaled by"),
    Pair("speed_full", "full_duty_speed_mps", "equal", 0.15, "speeds are estimated by"),
)


def differing(vehicle: Vehicle, held: Mapping[str, float]) -> list[tuple[Pair, float, float]]:
    """Where the firmware's parameters `held` and the vehicle file say different things: (which, the
    firmware's value, the file's)."""
    found = []
    for pair in PAIRS:
        value, wanted = held[pair.parameter], float(getattr(vehicle, pair.field))
        if pair.parameter == "battery_nominal" and value == 0.0:
            continue  # the scaling is switched off
        if pair.differs(value, wanted):
            found.append((pair, value, wanted))
    return found


def agree(link: Link, vehicle: Vehicle) -> None:
    """UserError where firmware and vehicle file contradict each other, with what to do about it."""
    held = {name: params.read(link, protocol.PARAMS[name]) for name in {p.parameter for p in PAIRS}}
    found = [
        f"{pair.why} {pair.parameter} = {value:g} in the firmware, {pair.field} = {wanted:g} in "
        f"the vehicle file: correct the one that is wrong (`daranti params set {pair.parameter} "
        f"{wanted:g} --save`, or the file)"
        for pair, value, wanted in differing(vehicle, held)
    ]
    if found:
        raise UserError("firmware and vehicle file differ: " + "; ".join(found))


def length_s(plan: Plan, vehicle: Vehicle) -> float:
    """About how long a plan takes."""
    if not plan.sides:
        return USUAL_S
    along = sum(side.length_m for side in plan.sides)
    return along / vehicle.cutting_speed_mps + TURN_S * len(plan.sides)


def room_for(path: Path, seconds: float) -> str:
    """A warning where the disk is too small for the record of so long a run, else nothing.
    UserError where there is no room at all, or no such disk."""
    folder = next(each for each in (path.parent, *path.parent.parents) if each.exists())
    free = shutil.disk_usage(folder).free
    if free < FREE_BYTES:
        raise UserError(
            f"the disk of {folder} has {free / 1e6:.0f} MB left, a record needs "
            f"{RECORD_BPS * 60 / 1e6:.0f} MB a minute; delete old records or name another --record"
        )
    if free < RECORD_BPS * seconds:
        return (
            f"the disk of {folder} has {free / 1e9:.1f} GB left, enough for "
            f"{free / RECORD_BPS / 60:.0f} of about {seconds / 60:.0f} minutes; the run goes on "
            "without a record when it is full"
        )
    return ""


# ---- place and direction -------------------------------------------------------------------------


def where_of(errand: Errand) -> tuple[float, float, float] | None:
    """(x, y, heading) in the field frame of the edge where the blade's right end has to stand; None
    without a plan."""
    if not errand.whole.sides:
        return None
    index, cut_m = errand.begun
    return errand.whole.sides[index].pose(cut_m)


@dataclass(frozen=True, slots=True)
class Problem:
    """Why the machine must not start from where it stands. `code` and `values` name the same for a
    page that says it in its own language."""

    code: str
    text: str
    values: Mapping[str, float | str] = field(default_factory=dict)


def start_problem(
    errand: Errand,
    corners: Sequence[LatLon],
    fixes: Sequence[Fix],
    view: CropView | None,
    heading_deg: float | None,
) -> Problem | None:
    """Why the machine must not start from where it stands, as far as receiver, compass and picture
    tell; None where it may. `corners`: of the field's boundary, `heading_deg`: by the compass."""
    found = place_problem(fixes, errand, corners)
    if found is None and heading_deg is not None:
        found = heading_problem(errand, heading_deg)
    if found is None and view is not None:
        found = view_problem(view)
    if found is not None:
        return found
    resumed = errand.begun != (0, 0.0)
    if resumed and heading_deg is None and (view is None or not direction_seen(view)):
        return Problem(
            "direction",
            "nothing tells which way the machine heads: give --heading, what a compass on it shows",
        )
    return None


def place_problem(
    fixes: Sequence[Fix], errand: Errand, corners: Sequence[LatLon]
) -> Problem | None:
    """Why the positions cannot be those of a machine that stands where it has to; None where they
    can, or nothing is known."""
    goal, frame = where_of(errand), errand.frame
    places = [fix for fix in fixes if fix.quality > 0]
    if goal is None or frame is None or not places:
        return None
    at = _middle(places, frame)
    away = math.dist(at, goal[:2])
    if errand.begun == (0, 0.0) and errand.corner is not None:
        apart = [math.dist(at, frame.to_local(*corner)) for corner in corners]
        nearest = apart.index(min(apart))
        if nearest != errand.corner and apart[errand.corner] - apart[nearest] > CORNERS_M:
            return Problem(
                "corner",
                f"the receiver has the machine {apart[nearest]:.0f} m from corner {nearest} and "
                f"{apart[errand.corner]:.0f} m from corner {errand.corner}, where it has to stand: "
                "move it there, or give the corner at which it stands",
                {"nearest": nearest + 1, "asked": errand.corner + 1},
            )
    if away > PLACE_M:
        way = _bearing(at, goal)
        return Problem(
            "place",
            f"the receiver has the machine {away:.0f} m from where it has to stand; move it "
            f"there ({way:.0f} degrees by the compass), or wait for a better position",
            {"metres": round(away), "bearing": round(way)},
        )
    return None


def heading_problem(errand: Errand, heading_deg: float) -> Problem | None:
    """Why a machine that heads so by the compass cannot begin; None where it can."""
    goal = where_of(errand)
    if goal is None:
        return None
    wanted = compass_deg(goal[2])
    off = math.remainder(heading_deg - wanted, 360)
    if abs(off) <= HEADING_DEG + _edge_doubt_deg(errand):
        return None
    side = "left" if off > 0 else "right"
    return Problem(
        "heading",
        f"the machine heads {heading_deg:.0f} degrees by the compass and has to head {wanted:.0f}: "
        f"turn it {abs(off):.0f} degrees to the {side}",
        {"wanted": round(wanted) % 360, "degrees": round(abs(off)), "side": f"word.{side}"},
    )


def _edge_doubt_deg(errand: Errand) -> float:
    """By how much the edge may run otherwise than the boundary says: two standard deviations, from
    how surely its two corners are known."""
    side = errand.whole.sides[errand.begun[0]]
    askew = math.atan2(2 * math.sqrt(2) * errand.whole.sigma_m, side.length_m)
    return min(EDGE_DOUBT_DEG, math.degrees(askew))


def view_problem(view: CropView) -> Problem | None:
    """Why what the camera sees is not the edge at the blade's right end; None where it is, or
    nothing sure is seen."""
    if view.confidence < SURE:
        return None
    askew = math.degrees(view.edge_heading_rad)
    if math.isfinite(askew) and abs(askew) > HEADING_DEG:
        side = "left" if askew > 0 else "right"
        return Problem(
            "askew",
            f"in the picture the crop's edge runs {abs(askew):.0f} degrees to the {side}: turn the "
            "machine along it",
            {"degrees": round(abs(askew)), "side": f"word.{side}"},
        )
    if abs(view.edge_offset_m) > OFFSET_M:
        side = "left" if view.edge_offset_m > 0 else "right"
        return Problem(
            "beside",
            f"in the picture the crop's edge is {abs(view.edge_offset_m):.1f} m {side} of the "
            "blade's right end: move the machine sideways",
            {"metres": round(abs(view.edge_offset_m), 1), "side": f"word.{side}"},
        )
    return None


def mount_problem(bgr: Bgr, name: str, vehicle: Vehicle) -> Problem | None:
    """Why a picture cannot be from the mount of that name, where another of the vehicle file's fits
    it: the one sees the sky above the horizon, the other the ground alone. None where nothing
    contradicts."""
    wanted = _sees_sky(vehicle.mounts[name])
    top = bgr[: max(1, bgr.shape[0] // 16)].astype(np.int16)
    warm = top[..., 2] - top[..., 0]
    sky = float(((warm < SKY_WARMTH) & (top.max(axis=2) > SKY_BRIGHT)).mean())
    ground = float((warm >= SKY_WARMTH).mean())
    seen = True if sky > MOSTLY else False if ground > ALL_BUT else None
    if wanted is None or seen is None or wanted == seen:
        return None
    others = [other for other, mount in vehicle.mounts.items() if _sees_sky(mount) == seen]
    if not others:
        return None
    what = "sky" if seen else "ground or crop and no sky"
    return Problem(
        "mount",
        f"the upper border of the picture shows {what}, which a camera on the mount {name} does "
        f"not: give --mount {' or '.join(others)}, or set the camera as the vehicle file has it",
        {"mount": name, "others": ", ".join(others)},
    )


def _sees_sky(mount: Mount) -> bool | None:
    """Whether the horizon lies well inside the picture, or well above it; None between."""
    row = mount.centre[1] - mount.focal * math.tan(math.radians(mount.pitch_deg))
    share = row / mount.height_px
    return True if share > HORIZON_IN else False if share < HORIZON_OUT else None


def direction_seen(view: CropView) -> bool:
    """Whether the picture tells the machine's direction against the edge."""
    return view.confidence >= SURE and math.isfinite(view.edge_heading_rad)


def _middle(fixes: Sequence[Fix], frame: LocalFrame) -> tuple[float, float]:
    """The median: one reflection off a wall does not count."""
    places = [frame.to_local(fix.lat_deg, fix.lon_deg) for fix in fixes]
    xs, ys = (sorted(values) for values in zip(*places, strict=True))
    return xs[len(xs) // 2], ys[len(ys) // 2]


def _bearing(at: tuple[float, float], goal: tuple[float, float, float]) -> float:
    """By the compass."""
    return compass_deg(math.atan2(goal[1] - at[1], goal[0] - at[0]))
