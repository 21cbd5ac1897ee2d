"""Both modes and two baselines on the same labelled photographs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from host.vision.mounted.paper import PaperPhoto
from host.vision.photo import benchmark, calibration
from host.vision.photo.confidence import TOLERANCE, Weights
from host.vision.photo.detector import RobustPhoto
from host.vision.photo.disturb import DISTURBANCES, FORMATS, disturbed, formatted
from host.vision.pictures import Picture
from host.vision.view import CropView

SEED = 0
"""Of the draws, so that figures repeat."""
THRESHOLDS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""Of the confidence, at which share and error of the answers are shown."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """What came out."""

    figures: Mapping[str, Mapping[str, float]]
    """By mode, then by figure."""
    robust: list[benchmark.Result]
    """One for each photograph, cross-validated."""
    folds: Any
    stages_ms: Mapping[str, float]
    curve: Sequence[Mapping[str, float]]
    """How often sure, and sure and wrong, by the confidence from which one is sure."""
    reliability: Sequence[Mapping[str, float]]
    """Of confidences in a range: their mean, how many were right, how many there were."""
    disturbed: Mapping[str, Mapping[str, float]]
    """Figures of robust mode by disturbance or format."""


def data_folder() -> Path:
    """Of real photographs and tracks: `DARANTI_DATA`, or ../shared/data."""
    return Path(os.environ.get("DARANTI_DATA") or "../shared/data")


def overlay(photo: benchmark.Photo, result: benchmark.Result) -> Picture:
    """The label's edge in blue, the found one in red."""
    out = photo.bgr.copy()
    for mask, colour in ((photo.standing, (235, 120, 30)), (result.standing, (40, 40, 235))):
        shapes, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, shapes, -1, colour, max(1, out.shape[1] // 250))
    scale = 360 / out.shape[0]
    return np.asarray(cv2.resize(out, None, fx=scale, fy=scale), np.uint8)


def compare(photos: Sequence[benchmark.Photo]) -> Comparison:
    """Scores and times every mode; robust is cross-validated over the scenes."""
    photos = list(photos)
    samples = calibration.gather(photos, SEED)
    weights = {
        str(scene): calibration.fit(samples, samples.scenes != scene)
        for scene in np.unique(samples.scenes)
    }
    robust, folds = benchmark.cross_validated(photos, weights)

    def robust_see(p: benchmark.Photo) -> CropView:
        return RobustPhoto(p.item.side).see(p.bgr)

    def paper_see(p: benchmark.Photo) -> CropView:
        return PaperPhoto(p.item.side).see(p.bgr)

    def fixed(see: benchmark.See) -> list[benchmark.Result]:
        return [benchmark.judge(p, see(p)) for p in photos]

    paper_ms = benchmark.median_ms(photos, paper_see)
    modes = {
        "robust": (robust, benchmark.median_ms(photos, robust_see)),
        "paper": (fixed(paper_see), paper_ms),
        "paper_tuned_per_scene": (benchmark.tuned_per_scene(photos), paper_ms),
        "lab_and_texture": (
            fixed(benchmark.lab_and_texture),
            benchmark.median_ms(photos, benchmark.lab_and_texture),
        ),
        "hough": (fixed(benchmark.hough), benchmark.median_ms(photos, benchmark.hough)),
    }
    return Comparison(
        {name: benchmark.summary(results, ms) for name, (results, ms) in modes.items()},
        robust,
        folds,
        benchmark.stage_times(photos),
        _curve(samples),
        _reliability(samples),
        {name: _under(name, photos, weights) for name in (*DISTURBANCES, *FORMATS)},
    )


def _curve(samples: calibration.Samples) -> list[dict[str, float]]:
    sure_of = calibration.held_out(samples)
    wrong = samples.wrong > benchmark.WRONG
    rows = []
    for least in THRESHOLDS:
        sure = sure_of >= least
        row = {"confidence": least}
        for name, which in (("photographs", samples.plain), ("disturbed", ~samples.plain)):
            row[f"{name}_sure"] = float(sure[which].mean())
            row[f"{name}_sure_and_wrong"] = float((sure & wrong)[which].mean())
        rows.append(row)
    return rows


def _reliability(samples: calibration.Samples) -> list[dict[str, float]]:
    sure_of = calibration.held_out(samples)
    right = samples.wrong <= TOLERANCE
    rows = []
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (sure_of >= low) & (sure_of < low + 0.1)
        if inside.any():
            mean, share = float(sure_of[inside].mean()), float(right[inside].mean())
            rows.append({"confidence": mean, "right": share, "pictures": float(inside.sum())})
    return rows


def _under(
    name: str, photos: Sequence[benchmark.Photo], weights: Mapping[str, Weights]
) -> dict[str, float]:
    """Figures of the photographs under one disturbance or in one format."""
    results = []
    for number, photo in enumerate(photos):
        rng = np.random.default_rng((SEED, number))
        if name in FORMATS:
            frame = formatted(photo.bgr, photo.standing, FORMATS[name])
            if frame is None:
                continue
            bgr, standing = frame
        else:
            bgr, standing = disturbed(photo.bgr, (name,), rng), photo.standing
        shown = benchmark.Photo(photo.item, bgr, standing)
        eye = RobustPhoto(photo.item.side, None, weights[photo.item.scene])
        results.append(benchmark.judge(shown, eye.see(bgr)))
    return benchmark.summary(results, 0.0)
