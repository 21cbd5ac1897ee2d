"""How far a found edge is from a labelled one, with the meanings of the labelled set."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.input_file import check_input
from host.vision.photo.split import SIDES, Side
from host.vision.pictures import Picture, read_photo, u8

Standing = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Labelled:
    """One labelled photograph."""

    name: str
    scene: str
    side: Side
    single_transition_rows: float
    """Share of the rows with exactly one change between standing and cut."""
    photo: Path
    mask: Path

    @property
    def lateral(self) -> bool:
        """The lateral error means something: crop left or right, one edge in most rows."""
        return self.side in ("left", "right") and self.single_transition_rows > 0.6

    def picture(self) -> Picture:
        return read_photo(self.photo)

    def standing(self) -> Standing:
        return read_photo(self.mask)[..., 0] < 128


def labelled_set(folder: Path) -> list[Labelled]:
    """The photographs of a labelled folder (manifest.csv, images/, masks/), doubtful labels left
    out."""
    manifest = folder / "manifest.csv"
    check_input(manifest, "the manifest", once=False)
    try:
        with manifest.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except OSError as error:
        raise UserError(
            f"{manifest}: cannot be read ({error.strerror}); name the data folder"
        ) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{manifest}: it is no CSV file ({error})") from error
    found = []
    for number, row in enumerate(rows, start=2):
        try:
            name, side = row["file"], row["standing_side"]
            item = Labelled(
                name,
                str(int(row["scene"])),
                SIDES[SIDES.index(side)],
                float(row["single_transition_rows"]),
                folder / "images" / f"{name}.jpg",
                folder / "masks" / f"{name}.png",
            )
        except (KeyError, ValueError, TypeError) as error:
            raise UserError(
                f"{manifest}: line {number} is not a labelled photograph ({error})"
            ) from error
        if row.get("label") != "doubtful":
            found.append(item)
    return found


def miou(true: Standing, found: Standing) -> float:
    """Mean of the intersections over unions of standing and of cut."""
    both = []
    for a, b in ((true, found), (~true, ~found)):
        union = int((a | b).sum())
        both.append(int((a & b).sum()) / union if union else 1.0)
    return float(np.mean(both))


def lateral_error(true: Standing, found: Standing) -> float:
    """The area between the true and the found edge per row, as a share of the width, over the rows
    in which the truth has exactly one edge; NaN where no row has."""
    single = (true[:, 1:] != true[:, :-1]).sum(1) == 1
    if not single.any():
        return math.nan
    return float((true[single] != found[single]).mean())


def heading_error_deg(true: Standing, found: Standing, side: Side) -> float:
    """Angle between the lines through the true and the found edge, 0..90; NaN without one."""
    a, b = edge_direction(true, side), edge_direction(found, side)
    if a is None or b is None:
        return math.nan
    return math.degrees(math.acos(min(1.0, abs(float(a @ b)))))


def edge_direction(standing: Standing, side: Side) -> NDArray[np.float64] | None:
    """Unit direction of the least-squares line through the edge."""
    points = edge_of(standing, side).astype(np.float64)
    if len(points) < 2:
        return None
    _, _, axes = np.linalg.svd(points - points.mean(0), full_matrices=False)
    return np.asarray(axes[0])


def edge_of(standing: Standing, side: Side) -> NDArray[np.float32]:
    """(n, 2) points (u, v) where a mask changes for the first time, one per row (crop left or
    right; from top to bottom) or per column (crop above or below; from left to right)."""
    mask = standing.view(np.uint8)
    mask = mask if side in ("left", "right") else u8(cv2.transpose(mask))
    first = (mask != mask[:, :1]).argmax(1)
    rows = np.flatnonzero(first)
    at = first[rows].astype(np.float64)
    points = np.column_stack([at, rows + 0.5])
    if side in ("top", "bottom"):
        points = points[:, ::-1]
    return np.ascontiguousarray(points, dtype=np.float32)
