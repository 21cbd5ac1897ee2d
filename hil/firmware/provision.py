"""A microcontroller as it comes from the workshop: its parameters stored in EEPROM."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Final, Literal

from hil.firmware import targets
from hil.firmware.targets import Board, Target
from host.core.errors import UserError
from host.link import protocol
from host.link.session import Session

Firmware = Literal["desk", "avr", "mega2560"]
"""The build for this machine, an Uno's binary in simavr, a Mega's."""
BOARD: Final[dict[Firmware, Board]] = {"desk": "uno", "avr": "uno", "mega2560": "mega2560"}
"""Whose pins it drives."""
FITTED: Final = {
    "steer_driver": 2.0,
    "steer_current_cont": 10.0,
    "drive_driver": 2.0,
    "drive_current_cont": 25.0,
}
"""What the owner of the default machine has told the firmware of its drivers: a BTS7960 steers, and
another drives, cooled so that it stands the 21 A which a slope of five degrees takes."""
SAVE_S: Final = 3.0
"""Longer than the EEPROM takes for all parameters."""
FAULT_LOG_BYTES: Final = 192
"""At the end of the memory. The workshop empties the log: there the board has no sensors."""
STEP_US: Final = 10_000
"""Between looks at the answers, while parameters are set."""
TIMER_2_HZ: Final = tuple(float(round(16e6 / 510 / n)) for n in (256, 128, 64, 32, 8))
"""All that the drive bridge's timer can within the parameter's range (ATmega328P's data sheet,
17.7.4: phase correct, with the prescalers of table 17-9)."""


def raw_values(parameters: Mapping[str, float]) -> dict[int, int]:
    """Parameter ids and raw values. Raises ValueError for a name or value that does not exist."""
    out = {}
    for name, value in parameters.items():
        spec = protocol.PARAMS.get(name)
        if spec is None:
            raise ValueError(f"the firmware has no parameter {name!r}; `daranti params list` has")
        out[spec.id] = spec.to_raw(value)
    return out


def pwm_hz(parameters: Mapping[str, float]) -> tuple[float, float]:
    """What the timers of the steering and the drive bridge run at, with these parameters."""

    def asked(name: str) -> float:
        spec = protocol.PARAMS[name]
        return parameters.get(name, spec.from_raw(spec.default_raw))

    slower = [hz for hz in TIMER_2_HZ if hz <= asked("drive_pwm_freq")]
    return asked("steer_pwm_freq"), max(slower, default=TIMER_2_HZ[0])


def target(firmware: Firmware, parameters: Mapping[str, float] | None = None) -> Target:
    """A fresh microcontroller that boots with these parameters, in their units; erased where none
    are given. Raises UserError where the firmware does not store them."""
    stored = eeprom(tuple(sorted(parameters.items()))) if parameters else None
    return targets.desk(stored) if firmware == "desk" else targets.avr(stored, BOARD[firmware])


def check_built(*builds: Firmware) -> None:
    """UserError where `target` could not start one of them: better before the work. The desk's
    stores the parameters for all."""
    targets.check_built(targets.DESK_LIBRARY)
    for build in builds:
        if build != "desk":
            targets.check_built(targets.AVR_LIBRARY, targets.image_of(BOARD[build]))


def fitted(firmware: Firmware) -> Target:
    """The firmware of the default machine as its owner has set it up."""
    return target(firmware, FITTED)


@cache
def eeprom(parameters: tuple[tuple[str, float], ...]) -> bytes:
    """The memory that the desk's firmware leaves when it has been given these parameters."""
    raw = raw_values(dict(parameters))
    session = Session()
    with targets.desk() as workshop:
        data = b"".join(session.request(protocol.ParamSet(k, v)) for k, v in raw.items())
        workshop.write(data + session.request(protocol.ParamSave()))
        saved = False
        while not saved and workshop.time_us < SAVE_S * 1e6:
            workshop.run_until(workshop.time_us + STEP_US)
            session.feed(workshop.time_us / 1e6, workshop.read())
            if session.refusal:
                raise UserError(f"the firmware did not take {dict(parameters)}: {session.refusal}")
            saved = any(
                isinstance(a, protocol.Ack) and a.request_id == protocol.ParamSave.ID
                for a in session.answers
            )
        if not saved:
            raise UserError(f"the firmware did not store {dict(parameters)}")
        memory = workshop.eeprom()
    return memory[:-FAULT_LOG_BYTES] + b"\xff" * FAULT_LOG_BYTES
