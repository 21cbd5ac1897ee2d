"""The page with sliders for the paper's parameters: the staged picture follows every move.

`Tuner` does the work and knows nothing of HTTP; the server answers four requests, each with JSON
but for the page itself: GET / (colour_page.html), GET /begin (names, sliders and parameters to
start from), GET /look?picture=N&parameter=value... (staged picture and confidence), POST /best and
POST /save (parameters as a JSON object). What is wrong with a request comes back as {"error": ...}.
"""

from __future__ import annotations

import asyncio
import base64
import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import cv2
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from host.core.errors import UserError
from host.panel.body import BodyError, json_body
from host.panel.gate import Guard
from host.vision.figure import staged
from host.vision.mounted.detector import MountedDetector
from host.vision.mounted.paper import PaperParams, PaperPhoto
from host.vision.pictures import Picture
from host.vision.tuning.profiles import Circumstance, Profiles
from host.vision.tuning.search import Contrast, tune

Json = dict[str, Any]

COLOUR_POLICY: Final = (
    b"default-src 'self'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    b"img-src 'self' data:; frame-ancestors 'none'"
)
"""The page holds its own script and style."""


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


def colour_application(tuner: Tuner) -> ASGIApp:
    """The page and its four requests, for this machine's own browser alone."""
    page = (resources.files("host.panel") / "colour_page.html").read_bytes()

    async def answer(work: Callable[[], Json]) -> Response:
        try:
            return JSONResponse(await asyncio.to_thread(work))
        except UserError as error:
            return _fail(400, str(error))

    async def shown(_: Request) -> Response:
        return Response(page, media_type="text/html")

    async def begin(_: Request) -> Response:
        return await answer(tuner.begin)

    async def look(request: Request) -> Response:
        query = dict(request.query_params)
        number = _number(query.pop("picture", "0"))
        return await answer(lambda: tuner.look(number, _params(query)))

    async def change(request: Request) -> Response:
        work = {"/best": tuner.best, "/save": tuner.save}[request.url.path]
        try:
            body = await json_body(request)
        except BodyError as error:
            return _fail(error.status, str(error))
        return await answer(lambda: work(_params(body)))

    async def unknown(request: Request) -> Response:
        return _fail(404, f"{request.url.path} is not served here")

    app = Starlette(
        routes=[
            Route("/", shown),
            Route("/begin", begin),
            Route("/look", look),
            Route("/best", change, methods=["POST"]),
            Route("/save", change, methods=["POST"]),
            Route("/{path:path}", unknown, methods=["GET", "POST"]),
        ]
    )
    return Guard(app, policy=COLOUR_POLICY)


def _fail(status: int, why: str) -> Response:
    return JSONResponse({"error": why}, status)


def _number(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() else -1


def _params(values: Json) -> PaperParams:
    try:
        return PaperParams.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UserError(f"{where}: {first['msg']}") from error
