"""A person with a phone who walks around fields: NMEA of a way through given places."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

from sim_plant.gnss import Gnss, GnssSpec

Place = tuple[float, float]
WALK_MPS = 1.3
PERFECT = GnssSpec(
    cep_m=0.0, white_m=0.0, jumps_per_hour=0.0, outages_per_hour=0.0, speed_noise_mps=0.0
)


def around(corners: list[Place], laps: int = 1, start: int = 0) -> list[Place]:
    """The way along the corners, `laps` times and back to where it began."""
    turned = corners[start:] + corners[:start]
    return turned * laps + turned[:1]


def walk(way: Iterable[Place], spec: GnssSpec = PERFECT, seed: int = 0) -> list[str]:
    """Sentences of a receiver carried along the way at 1.3 m/s, one epoch a second; pauses of two
    seconds at each place."""
    gnss = Gnss(spec, seed)
    lines: list[str] = []
    for second, (x, y, vx, vy) in enumerate(_steps(way)):
        lines += gnss.epoch(float(second), x, y, vx, vy)
    return lines


def _steps(way: Iterable[Place]) -> Iterator[tuple[float, float, float, float]]:
    for (ax, ay), (bx, by) in pairwise(way):
        for _ in range(2):
            yield ax, ay, 0.0, 0.0
        length = math.dist((ax, ay), (bx, by))
        seconds = max(1, round(length / WALK_MPS))
        vx, vy = (bx - ax) / seconds, (by - ay) / seconds
        for k in range(seconds):
            yield ax + vx * k, ay + vy * k, vx, vy
        yield bx, by, 0.0, 0.0
