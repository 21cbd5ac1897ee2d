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
from host.vision.photo import benchmark
from host.vision.photo.detector import RobustPhoto
from host.vision.pictures import Picture
from host.vision.view import CropView


@dataclass(frozen=True, slots=True)
class Comparison:
    """What came out."""

    figures: Mapping[str, Mapping[str, float]]
    """By mode, then by figure."""
    robust: list[benchmark.Result]
    """One for each photograph, cross-validated."""
    folds: Any
    stages_ms: Mapping[str, float]


def data_folder() -> Path:
    """`DARANTI_DATA`, or shared/data beside the checkout."""
    named = os.environ.get("DARANTI_DATA")
    return Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"


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
    robust, folds = benchmark.cross_validated(photos)

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
    )
