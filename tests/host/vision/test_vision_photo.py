"""Photographs: the dividing line, the curve, bad pictures, scores."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from host.vision.mounted.paper import Chain, PaperParams
from host.vision.photo import benchmark, calibration, confidence
from host.vision.photo.detector import photo_detector, searched
from host.vision.photo.disturb import (
    DISTURBANCES,
    FORMATS,
    disturbed,
    formatted,
    reframed,
    side_of,
)
from host.vision.photo.fisher import ALIKE, FLATTER, RIDGE, STRANGE, WIDER, Kinds, Reach, learn
from host.vision.photo.score import heading_error_deg, labelled_set, lateral_error, miou
from host.vision.photo.split import SIDES, Side, best_line, whiten
from host.vision.view import CropView
from tests.helpers.real_data import real
from tests.helpers.scenery import halves

Bgr = NDArray[np.uint8]


@settings(deadline=None, max_examples=25)
@given(st.sampled_from(SIDES), st.floats(-35, 35), st.floats(-50, 50))
def test_the_edge_between_two_kinds_is_found_on_every_side(
    side: Side, lean: float, shift: float
) -> None:
    bgr, line = halves(side, lean, shift)
    view = photo_detector("robust", side).see(bgr)
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
    assert view.standing is not None
    assert miou(line.signed(u, v) > 0, view.standing) > 0.93
    assert view.confidence >= 0.5


def test_a_strip_beside_the_crop_is_not_crop() -> None:
    """A cut face in shade: the best division into two lies at its far side."""
    bgr, line = halves("left")
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
    strip = (line.signed(u, v) <= 0) & (line.signed(u, v) > -24)
    shaded = bgr.copy()
    shaded[strip] = (0.35 * shaded[strip]).astype(np.uint8)
    view = photo_detector("robust", "left").see(shaded)
    assert view.standing is not None
    assert view.standing[strip].mean() < 0.25


@pytest.mark.parametrize(("side", "shaded"), [("left", (0.65, 1.0)), ("right", (0.0, 0.25))])
def test_a_shadow_beside_the_crop_has_no_edge(side: Side, shaded: tuple[float, float]) -> None:
    """Colour and texture change at its border as much as at the crop's."""
    bgr, line = halves(side)
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
    inside = (u >= shaded[0] * 400) & (u < shaded[1] * 400)
    shadow = bgr.copy()
    shadow[inside] = (0.7 * shadow[inside]).astype(np.uint8)
    view = photo_detector("robust", side).see(shadow)
    assert view.standing is not None
    assert miou(line.signed(u, v) > 0, view.standing) > 0.95


def test_what_the_line_is_searched_in_is_two_whitened_sets() -> None:
    rng = np.random.default_rng(0)
    features = rng.uniform(100, 160, (40, 50, 10)).astype(np.float32)
    found = searched(features).reshape(-1, 18)
    for kind in (found[:, :9], found[:, 9:]):
        assert np.abs(np.cov(kind.T) - np.eye(9)).max() < 1e-2


def test_a_line_explains_the_mean_over_its_sets() -> None:
    bgr, _ = halves("left")
    features = whiten(np.asarray(bgr[::4, ::4], np.float32))
    once = best_line(features, "left")
    twice = best_line(np.concatenate([features, features], -1), "left", sets=2)
    assert twice.explained == pytest.approx(once.explained, rel=1e-4)
    assert 0.0 < twice.explained <= 1.0


def _two_kinds() -> tuple[NDArray[np.float32], Kinds]:
    """Crop about (0, 0) right of the edge, cut about (4, 0) left of it."""
    rng = np.random.default_rng(1)
    features = rng.normal(size=(60, 40, 2)).astype(np.float32)
    features[:, :20, 0] += 4.0
    distances = np.broadcast_to(np.arange(-19.5, 20.0, dtype=np.float32), (60, 40))
    kinds = learn(features, distances, Reach(crop=15.0, cut=15.0, dead=1.0))
    assert kinds is not None
    return features, kinds


def test_what_is_like_neither_kind_is_not_crop() -> None:
    """Fisher's discriminant cannot say so: it looks along one direction only."""
    _, kinds = _two_kinds()
    strange = np.array([[[0.0, 9.0], [0.0, -9.0], [-9.0, 0.0]]], np.float32)
    assert (kinds.odds(strange) < -1.0).all()
    assert kinds.discriminant().value(strange)[0, 2] > 1.0


def test_odds_are_those_of_normal_kinds_with_a_share_of_strangers() -> None:
    features, kinds = _two_kinds()
    within = kinds.covariances.mean(0)
    ridge = RIDGE * np.diag(np.diag(within))
    crop, cut = ((1 - ALIKE) * c + ALIKE * within + ridge for c in kinds.covariances)

    def density(mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(multivariate_normal(mean, covariance).pdf(features))

    strangers = density(kinds.means[0], WIDER * crop)
    other = (1 - STRANGE) * density(kinds.means[1], cut) + STRANGE * strangers
    expected = FLATTER * np.log(density(kinds.means[0], crop) / other)
    assert np.abs(kinds.odds(features) - expected).max() < 1e-3


def test_too_few_cells_teach_nothing() -> None:
    features, distances = np.zeros((2, 4, 3), np.float32), np.ones((2, 4), np.float32)
    assert learn(features, distances, Reach(5.0, 5.0, 0.5)) is None


def test_whitened_features_are_uncorrelated_with_unit_variance() -> None:
    rng = np.random.default_rng(0)
    mixed = rng.normal(size=(40, 50, 4)) @ rng.normal(size=(4, 4)) * [1, 10, 100, 0.1]
    flat = whiten(mixed.astype(np.float32)).reshape(-1, 4)
    covariance = np.cov(flat.T)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 1e-3
    assert np.diag(covariance).max() == pytest.approx(1, abs=1e-3)


def test_a_line_without_a_contrast_explains_nothing() -> None:
    noise = np.random.default_rng(0).normal(size=(48, 64, 3)).astype(np.float32)
    assert best_line(whiten(noise), "left").explained < 0.1


def bad_pictures() -> dict[str, Bgr]:
    rng = np.random.default_rng(0)
    wheat, _ = halves("left")
    street = np.full((480, 640, 3), 96, np.uint8)
    street[:200] = (230, 190, 150)
    cv2.line(street, (320, 200), (100, 480), (255, 255, 255), 8)
    maize = np.array([40, 110, 60]) + rng.normal(0, 25, (480, 640, 3))
    maize[:, 320:] = np.array([45, 90, 50]) + rng.normal(0, 10, (480, 320, 3))
    return {
        "black": np.zeros((480, 640, 3), np.uint8),
        "white": np.full((480, 640, 3), 255, np.uint8),
        "noise": rng.integers(0, 255, (480, 640, 3)).astype(np.uint8),
        "street": np.clip(street + rng.normal(0, 8, street.shape), 0, 255).astype(np.uint8),
        "maize": np.clip(maize, 0, 255).astype(np.uint8),
        "grey": np.repeat(cv2.cvtColor(wheat, cv2.COLOR_BGR2GRAY)[..., None], 3, 2).astype(
            np.uint8
        ),
        "covered lens": np.asarray(cv2.GaussianBlur(wheat, (0, 0), 40), np.uint8),
        "no edge": np.ascontiguousarray(wheat[:, :150]),
        "tiny": np.ascontiguousarray(wheat[:20, :20]),
        "huge": np.tile(wheat[:, :150], (8, 20, 1)),
    }


@pytest.mark.parametrize("mode", ["robust", "paper"])
@pytest.mark.parametrize("name", bad_pictures())
def test_a_bad_picture_gives_no_confident_edge(name: str, mode: str) -> None:
    view = photo_detector(mode, "left").see(bad_pictures()[name])
    assert view.confidence < 0.5
    assert view.reason


# ---- the paper's colour stages -------------------------------------------------------------------


def coloured(hue_deg: float, saturation: float, value: float) -> Bgr:
    hsv = np.array([[[hue_deg * 256 / 360, saturation * 255, value * 255]]]).astype(np.uint8)
    return np.repeat(
        np.repeat(np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR_FULL), np.uint8), 32, 0), 32, 1
    )


@pytest.mark.parametrize(
    ("hue", "kind"),
    [(45.0, "ripe"), (62.0, "unripe"), (110.0, "neither"), (210.0, "neither"), (5.0, "neither")],
)
def test_ripe_crop_is_kept_unripe_marked_and_weeds_left_out(
    hue: float, kind: Literal["ripe", "unripe", "neither"]
) -> None:
    stages = Chain(PaperParams(), (32, 32)).run(coloured(hue, 0.6, 0.7))
    assert bool(stages.ripe.all()) == (kind == "ripe")
    assert bool(stages.unripe.all()) == (kind == "unripe")
    assert bool(stages.sy.any()) == (kind != "neither")


def test_the_tilted_plane_leaves_out_what_is_pale_and_bright() -> None:
    chain = Chain(PaperParams(), (32, 32))
    assert chain.run(coloured(45, 0.5, 0.8)).sy.any()
    assert not chain.run(coloured(45, 0.08, 0.95)).sy.any()


@given(st.floats(0, 100), st.floats(110, 250))
def test_the_wedge_is_stretched_over_the_full_circle(phi1: float, phi2: float) -> None:
    table = PaperParams(phi1_deg=phi1, phi2_deg=phi2).hue_table()
    inside = table[table > 0]
    step = 254 * 360 / 256 / (phi2 - phi1)
    assert inside.min() <= 1 + step
    assert inside.max() >= 254 - step
    assert (np.diff(inside.astype(int)) > 0).all()


# ---- scores --------------------------------------------------------------------------------------


def test_scores_of_a_shifted_edge() -> None:
    true, found = np.zeros((100, 200), bool), np.zeros((100, 200), bool)
    true[:, :100], found[:, :110] = True, True
    assert lateral_error(true, found) == pytest.approx(0.05)
    assert miou(true, found) == pytest.approx(0.5 * (100 / 110 + 90 / 100))
    assert heading_error_deg(true, found, "left") == pytest.approx(0, abs=1e-3)
    assert miou(true, true) == 1


def test_rows_with_two_edges_do_not_count_laterally() -> None:
    true, found = np.zeros((100, 200), bool), np.zeros((100, 200), bool)
    true[:50, 50:100] = True
    true[50:, :100] = True
    found[:, :100] = True
    assert lateral_error(true, found) == 0


# ---- confidence ----------------------------------------------------------------------------------


def doubts(**changed: float) -> NDArray[np.float64]:
    """Quantities as of an edge that nothing speaks against, but for those named."""
    good = dict.fromkeys(
        ("colour", "texture", "both", "brightness", "unlit", "strayed", "passes"), 0.05
    )
    good |= {"explained": 0.85, "apart": 1.4, "strip": 0.0, "uneven": 0.0}
    return np.array([(good | changed)[name] for name in confidence.REASONS])


def test_nothing_against_an_edge_makes_it_sure() -> None:
    assert confidence.weights().judged(doubts())[0] > 0.6


@pytest.mark.parametrize(
    ("name", "value"),
    [("unlit", 0.6), ("strayed", 0.6), ("passes", 0.4), ("apart", -1.5)],
)
def test_what_speaks_against_an_edge_is_named(name: str, value: float) -> None:
    sure, reason = confidence.weights().judged(doubts(**{name: value}))
    assert sure < 0.5
    assert reason == confidence.REASONS[name]


def _edges(seed: int, scenes: int = 12, pictures: int = 60) -> calibration.Samples:
    """Edges that are right the less, the farther colour strays; the rest tells nothing."""
    rng = np.random.default_rng(seed)
    quantities = rng.normal(size=(scenes * pictures, len(confidence.REASONS)))
    right = rng.random(len(quantities)) < 1 / (1 + np.exp(2 * quantities[:, 0]))
    return calibration.Samples(
        quantities,
        np.where(right, 0.0, 0.2),
        np.repeat([str(s) for s in range(scenes)], pictures),
        np.ones(len(quantities), np.bool_),
    )


def test_confidence_is_the_share_of_right_edges_on_scenes_held_out() -> None:
    samples = _edges(0)
    sure = calibration.held_out(samples)
    right = samples.wrong <= confidence.TOLERANCE
    for low in (0.0, 0.25, 0.5, 0.75):
        inside = (sure >= low) & (sure < low + 0.25)
        assert abs(sure[inside].mean() - right[inside].mean()) < 0.08


def test_weights_are_read_as_they_were_written(tmp_path: Path) -> None:
    samples = _edges(1)
    learnt = calibration.fit(samples, np.ones(len(samples.wrong), np.bool_))
    calibration.write(tmp_path / "w.json", learnt, "test")
    for q in samples.quantities[:20]:
        read, reason = confidence.weights(tmp_path / "w.json").judged(q)
        assert (read, reason) == (pytest.approx(learnt.judged(q)[0], abs=1e-4), reason)


def test_two_borders_that_divide_alike_are_doubted_more_than_one() -> None:
    """A second kind of ground in the cut half: which border is the crop's?"""
    bgr, _ = halves("left")
    other, _ = halves("right")
    two = bgr.copy()
    two[:, 300:] = (0.35 * bgr[:, 300:] + 0.65 * other[:, 300:]).astype(np.uint8)
    eye = photo_detector("robust", "left")
    assert eye.see(two).confidence < eye.see(bgr).confidence


# ---- disturbances --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DISTURBANCES)
def test_no_disturbance_makes_a_wrong_edge_sure(name: str) -> None:
    for number in range(4):
        rng = np.random.default_rng(number)
        side = SIDES[number]
        bgr, line = halves(side, 10.0 * number - 15.0)
        u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
        view = photo_detector("robust", side).see(disturbed(bgr, (name,), rng))
        assert view.standing is not None
        assert view.confidence < 0.5 or miou(line.signed(u, v) > 0, view.standing) > 0.85


@pytest.mark.parametrize("name", FORMATS)
def test_an_edge_is_found_in_every_format(name: str) -> None:
    bgr, line = halves("left")
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
    frame = formatted(bgr, np.asarray(line.signed(u, v) > 0), FORMATS[name])
    assert frame is not None
    view = photo_detector("robust", "left").see(frame[0])
    assert view.standing is not None
    assert miou(frame[1], view.standing) > 0.9


def test_a_reframed_picture_keeps_its_label() -> None:
    """Crop and cut of one colour each: what the label says is what the picture shows."""
    _, line = halves("left", 20.0)
    u, v = np.meshgrid(np.arange(400) + 0.5, np.arange(300) + 0.5)
    standing = np.asarray(line.signed(u, v) > 0)
    bgr = np.where(standing[..., None], 200, 50).astype(np.uint8).repeat(3, 2)
    for seed in range(20):
        frame = reframed(bgr, standing, np.random.default_rng(seed))
        if frame is not None:
            assert ((frame[0][..., 0] > 125) == frame[1]).mean() > 0.99
            assert side_of(frame[1]) in SIDES


# ---- the labelled set ----------------------------------------------------------------------------


def test_robust_mode_on_the_labelled_photographs() -> None:
    folder = real("wheat-edge")
    photos = [benchmark.Photo(i, i.picture(), i.standing()) for i in labelled_set(folder)]
    assert len(photos) == 96

    def see(photo: benchmark.Photo) -> CropView:
        return photo_detector("robust", photo.item.side).see(photo.bgr)

    figures = benchmark.summary([benchmark.judge(p, see(p)) for p in photos], 0.0)
    assert figures["lateral_pictures"] == 64
    assert figures["miou_mean"] >= 0.955
    assert figures["lateral_median"] <= 0.011
    assert figures["within_5pct"] >= 0.90
    assert figures["confident_wrong"] <= 0.01
    assert figures["confident"] >= 0.25
