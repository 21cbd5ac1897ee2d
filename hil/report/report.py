"""`daranti-hil report`: report.html of a run, a rig, a drive, a campaign or a fault matrix, in one
file; of what was broken off as much as there is.

Nothing is loaded from anywhere: pictures, plots and the video are inside. With `--against` another
run or campaign stands beside it, figure by figure.
"""

from __future__ import annotations

import base64
import contextlib
import glob
import io
import json
import math
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import av
import cv2
import jinja2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.judge import pictures, plots
from hil.judge.causes import Cause, hesitations, went_wrong
from hil.judge.causes import causes as causes_of
from hil.judge.fault_verdict import Verdict
from hil.judge.figures import MISSED, better, cells_of
from hil.judge.overview import overview
from hil.report.zoom import over_time, resources
from host.core.errors import UserError
from host.core.whole_file import save_text
from host.link import protocol
from host.runs import record
from host.sensors.jpeg import JpegDecoder

VIDEO_WIDTH = 320
"""Pixels of the film in a report, which mail still carries."""
VIDEO_FRAMES = 400
"""At most so many; a longer run is shown in steps."""
VIDEO_FPS = 12.0
"""Of that film."""
WORST = 12
"""Maps shown of a campaign, at most."""

CAMPAIGN, VERDICTS, RIG = "campaign.json", "verdicts.jsonl", "rig.json"
RECORD = "record.mcap"
DECIDED = "What stood around it when it last decided, and, dashed, its edge as believed."
RUN_KEYS = ("run", "scenario", "outcome", "reason")
ZOOM = (
    "Turn the wheel to zoom, drag to move, click a name to hide its line; the round arrow shows "
    "all again."
)

Tell = Callable[[str], None]
"""What a person has to know besides the page, in words."""

FIGURE = re.compile(r"[-+]?[\d.]+(e[-+]?\d+)?|–|same")
"""A cell that stands on the right of its column."""


@dataclass(slots=True)
class Grid:
    """A table: cells are text; a row's mark is a CSS class ('', 'good', 'limit', 'bad')."""

    columns: Sequence[str]
    rows: list[tuple[str, list[str]]] = field(default_factory=list)


@dataclass(slots=True)
class Section:
    """One part of a report; what is None is not there."""

    title: str
    text: str = ""
    grid: Grid | None = None
    pictures: list[tuple[str, str]] = field(default_factory=list)
    """(data URI, caption)."""
    wide: bool = False
    """Pictures below each other, not side by side."""
    video: str | None = None
    """Data URI."""
    plot: str = ""
    """HTML of `hil.report.zoom`, put in as it is."""


def _silent(_: str) -> None:
    """Where nobody listens, the page says it alone."""


def _uri(data: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _drawn(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return _uri(buffer.getvalue(), "image/png")


def _file(path: Path) -> str | None:
    return _uri(path.read_bytes(), "image/png") if path.exists() else None


def show(value: object) -> str:
    """A figure as a table shows it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:g}"
    return str(value)


def render(title: str, sections: Sequence[Section]) -> str:
    """The page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["figure"] = FIGURE.fullmatch
    return environment.get_template("report.html.j2").render(
        title=title, sections=sections, scripts=resources(section.plot for section in sections)
    )


def write(out: Path, title: str, sections: Sequence[Section], name: str = "report.html") -> Path:
    """The page in the folder."""
    path = out / name
    save_text(path, render(title, sections))
    return path


# ---- comparing -----------------------------------------------------------------------------------


def compared(ours: dict[str, Any], theirs: dict[str, Any] | None, names: tuple[str, str]) -> Grid:
    """A summary's figures with their units and what they have to keep; beside another's, marked
    where this one is better or worse."""
    numbers = [k for k, v in ours.items() if isinstance(v, int | float) and not isinstance(v, bool)]
    if theirs is None:
        grid = Grid(("figure", "value", "unit", "must be"))
        for key in numbers:
            cells = cells_of(key, ours[key])
            grid.rows.append(("bad" if cells[3].endswith(MISSED) else "", list(cells)))
        return grid
    grid = Grid(("figure", *names, "unit", "difference", "must be"))
    for key in numbers:
        a, b = ours[key], theirs.get(key)
        mark, text = "", "–"
        if isinstance(b, int | float):
            text = f"{a - b:+g}" if a != b else "same"
            won = better(key, a, b)
            mark = "" if won is None else "good" if won else "bad"
        _, shown, unit, must = cells_of(key, a)
        grid.rows.append((mark, [key, shown, show(b), unit, text, must]))
    return grid


# ---- video ---------------------------------------------------------------------------------------


def _frames_of_file(path: Path) -> Iterator[NDArray[np.uint8]]:
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield np.asarray(frame.to_ndarray(format="bgr24"), np.uint8)


def _frames_of_record(path: Path) -> Iterator[NDArray[np.uint8]]:
    decoder = JpegDecoder()
    for topic, _, message in record.read(path):
        if topic == "/camera":
            bgr = decoder.decode(message["data"])
            if bgr.size:
                yield bgr


def small_video(film: Path, kept: Path) -> str | None:
    """A run's film, or the pictures of its record, small enough to be carried in a page; None
    without pictures."""
    source = _frames_of_file if film.exists() else _frames_of_record
    path = film if film.exists() else kept
    if not path.exists():
        return None
    total = sum(1 for _ in source(path))
    if total == 0:
        return None
    step = max(1, math.ceil(total / VIDEO_FRAMES))
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch) / "small.mp4"
        video: pictures.Video | None = None
        for number, bgr in enumerate(source(path)):
            if number % step:
                continue
            height = 2 * round(bgr.shape[0] * VIDEO_WIDTH / bgr.shape[1] / 2)
            small = cv2.resize(bgr, (VIDEO_WIDTH, height), interpolation=cv2.INTER_AREA)
            video = video or pictures.Video(target, VIDEO_FPS, VIDEO_WIDTH, height)
            video.add(np.asarray(small, np.uint8))
        assert video is not None
        video.close()
        return _uri(target.read_bytes(), "video/mp4")


# ---- one run -------------------------------------------------------------------------------------


def record_sections(kept: Path, against: Path | None = None, tell: Tell = _silent) -> list[Section]:
    """What a record shows, and over time that of another beside it. Where one is not whole, it
    stands there, and `tell` is told."""
    data = plots.series(kept)
    sections = _cut_section(data, tell)
    sections.append(Section("Over time", ZOOM, plot=over_time(data)))
    if against is not None and against.exists():
        theirs = plots.series(against)
        sections += _cut_section(theirs, tell)
        plot = over_time(theirs)
        sections.append(Section(f"Over time: {against.parent.name}", ZOOM, plot=plot))
    grid = Grid(("since", "state", "why"))
    for since, phase, reason in data.phases:
        mark = "bad" if phase in ("fault", "hesitate") else ""
        grid.rows.append((mark, [f"{since:.1f} s", phase, reason]))
    sections.append(Section("What the pilot did", grid=grid))
    sections.append(Section("Where it went", pictures=[(_drawn(plots.draw_path(data)), "")]))
    word = protocol.Fault(int(np.bitwise_or.reduce(data.telemetry[:, 6].astype(np.int64))))
    texts = protocol.fault_texts(word)
    if texts:
        grid = Grid(("fault",), [("bad", [text]) for text in texts])
        sections.append(Section("Faults that the firmware reported", grid=grid))
    if data.faults:
        rows = [("", [f"{t:.2f} s", n, "begins" if b else "ends"]) for t, n, b in data.faults]
        sections.append(Section("Faults injected", grid=Grid(("at", "fault", ""), rows)))
    film = small_video(kept.with_name("camera.mp4"), kept)
    if film is not None:
        sections.append(Section("What the camera saw", video=film))
    about = record.about(kept)
    for name in ("scenario", "vehicle", "plan"):
        if name in about:
            text = json.dumps(json.loads(about[name]), indent=1)
            sections.append(Section(name.capitalize(), text=text))
            break
    return sections


def _cut_section(data: plots.Series, tell: Tell) -> list[Section]:
    if not data.cut:
        return []
    tell(data.cut)
    return [Section("The record is not whole", f"{data.cut}.")]


def run_sections(
    folder: Path, against: Path | None, tell: Tell = _silent
) -> tuple[str, list[Section]]:
    """Title and sections of one run's folder."""
    summary = plots.summary_beside(folder)
    other = plots.summary_beside(against) if against is not None else None
    if other is not None and "outcome" not in other:
        raise UserError(f"{against} is not the folder of a run: it has no summary.json of one")
    try:
        title = f"{summary['scenario']}, seed {summary['seed']}: {summary['outcome']}"
        reason = str(summary["reason"])
    except KeyError as error:
        raise UserError(f"{folder / 'summary.json'}: it has no {error}") from error
    names = (folder.name, against.name if against is not None else "")
    sections = [Section("Figures", reason, compared(summary, other, names))]
    sections += [*_maps([folder, against]), *_decisions(folder)]
    kept = folder / RECORD
    if kept.exists():
        theirs = against / RECORD if against is not None else None
        sections += record_sections(kept, theirs, tell)
    return title, sections


def _maps(folders: Sequence[Path | None]) -> list[Section]:
    maps = [
        (uri, place.name)
        for place in folders
        if place is not None and (uri := _file(place / "map.png")) is not None
    ]
    return [Section("Map", pictures=maps)] if maps else []


def _decisions(folder: Path) -> list[Section]:
    uri = _file(folder / "decisions.png")
    return [Section("Its last decisions", DECIDED, pictures=[(uri, "")])] if uri is not None else []


def rig_sections(folder: Path) -> tuple[str, list[Section]]:
    """Title and sections of what `daranti-hil rig` left, or has left so far."""
    about = plots.json_of(folder / RIG)
    grid = Grid(("", ""), [("", [str(key), str(value)]) for key, value in about.items()])
    sections = [Section("How it was reached", grid=grid)]
    summary = plots.summary_beside(folder)
    if not summary:
        why = "The rig has not ended, or was killed: it writes its figures when it ends."
        return "rig, not ended", [Section("Figures", why), *sections]
    figures = compared(summary, None, ("", ""))
    injected = summary.get("faults_injected") or []
    rows = [("", [str(cell) for cell in row]) for row in injected]
    sections = [Section("Figures", grid=figures), *_maps([folder]), *sections]
    if rows:
        sections.append(Section("Faults injected", grid=Grid(("at", "fault", ""), rows)))
    return f"rig: coverage {show(summary.get('coverage'))}", sections


def drive_sections(kept: Path, tell: Tell = _silent) -> tuple[str, list[Section]]:
    """Title and sections of a record alone: a drive's, or that of a run that was killed."""
    about = record.about(kept)
    begun = about.get("begun", "").partition(".")[0].replace("T", " ")
    title = f"{kept.stem}{', begun ' + begun if begun else ''}"
    return title, record_sections(kept, tell=tell)


# ---- many ----------------------------------------------------------------------------------------


def _spread_of(summaries: Sequence[dict[str, Any]]) -> Figure:
    """Coverage of every run, by scenario."""
    names = sorted({str(s["scenario"]) for s in summaries})
    figure = Figure(figsize=(10, 1.2 + 0.5 * len(names)), layout="constrained")
    axes = figure.subplots()
    for row, name in enumerate(names):
        for summary in summaries:
            if summary["scenario"] == name and summary.get("coverage") is not None:
                good = summary["outcome"] == "finished"
                axes.plot(
                    summary["coverage"], row, "o" if good else "x", ms=5, alpha=0.7,
                    color="tab:green" if good else "tab:red",
                )  # fmt: skip
    axes.set(yticks=range(len(names)), yticklabels=names, xlabel="coverage", xlim=(None, 1.005))
    axes.grid(alpha=0.3)
    return figure


def _kept(folder: Path, summary: dict[str, Any], name: str) -> str | None:
    """A picture of a run that kept its record, or of the same field driven again for its map."""
    run = str(summary["run"])
    drawn = str(summary.get("map", run))
    # The settings' hash apart, which is of the files that are kept, too.
    same = glob.escape(run.rpartition("-")[0])
    again = sorted(folder.glob(f"maps/runs/{same}-*/{name}"))
    for path in (*(folder / r / drawn / name for r in ("runs", "maps/runs")), *again):
        uri = _file(path)
        if uri is not None:
            return uri
    return None


def cause_sections(causes: Sequence[Cause], apart: Sequence[dict[str, Any]]) -> list[Section]:
    """What went wrong, the most frequent first, and where the two fidelities disagree."""
    sections = []
    if causes:
        grid = Grid(("outcome", "in", "reason", "runs", "share", "left m²", "told by", "such as"))
        for c in causes:
            cells = [c.outcome, c.state, c.reason, str(c.runs), f"{c.share:.1%}"]
            cells += [f"{c.left_m2:.1f}", c.circumstance, ", ".join(c.examples)]
            grid.rows.append(("bad" if c.outcome not in ("fault", "crop left") else "", cells))
        text = (
            "In: the pilot's state before. Left: crop that still stands, in the median of these "
            "runs. Told by: the circumstance that is the more frequent among these runs, by "
            "Fisher's exact test."
        )
        sections.append(Section("What went wrong, by how often", text, grid))
    if apart:
        columns = tuple(apart[0])
        grid = Grid(columns)
        for row in apart:
            grid.rows.append(("bad" if row["disagree"] else "", [show(row[k]) for k in columns]))
        count = sum(row["disagree"] for row in apart)
        text = f"{count} of {len(apart)} fields driven both ways disagree."
        sections.append(Section("By the model and by pictures", text, grid))
    return sections


def _hesitation_sections(summaries: Sequence[dict[str, Any]]) -> list[Section]:
    grid = Grid(("reason", "times", "runs", "s in all"))
    for reason, times, runs, seconds in hesitations(summaries):
        grid.rows.append(("", [reason, str(times), str(runs), f"{seconds:.0f}"]))
    return [Section("Hesitations, by the time they take", grid=grid)] if grid.rows else []


def _ended(summaries: Sequence[dict[str, Any]]) -> Section:
    """How many runs ended how."""
    count = Counter(str(s["outcome"]) for s in summaries)
    wrong = Counter(went_wrong(s) for s in summaries if s["outcome"] == "finished")
    ends = ", ".join(f"{n} {outcome}" for outcome, n in count.most_common())
    but = ", ".join(f"{n} {word}" for word, n in wrong.most_common() if word)
    text = f"{len(summaries)} runs: {ends}." + (f" Of those that finished: {but}." if but else "")
    return Section("How they ended", text)


def campaign_sections(
    folder: Path,
    summaries: Sequence[dict[str, Any]],
    rows: Sequence[dict[str, Any]],
    against: Sequence[dict[str, Any]] | None = None,
) -> list[Section]:
    """Sections of a campaign; `rows` and `against` as overview gives them."""
    columns = ("run", "outcome", "coverage", "neighbour_cut_m2", "outside_m", "why")
    grid = Grid(columns)
    ordered = sorted(
        summaries, key=lambda s: (s["outcome"] == "finished", s.get("coverage") or 0.0)
    )
    for s in ordered:
        mark = "" if s["outcome"] == "finished" else "bad"
        cells = [s["run"], s["outcome"], *(show(s.get(k)) for k in columns[2:5]), s["reason"]]
        grid.rows.append((mark, cells))
    maps = [
        (uri, f"{s['run']}: {s['outcome']}, coverage {show(s.get('coverage'))}. {s['reason']}")
        for s in ordered
        if (uri := _kept(folder, s, "map.png")) is not None
    ]
    sections = [Section("The worst", pictures=maps[:WORST])] if maps else []
    decisions = [
        (uri, f"{s['run']}: {s['reason']}")
        for s in ordered
        if s["outcome"] != "finished" and (uri := _kept(folder, s, "decisions.png")) is not None
    ]
    if decisions:
        sections.append(Section("Where they stopped", DECIDED, pictures=decisions[:WORST]))
    sections += _hesitation_sections(summaries)
    sections.append(Section("Every run's coverage", pictures=[(_drawn(_spread_of(summaries)), "")]))
    before = {str(row["scenario"]): row for row in against or ()}
    # That of all first.
    for row in sorted(rows, key=lambda row: row["scenario"] != "all"):
        other = before.get(str(row["scenario"]))
        sections.append(
            Section(f"Scenario {row['scenario']}", grid=compared(row, other, ("this", "against")))
        )
    sections.append(Section("All runs, the worst first", grid=grid))
    return sections


def campaign_report(
    folder: Path,
    summaries: Sequence[dict[str, Any]],
    rows: Sequence[dict[str, Any]],
    causes: Sequence[Cause] = (),
    apart: Sequence[dict[str, Any]] = (),
) -> Path:
    """report.html of a campaign."""
    sections = [_ended(summaries), *cause_sections(causes, apart)]
    sections += campaign_sections(folder, summaries, rows)
    return write(folder, f"{len(summaries)} runs", sections)


def _latencies(verdicts: Sequence[Verdict]) -> Figure:
    """How long each stop took, against its bound."""
    stopped = [v for v in verdicts if v.stop_latency_ms is not None and v.expect == "stop"]
    figure = Figure(figsize=(10, 1 + 0.17 * len(stopped)), layout="constrained")
    axes = figure.subplots()
    for row, v in enumerate(reversed(stopped)):
        colour = "tab:green" if v.ok else "tab:orange" if v.limit else "tab:red"
        axes.barh(row, max(v.stop_latency_ms or 0.0, 1.0), color=colour)
        axes.plot([float(v.bound.split()[0])] * 2, [row - 0.4, row + 0.4], color="black", lw=1.5)
    labels = [f"{v.fault} ({v.situation})" for v in reversed(stopped)]
    axes.set(yticks=range(len(stopped)), xlabel="stop latency (ms); black: the bound", xscale="log")
    axes.set_yticklabels(labels, fontsize=7)
    axes.margins(y=0.01)
    axes.grid(alpha=0.3, axis="x")
    return figure


def faults_sections(verdicts: Sequence[Verdict]) -> list[Section]:
    """Sections of a fault matrix."""
    limits = sum(v.limit for v in verdicts)
    bad = sum(not v.ok for v in verdicts) - limits
    grid = Grid(
        ("fault", "while", "must", "within", "detected by", "after ms", "stop_latency_ms",
         "moved m", "verdict")
    )  # fmt: skip
    for v in verdicts:
        bound = v.bound if v.expect == "stop" else ""
        cells = [v.fault, v.situation, v.expect, bound, v.detected_by]
        cells += [show(v.detected_ms), show(v.stop_latency_ms), show(v.moved_m), v.verdict]
        grid.rows.append(("" if v.ok else "limit" if v.limit else "bad", cells))
    text = (
        f"{len(verdicts)} faults: {bad} unsafe or late (red), {limits} known limits (yellow), "
        "which nothing on board can notice in time. Times count from when the fault first made a "
        "difference; moved: until the machine rested, or over the whole watch where it drove on."
    )
    return [
        Section("Verdicts", text, grid),
        Section("Stop latencies", pictures=[(_drawn(_latencies(verdicts)), "")]),
    ]


def faults_report(folder: Path, title: str, verdicts: Sequence[Verdict]) -> Path:
    """report.html of a fault matrix."""
    return write(folder, title, faults_sections(verdicts))


def report_of(where: Path, against: Path | None = None, tell: Tell = _silent) -> Path:
    """The page of any kind of results, or of one record; `tell` is told what is missing in a
    record. UserError where it is none of them."""
    if where.is_file():
        _alone(where, against)
        return write(where.parent, *drive_sections(where, tell), f"{where.stem}.report.html")
    summaries = _campaign_of(where)
    if summaries is not None:
        others = _campaign_of(against) if against is not None else None
        if against is not None and others is None:
            raise UserError(f"{against} is not a campaign's folder: it has no campaign.json")
        before = overview(others) if others is not None else None
        # Without the worlds, no cause is told by a circumstance.
        sections = [_ended(summaries), *cause_sections(causes_of(summaries, []), ())]
        sections += campaign_sections(where, summaries, overview(summaries), before)
        cut = "" if (where / CAMPAIGN).exists() else ", broken off"
        return write(where, f"{len(summaries)} runs{cut}", sections)
    summary = plots.summary_beside(where)
    if "faults" in summary or (where / VERDICTS).exists():
        return _matrix_report(where, summary, against)
    if (where / RIG).exists():
        _alone(where, against)
        return write(where, *rig_sections(where))
    if "outcome" in summary:
        return write(where, *run_sections(where, against, tell))
    records = sorted(where.glob("*.mcap"))
    if len(records) == 1:
        _alone(where, against)
        return write(where, *drive_sections(records[0], tell))
    if records:
        names = ", ".join(path.name for path in records)
        raise UserError(f"{where} holds {len(records)} records ({names}): give one of them")
    raise UserError(
        f"{where} holds no results: give the folder of a harvest, a rig, a campaign or a fault "
        "matrix, or the record of a drive"
    )


def _alone(where: Path, against: Path | None) -> None:
    """UserError where something is to be compared with what has no figures to compare."""
    if against is not None:
        raise UserError(
            f"{where} is a record or a rig's folder: --against compares the folders of two "
            "harvests, campaigns or fault matrices"
        )


def _campaign_of(folder: Path) -> list[dict[str, Any]] | None:
    """The summaries of a campaign, or of as many runs as one that was broken off had finished; None
    where it is none. UserError where they are not such."""
    if (folder / CAMPAIGN).exists():
        found = plots.json_of(folder / CAMPAIGN, list)
        paths = [folder / CAMPAIGN] * len(found)
    else:
        paths = sorted(folder.glob("runs/*/summary.json"))
        found = [plots.json_of(path) | {"run": path.parent.name} for path in paths]
    for path, one in zip(paths, found, strict=True):
        missing = [key for key in RUN_KEYS if not isinstance(one, dict) or key not in one]
        if missing:
            raise UserError(f"{path} is no campaign's: a run has no {', '.join(missing)}")
    return found or None


def _matrix_report(folder: Path, summary: dict[str, Any], against: Path | None) -> Path:
    """Of a fault matrix, or of as much as one that was broken off had done."""
    whole = "faults" in summary
    entries = summary["faults"] if whole else _verdicts_of(folder / VERDICTS)
    try:
        verdicts = [Verdict(**v) for v in entries]
    except TypeError as error:
        raise UserError(f"{folder}: its verdicts are not those of today: {error}") from error
    title = f"faults, {summary.get('firmware', '?')} firmware" if whole else "faults, broken off"
    sections = faults_sections(verdicts)
    if against is not None:
        grid = _changed(verdicts, against)
        text = "" if grid.rows else f"Every verdict is that of {against.name}."
        sections.insert(0, Section("Against", text, grid if grid.rows else None))
    return write(folder, title, sections)


def _verdicts_of(path: Path) -> list[dict[str, Any]]:
    """A line that a killed call has left half is left out."""
    found = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            found.append(json.loads(line)["verdict"])
    return found


def _changed(verdicts: Sequence[Verdict], against: Path) -> Grid:
    """What another fault matrix said otherwise."""
    theirs = {
        (v["fault"], v["situation"]): v for v in plots.summary_beside(against).get("faults", [])
    }
    if not theirs:
        raise UserError(f"{against} is not a fault matrix's folder: its summary.json has no faults")
    grid = Grid(("fault", "while", "this", against.name))
    for v in verdicts:
        other = theirs.get((v.fault, v.situation))
        if other is not None and other["verdict"] != v.verdict:
            mark = "good" if v.ok else "limit" if v.limit else "bad"
            grid.rows.append((mark, [v.fault, v.situation, v.verdict, other["verdict"]]))
    return grid
