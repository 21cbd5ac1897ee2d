"""What the detector answers to pictures, kept for the model eyes; whether harvests by model eyes
are like harvests by pictures; and whether both eyes say the same of the same moments."""

from __future__ import annotations

import datetime
import json
import math
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy import stats

from hil.bench.both_eyes import BothEyes
from hil.bench.eyes import Eyes, WitnessedEyes
from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.bench.model_eyes import ALONG, COLUMNS, Air, Library, ModelEyes, library
from hil.bench.sight import Sight
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, changed
from host.core.errors import UserError
from host.pilot.phase import Phase
from host.vision.view import CropView

SIDE_M: Final = (4.5, 6.5)
"""Of a field that is driven both ways: as many ends as a large one in a quarter of the time."""
LIMIT_S: Final = 900.0
"""Of one field's run."""
BEGINNING_S: Final = 300.0
"""Of a random field: its first sides and their ends."""
LATE_S: Final = 900.0
"""Of a random field that the model drives while the detector looks on: half of it or more."""
LODGED: Final = (0.05, 0.2)
"""Share of crop that lies in every third field, drawn: random fields have a quarter of it, which
would teach next to nothing of crop that is met lying."""
WRONG_M: Final = 0.1
"""What `CropView.confidence` is about."""
ANSWERED: Final = ("confidence", "edge_offset_m", "crop_ahead_m", "ahead_confidence")
"""Of the model, beside what the detector answered to the same picture."""
ALPHA: Final = 0.05
"""Distributions differ where chance makes such a difference in less than this share of cases."""
EFFECT: Final = 0.3
"""And matter where Cliff's delta is greater: a small to medium effect."""


def fitting_field(seed: int, *, late: bool = False) -> Scenario:
    """What the model eyes are fitted to. Even seeds: a small rectangle with the crop, ground,
    weather and mount of the random field of that seed. Odd ones: the beginning of that field
    itself, whose slanting borders and reflex corners no rectangle has. `late`: that field, whatever
    the seed, and more of it. In every third much crop lies."""
    base = random_field(seed)
    limit_s = LATE_S if late else BEGINNING_S if seed % 2 else LIMIT_S
    changes: dict[str, Any] = {
        "name": "fitting",
        "limits": {"time_s": limit_s},
        "record": {"film": False, "pictures_every": 0},
    }
    rng = np.random.default_rng([seed, 77])
    size = tuple(round(float(rng.uniform(*SIDE_M)), 2) for _ in range(2))
    field: dict[str, Any] = {}
    if seed % 2 == 0 and not late:
        field = {"polygon": None, "size_m": size, "keep_outs": (), "trees": ()}
        changes["start"] = {"corner": base.start.corner % 4}
    if seed % 3 == 0:
        field["lodged"] = float(rng.uniform(*LODGED))
    changes["field"] = field
    return changed(base, changes)


# ---- picture drives ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Task:
    """One harvest; plain data, so that it travels."""

    seed: int
    folder: str
    eyes: str
    """Who drives: picture, model; both: the model, and the detector looks on."""
    library: str | None = None

    @property
    def path(self) -> Path:
        """Where its result is kept."""
        return Path(self.folder) / f"{self.eyes}-{self.seed:05d}.parquet"


def drive(task: Task) -> dict[str, Any]:
    """Harvests a field, or reads what an earlier run has found: figures and distributions. A
    drive by model eyes leaves out what the same field taught them."""
    if task.path.exists():
        return about_of(task.path)
    cv2.setNumThreads(1)
    taken = task.path.with_name(task.path.name.replace("model-", "picture-"))
    scenario = (
        Scenario.model_validate_json(about_of(taken)["scenario"])
        if taken.exists()
        else fitting_field(task.seed, late=task.eyes == "both")
    )
    witness: list[WitnessedEyes] = []
    answers: list[list[CropView]] = []

    def eyes(bench: Bench) -> Eyes:
        errors = library(Path(task.library)) if task.library else library()
        if task.eyes == "model":
            return ModelEyes(bench, errors, without={name_of(task.seed)})
        witness.append(WitnessedEyes(bench))
        if task.eyes == "picture":
            return witness[0]
        both = BothEyes(ModelEyes(bench, errors, without={name_of(task.seed)}), witness[0])
        answers.append(both.answers)
        return both

    run = Harvest(scenario, eyes=eyes)
    for one in witness:
        one.looks = lambda: run.pilot.looks
    try:
        run.run()
    finally:
        run.close()
    pilot, vehicle = run.pilot, scenario.vehicle
    about = {
        "name": name_of(task.seed),
        "seed": task.seed,
        "eyes": task.eyes,
        "scenario": scenario.model_dump_json(),
        "mount": scenario.camera,
        "mode": scenario.mode,
        "blade_width_m": vehicle.blade_width_m,
        "overlap_m": vehicle.overlap_m,
        "air": asdict(Air.of(scenario)),
        "outcome": pilot.phase.value if pilot.done else "broken off",
        "reason": pilot.reason,
        "simulated_s": run.bench.now,
        "hesitations": sum(t.phase is Phase.HESITATE for t in pilot.transitions),
        "lateral": [round(value, 4) for value in run.truth.lateral],
        "ends": [round(value, 4) for value in run.truth.ends],
        **run.truth.summary(),
    }
    columns = table_of(witness[0].seen if witness else [])
    for by_model in answers:
        columns |= {f"model_{name}": [getattr(v, name) for v in by_model] for name in ANSWERED}
    save(task.path, columns, about)
    return about


def name_of(seed: int) -> str:
    """Of a drive in the library."""
    return f"fitting-{seed}"


def table_of(seen: Iterable[tuple[float, Sight, CropView, bool]]) -> dict[str, list[Any]]:
    """The library's columns of one drive, `drive` left out, reasons in words."""
    rows: dict[str, list[Any]] = {name: [] for name in COLUMNS if name != "drive"}
    for stamp, sight, view, fresh in seen:
        values = {"stamp_s": stamp, "fresh": fresh}
        for name, column in rows.items():
            source = sight if hasattr(sight, name) else view
            column.append(values[name] if name in values else getattr(source, name))
    return rows


def save(path: Path, columns: dict[str, Any], about: dict[str, Any]) -> None:
    """A Parquet file with what it is about; it appears only when it is complete."""
    arrays = {
        name: pa.array(np.asarray(v, np.float32) if _is_float(v) else v)
        for name, v in columns.items()
    }
    table = pa.table(arrays).replace_schema_metadata({"daranti": json.dumps(about)})
    fresh = path.with_suffix(".part")
    pq.write_table(table, fresh, compression="zstd", compression_level=15)
    fresh.replace(path)


def _is_float(values: Any) -> bool:
    return len(values) > 0 and isinstance(values[0], float | np.floating)


def about_of(path: Path) -> dict[str, Any]:
    """What a file is about."""
    about: dict[str, Any] = json.loads((pq.read_schema(path).metadata or {})[b"daranti"])
    return about


# ---- the fit -------------------------------------------------------------------------------------


def fit(folder: Path, out: Path, today: datetime.date) -> Library:
    """Joins the drives of a folder on which the detector saw pictures into one library with its
    figures."""
    paths = sorted([*folder.glob("picture-*.parquet"), *folder.glob("both-*.parquet")])
    if not paths:
        raise UserError(f"no drive in {folder} has pictures: name some with --seeds")
    drives, parts = [], []
    reasons: list[str] = []
    kept = ("name", "seed", "mount", "mode", "blade_width_m", "overlap_m", "air")
    for k, path in enumerate(paths):
        about = about_of(path)
        drives.append({name: about[name] for name in kept})
        table = pq.read_table(path)
        part = {name: table.column(name).to_numpy() for name in COLUMNS if name != "drive"}
        words = [str(word) for word in part["reason"]]
        reasons += [word for word in dict.fromkeys(words) if word not in reasons]
        part["reason"] = np.array([reasons.index(word) for word in words], np.int16)
        part["drive"] = np.full(len(words), k, np.int16)
        parts.append(part)
    modes = {drive["mode"] for drive in drives}
    if len(modes) > 1:
        raise UserError(f"{folder} holds drives of several modes: {', '.join(sorted(modes))}")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}
    made = Library(
        columns,
        {
            "mode": modes.pop(),
            "date": today.isoformat(),
            "commit": _commit(),
            "drives": drives,
            "reasons": reasons,
        },
    )
    made.about["figures"] = figures(made)
    save(out, columns, made.about)
    library.cache_clear()
    return made


def _commit() -> str:
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()


AIRS: Final = (("no dust", -1.0, 0.05), ("dust to 0.3", 0.05, 0.3), ("more dust", 0.3, 2.0))


def figures(errors: Library) -> dict[str, dict[str, float | int | None]]:
    """What the library says of each mount in each air, of the pictures in the crop: the figures
    that the model eyes reproduce."""
    c = errors.columns
    found: dict[str, dict[str, float | int | None]] = {}
    dust = errors.features[:, 0]
    mount = np.array([errors.mount[d["mount"]] for d in errors.drives])[errors.drive]
    for name, code in errors.mount.items():
        for air, low, high in AIRS:
            of = (mount == code) & (dust >= low) & (dust < high)
            crop = of & (errors.zone == 0) & (errors.edge == ALONG)
            if crop.sum() < 2:
                continue
            found[f"{name}, {air}"] = _figures_of(errors, c, crop, of & (errors.zone == 4))
    return found


def _figures_of(
    errors: Library, c: dict[str, NDArray[Any]], crop: NDArray[np.bool_], clear: NDArray[np.bool_]
) -> dict[str, float | int | None]:
    sure = crop & (c["confidence"] >= 0.5) & np.isfinite(errors.error)
    e = errors.error[sure].astype(float)
    unsure = crop & ~sure & np.isfinite(errors.error)
    u = errors.error[unsure].astype(float)

    def value(x: Any, digits: int = 4) -> float | None:
        return round(float(x), digits) if np.isfinite(x) else None

    false = crop & ~(c["crop_ahead_m"] < 0.8) & (c["ahead_confidence"] >= 0.5)
    seen = clear & (c["ahead_confidence"] >= 0.5)
    moving = np.abs(c["speed_mps"]) > 0.05
    return {
        "pictures": int(crop.sum()),
        "sure_share": value(sure.sum() / crop.sum()),
        "offset_bias_m": value(e.mean()) if e.size else None,
        "offset_sd_m": value(e.std()) if e.size else None,
        "offset_p5_m": value(np.quantile(e, 0.05)) if e.size else None,
        "offset_p95_m": value(np.quantile(e, 0.95)) if e.size else None,
        "sure_but_wrong": value(np.mean(np.abs(e) > WRONG_M)) if e.size else None,
        "unsure_offset_median_m": value(np.median(u)) if u.size else None,
        "unsure_offset_p95_m": value(np.quantile(u, 0.95)) if u.size else None,
        "correlation_0.5_m": value(_correlation(errors, sure & moving, 10)),
        "gap_pictures_p95": value(np.quantile(g, 0.95), 1)
        if (g := _runs(errors, crop, ~sure)).size
        else None,
        "false_clear_share": value(false.sum() / crop.sum(), 5),
        "clear_seen_share": value(seen.sum() / clear.sum()) if clear.any() else None,
    }


def _correlation(errors: Library, sure: NDArray[np.bool_], lag: int) -> float:
    """Of sure errors `lag` pictures apart, over all drives."""
    a, b = errors.error[:-lag].astype(float), errors.error[lag:].astype(float)
    stamps = errors.columns["stamp_s"]
    both = sure[:-lag] & sure[lag:] & (errors.drive[:-lag] == errors.drive[lag:])
    both &= np.abs(stamps[lag:] - stamps[:-lag] - 0.1 * lag) < 0.06
    if both.sum() < 30:
        return math.nan
    return float(np.corrcoef(a[both], b[both])[0, 1])


def _runs(errors: Library, of: NDArray[np.bool_], gap: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Lengths, in pictures, of what is a gap."""
    lengths, count = [], 0
    for k in range(errors.size):
        if of[k] and gap[k] and (count == 0 or errors.follows[k]):
            count += 1
        elif count:
            lengths.append(count)
            count = int(of[k] and gap[k])
    return np.array(lengths + [count] * (count > 0), np.int64)


# ---- the judgement -------------------------------------------------------------------------------


@cache
def compared() -> dict[str, str]:
    """What is compared, and how: figures of whole fields, or values pooled from all."""
    return {
        "lateral_m": "a value each 0.5 s of following, of one half second in ten",
        "lateral_rms_m": "one value a field",
        "end_of_field_error_m": "one value an end",
        "false_ends": "one value a field",
        "hesitations": "one value a field",
        "coverage": "one value a field",
        "simulated_s": "one value a field",
    }


THIN: Final = 100
"""Of 20 lateral errors a second, one in so many counts: those between hang together."""


def values_of(runs: Sequence[dict[str, Any]], name: str) -> NDArray[np.float64]:
    """All that a set of runs says of a figure."""
    if name == "lateral_m":
        found = [value for run in runs for value in run["lateral"][::THIN]]
    elif name == "end_of_field_error_m":
        found = [value for run in runs for value in run["ends"]]
    else:
        found = [run[name] for run in runs if run[name] is not None]
    return np.array(found, float)


def judge(
    pictures: Sequence[dict[str, Any]], models: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """A row a figure: medians and 90th percentiles both ways, the Kolmogorov-Smirnov test's p, and
    Cliff's delta (-1..1, from Mann-Whitney's U; 0 where neither is the greater)."""
    rows = []
    for name in compared():
        a, b = values_of(pictures, name), values_of(models, name)
        if not a.size or not b.size:
            continue
        p = float(stats.ks_2samp(a, b).pvalue)
        u = float(stats.mannwhitneyu(a, b).statistic)
        delta = 2 * u / (a.size * b.size) - 1
        rows.append(
            {
                "figure": name,
                "values": [int(a.size), int(b.size)],
                "median": [float(np.median(a)), float(np.median(b))],
                "p90": [float(np.quantile(a, 0.9)), float(np.quantile(b, 0.9))],
                "ks_p": p,
                "cliffs_delta": -delta,
                "agrees": p >= ALPHA or abs(delta) < EFFECT,
            }
        )
    return rows
