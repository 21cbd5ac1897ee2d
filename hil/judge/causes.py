"""Why runs go wrong: which state, which reason, which circumstance, over many runs.

A run is a flat row: the keys of summary.json, what the world was like (`circumstances`), and its
events, the pilot's changes of state.
"""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from scipy import stats

from hil.scenario.scenario import Scenario
from sim_plant.drive_response import drive_response

COVERED: Final = 0.95
"""A finished field of which less is cut has gone wrong, too."""
KNOWN: Final = 0.05
"""A circumstance counts where chance would show it in less than this share of cases."""
LIKELIER: Final = 1.2
"""And where it makes a cause at least so many times as frequent."""


def circumstances(scenario: Scenario) -> dict[str, float | str | bool]:
    """What a world was like that may have to do with how a run went."""
    f, w = scenario.field, scenario.weather
    ring = np.array(f.boundary.exterior.coords)[:-1]
    sides = np.roll(ring, -1, axis=0) - ring
    headings = np.arctan2(sides[:, 1], sides[:, 0])
    turns = (headings - np.roll(headings, 1) + math.pi) % math.tau - math.pi
    angles = 180.0 - np.degrees(turns)
    drive = drive_response(scenario.machine)
    return {
        "mount": scenario.camera,
        "shape": scenario.name,
        "corners": len(ring),
        "sharpest_corner_deg": round(float(angles.min()), 1),
        "reflex_corner": bool((angles > 180.0).any()),
        "shortest_side_m": round(float(np.hypot(*sides.T).min()), 2),
        "area_m2": round(float(shapely.Polygon(ring).area), 1),
        "keep_out": bool(f.keep_outs),
        "dust": w.dust,
        "cloud": w.cloud,
        "hour": w.hour,
        "wind_mps": w.wind_mps,
        "haze": w.haze,
        "crop_height_m": f.crop_height_m,
        "stalks_per_m2": f.stalks_per_m2,
        "drilled": f.drilled,
        "edge_wobble_m": f.edge_wobble_m,
        "weeds": f.weeds,
        "lodged": f.lodged,
        "thin": f.thin,
        "green": f.green,
        "bare": f.bare,
        "slope_deg": round(math.hypot(f.side_slope_deg, f.long_slope_deg), 3),
        "bump_sd_deg": f.bump_sd_deg,
        "gnss_cep_m": scenario.gnss.cep_m,
        "drive_full_mps": round(drive.full_mps, 3),
        "drive_lag_s": round(drive.lag_s, 3),
        "hall_pulses_per_m": scenario.machine.drive.hall_pulses_per_m,
        "pot_counts_per_deg": scenario.machine.steering.pot_counts_per_deg,
        "start_lateral_error_m": abs(scenario.start.lateral_error_m),
        "start_heading_error_deg": abs(scenario.start.heading_error_deg),
        **_mistaken(scenario),
    }


def _mistaken(scenario: Scenario) -> dict[str, float | str | bool]:
    """How far the host's knowledge is from the world; sizes, and where it counts the side."""
    world, told = scenario.world, scenario.told
    lens, mount = world.lens, told.mount
    true, believed = shapely.Polygon(world.corners), shapely.Polygon(told.boundary)
    return {
        "believed_yaw_deg": round(mount.yaw_deg - lens.yaw_deg, 3),
        "believed_pitch_deg": round(mount.pitch_deg - lens.pitch_deg, 3),
        "believed_roll_deg": round(mount.roll_deg - lens.roll_deg, 3),
        "believed_focal": round(mount.focal / lens.focal_px - 1.0, 4),
        "boundary_wrong_m": round(float(true.hausdorff_distance(believed)), 3),
        "boundary_area_wrong": round(float(believed.area / true.area) - 1.0, 4),
        "corners_miscounted": len(told.boundary) != len(world.corners),
        "believed_gap_m": round(told.gap_m - world.field.gap_m, 3),
        "believed_delay_s": round(told.vehicle.camera_delay_s - lens.delay_s, 3),
    }


def general(reason: str) -> str:
    """A reason without its numbers and names of sides."""
    reason = re.sub(r"-?\d+(\.\d+)?", "#", reason)
    return re.sub(r"\s+", " ", reason).strip()


@dataclass(frozen=True, slots=True)
class Cause:
    """One way in which runs went wrong."""

    outcome: str
    state: str
    """In which it was before."""
    reason: str
    runs: int
    share: float
    """Of all runs."""
    left_m2: float
    """Of crop, in the median of these runs."""
    circumstance: str
    """What is the more frequent among them, with how many times, or ''."""
    examples: tuple[str, ...]


def went_wrong(run: dict[str, Any]) -> str:
    """In a word or two what was wrong with a run; '' where nothing was."""
    for harm, word in (
        ("neighbour_cut_m2", "neighbour cut"),
        ("outside_m", "outside"),
        ("keep_out_m", "in a keep-out"),
    ):
        if (run.get(harm) or 0.0) > 0.0:
            return word
    if run["outcome"] != "finished":
        return str(run["outcome"])
    return "crop left" if run.get("coverage", 1.0) < COVERED else ""


def causes(
    runs: Sequence[dict[str, Any]], worlds: Sequence[dict[str, float | str | bool]]
) -> list[Cause]:
    """The ways in which runs went wrong, the most frequent first. `runs`: summaries with `events`;
    `worlds`: their circumstances."""
    groups: dict[tuple[str, str, str], list[int]] = {}
    for k, run in enumerate(runs):
        wrong = went_wrong(run)
        if not wrong:
            continue
        events = run.get("events") or []
        state = str(events[-2]["phase"]) if len(events) > 1 else "-"
        groups.setdefault((wrong, state, general(str(run["reason"]))), []).append(k)
    found = []
    for (wrong, state, reason), members in groups.items():
        left = [float(runs[k].get("missed_m2") or 0.0) for k in members]
        order = sorted(members, key=lambda k: float(runs[k].get("coverage") or 0.0))
        found.append(
            Cause(
                wrong,
                state,
                reason,
                len(members),
                len(members) / len(runs),
                statistics.median(left),
                telling(worlds, members),
                tuple(str(runs[k]["run"]) for k in order[:3]),
            )
        )
    harm = ("neighbour cut", "outside", "in a keep-out")
    return sorted(found, key=lambda c: (c.outcome not in harm, -c.runs, c.reason))


def telling(worlds: Sequence[dict[str, float | str | bool]], members: Sequence[int]) -> str:
    """The circumstance that is most surely more frequent among `members` than among the others,
    by Fisher's exact test; numbers are split at their median over all."""
    if len(worlds) < 2 or not members:
        return ""
    inside = np.zeros(len(worlds), np.bool_)
    inside[list(members)] = True
    best: tuple[float, str] = (1.0, "")
    tried = 0
    for name in worlds[0]:
        for text, has in _splits(name, [world[name] for world in worlds]):
            a, b = int((has & inside).sum()), int((~has & inside).sum())
            c, d = int((has & ~inside).sum()), int((~has & ~inside).sum())
            tried += 1
            if not has.any() or has.all() or a == 0:
                continue
            times = (a / (a + c)) / max(1e-9, (a + b) / len(worlds))
            p = float(stats.fisher_exact([[a, b], [c, d]], "greater").pvalue)
            if times >= LIKELIER and p < best[0]:
                best = (p, f"{text}: {a} of {a + b} ({times:.1f} times as frequent)")
    return best[1] if best[0] < KNOWN / max(1, tried) ** 0.5 else ""


def _splits(name: str, values: Sequence[Any]) -> list[tuple[str, Any]]:
    """(words, which runs have it) for each side of a circumstance."""
    if isinstance(values[0], bool):
        has = np.array(values)
        return [(name.replace("_", " "), has), (f"no {name.replace('_', ' ')}", ~has)]
    if isinstance(values[0], str):
        return [(f"{name} {kind}", np.array([v == kind for v in values])) for kind in set(values)]
    numbers = np.array(values, float)
    middle = float(np.median(numbers))
    return [(f"{name} > {middle:g}", numbers > middle), (f"{name} < {middle:g}", numbers < middle)]


def hesitations(runs: Sequence[dict[str, Any]]) -> list[tuple[str, int, int, float]]:
    """(reason, how often, in how many runs, seconds in all) of the pilot's hesitations."""
    found: dict[str, tuple[int, set[int], float]] = {}
    for k, run in enumerate(runs):
        events = run.get("events") or []
        for n, event in enumerate(events):
            if event["phase"] != "hesitate":
                continue
            until = (
                events[n + 1]["t"] if n + 1 < len(events) else run.get("simulated_s", event["t"])
            )
            reason = general(str(event["reason"]))
            times, of, seconds = found.get(reason, (0, set(), 0.0))
            found[reason] = (times + 1, of | {k}, seconds + float(until) - float(event["t"]))
    rows = [(reason, n, len(of), seconds) for reason, (n, of, seconds) in found.items()]
    return sorted(rows, key=lambda row: -row[3])


def disagreements(
    models: Sequence[dict[str, Any]], pictures: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """A row for each field driven both ways: outcome and coverage by the model and by pictures, and
    whether they disagree: another outcome, or coverage apart by more than 0.03."""
    by_seed = {(s["scenario"], s["seed"]): s for s in models}
    rows = []
    for seen in pictures:
        model = by_seed.get((seen["scenario"], seen["seed"]))
        if model is None:
            continue
        a, b = model.get("coverage"), seen.get("coverage")
        apart = a is None or b is None or abs(float(a) - float(b)) > 0.03
        rows.append(
            {
                "field": f"{seen['scenario']} {seen['seed']}",
                "model": model["outcome"],
                "pictures": seen["outcome"],
                "model coverage": a,
                "pictures coverage": b,
                "model reason": model["reason"],
                "pictures reason": seen["reason"],
                "disagree": apart or model["outcome"] != seen["outcome"],
            }
        )
    return rows
