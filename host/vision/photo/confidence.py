"""How far an edge in a photograph can be trusted: what speaks against it, weighed as on scenes that
were held out.

The picture is divided again by colour alone, by texture alone, by both, with its brightness, and by
colour and texture relative to brightness, in which a shadow has no border.
Where these put the border elsewhere, where the passes along the edge disagree, or where the curve
found little to hold on to, edges were wrong more often. How much more was learnt by a logistic
regression (`daranti tune confidence`).
"""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.photo.curve import Curve
from host.vision.photo.fisher import Features
from host.vision.photo.split import Side, beyond, divided, whiten
from host.vision.photo.texture import WITHOUT_LIGHT, unlit

TOLERANCE = 0.015
"""The confidence is the probability that at most this share of the picture lies on the wrong side
of the edge: where the picture is 4 m wide, 6 cm beside the true one on average."""
WEIGHTS = Path(__file__).with_name("confidence.json")
CUES: dict[str, tuple[int, ...]] = {
    "colour": (0, 1, 7),
    "texture": (2, 3, 4, 5),
    "both": tuple(range(WITHOUT_LIGHT)),
    "brightness": tuple(range(WITHOUT_LIGHT + 1)),
    "unlit": tuple(range(WITHOUT_LIGHT + 1, 2 * WITHOUT_LIGHT + 1)),
}
"""Columns of `texture.combine`, and of `texture.unlit` after them, by which the picture is divided
again."""

REASONS = {
    "colour": "colour divides the picture elsewhere: a side is of mixed kinds",
    "texture": "texture divides the picture elsewhere: a side is of mixed kinds",
    "both": "two borders divide the picture alike",
    "brightness": "with brightness the picture divides elsewhere: a shadow, or the crop's face",
    "unlit": "relative to brightness the picture divides elsewhere: a shadow's border, or dust",
    "explained": "the best line divides hardly anything",
    "apart": "the two sides of the edge hardly differ",
    "strayed": "the edge does not follow any line",
    "passes": "the two passes along the edge disagree",
    "strip": "whether a strip of a third kind lies beside the edge is doubtful",
    "uneven": "the edge all but leaves the picture",
}
"""Of each quantity, what it means where it speaks against an edge."""


@dataclass(frozen=True, slots=True)
class Weights:
    """The learnt regression; every array has an entry for each name of REASONS, in its order."""

    middle: NDArray[np.float64]
    """Mean of each quantity."""
    scale: NDArray[np.float64]
    weight: NDArray[np.float64]
    """Change of the odds' logarithm by a quantity that is one scale above its mean."""
    bias: float

    def judged(self, quantities: NDArray[np.float64]) -> tuple[float, str]:
        """Probability 0..1, and what speaks against the edge most."""
        parts = self.weight * (quantities - self.middle) / self.scale
        odds = float(parts.sum()) + self.bias
        probability = 1.0 / (1.0 + math.exp(-max(-50.0, min(50.0, odds))))
        return probability, tuple(REASONS.values())[int(parts.argmin())]


@functools.cache
def weights(path: Path = WEIGHTS) -> Weights:
    """Those that a file holds, as `daranti tune confidence` wrote it."""
    data = json.loads(path.read_text(encoding="utf-8"))
    rows = np.array([data["quantities"][name] for name in REASONS], np.float64)
    return Weights(rows[:, 0], rows[:, 1], rows[:, 2], float(data["bias"]))


def quantities(
    features: Features, curve: Curve, side: Side, size: tuple[int, int]
) -> NDArray[np.float64]:
    """What speaks for and against an edge, in the order of REASONS. `features`: (h, w, 10) of
    `texture.combine`; `size`: width and height of the picture whose pixels the curve is in."""
    small = cv2.resize(features, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    small = np.dstack([small, unlit(np.asarray(small, np.float32))])
    rows, columns = small.shape[:2]
    shorter = min(size)
    standing = curve.scaled(columns / size[0]).standing((columns, rows))
    elsewhere = []
    for which in CUES.values():
        angles, values = divided(whiten(np.ascontiguousarray(small[..., which], np.float32)), side)
        angle, border = (int(i) for i in np.unravel_index(int(values.argmax()), values.shape))
        mask = beyond(float(angles[angle]), border, values.shape[1], (rows, columns))
        elsewhere.append(math.sqrt(float((mask != standing).mean())))
    return np.array(
        [
            *elsewhere,
            curve.line.explained,
            math.log(curve.apart + 0.1),
            math.sqrt(curve.strayed_px / shorter),
            math.sqrt(curve.passes_px / shorter),
            math.sqrt(curve.line.strip / shorter),
            abs(float(standing.mean()) - 0.5),
        ]
    )
