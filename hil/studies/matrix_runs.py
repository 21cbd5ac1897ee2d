"""The whole fault matrix: which cases, spread over processes, kept from call to call.

A call that was killed goes on where it was, as long as scenario, firmware and programs are the
same.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hil.firmware import targets
from hil.firmware.provision import BOARD, Firmware
from hil.firmware.targets import ROOT
from hil.judge.fault_verdict import Situation, Verdict
from hil.studies.fault_matrix import Case, all_faults, grouped, run_group, scenario_of
from hil.studies.spread import spread
from host.core.errors import UserError

VERDICTS = "verdicts.jsonl"


@dataclass(frozen=True, slots=True)
class Matrix:
    """One machine, and what of it is made to fail."""

    only: tuple[str, ...] = ()
    """COMPONENT[.FAILURE[.HOW]]; none: all of them."""
    situations: tuple[Situation, ...] = ("follow", "turn")
    firmware: Firmware = "desk"
    mode: str = "robust"
    camera: str = "mast"
    sensors: bool = False
    """Whether the optional ones are fitted."""
    records: Path | None = None
    """Folder for a record of every run."""
    machine: int | None = None
    """Seed of one of its own; None: the default one, with this camera."""
    owner: Path = Path()
    """Folder for its owner's files."""

    @property
    def title(self) -> str:
        """Of its tables."""
        camera = f"{self.camera} camera" if self.machine is None else f"machine {self.machine}"
        machine = f"faults, {self.firmware} firmware, {camera}, {self.mode} vision"
        return f"{machine}, with the optional sensors" if self.sensors else machine

    def cases(self) -> list[Case]:
        """One run each. UserError where `only` names no fault."""
        keep = str(self.records.resolve()) if self.records is not None else None
        firmware, mode, camera = self.firmware, self.mode, self.camera
        fitted, seed, owner = self.sensors, self.machine, str(self.owner)
        return [
            Case(name, where, firmware, mode, camera, keep, fitted, seed, owner)
            for name in named(self.only)
            for where in self.situations
        ]

    def summary(self, verdicts: Sequence[Verdict]) -> dict[str, Any]:
        """What summary.json holds."""
        return {
            "firmware": self.firmware,
            "camera": self.camera,
            "mode": self.mode,
            "sensors": self.sensors,
            "machine": self.machine,
            "cases": len(verdicts),
            "bad": sum(not v.ok and not v.limit for v in verdicts),
            "limits": sum(v.limit for v in verdicts),
            "faults": [asdict(v) for v in verdicts],
        }


def named(only: Sequence[str]) -> list[tuple[str, str, str]]:
    """The faults that these words name, all where there are none. UserError where one names
    nothing."""
    names = all_faults()
    if not only:
        return names
    out = []
    for wanted in only:
        words = wanted.replace(".", " ").split()
        found = [n for n in names if list(n[: len(words)]) == words]
        if not found:
            components = ", ".join(dict.fromkeys(n[0] for n in names))
            known = ", ".join(n[1] for n in names if n[0] == words[0]) if words else ""
            hint = f"{words[0]} can be: {known}" if known else f"components: {components}"
            raise UserError(f"--only {wanted}: no such fault; {hint}")
        out += [n for n in found if n not in out]
    return out


def run_matrix(
    cases: Sequence[Case],
    out: Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    progress: Callable[[int, str], None] = lambda _done, _fault: None,
) -> list[Verdict]:
    """Runs what OUT/verdicts.jsonl does not have yet; returns all verdicts in their cases'
    order."""
    out.mkdir(parents=True, exist_ok=True)
    log = out / VERDICTS
    found = kept(log, cases)
    groups = grouped([case for case in cases if case not in found])
    progress(len(found), "")
    with log.open("a", encoding="utf-8") as file:
        file.write("\n")  # a killed call may have left half a line
        for group, verdicts in spread(run_group, groups, workers=workers, scheduler=scheduler):
            for case, verdict in zip(group, verdicts, strict=True):
                found[case] = verdict
                entry = {"digest": digest(case), "verdict": asdict(verdict)}
                file.write(json.dumps(entry) + "\n")
            file.flush()
            progress(len(found), verdicts[-1].fault)
    return [found[case] for case in cases]


def worst_stop_ms(verdicts: Sequence[Verdict]) -> float:
    """Of those that stopped, from the fault to all outputs off; NaN where none did."""
    stopped = [v.stop_latency_ms for v in verdicts if v.stop_latency_ms is not None]
    return max(stopped, default=math.nan)


# ---- kept from an earlier call -------------------------------------------------------------------


def digest(case: Case) -> str:
    """Of everything that a verdict depends on: the scenario, the firmware and the programs."""
    chosen = scenario_of(case).model_dump_json().encode()
    return hashlib.sha256(chosen + programs(case.firmware)).hexdigest()


@cache
def programs(firmware: Firmware) -> bytes:
    """A digest of all that decides a verdict besides its case: sources and images."""
    images = [targets.DESK_LIBRARY]
    if firmware != "desk":
        images = [targets.AVR_LIBRARY, targets.image_of(BOARD[firmware])]
    sources = sorted(p for d in ("hil", "host", "sim_plant") for p in (ROOT / d).rglob("*.py"))
    found = hashlib.sha256()
    for path in (*sources, *(image for image in images if image.exists())):
        found.update(path.read_bytes())
    return found.digest()


def kept(path: Path, cases: Sequence[Case]) -> dict[Case, Verdict]:
    """Verdicts that an earlier call of the same command left, of the same programs."""
    if not path.exists():
        return {}
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:  # the call was killed while it wrote
            continue
        found[entry["digest"]] = Verdict(**entry["verdict"])
    digests = {case: digest(case) for case in cases}
    return {case: found[key] for case, key in digests.items() if key in found}
