"""Facts about walks, the loops in them and the boundary that comes out."""

from __future__ import annotations

import contextlib
import datetime
import errno
import io
import math
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pynmea2
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.progress import Watch
from host.field.boundary_file import UNKNOWN_SIGMA_M, load_field
from host.field.corners import MAX_CORNERS
from host.field.rings import resampled
from host.field.smoothing import Smoother
from host.field.survey import (
    Survey,
    read_walk,
    record_walk,
    straight_sides,
    survey_track,
    with_keep_out,
)
from host.field.walk import (
    SPIKE_FIXES,
    Track,
    find_loops,
    read_fixes,
    track_of,
)
from host.sensors.nmea import Receiver
from sim_plant.gnss import Gnss, GnssSpec
from tests.helpers.console import Cli
from tests.helpers.real_data import real
from tests.helpers.walker import PERFECT, Place, around, walk

LIMIT_S = 60.0
ORIGIN = LocalFrame(PERFECT.lat_deg, PERFECT.lon_deg)
SQUARE: list[Place] = [(0, 0), (20, 0), (20, 20), (0, 20)]
ELL: list[Place] = [(0, 0), (30, 0), (30, 12), (14, 12), (14, 25), (0, 25)]
TREE: list[Place] = [(9, 9), (12, 9), (12, 12), (9, 12)]
THERE: list[Place] = [(-40, -30), (-25, -5), (-1, 0)]
SHAPES: dict[str, list[Place]] = {
    "triangle": [(0, 0), (40, 0), (10, 25)],
    "square": SQUARE,
    "trapezoid": [(0, 0), (30, 0), (24, 18), (4, 15)],
    "L": ELL,
    "pentagon": [(0, 0), (25, -5), (40, 10), (22, 28), (-4, 18)],
}


def tracked(lines: list[str]) -> Track:
    track = track_of(read_fixes((line.encode() + b"\r\n" for line in lines), Receiver()))
    assert track is not None
    return track


def in_field(survey: Survey) -> shapely.Polygon:
    """The surveyed field in the frame of the walker's places."""
    boundary = survey.boundary("")
    return boundary.polygon(ORIGIN)


def iou(a: shapely.Polygon, b: shapely.Polygon) -> float:
    return float(a.intersection(b).area / a.union(b).area)


# ---- from fixes to a track -----------------------------------------------------------------------


def fixes_at(places: list[Place], speed_mps: float | None = 1.0) -> list[Fix]:
    return [
        Fix(float(second), *ORIGIN.to_wgs84(x, y), 1, 1.0, 8, speed_mps)
        for second, (x, y) in enumerate(places)
    ]


LINE: list[Place] = [(float(k), 0.0) for k in range(40)]


def test_what_has_no_or_a_poor_position_is_left_out_and_counted() -> None:
    fixes = fixes_at(LINE)
    fixes[3] = Fix(3.0, math.nan, math.nan, 0, math.nan, 0)
    fixes[7] = Fix(7.0, *ORIGIN.to_wgs84(7, 0), 1, 9.9, 4)
    track = track_of(fixes)
    assert track is not None
    assert track.dropped == {"without a fix": 1, "HDOP above 5": 1}
    assert len(track.xy) == len(LINE) - 2
    assert not track.jumps_m.any(), "a missing fix is no jump"


@given(st.integers(1, SPIKE_FIXES), st.floats(15, 500), st.integers(1, 25))
def test_a_spike_is_rejected_and_the_walk_goes_on(length: int, height: float, at: int) -> None:
    places = [(x, height if at <= k < at + length else y) for k, (x, y) in enumerate(LINE)]
    track = track_of(fixes_at(places))
    assert track is not None
    assert track.dropped == {"spike": length}
    assert len(track.rejected) == length
    assert not track.jumps_m.any()


def test_a_jump_that_stays_is_marked_where_it_is() -> None:
    track = track_of(fixes_at([(x, 40.0 if k >= 20 else 0.0) for k, (x, _) in enumerate(LINE)]))
    assert track is not None
    assert np.flatnonzero(track.jumps_m).tolist() == [20]
    assert track.jumps_m[20] == pytest.approx(math.hypot(40, 1), rel=1e-3)
    assert track.length_m == pytest.approx(38, rel=1e-3)


def test_what_was_walked_unseen_counts_as_a_jump() -> None:
    fixes = fixes_at(LINE)
    track = track_of(fixes[:10] + fixes[35:])
    assert track is not None
    assert track.jumps_m[10] == pytest.approx(26, rel=1e-3)


def test_the_stamps_are_the_sentences_own_times_over_midnight_too() -> None:
    places = [(float(k), 0.0) for k in range(6)]
    spec = PERFECT.model_copy(
        update={"start": PERFECT.start.replace(hour=23, minute=59, second=57)}
    )
    lines = walk(places, spec)
    fixes = read_fixes((line.encode() + b"\r\n" for line in lines), Receiver())
    steps = {round(b.stamp - a.stamp, 6) for a, b in pairwise(fixes)}
    assert steps == {1.0}


def changed(lines: list[str], by: Callable[[pynmea2.RMC], None]) -> list[str]:
    """The same walk by a receiver whose RMC has something else in it."""
    out = []
    for line in lines:
        sentence = pynmea2.parse(line)
        if isinstance(sentence, pynmea2.RMC):
            by(sentence)
        out.append(str(sentence))
    return out


def says(knots: float, course: float, mirrored: bool = False) -> Callable[[pynmea2.RMC], None]:
    """Speed and course times so much."""

    def by(rmc: pynmea2.RMC) -> None:
        degrees = course * float(rmc.data[7] or 0)
        rmc.data[6] = f"{knots * float(rmc.data[6] or 0):.2f}"
        rmc.data[7] = f"{360 - degrees if mirrored else degrees:.1f}"

    return by


@pytest.mark.parametrize(
    "by",
    [says(0, 0), says(1, 0), says(1.852, 1), says(1, 1, mirrored=True)],
    ids=["no speed", "no course", "km/h", "mirrored"],
)
def test_a_velocity_that_is_none_leaves_the_boundary_alone(
    by: Callable[[pynmea2.RMC], None],
) -> None:
    lines = walk(around(SQUARE, laps=2))
    found = survey_track(tracked(changed(lines, by)))
    assert iou(in_field(found), shapely.Polygon(SQUARE)) > 0.98
    assert found.sigma_m == UNKNOWN_SIGMA_M
    assert survey_track(tracked(lines)).sigma_m < 0.3


def test_a_walk_whose_receiver_wandered_by_metres_is_to_be_walked_again() -> None:
    """To and fro by 10 m, once in a minute and a half: no lap closes badly, and no fix jumps."""
    wandered = []
    for k, fix in enumerate(_walked(around(SQUARE, laps=2))):
        x, y = ORIGIN.to_local(fix.lat_deg, fix.lon_deg)
        by = 10.0 * math.sin(k / 17)
        lat, lon = ORIGIN.to_wgs84(x + by, y + by / 2)
        wandered.append(replace(fix, lat_deg=lat, lon_deg=lon))
    track = track_of(wandered)
    assert track is not None
    found = survey_track(track)
    assert found.sigma_m > 1.5
    assert any("walk again" in text for text in found.warnings)


def test_positions_too_far_apart_in_time_are_refused_with_the_remedy(
    tmp_path: Path, cli: Cli
) -> None:
    places = [line for line in walk(around(SQUARE, laps=3)) if "GGA" in line]
    path = tmp_path / "walk.nmea"
    path.write_text("\n".join(places[::10]))
    code, _, err = cli("survey", str(path), "--out", str(tmp_path / "field.geojson"))
    assert code == 2
    assert f"{path}: its positions are 10 s apart" in err
    assert "set the app to one a second" in err


def test_sides_that_nobody_walked_along_are_not_fitted() -> None:
    track = tracked(walk(around(SQUARE)))
    elsewhere = np.array(SQUARE) + 500.0
    assert Smoother(track).sides(elsewhere, [(0, len(track.xy) - 1)]) is None


def test_no_position_at_all_is_no_track() -> None:
    assert track_of([Fix(0.0, math.nan, math.nan, 0, math.nan, 0)]) is None


# ---- loops ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("laps", [1, 2, 3, 5])
@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1], ELL], ids=["ccw", "cw", "L"])
def test_every_lap_is_found_and_the_way_there_is_not_in_it(laps: int, corners: list[Place]) -> None:
    loops = find_loops(tracked(walk([*THERE, *around(corners, laps), *THERE[::-1]])), 6.0)
    assert loops is not None
    area = shapely.Polygon(corners).area
    assert len(loops.laps) == laps
    for loop in loops.laps:
        assert loop.polygon.area == pytest.approx(area, rel=0.05)
        assert shapely.LinearRing(loop.xy).is_ccw
    assert loops.keep_outs == []


@pytest.mark.parametrize(
    "way",
    [
        [(0, 0), (100, 0)],
        [(0, 0), (100, 0), (0, 0)],
        [(0, 0), (100, 0), (100, 50), (100, 0), (0, 0)],
        [(0, 0), (20, 0), (20, 20), (0, 20)],
        [(0, 0), (0, 0)],
    ],
    ids=["a line", "there and back", "a corner and back", "a side missing", "standing"],
)
def test_a_walk_without_a_loop_has_none(way: list[Place]) -> None:
    track = tracked(walk(way))
    assert find_loops(track, 6.0) is None
    with pytest.raises(UserError, match="no closed loop"):
        survey_track(track)


def test_a_small_loop_on_a_way_that_never_closes_is_told() -> None:
    way = [(0, 0), *around(TREE), (100, 0), (100, 80), (0, 80)]
    said = " ".join(survey_track(tracked(walk(way))).warnings)
    assert "if it is larger, the walk did not come back to where it began" in said
    whole = [*THERE, *around(SQUARE), *THERE[::-1]]
    assert "did not come back" not in " ".join(survey_track(tracked(walk(whole))).warnings)


def test_a_small_loop_inside_is_a_keep_out_and_one_outside_is_not() -> None:
    far = [(x + 60, y) for x, y in TREE]
    way = [*around(SQUARE), (0, 10), *around(TREE), (0, 10), (0, 0), (60, 0), *around(far)]
    loops = find_loops(tracked(walk(way)), 2.0)
    assert loops is not None
    assert (len(loops.laps), len(loops.keep_outs), loops.others) == (1, 1, 1)
    found = survey_track(tracked(walk(way)), close_m=2.0)
    (hole,) = in_field(found).interiors
    assert iou(shapely.Polygon(hole), shapely.Polygon(TREE)) > 0.8
    assert any("outside the field" in text for text in found.warnings)


def test_a_lap_with_a_jump_is_left_aside_where_another_has_none() -> None:
    shifted = [(x, y + 5) for x, y in SQUARE]
    fixes = [
        *_walked([*around(SQUARE), *around(SQUARE)[:3]]),
        *_walked([*around(shifted)[2:], *around(shifted)[:1]]),
    ]
    renumbered = [
        Fix(float(k), f.lat_deg, f.lon_deg, 1, 1.0, 8, f.speed_mps) for k, f in enumerate(fixes)
    ]
    track = track_of(renumbered)
    assert track is not None
    assert track.jumps_m.max() == pytest.approx(5, abs=0.5)
    found = survey_track(track)
    assert iou(in_field(found), shapely.Polygon(SQUARE)) > 0.97


def _walked(way: list[Place]) -> list[Fix]:
    return read_fixes((line.encode() + b"\r\n" for line in walk(way)), Receiver())


# ---- the boundary --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHAPES)
def test_corners_are_counted_and_found(name: str) -> None:
    corners = SHAPES[name]
    found = survey_track(tracked(walk([*THERE, *around(corners, 2), *THERE[::-1]])))
    assert found.corners == len(corners)
    truth = shapely.MultiPoint(corners)
    for x, y in in_field(found).exterior.coords:
        assert truth.distance(shapely.Point(x, y)) < 0.3
    assert found.residual_m < 0.1
    assert found.warnings == []


@settings(max_examples=20, deadline=None)
@given(
    st.floats(0, math.tau),
    st.floats(12, 200),
    st.floats(0.3, 1.0),
    st.integers(0, 3),
    st.booleans(),
)
def test_a_rectangle_is_found_however_it_lies_and_is_walked(
    turn: float, length: float, aspect: float, start: int, clockwise: bool
) -> None:
    width = max(8.0, aspect * length)
    c, s = math.cos(turn), math.sin(turn)
    corners: list[Place] = [
        (c * x - s * y, s * x + c * y)
        for x, y in ((0, 0), (length, 0), (length, width), (0, width))
    ]
    if clockwise:
        corners.reverse()
    found = survey_track(tracked(walk(around(corners, 1, start))))
    assert found.corners == 4
    assert iou(in_field(found), shapely.Polygon(corners)) > 0.97


def test_laps_average_a_phones_drift_away() -> None:
    """Over twelve walks with 1 m CEP the mean of four laps has the shape better than one lap."""
    truth = shapely.Polygon(SQUARE)
    spec = GnssSpec(cep_m=1.0, jumps_per_hour=0.0, outages_per_hour=0.0)

    def error(laps: int, seed: int) -> float:
        found = survey_track(tracked(walk(around(SQUARE, laps), spec, seed)), corners=4)
        return abs(found.polygon.area / truth.area - 1)

    one, four = (float(np.mean([error(laps, seed) for seed in range(12)])) for laps in (1, 4))
    assert four < 0.7 * one


def test_a_phones_drift_makes_no_corners() -> None:
    spec = GnssSpec(cep_m=0.5, jumps_per_hour=0.0, outages_per_hour=0.0)
    counted = [survey_track(tracked(walk(around(SQUARE), spec, seed))).corners for seed in range(8)]
    assert counted == [4] * 8


def test_one_lap_can_be_taken_alone() -> None:
    larger = [(1.2 * x, 1.2 * y) for x, y in SQUARE]
    track = tracked(walk([*around(SQUARE), *around(larger)]))
    areas = [survey_track(track, lap=lap).polygon.area for lap in (1, 2)]
    assert areas == pytest.approx([400, 576], rel=0.03)
    with pytest.raises(UserError, match="--lap 3: the walk has 2 laps"):
        survey_track(track, lap=3)


def test_an_irregular_field_keeps_its_edge() -> None:
    angles = np.linspace(0, math.tau, 200, endpoint=False)
    radii = 25 + 3 * np.cos(3 * angles)
    blob: list[Place] = [
        (float(r * math.cos(a)), float(r * math.sin(a))) for r, a in zip(radii, angles, strict=True)
    ]
    lines = walk(around(blob), seed=1)
    found = survey_track(tracked(lines), irregular=True)
    assert found.corners is None
    assert iou(in_field(found), shapely.Polygon(blob)) > 0.98
    assert len(found.polygon.exterior.coords) < 80
    straight = survey_track(tracked(lines), corners=4)
    assert any("--irregular keeps the edge" in text for text in straight.warnings)
    assert (found.boundary("").recorded, straight.boundary("").recorded) == (True, False)


def test_a_long_survey_says_what_it_is_at(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []

    class Noted(Watch):
        def reach(self, done: float, text: str = "") -> None:
            told.append(text)
            super().reach(done, text)

    monkeypatch.setattr("host.commands.survey.Watch", Noted)
    source, out = tmp_path / "walk.nmea", tmp_path / "field.geojson"
    source.write_text("\r\n".join(walk(around(SQUARE, 20))))
    code, _, _ = cli("survey", str(source), "--out", str(out))
    assert code == 0
    read = [int(text.split()[1]) for text in told if text.startswith("reading, ")]
    assert read == sorted(read)
    assert len(read) > 3
    for stage in ("smoothing ", "looking for laps", "looking for the edge in 20 laps", "drawing"):
        assert any(text.startswith(stage) for text in told), stage


def oval(along_m: float, across_m: float) -> list[Place]:
    """An ellipse of these half axes, a corner every 1.5 m or so."""
    angles = np.linspace(0, math.tau, round(math.tau * along_m / 1.5), endpoint=False)
    return [(along_m * math.cos(a), across_m * math.sin(a)) for a in angles.tolist()]


@pytest.mark.parametrize("half_axes", [(14.0, 14.0), (20.0, 20.0), (25.0, 25.0), (24.0, 15.0)])
def test_sides_that_bulge_are_told(half_axes: tuple[float, float]) -> None:
    """The walk is never a metre from 7 to 12 straight sides of a round field, and follows none."""
    phone = GnssSpec(cep_m=1.0, outages_per_hour=0.0, jumps_per_hour=0.0)
    found = survey_track(tracked(smoothly(oval(*half_axes), phone)))
    assert found.residual_m < 0.6
    assert found.seems_to_bend
    assert any("--irregular keeps the edge as it was walked" in text for text in found.warnings)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", range(2))
def test_straight_sides_do_not_bulge(name: str, seed: int) -> None:
    phone = GnssSpec(cep_m=2.5, outages_per_hour=0.0)
    found = survey_track(tracked(walk(around(SHAPES[name], 1 + seed), phone, seed)))
    assert not found.seems_to_bend
    assert not any("--irregular" in text for text in found.warnings)


@pytest.mark.parametrize("seed", [0, 9])
def test_corner_0_is_where_the_walk_began_whichever_laps_close_best(seed: int) -> None:
    """Three times around a round field, where any second of the walk may begin a lap; of seed 9 the
    first lap that closes begins eleven seconds after the walk."""
    phone = GnssSpec(cep_m=0.9, outages_per_hour=0.0, jumps_per_hour=0.0)
    begin = (14.0, 0.0)
    track = tracked(walk(around(oval(14.0, 14.0), 3), phone, seed))
    edge = in_field(survey_track(track, irregular=True)).exterior
    off = shapely.distance(shapely.Point(begin), edge)
    assert math.dist(edge.coords[0], begin) < off + 3.0


def test_who_came_from_elsewhere_began_where_the_lap_did() -> None:
    """Past another corner, which is nearer to where he came from."""
    way: list[Place] = [(50, 50), (50, -15), (-5, -10), (-1, 0)]
    track = tracked(walk([*way, *around(SQUARE)]))
    corner = in_field(survey_track(track)).exterior.coords[0]
    assert math.dist(corner, SQUARE[0]) < 1.0


def test_as_many_sides_as_are_looked_for_may_be_a_bent_edge() -> None:
    """Where more would fit still better, nothing else tells."""
    found = survey_track(tracked(walk(around(SQUARE))))
    assert not found.seems_to_bend
    assert not replace(found, corners=MAX_CORNERS - 1).seems_to_bend
    assert replace(found, corners=MAX_CORNERS).seems_to_bend


def smoothly(ring: list[Place], phone: GnssSpec) -> list[str]:
    """Sentences of a walk around a ring at 1.3 m/s without a stop."""
    closed = np.array([*ring, ring[0]])
    done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.arange(0.0, done[-1], 1.3)
    x, y = (np.interp(at, done, values) for values in closed.T)
    gnss, lines = Gnss(phone, 1), []
    for k in range(len(at) - 1):
        vx, vy = float(x[k + 1] - x[k]), float(y[k + 1] - y[k])
        lines += gnss.epoch(float(k), float(x[k]), float(y[k]), vx, vy)
    return lines


def test_how_surely_an_irregular_edge_is_known_is_no_surer_than_a_walker_keeps_to_it() -> None:
    """With a receiver that hardly errs."""
    phone = PERFECT.model_copy(update={"cep_m": 0.01, "white_m": 0.0, "speed_noise_mps": 0.0})
    track = tracked(walk(around(ELL, laps=2), phone))
    assert survey_track(track).sigma_m < 0.15
    assert survey_track(track, irregular=True).sigma_m >= 0.2


def test_corners_that_are_not_there_are_refused() -> None:
    with pytest.raises(UserError, match="5 straight sides"):
        straight_sides([resampled(np.array(SQUARE, dtype=float), 200)], 5)


def test_a_keep_out_may_be_a_walk_of_its_own() -> None:
    field = survey_track(tracked(walk(around(SQUARE))))
    found = with_keep_out(field, tracked(walk(around(TREE, 2))), "tree.nmea")
    (hole,) = in_field(found).interiors
    assert iou(shapely.Polygon(hole), shapely.Polygon(TREE)) > 0.8
    assert shapely.Polygon(hole).buffer(0.01).contains(shapely.Polygon(TREE)), "nothing is cut off"
    far = tracked(walk(around([(x + 50, y) for x, y in TREE])))
    with pytest.raises(UserError, match=r"tree\.nmea: the keep-out does not lie inside"):
        with_keep_out(field, far, "tree.nmea")


# ---- the command ---------------------------------------------------------------------------------


def recorded(folder: Path, lines: list[str], name: str = "walk.nmea") -> Path:
    path = folder / name
    path.write_text("".join(line + "\r\n" for line in lines))
    return path


def test_the_command_writes_field_and_picture_and_counts_what_was_bad(
    tmp_path: Path, cli: Cli
) -> None:
    lines = walk(around(SQUARE, 2), PERFECT.model_copy(update={"first_fix_s": 10.0}))
    lines[300] = lines[300].replace("*", "0*")
    lines.insert(400, "noise")
    source, out = recorded(tmp_path, lines), tmp_path / "field.geojson"
    tree = recorded(tmp_path, walk(around(TREE)), "tree.nmea")
    code, text, err = cli("survey", str(source), "--out", str(out), "--keep-out", str(tree))
    assert (code, err) == (0, "")
    assert "bad: 1 checksum, 1 malformed" in text
    assert "left out: 10 without a fix" in text
    assert "4 corners" in text
    assert "1 keep-outs" in text
    field = load_field(out)
    assert field.name == "field"
    assert len(field.keep_outs) == 1
    assert out.with_suffix(".png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (b"", [], "not one position in it (understood: nothing; bad: none)"),
        (b"\xff\x00\n" * 3, [], "not one position in it (understood: nothing; bad: 3 not ASCII)"),
        (b"a picture\n", [], "it is no NMEA text"),
        (b"$GPGGA,,,,,,0,,,,,,,,*66\n", [], "understood: 1 GGA; bad: none); wait under open sky"),
        (b"$GPGGA,,,,,,0,,,,,,,,\n", [], "the checksum at a sentence's end is missing"),
        (b"", ["--irregular", "--corners", "4"], "exclude each other"),
        (b"", ["--corners", "two"], "give auto or a number from 3"),
        (b"", ["--lap", "0"], "0 is not in the range"),
    ],
)
def test_a_walk_that_cannot_be_used_is_one_message(
    tmp_path: Path, cli: Cli, content: bytes, options: list[str], message: str
) -> None:
    source = tmp_path / "walk.nmea"
    source.write_bytes(content)
    out = tmp_path / "field.geojson"
    code, _, err = cli("survey", str(source), "--out", str(out), *options)
    assert code == 2
    assert message in err
    assert not out.exists()


def test_a_source_that_is_not_there_is_said(tmp_path: Path, cli: Cli) -> None:
    code, _, err = cli("survey", str(tmp_path / "no"), "--out", str(tmp_path / "field.kml"))
    assert code == 2
    assert "does not exist" in err
    assert not list(tmp_path.iterdir()), "nothing is left that would be in the next walk's way"


def test_an_empty_recording_is_not_in_a_walks_way(tmp_path: Path) -> None:
    path = tmp_path / "field.nmea"
    path.touch()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        said: list[str] = []

        def say(text: str) -> None:
            said.append(text)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            record_walk(f"tcp://127.0.0.1:{listener.getsockname()[1]}", path, say)
    assert said[0].startswith("recording tcp://")


def test_a_walk_is_recorded_from_the_phone_until_ctrl_c(tmp_path: Path) -> None:
    stream = "".join(line + "\r\n" for line in walk(around(SQUARE))).encode()
    out = tmp_path / "field.geojson"
    recording = out.with_suffix(".nmea")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        command = [sys.executable, "-c", "from host.commands.cli import main; main()", "survey"]
        url = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        process = subprocess.Popen(
            [*command, url, "--out", str(out)], stdout=subprocess.PIPE, text=True
        )
        try:
            listener.settimeout(LIMIT_S)
            phone, _ = listener.accept()
            with phone:
                # What comes while a port is being opened is thrown away: speak until heard.
                deadline = time.monotonic() + LIMIT_S
                while not (recording.is_file() and recording.stat().st_size):
                    assert time.monotonic() < deadline
                    phone.sendall(b"\r\n")
                    time.sleep(0.01)
                phone.sendall(stream)
                while recording.stat().st_size < len(stream):
                    assert time.monotonic() < deadline
                    time.sleep(0.01)
                process.send_signal(signal.SIGINT)
                text, _ = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
    assert process.returncode == 0
    assert "4 corners" in text
    assert recording.read_bytes().endswith(stream)
    assert load_field(out).crop


def test_a_walk_that_can_no_longer_be_recorded_ends_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Full(io.RawIOBase):
        def write(self, _: Any) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "open", lambda *_, **__: Full())
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def speak() -> None:
            phone, _ = listener.accept()
            with phone, contextlib.suppress(OSError):
                phone.sendall("".join(f"{line}\r\n" for line in walk(around(SQUARE))).encode())
                phone.recv(1)

        threading.Thread(target=speak, daemon=True).start()
        url = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        with pytest.raises(UserError, match="ends after 0 positions: No space left on device"):
            record_walk(url, tmp_path / "field.nmea", lambda _: None)


def test_a_recorded_walk_is_not_written_over(tmp_path: Path, cli: Cli) -> None:
    recorded(tmp_path, ["precious"], "field.nmea")
    code, _, err = cli("survey", "tcp://127.0.0.1:9", "--out", str(tmp_path / "field.kml"))
    assert code == 2
    assert "is there already" in err


def test_a_target_that_cannot_be_is_said_before_the_walk(tmp_path: Path, cli: Cli) -> None:
    code, _, err = cli("survey", "tcp://127.0.0.1:9", "--out", str(tmp_path / "field.dwg"))
    assert code == 2
    assert "its suffix names no format" in err


def test_a_real_phones_walk_becomes_a_closed_boundary(tmp_path: Path, cli: Cli) -> None:
    path = real("gps/phone-walk.nmea")
    out = tmp_path / "walk.kml"
    code, text, _ = cli("survey", str(path), "--out", str(out), "--irregular")
    assert code == 0
    assert "2712 GGA, 2712 GSA, 16245 GSV, 2712 RMC, 2712 VTG; bad: none" in text
    assert "2628 used, left out: 84 without a fix" in text
    assert "40.1" in text, "its one jump"
    field = load_field(out)
    polygon = field.polygon(field.frame)
    assert polygon.is_valid
    assert polygon.area == pytest.approx(43_400, rel=0.01)


def gpx(path: Path, segments: list[list[tuple[Place, float | None]]]) -> Path:
    """As phone apps write it: a track of segments of places with their seconds of the day."""
    text = ""
    for segment in segments:
        text += "<trkseg>"
        for place, second in segment:
            lat, lon = ORIGIN.to_wgs84(*place)
            text += f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><ele>312</ele>'
            if second is not None:
                when = datetime.datetime(2026, 6, 1, 22, 59) + datetime.timedelta(seconds=second)
                text += f"<time>{when.isoformat()}.000Z</time>"
            text += "</trkpt>"
        text += "</trkseg>"
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" creator="OsmAnd" '
        f'xmlns="http://www.topografix.com/GPX/1/1"><trk><name>w</name>{text}</trk></gpx>'
    )
    return path


@pytest.mark.parametrize("seconds", [10.0, None])
@pytest.mark.parametrize("cut", [(), (3, 7)])
def test_a_phone_apps_gpx_is_a_walk(
    tmp_path: Path, cli: Cli, seconds: float | None, cut: tuple[int, ...]
) -> None:
    way = shapely.segmentize(shapely.LineString([*SQUARE, *SQUARE, SQUARE[0]]), 12.0).coords
    timed = [(place, None if seconds is None else k * seconds) for k, place in enumerate(way)]
    ends = [0, *cut, len(timed)]
    # An app that pauses by itself begins its next segment where it stood.
    segments = [timed[max(0, a - 1) : b] for a, b in pairwise(ends)]
    path = gpx(tmp_path / "walk.gpx", segments)
    code, text, err = cli("survey", str(path), "--out", str(tmp_path / "field.geojson"))
    assert code == 0, err
    assert f"{len(timed) + len(cut)} GPX point; bad: none" in text
    assert "left out: none" in text
    assert "jumps and unseen ways: 0" in text
    assert "laps: 2" in text
    found = load_field(tmp_path / "field.geojson").polygon(ORIGIN)
    assert iou(found, shapely.Polygon(SQUARE)) > 0.99


def test_a_place_that_the_walk_marks_is_said_to_be_no_keep_out(tmp_path: Path, cli: Cli) -> None:
    way = [*SQUARE, SQUARE[0]]
    path = gpx(tmp_path / "walk.gpx", [[(place, k * 50.0) for k, place in enumerate(way)]])
    places = {"the well": shapely.Polygon(SQUARE).centroid.coords[0], "home": (-200.0, 0.0)}
    for name, place in places.items():
        lat, lon = ORIGIN.to_wgs84(*place)
        mark = f'<wpt lat="{lat}" lon="{lon}"><name>{name}</name></wpt>'
        path.write_text(path.read_text().replace("<trk>", f"{mark}<trk>"))
    out = tmp_path / "field.geojson"
    code, text, err = cli("survey", str(path), "--out", str(out))
    assert code == 0, err
    assert "warning: the file has in the field, and not as a keep-out: 'the well' (Point)" in text
    assert "home" not in text
    assert "the well" in load_field(out).not_kept_out, "whoever plans with it is told as well"


def test_what_an_app_did_not_see_for_a_minute_is_a_jump(tmp_path: Path) -> None:
    path = gpx(tmp_path / "walk.gpx", [[((0.0, 0.0), 0.0), ((5.0, 0.0), 4.0), ((75.0, 0.0), 65.0)]])
    track, _ = read_walk(path)
    assert track.jumps_m.tolist() == pytest.approx([0, 0, 0, 0, 0, 70], rel=1e-3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<gpx", "not GPX that can be read"),
        ('<gpx version="1.1" creator="x"><wpt lat="1" lon="2"/></gpx>', "holds no track"),
        (
            '<gpx version="1.1" creator="x"><trk><trkseg><trkpt lat="nan" lon="2"/></trkseg></trk>'
            "</gpx>",
            "a point is no latitude and longitude",
        ),
    ],
)
def test_gpx_that_is_no_walk_is_one_message(tmp_path: Path, content: str, message: str) -> None:
    (path := tmp_path / "walk.gpx").write_text(content)
    with pytest.raises(UserError, match=message) as error:
        read_walk(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(("laps", "begin"), [(1, 0), (2, 0), (3, 0), (1, 180), (2, 180)])
def test_a_real_phones_loop_has_its_corners_where_a_person_sees_them(laps: int, begin: int) -> None:
    with real("gps/phone-walk.nmea").open("rb") as lines:
        fixes = [fix for fix in read_fixes(lines, Receiver()) if fix.quality]
    frame = LocalFrame(fixes[0].lat_deg, fixes[0].lon_deg)
    loop = fixes[1095:1620]
    walked = [*(loop[begin:] + loop[:begin]) * laps, loop[begin]]
    track = track_of(replace(fix, stamp=float(second)) for second, fix in enumerate(walked))
    assert track is not None
    found = survey_track(track)
    assert len(found.loops.laps) == laps
    corners = np.array([frame.to_local(*corner) for corner in found.boundary("").crop])
    for seen in ((-856, 487), (-991, 359), (-850, 234)):
        assert np.hypot(*(corners - seen).T).min() < 6
    assert found.polygon.area == pytest.approx(43_400, rel=0.02)
