"""The phone on its mount: pictures over HTTP and positions over TCP, as common phone apps do.

    GET /video     multipart/x-mixed-replace of JPEG files (also /videofeed)
    GET /shot.jpg  the latest picture
    GET /sensors.json  the latest samples of gyroscope and accelerometer
    TCP            NMEA sentences, one per line with CR LF

Whoever owns the phone puts pictures and sentences in; clients see them `delay_s` later. In a
drop-out every connection ends and new ones are closed at once. Wall-clock time: this is for the
virtual serial rig, never for the lockstep.
"""

from __future__ import annotations

import math
import socketserver
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Annotated, Final

import numpy as np
from pydantic import Field as Limits

from sim_plant.gyro import Sample, sensors_json
from sim_plant.strict import NotNegative, Positive, Strict

PATHS: Final = ("/video", "/videofeed", "/shot.jpg", "/sensors.json")
KEPT: Final = 250
"""Samples in one answer: five seconds of the gyroscope's."""
BOUNDARY: Final = "Ba4oTvQMY8ew04N8dcnM"


class PhoneSpec(Strict):
    """Where the phone listens and how badly."""

    host: str = "127.0.0.1"
    http_port: Annotated[int, Limits(ge=0, le=65535)] = 8080
    """0 takes any free port."""
    nmea_port: Annotated[int, Limits(ge=0, le=65535)] = 11123
    delay_s: NotNegative = 0.15
    """From `show` or `say` to the client."""
    dropouts_per_minute: NotNegative = 0.0
    dropout_s: Positive = 2.0
    """Mean length of a drop-out."""
    seed: int = 0


class _Line:
    """A delay line that many readers follow, each at its own pace."""

    def __init__(self, delay_s: float, keep: int, clock: Callable[[], float]) -> None:
        self._delay = delay_s
        self._clock = clock
        self._items: deque[tuple[int, float, bytes]] = deque(maxlen=keep)
        self._next = 0
        self._changed = threading.Condition()

    def put(self, data: bytes) -> None:
        with self._changed:
            self._items.append((self._next, self._clock() + self._delay, data))
            self._next += 1
            self._changed.notify_all()

    def wake(self) -> None:
        """Lets every waiting reader look up."""
        with self._changed:
            self._changed.notify_all()

    @property
    def end(self) -> int:
        """The number that the next item will get."""
        return self._next

    def since(self, number: int, patience_s: float) -> list[tuple[int, bytes]]:
        """Items numbered `number` and later that are due; waits up to `patience_s` for one."""
        with self._changed:
            until = self._clock() + patience_s
            while True:
                now = self._clock()
                fresh = [i for i in self._items if i[0] >= number]
                due = [(n, data) for n, at, data in fresh if at <= now]
                if due or now >= until:
                    return due
                ahead = min((at for _, at, _ in fresh), default=until)
                self._changed.wait(max(0.001, min(until, ahead) - now))


class _HttpServer(ThreadingHTTPServer):
    daemon_threads = True
    phone: Phone


class _TcpServer(socketserver.ThreadingTCPServer):
    daemon_threads = True
    allow_reuse_address = True
    phone: Phone


class _Pages(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.0"
    server_version = "IP Webcam Server"
    sys_version = ""
    server: _HttpServer

    def do_GET(self) -> None:
        phone = self.server.phone
        if not phone.online:
            self.close_connection = True
            return
        path = self.path.partition("?")[0]
        try:
            if path in ("/video", "/videofeed"):
                self._video(phone)
            elif path == "/shot.jpg":
                self._shot(phone)
            elif path == "/sensors.json" and phone.samples:
                self._answer("application/json", sensors_json(list(phone.samples)))
            else:
                self.send_error(404, f"only {', '.join(PATHS)} are served")
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True

    def _shot(self, phone: Phone) -> None:
        items = phone.pictures.since(0, 2.0)
        if not items:
            self.send_error(503, "the camera has no picture yet")
            return
        self._answer("image/jpeg", items[-1][1])

    def _answer(self, kind: str, data: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _video(self, phone: Phone) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace;boundary={BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        number = max(0, phone.pictures.end - 1)
        while phone.online:
            items = phone.pictures.since(number, 0.25)
            if not items:
                continue
            number, data = items[-1]
            number += 1
            head = (
                f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
            )
            self.wfile.write(head.encode("ascii") + data + b"\r\n")

    def log_message(self, *_: object) -> None:
        """Silent: requests are not the operator's business."""


class _Positions(socketserver.BaseRequestHandler):
    server: _TcpServer

    def handle(self) -> None:
        phone = self.server.phone
        number = phone.sentences.end
        try:
            while phone.online:
                for n, data in phone.sentences.since(number, 0.25):
                    number = n + 1
                    self.request.sendall(data)
        except (BrokenPipeError, ConnectionResetError):
            return


class Phone:
    """Serves from `with Phone(spec) as phone:`; raises OSError where a port is taken."""

    def __init__(
        self, spec: PhoneSpec | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.spec = spec or PhoneSpec()
        self._clock = clock
        s = self.spec
        self.pictures = _Line(s.delay_s, 2 + math.ceil(s.delay_s * 60), clock)
        self.sentences = _Line(s.delay_s, 200 + math.ceil(s.delay_s * 60), clock)
        self.samples: deque[Sample] = deque(maxlen=KEPT)
        """Of the gyroscope, the newest last."""
        self._connected = True
        self._closed = False
        self._rng = np.random.default_rng([s.seed, 0x70])
        self._lost_from = self._lost_until = -math.inf
        self._plan(clock())
        self._lock = threading.Lock()
        self._http = _HttpServer((s.host, s.http_port), _Pages)
        try:
            self._tcp = _TcpServer((s.host, s.nmea_port), _Positions)
        except OSError:
            self._http.server_close()
            raise
        self._http.phone = self._tcp.phone = self
        self._threads = [
            threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
            for server in (self._http, self._tcp)
        ]

    def _plan(self, now: float) -> None:
        rate = self.spec.dropouts_per_minute / 60
        if rate > 0:
            self._lost_from = now + self._rng.exponential(1 / rate)
            self._lost_until = self._lost_from + self._rng.exponential(self.spec.dropout_s)

    @property
    def online(self) -> bool:
        """Whether clients are served at this moment."""
        with self._lock:
            now = self._clock()
            if now >= self._lost_until > -math.inf:
                self._plan(now)
            lost = self._lost_from <= now < self._lost_until
            return self._connected and not self._closed and not lost

    def connect(self, connected: bool) -> None:
        """Takes the phone off the network, or back."""
        self._connected = connected
        self.pictures.wake()
        self.sentences.wake()

    def show(self, jpeg: bytes) -> None:
        """The camera's next picture, a whole JPEG file."""
        self.pictures.put(jpeg)

    def say(self, sentences: Iterable[str]) -> None:
        """The receiver's next epoch: NMEA sentences without line ends."""
        self.sentences.put("".join(f"{s}\r\n" for s in sentences).encode("ascii"))

    def feel(self, samples: Iterable[Sample]) -> None:
        """New samples of the gyroscope. Until the first the phone has none."""
        self.samples.extend(samples)

    @property
    def camera_url(self) -> str:
        """Of the MJPEG stream."""
        host, port = self._http.server_address[:2]
        return f"http://{host!s}:{port}/video"

    @property
    def gnss_url(self) -> str:
        """Of the NMEA stream."""
        host, port = self._tcp.server_address[:2]
        return f"tcp://{host!s}:{port}"

    def __enter__(self) -> Phone:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closed = True
        self.connect(False)
        for server, thread in zip((self._http, self._tcp), self._threads, strict=True):
            server.shutdown()
            thread.join()
            server.server_close()
