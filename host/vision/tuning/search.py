"""Finding the paper's parameters by the contrast that they reach, so that no one has to by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from host.vision.mounted.detector import MountedDetector
from host.vision.mounted.paper import PaperParams, PaperPhoto
from host.vision.photo.split import Side
from host.vision.pictures import Picture
from host.vision.tuning.profiles import Circumstance, Profiles

Contrast = Callable[[PaperParams], float]
"""0..1: how clearly parameters tell standing crop from cut on some pictures."""

CHOICES: dict[str, tuple[float, ...]] = {
    "phi1_deg": (0.0, 10.0, 20.0, 30.0, 38.0),
    "phi2_deg": (48.0, 58.0, 70.0, 90.0),
    "b": (-0.5, -0.3, -0.15, -0.05),
    "ripe_from_deg": (0.0, 60.0, 120.0),
    "ripe_to_deg": (180.0, 250.0, 330.0),
    "contrast": (6.0, 10.0, 16.0, 24.0),
    "gap_px": (1, 2, 4),
}
"""Tried one after the other, twice over."""


def photo_contrast(pictures: Sequence[tuple[Picture, Side]]) -> Contrast:
    """Over photographs whose standing side is known: the mean confidence in their edges."""

    def contrast(params: PaperParams) -> float:
        seen = [PaperPhoto(side, params).contrast(bgr) for bgr, side in pictures]
        return float(np.mean(seen)) if seen else 0.0

    return contrast


def mounted_contrast(
    pictures: Sequence[Picture], detector: Callable[[PaperParams], MountedDetector]
) -> Contrast:
    """Over pictures of the machine's own camera, taken where crop stands ahead as it should at the
    start: the mean confidence in E_outer."""

    def contrast(params: PaperParams) -> float:
        eye = detector(params)
        return float(np.mean([eye.see(bgr).confidence for bgr in pictures])) if pictures else 0.0

    return contrast


def tune(
    contrast: Contrast, start: PaperParams | None = None, rounds: int = 2
) -> tuple[PaperParams, float]:
    """The parameters of greatest contrast that a search along one parameter after the other finds,
    and that contrast. What changes nothing is left as it was."""
    best = start or PaperParams()
    reached = contrast(best)
    for _ in range(rounds):
        before = reached
        for name, choices in CHOICES.items():
            for value in choices:
                if getattr(best, name) == value:
                    continue
                tried = best.model_copy(update={name: value})
                if tried.phi1_deg >= tried.phi2_deg or tried.ripe_from_deg >= tried.ripe_to_deg:
                    continue
                score = contrast(tried)
                if score > reached + 1e-4:
                    best, reached = tried, score
        if reached <= before:
            break
    return best, reached


GOOD = 0.6
"""Contrast from which parameters are left as they are."""


def first_params(
    database: Path,
    where: Circumstance,
    first: Picture,
    detector: Callable[[PaperParams], MountedDetector],
) -> tuple[PaperParams, str]:
    """Parameters to start a drive with, and in words where they are from: the nearest profile's
    (without a database the built-in ones), tuned where the first picture shows too little."""
    near = None
    if database.exists():
        with Profiles(database) as profiles:
            near = profiles.nearest(where)
    if near is None:
        start, origin = PaperParams(), "the built-in colour thresholds"
    else:
        there = near.circumstance
        start = near.params
        origin = f"the colour thresholds of {there.hour:04.1f} h, {there.mount} ({near.saved})"
    contrast = mounted_contrast([first], detector)
    before = contrast(start)
    if before >= GOOD:
        return start, f"{origin}: contrast {before:.2f}"
    params, after = tune(contrast, start, rounds=1)
    return params, f"{origin}, tuned on the first picture: contrast {before:.2f}, now {after:.2f}"
