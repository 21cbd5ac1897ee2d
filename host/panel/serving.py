"""Serves an application until Ctrl-C."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from host.core.errors import UserError
from host.panel import strict_http


def serve_application(
    app: ASGIApp, host: str, port: int, option: str, say: Callable[[str], None]
) -> None:
    """`say` is told the address; port 0 takes a free one. UserError where the port is taken."""
    serve_on(listening(host, port, option), app, host, say)


def listening(host: str, port: int, option: str) -> socket.socket:
    """A port to serve on; 0 takes a free one. UserError where it is taken."""
    try:
        return socket.create_server((host, port))
    except OSError as error:
        raise UserError(f"port {port}: {error.strerror}; name another with {option}") from error


def serve_on(listener: socket.socket, app: ASGIApp, host: str, say: Callable[[str], None]) -> None:
    """`say` is told the address."""
    say(f"http://{reachable(host)}:{listener.getsockname()[1]}/")
    config = uvicorn.Config(app, **strict_http.settings())
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])


def reachable(host: str) -> str:
    """Where a browser finds the server."""
    if host != "0.0.0.0":
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing: only asks which way it would go
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"
