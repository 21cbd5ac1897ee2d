"""The page with sliders: what it asks for and what it is answered, over HTTP and without."""

from __future__ import annotations

import base64
import datetime
import json
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from host.core.errors import UserError
from host.core.vehicle import LOW, Vehicle
from host.panel.body import BODY_BYTES
from host.panel.colour_page import SLIDERS, Tuner, colour_application
from host.panel.serving import serve_application
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import Circumstance, Profiles
from host.vision.tuning.search import mounted_contrast
from tests.helpers.scenery import field
from tests.helpers.served_panel import running

NOW = datetime.datetime(2026, 4, 28, 9, tzinfo=datetime.UTC)
BLIND = PaperParams(phi1_deg=200, phi2_deg=240)
"""Blue: no crop."""


def eye(params: PaperParams) -> MountedDetector:
    return make_detector("paper", Vehicle(), LOW, params=params)


@pytest.fixture
def tuner(tmp_path: Path) -> Tuner:
    pictures = [("first", field(LOW)), ("second", field(LOW, seed=2))]
    contrast = mounted_contrast([bgr for _, bgr in pictures], eye)
    database = tmp_path / "p.sqlite"
    where = Circumstance(9.0, mount="low")
    return Tuner(pictures, lambda _, p: eye(p), contrast, BLIND, database, where, lambda: NOW)


@pytest.fixture
def page(tuner: Tuner) -> Iterator[str]:
    with running(colour_application(tuner)) as port:
        yield f"http://127.0.0.1:{port}/"


def ask(url: str, body: object = None, kind: str = "application/json") -> tuple[int, Any]:
    """Status and parsed answer; a body makes it a POST."""
    data = None if body is None else json.dumps(body).encode()
    origin = url[: url.index("/", 8)]
    headers = {"Content-Type": kind, "Origin": origin} if data else {}
    request = urllib.request.Request(url, data, headers)
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def test_every_parameter_has_a_slider_that_reaches_its_default() -> None:
    defaults = PaperParams().model_dump()
    assert {s.name for s in SLIDERS} == set(defaults)
    for s in SLIDERS:
        assert s.least <= defaults[s.name] <= s.most
        for end in (s.least, s.most):
            PaperParams.model_validate({s.name: end})


def test_the_picture_follows_the_parameters(tuner: Tuner) -> None:
    blind, seeing = tuner.look(0, BLIND), tuner.look(0, PaperParams())
    assert blind["confidence"] < 0.5 <= seeing["confidence"]
    assert blind["image"] != seeing["image"]
    kind, _, data = seeing["image"].partition(",")
    assert kind == "data:image/jpeg;base64"
    jpeg = np.frombuffer(base64.b64decode(data), np.uint8)
    assert cv2.imdecode(jpeg, cv2.IMREAD_COLOR).shape[2] == 3


def test_the_search_starts_from_the_sliders_and_what_is_saved_is_what_they_say(page: str) -> None:
    status, begin = ask(page + "begin")
    assert (status, begin["pictures"]) == (200, ["first", "second"])
    assert begin["params"] == BLIND.model_dump()
    status, found = ask(page + "best", begin["params"])
    assert status == 200
    assert found["contrast"] >= 0.5
    status, saved = ask(page + "save", found["params"])
    assert (status, saved["contrast"]) == (200, found["contrast"])
    with Profiles(Path(saved["saved"])) as profiles:
        (kept,) = profiles.all()
    assert kept.params == PaperParams.model_validate(found["params"])
    assert kept.circumstance == Circumstance(9.0, mount="low")


def test_the_page_itself_is_served_and_asks_no_other_machine(page: str) -> None:
    with urllib.request.urlopen(page) as answer:
        text = answer.read().decode()
    assert "/look?" in text
    assert "//" not in text.replace("// ", "")


@pytest.mark.parametrize(
    ("path", "body", "kind", "status", "says"),
    [
        ("look?picture=7", None, "", 400, "there are 2"),
        ("look?picture=x", None, "", 400, "there are 2"),
        ("look?phi1_deg=900", None, "", 400, "phi1_deg"),
        ("look?unknown=1", None, "", 400, "unknown"),
        ("elsewhere", None, "", 404, "/elsewhere"),
        ("save", {"phi1_deg": "red"}, "application/json", 400, "phi1_deg"),
        ("save", [1], "application/json", 400, "JSON object"),
        ("save", {}, "text/plain", 415, "application/json"),
        ("save", {"a": "1" * 20_000}, "application/json", 413, "10000"),
        ("elsewhere", {}, "application/json", 404, "/elsewhere"),
    ],
)
def test_a_bad_request_is_told_what_is_wrong(
    page: str, path: str, body: object, kind: str, status: int, says: str
) -> None:
    got, answer = ask(page + path, body, kind)
    assert got == status
    assert says in answer["error"]


def test_a_port_that_is_taken_gives_one_clear_message(tuner: Tuner) -> None:
    app = colour_application(tuner)
    with running(app) as port, pytest.raises(UserError, match="name another with --port"):
        serve_application(app, "127.0.0.1", port, "--port", print)


def test_foreign_hosts_and_origins_are_refused(page: str) -> None:
    for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        with pytest.raises(urllib.error.HTTPError, match="421"):
            urllib.request.urlopen(urllib.request.Request(page + "begin", headers=headers))


def test_a_body_is_as_long_as_what_comes_of_it(page: str) -> None:
    """Chunks need no length in the head, or may belie it."""
    where = urlsplit(page)
    assert where.hostname is not None
    for length in ("", "Content-Length: 5\r\n"):
        head = f"POST /save HTTP/1.1\r\nHost: {where.netloc}\r\nOrigin: http://{where.netloc}\r\n"
        head += f"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n{length}\r\n"
        chunk = f"{BODY_BYTES:x}\r\n".encode() + b" " * BODY_BYTES + b"\r\n"
        with socket.create_connection((where.hostname, where.port or 80), timeout=30) as line:
            line.sendall(head.encode() + chunk + chunk)  # and no end
            answer = line.recv(4096)
        assert answer.startswith((b"HTTP/1.1 413", b"HTTP/1.1 400")), answer


def test_brackets_without_end_are_no_parameters(page: str) -> None:
    for text in (b"[" * 9000, b'{"a":' * 1800, b""):
        request = urllib.request.Request(page + "save", text, {"Content-Type": "application/json"})
        request.add_header("Origin", page.rstrip("/"))
        with pytest.raises(urllib.error.HTTPError, match="400"):
            urllib.request.urlopen(request)
