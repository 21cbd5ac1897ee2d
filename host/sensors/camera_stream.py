"""The camera as a feed of pictures: a phone's MJPEG or single JPEG over HTTP, a file, a device.

The reading thread only cuts the stream into pictures; what is never looked at is never decoded, so
a slow laptop falls behind in rate and not in time.
"""

from __future__ import annotations

import base64
import http.client
import os
import re
import socket
import ssl
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import SplitResult, unquote, urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.messages import Frame
from host.sensors.jpeg import END, JpegDecoder, end_of
from host.sensors.newest import Feed, SourceLostError

MAX_JPEG_BYTES = 16 * 1024 * 1024
"""Of one picture: more is no camera's stream."""
READ_BYTES = 64 * 1024
"""Taken from the network at once: a picture or two."""
ASKED_S = 0.04
"""From one request for a single JPEG to the next, at the least: the pilot looks at 20 a second, and
a picture that comes twice only keeps the network from the next."""
PADDING = b"\r\n\0-"
"""What servers put between a picture and the next boundary."""
MOST_PADDING = 16
"""Bytes of it behind a picture whose end is looked for before the next boundary has come."""
HINTS: dict[int, str] = {
    http.HTTPStatus.UNAUTHORIZED: (
        "give the app's name and password in the address, as http://NAME:PASSWORD@HOST; only basic "
        "authentication is known"
    ),
    http.HTTPStatus.SERVICE_UNAVAILABLE: (
        "close whatever else shows its pictures, many apps serve one at a time"
    ),
}
"""What to do about an answer."""


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture as it came: a JPEG from a phone, pixels from a device. `stamp`: its arrival."""

    stamp: float
    jpeg: bytes | None
    bgr: NDArray[np.uint8] | None = None

    def frame(self, decoder: JpegDecoder) -> Frame:
        """Decoded; without any pixels where the JPEG is spoiled."""
        if self.bgr is not None:
            return Frame(self.stamp, self.bgr)
        return Frame(self.stamp, decoder.decode(self.jpeg or b""))


class MultipartJpeg:
    """Parses multipart/x-mixed-replace (RFC 2046) as cameras and phone apps send it, byte-wise.

    Trusts Content-Length where a part has one and it leads to a JPEG's end, else scans for the
    JPEG's own end or the boundary. Garbage between parts is skipped. No I/O.
    """

    _LENGTH = re.compile(rb"^content-length:\s*(\d{1,12})\s*$", re.IGNORECASE | re.MULTILINE)

    def __init__(self, boundary: str) -> None:
        """`boundary` as in the Content-Type header, with or without the leading dashes (servers
        disagree about whether they belong to it)."""
        self._mark = b"--" + boundary.strip('"').lstrip("-").encode("latin-1")
        self._data = bytearray()
        self.bad = 0
        """Parts dropped: no JPEG inside, or longer than any picture."""

    def feed(self, data: bytes) -> list[bytes]:
        """Returns the JPEGs completed by these bytes, oldest first."""
        self._data += data
        pictures: list[bytes] = []
        while (part := self._part()) is not None:
            if part.startswith(b"\xff\xd8") and part.endswith(b"\xff\xd9"):
                pictures.append(part)
            else:
                self.bad += 1
        if len(self._data) > MAX_JPEG_BYTES:
            self._data.clear()
            self.bad += 1
        return pictures

    def _part(self) -> bytes | None:
        """Takes one whole part's body off the buffer."""
        start = self._data.find(self._mark)
        if start < 0:
            del self._data[: max(0, len(self._data) - len(self._mark))]
            return None
        del self._data[:start]
        header = re.compile(rb"\r?\n\r?\n").search(self._data)
        if header is None:
            return None
        body = header.end()
        length = self._LENGTH.search(bytes(self._data[: header.start()]).replace(b"\r", b""))
        if length is not None and (count := int(length[1])) <= MAX_JPEG_BYTES:
            if len(self._data) < body + count:
                return None
            part = bytes(self._data[body : body + count])
            if part.endswith(END):
                del self._data[: body + count]
                return part
        end = self._data.find(self._mark, body)
        if end < 0:
            # The next boundary may come with the next picture only, a whole period later.
            last = bytes(self._data[-MOST_PADDING:]).rstrip(PADDING)
            whole = end_of(self._data, body) if last.endswith(END) else None
            if whole is None:
                return None
            end = whole
        part = bytes(self._data[body:end]).rstrip(PADDING)
        del self._data[:end]
        return part


def authorization(parts: SplitResult) -> dict[str, str]:
    """HTTP basic authentication from user:password@ in the URL, as phone apps ask for it."""
    if parts.username is None:
        return {}
    pair = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
    return {"Authorization": "Basic " + base64.b64encode(pair.encode()).decode()}


def without_password(url: str) -> str:
    """A camera's address as it may be shown."""
    parts = urlsplit(url)
    return parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl() if parts.netloc else url


def fetch(
    connection: http.client.HTTPConnection, path: str, parts: SplitResult
) -> http.client.HTTPResponse:
    """The answer to GET. Asks once more where the connection had served before: servers close one
    that they had promised to keep, and that is no loss."""
    headers = authorization(parts)
    kept = connection.sock is not None
    try:
        connection.request("GET", path, headers=headers)
        return connection.getresponse()
    except ConnectionError:
        if not kept:
            raise
    except ssl.SSLError as error:
        raise SourceLostError(
            f"no encrypted connection ({error.reason}): use the app's http:// address"
        ) from error
    connection.close()
    connection.request("GET", path, headers=headers)
    return connection.getresponse()


def refusal(response: http.client.HTTPResponse, *, final: bool = False) -> SourceLostError:
    """What a server answers instead of what it was asked for, and what to do about it."""
    said = f"the server answers {response.status} {response.reason}"
    elsewhere = response.headers.get("Location")
    hint = f"give the address {elsewhere}" if elsewhere else HINTS.get(response.status)
    return SourceLostError(f"{said}: {hint}" if hint else said, final=final)


def _from_http(parts: SplitResult, feed: Feed[Picture]) -> Iterator[Picture]:
    """Multipart MJPEG, or one JPEG asked for again and again: the server's content type decides."""
    secure = parts.scheme == "https"
    kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=feed.silence_s)
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    try:
        while not feed.stopping:
            asked = feed.clock()
            response = fetch(connection, path, parts)
            if response.status != http.HTTPStatus.OK:
                raise refusal(response)
            content = response.headers.get_content_type()
            if content == "image/jpeg":
                yield Picture(feed.clock(), response.read(MAX_JPEG_BYTES))
                feed.pause(max(0.0, asked + ASKED_S - feed.clock()))
            elif content.startswith("multipart/"):
                boundary = response.headers.get_param("boundary")
                if not isinstance(boundary, str) or not boundary.strip("-"):
                    raise SourceLostError("the server sends multipart without a boundary")
                yield from _from_multipart(response, MultipartJpeg(boundary), feed)
            else:
                raise SourceLostError(
                    f"the server sends {content}, not pictures; is the path right?"
                )
    except TimeoutError as error:
        raise SourceLostError(f"silent for {feed.silence_s:.0f} s") from error
    except socket.gaierror as error:
        raise SourceLostError(f"no such host: {parts.hostname}") from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise SourceLostError(str(error) or type(error).__name__) from error
    finally:
        connection.close()


def _from_multipart(
    response: http.client.HTTPResponse, parser: MultipartJpeg, feed: Feed[Picture]
) -> Iterator[Picture]:
    heard = feed.clock()
    while not feed.stopping:
        data = response.read1(READ_BYTES)
        if not data:
            raise SourceLostError("the server closed the stream")
        now = feed.clock()
        pictures = parser.feed(data)
        if pictures:
            heard = now
            yield Picture(now, pictures[-1])
        elif now - heard > feed.silence_s:
            raise SourceLostError(
                f"the server sends, but no whole JPEG for {feed.silence_s:.0f} s; is it the app's "
                "MJPEG address, and does the network keep up?"
            )


def _opened(source: str | int, silence_s: float) -> cv2.VideoCapture:
    """A network stream that stalls ends after `silence_s`: FFmpeg would wait for half a minute."""
    if isinstance(source, int) or "://" not in source:
        return cv2.VideoCapture(source)
    patience_ms = round(1000 * silence_s)
    limits = (cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, cv2.CAP_PROP_READ_TIMEOUT_MSEC)
    options = [value for limit in limits for value in (limit, patience_ms)]
    return cv2.VideoCapture(source, cv2.CAP_FFMPEG, options)


def _from_opencv(source: str | int, file: bool, feed: Feed[Picture]) -> Iterator[Picture]:
    """A device or a network stream as fast as it comes; a file at its own rate, once."""
    capture = _opened(source, feed.silence_s)
    try:
        if not capture.isOpened():
            raise SourceLostError("cannot be opened as a video", final=file)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        period = 1 / (capture.get(cv2.CAP_PROP_FPS) or 30.0) if file else 0.0
        due = feed.clock()
        while not feed.stopping:
            there, bgr = capture.read()
            if not there:
                raise SourceLostError("end of the file" if file else "no more pictures", final=file)
            due += period
            feed.pause(max(0.0, due - feed.clock()))
            yield Picture(feed.clock(), None, bgr.astype(np.uint8, copy=False))
    finally:
        capture.release()


def _check_device(url: str) -> None:
    """UserError where a device, /dev/videoN or N, cannot be opened: OpenCV would not say why."""
    if sys.platform != "linux":
        return
    path = Path(f"/dev/video{url}" if url.isdecimal() else url)
    if not path.exists():
        there = ", ".join(sorted(map(str, Path("/dev").glob("video*")))) or "none"
        raise UserError(f"camera {url}: there is no {path}; cameras there now: {there}")
    if not os.access(path, os.R_OK | os.W_OK):
        raise UserError(
            f"no permission to open the camera {path}: `sudo usermod -aG video $USER`, then log in "
            "again"
        )


def camera_feed(
    url: str, clock: Callable[[], float], report: Callable[[str], None]
) -> Feed[Picture]:
    """`url`: http(s)://... of MJPEG or of single JPEGs, rtsp://..., a video file, /dev/videoN or N.

    The feed runs when it is started. Raises UserError on what cannot mean any of these.
    """
    parts = urlsplit(url)
    source: Callable[[Feed[Picture]], Iterator[Picture]]
    if parts.scheme in ("http", "https"):
        try:
            usable = bool(parts.hostname) and (parts.port is None or parts.port > 0)
        except ValueError:
            usable = False
        if not usable:
            raise UserError(f"camera address {url}: needs a host, as http://192.168.1.7:8080/video")
        source = partial(_from_http, parts)
    elif parts.scheme == "rtsp":
        source = partial(_from_opencv, url, False)
    elif parts.scheme:
        raise UserError(
            f"camera address {url}: scheme {parts.scheme}:// is unknown; use http://, rtsp://, "
            "a video file or /dev/videoN"
        )
    elif url.isdecimal() or Path(url).is_char_device():
        _check_device(url)
        device = int(url) if url.isdecimal() else url
        source = partial(_from_opencv, device, False)
    elif Path(url).is_file():
        source = partial(_from_opencv, url, True)
    elif Path(url).exists():
        raise UserError(f"camera {url} is neither a camera nor a video file; name one")
    else:
        raise UserError(
            f"camera {url} does not exist; give http://..., a video file or /dev/videoN"
        )
    return Feed("camera", source, clock, report)
