"""Prints the table of docs/use/survey/README.md in half a minute:
`python docs/use/survey/figures.py`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import shapely
from shapely.affinity import translate

from host.field.survey import survey_track
from sim_plant.gnss import GnssSpec

sys.path.insert(0, str(Path(__file__).parents[3]))

from tests.helpers.walker import around, walk
from tests.host.field.test_survey import SHAPES, in_field, iou, tracked

WALKS = 6
"""Of each shape."""


def main() -> None:
    """One line for each quality of the phone and number of laps."""
    print("CEP m | laps | miscounted | area error, median, p95 | place m | overlap, median, worst")
    for cep in (0.5, 2.5):
        for laps in (1, 3):
            rows = []
            for corners in SHAPES.values():
                truth = shapely.Polygon(corners)
                for seed in range(WALKS):
                    lines = walk(around(corners, laps), GnssSpec(cep_m=cep), seed)
                    found = survey_track(tracked(lines))
                    field = in_field(found)
                    dx = field.centroid.x - truth.centroid.x
                    dy = field.centroid.y - truth.centroid.y
                    rows.append(
                        (
                            found.corners != len(corners),
                            abs(field.area / truth.area - 1),
                            np.hypot(dx, dy),
                            iou(translate(field, -dx, -dy), truth),
                        )
                    )
            wrong, area, place, overlap = np.array(rows, dtype=float).T
            print(
                f"{cep} | {laps} | {wrong.sum():.0f} of {len(rows)} | "
                f"{100 * np.median(area):.1f} %, {100 * np.percentile(area, 95):.1f} % | "
                f"{np.median(place):.1f} | {np.median(overlap):.3f}, {overlap.min():.2f}"
            )


if __name__ == "__main__":
    main()
