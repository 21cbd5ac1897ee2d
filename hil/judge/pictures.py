"""Pictures of a run that a person can read: the map, the steering trace, the annotated video."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import av
import cv2
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from host.core.whole_file import saved
from host.pilot.phase import Phase
from host.vision.view import CropView
from sim_plant import ground
from sim_plant.field import Field

mpl.use("Agg")

_GROUND = {
    ground.SOIL: (0.72, 0.62, 0.50),
    ground.CROP: (0.80, 0.16, 0.12),
    ground.STUBBLE: (0.95, 0.89, 0.70),
    ground.WINDROW: (0.90, 0.80, 0.52),
    ground.GRASS: (0.66, 0.68, 0.48),
    ground.NEIGHBOUR: (0.45, 0.58, 0.32),
    ground.NEIGHBOUR_STUBBLE: (0.55, 0.0, 0.6),
    ground.OBSTACLE: (0.25, 0.25, 0.25),
}
GROUND = np.zeros((256, 3))
"""(256, 3): the colour of each kind of ground."""
for _kind, _colour in _GROUND.items():
    GROUND[_kind] = _colour
_NAMES = {
    ground.CROP: "missed",
    ground.STUBBLE: "cut",
    ground.WINDROW: "straw",
    ground.NEIGHBOUR: "neighbour's crop",
    ground.NEIGHBOUR_STUBBLE: "neighbour's crop CUT",
}
_PATH = {
    Phase.FOLLOW: ("tab:blue", "follow"),
    Phase.TURN: ("tab:purple", "turn"),
    Phase.HESITATE: ("black", "hesitate"),
}


BEYOND_GAP_M = 2.0
"""What a map shows of the neighbour's crop."""


def draw_map(
    path: Path, crop: Field, track: list[tuple[float, float, float, float, Phase]], title: str
) -> None:
    """map.png: what is cut, missed and the neighbour's, and the rear axle's path by phase."""
    rows, columns = crop.kind.shape
    x0, y0 = crop.origin
    corners = np.array(crop.spec.corners)
    zero = corners[0]  # where the pictures of plan and survey count from, too
    x0, y0 = x0 - zero[0], y0 - zero[1]
    extent = (x0, x0 + columns * crop.cell, y0, y0 + rows * crop.cell)
    figure = Figure(figsize=(9, 9), layout="constrained")
    axes = figure.subplots()
    axes.imshow(GROUND[crop.kind], origin="lower", extent=extent, interpolation="nearest")
    points = np.array([(x, y) for _, x, y, _, _ in track]).reshape(-1, 2) - zero
    for number, corner in enumerate(corners - zero):
        axes.annotate(str(number), corner, (5, 5), textcoords="offset points", weight="bold")
    phases = [phase for *_, phase in track]
    start = 0
    for end in range(1, len(track) + 1):
        if end == len(track) or phases[end] is not phases[start]:
            line, _ = _PATH.get(phases[start], ("grey", ""))
            piece = points[start : end + 1]
            axes.plot(piece[:, 0], piece[:, 1], color=line, linewidth=0.9)
            start = end
    present = set(np.unique(crop.kind).tolist())
    for kind, name in _NAMES.items():
        if kind in present:
            axes.scatter([], [], color=[_GROUND[kind]], marker="s", s=60, label=name)
    for phase, (line, name) in _PATH.items():
        if phase in phases:
            axes.plot([], [], color=line, label=name)
    axes.set(xlabel="east of corner 0 (m)", ylabel="north of corner 0 (m)", title=title)
    left, bottom, right, top = np.array(crop.spec.boundary.bounds) - np.tile(zero, 2)
    around = crop.spec.gap_m + BEYOND_GAP_M
    axes.set(
        xlim=(max(extent[0], left - around), min(extent[1], right + around)),
        ylim=(max(extent[2], bottom - around), min(extent[3], top + around)),
    )
    figure.legend(loc="outside lower center", ncols=7, fontsize=8)
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=110)


def draw_steering(path: Path, trace: NDArray[np.float64]) -> None:
    """steering.png from rows of (t s, setpoint rad, angle as reported rad, duty -255..255)."""
    figure = Figure(figsize=(12, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    # The setpoint is the thin line above: neither hides the other.
    t, setpoint, angle = trace[:, 0], np.degrees(trace[:, 1]), np.degrees(trace[:, 2])
    upper.plot(t, angle, color="tab:blue", lw=2.2, alpha=0.55, label="angle")
    upper.plot(t, setpoint, color="tab:orange", lw=0.9, label="setpoint")
    upper.set(ylabel="steering angle (deg, left positive)", title="Steering")
    upper.legend(loc="upper right")
    upper.grid(alpha=0.3)
    lower.plot(trace[:, 0], trace[:, 3], color="tab:green", lw=0.6)
    lower.set(xlabel="time (s)", ylabel="duty (of 255)")
    lower.grid(alpha=0.3)
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=110)


def _shown(value: float, form: str) -> str:
    """A number, or a dash where nothing was measured."""
    return "-" if math.isnan(value) else format(value, form)


def annotate(
    bgr: NDArray[np.uint8], view: CropView | None, t: float, phase: str, reason: str
) -> NDArray[np.uint8]:
    """A copy with the paper's lines (Fig. 2) and the pilot's state drawn in."""
    picture = bgr.copy()
    height, width = picture.shape[:2]
    if view is not None:
        if view.edge_px is not None and len(view.edge_px) > 1:
            points = np.round(view.edge_px).astype(np.int32).reshape(-1, 1, 2)
            cv2.polylines(picture, [points], False, (255, 255, 0), 2)
        lines = (
            ("E_outer", view.e_outer_px, True, (0, 0, 255)),
            ("O_map", view.o_map_px, True, (255, 120, 0)),
            ("l_height", view.l_height_px, False, (0, 0, 255)),
            ("l_reference", view.l_reference_px, False, (255, 120, 0)),
        )
        for name, at, vertical, colour in lines:
            if not math.isfinite(at):
                continue
            k = round(at)
            a, b = ((k, 0), (k, height - 1)) if vertical else ((0, k), (width - 1, k))
            cv2.line(picture, a, b, colour, 1)
            where = (min(max(k + 3, 0), width - 70), height - 8 if name == "O_map" else height - 24)
            if not vertical:
                where = (4 if name == "l_height" else 90, min(max(k - 3, 12), height - 4))
            cv2.putText(picture, name, where, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    lines_of_text = [f"{t:7.1f} s  {phase}: {reason}"[:88]]
    if view is not None:
        lines_of_text.append(
            f"offset {_shown(view.edge_offset_m, '+.2f')} m"
            f"  heading {_shown(math.degrees(view.edge_heading_rad), '+.1f')} deg"
            f"  ahead {_shown(view.crop_ahead_m, '.2f')} m  confidence {view.confidence:.2f}"
        )
    cv2.rectangle(picture, (0, 0), (width, 4 + 16 * len(lines_of_text)), (0, 0, 0), -1)
    for k, text in enumerate(lines_of_text):
        cv2.putText(
            picture,
            text,
            (4, 14 + 16 * k),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.42,
            (255, 255, 255),
            1,
            cv2.LINE_AA,
        )
    return picture


class Video:
    """An H.264 file; `add` takes pictures of one size."""

    def __init__(self, path: Path, fps: float, width: int, height: int) -> None:
        self._container = av.open(str(path), "w")
        stream = self._container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"preset": "ultrafast", "crf": "27"}
        stream.thread_count = 1
        self._stream = stream

    def add(self, bgr: NDArray[np.uint8]) -> None:
        """Appends one picture."""
        planes = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420), np.uint8)
        for packet in self._stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")):
            self._container.mux(packet)

    def close(self) -> None:
        """Finishes the file."""
        for packet in self._stream.encode():
            self._container.mux(packet)
        self._container.close()
