"""Facts about reports and plots: one file, complete in itself, that a browser shows."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import asdict
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from hil.bench.harvest import Harvest, harvest
from hil.commands.cli import cli
from hil.commands.plot import plot
from hil.commands.report import report
from hil.firmware import targets
from hil.judge.fault_verdict import Verdict
from hil.judge.pictures import draw_map
from hil.judge.plots import draw_path, draw_time, series
from hil.report.report import (
    Grid,
    Section,
    campaign_report,
    compared,
    faults_report,
    render,
    report_of,
)
from hil.scenario.faults import At, Fault
from host.core.errors import UserError
from host.core.errors import run as run_command
from host.link import protocol
from host.pilot.phase import Phase
from host.runs.record import Recorder
from sim_plant.field import Field, FieldSpec
from tests.helpers.oracle import Oracle, quick

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")


class Page(HTMLParser):
    """What a page refers to, and how its elements nest."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def complete(path: Path) -> Page:
    """The page, once nothing in it comes from elsewhere."""
    page = Page(path.read_text(encoding="utf-8"))
    assert all(link.startswith(("data:", "#")) for link in page.links)
    assert "default-src 'none'" in path.read_text(encoding="utf-8")  # a browser holds it to that
    return page


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short harvest with a fault."""
    folder = tmp_path_factory.mktemp("run")
    fault = Fault(component="gnss", failure="off", at=At(time_s=1.0), for_s=0.5)
    harvest(quick(limits={"time_s": 3.0}, faults=(fault,)), folder)
    return folder


@needs_firmware
def test_a_runs_report_holds_map_plots_video_and_tables(run: Path) -> None:
    page = complete(report_of(run))
    assert page.tags.count("img") >= 2
    assert page.tags.count("script") >= 2
    assert page.tags.count("video") == 1
    assert page.tags.count("table") >= 3
    text = (run / "report.html").read_text()
    assert "gnss off" in text
    assert "data:video/mp4" in text


@needs_firmware
@pytest.mark.skipif(BROWSER is None, reason="no chromium is installed")
def test_a_browser_shows_the_report_with_its_pictures(run: Path, tmp_path: Path) -> None:
    report_of(run)
    probe = (
        "<script>addEventListener('load', () => setTimeout(() => document.body.append("
        "[...document.images].map(i => i.naturalWidth > 0).join() + ' ' + innerWidth + ' ' +"
        "(document.documentElement.scrollWidth <= innerWidth) + ' ' +"
        "Bokeh.documents.reduce((n, d) => n + d.roots().length, 0)), 500))</script>"
    )
    page = tmp_path / "probe.html"
    page.write_text((run / "report.html").read_text().replace("</body>", probe + "</body>"))
    assert BROWSER is not None
    shown = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000",
         "--dump-dom", page.as_uri()],
        check=True, capture_output=True, text=True, timeout=100,
    ).stdout  # fmt: skip
    said = re.search(r"([a-z,]+) [0-9]+ (\w+) ([0-9]+)</body>", shown)
    assert said is not None, shown[-300:]
    loaded, fits, plots = said.groups()
    assert set(loaded.split(",")) == {"true"}
    assert fits == "true"
    assert int(plots) > 0  # that can be zoomed


@needs_firmware
def test_two_runs_stand_side_by_side(run: Path, tmp_path: Path) -> None:
    harvest(quick(limits={"time_s": 2.0}), tmp_path)
    page = complete(report_of(run, tmp_path))
    assert "difference" in (run / "report.html").read_text()
    assert page.tags.count("img") >= 3
    assert (run / "report.html").read_text().count('class="zoom"') == 2


@needs_firmware
def test_a_record_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "record.mcap"
    harvested = Harvest(quick(limits={"time_s": 4.0}), path, detector=Oracle)
    harvested.run()
    harvested.close()
    done = CliRunner().invoke(plot, [str(path)])
    assert done.exit_code == 0, done.output
    assert {p.name for p in tmp_path.glob("*.png")} == {"record-time.png", "record-path.png"}
    assert "follow: the edge is in view" in done.output


def seen(t: float, **about: object) -> dict[str, object]:
    return {"edge_offset_m": 0.3, "confidence": 0.9, "crop_ahead_m": 1.0, "t": t} | about


def recorded(path: Path, along: list[tuple[float, float]], **about: str) -> Path:
    """A drive's record: telemetry, and dead reckoning along a path."""
    told = {"setpoint_rad": 0.1, "angle_rad": 0.1, "steer_duty": 0, "drive_duty": 90,
            "battery_v": 12.0, "faults": 4}  # fmt: skip
    with Recorder(path, about) as recorder:
        for number, (x, y) in enumerate(along):
            recorder.put("/telemetry", 0.1 * number, told)
            pilot = {"phase": "follow", "reason": "r", "x_m": x, "y_m": y, "offset_m": 0.0}
            recorder.put("/pilot", 0.1 * number, pilot)
            recorder.put("/command", 0.1 * number, {"speed_mps": 0.5, "blade": True})
            recorder.put("/view", 0.1 * number, seen(0.1 * number, edge_offset_m=0.9))
    return path


def test_a_straight_drive_has_a_picture_that_shows_it(tmp_path: Path) -> None:
    along = [(0.1 * k, 1e-6 * k) for k in range(80)]
    figure = draw_path(series(recorded(tmp_path / "d.mcap", along)))
    (axes,) = figure.axes
    assert axes.get_ylim()[1] - axes.get_ylim()[0] == pytest.approx(
        axes.get_xlim()[1] - axes.get_xlim()[0]
    )
    names = axes.get_legend_handles_labels()[1]
    assert len(names) == len(set(names))
    assert "follow" in names


def test_what_was_seen_for_sure_lies_within_the_scale(tmp_path: Path) -> None:
    figure = draw_time(series(recorded(tmp_path / "d.mcap", [(0.1 * k, 0.0) for k in range(9)])))
    edge = figure.axes[2]
    assert edge.get_ylim()[1] > 90  # cm


def test_the_setpoint_is_drawn_above_the_angle(tmp_path: Path) -> None:
    figure = draw_time(series(recorded(tmp_path / "d.mcap", [(0.1 * k, 0.0) for k in range(9)])))
    angle, setpoint = figure.axes[0].lines
    assert (angle.get_label(), setpoint.get_label()) == ("angle", "setpoint")
    assert setpoint.get_linewidth() < angle.get_linewidth()


def test_a_drive_has_a_report_by_its_record_or_its_folder(tmp_path: Path) -> None:
    evil = "2026-04-01T08:00:00.5</script><script>alert(1)"
    path = recorded(tmp_path / "drive-1.mcap", [(0.1 * k, 0.0) for k in range(9)], begun=evil)
    complete(report_of(path))
    page = (tmp_path / "drive-1.report.html").read_text()
    assert "alert(1)</" not in page
    assert protocol.fault_texts(protocol.Fault(4))[0] in html.unescape(page)
    complete(report_of(tmp_path))
    recorded(tmp_path / "drive-2.mcap", [(0.0, 0.0)])
    with pytest.raises(UserError, match=r"drive-1\.mcap, drive-2\.mcap"):
        report_of(tmp_path)


def test_plot_and_report_say_what_a_record_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recorded(tmp_path / "drive-1.mcap", [(0.1 * k, 0.0) for k in range(40_000)])
    whole = path.read_bytes()
    for size, lacks in ((len(whole), False), (len(whole) // 2, True)):
        path.write_bytes(whole[:size])
        for verb in ("plot", "report"):
            with pytest.raises(SystemExit) as exit_:
                run_command(cli, "daranti-hil", [verb, str(path)])
            assert exit_.value.code == 0
            out, err = capsys.readouterr()
            assert "written: " in out
            assert (f"warning: {path} is not whole: its last message is of" in err) == lacks
        page = (tmp_path / "drive-1.report.html").read_text()
        assert ("The record is not whole" in page) == lacks


def test_a_rig_has_a_report_also_before_it_ends(tmp_path: Path) -> None:
    (tmp_path / "rig.json").write_text(json.dumps({"port": "/dev/pts/7"}))
    complete(report_of(tmp_path))
    assert "has not ended" in (tmp_path / "report.html").read_text()
    summary = {"coverage": 0.5, "late_p99_ms": 3.0, "faults_injected": [["3 s", "pot off", "x"]]}
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    complete(report_of(tmp_path))
    text = (tmp_path / "report.html").read_text()
    assert "pot off" in text
    assert "at least 0.95: MISSED" in text


def test_what_was_broken_off_has_a_report_of_what_there_is(tmp_path: Path) -> None:
    done = tmp_path / "campaign" / "runs" / "a-1"
    done.mkdir(parents=True)
    (done.parent / "a-2").mkdir()
    one = {"scenario": "a", "outcome": "finished", "reason": "done", "coverage": 1.0}
    (done / "summary.json").write_text(json.dumps(one))
    complete(report_of(tmp_path / "campaign"))
    assert "1 runs, broken off" in (tmp_path / "campaign" / "report.html").read_text()
    matrix = tmp_path / "matrix"
    matrix.mkdir()
    good = Verdict("pot off", "follow", "stop", "250 ms", "firmware", 9.0, 12.0, 0.1, True, "ok")
    line = json.dumps({"digest": "x", "verdict": asdict(good)})
    (matrix / "verdicts.jsonl").write_text(f"{line}\n{line[:30]}")
    complete(report_of(matrix))
    assert "faults, broken off" in (matrix / "report.html").read_text()


def test_the_map_counts_from_corner_0_as_the_plan_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Figure] = []
    save = Figure.savefig

    def show(figure: Figure, *args: Any, **how: Any) -> None:
        shown.append(figure)
        save(figure, *args, **how)

    monkeypatch.setattr(Figure, "savefig", show)
    ring = ((30.0, 20.0), (36.0, 20.0), (36.0, 24.0), (30.0, 24.0))
    crop = Field(FieldSpec(polygon=ring, neighbours="none"), 1)
    draw_map(tmp_path / "map.png", crop, [(0.0, 31.0, 22.0, 0.0, Phase.FOLLOW)], "t")
    (axes,) = shown[0].axes
    numbers = {text.get_text(): text.xy for text in axes.texts if isinstance(text, Annotation)}
    assert tuple(numbers["0"]) == (0.0, 0.0)
    assert axes.get_xlabel() == "east of corner 0 (m)"


def test_units_and_marks_stand_beside_figures() -> None:
    grid = compared({"coverage": 0.9, "outside_m": 0.05, "late_p99_ms": 2.0}, None, ("", ""))
    assert [cells[2:] for _, cells in grid.rows] == [
        ["of 1", "at least 0.95: MISSED"], ["m", "at most 0.1"], ["ms", ""],
    ]  # fmt: skip
    assert [mark for mark, _ in grid.rows] == ["bad", "", ""]


def test_better_and_worse_are_told_apart() -> None:
    ours = {"coverage": 0.99, "missed_m2": 1.0, "end_of_field_error_worst_m": -0.5, "seed": 2}
    theirs = {"coverage": 0.98, "missed_m2": 2.0, "end_of_field_error_worst_m": 0.3, "seed": 1}
    marks = {cells[0]: mark for mark, cells in compared(ours, theirs, ("a", "b")).rows}
    assert marks == {
        "coverage": "good",
        "missed_m2": "good",
        "end_of_field_error_worst_m": "bad",
        "seed": "",
    }


def test_text_cannot_become_markup() -> None:
    evil = "<script>alert(1)</script>"
    text = render(evil, [Section(evil, evil, Grid((evil,), [("", [evil])]))])
    assert "<script" not in text
    Page(text)


def test_a_campaigns_report_shows_every_run(tmp_path: Path) -> None:
    runs = [
        {"scenario": "a", "run": f"a-{k}", "outcome": "finished", "coverage": 0.9 + k / 100,
         "neighbour_cut_m2": 0.0, "outside_m": 0.0, "reason": "done"}
        for k in range(5)
    ]  # fmt: skip
    runs.append({"scenario": "b", "run": "b-0", "outcome": "crashed", "reason": "boom"})
    runs[0]["events"] = [
        {"t": 1.0, "phase": "hesitate", "reason": "dust 3 m ahead"},
        {"t": 8.0, "phase": "follow", "reason": ""},
    ]
    rows = [{"scenario": "a", "runs": 5, "finished": 5}, {"scenario": "b", "runs": 1}]
    path = campaign_report(tmp_path, runs, rows)
    complete(path)
    text = path.read_text()
    assert all(str(run["run"]) in text for run in runs)
    assert text.index("b-0") < text.index("a-4")
    assert "6 runs: 5 finished, 1 crashed. Of those that finished: 5 crop left." in text
    # The hesitation of 7 s.
    assert re.search(r"dust # m ahead</td>\s*<td[^>]*>1</td>\s*<td[^>]*>1</td>\s*<td[^>]*>7<", text)


def test_a_campaigns_report_says_first_what_went_wrong(tmp_path: Path) -> None:
    """Made anew from its folder, too, where the worlds are not at hand."""
    runs = [
        {"scenario": "a", "run": f"a-{k}", "outcome": "fault", "coverage": 0.5, "missed_m2": 9.0,
         "reason": f"lost after {k} s", "events": [{"t": 0.0, "phase": "turn", "reason": ""}] * 2}
        for k in range(4)
    ]  # fmt: skip
    (tmp_path / "campaign.json").write_text(json.dumps(runs))
    text = report_of(tmp_path).read_text()
    complete(tmp_path / "report.html")
    assert "4 runs: 4 fault." in text
    assert text.index("lost after # s") < text.index("lost after 3 s")
    assert "The worst" not in text


def test_a_campaigns_worst_runs_are_shown_by_the_maps_that_were_drawn_of_them(
    tmp_path: Path,
) -> None:
    """In the run's own folder, or where the same field was driven again for its map."""
    runs = [
        {"scenario": "a", "run": f"a-{k}-5c33", "outcome": "fault", "coverage": k / 10,
         "reason": f"lost {k}"}
        for k in range(3)
    ]  # fmt: skip
    (tmp_path / "campaign.json").write_text(json.dumps(runs))
    for folder in ("runs/a-2-5c33", "maps/runs/a-1-2fbc"):
        (tmp_path / folder).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / folder / "map.png"), np.zeros((4, 4, 3), np.uint8))
    text = report_of(tmp_path).read_text()
    assert "a-1-5c33: fault, coverage 0.1" in text
    assert "a-2-5c33: fault, coverage 0.2" in text
    assert "a-0-5c33: fault" not in text


def test_where_a_campaigns_runs_stopped_is_shown_and_not_where_they_finished(
    tmp_path: Path,
) -> None:
    runs = [
        {"scenario": "a", "run": f"a-{k}-5c33", "outcome": outcome, "coverage": 0.5, "reason": why}
        for k, (outcome, why) in enumerate((("fault", "lost"), ("finished", "all cut")))
    ]
    (tmp_path / "campaign.json").write_text(json.dumps(runs))
    for k in range(2):
        (tmp_path / f"runs/a-{k}-5c33").mkdir(parents=True)
        decided = tmp_path / f"runs/a-{k}-5c33" / "decisions.png"
        cv2.imwrite(str(decided), np.zeros((4, 4, 3), np.uint8))
    text = report_of(tmp_path).read_text()
    assert "Where they stopped" in text
    assert "a-0-5c33: lost" in text
    assert "a-1-5c33: all cut" not in text


def test_a_fault_matrix_report_marks_what_is_unsafe(tmp_path: Path) -> None:
    good = Verdict("pot off", "follow", "stop", "250 ms", "firmware", 9.0, 12.0, 0.1, True, "ok")
    bad = Verdict("pot stuck", "turn", "stop", "250 ms", "nobody", None, None, 2.0, False, "UNSAFE")
    path = faults_report(tmp_path, "faults", [good, bad])
    complete(path)
    assert path.read_text().count('class="bad"') == 1


def test_what_a_record_or_a_rig_is_to_be_compared_with_is_not_passed_over(tmp_path: Path) -> None:
    (rig := tmp_path / "rig").mkdir()
    (rig / "rig.json").write_text("{}")
    (alone := tmp_path / "alone").mkdir()
    (alone / "record.mcap").write_bytes(b"")
    for where in (rig, alone, alone / "record.mcap"):
        with pytest.raises(UserError, match="--against compares the folders of two"):
            report_of(where, tmp_path)


def test_a_folder_without_results_is_one_message(tmp_path: Path) -> None:
    done = CliRunner().invoke(report, [str(tmp_path)])
    assert isinstance(done.exception, UserError)
    assert "holds no results" in str(done.exception)
