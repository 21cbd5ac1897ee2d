"""The mean of what was compared, and how surely it is known."""

from __future__ import annotations

import math
from collections.abc import Collection


def mean_and_error(values: Collection[float]) -> tuple[float, float]:
    """Mean of two values or more, and its standard error. `statistics` reckons in fractions, which
    takes a hundred times as long."""
    count = len(values)
    mean = math.fsum(values) / count
    squares = math.fsum((value - mean) ** 2 for value in values)
    return mean, math.sqrt(squares / (count - 1) / count)
