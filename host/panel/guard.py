"""Who may: which hosts and origins are answered, who has paired, who drives.

Without --lan the page is served to this machine alone, and whoever can open it may drive. With it a
phone pairs once by a code that the laptop shows; a cookie says later that it has. Pure logic: no
clock, no network.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import urlsplit

ALPHABET: Final = "23456789ABCDEFGHJKMNPQRSTUVWXYZ"
"""Without what looks alike."""
CODE_LETTERS: Final = 6
"""Of the pairing code: 30 bits, read out across a field."""
CODE_S: Final = 600.0
"""How long a code pairs."""
GUESSES: Final = 5
"""Wrong codes after which the code is a new one, and nobody pairs for a while."""
WAIT_S: Final = 30.0
"""After too many wrong codes, doubled each time ..."""
LONGEST_WAIT_S: Final = 3600.0
"""... up to an hour."""
PAIRED: Final = 8
"""Phones paired at a time; one more ends the oldest."""
AWAY_S: Final = 4.0
"""A driver not heard of for so long may be replaced."""


def own_host(header: str, address: str, port: int) -> bool:
    """Whether a Host header names this server by an address and port on which it was reached.
    Names are refused, `localhost` apart: a name can be made to point anywhere (DNS rebinding)."""
    try:
        parts = urlsplit(f"//{header}")
        name, given = parts.hostname, parts.port
    except ValueError:
        return False
    if parts.username is not None or parts.path or parts.query or name is None:
        return False
    if (given or 80) != port:
        return False
    try:
        here = ipaddress.ip_address(address)
        if name == "localhost":
            return here.is_loopback
        return ipaddress.ip_address(name) == here
    except ValueError:
        return False


def own_origin(origin: str | None, host: str, *, needed: bool) -> bool:
    """Whether a request comes from our own page. A browser always says where a WebSocket or a form
    comes from (`needed`)."""
    if origin is None:
        return not needed
    return origin == f"http://{host}"


class Pairing:
    """Codes and those whom a code let in."""

    def __init__(self, clock: Callable[[], float], *, needed: bool) -> None:
        self.needed = needed
        self._clock = clock
        self._known: list[str] = []
        self._wrong = 0
        self._locks = 0
        self._locked_until = 0.0
        self._renew()

    @property
    def code(self) -> str:
        """The one that pairs now."""
        if self._clock() > self._code_until:
            self._renew()
        return self._code

    @property
    def wait_s(self) -> float:
        """For how long no code is looked at, for there were too many wrong ones."""
        return max(0.0, self._locked_until - self._clock())

    def pair(self, guess: str) -> str | None:
        """A ticket for whoever knows the code; it pairs once. None for a wrong one."""
        if self.wait_s > 0:
            return None
        if not hmac.compare_digest(guess.strip().upper().encode(), self.code.encode()):
            self._wrong += 1
            if self._wrong >= GUESSES:
                self._wrong = 0
                self._locked_until = self._clock() + min(LONGEST_WAIT_S, WAIT_S * 2.0**self._locks)
                self._locks += 1
                self._renew()
            return None
        self._wrong = self._locks = 0
        self._renew()
        ticket = secrets.token_urlsafe(32)
        self._known = [*self._known[1 - PAIRED :], ticket]
        return ticket

    def known(self, ticket: str | None) -> bool:
        """Whether a ticket is one of those given."""
        if not self.needed:
            return True
        given = (ticket or "").encode()
        return sum(hmac.compare_digest(given, one.encode()) for one in self._known) > 0

    def _renew(self) -> None:
        self._code = "".join(secrets.choice(ALPHABET) for _ in range(CODE_LETTERS))
        self._code_until = self._clock() + CODE_S


@dataclass
class Seat:
    """The one page that drives; the others watch. It is taken, left, or lost by silence."""

    clock: Callable[[], float]
    holder: str | None = None
    heard: float = field(default=0.0)

    @property
    def taken(self) -> bool:
        """Whether a page sits there and is awake."""
        return self.holder is not None and self.clock() - self.heard < AWAY_S

    def take(self, page: str) -> bool:
        """False where another page sits there and is awake."""
        if self.holder != page and self.taken:
            return False
        self.holder, self.heard = page, self.clock()
        return True

    def hear(self, page: str) -> bool:
        """Notes a sign of life; False for one who only watches."""
        if page != self.holder:
            return False
        self.heard = self.clock()
        return True

    def leave(self, page: str) -> None:
        """Free for the next."""
        if page == self.holder:
            self.holder = None
