"""The firmware's fault log: a ring in the board's EEPROM that outlives a reset."""

from __future__ import annotations

import datetime

from host.core.errors import UserError
from host.link import protocol
from host.link.session import Link

ENTRIES = 16
"""That the board has room for (firmware/src/core/fault_log.h)."""
SINCE = (2, 1)
"""The firmware's version that keeps one."""
UPTIME_MAX_S = 65535
"""Where an entry's uptime stands still."""


def read_all(link: Link) -> list[protocol.LogEntry]:
    """The entries, newest first. UserError where the firmware is too old to keep any."""
    _known(link)
    found = []
    for index in range(ENTRIES):
        entry = link.ask(protocol.LogGet(index))
        assert isinstance(entry, protocol.LogEntry)
        if entry.faults:
            found.append(entry)
    return found


def clear(link: Link) -> None:
    """Empties it; the firmware answers when that is done. UserError where it refuses."""
    _known(link)
    link.ask(protocol.LogClear(), timeout_s=3.0)


def text_of(entry: protocol.LogEntry) -> str:
    """When it came, in words."""
    causes = [t for bit, (t, _) in protocol.RESETCAUSE_TEXTS.items() if bit & entry.reset_cause]
    start = f"start by {' and '.join(causes) or 'an unknown cause'}"
    if entry.uptime == 0 and entry.state is protocol.State.FAULT:
        return f"at the {start}"
    least = "more than " if entry.uptime == UPTIME_MAX_S else ""
    after = datetime.timedelta(seconds=entry.uptime)
    return f"{least}{after} after the {start}, {entry.state.name}"


def _known(link: Link) -> None:
    version = link.session.version
    if version is None or (version.firmware_major, version.firmware_minor) < SINCE:
        raise UserError(
            f"{link.port}: this firmware keeps no fault log; `daranti flash` writes one that does"
        )
