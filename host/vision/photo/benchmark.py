"""Scores of the detectors on labelled photographs, beside two plain baselines."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.mounted.paper import Chain, PaperParams, PaperPhoto
from host.vision.photo.confidence import Weights
from host.vision.photo.curve import follow
from host.vision.photo.detector import (
    CELL_PX,
    EDGE_PX,
    SEARCH_PX,
    SEARCH_SIGMA,
    SIGMAS,
    RobustPhoto,
    searched,
    trace,
)
from host.vision.photo.score import (
    Labelled,
    Standing,
    heading_error_deg,
    lateral_error,
    miou,
)
from host.vision.photo.split import Line, Search, Side, best_line, whiten
from host.vision.photo.texture import combine, measure, pooled, reduced
from host.vision.pictures import Picture
from host.vision.tuning.search import photo_contrast, tune
from host.vision.view import CropView

SURE = 0.5
"""Confidence above which an answer counts as given."""
WRONG = 0.10
"""Of the width."""
TIMED_SIZE = (640, 480)
"""Width and height at which times are taken: the machine's camera."""
STRIPS = (0.08, 0.10, 0.12, 0.15)
GAINS = (0.015, 0.02, 0.025, 0.03)
"""Tried, as are the strips' widths: the best on all other scenes is used."""
BASELINE_PX, BASELINE_CELL, BASELINE_SIGMA = 640, (5, 5), 0.8
"""Of the Lab-and-texture baseline, as data/README.md has it."""
TUNED_ON = 3
"""Photographs of a scene that the paper's tuner sees."""


@dataclass(frozen=True, slots=True)
class Result:
    """One photograph and one detector."""

    item: Labelled
    miou: float
    lateral: float
    """Share of the width; NaN where it means nothing."""
    heading_deg: float
    confidence: float
    standing: Standing


@dataclass(frozen=True, slots=True)
class Photo:
    """A labelled photograph in memory."""

    item: Labelled
    bgr: Picture
    standing: Standing


See = Callable[[Photo], CropView]


def judge(photo: Photo, view: CropView) -> Result:
    """One view against its label."""
    found = view.standing if view.standing is not None else np.zeros_like(photo.standing)
    lateral = lateral_error(photo.standing, found) if photo.item.lateral else float("nan")
    return Result(
        photo.item,
        miou(photo.standing, found),
        lateral,
        heading_error_deg(photo.standing, found, photo.item.side),
        view.confidence,
        found,
    )


def summary(results: list[Result], ms: float) -> dict[str, float]:
    """The figures of one mode, keys as in summary.json."""
    lateral = np.array([r.lateral for r in results if r.item.lateral])
    headings = np.array([r.heading_deg for r in results if r.item.lateral])
    sure = np.array([r.confidence >= SURE for r in results if r.item.lateral])
    return {
        "pictures": len(results),
        "lateral_pictures": len(lateral),
        "miou_mean": float(np.mean([r.miou for r in results])),
        "lateral_median": float(np.median(lateral)),
        "within_5pct": float(np.mean(lateral < 0.05)),
        "heading_within_5deg": float(np.mean(np.nan_to_num(headings, nan=90.0) < 5.0)),
        "confident_wrong": float(np.mean(sure & (lateral > WRONG))),
        "confident": float(np.mean(sure)),
        "ms_median": ms,
    }


def cross_validated(
    photos: list[Photo], weights: Mapping[str, Weights]
) -> tuple[list[Result], dict[str, object]]:
    """Robust mode; the strip's two numbers are chosen for each scene on all other scenes.
    `weights`: of each scene's confidence, learnt on the other scenes."""
    grid = [Search(share, gain) for share, gain in itertools.product(STRIPS, GAINS)]

    def seen(p: Photo, search: Search) -> Result:
        return judge(p, RobustPhoto(p.item.side, search, weights[p.item.scene]).see(p.bgr))

    table = [[seen(p, search) for search in grid] for p in photos]
    scores = np.array([[r.miou for r in row] for row in table])
    scenes = np.array([p.item.scene for p in photos])
    results: list[Result | None] = [None] * len(photos)
    folds: dict[str, object] = {}
    for scene in sorted(set(scenes), key=int):
        held = np.flatnonzero(scenes == scene)
        choice = int(scores[scenes != scene].mean(0).argmax())
        folds[str(scene)] = {
            "pictures": [photos[i].item.name for i in held],
            "strip_share": grid[choice].strip_share,
            "strip_gain": grid[choice].strip_gain,
            "miou_mean": float(scores[held, choice].mean()),
        }
        for i in held:
            results[i] = table[i][choice]
    return [r for r in results if r is not None], folds


def tuned_per_scene(photos: list[Photo]) -> list[Result]:
    """Paper mode with the parameters that its own tuner finds on a few pictures of each scene; the
    tuner is told the side, not the label."""
    found: dict[str, PaperParams] = {}
    for p in photos:
        scene = p.item.scene
        if scene not in found:
            some = [(q.bgr, q.item.side) for q in photos if q.item.scene == scene][:TUNED_ON]
            found[scene], _ = tune(photo_contrast(some))
    return [judge(p, PaperPhoto(p.item.side, found[p.item.scene]).see(p.bgr)) for p in photos]


def lab_and_texture(photo: Photo) -> CropView:
    """The baseline of the labelled set: one straight line by Fisher's criterion over L, a, b, the
    two brightness steps and the spread."""
    cells = measure(reduced(photo.bgr, BASELINE_PX), BASELINE_CELL, SIGMAS)
    wide = combine(pooled(cells, BASELINE_SIGMA))[..., [9, 0, 1, 2, 3, 6]]
    line = best_line(
        whiten(np.ascontiguousarray(wide)), photo.item.side, Search(strip_gain=float("inf"))
    )
    return _straight(line.scaled(photo.bgr.shape[1] / wide.shape[1]), photo.bgr, line.explained)


def hough(photo: Photo) -> CropView:
    """A plain Hough implementation: Canny edges, the longest line within the side's fan."""
    grey = cv2.GaussianBlur(cv2.cvtColor(photo.bgr, cv2.COLOR_BGR2GRAY), (0, 0), 2)
    h = grey.shape[0]
    found = cv2.HoughLinesP(
        cv2.Canny(grey, 40, 120), 1, np.pi / 180, 60, minLineLength=h // 6, maxLineGap=h // 20
    )
    upright = photo.item.side in ("left", "right")
    best: tuple[float, Line] | None = None
    for u0, v0, u1, v1 in (found if found is not None else np.zeros((0, 4))).reshape(-1, 4):
        du, dv = float(u1 - u0), float(v1 - v0)
        length = float(np.hypot(du, dv))
        if length == 0 or (abs(dv) < abs(du)) == upright:
            continue
        normal = np.array([-dv, du]) / length
        towards = {"right": normal[0], "left": -normal[0], "bottom": normal[1], "top": -normal[1]}
        if towards[photo.item.side] < 0:
            normal = -normal
        line = Line(float(np.arctan2(normal[1], normal[0])), float(normal @ [u0, v0]))
        if best is None or length > best[0]:
            best = (length, line)
    if best is None:
        return CropView(0.0, reason="no line")
    return _straight(best[1], photo.bgr, min(0.95, best[0] / h))


def _straight(line: Line, bgr: Picture, confidence: float) -> CropView:
    h, w = bgr.shape[:2]
    u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    return CropView(confidence, standing=np.asarray(line.signed(u, v) > 0))


def median_ms(photos: list[Photo], see: See) -> float:
    """Median of the best of three runs a picture at 640x480, in processor time of one thread: other
    work on the machine does not count."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        times = []
        for p in photos:
            small = Photo(p.item, np.asarray(cv2.resize(p.bgr, TIMED_SIZE), np.uint8), p.standing)
            see(small)
            runs = []
            for _ in range(3):
                start = time.thread_time()
                see(small)
                runs.append(time.thread_time() - start)
            times.append(min(runs))
    finally:
        cv2.setNumThreads(threads)
    return 1e3 * float(np.median(times))


def stage_times(photos: list[Photo]) -> dict[str, float]:
    """Median milliseconds of each stage at 640x480, one thread."""

    def side(p: Photo) -> Side:
        return p.item.side

    def cells(p: Photo) -> NDArray[np.float32]:
        small = reduced(reduced(p.bgr, EDGE_PX), SEARCH_PX)
        return measure(small, (CELL_PX, CELL_PX), SIGMAS)

    def measured(p: Photo) -> None:
        cells(p)

    def divided(p: Photo) -> None:
        best_line(searched(combine(pooled(cells(p), SEARCH_SIGMA))), side(p))

    def doubted(p: Photo) -> None:
        found = trace(p.bgr, side(p), Search())
        found.quantities(side(p))

    def traced(p: Photo) -> None:
        trace(p.bgr, side(p), Search())

    def followed(p: Photo) -> None:
        bgr = reduced(p.bgr, EDGE_PX)
        follow(bgr, Line(0.0, bgr.shape[1] / 2))

    chain = Chain(PaperParams(), TIMED_SIZE)

    def chained(p: Photo) -> None:
        chain.run(p.bgr)

    def timed(work: Callable[[Photo], None]) -> float:
        def see(p: Photo) -> CropView:
            work(p)
            return CropView(0.0)

        return median_ms(photos, see)

    base = timed(measured)
    return {
        "robust: colour and texture": base,
        "robust: whitening and line": timed(divided) - base,
        "robust: curve": timed(followed),
        "robust: confidence": timed(doubted) - timed(traced),
        "paper: SY, TSY, VTSY": timed(chained),
    }
