"""How the bench's machine is wired: which driver stands behind which pins, and what a pin that
nobody drives does. The world's half: the firmware is told about its drivers by parameters of its
own, and nothing here is taken from it.

Pins are the boards' own numbers, from docs/build (the wiring drawing).
"""

from __future__ import annotations

import enum
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np

from hil.firmware.targets import Board
from host.core.strict import Strict

Driver = Literal["l298n", "bts7960", "vnh5019"]

TWO_PWM: Final[tuple[Driver, ...]] = ("l298n", "bts7960")
"""A duty wire for either direction, the enables wired high."""

ESTOP_CLOSED_MV: Final = 880.0
"""The loop: 2.2 kOhm to 5 V on the board, 470 Ohm to ground behind the button's contact."""
ESTOP_OPEN_MV: Final = 5000.0
"""Pulled up to the supply where the loop is open."""


@dataclass(frozen=True)
class Pins:
    """Where a board's wires end."""

    steer_pwm: int
    """PWM of a VNH5019, RPWM of a BTS7960, IN1 of an L298N."""
    steer_lpwm: int
    steer_in1: int
    steer_in2: int
    drive_pwm: int
    drive_lpwm: int
    drive_in1: int
    drive_in2: int
    blade: int
    lamp: int
    hall: int
    hall_b: int
    blade_turn: int
    estop: int
    """The e-stop's loop, a digital number of its analog input."""

    @cached_property
    def outputs(self) -> tuple[int, ...]:
        """Of bridges and blade."""
        return astuple(self)[:9]


_UNO: Final = Pins(9, 10, 7, 8, 3, 11, 4, 5, 6, 13, 12, 19, 2, 18)
PINS: Final[dict[Board, Pins]] = {
    "uno": _UNO,
    "nano": _UNO,
    "mega2560": Pins(11, 12, 22, 23, 9, 10, 24, 25, 26, 13, 30, 31, 32, 58),
}


class Channel(enum.IntEnum):
    """Analog inputs, A0 = 0."""

    POT = 0
    BATTERY = 1
    STEER_SENSE = 2
    DRIVE_SENSE = 3
    ESTOP = 4


class Wiring(Strict):
    """A machine's drivers and loose ends."""

    steering: Driver = "bts7960"
    """The default motor draws 9 A blocked, and 13 A as it reverses: an L298N stands 5."""
    drive: Driver = "bts7960"
    """For the current of two drive motors. It brakes where the machine is to go slower; a VNH5019
    does not: its PWM low opens both low sides."""
    pull_downs: bool = True
    """10 kOhm to ground at every output. Without them an undriven wire is taken for high."""
    relay: Literal["active_high", "active_low"] = "active_high"
    """The level that closes the blade's relay."""


LAYOUT: Final = np.dtype(
    [
        *((name, np.int64) for name in Pins.__dataclass_fields__),
        ("steer_two_pwm", np.int64),  # 1: a duty wire for either direction
        ("drive_two_pwm", np.int64),
        ("loose", np.float64),  # level of a wire that nobody drives
        ("relay_low", np.int64),  # 1: the relay closes at a low level
    ],
    align=True,
)


def layout(wiring: Wiring | None = None, board: Board = "uno") -> np.ndarray[Any, Any]:
    """The (1,) LAYOUT record for the compiled loop."""
    wiring = wiring or Wiring()
    out = np.zeros(1, LAYOUT)
    for name in Pins.__dataclass_fields__:
        out[name] = getattr(PINS[board], name)
    out["steer_two_pwm"] = wiring.steering in TWO_PWM
    out["drive_two_pwm"] = wiring.drive in TWO_PWM
    out["loose"] = 0.0 if wiring.pull_downs else 1.0
    out["relay_low"] = wiring.relay == "active_low"
    return out
