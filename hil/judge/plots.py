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
    for topic, stamp, message in record.read(path):
        if topic in _ROWS:
            values = [message.get(name) for name in _ROWS[topic]]
            rows[topic].append([stamp, *(np.nan if v is None else float(v) for v in values)])
        if topic == "/pilot" and (not phases or phases[-1][1] != message["phase"]):
            phases.append((stamp, message["phase"], message["reason"]))
        if topic == "/fault":
            faults.append((stamp, message["fault"], message["begins"]))
    if not rows["/telemetry"]:
        raise UserError(f"{path} holds no telemetry: there is nothing to draw")

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
    )


def _marks(axes: Axes, data: Series) -> None:
    for stamp, _, begins in data.faults:
        axes.axvline(stamp, color="tab:red", lw=1, ls="-" if begins else ":")


def draw_time(data: Series) -> Figure:
    """Everything over time."""
    figure = Figure(figsize=(12, 9), layout="constrained")
    steer, duty, edge, speed, state = figure.subplots(
        5, 1, sharex=True, height_ratios=(3, 2, 3, 2, 0.6)
    )
    t = data.telemetry[:, 0]
    steer.plot(t, data.telemetry[:, 1], color="tab:orange", lw=0.9, label="setpoint")
    steer.plot(t, data.telemetry[:, 2], color="tab:blue", lw=0.9, label="angle")
    steer.set(ylabel="steering (deg, left +)")
    duty.plot(t, data.telemetry[:, 3], color="tab:green", lw=0.7, label="steering")
    duty.plot(t, data.telemetry[:, 4], color="tab:brown", lw=0.9, label="drive")
    duty.set(ylabel="duty (of 255)")
    sure = data.view[:, 2] >= 0.5
    offset = np.where(sure, data.view[:, 1], np.nan)
    edge.plot(data.view[:, 0], 100 * offset, color="tab:blue", lw=0.9, label="seen, sure")
    edge.plot(
        data.view[~sure, 0], 100 * data.view[~sure, 1], ".", ms=2, color="0.6", label="not sure"
    )
    edge.set(ylabel="edge offset (cm)", ylim=(-40, 40))
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


def draw_path(data: Series) -> Figure:
    """Where the rear axle went: truly, where that is known, else by dead reckoning."""
    figure = Figure(figsize=(7, 7), layout="constrained")
    axes = figure.subplots()
    track = data.truth if len(data.truth) else data.pilot
    if data.scenario is not None and len(data.truth):
        ring = [*data.scenario.world.corners, data.scenario.world.corners[0]]
        axes.plot(*np.array(ring).T, color="0.3", lw=1.5, label="crop's boundary")
    names = [phase for _, phase, _ in data.phases]
    since = [stamp for stamp, _, _ in data.phases]
    for k, phase in enumerate(names):
        until = since[k + 1] if k + 1 < len(since) else np.inf
        part = track[(track[:, 0] >= since[k] - 0.11) & (track[:, 0] <= until)]
        label = phase if phase not in names[:k] else None
        axes.plot(part[:, 1], part[:, 2], color=PHASES.get(phase, "0.5"), lw=1.1, label=label)
    for stamp, what, begins in data.faults:
        if begins and len(track):
            k = int(np.argmin(np.abs(track[:, 0] - stamp)))
            axes.plot(track[k, 1], track[k, 2], "x", color="tab:red", ms=9, label=what)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def summary_beside(path: Path) -> dict[str, Any]:
    """summary.json of the folder, empty where there is none."""
    file = path / "summary.json"
    if not file.exists():
        return {}
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise UserError(f"{file} is not JSON: {error}") from error
    return dict(data)
