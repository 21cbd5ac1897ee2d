"""What the wires do is the scenario's, whatever the firmware believes of them."""

from __future__ import annotations

from typing import Any

import pytest

from hil.firmware import coupling, provision, targets, wiring
from hil.firmware.targets import Target
from hil.firmware.wiring import Wiring
from host.link import protocol
from host.link.protocol import Result
from sim_plant import machine
from sim_plant.machine import MachineSpec

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


class Stand:
    """Firmware and machine, without field or host."""

    def __init__(self, target: Target, fitted: Wiring) -> None:
        spec = MachineSpec()
        self.target = target
        self.state = machine.initial(spec)
        self.given = machine.inputs()
        self.layout = wiring.layout(fitted)
        self._run = coupling.bind(
            target, self.state, machine.parameters(spec), self.given, layout=self.layout
        )
        self._parser, self._seq, self._now = protocol.Parser(), 0, 0
        self.results: list[Result] = []
        self.worst = 0.0
        """Of the drive duty."""
        self.cut = False
        self.driven = 0.0
        """Sum of the drive duties of all commands, backwards negative."""

    def send(self, message: protocol.Message) -> None:
        self._seq += 1
        self.target.write(protocol.encode(message, self._seq & 0xFF))

    def run(self, ms: int) -> None:
        for _ in range(ms):
            assert self._run(self._now, self._now + 1000) == 0
            self._now += 1000
            given: Any = self.given[0]
            self.worst = max(self.worst, abs(float(given["drive_duty"])))
            self.cut |= bool(given["blade_on"])
            for _, message in self._parser.feed(self.target.read()):
                if isinstance(message, protocol.Ack):
                    self.results.append(message.result)

    def drive_and_stand(self, speed: float = 0.4) -> None:
        """Arms, drives for a second, and stands for one."""
        self.run(50)
        self.send(protocol.Arm(protocol.VERSION))
        for k in range(100):
            self.send(protocol.Drive(0.0, speed if k < 50 else 0.0, 0))
            self.run(20)
            self.driven += float(self.given[0]["drive_duty"])


@pytest.mark.parametrize("named", (0.0, 2.0))
def test_a_driver_that_is_not_named_never_gets_power(named: float) -> None:
    told = {"drive_driver": named, "steer_driver": 2.0}
    with provision.target("desk", told) as target:
        stand = Stand(target, Wiring(drive="bts7960"))
        stand.drive_and_stand()
        assert stand.results[0] == (Result.OK if named else Result.NOT_SET_UP)
        assert (0.3 < stand.worst < 0.8) if named else stand.worst == 0.0
        assert stand.given[0]["drive_duty"] == 0


@pytest.mark.parametrize(("drive", "named"), [("vnh5019", 3.0), ("bts7960", 2.0)])
@pytest.mark.parametrize("way", [1, -1])
def test_each_bridge_drives_forward_and_back(drive: Any, named: float, way: int) -> None:
    told = provision.FITTED | {"drive_driver": named}
    with provision.target("desk", told) as target:
        stand = Stand(target, Wiring(drive=drive))
        stand.drive_and_stand(0.2 * way)
        assert way * stand.driven > 1.0


def test_a_driver_that_is_named_wrongly_drives_forward_as_it_should_stand() -> None:
    """Why none is assumed: "stand" of a VNH5019 is full power of a BTS7960. The bench shows it."""
    with provision.target("desk", provision.FITTED | {"drive_driver": 3.0}) as target:
        stand = Stand(target, Wiring(drive="bts7960"))
        stand.drive_and_stand()
        assert stand.worst == 1.0


@pytest.mark.parametrize("torn", ("drive_pwm", "drive_in1", "drive_in2"))
def test_a_wire_that_tears_at_a_braked_stand_is_no_power(torn: str) -> None:
    with provision.fitted("desk") as target:
        stand = Stand(target, Wiring())
        stand.drive_and_stand()
        assert stand.given[0]["drive_brake"]
        stand.layout[torn] = 17  # A3: nobody drives it, so the pull-down holds it
        stand.worst = 0.0
        for _ in range(25):
            stand.send(protocol.Drive(0.0, 0.0, 0))
            stand.run(20)
        assert stand.worst == 0.0


@pytest.mark.parametrize("relay", ("active_high", "active_low"))
@pytest.mark.parametrize("pull_downs", (True, False))
def test_while_the_controller_starts_only_pull_downs_and_the_right_relay_hold_the_blade(
    relay: Any, pull_downs: bool
) -> None:
    if not targets.AVR_LIBRARY.exists() or not targets.AVR_IMAGE.exists():
        pytest.skip("not built: run `make build`")
    loader = "/usr/share/arduino/hardware/arduino/avr/bootloaders/optiboot/optiboot_atmega328.hex"
    image = provision.eeprom(tuple(provision.FITTED.items()))
    with targets.avr(image, "uno", targets.Path(loader)) as target:
        target.reset(targets.ResetCause.EXTERNAL)
        stand = Stand(target, Wiring(relay=relay, pull_downs=pull_downs))
        stand.run(300)
        assert stand.cut is ((relay == "active_low") is pull_downs)
