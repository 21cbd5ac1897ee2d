"""Facts about the eyes that need no pictures."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from hil.bench.eyes import PerfectEye
from hil.bench.harvest import Harvest, harvest
from hil.bench.lockstep import Bench
from hil.bench.model_eyes import LIBRARY, Library, ModelEyes, library, read_as
from hil.firmware import targets
from hil.scenario.scenario import Scenario, load
from host.core.errors import UserError
from host.runs.record import read
from host.sensors.jpeg import NOTHING
from host.vision.view import CropView, Detector

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


def scenario(**changes: Any) -> Scenario:
    values: dict[str, Any] = {
        "eyes": "model",
        "field": {"size_m": (12.0, 6.0), "neighbour_depth_m": 3.0, "edge_wobble_m": 0.0},
        "limits": {"time_s": 25.0},
    }
    return Scenario.model_validate(values | changes)


class Standing:
    """A bench whose machine is put where a test wants it."""

    def __init__(self, chosen: Scenario) -> None:
        self.bench = Bench(chosen)
        self.eyes = ModelEyes(self.bench)
        self.detector: Detector = self.eyes.detector()

    def answers(self, count: int) -> list[CropView]:
        return [self.detector.see(self.eyes.develop(self.eyes.shutter())[1]) for _ in range(count)]


def test_the_same_seed_gives_the_same_record_byte_for_byte(tmp_path: Path) -> None:
    def digest(name: str, **changes: Any) -> str:
        path = tmp_path / name
        run = Harvest(scenario(**changes), path)
        run.run()
        run.close()
        return hashlib.sha256(path.read_bytes()).hexdigest()

    assert digest("one.mcap") == digest("two.mcap") != digest("other.mcap", seed=2)


@pytest.mark.parametrize("camera", ["low", "mast"])
def test_a_side_is_cut_and_nothing_else(camera: str) -> None:
    run = Harvest(scenario(camera=camera, belief="exact", limits={"time_s": 60.0}))
    run.run(enough=lambda: run.pilot.turns == 1)
    run.close()
    summary = run.truth.summary()
    planned = run.bench.scenario.vehicle.pass_m / 12.0
    assert run.bench.field.coverage() > 0.9 * planned
    assert summary["neighbour_cut_m2"] == 0
    assert float(summary["lateral_rms_m"] or 0.0) < 0.12


def test_answers_lie_about_the_truth_as_the_detectors_did() -> None:
    """Before the crop, the machine standing; the truth is the same in every picture."""
    standing = Standing(scenario(start={"before_m": 0.4}))
    views = standing.answers(200)
    sure = [view.edge_offset_m for view in views if view.confidence >= 0.5]
    assert len(sure) > 20
    assert abs(float(np.median(sure))) < 0.15
    assert len({round(offset, 4) for offset in sure}) > 1
    ahead = [view.crop_ahead_m for view in views if view.ahead_confidence >= 0.5]
    assert float(np.median(ahead)) == pytest.approx(
        PerfectEye(standing.bench).sight().read_ahead_m, abs=0.25
    )


def taught(standing: Standing, **columns: np.ndarray[Any, np.dtype[Any]]) -> Standing:
    """By a library that says so."""
    known = library()
    standing.eyes = ModelEyes(standing.bench, Library(known.columns | columns, known.about))
    standing.detector = standing.eyes.detector()
    return standing


def test_stems_right_before_a_lens_below_the_tops_are_known_four_times_in_five() -> None:
    def hidden(camera: str, lens_x_m: float) -> float:
        at = scenario(camera=camera, belief="exact", lens={"x_m": lens_x_m})
        answers = Standing(at).answers(400)
        assert all(view.confidence == 0.0 for view in answers if view.hidden)
        return float(np.mean([view.hidden for view in answers]))

    assert hidden("low", 2.5) == pytest.approx(0.8, abs=0.06), "in the crop"
    assert hidden("low", 0.1) == 0.0, "before it"
    assert hidden("mast", 2.5) == 0.0, "above it"


def test_an_answer_to_stems_before_the_lens_is_none_to_anything_else() -> None:
    """Of a library that knows one situation alone, in which they stood there at every other
    picture."""
    known = library()
    every_other = np.arange(known.size) % 2 == 0
    sure = np.where(every_other, 0.0, 0.9).astype(np.float32)
    standing = taught(Standing(scenario()), hidden=every_other, confidence=sure)
    shown = [view for view in standing.answers(60) if math.isfinite(view.edge_offset_m)]
    assert len(shown) > 5
    assert {round(view.confidence, 3) for view in shown} <= {0.9, 0.45}


def test_how_far_crop_is_by_its_height_errs_as_the_detectors_did() -> None:
    by_height = library().columns["read_ahead_m"] + np.float32(0.3)
    standing = taught(Standing(scenario(start={"before_m": 1.2})), ahead_by_height_m=by_height)
    true_m = PerfectEye(standing.bench).sight().read_ahead_m
    for view in standing.answers(50):
        assert view.ahead_by_height_m == pytest.approx(true_m + 0.3, abs=1e-5)
    nowhere = np.full(library().size, np.nan, np.float32)
    view = taught(Standing(scenario()), ahead_by_height_m=nowhere).answers(1)[0]
    assert math.isnan(view.ahead_by_height_m)


class Beside:
    """A machine left_m left of its lane: with crop 0.3 m left of its way, or at -2.0 with none. And
    a library that says of it what a test wants."""

    def __init__(
        self, camera: str, left_m: float = -0.7, **columns: float | np.ndarray[Any, np.dtype[Any]]
    ) -> None:
        start = {"lateral_error_m": left_m}
        self._standing = Standing(scenario(camera=camera, belief="exact", start=start))
        bench, known = self._standing.bench, library()
        put = {
            name: np.broadcast_to(value, known.size).astype(np.float32)
            for name, value in columns.items()
        }
        self._standing.eyes = ModelEyes(bench, Library(known.columns | put, known.about))
        self._standing.detector = self._standing.eyes.detector()
        inset_m = bench.scenario.vehicle.inset_m
        self._expected_m = PerfectEye(bench).sight().beside_m + inset_m

    def said(self) -> list[float]:
        """Its place, m."""
        return [view.edge_beside_m for view in self._standing.answers(50)]

    def errors(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Of its place, m."""
        answers = self._standing.answers(2000)
        return np.array([view.edge_beside_m - self._expected_m for view in answers])


@pytest.mark.parametrize(("camera", "off_m"), [("low", 0.09), ("mast", 0.04)])
def test_crop_beside_the_way_is_seen_as_far_off_as_a_rule_says_where_no_drive_met_it(
    camera: str, off_m: float
) -> None:
    beside = Beside(camera, read_beside_m=math.nan, edge_beside_m=math.nan)
    assert float(np.std(beside.errors())) == pytest.approx(off_m, rel=0.25)


@pytest.mark.parametrize("off_m", [0.0, 0.17])
def test_crop_beside_the_way_is_seen_as_far_off_as_the_detector_saw_it(off_m: float) -> None:
    """Each drive of the library has a blade of its own width."""
    insets_m = np.array([d["blade_width_m"] / 2 - d["overlap_m"] for d in library().drives])
    said_m = 0.5 + insets_m[library().drive] + off_m
    beside = Beside("low", read_beside_m=0.5, edge_beside_m=said_m)
    assert beside.errors() == pytest.approx(off_m, abs=0.02)


def test_crop_beside_the_way_that_the_detector_did_not_see_is_not_seen() -> None:
    beside = Beside("low", read_beside_m=0.5, edge_beside_m=math.nan)
    assert np.isnan(beside.errors()).all()


@pytest.mark.parametrize(("was_m", "said_m"), [(math.nan, 0.7), (0.5, math.nan)])
def test_what_is_said_beside_the_way_where_nothing_stands_was_said_where_nothing_stood(
    was_m: float, said_m: float
) -> None:
    beside = Beside(
        "mast", -2.0, read_beside_m=was_m, edge_beside_m=0.7
    )  # a low lens stands in the crop
    assert beside.said() == pytest.approx([said_m] * 50, nan_ok=True)


def test_that_crop_may_lie_is_said_as_the_detector_said_it() -> None:
    standing = Standing(scenario(start={"before_m": 0.4}))
    known = library()
    lies = {"lies_confidence": np.full(known.size, 0.8, np.float32)}
    eyes = ModelEyes(standing.bench, Library(known.columns | lies, known.about))
    view = eyes.detector().see(eyes.develop(eyes.shutter())[1])
    assert view.lies_confidence == pytest.approx(0.8)


def test_of_crop_that_lies_the_detectors_answers_to_crop_that_lies_are_given() -> None:
    """By a library in which nothing was seen ahead wherever crop lay, in every other picture."""

    def clear(lodged: float) -> float:
        field = {"size_m": (12.0, 6.0), "lodged": lodged, "edge_wobble_m": 0.0}
        standing, count = Standing(scenario(field=field, start={"before_m": 0.4})), library().size
        lay = np.arange(count) // 30 % 2 == 0
        said = np.where(lay, math.inf, library().columns["crop_ahead_m"])
        taught(standing, lying=lay.astype(np.float32), crop_ahead_m=said.astype(np.float32))
        return float(np.mean([view.crop_ahead_m == math.inf for view in standing.answers(200)]))

    assert clear(0.0) < 0.1
    assert clear(0.999) == 1.0


def test_a_new_detector_gives_the_same_answers() -> None:
    standing = Standing(scenario())
    first = standing.answers(20)
    standing.detector = standing.eyes.detector()
    again = standing.answers(20)
    assert [view.confidence for view in first] == [view.confidence for view in again]


def test_a_repeated_and_a_broken_picture_are_told_apart() -> None:
    standing = Standing(scenario())
    _, picture = standing.eyes.develop(standing.eyes.shutter())
    assert standing.detector.see(picture).usable
    repeated = standing.detector.see(picture)
    assert not repeated.usable and "repeats" in repeated.reason
    broken = standing.detector.see(NOTHING)
    assert not broken.usable and "broken" in broken.reason


@pytest.mark.parametrize(
    ("seen_m", "was_m", "here_m", "read_m"),
    [
        (1.1, 1.0, 0.5, 0.6),
        (0.95, 1.0, 1.2, 1.15),
        (0.9, 2.4, 1.2, 0.9),
        (0.9, 2.4, 0.6, 0.6),
        (0.0, 1.0, 0.5, 0.0),
        (2.0, 1.5, math.inf, 2.0),
    ],
)
def test_what_is_read_too_near_comes_no_nearer_with_the_crop(
    seen_m: float, was_m: float, here_m: float, read_m: float
) -> None:
    assert read_as(seen_m, was_m, here_m) == pytest.approx(read_m)


def test_what_the_library_does_not_know_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="use --eyes picture"):
        ModelEyes(Bench(scenario(mode="paper")))
    with pytest.raises(UserError, match="eyes fit"):
        library(Path("/nowhere/errors.parquet"))
    old = pq.read_table(LIBRARY)
    pq.write_table(old.drop_columns(["lying"]), tmp_path / "old.parquet")
    with pytest.raises(UserError, match=r"old\.parquet.*lying.*eyes fit"):
        library(tmp_path / "old.parquet")


def test_the_library_says_what_it_was_fitted_to() -> None:
    about = library().about
    assert about["mode"] == "robust" and about["date"]
    assert {drive["mount"] for drive in about["drives"]} == {"low", "mast"}
    for name, figures in about["figures"].items():
        assert figures["pictures"] > 0, name
        assert math.isfinite(figures["offset_sd_m"]), name


def test_eyes_that_take_no_pictures_leave_none_in_film_and_record(tmp_path: Path) -> None:
    chosen = scenario(limits={"time_s": 2.0}, record={"film": True, "pictures_every": 1})
    harvest(chosen, tmp_path)
    assert not (tmp_path / "camera.mp4").exists()
    topics = {topic for topic, _, _ in read(tmp_path / "record.mcap")}
    assert "/view" in topics
    assert "/camera" not in topics


def test_a_post_that_nobody_surveyed_is_driven_over_and_counted() -> None:
    """The machine sees neither posts nor people: the bench says so, whoever looks away."""
    run = Harvest(load("post", {"eyes": "model", "limits": {"time_s": 25.0}}))
    assert not run.bench.scenario.told.keep_outs
    run.run()
    run.close()
    assert float(run.truth.summary()["keep_out_m"] or 0.0) > 0.1
