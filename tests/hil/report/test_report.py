"""Facts about reports and plots: one file, complete in itself, that a browser shows."""

from __future__ import annotations

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil.bench.harvest import Harvest, harvest
from hil.commands.plot import plot
from hil.commands.report import report
from hil.firmware import targets
from hil.judge.fault_verdict import Verdict
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
    assert "url(" not in path.read_text(encoding="utf-8")
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
        "<script>addEventListener('load', () => document.body.append("
        "[...document.images].map(i => i.naturalWidth > 0).join() + ' ' + innerWidth + ' ' +"
        "(document.documentElement.scrollWidth <= innerWidth)))</script>"
    )
    page = tmp_path / "probe.html"
    page.write_text((run / "report.html").read_text().replace("</body>", probe + "</body>"))
    assert BROWSER is not None
    shown = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", page.as_uri()],
        check=True, capture_output=True, text=True, timeout=100,
    ).stdout  # fmt: skip
    loaded, _, fits = shown[shown.rindex("</section>") :].split("</script>")[-1].partition(" ")
    assert re.fullmatch(r"(true,)*true", loaded.strip()), shown[-300:]
    assert fits.split("<")[0].split()[-1] == "true"


@needs_firmware
def test_two_runs_stand_side_by_side(run: Path, tmp_path: Path) -> None:
    harvest(quick(limits={"time_s": 2.0}), tmp_path)
    page = complete(report_of(run, tmp_path))
    assert "difference" in (run / "report.html").read_text()
    assert page.tags.count("img") >= 4


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
    rows = [{"scenario": "a", "runs": 5, "finished": 5}, {"scenario": "b", "runs": 1}]
    path = campaign_report(tmp_path, runs, rows)
    complete(path)
    text = path.read_text()
    assert all(str(run["run"]) in text for run in runs)
    assert text.index("b-0") < text.index("a-4")


def test_a_fault_matrix_report_marks_what_is_unsafe(tmp_path: Path) -> None:
    good = Verdict("pot off", "follow", "stop", "250 ms", "firmware", 9.0, 12.0, 0.1, True, "ok")
    bad = Verdict("pot stuck", "turn", "stop", "250 ms", "nobody", None, None, 2.0, False, "UNSAFE")
    path = faults_report(tmp_path, "faults", [good, bad])
    complete(path)
    assert path.read_text().count('class="bad"') == 1


def test_a_folder_without_results_is_one_message(tmp_path: Path) -> None:
    done = CliRunner().invoke(report, [str(tmp_path)])
    assert isinstance(done.exception, UserError)
    assert "holds no results" in str(done.exception)
