"""The board's port: what an address means, whether it is there, and why it does not open."""

from __future__ import annotations

import errno
import os
import re
import stat
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from host.core.errors import UserError
from host.link import protocol

READ_S = 0.005
"""What a read waits for at most. Fixed: pyserial sets up the whole port again at each change."""
_ERRNO = re.compile(r"^\[Errno -?\d+\] ")
WRITE_TIMEOUT_S = 0.5
"""A port that takes nothing for so long has no board that reads."""
NETWORK: Final = ("socket", "rfc2217")
"""Of pyserial's kinds of address: those that name a host and a port."""


def check_address(port: str) -> None:
    """UserError where an address can never mean a port. Opens nothing."""
    kind = port.partition("://")[0] if "://" in port else ""
    if not port:
        raise UserError("--port is empty: give the board's serial port, as /dev/ttyACM0")
    if kind not in NETWORK:
        return
    try:
        parts = urlsplit(port)
        usable = bool(parts.hostname) and bool(parts.port)
    except ValueError:
        usable = False
    if not usable:
        raise UserError(
            f"cannot connect to {port}: the address needs a host and a port from 1 to 65535, as "
            f"{kind}://192.168.1.7:5000"
        )


def check_port(port: str) -> None:
    """UserError where an address can never mean a port, or means one that is not there. Opens
    nothing: a board resets when its port is opened."""
    check_address(port)
    if "://" in port or os.name != "posix":
        return
    try:
        found = Path(port).stat()
    except (OSError, ValueError) as error:
        raise UserError(_why_not(port, error)) from error
    if not (stat.S_ISCHR(found.st_mode) and _is_terminal(found.st_rdev)):
        raise UserError(f"{port} is not a serial port; give one, as /dev/ttyACM0")
    if not os.access(port, os.R_OK | os.W_OK):
        raise UserError(_why_not(port, PermissionError(errno.EACCES, "")))


def _is_terminal(device: int) -> bool:
    """Whether a device is of the kind that serial ports are, as far as Linux says it."""
    kind = Path(f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/subsystem")
    return not kind.exists() or kind.resolve().name == "tty"


def open_port(port: str, baud: int = protocol.BAUD, read_s: float = READ_S) -> serial.Serial:
    """A read waits for `read_s` at most. UserError where it is missing, taken, or no port."""
    check_address(port)
    remote = port.startswith("rfc2217://")  # pyserial has no write timeout there
    try:
        return serial.serial_for_url(
            port,
            baudrate=baud,
            timeout=read_s,
            write_timeout=None if remote else WRITE_TIMEOUT_S,
            exclusive=True,
        )
    except (OSError, ValueError) as error:
        raise UserError(_why_not(port, error)) from error


def _why_not(port: str, error: Exception) -> str:
    """Why a port does not open, and what to do about it."""
    code = getattr(error, "errno", None)
    if "://" in port:
        kind = port.partition("://")[0]
        if "protocol" in str(error) and "not known" in str(error):
            known = " or ".join(f"{each}://HOST:PORT" for each in NETWORK)
            return f"cannot connect to {port}: {kind}:// is unknown; give a serial port, {known}"
        why = str(error).removeprefix(f"Could not open port {port}: ")
        why = _ERRNO.sub("", why)
        return f"cannot connect to {port}: {why}; check address and network"
    if code == errno.ENOENT:
        there = ", ".join(sorted(p.device for p in list_ports.comports())) or "none"
        return f"serial port {port} does not exist; ports there now: {there}"
    if code == errno.EACCES:
        return f"no permission to open {port}: `sudo usermod -aG dialout $USER`, then log in again"
    if code in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
        return f"{port} is in use by another program; close it first"
    if code == errno.EISDIR:
        return f"cannot open {port} as a serial port: it is a folder"
    if "configure port" in str(error):
        return f"{port} is not a serial port"
    return f"cannot open {port} as a serial port: {error}"
