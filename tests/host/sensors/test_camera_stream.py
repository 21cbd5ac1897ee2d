"""Facts about the camera: the multipart parser, the HTTP sources, loss and return."""

from __future__ import annotations

import http.server
import itertools
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.sensors.camera_stream import (
    ASKED_S,
    MAX_JPEG_BYTES,
    MultipartJpeg,
    Picture,
    _from_http,
    _from_multipart,
    camera_feed,
    without_password,
)
from host.sensors.jpeg import JpegDecoder
from host.sensors.newest import MOST_WORDS, Feed, SourceLostError

LIMIT_S = 10.0


def jpeg(level: int) -> bytes:
    done, data = cv2.imencode(".jpg", np.full((48, 64, 3), level, np.uint8))
    assert done
    return data.tobytes()


PICTURES = [jpeg(level) for level in (10, 120, 240)]


def with_length(picture: bytes) -> bytes:
    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
    return head.encode() + picture + b"\r\n"


def without_length(picture: bytes) -> bytes:
    return b"--frame\r\nContent-Type: image/jpeg\r\n\r\n" + picture + b"\r\n"


def lying(picture: bytes, by: int) -> bytes:
    return with_length(picture).replace(
        f"Length: {len(picture)}".encode(), f"Length: {len(picture) + by}".encode()
    )


# ---- the parser ----------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [with_length, without_length])
@given(size=st.integers(1, 900))
def test_pictures_do_not_depend_on_how_the_bytes_are_cut(
    part: Callable[[bytes], bytes], size: int
) -> None:
    stream = b"".join(part(picture) for picture in PICTURES) + b"--frame\r\n"
    parser = MultipartJpeg("frame")
    found = [
        picture
        for start in range(0, len(stream), size)
        for picture in parser.feed(stream[start : start + size])
    ]
    assert found == PICTURES
    assert parser.bad == 0


def test_with_a_length_a_picture_is_given_without_waiting_for_the_next() -> None:
    assert MultipartJpeg("frame").feed(with_length(PICTURES[0])) == [PICTURES[0]]


def thumbnailed(picture: bytes) -> bytes:
    """With another picture in its EXIF segment."""
    inside = b"Exif\0\0" + PICTURES[2]
    return picture[:2] + b"\xff\xe1" + (len(inside) + 2).to_bytes(2) + inside + picture[2:]


@pytest.mark.parametrize("padding", [b"", b"\r\n", b"\0\0\r\n"])
def test_without_a_length_a_picture_is_given_without_waiting_for_the_next(padding: bytes) -> None:
    parser = MultipartJpeg("frame")
    whole = thumbnailed(PICTURES[0])
    stream = without_length(whole).removesuffix(b"\r\n") + padding
    inside = stream.index(PICTURES[2]) + len(PICTURES[2])
    assert parser.feed(stream[:inside]) == [], "the thumbnail's end is not the picture's"
    assert parser.feed(stream[inside:]) == [whole]
    assert parser.feed(without_length(PICTURES[1])) == [PICTURES[1]]
    assert parser.bad == 0


@pytest.mark.parametrize("boundary", ["frame", "--frame", '"frame"'])
def test_the_boundary_may_be_written_with_dashes_or_quotes(boundary: str) -> None:
    assert MultipartJpeg(boundary).feed(with_length(PICTURES[0])) == [PICTURES[0]]


@pytest.mark.parametrize("by", [-5, 5])
def test_a_wrong_length_costs_no_later_picture(by: int) -> None:
    parser = MultipartJpeg("frame")
    found = parser.feed(lying(PICTURES[0], by))
    for picture in PICTURES[1:]:
        found += parser.feed(with_length(picture))
    assert found == PICTURES


def test_a_picture_cut_off_by_the_next_is_dropped_and_counted() -> None:
    parser = MultipartJpeg("frame")
    found = parser.feed(without_length(PICTURES[0][:-40]) + with_length(PICTURES[1]))
    assert found == [PICTURES[1]]
    assert parser.bad == 1


@given(st.lists(st.binary(max_size=300)))
def test_after_any_garbage_pictures_are_found_again(chunks: list[bytes]) -> None:
    parser = MultipartJpeg("frame")
    for chunk in chunks:
        parser.feed(chunk)
    found = parser.feed(b"\r\n" + b"".join(with_length(picture) for picture in PICTURES))
    assert found[-2:] == PICTURES[-2:], "a claimed length may swallow one, not more"


def test_a_stream_without_end_does_not_fill_the_memory() -> None:
    parser = MultipartJpeg("frame")
    parser.feed(b"--frame\r\n\r\n")
    for _ in range(MAX_JPEG_BYTES // 2**20 + 2):
        parser.feed(bytes(2**20))
    assert parser.bad == 1
    assert parser.feed(with_length(PICTURES[0])) == [PICTURES[0]]


def test_a_length_of_thousands_of_digits_is_none() -> None:
    part = b"--x\r\nContent-Length: " + b"9" * 5000 + b"\r\n\r\n" + PICTURES[0] + b"\r\n--x\r\n"
    assert MultipartJpeg("x").feed(part) == PICTURES[:1]


def test_a_server_that_talks_without_end_is_quoted_in_short() -> None:
    assert len(str(SourceLostError("word " * 10_000))) <= MOST_WORDS


def test_a_broken_jpeg_has_no_pixels() -> None:
    assert Picture(0.0, b"\xff\xd8 nothing \xff\xd9").frame(JpegDecoder()).bgr.size == 0
    frame = Picture(3.0, PICTURES[1]).frame(JpegDecoder())
    assert frame.stamp == 3.0
    assert frame.bgr.shape == (48, 64, 3)
    assert abs(int(frame.bgr.mean()) - 120) <= 2


class Burst:
    """An HTTP response that gives everything at once, and then closes."""

    def __init__(self, data: bytes) -> None:
        self._data = [data, b""]

    def read1(self, _count: int) -> bytes:
        return self._data.pop(0)


def test_of_pictures_that_come_at_once_only_the_newest_is_given() -> None:
    burst: Any = Burst(b"".join(with_length(picture) for picture in PICTURES))
    feed: Feed[Picture] = Feed("camera", lambda _: iter(()), lambda: 4.0, print)
    given = _from_multipart(burst, MultipartJpeg("frame"), feed)
    assert next(given) == Picture(4.0, PICTURES[-1])
    with pytest.raises(SourceLostError, match="closed the stream"):
        next(given)


def test_a_stream_that_flows_and_holds_no_picture_is_lost() -> None:
    """Another boundary than the header's, pictures that are no JPEG, an app that says it waits."""
    clock = itertools.count()
    feed: Feed[Picture] = Feed("camera", lambda _: iter(()), lambda: next(clock), print)
    parts = iter([b"--other\r\n\r\nwait\r\n"] * 10 + [b""])
    waiting: Any = SimpleNamespace(read1=lambda _count: next(parts))
    with pytest.raises(SourceLostError, match="no whole JPEG for 3 s"):
        next(_from_multipart(waiting, MultipartJpeg("frame"), feed))


# ---- the sources ---------------------------------------------------------------------------------


class Phone(http.server.ThreadingHTTPServer):
    """/video streams PICTURES once and closes, /shot.jpg gives one, /broken.jpg as well and closes
    a connection that it promised to keep, /page is no picture, /locked wants a password, /moved is
    elsewhere, /busy serves somebody else, /silent never sends."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.hold = threading.Event()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Handler(http.server.BaseHTTPRequestHandler):
    server: Phone

    def log_message(self, format: str, *args: object) -> None:
        del format, args

    def do_GET(self) -> None:
        if self.path == "/locked" and self.headers["Authorization"] != "Basic dTpwQDpz":
            self.send_error(401)
            return
        if self.path in ("/moved", "/busy"):
            self.send_response(302 if self.path == "/moved" else 503)
            self.send_header("Content-Length", "0")
            if self.path == "/moved":
                self.send_header("Location", "/video?480p")
            self.end_headers()
            return
        if self.path == "/broken.jpg":
            self.protocol_version = "HTTP/1.1"
        kind = {
            "/broken.jpg": "image/jpeg",
            "/video": "multipart/x-mixed-replace; boundary=frame",
            "/silent": "multipart/x-mixed-replace; boundary=frame",
            "/shot.jpg": "image/jpeg",
            "/locked": "image/jpeg",
            "/page": "text/html",
        }.get(self.path)
        if kind is None:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", kind)
        if self.path == "/broken.jpg":
            self.send_header("Content-Length", str(len(PICTURES[0])))
        self.end_headers()
        self.close_connection = True
        if self.path == "/video":
            for picture in PICTURES:
                self.wfile.write(with_length(picture))
        elif self.path == "/silent":
            self.wfile.flush()
            self.server.hold.wait(LIMIT_S)
        else:
            self.wfile.write(PICTURES[0])


@contextmanager
def phone() -> Iterator[Phone]:
    server = Phone()
    try:
        yield server
    finally:
        server.hold.set()
        server.shutdown()
        server.server_close()


@contextmanager
def running(url: str) -> Iterator[tuple[Feed[Picture], list[str]]]:
    reports: list[str] = []
    feed = camera_feed(url, time.monotonic, reports.append)
    feed.silence_s = 0.5
    feed.start()
    try:
        yield feed, reports
    finally:
        feed.close()


def until(condition: Callable[[], bool]) -> bool:
    """Polls with a deadline: for what changes in another thread without telling."""
    deadline = time.monotonic() + LIMIT_S
    gate = threading.Event()
    while time.monotonic() < deadline:
        if condition():
            return True
        gate.wait(0.005)
    return False


@pytest.mark.parametrize("path", ["/video", "/shot.jpg"])
def test_pictures_come_over_http(path: str) -> None:
    with phone() as server, running(server.url + path) as (feed, _):
        assert feed.wait(LIMIT_S)
        picture = feed.take()
        assert picture is not None
        assert picture.jpeg in PICTURES
        assert picture.frame(JpegDecoder()).bgr.size


def test_a_closed_stream_is_reported_connected_again_and_said_to_be_back() -> None:
    with phone() as server, running(server.url + "/video") as (feed, reports):
        assert until(lambda: "camera is back" in reports)
        assert reports[0] == "camera lost: the server closed the stream"
        assert feed.count >= 2


def test_a_phone_that_is_switched_off_is_reported() -> None:
    with phone() as server:
        url = server.url + "/video"
    with running(url) as (feed, reports):
        assert until(lambda: bool(reports))
        assert "Connection refused" in reports[0]
        assert feed.problem is not None
        assert not feed.wait(0.0)


@pytest.mark.parametrize(
    ("path", "problem"),
    [
        ("/page", "sends text/html, not pictures; is the path right"),
        ("/nothing", "answers 404"),
        ("/locked", "answers 401"),
        ("/locked", "http://NAME:PASSWORD@HOST"),
        ("/moved", "answers 302 Found: give the address /video?480p"),
        ("/busy", "answers 503 Service Unavailable: close whatever else"),
        ("/silent", "silent for"),
    ],
)
def test_what_the_server_does_wrong_is_said(path: str, problem: str) -> None:
    with phone() as server, running(server.url + path) as (_, reports):
        assert until(lambda: any(problem in report for report in reports))


def test_an_app_that_does_not_encrypt_as_it_should_is_said() -> None:
    """A phone's certificate is its own, or it has none."""
    with phone() as server, running(server.url.replace("http:", "https:")) as (_, reports):
        assert until(lambda: any("use the app's http:// address" in each for each in reports))


def test_a_password_in_the_address_is_used() -> None:
    with phone() as server:
        url = server.url.replace("//", "//u:p%40%3As@") + "/locked"
        with running(url) as (feed, _):
            assert feed.wait(LIMIT_S)


def test_single_pictures_are_not_asked_for_faster_than_they_are_looked_at() -> None:
    with phone() as server:
        feed = camera_feed(server.url + "/shot.jpg", lambda: 7.0, print)
        paused: list[float] = []
        feed.pause = paused.append  # type: ignore[method-assign]
        pictures = _from_http(urlsplit(server.url + "/shot.jpg"), feed)
        for _ in range(3):
            next(pictures)
    assert paused == pytest.approx([ASKED_S, ASKED_S])


def test_a_network_stream_that_stalls_is_tried_again_soon() -> None:
    """OpenCV by itself gives up after half a minute."""
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        running(f"rtsp://127.0.0.1:{listener.getsockname()[1]}/video") as (_, reports),
    ):
        assert until(lambda: bool(reports))


def test_a_connection_that_was_to_be_kept_and_is_closed_is_no_loss() -> None:
    with phone() as server, running(server.url + "/broken.jpg") as (feed, reports):
        assert until(lambda: feed.count >= 5)
        assert reports == []


def test_a_lost_camera_is_reported_once_and_not_every_half_second() -> None:
    with running("http://127.0.0.1:1/video") as (feed, reports):
        feed.retry_s = 0.001
        tries = iter(range(50))
        assert until(lambda: next(tries, None) is None)
        assert len(reports) == 1


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "field.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (64, 48))
    for level in (10, 120, 240):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    return path


def test_a_file_plays_once_at_its_own_rate(video: Path) -> None:
    with running(str(video)) as (feed, reports):
        assert until(lambda: feed.stopping)
        assert feed.count == 3
        assert reports == ["camera lost: end of the file"]


def test_a_file_that_is_no_video_is_said(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a video")
    with running(str(path)) as (_, reports):
        assert until(lambda: reports == ["camera lost: cannot be opened as a video"])


@pytest.mark.skipif(sys.platform != "linux", reason="other systems name cameras otherwise")
def test_a_camera_that_is_no_device_or_forbidden_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for number in ("987", "9" * 30):
        with pytest.raises(UserError, match=f"camera {number}: there is no /dev/video{number}; ca"):
            camera_feed(number, time.monotonic, print)
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(UserError, match="no permission to open the camera /dev/null: `sudo"):
        camera_feed("/dev/null", time.monotonic, print)


@pytest.mark.parametrize("url", ["http://", "http://host:x/", "ftp://host/video", "no-such.mp4"])
def test_a_camera_that_cannot_be_is_refused_in_one_message(url: str) -> None:
    with pytest.raises(UserError, match="camera"):
        camera_feed(url, time.monotonic, print)


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("http://me:secret@phone:8080/video?x=1", "http://phone:8080/video?x=1"),
        ("http://phone:8080/video", "http://phone:8080/video"),
        ("/dev/video0", "/dev/video0"),
    ],
)
def test_no_message_shows_the_camera_s_password(url: str, shown: str) -> None:
    assert without_password(url) == shown
