"""Facts about decoding: what is lost of a file is not filled in, and no file does harm."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.sensors.jpeg import JpegDecoder, size_of


def scene() -> NDArray[np.uint8]:
    """Enough detail that every byte of its file matters."""
    grain = np.random.default_rng(1).normal(120.0, 40.0, (120, 160, 3))
    return cv2.GaussianBlur(np.clip(grain, 0, 255).astype(np.uint8), (0, 0), 1.0).astype(np.uint8)


BGR = scene()
JPEG = cv2.imencode(".jpg", BGR)[1].tobytes()


def proved() -> JpegDecoder:
    """A decoder whose camera has sent a clean file."""
    decoder = JpegDecoder()
    assert decoder.decode(JPEG).size
    return decoder


def test_the_pixels_are_those_of_every_other_decoder() -> None:
    expected = cv2.imdecode(np.frombuffer(JPEG, np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(JpegDecoder().decode(JPEG), expected)


def held(orientation: int, order: Literal["little", "big"], *, jfif: bool) -> bytes:
    """JPEG with an EXIF segment that a phone writes."""

    def number(value: int, size: int) -> bytes:
        return value.to_bytes(size, order)

    entries = [(0x0110, 2, 1, 0), (0x0112, 3, 1, orientation), (0x0131, 2, 1, 0)]
    tiff = (b"II" if order == "little" else b"MM") + number(42, 2) + number(8, 4)
    tiff += number(len(entries), 2)
    for tag, kind, count, value in entries:
        tiff += number(tag, 2) + number(kind, 2) + number(count, 4) + number(value, 2) + bytes(2)
    body = b"Exif\0\0" + tiff + bytes(4)
    segment = b"\xff\xe1" + (len(body) + 2).to_bytes(2) + body
    at = 20 if jfif else 2
    assert JPEG[20:22] == b"\xff\xdb", "the JFIF segment ends there"
    return JPEG[:at] + segment + JPEG[20 if jfif else 2 :]


@pytest.mark.parametrize("jfif", [True, False])
@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("orientation", range(10))
def test_a_picture_is_the_way_up_that_every_viewer_shows_it(
    orientation: int, order: Literal["little", "big"], jfif: bool
) -> None:
    data = held(orientation, order, jfif=jfif)
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(JpegDecoder().decode(data), expected)


@given(st.binary(max_size=60), st.booleans())
def test_no_exif_segment_does_harm(data: bytes, whole: bool) -> None:
    body = held(6, "big", jfif=False)[6:40] * whole + data
    segment = b"\xff\xe1" + (len(body) + 8).to_bytes(2) + b"Exif\0\0" + body
    assert JpegDecoder().decode(JPEG[:2] + segment + JPEG[2:]).size == BGR.size


def test_a_file_whose_rest_is_lost_has_no_pixels() -> None:
    half = JPEG[: len(JPEG) // 2] + b"\xff\xd9"
    assert proved().decode(half).size == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_of_files_with_a_hundredth_of_wrong_bytes_one_in_five_passes_at_most(seed: int) -> None:
    rng = np.random.default_rng(seed)
    decoder, passed = proved(), 0
    for _ in range(20):
        data = np.frombuffer(JPEG, np.uint8).copy()
        at = rng.integers(len(data), size=len(data) // 100)
        data[at] = rng.integers(256, size=len(at))
        passed += decoder.decode(data.tobytes()).size > 0
    assert passed <= 4


def test_a_picture_that_takes_longer_than_the_machine_may_wait_has_no_pixels() -> None:
    large = cv2.imencode(".jpg", np.zeros((3000, 4000, 3), np.uint8))[1].tobytes()
    assert size_of(large) == (4000, 3000)
    assert JpegDecoder().decode(large).size == 0
    assert size_of(b"no picture") is None


def test_a_camera_whose_files_are_never_clean_is_lived_with() -> None:
    """Logitech's cameras among others send bytes too many before the end marker."""
    padded = JPEG[:-2] + b"\0\0\0" + JPEG[-2:]
    decoder = JpegDecoder()
    assert decoder.decode(padded).shape == BGR.shape
    assert decoder.decode(padded).shape == BGR.shape
    assert decoder.decode(JPEG).shape == BGR.shape
    assert decoder.decode(padded).size == 0, "it can send clean ones"


@given(st.binary(max_size=200), st.booleans())
def test_no_bytes_do_harm(data: bytes, headed: bool) -> None:
    assert JpegDecoder().decode(JPEG[:300] * headed + data).ndim == 3


def test_a_header_of_terabytes_allocates_nothing() -> None:
    at = JPEG.index(b"\xff\xc0") + 5
    assert JpegDecoder().decode(JPEG[:at] + b"\xff\xff\xff\xff" + JPEG[at + 4 :]).size == 0


def test_a_small_file_of_many_passes_has_no_pixels() -> None:
    """Each takes as long as the whole of an ordinary picture."""
    file = cv2.imencode(".jpg", BGR, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    assert JpegDecoder().decode(file).shape == BGR.shape
    last = file[file.rindex(b"\xff\xda") : -2]
    assert JpegDecoder().decode(file[:-2] + 100 * last + file[-2:]).size == 0
