"""What a wrong belief does: one small field, harvested with one thing of the world other than the
host was told, or with two. Everything not named is exact, so that a row shows what its own error
does."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.table import Table

from hil.bench.harvest import harvest
from hil.bench.wrong_pictures import WrongPictures
from hil.judge.figures import MARKS
from hil.scenario.scenario import Scenario, changed, load, merge
from hil.studies.spread import spread
from host.core.whole_file import save_text
from host.field.boundary_file import UNKNOWN_SIGMA_M
from sim_plant.drive_response import drive_response
from sim_plant.machine import DriveSpec, MachineSpec

SIZE_M: Final = (9.0, 7.0)
"""Not a square: to be at another corner than said makes a difference."""
SEED: Final = 7
"""Of the world and of the wrong corners."""
LIMIT_S: Final = 900.0
"""Of one run."""
FIGURES: Final = (
    "neighbour_cut_m2", "outside_m", "coverage", "outcome", "reason", "put_outside_m",
    "believed_wrong",
)  # fmt: skip
KNOCKED_AT_S: Final = 100.0
"""In mid-run: on the third side."""
OLD_FROM_S: Final = 12.0
"""In the middle of the first side, where only the pictures tell where its edge and its end are."""
DRIFT_STEP_S: Final = 6.0
"""In such steps a potentiometer's drift is made."""
DRIFTS_S: Final = 120.0
"""For so long it drifts: twice what the issue's machine took to come off."""


def _ring(*, longer: float = 0.0, wider: float = 0.0) -> list[list[float]]:
    width, height = SIZE_M[0] + wider, SIZE_M[1] + longer
    return [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]


def scattered_of(sigma_m: float) -> list[list[float]]:
    off = np.random.default_rng(SEED).normal(0, sigma_m, (4, 2))
    return [[float(v) for v in corner] for corner in np.array(_ring()) + off]


def _rotated(degrees: float) -> list[list[float]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    ring = np.array(_ring()) @ np.array([[c, s], [-s, c]])
    return [[float(v) for v in corner] for corner in ring]


def mount_of(**off: float) -> dict[str, Any]:
    true = {"pitch_deg": 28.0, "yaw_deg": 0.0, "roll_deg": 0.0, "z_m": 1.6}
    return {"lens": {name: true[name] + value for name, value in off.items()}, "belief": SAID}


SAID: Final[dict[str, Any]] = {
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


COUNTS_PER_DEG: Final = 4.5
"""Of the potentiometer."""


def hall_of(pulses_per_m: float) -> dict[str, Any]:
    return {"machine": {"drive": {"hall_pulses_per_m": pulses_per_m}}, "belief": SAID}


def hall_at(left_m: float, said_m: float) -> dict[str, Any]:
    """The wheel with the sensor runs there, and was said to run elsewhere."""
    place = {"drive": {"hall_left_m": left_m}}
    return {"machine": place, "belief": {"vehicle": {"hall_left_m": said_m}}}


def pot_of(degrees: float) -> dict[str, Any]:
    off = {"steering": {"pot_centre_counts": 512.0 + COUNTS_PER_DEG * degrees}}
    return {"machine": off, "belief": SAID}


def pot_scaled_by(share: float) -> dict[str, Any]:
    """It gives so many times the counts for an angle that the firmware was told."""
    off = {"steering": {"pot_counts_per_deg": COUNTS_PER_DEG * share}}
    return {"machine": off, "belief": SAID}


DRIVE: Final = drive_response(MachineSpec())
"""What the owner has measured before other motors were fitted."""


def motors_of(faster: float, pulses_per_m: float = 50.0) -> dict[str, Any]:
    """They turn so many times as fast as those of which the owner has measured speed and duty."""
    machine = {"k_vspm": DriveSpec().k_vspm / faster, "hall_pulses_per_m": pulses_per_m}
    told = {
        "vehicle": {
            "full_duty_speed_mps": DRIVE.full_mps,
            "dead_duty": DRIVE.dead,
            "drive_lag_s": DRIVE.lag_s,
            "hall_pulses_per_m": pulses_per_m,
        },
        "parameters": {
            "speed_full": DRIVE.full_mps,
            "drive_min_duty": 255 * DRIVE.dead,
            "drive_lag": DRIVE.lag_s,
            "hall_per_metre": pulses_per_m,
        },
    }
    return {"machine": {"drive": machine}, "belief": merge(SAID, told)}


def _pot_drifts(deg_per_min: float) -> dict[str, Any]:
    """From the first side on, until it is held."""
    step = COUNTS_PER_DEG * deg_per_min * DRIFT_STEP_S / 60.0
    count = round(DRIFTS_S / DRIFT_STEP_S)
    times = [DRIFT_STEP_S * (k + 1) for k in range(count)]
    return {
        "faults": [
            {
                "component": "pot",
                "failure": "wrong",
                "value": step * (k + 1),
                "at": {"time_s": at},
                **({"for_s": DRIFT_STEP_S} if k + 1 < count else {}),
            }
            for k, at in enumerate(times)
        ]
    }


def _hall_in_turn() -> dict[str, Any]:
    """It loses pulses through the first turn."""
    fault = {"component": "hall", "failure": "intermittent", "at": {"state": "turn"}, "for_s": 20.0}
    return {"faults": [fault]}


def _dirt(**wrong: float) -> dict[str, Any]:
    return {"lens": {"disturbance": wrong}}


def delay_of(true_s: float) -> dict[str, Any]:
    return {"lens": {"delay_s": true_s}, "belief": SAID}


def _delayed(more_s: float) -> dict[str, Any]:
    """On the way to the host, from the start: no camera alone is so late."""
    fault = {"component": "camera", "failure": "delayed", "value": more_s, "at": {"time_s": 0.0}}
    return {"faults": [fault]}


def gap_of(true_m: float, said_m: float) -> dict[str, Any]:
    return {"field": {"gap_m": true_m}, "belief": {"gap_m": said_m}}


def boundary_of(ring: list[list[float]], sigma_m: float = UNKNOWN_SIGMA_M) -> dict[str, Any]:
    """As a file has it that does not say how surely its corners are known."""
    return {"belief": {"boundary": ring, "corner": 1, "boundary_sigma_m": sigma_m}}


CASES: Final[Mapping[str, dict[str, Any]]] = {
    "exact": {},
    "mount 1.5 deg, 5 cm": mount_of(pitch_deg=1.5, yaw_deg=1.5, z_m=0.05),
    "mount yaw 2 deg": mount_of(yaw_deg=2.0),
    "wheelbase 5 %": {"machine": {"wheelbase_m": 1.05}, "belief": SAID},
    "hall 5 %": hall_of(52.5),
    "hall loses a tenth": hall_of(45.0),
    "hall loses a fifth": hall_of(40.0),
    "hall loses three tenths": hall_of(35.0),
    "hall loses half": hall_of(25.0),
    "hall doubled": hall_of(100.0),
    "hall on the other wheel": hall_at(-0.35, 0.35),
    "hall's place 5 cm": hall_at(0.35, 0.3),
    "pot 4 deg": pot_of(4.0),
    "pot's scale 10 % more": pot_scaled_by(1.1),
    "pot's scale 10 % less": pot_scaled_by(0.9),
    "motors a third faster": motors_of(1.33),
    "motors a third slower": motors_of(0.75),
    "no wheel sensor": motors_of(1.0, 0.0),
    "corners 0.5 m": boundary_of(scattered_of(0.5)),
    "corners 1.0 m": boundary_of(scattered_of(1.0)),
    "said 2 m longer": boundary_of(_ring(longer=2.0)),
    "said 3 m longer": boundary_of(_ring(longer=3.0)),
    "said 2 m wider": boundary_of(_ring(wider=2.0)),
    "said 2 m longer, surely": boundary_of(_ring(longer=2.0), 0.0),
    "said 2 m short, surely": boundary_of(_ring(longer=-2.0), 0.0),
    "said 1 m short": boundary_of(_ring(longer=-1.0)),
    "said 2 m short": boundary_of(_ring(longer=-2.0)),
    "said 3 m short": boundary_of(_ring(longer=-3.0)),
    "rotated 5 deg": boundary_of(_rotated(5.0)),
    "at another corner": {"belief": {"corner": 0}},
    "the wrong way round": {"start": {"heading_error_deg": 180.0}},
    "gap 1.2, said 2": gap_of(1.2, 2.0),
    "gap 1.5, said 2": gap_of(1.5, 2.0),
    "gap 2.5, said 2": gap_of(2.5, 2.0),
    "gap 1.0": gap_of(1.0, 1.0),
    "pot drifts 5 deg a minute": _pot_drifts(5.0),
    "pot drifts 12 deg a minute": _pot_drifts(12.0),
    "hall loses pulses in a turn": _hall_in_turn(),
    "camera knocked by 5 deg yaw": {},
    "camera knocked by 3 deg pitch": {},
    "camera knocked by 5 deg roll": {},
    "lens half under mud": _dirt(mud=0.5),
    "lens under straw": _dirt(straws=20),
    "picture mirrored": {},
    "picture upside down": {},
    "picture frozen, fresh noise": {},
    "picture in a loop of 3 s": {},
    "delay 0.3, said 0.1": delay_of(0.3),
    "delay 0.6, said 0.1": delay_of(0.6),
    "delay 1.0, said 0.1": delay_of(1.0),
    "delay 3.1, said 0.1": _delayed(3.0),
    "a little of all": {
        "lens": {"pitch_deg": 28.8, "yaw_deg": 0.8, "z_m": 1.63, "hfov_deg": 63.0},
        "machine": {
            "wheelbase_m": 1.02,
            "drive": {"hall_pulses_per_m": 51.0},
            "steering": {"pot_centre_counts": 516.0},
        },
        "field": {"gap_m": 1.8},
        "belief": merge(
            SAID,
            {
                "boundary": scattered_of(0.5),
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
PICTURES: Final[Mapping[str, WrongPictures]] = {
    "camera knocked by 5 deg yaw": WrongPictures(knocked_at_s=KNOCKED_AT_S, yaw_deg=5.0),
    "camera knocked by 3 deg pitch": WrongPictures(knocked_at_s=KNOCKED_AT_S, pitch_deg=3.0),
    "camera knocked by 5 deg roll": WrongPictures(knocked_at_s=KNOCKED_AT_S, roll_deg=5.0),
    "picture mirrored": WrongPictures(flip="mirrored"),
    "picture upside down": WrongPictures(flip="upside down"),
    "picture frozen, fresh noise": WrongPictures(old_from_s=OLD_FROM_S),
    "picture in a loop of 3 s": WrongPictures(old_from_s=OLD_FROM_S, old_s=3.0),
}
"""Of these cases the pictures are wrong."""
ONLY_PICTURES: Final = frozenset(
    # Of seconds, only the pictures' motion tells before harm is done. And no drive that the model
    # eyes are fitted to has a gap below 1.5 m (docs/use/thousand_fields.md).
    ("lens half under mud", "lens under straw", "delay 3.1, said 0.1", "gap 1.0", "gap 1.2, said 2")
) | {case for case, wrong in PICTURES.items() if wrong.only_pictures}
"""What model eyes cannot show."""
KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    "camera": ("mount 1.5 deg, 5 cm", "mount yaw 2 deg", "delay 0.3, said 0.1"),
    "wheels": ("hall 5 %", "hall loses a tenth", "hall loses a fifth", "hall doubled"),
    "motors": ("motors a third faster", "motors a third slower"),
    "steering": ("wheelbase 5 %", "pot 4 deg", "pot drifts 5 deg a minute"),
    "boundary": (
        "corners 0.5 m", "corners 1.0 m", "said 2 m longer", "said 2 m wider", "said 1 m short",
        "said 2 m short", "rotated 5 deg", "at another corner",
    ),
    "gap": ("gap 1.2, said 2", "gap 1.5, said 2", "gap 2.5, said 2"),
}  # fmt: skip
"""Wrong beliefs that can go together: two of different kinds."""
AND: Final = " and "
STOOD_M: Final = 0.01
"""A machine that stands moves less, whatever its motors do."""


def scenario_of(
    case: str,
    eyes: str = "picture",
    firmware: str = "desk",
    cases: Mapping[str, dict[str, Any]] = CASES,
) -> Scenario:
    """The harvest of a case, or of several at once."""
    over = merge_all(cases[one] for one in case.split(AND))
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


MOST_PAIRS: Final = 200
"""There are some more."""


def merge_all(overs: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """What several cases have otherwise; all their faults happen."""
    found: dict[str, Any] = {}
    for over in overs:
        faults = [*found.get("faults", []), *over.get("faults", [])]
        found = merge(found, over) | ({"faults": faults} if faults else {})
    return found


def pairs(count: int, seed: int) -> list[str]:
    """So many pairs of cases of different kinds, no pair twice, drawn by a seed."""
    rng = np.random.default_rng(seed)
    kinds, found = list(KINDS), dict[str, None]()
    while len(found) < count:
        one, other = sorted(int(k) for k in rng.choice(len(kinds), 2, replace=False))
        names = [KINDS[kinds[k]][int(rng.integers(len(KINDS[kinds[k]])))] for k in (one, other)]
        found[AND.join(names)] = None
    return list(found)


def slug(case: str) -> str:
    """A case's name as a folder's."""
    return "".join(c if c.isalnum() or c == "." else "-" for c in case).strip("-")


@dataclass(frozen=True, slots=True)
class Task:
    """One harvest; plain data, so that it travels."""

    name: str
    case: str
    scenario: Scenario
    folder: Path


def drive(task: Task) -> dict[str, Any]:
    """The row of one harvest, which leaves its files in the task's folder."""
    wrong = PICTURES.get(task.case)
    summary = harvest(task.scenario, task.folder, eyes=wrong.eyes if wrong is not None else None)
    return {"belief": task.name} | {name: summary[name] for name in FIGURES}


def run(
    cases: Iterable[str],
    out: Path,
    eyes: str,
    firmware: str,
    done: Callable[[dict[str, Any]], None] | None = None,
    of: Mapping[str, dict[str, Any]] = CASES,
    seeds: Sequence[int] = (SEED,),
    workers: int = 1,
) -> list[dict[str, Any]]:
    """Harvests each case into its folder, with each seed of crop, weather and noise; its rows,
    which beliefs.json keeps too."""
    tasks = []
    for case, seed in itertools.product(cases, seeds):
        name = case if len(seeds) == 1 else f"{case}, seed {seed}"
        scenario = changed(scenario_of(case, eyes, firmware, of), {"seed": seed})
        tasks.append(Task(name, case, scenario, out / slug(name)))
    found: dict[str, dict[str, Any]] = {}
    for task, row in spread(drive, tasks, workers=min(workers, len(tasks))):
        found[task.name] = row
        if done is not None:
            done(row)
    rows = [found[task.name] for task in tasks]
    out.mkdir(parents=True, exist_ok=True)
    save_text(out / "beliefs.json", json.dumps(rows, indent=1))
    return rows


def harmless(row: Mapping[str, Any]) -> bool:
    """Whether nobody else's crop was cut and the machine stayed where it is permitted; one that was
    put down outside must not have gone any farther out."""
    put_m = row.get("put_outside_m", 0.0)
    stayed = MARKS["outside_m"].holds(row["outside_m"]) or row["outside_m"] <= put_m + STOOD_M
    return MARKS["neighbour_cut_m2"].holds(row["neighbour_cut_m2"]) and stayed


def table_of(rows: Iterable[Mapping[str, Any]]) -> Table:
    """For a terminal."""
    table = Table("belief", "neighbour cut m2", "outside m", "coverage", "end")
    for row in rows:
        style = "" if harmless(row) else "red"
        end = f"{row['outcome']}: {row['reason']}"
        end += f"; {row['believed_wrong']}" if row["believed_wrong"] else ""
        figures = [f"{row[name]:.3g}" for name in FIGURES[:3]]
        figures[1] += " (put there)" if row["put_outside_m"] > 0.0 else ""
        table.add_row(str(row["belief"]), *figures, end, style=style)
    return table
