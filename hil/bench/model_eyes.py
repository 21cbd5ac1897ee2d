"""Eyes without pictures: the detector's answer drawn from the world's geometry.

The answer is the perfect eye's (`hil.bench.sight`) with an error that the real detector once made
in a like situation, and the errors that followed it there: a bootstrap of blocks (Künsch 1989) of
measured answers, matched to the situation. So bias, correlation along the way, dust's pull, gaps,
false and late ends are what was measured, together, and no distribution is assumed. The library of
answers comes from harvests with pictures: `daranti-hil eyes fit`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.parquet as pq
from numba import njit
from numpy.typing import NDArray

from hil.bench.eyes import PerfectEye
from hil.bench.lockstep import Bench
from hil.bench.sight import CUTTING_M, Sight
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.sensors.jpeg import NOTHING, Bgr
from host.vision.mounted.before_lens import HIDES
from host.vision.view import NAN, CropView
from sim_plant.camera import CameraSpec

LIBRARY: Final = Path(__file__).with_name("eye_errors.parquet")

ZONES_M: Final = (CUTTING_M, 1.0, 2.5)
"""Distances ahead at which the situation becomes another."""
LAST_M: Final = 0.8
"""Of the crop that is being cut: no full window of its edge is left."""
LIES: Final = 0.3
"""Crop that is flatter at its face (`Sight.lying`) shows few stems."""
SLANT: Final = 0.25
"""Of the right end, left per metre ahead: no edge along the way any more."""
MOVING_MPS: Final = 0.05
"""Slower is standing still: the rows of a drive differ from those of a halt."""
NEXT_S: Final = 0.16
"""Between pictures that follow each other in the library."""
BLOCK: Final = 60
"""Pictures, on average, after which a block is left for another though it fits still: 3 m."""
KEPT_M: Final = (0.3, 0.4)
"""A block's distance ahead and depth may differ from the world's by so much."""
NEAREST: Final = 8
"""One of so many likest situations is taken."""
TRIED: Final = 1500
"""Rows of which the likest are chosen, evenly spread over all."""
SINCE: Final = 12
"""Pictures since the situation began, at most, that are told apart."""
DONOR: Final = 1.0
"""How much a run prefers some drives of the library over others: what its field does to every
picture, it does for good."""

COLUMNS: Final = (
    "drive", "stamp_s", "ahead_m", "depth_m", "right_m", "slope", "density", "lying", "speed_mps",
    "blade", "fresh", "read_ahead_m", "read_right_m", "read_beside_m", "confidence",
    "edge_offset_m", "edge_beside_m", "edge_ahead_m",
    "crop_ahead_m", "ahead_by_height_m", "ahead_confidence", "lies_confidence", "tip_share",
    "hidden", "usable", "reason",
)  # fmt: skip
"""Of the library; truths first, then the answer."""

# Of a situation, and what a difference of one counts for: dust in the air, depth, distance ahead,
# pictures since it began, the answer before (its kind, its error), density, the angle of the slope,
# place of the right end and of what stands beside the way, how flat the crop's face lies,
# crop height, cloud, hour, drilled.
SCALES: Final = np.array(
    [0.1, 0.3, 0.15, 4.0, 0.6, 0.03, 0.25, 0.2, 0.05, 0.3, 0.15, 0.15, 1.0, 5.0, 2.0], np.float32
)
FEATURES: Final = len(SCALES)

FAR_BESIDE_M: Final = 2.5
"""Stands for nothing beside the way: farther left than anything is."""

NO_RIGHT_END: Final = "the crop ahead has no clear right end"

DERIVED_FROM: Final = (
    "stamp_s", "ahead_m", "depth_m", "right_m", "slope", "density", "lying", "speed_mps",
    "read_right_m", "read_beside_m", "confidence", "edge_offset_m", "edge_beside_m", "crop_ahead_m",
    "ahead_confidence",
)  # fmt: skip
"""Numbers from which a library's situations are made out."""

Cell = tuple[int, int, int, int, int]
"""Of a situation: zone, whether the crop's face lies, whether the blade spins, whether the
machine moves, whether the detector was restarted."""


@njit(cache=True, nogil=True)
def _kind(sure: bool, clear: bool, ahead_sure: bool) -> int:
    """Of an answer: whether the edge is sure, the way clear, and what is ahead sure."""
    if clear:
        return 3 if ahead_sure else 4
    return 0 if sure else 1 if ahead_sure else 2


@njit(cache=True, nogil=True)
def zone_of(ahead_m: float, depth_m: float) -> int:
    """0 in the crop, 1 in its last, 2 and 3 before it, 4 without."""
    if ahead_m < CUTTING_M:
        return 0 if depth_m >= LAST_M else 1
    return 2 if ahead_m < ZONES_M[1] else 3 if ahead_m < ZONES_M[2] else 4


ALONG, SLANTS_LEFT, SLANTS_RIGHT, ENDS, NONE, ACROSS = range(6)
"""What the face's right end is: an edge along the way, a border that slants to the left or to the
right ahead, one that nothing stands behind, none in view, none of a field that begins beyond clear
ground, as the next one does beyond the gap."""
FIELD_M: Final = 1.5
"""Crop that goes on for so long is a field, and no tuft."""


@njit(cache=True, nogil=True)
def edge_of(right_m: float, slope: float) -> int:
    """Which of these a right end is, by its place and slope (`Sight`)."""
    if math.isnan(right_m):
        return NONE
    if math.isnan(slope):
        return ENDS
    return ALONG if abs(slope) < SLANT else SLANTS_LEFT if slope > 0.0 else SLANTS_RIGHT


@njit(cache=True, nogil=True)
def face_of(zone: int, depth_m: float, right_m: float, slope: float) -> int:
    """The same of crop in a zone, with what stands across the whole view."""
    edge = edge_of(right_m, slope)
    return ACROSS if edge == NONE and zone in (2, 3) and depth_m >= FIELD_M else edge


@dataclass(frozen=True, slots=True)
class Air:
    """What of a scenario counts for every picture."""

    dust: float
    crop_height_m: float
    cloud: float
    hour: float
    drilled: bool

    @classmethod
    def of(cls, scenario: Scenario) -> Air:
        """Of the world of a scenario."""
        w, f = scenario.weather, scenario.field
        return cls(w.dust, f.crop_height_m, w.cloud, w.hour, f.drilled)

    def row(self) -> tuple[float, float, float, float, float]:
        """In numbers alone."""
        return self.dust, self.crop_height_m, self.cloud, self.hour, float(self.drilled)


@njit(cache=True, nogil=True)
def _likest(
    features: NDArray[np.float32],
    drives: NDArray[np.int32],
    rows: NDArray[np.int32],
    here: NDArray[np.float32],
    scales: NDArray[np.float32],
    liking: NDArray[np.float32],
    offset: int,
    stride: int,
    pick: int,
) -> int:
    """The `pick`-th likest of the rows, of at most TRIED that are `stride` apart."""
    best = np.full(NEAREST, np.float32(1e30))
    which = np.full(NEAREST, -1, np.int32)
    n = rows.shape[0]
    count = min(n, TRIED)
    for q in range(count):
        row = rows[(offset + q * stride) % n]
        d = liking[drives[row]]
        if d >= 1e9:
            continue
        for k in range(features.shape[1]):
            d += abs(features[row, k] - here[k]) / scales[k]
        if d < best[NEAREST - 1]:
            k = NEAREST - 1
            while k > 0 and best[k - 1] > d:
                best[k] = best[k - 1]
                which[k] = which[k - 1]
                k -= 1
            best[k] = d
            which[k] = row
    found = 0
    while found < NEAREST and which[found] >= 0:
        found += 1
    if found == 0:
        return -1
    return int(which[pick % found])


@njit(cache=True, nogil=True)
def _describe(
    features: NDArray[np.float32], air: NDArray[np.float64], ahead_m: float, depth_m: float,
    offset_m: float, beside_m: float, slope: float, density: float, lying: float, blade: bool,
    since: int, kind: int, error_m: float,
) -> None:  # fmt: skip
    """Writes a situation's features, in the order of SCALES."""
    features[0] = air[0] if blade else 0.0
    features[1] = 1.5 if depth_m > 1.5 else depth_m
    features[2] = 3.0 if ahead_m > 3.0 else ahead_m
    features[3] = min(since, SINCE)
    features[4] = kind
    features[5] = max(-0.3, min(0.3, error_m))
    features[6] = density
    features[7] = math.atan(slope) if math.isfinite(slope) else 0.0
    features[8] = max(-1.0, min(1.0, offset_m)) if math.isfinite(offset_m) else 0.0
    features[9] = beside_m if math.isfinite(beside_m) else FAR_BESIDE_M
    features[10] = lying
    features[11:] = air[1:]


@njit(cache=True, nogil=True)
def _derived(
    air: NDArray[np.float64], ahead_m: NDArray[np.float64], depth_m: NDArray[np.float64],
    right_m: NDArray[np.float64], slope: NDArray[np.float64], density: NDArray[np.float64],
    lying: NDArray[np.float64], offset_m: NDArray[np.float64], beside_m: NDArray[np.float64],
    error_m: NDArray[np.float64],
    blade: NDArray[np.bool_], moving: NDArray[np.bool_], fresh: NDArray[np.bool_],
    follows: NDArray[np.bool_], sure: NDArray[np.bool_], clear: NDArray[np.bool_],
    ahead_sure: NDArray[np.bool_],
) -> tuple[NDArray[np.int8], NDArray[np.int8], NDArray[np.float32]]:  # fmt: skip
    """Of rows, one after the other: (n, 6) cell and edge, (n,) kind, (n, FEATURES)."""
    n = ahead_m.shape[0]
    cells = np.empty((n, 6), np.int8)
    kinds = np.empty(n, np.int8)
    features = np.empty((n, FEATURES), np.float32)
    before_kind, before_error, since = 0, 0.0, 0
    for k in range(n):
        zone = zone_of(ahead_m[k], depth_m[k])
        cells[k, 0], cells[k, 1] = zone, lying[k] >= LIES
        cells[k, 2], cells[k, 3], cells[k, 4] = blade[k], moving[k], fresh[k]
        cells[k, 5] = face_of(zone, depth_m[k], right_m[k], slope[k])
        kinds[k] = _kind(sure[k], clear[k], ahead_sure[k])
        if not follows[k]:
            before_kind, before_error, since = 0, 0.0, 0
        elif (cells[k, :5] == cells[k - 1, :5]).all():
            since += 1
        else:
            since = 0
        _describe(
            features[k], air[k], ahead_m[k], depth_m[k], offset_m[k], beside_m[k], slope[k],
            density[k], lying[k], blade[k], since, before_kind, before_error,
        )  # fmt: skip
        before_kind = int(kinds[k])
        if math.isfinite(error_m[k]):
            before_error = error_m[k]
    return cells, kinds, features


class Library:
    """Answers of the real detector with what was true: one row a picture, drive after drive."""

    def __init__(self, columns: dict[str, NDArray[Any]], about: dict[str, Any]) -> None:
        self.about = about
        self.columns = columns
        # Single values are read several times as fast from lists as from arrays.
        self.values = {name: column.tolist() for name, column in columns.items()}
        self.drives: list[dict[str, Any]] = about["drives"]
        self.reasons: list[str] = about["reasons"]
        self.size = len(columns["drive"])
        self.drive = columns["drive"].astype(np.int32)
        self._prepare()

    def _prepare(self) -> None:
        """What is derived of each row, and the rows of each cell."""
        c = {name: self.columns[name].astype(np.float64) for name in DERIVED_FROM}
        self.mount = {name: k for k, name in enumerate(sorted({d["mount"] for d in self.drives}))}
        expected = [-(d["blade_width_m"] / 2 - d["overlap_m"]) for d in self.drives]
        expected_m = np.array(expected, np.float64)[self.drive]
        error_m = c["edge_offset_m"] - (c["read_right_m"] - expected_m)
        beside_m = c["read_beside_m"] - expected_m
        self.error = error_m.astype(np.float32)
        self.beside_error = (c["edge_beside_m"] - beside_m).astype(np.float32)
        between_s = np.diff(c["stamp_s"])
        self.follows = np.zeros(self.size, np.bool_)
        self.follows[1:] = (np.diff(self.drive) == 0) & (between_s > 0) & (between_s < NEXT_S)
        air = np.array([Air(**d["air"]).row() for d in self.drives], np.float64)[self.drive]
        blade, fresh = (self.columns[name].astype(np.bool_) for name in ("blade", "fresh"))
        cells, self.kind, self.features = _derived(
            air, c["ahead_m"], c["depth_m"], c["right_m"], c["slope"], c["density"], c["lying"],
            c["right_m"] - expected_m, beside_m, error_m, blade,
            np.abs(c["speed_mps"]) > MOVING_MPS, fresh, self.follows,
            c["confidence"] >= 0.5, ~(c["crop_ahead_m"] < 0.8), c["ahead_confidence"] >= 0.5,
        )  # fmt: skip
        self.zone, self.lies, self.edge = (np.ascontiguousarray(cells[:, k]) for k in (0, 1, 5))
        self.cells = self._cells(cells)

    def _cells(self, cells: NDArray[np.int8]) -> dict[tuple[int, ...], NDArray[np.int32]]:
        """Rows, in their order, by each of their keys."""
        shown = np.flatnonzero(~self.columns["hidden"].astype(np.bool_))
        mount = np.array([self.mount[d["mount"]] for d in self.drives], np.int8)[self.drive]
        columns = [mount, *cells.T]
        sizes = [int(column.max(initial=0)) + 1 for column in columns]
        alike, inverse = np.unique(
            np.ravel_multi_index([column[shown] for column in columns], sizes), return_inverse=True
        )
        situations = np.column_stack(np.unravel_index(alike, sizes)).tolist()
        order = np.argsort(inverse, kind="stable")
        ends = np.cumsum(np.bincount(inverse, minlength=len(alike)))
        found: dict[tuple[int, ...], list[NDArray[np.intp]]] = {}
        for situation, rows in zip(situations, np.split(order, ends[:-1]), strict=True):
            for key in _keys(*situation):
                found.setdefault(key, []).append(rows)
        return {
            key: shown[np.sort(np.concatenate(rows))].astype(np.int32)
            for key, rows in found.items()
        }


ZONE_ACROSS: Final = 3
"""Stands for the distances of what stands across the view."""


def _keys(
    mount: int, zone: int, lies: int, blade: int, moving: int, fresh: int, edge: int
) -> tuple[tuple[int, ...], ...]:
    """A situation's cell and those that stand in where the library has too little of it. What
    stands across the view looks alike at any distance."""
    if edge == ACROSS:
        zone = ZONE_ACROSS
    return (
        (mount, zone, lies, blade, moving, fresh, edge),
        (mount, zone, lies, blade, moving, edge),
        (mount, zone, lies, blade, edge),
        (mount, zone, lies, edge),
        (mount, zone, lies),
        (mount, zone),
        (mount,),
    )


BESIDE_SIGMA_M: Final = {"low": 0.09, "mast": 0.04}
"""Of the right end of crop that stands beside the machine's way, by the mount: where nothing stands
before the blade, the fitted drives have 0.10 and 0.05."""
UNSURE: Final = {"low": 0.9, "mast": 0.1}
"""Where an earlier strip has left some crop beside the edge, the detector is unsure of most
pictures: below this quantile of the normal distribution (20 of 24 rendered views from the low
camera, 13 from the mast)."""
LASTS: Final = 0.9
"""Correlation of that error from picture to picture."""
HIDDEN: Final = {"low": 0.8, "mast": 0.0}
"""How often the detector knows stems right before the lens for what they are, by the mount: 253 of
318 pictures of six fitted drives, 66 of 106 of three others. Its answers to them are answers to no
other situation."""
LEAST: Final = 12
"""Rows of a cell from which on it stands for itself."""


def features_of(
    air: Air, ahead_m: float, depth_m: float, offset_m: float, beside_m: float, slope: float,
    density: float, lying: float, blade: bool, since: int, kind: int, error_m: float,
) -> NDArray[np.float32]:  # fmt: skip
    """(FEATURES,) of a situation, in the order of SCALES."""
    features = np.empty(FEATURES, np.float32)
    _describe(
        features, np.array(air.row()), float(ahead_m), float(depth_m), float(offset_m),
        float(beside_m), float(slope), float(density), float(lying), bool(blade), int(since),
        int(kind), float(error_m),
    )  # fmt: skip
    return features


def read_as(seen_m: float, was_m: float, here_m: float) -> float:
    """How far ahead crop is read that stands here_m ahead, by an answer that read seen_m where it
    stood was_m ahead (here_m may be infinite). What stood in its way, dust or swath, stands there
    still: it does not come nearer with the crop."""
    if not math.isfinite(here_m):
        return seen_m
    return max(0.0, here_m + seen_m - was_m, min(here_m, seen_m) if seen_m < was_m else 0.0)


@cache
def library(path: Path = LIBRARY) -> Library:
    """The library in a file. UserError where there is none."""
    try:
        table = pq.read_table(path)
        about = json.loads((table.schema.metadata or {})[b"daranti"])
        columns = {name: table.column(name).to_numpy() for name in COLUMNS}
    except (OSError, ValueError, KeyError) as error:
        why = f"it lacks {error}" if isinstance(error, KeyError) else error
        raise UserError(
            f"no library of the detector's errors in {path} ({why}): make one with "
            "`daranti-hil eyes fit`"
        ) from error
    return Library(columns, about)


# ---- the eyes ------------------------------------------------------------------------------------


class ModelEyes:
    """In place of the camera: a picture is the number of its shot, and what was true then."""

    takes_pictures = False

    def __init__(
        self, bench: Bench, errors: Library | None = None, without: Collection[str] = ()
    ) -> None:
        """`without`: drives of the library that are not used, by their names."""
        scenario = bench.scenario
        if any(
            f.component in ("camera", "phone") and f.failure == "wrong" for f in scenario.faults
        ):
            raise UserError(
                "model eyes know nothing of pictures that show something else: use --eyes picture"
            )
        self._bench = bench
        self._library = errors or library()
        if scenario.camera not in self._library.mount:
            known = ", ".join(sorted(self._library.mount))
            raise UserError(
                f"the library of the detector's errors knows no mount {scenario.camera!r}, only "
                f"{known}: use --eyes picture"
            )
        if scenario.mode != self._library.about["mode"]:
            raise UserError(
                f"the library of errors is the {self._library.about['mode']} detector's, not the "
                f"{scenario.mode} one's: use --eyes picture"
            )
        self._eye = PerfectEye(bench)
        self._without = frozenset(without)
        self._shots: dict[int, Sight] = {}
        self._count = 0

    def shutter(self) -> int:
        """The number of the shot."""
        self._count += 1
        self._shots[self._count] = self._eye.sight()
        self._shots.pop(self._count - 100, None)
        return self._count

    def knock(self, lens: CameraSpec) -> None:
        """It is misread as pictures of this camera would be, from now on."""
        self._eye.knock(lens)

    def develop(self, shot: int) -> tuple[bytes, Bgr]:
        """Six bytes for a file, two pixels for a picture."""
        data = shot.to_bytes(6, "little")
        return data, self.decode(data)

    def decode(self, data: bytes) -> Bgr:
        """The two pixels, or none of a file that was spoiled."""
        return np.frombuffer(data, np.uint8).reshape(1, 2, 3) if len(data) == 6 else NOTHING

    def sight(self, bgr: Bgr) -> tuple[int, Sight | None]:
        """What was true of a picture, and its number."""
        number = int.from_bytes(bgr.tobytes(), "little")
        return number, self._shots.get(number)

    def detector(self) -> ModelDetector:
        """A new one; the same answers to the same pictures."""
        return ModelDetector(self, self._bench.scenario, self._library, self._without)


class ModelDetector:
    """A `host.vision.view.Detector` that draws its answers."""

    def __init__(
        self, eyes: ModelEyes, scenario: Scenario, errors: Library, without: Collection[str] = ()
    ) -> None:
        self._eyes = eyes
        self._library = errors
        self._air = Air.of(scenario)
        self._mount = errors.mount[scenario.camera]
        v = scenario.vehicle
        self._expected_m = -(v.blade_width_m / 2 - v.overlap_m)
        self._rng = np.random.default_rng([scenario.seed, 0xE7E5])
        liking = DONOR * self._rng.exponential(size=len(errors.drives))
        liking[[d["name"] in without for d in errors.drives]] = 1e9
        self._liking = liking.astype(np.float32)
        self._row = -1
        self._kind, self._error = 0, 0.0
        self._since = 0
        self._cell: Cell = (-1, 0, 0, 0, 0)
        self._fresh = True
        self._number = -1
        self._camera = scenario.camera
        self._aside, self._aside_sigma_m = 0.0, BESIDE_SIGMA_M[scenario.camera]

    def see(self, bgr: Bgr, *, stages: bool = False) -> CropView:
        """The perfect eye's answer with a measured error."""
        del stages
        number, sight = self._eyes.sight(bgr)
        fresh, self._fresh = self._fresh, False
        if sight is None:
            reason = "the camera's picture is broken: its file is damaged"
            return CropView(0.0, usable=False, reason=reason)
        if number == self._number:
            return CropView(0.0, usable=False, reason="the camera repeats its picture")
        self._number = number
        return self._answer(sight, fresh)

    def glance(self, bgr: Bgr) -> CropView:
        """Nothing is measured."""
        number, sight = self._eyes.sight(bgr)
        usable = sight is not None and number != self._number
        self._number = number
        self._row = -1
        reason = "not looked at: it turns" if usable else "the camera repeats its picture"
        return CropView(0.0, usable=usable, reason=reason)

    def next_crop(self, gap_m: float) -> None:
        """What the fitted drives believed of the gap stays."""

    def restart(self, *, turned: bool = True) -> None:
        """As the detector's, whose next answer is without memory."""
        del turned
        self._fresh = True

    def _answer(self, sight: Sight, fresh: bool) -> CropView:
        errors = self._library
        if sight.before_lens and self._rng.random() < HIDDEN[self._camera]:
            self._row = -1
            return CropView(0.0, hidden=True, reason=HIDES)
        zone = zone_of(sight.ahead_m, sight.depth_m)
        edge = face_of(zone, sight.depth_m, sight.right_m, sight.slope)
        moving = abs(sight.speed_mps) > MOVING_MPS
        lies = sight.lying >= LIES
        cell = (zone, int(lies), int(sight.blade), int(moving), int(fresh))
        known = self._row >= 0
        self._since = self._since + 1 if known and cell == self._cell else 0
        if not known:
            self._kind, self._error = 0, 0.0
        self._cell = cell
        row = self._row + 1
        goes_on = known and row < errors.size and self._fits(row, sight, cell, edge)
        if not goes_on or self._rng.random() < 1.0 / BLOCK:
            row = self._draw(sight, cell, edge)
        self._row = row
        return self._view(row, sight, edge)

    def _beside(self, row: int, sight: Sight) -> float:
        """What it shows beside the machine's way: as in a like situation, or where nothing stood
        there, by the rule of BESIDE_SIGMA_M, with an error that lasts for a second."""
        fresh = math.sqrt(1.0 - LASTS**2) * self._rng.standard_normal()
        self._aside = LASTS * self._aside + self._aside_sigma_m * fresh
        errors, true_m = self._library, sight.read_beside_m - self._expected_m
        known = math.isfinite(errors.values["read_beside_m"][row])
        if math.isnan(true_m):
            return NAN if known else float(errors.values["edge_beside_m"][row])
        return true_m + (float(errors.beside_error[row]) if known else self._aside)

    def _fits(self, row: int, sight: Sight, cell: Cell, edge: int) -> bool:
        errors, c = self._library, self._library.values
        zone, lies, blade, moving, fresh = cell
        across, beside_m = edge == ACROSS, sight.read_beside_m
        return bool(
            errors.follows[row]
            and not c["hidden"][row]
            and (errors.zone[row] == zone or across)
            and errors.lies[row] == lies
            and errors.edge[row] == edge
            and bool(c["blade"][row]) == bool(blade)
            and bool(c["fresh"][row]) == bool(fresh)
            and (abs(c["speed_mps"][row]) > MOVING_MPS) == bool(moving)
            and (zone not in (2, 3) or across or abs(c["ahead_m"][row] - sight.ahead_m) < KEPT_M[0])
            and (zone != 1 or abs(c["depth_m"][row] - sight.depth_m) < KEPT_M[1])
            and (zone != 4 or math.isnan(c["read_beside_m"][row]) == math.isnan(beside_m))
        )

    def _draw(self, sight: Sight, cell: Cell, edge: int) -> int:
        errors = self._library
        here = features_of(
            self._air, sight.ahead_m, sight.depth_m, sight.right_m - self._expected_m,
            sight.read_beside_m - self._expected_m, sight.slope, sight.density, sight.lying,
            sight.blade, self._since, self._kind, self._error,
        )  # fmt: skip
        offset, pick = (int(k) for k in self._rng.integers(1 << 30, size=2))
        for key in _keys(self._mount, *cell, edge):
            rows = errors.cells.get(key)
            if rows is None or len(rows) < LEAST:
                continue
            stride = max(1, len(rows) // TRIED)
            found = _likest(
                errors.features, errors.drive, rows, here, SCALES, self._liking, offset, stride,
                pick,
            )  # fmt: skip
            if found >= 0:
                return int(found)
        raise UserError("the library of the detector's errors is empty for this mount")

    def _view(self, row: int, sight: Sight, edge: int) -> CropView:
        errors, c = self._library, self._library.values
        self._kind = int(errors.kind[row])
        error = float(errors.error[row])
        offset = float(c["edge_offset_m"][row])
        if math.isfinite(error):
            self._error = error
            if edge not in (NONE, ACROSS):
                offset = sight.read_right_m - self._expected_m + error
        seen, was = float(c["crop_ahead_m"][row]), float(c["read_ahead_m"][row])
        ahead = seen
        if sight.ahead_m >= CUTTING_M and math.isfinite(seen) and math.isfinite(was):
            ahead = read_as(seen, was, sight.read_ahead_m)
        by_height = float(c["ahead_by_height_m"][row])
        if math.isfinite(by_height) and math.isfinite(was):
            by_height = read_as(by_height, was, sight.read_ahead_m)
        beyond = float(c["edge_ahead_m"][row])
        if math.isfinite(seen) and math.isfinite(ahead):
            beyond = max(0.0, beyond + ahead - seen)
        sure = math.isfinite(offset)
        confidence = float(c["confidence"][row]) if sure else 0.0
        if sight.remnant and self._aside < UNSURE[self._camera] * self._aside_sigma_m:
            confidence *= 0.5
        return CropView(
            confidence,
            edge_offset_m=offset,
            edge_beside_m=self._beside(row, sight),
            crop_right=sight.crop_right,
            edge_ahead_m=beyond,
            edge_heading_rad=NAN,
            crop_ahead_m=ahead,
            ahead_by_height_m=by_height,
            ahead_confidence=float(c["ahead_confidence"][row]),
            lies_confidence=float(c["lies_confidence"][row]),
            tip_share=float(c["tip_share"][row]),
            reason=errors.reasons[int(c["reason"][row])] if sure else NO_RIGHT_END,
            usable=bool(c["usable"][row]),
        )
