"""Facts about the picture watch: what a camera's faults look like, and what they must not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.sensors.picture_watch import MEMORY, PictureWatch
from tests.helpers.shots import HEIGHT, WIDTH, Picture, scene, shot


def jpeg(picture: Picture) -> bytes:
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()


def watch() -> PictureWatch:
    return PictureWatch(WIDTH, HEIGHT)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 5), st.lists(st.integers(0, 40), min_size=1, max_size=6))
def test_a_live_camera_is_believed_however_it_pans(seed: int, steps: list[int]) -> None:
    made, world, at = watch(), scene(seed), 0
    for k, step in enumerate(steps):
        at += step
        assert made.problem(shot(world, at, k)) == ""


def test_a_machine_at_rest_is_no_frozen_camera() -> None:
    made, world = watch(), scene()
    assert [made.problem(shot(world, 0, k)) for k in range(5)] == [""] * 5


def test_a_frozen_camera_is_noticed_at_its_first_repetition() -> None:
    made, picture = watch(), shot(scene())
    assert made.problem(picture) == ""
    assert "repeats" in made.problem(picture.copy())


def test_a_picture_is_known_again_under_fresh_noise_and_no_other_is() -> None:
    made, world = watch(), scene()
    for k in range(30):
        assert made.problem(shot(world, 8 * k, k)) == "" and made.same_ago == 0
    for k in range(5):
        assert made.problem(shot(world, 8 * 29, 100 + k)) == ""
        assert made.same_ago == k + 1, "the first one that it is the same as"
    assert made.problem(shot(world, 0, 200)) == "" and made.same_ago == 35
    for k in range(MEMORY):
        made.problem(np.zeros((2, 2, 3), np.uint8) if k % 2 else shot(world, 400, 300 + k))
    made.problem(shot(world, 0, 500))
    assert made.same_ago == 0, "so long it remembers none"


def test_a_clock_in_the_corner_does_not_make_a_frozen_picture_live() -> None:
    made, picture = watch(), shot(scene())
    assert made.problem(picture) == ""
    for k in range(3):
        cv2.putText(
            picture, f"12:00:0{k}", (8, 30), cv2.FONT_HERSHEY_SIMPLEX, 1, (255, 255, 255), 2
        )
        assert "repeats" in made.problem(picture)


def test_the_camera_is_believed_again_as_soon_as_it_lives() -> None:
    made, world = watch(), scene()
    made.problem(shot(world))
    made.problem(shot(world))
    assert made.problem(shot(world, 5, 1)) == ""


@pytest.mark.parametrize(
    "spoil",
    [
        np.zeros_like,
        lambda p: cv2.convertScaleAbs(p, alpha=3.0, beta=120.0),
        lambda p: cv2.convertScaleAbs(cv2.blur(p, (151, 151)), alpha=0.25, beta=8.0),
    ],
    ids=["black", "overexposed", "covered"],
)
def test_a_picture_that_shows_nothing_is_not_believed(spoil: object) -> None:
    assert callable(spoil)
    made, world = watch(), scene()
    made.problem(shot(world))
    for k in range(1, 4):
        assert "nothing" in made.problem(shot(spoil(world), 5 * k, k))


def test_what_is_lost_of_a_file_is_seen_in_the_picture() -> None:
    whole = jpeg(shot(scene()))
    data = np.frombuffer(whole[: len(whole) // 2] + b"\xff\xd9", np.uint8)
    half = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert half is not None
    assert "broken" in watch().problem(np.asarray(half, np.uint8))


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_files_with_wrong_bytes_are_hardly_ever_believed(seed: int) -> None:
    """At 1 % of the bytes; a picture that passes shows little wrong."""
    rng = np.random.default_rng(seed)
    made, world, believed = watch(), scene(), 0
    for k in range(10):
        data = np.frombuffer(jpeg(shot(world, 3 * k, k)), np.uint8).copy()
        at = rng.integers(len(data), size=len(data) // 100)
        data[at] = rng.integers(256, size=len(at))
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if decoded is not None:
            believed += made.problem(np.asarray(decoded, np.uint8)) == ""
    assert believed <= 1


def test_a_picture_of_another_size_is_not_shown_to_anybody() -> None:
    assert "size" in watch().problem(np.zeros((8060, WIDTH, 3), np.uint8))


def test_a_washed_out_sky_is_not_a_lost_part() -> None:
    picture = shot(scene())
    picture[: HEIGHT // 2] = 255
    assert watch().problem(picture) == ""


def test_smooth_squares_are_not_a_lost_part() -> None:
    """Crop close before the lens is out of focus; its file's blocks have one colour each."""
    rng = np.random.default_rng(2)
    blocks = rng.integers(60, 200, (HEIGHT // 8, WIDTH // 8, 3), np.uint8)
    squares = np.kron(blocks, np.ones((8, 8, 1), np.uint8))
    assert watch().problem(squares) == ""
