"""`daranti-hil faults`: every fault that the bench can make, and what the machine did about it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import click

from hil.firmware.provision import Firmware
from hil.judge.fault_verdict import Situation
from hil.report import report
from hil.report.fault_tables import markdown_of, table_of
from hil.studies.fault_matrix import Case, all_faults, digest, grouped, kept, run_group
from hil.studies.spread import spread
from host.core.errors import UserError
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo


def _selected(only: Sequence[str]) -> list[tuple[str, str, str]]:
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


@click.command()
@click.option(
    "--firmware", type=click.Choice(get_args(Firmware)), default="desk", show_default=True
)
@click.option("--only", multiple=True, metavar="COMPONENT[.FAILURE[.HOW]]", help="May be repeated.")
@click.option("--while", "situation", type=click.Choice(["follow", "turn", "both"]), default="both")
@click.option("--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True)
@click.option("--camera", default="mast", show_default=True, metavar="low|mast")
@click.option("--sensors", is_flag=True, help="With the optional sensors of wheel and blade.")
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT.")
@click.option("--records", is_flag=True, help="Keep a record of every run.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/faults"))
def faults(
    firmware: Firmware,
    only: tuple[str, ...],
    situation: str,
    mode: str,
    camera: str,
    sensors: bool,
    workers: int,
    scheduler: str | None,
    records: bool,
    out: Path,
) -> None:
    """Makes everything fail that can fail, and says who noticed, when, and what moved meanwhile.

    Exits with an error when any outcome is unsafe or late; known limits are counted apart. The same
    command goes on where it was killed, as long as the programs are the same."""

    wheres: list[Situation] = ["follow", "turn"] if situation == "both" else [situation]  # type: ignore[list-item]
    out.mkdir(parents=True, exist_ok=True)
    keep = str((out / "records").resolve()) if records else None
    cases = [
        Case(name, where, firmware, mode, camera, keep, sensors)
        for name in _selected(only)
        for where in wheres
    ]
    log = out / "verdicts.jsonl"
    found = kept(log, cases)
    todo = [case for case in cases if case not in found]
    with (
        Watch(f"{len(cases)} faults", len(cases)) as watch,
        log.open("a", encoding="utf-8") as file,
    ):
        file.write("\n")  # a killed call may have left half a line
        watch.reach(len(found))
        groups = grouped(todo)
        for group, verdicts in spread(run_group, groups, workers=workers, scheduler=scheduler):
            for case, verdict in zip(group, verdicts, strict=True):
                found[case] = verdict
                entry = {"digest": digest(case), "verdict": asdict(verdict)}
                file.write(json.dumps(entry) + "\n")
            file.flush()
            watch.reach(len(found), verdicts[-1].fault)
    verdicts = [found[case] for case in cases]
    title = f"faults, {firmware} firmware, {camera} camera, {mode} vision"
    if sensors:
        title += ", with the optional sensors"
    summary = {
        "firmware": firmware,
        "camera": camera,
        "mode": mode,
        "sensors": sensors,
        "cases": len(verdicts),
        "bad": sum(not v.ok and not v.limit for v in verdicts),
        "limits": sum(v.limit for v in verdicts),
        "faults": [asdict(v) for v in verdicts],
    }
    (out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    PlainConsole().print_table(table_of(verdicts, title))
    (out / "faults.md").write_text(markdown_of(verdicts, title), encoding="utf-8")
    report.faults_report(out, title, verdicts)
    latencies = [v.stop_latency_ms for v in verdicts if v.stop_latency_ms is not None]
    worst = max(latencies, default=math.nan)
    echo(
        f"{len(verdicts)} runs, {summary['limits']} known limits, worst stop_latency_ms "
        f"{worst:.0f}; written to {out}"
    )
    if summary["bad"]:
        raise UserError(f"{summary['bad']} of {len(verdicts)} outcomes are unsafe or late")
