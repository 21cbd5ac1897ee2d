"""A request's body as the panel takes it: one small JSON object, soon. Whoever serves a page reads
bodies by this alone, so that a bound holds for all of them."""

from __future__ import annotations

import asyncio
import json
from typing import Any, Final

from starlette.requests import ClientDisconnect, Request

from host.core.errors import UserError

BODY_BYTES: Final = 10_000
"""Bytes of a body: a code or parameters need a few hundred."""
BODY_S: Final = 5.0
"""Seconds for a body to come."""


class BodyError(UserError):
    """The body is none that is taken; `status` is HTTP's word for why."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


async def json_body(request: Request) -> dict[str, Any]:
    """The body's JSON object. BodyError where it is none, too long or too slow. It counts the bytes
    that come: what the head says of their number need not be true."""
    if request.headers.get("content-type", "").split(";")[0] != "application/json":
        raise BodyError(415, "parameters come as application/json")
    data = bytearray()
    try:
        async with asyncio.timeout(BODY_S):
            async for part in request.stream():
                data += part
                if len(data) > BODY_BYTES:
                    raise BodyError(413, f"a request holds at most {BODY_BYTES} bytes")
        found = json.loads(data)
    except TimeoutError:
        raise BodyError(408, "too slow") from None
    except (ClientDisconnect, ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise BodyError(400, "parameters are one JSON object")
    return found
