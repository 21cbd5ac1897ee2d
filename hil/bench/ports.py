"""The serial ports that a rig serves: a pseudo-terminal, TCP, RFC 2217."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import struct
import tty
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, Protocol

import serial
from serial.rfc2217 import PortManager

from host.core.errors import UserError

NETWORK: Final = ("socket", "rfc2217")


IN_THE_MAKING: Final = 2
"""Pictures developed or waiting for it."""


BACKLOG_BYTES: Final = 4096
"""What a real USB serial adapter keeps for a reader that does not read."""


class Port(Protocol):
    """The cable: bytes both ways, neither blocking. What nobody reads is lost, as on a real one."""

    name: str

    def read(self) -> bytes:
        """What the host has sent since."""
        ...

    def write(self, data: bytes) -> None:
        """To the host."""
        ...

    def close(self) -> None:
        """Unplugs."""
        ...


class PseudoTerminal:
    """A port that pyserial opens by its name."""

    def __init__(self, link: Path | None = None) -> None:
        """`link`: a symbolic link to keep at the same name from run to run. UserError where one is
        there that leads somewhere: to another rig's port, or to what it is a link of."""
        if link is not None and link.is_symlink() and link.exists():
            raise UserError(
                f"{link} leads to {link.readlink()} already, perhaps another rig's port; end that "
                "rig, remove the link or give another --link"
            )
        self._master, self._slave = pty.openpty()  # the slave stays open: hosts come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._pts = self.name
        self._link = link
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(self.name)
            except OSError as error:
                raise UserError(f"cannot link {link} to the port: {error.strerror}") from error
            self.name = str(link)

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self._master, BACKLOG_BYTES)
        return b""

    def write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            if self._link is not None and str(self._link.readlink()) == self._pts:
                self._link.unlink()
        os.close(self._master)
        os.close(self._slave)


class TcpPort:
    """A port that pyserial opens as socket://HOST:PORT, for a host on another machine. One client
    at a time; when it leaves, the next may come."""

    SCHEME = "socket"

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise UserError(f"cannot serve TCP port {port} of {host}: {error.strerror}") from error
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self.name = f"{self.SCHEME}://{host}:{self._listener.getsockname()[1]}"

    def read(self) -> bytes:
        if self._peer is None:
            with contextlib.suppress(BlockingIOError):
                peer, _ = self._listener.accept()
                peer.setblocking(False)
                peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._peer = peer
                self._greet()
            return b""
        try:
            data = self._peer.recv(BACKLOG_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return self._received(data)

    def write(self, data: bytes) -> None:
        self._send(self._to_send(data))

    def _greet(self) -> None:
        """A client has come."""

    def _received(self, data: bytes) -> bytes:
        """What of a client's bytes is meant for the firmware."""
        return data

    def _to_send(self, data: bytes) -> bytes:
        """The firmware's bytes as the client expects them."""
        return data

    def _send(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._peer.send(data)
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        self._hang_up()
        self._listener.close()


LONGEST_OPTION = 1000
"""Bytes of a negotiation that has not ended; a setting takes 6."""


class Rfc2217Port(TcpPort):
    """The same with the port's settings in the stream (RFC 2217): rfc2217://HOST:PORT."""

    SCHEME = "rfc2217"

    def _greet(self) -> None:
        settings: Any = serial.serial_for_url("loop://")  # remembers baud rate and lines only
        network: Any = SimpleNamespace(write=self._send)
        self._manager = PortManager(settings, network)

    def _received(self, data: bytes) -> bytes:
        try:
            found = b"".join(self._manager.filter(data))
        except (struct.error, ValueError, LookupError, TypeError, serial.SerialException):
            self._hang_up()  # a negotiation that is none
            return b""
        if len(self._manager.suboption or b"") > LONGEST_OPTION:
            self._hang_up()
        return found

    def _to_send(self, data: bytes) -> bytes:
        return b"" if self._peer is None else b"".join(self._manager.escape(data))
