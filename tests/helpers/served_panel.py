"""A panel that serves, its machine's process beside it, and a page without a browser."""

from __future__ import annotations

import asyncio
import http.client
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from websockets.sync.client import ClientConnection, connect

from host.core.vehicle import Vehicle
from host.panel import strict_http
from host.panel.fields import FieldDesk
from host.panel.guard import Pairing
from host.panel.machine import Settings
from host.panel.server import Panel, application

Json = dict[str, Any]
PATIENCE_S = 30.0


class Served:
    """Where the panel is, and the panel."""

    def __init__(self, panel: Panel, port: int) -> None:
        self.panel = panel
        self.port = port
        self.host = f"127.0.0.1:{port}"

    def ask(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: dict[str, str] | None = None,
    ) -> tuple[int, bytes, http.client.HTTPMessage]:
        """Status, body and headers of one request."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read(), answer.headers
        finally:
            connection.close()

    def page(self, **headers: str) -> Page:
        """A page's socket, open."""
        return Page(
            connect(
                f"ws://{self.host}/live",
                origin=f"http://{self.host}",  # type: ignore[arg-type]
                additional_headers=headers,
            )
        )


class Page:
    """What a page's script does, without its looks."""

    def __init__(self, opening: connect) -> None:
        self._opening = opening
        self.socket: ClientConnection = opening.__enter__()
        self.seen: list[Json] = []

    def ask(self, what: str, **values: Any) -> None:
        """One wish, on the sight of the newest snapshot."""
        seen = next((m["t"] for m in reversed(self.seen) if m["kind"] == "now"), None)
        self.socket.send(json.dumps({"do": what, "seen": seen, **values}))

    def until(self, fits: Callable[[Json], bool], patience_s: float = PATIENCE_S) -> Json:
        """The first message that fits; signs of life go out meanwhile."""
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline:
            try:
                data = self.socket.recv(timeout=0.3)
            except TimeoutError:
                continue
            if isinstance(data, bytes):
                continue
            message = json.loads(data)
            self.seen.append(message)
            if fits(message):
                return dict(message)
        raise AssertionError(f"nothing fitted; the last: {self.seen[-1:]}")

    def close(self) -> None:
        """The page is closed."""
        self._opening.__exit__(None, None, None)


def now(**wanted: Any) -> Callable[[Json], bool]:
    """Whether a message is a snapshot with these values."""
    return lambda message: (
        message["kind"] == "now" and all(message.get(key) == value for key, value in wanted.items())
    )


@contextmanager
def served(
    port: str,
    folder: Path,
    *,
    lan: bool = False,
    clock: Callable[[], float] = time.monotonic,
    show_code: Callable[[str, float], None] = lambda _code, _wait_s: None,
    **more: Any,
) -> Iterator[Served]:
    """Serves until left."""
    settings = Settings.model_validate({"port": port, "folder": folder, **more})
    fields = FieldDesk(folder, Vehicle(), None, None)
    panel = Panel(settings, Pairing(clock, needed=lan), fields, show_code)
    with running(application(panel)) as number:
        yield Served(panel, number)


@contextmanager
def running(app: ASGIApp) -> Iterator[int]:
    """Serves an application in a thread; gives its port."""
    listener = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, **strict_http.settings()))
    thread = threading.Thread(
        target=lambda: asyncio.run(server.serve(sockets=[listener])), daemon=True
    )
    thread.start()
    try:
        yield int(listener.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join(20)
        listener.close()
