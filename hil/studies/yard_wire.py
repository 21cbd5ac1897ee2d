"""A bench as a Wire, in lockstep: what a host's experiment drives in simulation."""

from __future__ import annotations

from typing import Final

from hil.bench.lockstep import Bench
from hil.bench.slices import SLICE_US
from host.core.messages import Telemetry
from host.link import protocol
from host.link.session import Session

POLL_S: Final = SLICE_US * 1e-6
"""The bench advances so far at each look: its shortest step, half of what lies between two
telemetry messages."""


class BenchWire:
    """A bench as a Wire: `poll` runs one of its slices."""

    def __init__(self, bench: Bench) -> None:
        self.session = Session()
        self._bench = bench

    @property
    def now(self) -> float:
        """The bench's time."""
        return self._bench.now

    def request(self, message: protocol.Message) -> None:
        """Sends a message to the firmware."""
        self._bench.send(self.session.request(message))

    def poll(self) -> list[Telemetry]:
        """What the firmware sent in the next slice."""
        told: list[Telemetry] = []
        for stamp, data in self._bench.advance(self._bench.now + POLL_S):
            told += self.session.feed(stamp, data)
        return told
