"""Learning how far edges can be trusted, from labelled photographs and disturbed pictures of them.

Folds hold scenes out: what a scene's confidences are judged by was learnt on other scenes alone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.whole_file import save_text
from host.vision.photo.benchmark import Photo
from host.vision.photo.confidence import REASONS, TOLERANCE, Weights
from host.vision.photo.detector import RobustPhoto, trace
from host.vision.photo.disturb import disturbed, reframed, side_of, some

PER_PHOTO = 8
"""Disturbed pictures of each photograph."""
PENALTY = 3.0
"""On the squares of the weights."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Samples:
    """Edges of pictures whose label is known."""

    quantities: Floats
    """(n, len(REASONS))."""
    wrong: Floats
    """(n,): the share of the picture on the wrong side."""
    scenes: NDArray[np.str_]
    plain: NDArray[np.bool_]
    """(n,): the photograph itself, not disturbed."""


def gather(photos: Sequence[Photo], seed: int, per_photo: int = PER_PHOTO) -> Samples:
    """The detector's edges on the photographs and on `per_photo` disturbed pictures of each."""
    quantities, wrong, scenes, plain = [], [], [], []
    for number, photo in enumerate(photos):
        rng = np.random.default_rng((seed, number))
        for k in range(1 + per_photo):
            bgr, standing, side = photo.bgr, photo.standing, photo.item.side
            if k > 0:
                frame = reframed(bgr, standing, rng)
                if frame is None:
                    continue
                bgr, standing = disturbed(frame[0], some(rng), rng), frame[1]
                side = side_of(standing)
            found = trace(bgr, side, RobustPhoto(side).search)
            mask = found.curve.standing(found.size)
            true = cv2.resize(
                standing.astype(np.uint8), found.size, interpolation=cv2.INTER_NEAREST
            )
            quantities.append(found.quantities(side))
            wrong.append(float((mask != (true > 0)).mean()))
            scenes.append(photo.item.scene)
            plain.append(k == 0)
    return Samples(np.array(quantities), np.array(wrong), np.array(scenes), np.array(plain))


def fit(samples: Samples, chosen: NDArray[np.bool_]) -> Weights:
    """A logistic regression by Newton's method on the chosen samples; a scene counts by the root of
    its number of pictures."""
    x, right = samples.quantities[chosen], samples.wrong[chosen] <= TOLERANCE
    _, scene, counts = np.unique(samples.scenes[chosen], return_inverse=True, return_counts=True)
    share = 1.0 / np.sqrt(counts[scene])
    share /= share.mean()
    middle, scale = x.mean(0), x.std(0) + 1e-9
    rows = np.column_stack([(x - middle) / scale, np.ones(len(x))])
    penalty = np.diag([PENALTY] * x.shape[1] + [0.0])
    w = np.zeros(rows.shape[1])
    for _ in range(30):
        p = 1.0 / (1.0 + np.exp(-np.clip(rows @ w, -50, 50)))
        slope = rows.T @ (share * (p - right)) + penalty @ w
        w -= np.linalg.solve((rows.T * (share * p * (1 - p))) @ rows + penalty, slope)
    return Weights(middle, scale, w[:-1], float(w[-1]))


def held_out(samples: Samples) -> Floats:
    """(n,) probabilities, each by weights learnt on all scenes but its own."""
    out = np.zeros(len(samples.wrong))
    for scene in np.unique(samples.scenes):
        held = samples.scenes == scene
        learnt = fit(samples, ~held)
        out[held] = [learnt.judged(q)[0] for q in samples.quantities[held]]
    return out


def write(path: Path, learnt: Weights, command: str) -> None:
    """The weights as JSON, with the command that made them."""
    columns = zip(learnt.middle, learnt.scale, learnt.weight, strict=True)
    data = {
        "command": command,
        "columns": ["mean", "scale", "weight"],
        "quantities": {
            name: [round(float(v), 6) for v in row]
            for name, row in zip(REASONS, columns, strict=True)
        },
        "bias": round(learnt.bias, 6),
    }
    save_text(path, json.dumps(data, indent=1) + "\n")
