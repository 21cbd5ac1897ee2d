"""What the panel and the machine's process say to each other over a Unix socket.

A frame is its payload's length (u32, little-endian), one byte that names the kind, and the payload:
`J` a JSON object, `P` a JPEG file. Neither end ever waits for the other: what a full socket does
not take is dropped if a newer one will come anyway (`offer`), or kept in order (`post`).
"""

from __future__ import annotations

import json
import socket
import struct
from collections import deque
from typing import Any, Final

Json = dict[str, Any]

HEAD: Final = struct.Struct("<IB")
LONGEST: Final = 8 * 1024 * 1024
"""Bytes of a frame: a phone's largest picture."""
POSTED: Final = 200
"""Frames kept for a peer that does not read; older ones are lost."""


class WireError(Exception):
    """The peer is gone, or is no peer of ours."""


def frame(kind: str, payload: bytes) -> bytes:
    """As it goes over the socket."""
    return HEAD.pack(len(payload), ord(kind)) + payload


def packed(message: Json) -> bytes:
    """A JSON object's frame."""
    return frame("J", json.dumps(message, allow_nan=False, separators=(",", ":")).encode())


class Frames:
    """Cuts bytes into frames."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[tuple[str, bytes]]:
        """(kind, payload) of the frames completed by `data`. Raises WireError on one too long."""
        self._data += data
        found = []
        while len(self._data) >= HEAD.size:
            length, kind = HEAD.unpack_from(self._data)
            if length > LONGEST:
                raise WireError(f"a frame of {length} bytes")
            if len(self._data) < HEAD.size + length:
                break
            found.append((chr(kind), bytes(self._data[HEAD.size : HEAD.size + length])))
            del self._data[: HEAD.size + length]
        return found


class Peer:
    """One end of a connected socket that never blocks."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._frames = Frames()
        self._leaving = b""
        self._posted: deque[bytes] = deque(maxlen=POSTED)

    def read(self) -> list[Json]:
        """The JSON objects that have come. Raises WireError when the peer is gone."""
        found = []
        while True:
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                break
            except OSError as error:
                raise WireError(str(error)) from error
            if not data:
                raise WireError("closed")
            for kind, payload in self._frames.feed(data):
                if kind != "J":
                    continue
                try:
                    message = json.loads(payload)
                except ValueError as error:
                    raise WireError("no JSON") from error
                if isinstance(message, dict):
                    found.append(message)
        return found

    def offer(self, data: bytes) -> bool:
        """Sends a frame if nothing older still waits to leave; False where it is dropped."""
        self._flush()
        if self._leaving or self._posted:
            return False
        self._leaving = data
        self._flush()
        return True

    def post(self, message: Json) -> None:
        """Sends a JSON object, at once or when the socket takes it."""
        self._posted.append(packed(message))
        self._flush()

    def _flush(self) -> None:
        while True:
            if not self._leaving:
                if not self._posted:
                    return
                self._leaving = self._posted.popleft()
            try:
                sent = self._socket.send(self._leaving)
            except BlockingIOError:
                return
            except OSError as error:
                raise WireError(str(error)) from error
            self._leaving = self._leaving[sent:]

    def close(self) -> None:
        """Hangs up."""
        self._socket.close()
