"""`daranti-hil plot`: a record drawn: steering, duty, edge offset, what the pilot did, the map."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.core.input_file import check_input
from host.runs import record

mpl.use("Agg")

PHASES = {
    "connect": "0.75",
    "align": "0.6",
    "follow": "tab:blue",
    "turn": "tab:purple",
    "search": "tab:cyan",
    "hesitate": "tab:orange",
    "finished": "tab:green",
    "fault": "tab:red",
}


SURE = 0.5
"""Confidence from which the pilot follows what it sees."""
EDGE_CM = 10.0
"""The edge's scale reaches at least so far."""
PATH_M = 2.0
"""A path's picture shows at least so much either way: a straight drive is a line in it."""


@dataclass(slots=True)
class Series:
    """A record as columns; every array's first column is the time in s."""

    scenario: Scenario | None
    telemetry: NDArray[np.float64]
    """(t, setpoint deg, angle deg, steer duty, drive duty, battery V, fault word)."""
    view: NDArray[np.float64]
    """(t, edge offset m, confidence, crop ahead m)."""
    truth: NDArray[np.float64]
    """(t, x m, y m, speed m/s, coverage); empty for a drive in the field."""
    pilot: NDArray[np.float64]
    """(t, x m, y m, offset m): dead reckoning from the first pose."""
    command: NDArray[np.float64]
    """(t, speed m/s, blade)."""
    phases: list[tuple[float, str, str]] = field(default_factory=list)
    """(since, phase, reason), each change."""
    faults: list[tuple[float, str, bool]] = field(default_factory=list)
    """(at, what was injected, begins)."""
    cut: str = ""
    """Why the record is not whole, in words; empty where it is."""


_ROWS = {
    "/telemetry": ("setpoint_rad", "angle_rad", "steer_duty", "drive_duty", "battery_v", "faults"),
    "/view": ("edge_offset_m", "confidence", "crop_ahead_m"),
    "/truth": ("x_m", "y_m", "speed_mps", "coverage"),
    "/pilot": ("x_m", "y_m", "offset_m"),
    "/command": ("speed_mps", "blade"),
}


def series(path: Path) -> Series:
    """Reads a record. UserError where it is none, or holds nothing to draw."""
    rows: dict[str, list[list[float]]] = {topic: [] for topic in _ROWS}
    phases: list[tuple[float, str, str]] = []
    faults: list[tuple[float, str, bool]] = []
    cut: list[str] = []
    for topic, stamp, message in record.read(path, cut.append):
        if topic in _ROWS:
            values = [message.get(name) for name in _ROWS[topic]]
            rows[topic].append([stamp, *(np.nan if v is None else float(v) for v in values)])
        if topic == "/pilot" and (not phases or phases[-1][1] != message["phase"]):
            phases.append((stamp, message["phase"], message["reason"]))
        if topic == "/fault":
            faults.append((stamp, message["fault"], message["begins"]))
    if not rows["/telemetry"]:
        why = f" ({cut[0]})" if cut else ""
        raise UserError(f"{path} holds no telemetry: there is nothing to draw{why}")

    def columns(topic: str) -> NDArray[np.float64]:
        return np.array(rows[topic], np.float64).reshape(-1, 1 + len(_ROWS[topic]))

    telemetry = columns("/telemetry")
    telemetry[:, 1:3] = np.degrees(telemetry[:, 1:3])
    view = columns("/view")
    view[np.abs(view[:, 3]) >= record.INFINITE, 3] = np.nan
    about = record.about(path)
    scenario = Scenario.model_validate_json(about["scenario"]) if "scenario" in about else None
    return Series(
        scenario,
        telemetry,
        view,
        columns("/truth"),
        columns("/pilot"),
        columns("/command"),
        phases,
        faults,
        "".join(cut),
    )


def _marks(axes: Axes, data: Series) -> None:
    for stamp, _, begins in data.faults:
        axes.axvline(stamp, color="tab:red", lw=1, ls="-" if begins else ":")


def _lines(axes: Axes, t: NDArray[np.float64], asked: NDArray[np.float64],
           got: NDArray[np.float64], names: tuple[str, str]) -> None:  # fmt: skip
    """What was asked as a thin line over what came of it, so that neither hides the other."""
    axes.plot(t, got, color="tab:blue", lw=2.2, alpha=0.55, label=names[1])
    axes.plot(t, asked, color="tab:orange", lw=0.9, label=names[0])


def _edge(axes: Axes, view: NDArray[np.float64]) -> None:
    """The edge's offset on a scale that holds all that was sure; what was not sure and lies beyond
    is marked at the border."""
    t, offset, sure = view[:, 0], 100 * view[:, 1], view[:, 2] >= SURE
    seen = np.abs(offset[sure & np.isfinite(offset)])
    limit = max(EDGE_CM, 1.1 * float(seen.max(initial=0.0)))
    axes.plot(t, np.where(sure, offset, np.nan), color="tab:blue", lw=0.9, label="seen, sure")
    known = ~sure & np.isfinite(offset)
    inside = known & (np.abs(offset) <= limit)
    axes.plot(t[inside], offset[inside], ".", ms=3, color="0.6", label="not sure")
    beyond = known & ~inside
    if beyond.any():
        at = np.sign(offset[beyond]) * 0.97 * limit
        axes.plot(t[beyond], at, "d", ms=3, color="tab:orange", label="not sure, beyond the scale")
    axes.set(ylabel="edge offset\n(cm, left +)", ylim=(-limit, limit))


def draw_time(data: Series) -> Figure:
    """Everything over time."""
    figure = Figure(figsize=(12, 9), layout="constrained")
    steer, duty, edge, speed, state = figure.subplots(
        5, 1, sharex=True, height_ratios=(3, 2, 3, 2, 0.6)
    )
    t = data.telemetry[:, 0]
    _lines(steer, t, data.telemetry[:, 1], data.telemetry[:, 2], ("setpoint", "angle"))
    steer.set(ylabel="steering\n(deg, left +)")
    duty.plot(t, data.telemetry[:, 3], color="tab:green", lw=0.7, label="steering")
    duty.plot(t, data.telemetry[:, 4], color="tab:brown", lw=0.9, label="drive")
    duty.set(ylabel="duty (of 255)")
    _edge(edge, data.view)
    speed.plot(data.command[:, 0], data.command[:, 1], color="tab:orange", lw=0.9, label="asked")
    if len(data.truth):
        speed.plot(data.truth[:, 0], data.truth[:, 3], color="tab:blue", lw=0.9, label="true")
    blade = data.command[:, 2] > 0
    speed.fill_between(
        data.command[:, 0], 0, np.where(blade, 0.1, 0), step="post", color="tab:red", alpha=0.4,
        label="blade asked",
    )  # fmt: skip
    speed.set(ylabel="speed (m/s)")
    for axes in (steer, duty, edge, speed):
        axes.grid(alpha=0.3)
        axes.legend(loc="upper right", fontsize=8, ncols=3)
        _marks(axes, data)
    end = float(t[-1])
    for k, (since, phase, _) in enumerate(data.phases):
        until = data.phases[k + 1][0] if k + 1 < len(data.phases) else end
        state.axvspan(since, until, color=PHASES.get(phase, "0.9"), lw=0)
        if until - since > 0.05 * end:
            state.text((since + until) / 2, 0.5, phase, ha="center", va="center", fontsize=8)
    state.set(yticks=[], ylim=(0, 1), xlabel="time (s)", xlim=(0, end))
    _marks(state, data)
    return figure


def _origin(data: Series) -> tuple[float, float]:
    """Corner 0 of the field, from which every picture of it counts."""
    if data.scenario is None or not len(data.truth):
        return 0.0, 0.0
    return data.scenario.world.corners[0]


def _track(data: Series) -> NDArray[np.float64]:
    """(t, x, y) of the rear axle: truly, where that is known, else by dead reckoning."""
    track = data.truth if len(data.truth) else data.pilot
    track = track[np.isfinite(track[:, 1:3]).all(axis=1), :3]
    return track - (0.0, *_origin(data))


def draw_path(data: Series) -> Figure:
    """Where the rear axle went."""
    figure = Figure(figsize=(8, 8), layout="constrained")
    axes = figure.subplots()
    track = _track(data)
    every = [track[:, 1:]]
    if data.scenario is not None and len(data.truth):
        ring = np.array(data.scenario.world.corners) - _origin(data)
        every.append(ring)
        axes.plot(*np.vstack([ring, ring[:1]]).T, color="0.3", lw=1.5, label="crop's boundary")
        for number, corner in enumerate(ring):
            axes.annotate(str(number), corner, (5, 5), textcoords="offset points", weight="bold")
        axes.set(xlabel="east of corner 0 (m)", ylabel="north of corner 0 (m)")
    elif len(data.truth):
        axes.set(xlabel="east (m)", ylabel="north (m)")
    else:
        axes.set(xlabel="ahead of where it began (m)", ylabel="left of where it began (m)",
                 title="by dead reckoning")  # fmt: skip
    names = [phase for _, phase, _ in data.phases]
    since = [stamp for stamp, _, _ in data.phases]
    for k, phase in enumerate(names):
        until = since[k + 1] if k + 1 < len(since) else np.inf
        part = track[(track[:, 0] >= since[k] - 0.11) & (track[:, 0] <= until)]
        label = phase if phase not in names[:k] else None
        axes.plot(part[:, 1], part[:, 2], color=PHASES.get(phase, "0.5"), lw=1.3, label=label)
    if not names:
        axes.plot(track[:, 1], track[:, 2], color="0.5", lw=1.3, label="rear axle")
    told: set[str] = set()
    for stamp, what, begins in data.faults:
        if begins and len(track):
            k = int(np.argmin(np.abs(track[:, 0] - stamp)))
            label = None if what in told else what
            told.add(what)
            axes.plot(track[k, 1], track[k, 2], "x", color="tab:red", ms=9, label=label)
    points = np.concatenate(every)
    if len(track):
        axes.plot(*track[0, 1:], "o", color="black", ms=6, label="start")
        axes.plot(*track[-1, 1:], "s", color="black", ms=5, label="end")
    else:
        axes.text(0.5, 0.5, "the record holds no positions", transform=axes.transAxes, ha="center")
    if len(points):
        middle, half = (points.max(0) + points.min(0)) / 2, np.ptp(points, axis=0) / 2
        reach = max(PATH_M, 1.08 * float(half.max()))
        axes.set(xlim=middle[0] + np.array([-reach, reach]),
                 ylim=middle[1] + np.array([-reach, reach]))  # fmt: skip
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=5, fontsize=8)
    return figure


def json_of(path: Path, kind: type[Any] = dict) -> Any:
    """What a file holds. UserError where that is not JSON, or another kind of it."""
    check_input(path, "the result", once=False)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is not JSON: {error}") from error
    if not isinstance(data, kind):
        raise UserError(f"{path} does not hold what a result does")
    return data


def summary_beside(path: Path) -> dict[str, Any]:
    """summary.json of the folder, empty where there is none."""
    file = path / "summary.json"
    return dict(json_of(file)) if file.exists() else {}
