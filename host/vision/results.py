"""What the vision found, as files; and what a person has noted of photographs."""

from __future__ import annotations

import csv
import itertools
import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.whole_file import saved
from host.vision.photo.split import SIDES, Side
from host.vision.pictures import Picture, write_picture
from host.vision.view import CropView


def own_name(name: str, taken: set[str]) -> str:
    """The name under which a picture's results are written: of a second picture of the same name,
    as two folders of a phone have them, NAME-2. It is taken from now on."""
    numbered = (f"{name}-{number}" for number in itertools.count(2))
    own = name if name not in taken else next(each for each in numbered if each not in taken)
    taken.add(own)
    return own


def read_sides(manifest: Path) -> dict[str, Side]:
    """Standing side by file name without suffix, from a CSV with columns file, standing_side."""
    check_input(manifest, "the manifest")
    try:
        with manifest.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{manifest}: cannot be read ({error}); give a CSV file") from error
    sides: dict[str, Side] = {}
    for number, row in enumerate(rows, start=2):
        if not row.get("file") or row.get("standing_side") not in SIDES:
            raise UserError(
                f"{manifest}: line {number} needs the columns file and standing_side "
                f"({', '.join(SIDES)})"
            )
        sides[Path(row["file"]).stem] = row["standing_side"]  # type: ignore[assignment]
    return sides


def heading_deg(edge: NDArray[np.float32] | None) -> float:
    """Direction of an edge in the picture, degrees in (-90, 90] from upright, positive where its
    upper end leans to the right; NaN below two points."""
    if edge is None or len(edge) < 2:
        return math.nan
    centred = edge - edge.mean(0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    du, dv = axes[0]
    return float((math.degrees(math.atan2(du, -dv)) + 90.0) % 180.0 - 90.0)


def write_result(folder: Path, name: str, bgr: Picture, view: CropView, ms: float) -> None:
    """NAME.mask.png (255 = cut, 0 = standing) and NAME.json."""
    h, w = bgr.shape[:2]
    standing = view.standing if view.standing is not None else np.zeros((h, w), np.bool_)
    write_picture(folder / f"{name}.mask.png", np.where(standing, 0, 255).astype(np.uint8))
    edge = view.edge_px if view.edge_px is not None else np.zeros((0, 2), np.float32)
    heading = heading_deg(edge)
    record = {
        "edge_px": [[round(float(u), 2), round(float(v), 2)] for u, v in edge],
        "heading_deg": round(heading, 3) if math.isfinite(heading) else None,
        "confidence": round(view.confidence, 4),
        "reason": view.reason,
        "ms": round(ms, 3),
    }
    with saved(folder / f"{name}.json", sync=False) as fresh:
        fresh.write_text(json.dumps(record) + "\n", encoding="utf-8")
