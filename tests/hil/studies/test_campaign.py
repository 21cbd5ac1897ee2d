"""Facts about campaigns: nothing is lost, nothing is run twice, a failure is a result."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil.commands.campaign import campaign
from hil.firmware import targets
from hil.judge.overview import overview, ranking, stopped_safely
from hil.scenario.scenario import Scenario, changed, load
from hil.studies.campaign import jobs_of, run_campaign, run_job, seeds_of, variants
from host.core.errors import UserError
from host.runs.record import about

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
DASK_PORT = 8787
"""Another campaign's."""
LIMIT_S = 500.0
"""Hangs end here; a busy machine needs a good part of it."""
TINY = """
field: {size_m: [4.0, 3.0], neighbour_depth_m: 2.0}
lens: {width_px: 64, height_px: 48}
belief: exact
limits: {time_s: 0.2}
"""


def tiny(folder: Path) -> Path:
    path = folder / "tiny.yaml"
    path.write_text(TINY)
    return path


# ---- what is run ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seeds"),
    [
        ("3", [3]),
        ("1-4", [1, 2, 3, 4]),
        ("1,4, 9", [1, 4, 9]),
        ("1-2,7", [1, 2, 7]),
        ("2,1-3", [2, 1, 3]),
    ],
)
def test_seeds_are_ranges_and_lists(text: str, seeds: list[int]) -> None:
    assert seeds_of(text) == seeds


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "'' is no seed"),
        ("a", "'a' is no seed"),
        ("1-", "'1-' is no seed"),
        ("4-1", "'4-1' counts down"),
        ("1,1-99999999", "'1-99999999' is too many: 10000000 is the most"),
    ],
)
def test_what_names_no_seed_is_refused_with_the_reason(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        seeds_of(text)


def test_settings_sweep_every_combination() -> None:
    found = list(variants(["weather.hour=9,12", "camera=low,mast", "field.size_m=[4, 5]"]))
    assert [name for name, _ in found] == [
        f"hour={hour} camera={camera}" for hour in (9, 12) for camera in ("low", "mast")
    ]
    assert found[0][1] == {
        "weather": {"hour": 9},
        "camera": "low",
        "field": {"size_m": [4, 5]},
    }


def test_the_same_run_named_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="named twice"):
        jobs_of([Scenario(), Scenario()], tmp_path, False)


def test_an_overview_counts_what_finished_and_finds_the_worst() -> None:
    runs = [
        {"scenario": "a", "outcome": "finished", "coverage": 0.99, "false_ends": 0},
        {"scenario": "a", "outcome": "finished", "coverage": 0.97, "false_ends": 2},
        {"scenario": "a", "outcome": "fault", "coverage": 0.2, "false_ends": None},
        {"scenario": "b", "outcome": "crashed"},
    ]
    a, b, every = overview(runs)
    assert (a["runs"], a["finished"], a["coverage worst"]) == (3, 2, 0.97)
    assert (a["coverage median"], a["false_ends worst"]) == (0.98, 2)
    assert (b["finished"], b["crashed"]) == (0, 1)
    assert (every["scenario"], every["runs"], every["finished"]) == ("all", 4, 2)
    assert overview(runs[:3]) == [a]


def test_safely_stopped_is_who_decided_so_and_did_no_harm() -> None:
    calm = {"outcome": "fault", "neighbour_cut_m2": 0, "outside_m": 0.0, "keep_out_m": 0.0}
    assert stopped_safely(calm)
    assert not stopped_safely(calm | {"outcome": "broken off"})
    assert not stopped_safely(calm | {"outcome": "finished"})
    for harm in ("neighbour_cut_m2", "outside_m", "keep_out_m"):
        assert not stopped_safely(calm | {harm: 0.01})
    assert not stopped_safely({"outcome": "crashed"})
    (row,) = overview([calm | {"scenario": "a"}, {"scenario": "a", "outcome": "crashed"}])
    assert (row["runs"], row["stopped safely"], row["crashed"]) == (2, 1, 1)


def test_the_law_with_the_least_error_and_the_most_cut_comes_first() -> None:
    def run(name: str, lateral: float | None, coverage: float, **more: float) -> dict[str, Any]:
        return {"scenario": name, "lateral_rms_m": lateral, "coverage": coverage, **more}

    runs = [
        run("slow", 0.02, 0.5),
        run("quick", 0.03, 0.8),
        run("quick", 0.05, 0.8),
        run("wild", 0.01, 0.9, neighbour_cut_m2=0.1),
        run("blind", None, 0.0),
    ]
    names = [name for name, _, _ in ranking(runs)]
    assert names == ["quick", "slow", "blind", "wild"]
    assert ranking(runs)[0][1:] == (pytest.approx(0.6), pytest.approx(0.7))


# ---- one run -------------------------------------------------------------------------------------


@needs_firmware
def test_a_run_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (job,) = jobs_of([load(str(tiny(tmp_path)))], tmp_path, False)
    first = run_job(job)
    driven: list[Any] = []
    monkeypatch.setattr(
        "hil.bench.harvest.harvest", lambda *what, **_: driven.append(what) or first
    )
    assert run_job(job) == first
    assert not driven
    assert first["run"] == job.key
    assert (job.place / "record.mcap").exists()  # it was broken off, so its record is kept
    assert load(str(job.place / "scenario.yaml")) == Scenario.model_validate_json(job.scenario)


@needs_firmware
def test_a_commissioned_run_harvests_with_what_was_found(tmp_path: Path) -> None:
    brief = {
        "field": {"size_m": [14.0, 11.0]},
        "eyes": "model",
        "limits": {"time_s": 1.0},
    }
    (plain,) = jobs_of([load("default", brief)], tmp_path, False)
    (job,) = jobs_of([load("default", brief)], tmp_path, True, commissioned=True)
    assert job.key != plain.key
    assert run_job(job)["outcome"] == "broken off"
    folder = job.place / "belief"
    again = load(str(job.place / "scenario.yaml"))
    assert again.belief.folder == str(folder)
    assert again.told == changed(load("default", brief), {"belief": {"folder": str(folder)}}).told
    recorded = about(job.place / "record.mcap")["scenario"]
    assert Scenario.model_validate_json(recorded).told == again.told


def test_a_run_that_crashes_is_a_result_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fall(*_: object, **__: object) -> None:
        raise RuntimeError("over a stone")

    monkeypatch.setattr("hil.bench.harvest.harvest", fall)
    (job,) = jobs_of([load(str(tiny(tmp_path)))], tmp_path, False)
    summary = run_job(job)
    assert summary["outcome"] == "crashed"
    assert summary["reason"] == "RuntimeError: over a stone"
    assert (job.place / "traceback.txt").exists()


@needs_firmware
def test_the_results_come_in_the_order_of_the_jobs(tmp_path: Path) -> None:
    base = load(str(tiny(tmp_path)))
    jobs = jobs_of([changed(base, {"seed": s}) for s in (5, 3, 4)], tmp_path, False)
    summaries = run_campaign(jobs, tmp_path, workers=1)
    assert [s["seed"] for s in summaries] == [5, 3, 4]
    assert json.loads((tmp_path / "campaign.json").read_text()) == summaries


# ---- killed and resumed --------------------------------------------------------------------------


def finished(out: Path) -> dict[str, int]:
    """Finished runs, with the time when each was written."""
    return {
        path.parent.name: path.stat().st_mtime_ns for path in out.glob("runs/[!.]*/summary.json")
    }


@contextmanager
def process(*command: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process in a group of its own, killed with all its children at the end."""
    with log.open("wb") as file:
        child = subprocess.Popen(command, stdout=file, stderr=file, start_new_session=True)
    try:
        yield child
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def wait_for(condition: object, child: subprocess.Popen[bytes] | None = None) -> None:
    """Until a callable is true; fails after LIMIT_S, or when the child has ended before."""
    assert callable(condition)
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline
        assert child is None or child.poll() is None
        time.sleep(0.02)


COMMAND = [sys.executable, "-c", "from hil.commands.cli import main; main()", "campaign"]


def options(tmp_path: Path, count: int, *more: str) -> list[str]:
    return [
        "--scenario", str(tiny(tmp_path)), "--seeds", f"1-{count}", "--out", str(tmp_path),
        "--eyes", "model", "--maps", "0", *more,
    ]  # fmt: skip


def begin_again(options: list[str]) -> None:
    """The same command once more, here: a process of its own would first import all of it."""
    done = CliRunner().invoke(campaign, options)
    assert done.exit_code == 0, done.output


@needs_firmware
@pytest.mark.parametrize("count", [24, pytest.param(200, marks=pytest.mark.long)], ids=str)
def test_a_campaign_killed_halfway_goes_on_where_it_was(tmp_path: Path, count: int) -> None:
    asked = options(tmp_path, count)
    with contextlib.ExitStack() as other:
        with contextlib.suppress(OSError):  # it is in use already
            other.enter_context(socket.create_server(("", DASK_PORT)))
        with process(*COMMAND, *asked, log=tmp_path / "first.log") as child:
            wait_for(lambda: len(finished(tmp_path)) >= count // 2, child)
        assert "Warning" not in (tmp_path / "first.log").read_text()
    before = finished(tmp_path)
    assert count // 2 <= len(before) < count
    begin_again([*asked, "--workers", "1"])
    after = finished(tmp_path)
    assert len(after) == count
    assert {name: after[name] for name in before} == before
    summaries = json.loads((tmp_path / "campaign.json").read_text())
    assert [s["seed"] for s in summaries] == list(range(1, count + 1))
    assert {s["run"] for s in summaries} == set(after)
    assert not list((tmp_path / "runs").glob(".*"))


@needs_firmware
@pytest.mark.parametrize("count", [24, pytest.param(200, marks=pytest.mark.long)], ids=str)
def test_a_second_worker_started_by_hand_takes_over(tmp_path: Path, count: int) -> None:
    """A scheduler and two workers; halfway one of them and the campaign itself are killed, and the
    campaign is started again."""
    dask = [sys.executable, "-m", "dask"]
    with process(
        *dask, "scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1",
        log=tmp_path / "scheduler.log",
    ):  # fmt: skip

        def address() -> str:
            text = (tmp_path / "scheduler.log").read_text()
            found = re.search(r"Scheduler at:\s+(tcp://\S+)", text)
            return found[1] if found else ""

        wait_for(address)
        worker = [
            *dask, "worker", address(), "--nthreads", "1", "--no-dashboard", "--no-nanny",
            "--local-directory", str(tmp_path / "scratch"),
        ]  # fmt: skip
        asked = options(tmp_path, count, "--scheduler", address())
        with process(*worker, log=tmp_path / "second.log") as second:
            with (
                process(*worker, log=tmp_path / "first.log"),
                process(*COMMAND, *asked, log=tmp_path / "campaign.log") as client,
            ):
                wait_for(lambda: len(finished(tmp_path)) >= count // 2, client)
            before = finished(tmp_path)
            assert count // 2 <= len(before) < count
            begin_again(asked)
            assert second.poll() is None
    after = finished(tmp_path)
    assert len(after) == count
    assert {name: after[name] for name in before} == before
    summaries = json.loads((tmp_path / "campaign.json").read_text())
    assert [s["seed"] for s in summaries] == list(range(1, count + 1))


def test_a_second_campaign_leaves_what_the_first_is_at(tmp_path: Path) -> None:
    half_done = tmp_path / "runs" / ".half-done"
    half_done.mkdir(parents=True)
    with (tmp_path / ".running").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(UserError, match="another campaign is writing to"):
            run_campaign([], tmp_path)
        assert half_done.exists()


def test_a_scheduler_that_is_not_there_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.studies.spread.ANSWER_S", 1.0)
    jobs = jobs_of([load(str(tiny(tmp_path)))], tmp_path, False)
    with pytest.raises(UserError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        run_campaign(jobs, tmp_path, scheduler="tcp://127.0.0.1:9")


@pytest.mark.parametrize("text", ["", "x", "1-", "3,,4", "5-1", "1-99999999999999"])
def test_seeds_that_are_none_are_refused_with_what_would_do(text: str) -> None:
    done = CliRunner().invoke(campaign, ["--seeds", text])
    assert isinstance(done.exception, UserError)
    assert f"--seeds {text}: say 1-30, or 1,4,9" in str(done.exception)
