"""What one fault came to: who noticed, when, and what moved meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Situation = Literal["follow", "turn"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one fault; times in ms after it first made a difference."""

    fault: str
    situation: Situation
    expect: str
    bound: str
    detected_by: str
    """The firmware's fault bits, the pilot's reason, or nobody."""
    detected_ms: float | None
    stop_latency_ms: float | None
    """Until drive and blade were off for good; None where they were not."""
    moved_m: float
    """Travelled meanwhile, the coasting included; over the whole watch where nothing stopped."""
    ok: bool
    verdict: str
    limit: bool = False
    """Not ok, and known: nothing on board can notice it."""
