"""HTTP as the panel takes it: one request a connection, its head within HEAD_S, few connections an
address. A device on the farm's network that holds connections open, by malice or by mistake, keeps
nobody else out for long."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any, Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S: Final = 5.0
"""For a request's head to come."""
AN_ADDRESS: Final = 16
"""Connections that have not become a WebSocket, from one address."""
IN_ALL: Final = 64
"""Connections, of all addresses."""

_open: Counter[str] = Counter()


class StrictHttp(H11Protocol):
    """uvicorn's protocol with these bounds."""

    _address = ""
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Too many: closed without a word."""
        super().connection_made(transport)
        self._address = self.client[0] if self.client else "-"
        _open[self._address] += 1
        if _open[self._address] > AN_ADDRESS or _open.total() > IN_ALL:
            transport.abort()
            return
        self._timer = self.loop.call_later(HEAD_S, self._too_slow)

    def _too_slow(self) -> None:
        if not self._asked and not self.transport.is_closing():
            self.transport.abort()

    @property
    def _asked(self) -> bool:
        """Whether a request's head has come whole."""
        scope: object = self.scope
        return scope is not None

    def _gone(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._address:
            _open[self._address] -= 1
            if _open[self._address] <= 0:
                del _open[self._address]
            self._address = ""

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """A WebSocket counts as a page, not as a request."""
        self._gone()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, exc: Exception | None) -> None:
        """Makes room."""
        self._gone()
        super().connection_lost(exc)


def settings() -> dict[str, Any]:
    """What `uvicorn.Config` is told besides."""
    return {
        "http": StrictHttp,
        "ws": "websockets-sansio",
        "ws_max_size": 64 * 1024,
        "ws_max_queue": 8,
        "ws_ping_interval": 5.0,
        "ws_ping_timeout": 10.0,
        "ws_per_message_deflate": False,
        "h11_max_incomplete_event_size": 16 * 1024,
        "proxy_headers": False,
        "server_header": False,
        "access_log": False,
        "log_level": "critical",
        "lifespan": "auto",
        "timeout_graceful_shutdown": 2,
    }
