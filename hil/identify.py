"""`daranti-hil identify`: the experiments of host.identify on a simulated actuator, in lockstep."""

from __future__ import annotations

from collections.abc import Callable

from hil.actuators import Firmware, Plant, Stand, calibration, set_params
from host import identify, protocol
from host.link import Session
from host.types import Telemetry

POLL_S = 0.001


class StandWire:
    """A stand as identify.Wire: `poll` runs a millisecond."""

    def __init__(self, stand: Stand) -> None:
        self.session = Session()
        self._stand = stand

    @property
    def now(self) -> float:
        return self._stand.now

    def request(self, message: protocol.Message) -> None:
        self._stand.write(self.session.request(message))

    def poll(self) -> list[Telemetry]:
        data = self._stand.advance(POLL_S)
        return self.session.feed(self._stand.now, data)


def defaults() -> dict[str, float]:
    """The firmware's parameters as it is delivered."""
    return {name: spec.from_raw(spec.default_raw) for name, spec in protocol.PARAMS.items()}


def identify_plant(
    plant: Plant, firmware: Firmware = "desk", say: Callable[[str], None] = lambda _: None
) -> tuple[identify.Findings, identify.ActuatorModel, float]:
    """Experiments and fit on one plant. Also returns the largest angle that the wheel had, deg."""
    import numpy as np  # noqa: PLC0415

    spec = plant.machine()
    with Stand(spec, seed=plant.seed, log_s=120.0, firmware=firmware) as stand:
        wire = StandWire(stand)
        stand.advance(0.02)
        set_params(stand, wire.session, calibration(spec.steering))
        with identify.armed(wire, "stand", defaults()) as experimenter:
            experimenter.say = say
            findings = experimenter.identify()
        largest = float(np.degrees(np.abs(stand.log()["steer_angle"]).max()))
    return findings, identify.fit(findings), largest
