"""What a page is told, five times a second: plain values, names of texts, no sentences of its own.

Lengths in metres, angles in degrees, times in seconds of the machine process's clock.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any, Final

from host.core.messages import Fix, State, Telemetry
from host.link import protocol
from host.pilot.behaviours import BEHAVIOURS
from host.pilot.guard import Watched
from host.pilot.phase import Reason
from host.pilot.pilot import Pilot
from host.route.plan import Plan
from host.route.side import Side
from host.vision.view import CropView

Json = dict[str, Any]

EDGE_POINTS: Final = 24
"""Of the edge in the driver's picture."""
TURN_S: Final = 14.0
"""What a turn takes about, for the time that is left."""


def number(value: float | None, digits: int = 3) -> float | None:
    """Rounded; None for what is not known (JSON has no NaN)."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits)


def of_telemetry(telemetry: Telemetry, now: float) -> Json:
    """The board."""
    faults = protocol.Fault(telemetry.faults)
    return {
        "state": telemetry.state.name,
        "faults": [bit.name for bit in protocol.Fault if bit in faults],
        "battery_v": number(telemetry.battery_v, 2),
        "angle_deg": number(math.degrees(telemetry.angle_rad), 1),
        "setpoint_deg": number(math.degrees(telemetry.setpoint_rad), 1),
        "steer_duty": telemetry.steer_duty,
        "drive_duty": telemetry.drive_duty,
        "blade": telemetry.blade,
        "speed_mps": number(telemetry.speed_mps, 2),
        "distance_m": number(telemetry.distance_m, 2),
        "age_s": number(now - telemetry.stamp, 2),
        "off": telemetry.state in (State.SAFE, State.FAULT)
        and telemetry.drive_duty == 0
        and telemetry.steer_duty == 0
        and not telemetry.blade,
    }


def of_fix(fix: Fix, now: float) -> Json:
    """The receiver's newest."""
    return {
        "lat": number(fix.lat_deg, 7),
        "lon": number(fix.lon_deg, 7),
        "quality": fix.quality,
        "satellites": fix.satellites,
        "hdop": number(fix.hdop, 1),
        "speed_mps": number(fix.speed_mps, 2),
        "course_rad": number(fix.course_rad, 3),
        "stamp": number(fix.stamp, 2),
        "age_s": number(now - fix.stamp, 1),
    }


def fix_of(told: Json) -> Fix:
    """What `of_fix` told."""
    return Fix(
        told["stamp"],
        told["lat"],
        told["lon"],
        told["quality"],
        math.nan if told["hdop"] is None else told["hdop"],
        told["satellites"],
        told["speed_mps"],
        told["course_rad"],
    )


def of_view(view: CropView) -> Json:
    """What is drawn over the picture, in pixels of the mount's size."""
    edge = view.edge_px
    points = [] if edge is None else edge[:: max(1, len(edge) // EDGE_POINTS)].round(1).tolist()
    return {
        "offset_m": number(view.edge_offset_m, 2),
        "confidence": number(view.confidence, 2),
        "reason": view.reason,
        "e_outer_px": number(view.e_outer_px, 1),
        "o_map_px": number(view.o_map_px, 1),
        "edge_px": points,
    }


@cache
def reasons() -> tuple[Reason, ...]:
    """All that the pilot may say of why it does something."""
    kinds: list[type[Reason]] = [Watched]
    kinds += [kind for behaviour in BEHAVIOURS.values() for kind in behaviour.reasons]
    return tuple(dict.fromkeys(reason for kind in kinds for reason in kind))


def code_of(reason: Reason) -> str:
    """Names a reason's text: a behaviour's own by its name, a shared one with its class's."""
    shared = type(reason).__name__
    return reason.name if shared == "Why" else f"{shared}.{reason.name}"


@cache
def _pattern(reason: Reason) -> re.Pattern[str]:
    """A reason's text with what it speaks of as groups."""
    parts = re.split(r"\{(\w+)\}", reason.text)
    return re.compile(
        "".join(f"(?P<{part}>.*)" if k % 2 else re.escape(part) for k, part in enumerate(parts)),
        re.DOTALL,
    )


def of_reason(pilot: Pilot) -> Json:
    """Why the pilot does what it does: the reason's code and what it speaks of."""
    if not pilot.transitions:
        return {"code": "", "words": {}}
    last = pilot.transitions[-1]
    # While a behaviour waits, its reason may be another than the one that led to it.
    name = last.code.rpartition(": ")[2] if pilot.reason == last.reason else ""
    meant = [reason for reason in reasons() if name in ("", reason.name)]
    fitting = [(r, found) for r in meant if (found := _pattern(r).fullmatch(pilot.reason))]
    if not fitting:
        return {"code": "", "words": {}}
    # Of two texts that fit, the one that leaves less to be filled in.
    reason, found = min(fitting, key=lambda fit: sum(map(len, fit[1].groups())))
    return {"code": code_of(reason), "words": found.groupdict()}


def of_pilot(pilot: Pilot, plan: Plan, speed_mps: float) -> Json:
    """The harvest: what the pilot does and why, where it is, what is left."""
    side = min(pilot.turns, max(0, len(plan.sides) - 1))
    lengths = [one.length_m for one in plan.sides]
    left = max(0.0, sum(lengths[side:]) - pilot.cut_m) if lengths else None
    whole = sum(lengths)
    turns = max(0, len(lengths) - 1 - pilot.turns)
    place = pilot.position.pose if pilot.position.known else None
    return {
        "phase": pilot.phase.value,
        "reason": pilot.reason,
        **of_reason(pilot),
        "side": plan.done + side + 1 if lengths else pilot.turns + 1,
        "sides": plan.done + len(lengths),
        "done": number(1 - left / whole, 3) if left is not None and whole > 0 else None,
        "left_m": number(left, 1),
        "left_s": number(left / speed_mps + TURN_S * turns, 0) if left is not None else None,
        "place": None if place is None else [number(value, 3) for value in place],
        "view": None if pilot.view is None else of_view(pilot.view),
    }


def of_cut(whole: Plan, begun: tuple[int, float]) -> list[list[list[float | None]]]:
    """Outlines of the strips that were cut before a run that goes on with `begun`: side of the
    whole plan, and how far along it."""
    index, cut_m = begun
    done = [(side, side.length_m) for side in whole.sides[:index]]
    done += [(side, cut_m) for side in whole.sides[index : index + 1]]
    found = []
    for side, until_m in done:
        for start_m, piece in side.pieces():
            long_m = min(piece.length_m, until_m - start_m)
            if long_m > 0:
                wide = piece.width_m
                ends = ((0.0, 0.0), (long_m, 0.0), (long_m, wide), (0.0, wide))
                found.append([[number(v, 2) for v in piece.pose(*end)[:2]] for end in ends])
    return found


def of_plan(plan: Plan) -> Json:
    """The map's still part, in the field frame."""
    return {
        "boundary": [list(corner) for corner in plan.boundary],
        "keep_outs": [[list(corner) for corner in hole] for hole in plan.keep_outs],
        "gap_m": plan.gap_m,
        "leftover_m2": number(plan.leftover_m2, 1),
        "sides": [_course(side) for side in plan.sides],
    }


def _course(side: Side) -> list[list[float | None]]:
    """A side's places, from its beginning over its bends to its end."""
    places = [piece.pose(0.0) for _, piece in side.pieces()]
    places.append(side.pose(side.length_m))
    return [[number(value, 2) for value in place[:2]] for place in places]
