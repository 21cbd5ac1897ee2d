"""Numbers of a seed's stream."""

from __future__ import annotations

import numpy as np


class Drawn:
    """Numbers of a stream, rounded so that a file of them reads well."""

    def __init__(self, *seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def within(self, low: float, high: float) -> float:
        """Uniform between two."""
        return round(float(self.rng.uniform(low, high)), 3)

    def likely(self, share: float) -> bool:
        """True in this share of the draws."""
        return bool(self.rng.random() < share)
