"""Model and detector on the same pictures, situation by situation: where the model says other
things than the detector does, whatever comes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from hil.bench.model_eyes import edge_of, zone_of
from hil.studies.eye_fit import WRONG_M, about_of
from host.estimate.crop_ahead import CONFIDENT, END_CLEAR_M
from host.vision.view import NAN

Columns = dict[str, NDArray[Any]]

LEAST: Final = 30
"""Pictures of a situation, below which it is not spoken of."""
WAYS: Final = (
    "edge along the way",
    "border slants left ahead",
    "border slants right ahead",
    "border that ends",
    "no right end",
)


@dataclass(frozen=True, slots=True)
class Said:
    """What one of them says of one situation; shares of its pictures."""

    sure: float
    wrong: float
    """Sure of an edge, and wrong by more than WRONG_M."""
    off_m: tuple[float, float, float]
    """Of sure edges: 10, 50 and 90 % of how far left of the true one they are said to lie. Where
    the border slants, the true one is where the perfect eye has it end (hil/bench/sight.py)."""
    clear: float
    """Sure that nothing stands before the blade."""


@dataclass(frozen=True, slots=True)
class Compared:
    """What both say of one situation."""

    mount: str
    situation: str
    pictures: int
    detector: Said
    model: Said


def situation(ahead_m: float, depth_m: float, right_m: float, slope: float) -> str:
    """In words: what is before the blade, and where its border runs."""
    zone = zone_of(ahead_m, depth_m)
    if zone == 4:
        return "clear ground"
    where = "in the crop" if zone < 2 else "before the crop"
    return f"{where}: {WAYS[edge_of(right_m, slope)]}"


def compared(paths: Sequence[Path]) -> list[Compared]:
    """Of drives by both eyes (`hil.studies.eye_fit.drive`)."""
    parts: dict[tuple[str, str], list[Columns]] = {}
    for path in paths:
        about, table = about_of(path), pq.read_table(path)
        c = {name: table.column(name).to_numpy() for name in table.schema.names}
        expected = -(about["blade_width_m"] / 2 - about["overlap_m"])
        c["true_m"] = c["read_right_m"] - expected
        where = zip(c["ahead_m"], c["depth_m"], c["right_m"], c["slope"], strict=True)
        named = np.array([situation(*row) for row in where])
        for name in dict.fromkeys(named.tolist()):
            rows = {key: column[named == name] for key, column in c.items()}
            parts.setdefault((about["mount"], name), []).append(rows)
    joined = {
        key: {name: np.concatenate([part[name] for part in of]) for name in of[0]}
        for key, of in sorted(parts.items())
    }
    return [
        Compared(*key, len(c["true_m"]), _said(c, ""), _said(c, "model_"))
        for key, c in joined.items()
        if len(c["true_m"]) >= LEAST
    ]


def _said(c: Columns, prefix: str) -> Said:
    sure = c[f"{prefix}confidence"] >= CONFIDENT
    off = c[f"{prefix}edge_offset_m"] - c["true_m"]
    wrong = sure & ~(np.abs(off) <= WRONG_M)
    ahead = c[f"{prefix}ahead_confidence"] >= CONFIDENT
    clear = ahead & (c[f"{prefix}crop_ahead_m"] >= END_CLEAR_M)
    known = off[sure & np.isfinite(off)]
    low, middle, high = np.quantile(known, (0.1, 0.5, 0.9)) if known.size else (NAN, NAN, NAN)
    off_m = (float(low), float(middle), float(high))
    return Said(float(sure.mean()), float(wrong.mean()), off_m, float(clear.mean()))
