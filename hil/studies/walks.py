"""How well a boundary walked with a phone is known: `python -m hil.studies.walks` prints the table
of docs/use/survey/README.md in a few minutes.

Every random field is walked with simulated phones. Its corners are compared with the true ones, a
common shift left out, once by positions alone and once with the phone's speed and course as well.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from hil.scenario.belief import ccw, corner_like, walk_lines
from hil.scenario.random_fields import random_field
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.field.survey import survey_track
from host.field.walk import read_fixes, track_of
from host.sensors.nmea import Receiver

SEEDS = range(9001, 9031)
FILTERS = ((0.0, 0.0), (1.5, 0.8))
"""The phone's own: smoothing_s and lag_s."""


@dataclass(frozen=True)
class Walked:
    """One survey against the truth."""

    off: NDArray[np.float64]
    """(n, 2), metres: corners from the true ones, a common shift left out."""
    area: float
    """Share by which the area is too large."""
    sigma_m: float

    @property
    def normalised(self) -> float:
        """About 1 where `sigma_m` is honest: the squared error of an axis by what was expected."""
        return float((self.off**2).sum()) / (2 * (len(self.off) - 1)) / self.sigma_m**2


def walked(
    seed: int, cep_m: float, laps: int, smoothing_s: float, lag_s: float, velocities: bool
) -> Walked | None:
    """A walk around the random field of a seed; None where it gives no boundary."""
    world = random_field(seed).world
    kind = {"cep_m": cep_m, "smoothing_s": smoothing_s, "lag_s": lag_s, "first_fix_s": 0.0}
    phone = world.gnss.model_copy(update=kind)
    lines = (f"{line}\r\n".encode() for line in walk_lines(world.corners, phone, laps, seed))
    fixes = read_fixes(lines, Receiver())
    if not velocities:
        fixes = [replace(fix, speed_mps=None, course_rad=None) for fix in fixes]
    track = track_of(fixes)
    if track is None:
        return None
    try:
        found = survey_track(track, corners=len(world.corners))
    except UserError:
        return None
    home, frame = LocalFrame(phone.lat_deg, phone.lon_deg), track.frame
    places = [home.to_local(*frame.to_wgs84(x, y)) for x, y, *_ in found.polygon.exterior.coords]
    said, true = np.array(ring := tuple(ccw(places)[:-1])), np.array(world.corners)
    off = np.roll(said, -corner_like(world.corners, 0, ring), axis=0) - true
    area = shapely.Polygon(said).area / shapely.Polygon(true).area - 1
    return Walked(off - off.mean(axis=0), float(area), found.sigma_m)


def table(seeds: Iterable[int]) -> Iterable[str]:
    """A heading, then a line for each phone and number of laps."""
    yield (
        "CEP m | laps | smoothing, lag s | velocities | none of | corner rms, p95 m | "
        "area median, p95 % | sigma m, median | normalised, mean"
    )
    seeds = list(seeds)
    for (smoothing, lag), cep, laps in itertools.product(FILTERS, (0.5, 1.0, 2.5), (1, 2, 3)):
        for velocities in (False, True):
            tried = [walked(seed, cep, laps, smoothing, lag, velocities) for seed in seeds]
            got = [walk for walk in tried if walk is not None]
            away = np.hypot(*np.concatenate([walk.off for walk in got]).T)
            area = 100 * np.abs([walk.area for walk in got])
            sigma = np.median([walk.sigma_m for walk in got])
            yield (
                f"{cep:g} | {laps} | {smoothing:g}, {lag:g} | {'yes' if velocities else 'no'} | "
                f"{len(tried) - len(got)} | {math.sqrt(np.mean(away**2)):.2f}, "
                f"{np.percentile(away, 95):.2f} | {np.median(area):.1f}, "
                f"{np.percentile(area, 95):.1f} | {sigma:.2f} | "
                f"{np.mean([walk.normalised for walk in got]):.2f}"
            )


def main() -> None:
    """The table of all seeds, or of some."""
    parser = argparse.ArgumentParser(description=__doc__)
    ends = (SEEDS[0], SEEDS[-1])
    parser.add_argument("--seeds", nargs=2, type=int, default=ends, metavar=("FIRST", "LAST"))
    first, last = parser.parse_args().seeds
    for line in table(range(first, last + 1)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
