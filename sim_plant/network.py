"""When a phone's pictures reach the host: one stream over Wi-Fi and TCP, which keeps their order.

What the network adds to one picture is told by no header. So a host that takes a picture's arrival
less its usual delay for the shutter is wrong by it.
"""

from __future__ import annotations

import math
from typing import Final

from sim_plant import noise
from sim_plant.camera import CameraSpec

STALL_S: Final = 0.2
"""Until a segment that was lost is sent again, s: the least retransmission timeout of Linux and so
of Android (TCP_RTO_MIN, HZ / 5; include/net/tcp.h)."""
QUICKEST: Final = 0.2
"""Of the mean delay, that no picture comes sooner than: exposure, read-out and JPEG take it."""


class Stream:
    """One phone's pictures. To be asked in order of their shutters; deterministic by (lens, seed,
    number of the picture)."""

    def __init__(self, lens: CameraSpec, seed: int) -> None:
        self._lens, self._seed = lens, seed + 0x57F1
        self._count = 0
        self._last_s = -math.inf
        """When the picture before arrives."""

    def arrives_s(self, shutter_s: float) -> float:
        """When the next picture reaches the host, whose shutter opened then. What it waits for
        besides is exponential; what waits behind a late one comes together with it."""
        lens, k = self._lens, self._count
        self._count += 1
        waits_s = -math.log(1.0 - noise.uniform(self._seed, k, 1)) - 1.0
        took_s = max(QUICKEST * lens.delay_s, lens.delay_s + lens.jitter_s * waits_s)
        if lens.stall_share > 0.0 and noise.uniform(self._seed, k, 2) < lens.stall_share:
            took_s += STALL_S
        self._last_s = max(self._last_s, shutter_s + took_s)
        return self._last_s
