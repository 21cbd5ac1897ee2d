"""The gate before every page of the panel: foreign hosts and origins are refused here."""

from __future__ import annotations

from typing import Final

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from host.panel.guard import own_host, own_origin

POLICY: Final = b"default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'"
HEADERS: Final = (
    (b"x-content-type-options", b"nosniff"),
    # With "no-referrer" a form of our own page would come from the origin "null".
    (b"referrer-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
    (b"connection", b"close"),
)


class Guard:
    """Refuses foreign hosts and origins before anything else looks at a request."""

    def __init__(self, app: ASGIApp, policy: bytes = POLICY) -> None:
        """`policy`: what the page may load (Content-Security-Policy)."""
        self.app = app
        self._headers = ((b"content-security-policy", policy), *HEADERS)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {
            key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]
        }
        address, port = scope["server"]
        host = headers.get("host", "")
        socket = scope["type"] == "websocket"
        needed = socket or scope["method"] not in ("GET", "HEAD")
        fine = own_host(host, address, port) and own_origin(
            headers.get("origin"), host, needed=needed
        )
        if fine:
            await self.app(scope, receive, send if socket else self._with_headers(send))
        elif socket:
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await Response("not this host or origin", 421)(scope, receive, self._with_headers(send))

    def _with_headers(self, send: Send) -> Send:
        async def sender(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *self._headers]
            await send(message)

        return sender
