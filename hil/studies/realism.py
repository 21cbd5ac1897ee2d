"""How much the simulated pictures resemble photographs of the same thing, in figures.

Two comparisons, on the labelled photographs of `DARANTI_DATA` and on simulated views of an edge:
how far the distributions of hue, saturation and gradient direction overlap (1: the same, 0: apart),
for standing crop and for stubble; and how well the best straight line by each cue divides the two,
which must rank the cues alike. Simulated views are from a cab's height as the photographs are, and
from the two reference mounts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from host.core.errors import UserError
from host.core.terminal import PlainConsole, echo
from host.vision.photo.comparison import data_folder
from host.vision.photo.score import labelled_set, miou
from host.vision.photo.split import Search, Side, best_line, whiten
from sim_plant import labels
from sim_plant.camera import LOW, MAST, Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.sky import WeatherSpec

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]

WIDTH_PX: Final = 640
"""At most, of photographs: as wide as the simulated pictures."""
CELL_PX: Final = 10
"""Side of the cells over which cues are averaged."""
CAB: Final = CameraSpec(x_m=0.0, z_m=2.8, pitch_deg=32.0)
"""As the photographs were taken, from a combine's cab."""
MOUNTS: Final = {"cab": CAB, "mast": MAST, "low": LOW}
CUES: Final = ("hue", "L", "Lab", "texture", "Lab and texture")
QUANTITIES: Final = ("hue", "saturation", "gradient direction")


@dataclass(frozen=True, slots=True)
class Sample:
    """A picture with its standing crop and its cut ground; pixels of neither count nowhere."""

    bgr: Picture
    standing: Mask
    cut: Mask
    side: Side
    scene: str


def photographs(folder: Path) -> list[Sample]:
    """The labelled photographs, at most WIDTH_PX wide."""
    out = []
    for item in labelled_set(folder):
        bgr, standing = item.picture(), item.standing()
        scale = min(1.0, WIDTH_PX / bgr.shape[1])
        size = (round(bgr.shape[1] * scale), round(bgr.shape[0] * scale))
        small = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(standing.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        out.append(Sample(np.asarray(small, np.uint8), mask, ~mask, item.side, item.scene))
    return out


def simulated(mount: CameraSpec, seed: int, count: int = 24) -> list[Sample]:
    """Views of a cut edge at varied hours, weathers, fields and poses, without the background."""
    rng = np.random.default_rng([seed, 0x5E])
    out = []
    for k in range(count):
        spec = FieldSpec(
            size_m=(14.0, 8.0),
            stalks_per_m2=float(rng.uniform(250, 600)),
            drilled=bool(rng.random() < 0.5),
            weeds=float(rng.uniform(0, 0.1)),
            lodged=float(rng.choice([0.0, 0.15])),
            green=float(rng.uniform(0, 0.08)),
            crop_bgr=_ripe(rng, float(rng.uniform(165, 215))),
            straw_bgr=_ripe(rng, float(rng.uniform(150, 240))),
        )
        crop = Field(spec, seed + k)
        edge = float(rng.uniform(1.5, 3.0))
        crop.clear(((-1, -1), (15, -1), (15, edge), (-1, edge)))
        weather = WeatherSpec(
            hour=float(rng.uniform(9, 16)),
            haze=float(rng.choice([0.002, 0.01, 0.03])),
            cloud=float(rng.choice([0.0, 0.0, 0.6, 1.0])),
            wind_mps=float(rng.uniform(0, 6)),
        )
        camera = Camera(crop, mount, weather, seed + k)
        pose = (1.0, edge + float(rng.uniform(-0.5, 0.3)), float(rng.normal(0, 0.06)))
        bgr = camera.capture(1.0, *pose, v=0.5)
        bgr = np.asarray(cv2.imdecode(np.frombuffer(camera.encode(bgr), np.uint8), 1), np.uint8)
        label = camera.labels(1.0, *pose, v=0.5)
        standing = np.isin(label, (labels.STANDING, labels.EDGE))
        cut = np.isin(label, (labels.STUBBLE, labels.STRAW))
        window = _window(standing, cut)
        if window is not None:
            out.append(Sample(bgr[window], standing[window], cut[window], "left", f"simulated {k}"))
    return out


def _ripe(rng: np.random.Generator, bright: float) -> tuple[float, float, float]:
    """BGR of a ripe field's straw: hue about 30 degrees, saturation about one half."""
    hue, saturation = rng.normal(31, 5), float(np.clip(rng.normal(0.5, 0.09), 0.3, 0.8))
    least = bright * (1 - saturation)
    return least, least + (bright - least) * float(np.clip(hue, 18, 45)) / 60, bright


def _window(standing: Mask, cut: Mask) -> tuple[slice, slice] | None:
    """The largest rectangle in which nearly everything is crop or stubble, and enough of either."""
    known = standing | cut
    best, found = 0, None
    height = known.shape[0]
    for top in range(0, height - 120, 24):
        for bottom in range(top + 120, height + 1, 24):
            rows = slice(top, bottom)
            columns = np.flatnonzero(known[rows].mean(0) > 0.9)
            if columns.size < 120:
                continue
            across = slice(int(columns[0]), int(columns[-1]) + 1)
            part = known[rows, across]
            share = cut[rows, across].mean()
            if part.mean() > 0.9 and 0.12 < share < 0.88 and part.size > best:
                best, found = part.size, (rows, across)
    return found


# ---- distributions -------------------------------------------------------------------------------


def histograms(bgr: Picture, where: Mask) -> dict[str, NDArray[np.float64]]:
    """Normalised histograms of QUANTITIES over the pixels of a mask."""
    hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    gx, gy = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    direction = np.degrees(np.arctan2(gy, gx)) % 180
    strength = np.hypot(gx, gy)
    raw = {
        "hue": np.histogram(hsv[..., 0][where], 60, (0, 180))[0],
        "saturation": np.histogram(hsv[..., 1][where], 32, (0, 256))[0],
        "gradient direction": np.histogram(direction[where], 18, (0, 180), weights=strength[where])[
            0
        ],
    }
    return {name: h / max(1e-9, float(h.sum())) for name, h in raw.items()}


def pooled(samples: Iterable[Sample], kind: str) -> dict[str, NDArray[np.float64]]:
    """The mean of every sample's histograms over its standing crop or its stubble."""
    each = []
    for s in samples:
        where = s.standing if kind == "standing" else s.cut
        if np.count_nonzero(where) > 500:
            each.append(histograms(s.bgr, where))
    return {name: np.mean([h[name] for h in each], 0) for name in QUANTITIES}


def overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Common area of two normalised histograms, 0..1."""
    return float(np.minimum(a, b).sum())


# ---- cues ----------------------------------------------------------------------------------------


def cue_features(bgr: Picture, cue: str) -> NDArray[np.float32]:
    """(rows, columns, n) of one cue, means over cells of CELL_PX."""
    h, w = bgr.shape[0] // CELL_PX, bgr.shape[1] // CELL_PX

    def cells(plane: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(plane, (w, h), interpolation=cv2.INTER_AREA), np.float32)

    bgr = bgr[: h * CELL_PX, : w * CELL_PX]
    lab = cv2.cvtColor(bgr, cv2.COLOR_BGR2LAB).astype(np.float32)
    planes: list[NDArray[np.float32]] = []
    if cue == "hue":
        planes = [cells(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)[..., 0].astype(np.float32))]
    if cue == "L":
        planes = [cells(lab[..., 0])]
    if cue in ("Lab", "Lab and texture"):
        planes = [cells(lab[..., k]) for k in range(3)]
    if cue in ("texture", "Lab and texture"):
        light = lab[..., 0]
        gx, gy = cv2.Sobel(light, cv2.CV_32F, 1, 0), cv2.Sobel(light, cv2.CV_32F, 0, 1)
        mean = cells(light)
        sigma = np.sqrt(np.maximum(0.0, cells(light * light) - mean * mean))
        planes += [cells(np.abs(gx)), cells(np.abs(gy)), sigma.astype(np.float32)]
    return np.stack(planes, -1)


def divided(sample: Sample, cue: str) -> float:
    """Mean IoU of the best straight line by one cue, the side given."""
    features = cue_features(sample.bgr, cue)
    line = best_line(whiten(features), sample.side, Search(strip_share=0.0))
    rows, columns = features.shape[:2]
    v, u = np.mgrid[0:rows, 0:columns] + 0.5
    found = line.signed(u, v) > 0
    size = (columns, rows)
    true = cv2.resize(
        sample.standing[: rows * CELL_PX, : columns * CELL_PX].astype(np.float32),
        size,
        interpolation=cv2.INTER_AREA,
    )
    return miou(true > 0.5, found)


# ---- report --------------------------------------------------------------------------------------


def report(seed: int) -> None:
    """Prints both tables. Raises UserError where the photographs are missing."""
    folder = data_folder() / "wheat-edge"
    if not folder.exists():
        raise UserError(
            f"no photographs at {folder}; set DARANTI_DATA to the folder that holds wheat-edge/"
        )
    console = PlainConsole()
    photos = photographs(folder)
    views = {name: simulated(mount, seed) for name, mount in MOUNTS.items()}
    scenes = sorted({p.scene for p in photos})
    halves = [[p for p in photos if scenes.index(p.scene) % 2 == k] for k in range(2)]

    table = Table(title="overlap of the distributions with the photographs' (1: the same)")
    table.add_column("of")
    names = (*views, "photographs, half against half of the scenes")
    for name in names:
        table.add_column(name, justify="right")
    weakest = (math.inf, "")
    for kind in ("standing", "stubble"):
        real = pooled(photos, kind)
        half = [pooled(h, kind) for h in halves]
        each = {name: pooled(v, kind) for name, v in views.items()}
        for q in QUANTITIES:
            values = [overlap(real[q], each[name][q]) for name in views]
            named = [(v, f"{kind} {q}, {n}") for v, n in zip(values, views, strict=True)]
            weakest = min(weakest, *named)
            values.append(overlap(half[0][q], half[1][q]))
            table.add_row(f"{kind}: {q}", *(f"{v:.2f}" for v in values))
    console.print_table(table)
    console.print(f"weakest: {weakest[1]} ({weakest[0]:.2f})")

    table = Table(title="mean IoU of the best straight line by one cue, the side given")
    table.add_column("cue")
    sets = {"photographs": photos, **views}
    for name, samples in sets.items():
        table.add_column(f"{name} ({len(samples)})", justify="right")
    for cue in CUES:
        means = [float(np.mean([divided(s, cue) for s in samples])) for samples in sets.values()]
        table.add_row(cue, *(f"{m:.3f}" for m in means))
    console.print_table(table)
    echo(f"photographs: {folder}")
