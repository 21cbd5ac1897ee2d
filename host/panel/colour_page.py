"""The page with sliders for the paper's parameters: the staged picture follows every move.

`Tuner` does the work and knows nothing of HTTP; the server answers four requests, each with JSON
but for the page itself: GET / (colour_page.html), GET /begin (names, sliders and parameters to
start from), GET /look?picture=N&parameter=value... (staged picture and confidence), POST /best and
POST /save (parameters as a JSON object). What is wrong with a request comes back as {"error": ...}.
"""

from __future__ import annotations

import base64
import datetime
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import cv2
from pydantic import ValidationError

from host.core.errors import UserError
from host.vision.figure import staged
from host.vision.mounted.detector import MountedDetector
from host.vision.mounted.paper import PaperParams, PaperPhoto
from host.vision.pictures import Picture
from host.vision.tuning.profiles import Circumstance, Profiles
from host.vision.tuning.search import Contrast, tune

Json = dict[str, Any]

LONGEST_BODY = 10_000
"""Bytes of a request: parameters need a few hundred."""


@dataclass(frozen=True, slots=True)
class Slider:
    """One parameter on the page; the label says what more of it does."""

    name: str
    label: str
    least: float
    most: float
    step: float


SLIDERS = (
    Slider("phi1_deg", "φ1: hue where crop begins (red 0, yellow 60), degrees", 0, 360, 1),
    Slider("phi2_deg", "φ2: hue where crop ends (green 120), degrees", 0, 360, 1),
    Slider("a", "a: weight of the saturation", 0, 2, 0.05),
    Slider("b", "b: weight of the brightness; lower leaves out pale straw and sky", -1, 0.5, 0.01),
    Slider("ripe_from_deg", "ripe from, on the hue stretched over the circle", 0, 360, 1),
    Slider("ripe_to_deg", "ripe up to; above it is unripe and red", 0, 360, 1),
    Slider("contrast", "least step of brightness beside a stem", 1, 40, 0.5),
    Slider("gap_px", "gaps that a stem may have, pixels", 0, 8, 1),
)


@dataclass(frozen=True, slots=True)
class Tuner:
    """Pictures, the detector that looks at them, and where the outcome goes."""

    pictures: Sequence[tuple[str, Picture]]
    eye: Callable[[str, PaperParams], MountedDetector | PaperPhoto]
    """Of a picture's name and parameters."""
    contrast: Contrast
    """Over all pictures."""
    start: PaperParams
    database: Path
    where: Circumstance
    clock: Callable[[], datetime.datetime]

    def begin(self) -> Json:
        """What the page shows before the first move."""
        sliders = [
            {"name": s.name, "label": s.label, "min": s.least, "max": s.most, "step": s.step}
            for s in SLIDERS
        ]
        names = [name for name, _ in self.pictures]
        return {"pictures": names, "sliders": sliders, "params": self.start.model_dump()}

    def look(self, picture: int, params: PaperParams) -> Json:
        """The staged picture as a data URL, and what the detector says of it."""
        if not 0 <= picture < len(self.pictures):
            raise UserError(f"picture {picture}: there are {len(self.pictures)}, counted from 0")
        name, bgr = self.pictures[picture]
        view = self.eye(name, params).see(bgr, stages=True)
        _, jpeg = cv2.imencode(".jpg", staged(bgr, view))
        return {
            "image": "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode(),
            "confidence": round(view.confidence, 3),
            "reason": view.reason,
        }

    def best(self, params: PaperParams) -> Json:
        """The parameters of greatest contrast over all pictures that a search from `params` on
        finds."""
        found, reached = tune(self.contrast, params)
        return {"params": found.model_dump(), "contrast": round(reached, 3)}

    def save(self, params: PaperParams) -> Json:
        """Keeps `params` as the profile of the circumstance."""
        reached = self.contrast(params)
        with Profiles(self.database) as profiles:
            profiles.save(self.where, params, reached, self.clock())
        return {"saved": str(self.database), "contrast": round(reached, 3)}


class TunePage(ThreadingHTTPServer):
    """Serves one tuner on this machine alone; port 0 takes a free one."""

    daemon_threads = True

    def __init__(self, tuner: Tuner, port: int) -> None:
        """UserError where the port is taken."""
        self.tuner = tuner
        self.page = (resources.files("host.panel") / "colour_page.html").read_bytes()
        try:
            super().__init__(("127.0.0.1", port), _Requests)
        except OSError as error:
            raise UserError(f"port {port}: {error.strerror}; name another with --port") from error

    @property
    def url(self) -> str:
        """For a browser on this machine."""
        return f"http://127.0.0.1:{self.server_address[1]}/"


class _Requests(BaseHTTPRequestHandler):
    server: TunePage

    def do_GET(self) -> None:
        tuner = self.server.tuner
        url = urlsplit(self.path)
        if url.path == "/":
            self._send(200, "text/html; charset=utf-8", self.server.page)
        elif url.path == "/begin":
            self._answer(tuner.begin)
        elif url.path == "/look":
            query = dict(parse_qsl(url.query))
            self._answer(lambda: tuner.look(_number(query.pop("picture", "0")), _params(query)))
        else:
            self._fail(404, f"{url.path} is not served here")

    def do_POST(self) -> None:
        work = {"/best": self.server.tuner.best, "/save": self.server.tuner.save}.get(self.path)
        length = _number(self.headers.get("Content-Length", "0"))
        # what is left unread would cut the answer off
        body = self.rfile.read(max(0, min(length, 100 * LONGEST_BODY)))
        if work is None:
            self._fail(404, f"{self.path} is not served here")
        elif not 0 < length <= LONGEST_BODY:
            self._fail(413, f"a request holds 1 to {LONGEST_BODY} bytes of parameters")
        elif self.headers.get_content_type() != "application/json":
            # a page of another site cannot send this kind unasked
            self._fail(415, "parameters come as application/json")
        else:
            self._answer(lambda: work(_params(_parsed(body))))

    def _answer(self, work: Callable[[], Json]) -> None:
        try:
            found = work()
        except UserError as error:
            self._fail(400, str(error))
        else:
            self._send(200, "application/json", json.dumps(found).encode())

    def _fail(self, status: int, why: str) -> None:
        self._send(status, "application/json", json.dumps({"error": why}).encode())

    def _send(self, status: int, kind: str, body: bytes) -> None:
        try:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True

    def log_message(self, format: str, *args: object) -> None:
        """Every move of a slider is a request: nothing to log."""


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() else -1


def _parsed(body: bytes) -> Json:
    try:
        found = json.loads(body)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise UserError("parameters are one JSON object")
    return found


def _params(values: Json) -> PaperParams:
    try:
        return PaperParams.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{where}: {first['msg']}") from error
