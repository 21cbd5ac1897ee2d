"""What a wrong belief does: one small field, harvested with one thing of the world other than the
host was told. Everything not named is exact, so that a row shows what its own error does."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.table import Table

from hil.bench.harvest import harvest
from hil.judge.figures import MARKS
from hil.scenario.scenario import Scenario, load, merge
from host.field.boundary_file import UNKNOWN_SIGMA_M

SIZE_M: Final = (9.0, 7.0)
"""Not a square: to be at another corner than said makes a difference."""
SEED: Final = 7
"""Of the world and of the wrong corners."""
LIMIT_S: Final = 900.0
"""Of one run."""
FIGURES: Final = ("neighbour_cut_m2", "outside_m", "coverage", "outcome", "reason")


def _ring(*, longer: float = 0.0, wider: float = 0.0) -> list[list[float]]:
    width, height = SIZE_M[0] + wider, SIZE_M[1] + longer
    return [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]


def _scattered(sigma_m: float) -> list[list[float]]:
    off = np.random.default_rng(SEED).normal(0, sigma_m, (4, 2))
    return [[float(v) for v in corner] for corner in np.array(_ring()) + off]


def _rotated(degrees: float) -> list[list[float]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    ring = np.array(_ring()) @ np.array([[c, s], [-s, c]])
    return [[float(v) for v in corner] for corner in ring]


def _mount(**off: float) -> dict[str, Any]:
    true = {"pitch_deg": 28.0, "yaw_deg": 0.0, "roll_deg": 0.0, "z_m": 1.6}
    return {"lens": {name: true[name] + value for name, value in off.items()}, "belief": _SAID}


_SAID: Final[dict[str, Any]] = {
    "vehicle": {
        "mounts": {"mast": {"z_m": 1.6, "pitch_deg": 28.0, "yaw_deg": 0.0, "roll_deg": 0.0}},
        "hall_pulses_per_m": 50.0,
        "wheelbase_m": 1.0,
        "camera_delay_s": 0.1,
    },
    "gap_m": 2.0,
    "parameters": {"pot_centre": 512.0, "pot_left": 737.0, "pot_right": 287.0},
}
"""What the host is told where the world is another."""


def _hall(pulses_per_m: float) -> dict[str, Any]:
    return {"machine": {"drive": {"hall_pulses_per_m": pulses_per_m}}, "belief": _SAID}


def _pot(degrees: float) -> dict[str, Any]:
    off = {"steering": {"pot_centre_counts": 512.0 + 4.5 * degrees}}
    return {"machine": off, "belief": _SAID}


def _gap(true_m: float, said_m: float) -> dict[str, Any]:
    return {"field": {"gap_m": true_m}, "belief": {"gap_m": said_m}}


def _boundary(ring: list[list[float]], sigma_m: float = UNKNOWN_SIGMA_M) -> dict[str, Any]:
    """As a file has it that does not say how surely its corners are known."""
    return {"belief": {"boundary": ring, "corner": 1, "boundary_sigma_m": sigma_m}}


CASES: Final[Mapping[str, dict[str, Any]]] = {
    "exact": {},
    "mount 1.5 deg, 5 cm": _mount(pitch_deg=1.5, yaw_deg=1.5, z_m=0.05),
    "mount yaw 2 deg": _mount(yaw_deg=2.0),
    "wheelbase 5 %": {"machine": {"wheelbase_m": 1.05}, "belief": _SAID},
    "hall 5 %": _hall(52.5),
    "hall loses a tenth": _hall(45.0),
    "hall loses a fifth": _hall(40.0),
    "hall loses three tenths": _hall(35.0),
    "hall loses half": _hall(25.0),
    "hall doubled": _hall(100.0),
    "pot 4 deg": _pot(4.0),
    "corners 0.5 m": _boundary(_scattered(0.5)),
    "corners 1.0 m": _boundary(_scattered(1.0)),
    "said 2 m longer": _boundary(_ring(longer=2.0)),
    "said 3 m longer": _boundary(_ring(longer=3.0)),
    "said 2 m wider": _boundary(_ring(wider=2.0)),
    "said 2 m longer, surely": _boundary(_ring(longer=2.0), 0.0),
    "said 2 m short, surely": _boundary(_ring(longer=-2.0), 0.0),
    "said 1 m short": _boundary(_ring(longer=-1.0)),
    "said 2 m short": _boundary(_ring(longer=-2.0)),
    "said 3 m short": _boundary(_ring(longer=-3.0)),
    "rotated 5 deg": _boundary(_rotated(5.0)),
    "at another corner": {"belief": {"corner": 0}},
    "the wrong way round": {"start": {"heading_error_deg": 180.0}},
    "gap 1.2, said 2": _gap(1.2, 2.0),
    "gap 1.5, said 2": _gap(1.5, 2.0),
    "gap 2.5, said 2": _gap(2.5, 2.0),
    "gap 1.0": _gap(1.0, 1.0),
    "delay 0.3, said 0.1": {"lens": {"delay_s": 0.3}, "belief": _SAID},
    "a little of all": {
        "lens": {"pitch_deg": 28.8, "yaw_deg": 0.8, "z_m": 1.63, "hfov_deg": 63.0},
        "machine": {
            "wheelbase_m": 1.02,
            "drive": {"hall_pulses_per_m": 51.0},
            "steering": {"pot_centre_counts": 516.0},
        },
        "field": {"gap_m": 1.8},
        "belief": merge(
            _SAID,
            {
                "boundary": _scattered(0.5),
                "boundary_sigma_m": UNKNOWN_SIGMA_M,
                "corner": 1,
                "vehicle": {
                    "mounts": {"mast": {"hfov_deg": 62.0, "distortion": [0.0, 0.0, 0.0, 0.0, 0.0]}}
                },
            },
        ),
    },
    "as drawn by default": {"belief": {"errors": {}}},
}
"""What is otherwise than the host was told, by name."""


def scenario_of(case: str, eyes: str = "picture", firmware: str = "desk") -> Scenario:
    """The harvest of a case."""
    over = CASES[case]
    base: dict[str, Any] = {
        "name": case,
        "seed": SEED,
        "firmware": firmware,
        "eyes": eyes,
        "field": {"size_m": list(SIZE_M), "gap_m": 2.0, "neighbour_depth_m": 4.0},
        "limits": {"time_s": LIMIT_S},
        "record": {"film": False, "pictures_every": 0},
    }
    if case == "as drawn by default":
        return load("default", base)
    return load("default", merge(merge(base, {"belief": "exact"}), over))


def slug(case: str) -> str:
    """A case's name as a folder's."""
    return "".join(c if c.isalnum() or c == "." else "-" for c in case).strip("-")


def run(
    cases: Iterable[str],
    out: Path,
    eyes: str,
    firmware: str,
    done: Callable[[dict[str, Any]], None] | None = None,
) -> list[dict[str, Any]]:
    """Harvests each case into its folder; its rows, which beliefs.json keeps too."""
    rows = []
    for case in cases:
        summary = harvest(scenario_of(case, eyes, firmware), out / slug(case))
        row = {"belief": case} | {name: summary[name] for name in FIGURES}
        rows.append(row)
        if done is not None:
            done(row)
    out.mkdir(parents=True, exist_ok=True)
    (out / "beliefs.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return rows


def harmless(row: Mapping[str, Any]) -> bool:
    """Whether nobody else's crop was cut and the machine stayed where it is permitted."""
    return all(MARKS[key].holds(row[key]) for key in ("neighbour_cut_m2", "outside_m"))


def table_of(rows: Iterable[Mapping[str, Any]]) -> Table:
    """For a terminal."""
    table = Table("belief", "neighbour cut m2", "outside m", "coverage", "end")
    for row in rows:
        style = "" if harmless(row) else "red"
        end = f"{row['outcome']}: {row['reason']}"
        figures = [f"{row[name]:.3g}" for name in FIGURES[:3]]
        table.add_row(str(row["belief"]), *figures, end, style=style)
    return table
