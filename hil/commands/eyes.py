"""`daranti-hil eyes`: the model eyes are fitted and judged."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import click
from rich.table import Table

from hil.bench.model_eyes import LIBRARY
from hil.commands.seeds import SEEDS, SEEDS_OR_NONE
from hil.firmware.provision import check_built
from hil.studies.eye_comparison import Compared, compared
from hil.studies.eye_fit import Task, drive, fit, judge
from hil.studies.spread import spread
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo

FITTED, LATE, COMPARED = "9001-9030", "9031-9046", "9061-9066"


def _drive(
    seeds: Sequence[int], out: Path, eyes: Literal["picture", "model", "both"], workers: int,
    scheduler: str | None, library: Path | None = None,
) -> list[dict[str, Any]]:  # fmt: skip
    check_folder(out)
    check_built("desk")
    out.mkdir(parents=True, exist_ok=True)
    where = str(out.resolve())
    used = str(library.resolve()) if library is not None else None
    tasks = [Task(seed, where, eyes, used) for seed in seeds]
    found: dict[int, dict[str, Any]] = {}
    with Watch(f"{len(tasks)} fields by {eyes}", len(tasks)) as watch:
        for task, about in spread(drive, tasks, workers=workers, scheduler=scheduler):
            found[task.seed] = about
            watch.step()
    return [found[seed] for seed in seeds]


@click.group()
def eyes() -> None:
    """Fits the model eyes to picture drives and judges them by such."""


_options = [
    click.option(
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        default=Path("out/eyes"),
        show_default=True,
        help="Where drives are kept.",
    ),
    click.option("--workers", type=WholeRange(1, 256), default=2, show_default=True),
    click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT."),
]


def _common(seeds: str) -> Callable[[Any], Any]:
    """The options of all three, `seeds` by default."""
    of_seeds = click.option("--seeds", type=SEEDS, default=seeds, show_default=True)

    def with_options(command: Any) -> Any:
        for option in reversed([of_seeds, *_options]):
            command = option(command)
        return command

    return with_options


@eyes.command("fit")
@_common(FITTED)
@click.option(
    "--late",
    type=SEEDS_OR_NONE,
    default=LATE,
    show_default=True,
    help="Random fields that the model drives, the detector looking on; none: ''.",
)
@click.option("--library", type=click.Path(path_type=Path), default=LIBRARY, show_default=False,
              help="The file to write; default the bench's own.")  # fmt: skip
def fit_command(
    seeds: list[int],
    out: Path,
    workers: int,
    scheduler: str | None,
    late: list[int],
    library: Path,
) -> None:
    """Drives fields with pictures, or takes drives that are there, and keeps what the
    detector answered to each as the model eyes' library."""
    _drive(seeds, out, "picture", workers, scheduler)
    if late:
        _drive(late, out, "both", workers, scheduler)
    with Watch("fit"):
        made = fit(out, library, datetime.datetime.now(datetime.UTC).date())
    PlainConsole().print_table(fitted(made.about["figures"]))
    echo(f"{made.size} pictures of {len(made.drives)} drives: {library}")


@eyes.command("judge")
@_common(FITTED)
@click.option("--library", type=click.Path(path_type=Path), default=LIBRARY, show_default=False,
              help="Of errors; default the bench's own.")  # fmt: skip
def judge_command(
    seeds: list[int], out: Path, workers: int, scheduler: str | None, library: Path
) -> None:
    """Drives the same fields both ways and compares what came of it. By the model each field is
    driven without what it taught the model itself."""
    pictures = _drive(seeds, out, "picture", workers, scheduler)
    models = _drive(seeds, out, "model", workers, scheduler, library)
    rows = judge(pictures, models)
    table = Table(title=f"{len(seeds)} fields by pictures and by the model")
    for title in ("figure", "values", "median", "p90", "KS p", "Cliff's delta", "agrees"):
        table.add_column(title, justify="left" if title == "figure" else "right")
    for row in rows:
        table.add_row(
            row["figure"],
            *(" / ".join(f"{v:g}" for v in row[k]) for k in ("values",)),
            *(" / ".join(f"{v:.3f}" for v in row[k]) for k in ("median", "p90")),
            f"{row['ks_p']:.3f}",
            f"{row['cliffs_delta']:+.2f}",
            "yes" if row["agrees"] else "NO",
        )
    PlainConsole().print_table(table)
    for name, runs in (("pictures", pictures), ("model", models)):
        done = sum(run["outcome"] == "finished" for run in runs)
        echo(f"by {name}: {done} of {len(runs)} fields finished")


@eyes.command("compare")
@_common(COMPARED)
@click.option("--library", type=click.Path(path_type=Path), default=LIBRARY, show_default=False,
              help="Of errors; default the bench's own.")  # fmt: skip
def compare_command(
    seeds: list[int], out: Path, workers: int, scheduler: str | None, library: Path
) -> None:
    """Drives random fields by the model, shows the detector the same moments in pictures, and
    prints what each says, situation by situation."""
    _drive(seeds, out, "both", workers, scheduler, library)
    paths = [Task(seed, str(out), "both").path for seed in seeds]
    PlainConsole().print_table(compared_table(compared(paths)))


def compared_table(rows: Sequence[Compared]) -> Table:
    """A row for each situation: detector / model."""
    table = Table(title="the same moments, by the detector / by the model")
    for title in ("mount", "situation"):
        table.add_column(title)
    for title in ("pictures", "sure", "sure and wrong", "clear", "off by, m (10, 50, 90 %)"):
        table.add_column(title, justify="right")
    for row in rows:
        both = (row.detector, row.model)
        shares = (tuple(getattr(by, name) for by in both) for name in ("sure", "wrong", "clear"))
        table.add_row(
            row.mount,
            row.situation,
            str(row.pictures),
            *(" / ".join(f"{v:.3f}" for v in pair) for pair in shares),
            " / ".join(" ".join(f"{v:+.2f}" for v in by.off_m) for by in both),
        )
    return table


def fitted(figures: dict[str, dict[str, Any]]) -> Table:
    """The figures of a library, a column for each mount and air."""
    table = Table(title="the detector's answers in the crop")
    table.add_column("figure")
    for name in figures:
        table.add_column(name, justify="right")
    for key in dict.fromkeys(key for column in figures.values() for key in column):
        cells = (column.get(key) for column in figures.values())
        table.add_row(key, *("-" if v is None else f"{v:g}" for v in cells))
    return table
