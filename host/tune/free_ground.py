"""The machine driven on free ground, the blade off, for whoever measures it on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from host.core.errors import FaultError
from host.core.messages import State, Telemetry
from host.link import protocol
from host.tune.wire import Wire, armed_wire, why

KEEPALIVE_S: Final = 0.05
"""Between commands: the host's usual period; the firmware's link watchdog takes 250 ms."""
SILENT_S: Final = 1.0
"""Without telemetry, s: fifty messages that did not come."""
STOPS_S: Final = 2.0
"""For a machine to stop in, and to stand a moment."""
STEERS_S: Final = 1.5
"""For the steering to reach its angle before the machine moves."""


class Driver:
    """Drives an armed machine. `trace` has all telemetry, oldest first."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.trace: list[Telemetry] = []

    @property
    def last(self) -> Telemetry:
        """The latest telemetry."""
        told = self._wire.session.telemetry
        assert told is not None, "an armed machine has spoken"
        return told

    def drive(
        self,
        speed_mps: float,
        steer_rad: float,
        seconds: float,
        until: Callable[[Telemetry], bool] = lambda _: False,
    ) -> list[Telemetry]:
        """Drives for a time, or to the first telemetry that `until` likes. Returns what came
        meanwhile. Raises FaultError where the firmware stops the machine, or says nothing."""
        wire = self._wire
        end = wire.now + seconds
        due = wire.now
        seen: list[Telemetry] = []
        while wire.now < end - 1e-9:
            if wire.now >= due - 1e-9:
                due += KEEPALIVE_S
                wire.request(protocol.Drive(steer_rad, speed_mps, 0))
            for telemetry in wire.poll():
                if telemetry.state not in (State.ARMED, State.RUNNING):
                    raise FaultError(f"the machine stopped: {why(telemetry)}")
                seen.append(telemetry)
                if until(telemetry):
                    end = wire.now
            if wire.now - self.last.stamp > SILENT_S:
                raise FaultError(
                    f"no telemetry for {SILENT_S:g} s: the board hangs or the cable is broken"
                )
        self.trace += seen
        return seen

    def steer(self, angle_rad: float) -> None:
        """Turns the wheel while the machine stands."""
        self.drive(0.0, angle_rad, STEERS_S)

    def stop(self, steer_rad: float = 0.0) -> list[Telemetry]:
        """Until it stands. Returns what came meanwhile."""
        return self.drive(0.0, steer_rad, STOPS_S)


@contextmanager
def driver(wire: Wire, name: str) -> Iterator[Driver]:
    """An armed machine to drive, stopped whatever happens; UserError where it does not arm."""
    with armed_wire(wire, name):
        yield Driver(wire)
