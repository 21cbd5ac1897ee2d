"""The board at rest: who it is, what it complains of, its parameters, its battery."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from host.check.notes import Notes
from host.core.errors import UserError
from host.core.messages import Command, Request, State
from host.link import protocol
from host.runs.preflight import differing

BOARD_S: Final = 8.0
"""A board that resets on opening its port has answered by then: its bootloader waits up to 2 s."""
REST_V: Final = 0.965
"""Share of the nominal voltage (12.6 V of a full lead battery, so 12.2 V): a third of its charge is
left below it, by the usual tables of resting voltage."""
ROOM_LOW_V: Final = 0.7
"""A resting battery is at least so far above the board's own limit, which its load reaches."""
ROOM_HIGH_V: Final = 0.3
"""And so far below the upper limit, which charging reaches."""
POT_COUNTS: Final = 60.0
"""ADC counts from the centre to either calibration point, at least: 12 degrees of a common pot."""


@dataclass(frozen=True, slots=True)
class AtRest:
    """The board's parameters, in their units, and the resting battery's voltage."""

    parameters: dict[str, float]
    battery_v: float


def board(notes: Notes) -> AtRest | None:
    """What was read of the board; None where a line of it is wrong."""
    hands = notes.hands
    there = notes.until(BOARD_S, lambda: hands.version is not None and not hands.board_problem)
    if not there:
        why = hands.board_problem
        if "protocol version" in why:
            notes.note("port", "ok", "port.ok")
            notes.note("firmware", "bad", "firmware.other", why=why)
        else:
            notes.note("port", "bad", "port.silent", why=why)
        return None
    notes.note("port", "ok", "port.ok")
    version, last = hands.version, hands.telemetry
    assert version is not None
    assert last is not None
    number = f"{version.firmware_major}.{version.firmware_minor}"
    if version.build == 2:
        notes.note("firmware", "bad", "firmware.hil", version=number)
        return None
    notes.note("firmware", "ok", "firmware.ok", version=number)
    held: dict[str, float] = {}
    fine = [_faults(notes), _parameters(notes, held), _battery(notes, last.battery_v, held)]
    return AtRest(held, last.battery_v) if all(fine) else None


def _faults(notes: Notes) -> bool:
    hands = notes.hands
    if notes.state is State.FAULT:
        hands.send(Command(Request.CLEAR, reason="check"))
        hands.pump(0.5)
    faults = notes.faults
    if faults == ["ESTOP_OPEN"]:
        return notes.note("faults", "bad", "faults.estop")
    if faults:
        return notes.note("faults", "bad", "faults.there", faults=notes.fault_texts)
    return notes.note("faults", "ok", "faults.ok")


def _parameters(notes: Notes, held: dict[str, float]) -> bool:
    """Fills `held`."""
    try:
        for name, spec in protocol.PARAMS.items():
            answer = notes.hands.ask_board(protocol.ParamGet(spec.id))
            assert isinstance(answer, protocol.ParamValue)
            held[name] = spec.from_raw(answer.value)
    except UserError as error:
        return notes.note("parameters", "bad", "parameters.unread", why=str(error))
    differ = [
        f"{pair.parameter} {value:g} / {wanted:g}"
        for pair, value, wanted in differing(notes.hands.vehicle, held)
    ]
    if differ:
        return notes.note("parameters", "bad", "parameters.differ", pairs=differ)
    notes.note("parameters", "ok", "parameters.ok", count=len(held))
    styles = {"steer": round(held["steer_driver"]), "drive": round(held["drive_driver"])}
    if 0 in styles.values():
        notes.skip("pot")
        return notes.note("bridge", "bad", "bridge.unset", **styles)
    notes.note("bridge", "ok", "bridge.ok", **styles)
    left, centre, right = (held[f"pot_{side}"] for side in ("left", "centre", "right"))
    apart = (left - centre) * (centre - right) > 0
    wide = min(abs(left - centre), abs(centre - right)) > POT_COUNTS
    counts = {"left": round(left), "centre": round(centre), "right": round(right)}
    return notes.judge("pot", apart and wide, "pot.unset", **counts)


def _battery(notes: Notes, volts: float, held: dict[str, float]) -> bool:
    nominal = notes.hands.vehicle.nominal_battery_v
    least = max(REST_V * nominal, held.get("battery_low", 0.0) + ROOM_LOW_V)
    if volts < least:
        return notes.note("battery", "bad", "battery.low", volts=volts, least=least)
    if volts > held.get("battery_high", math.inf) - ROOM_HIGH_V:
        return notes.note("battery", "bad", "battery.high", volts=volts)
    return notes.note("battery", "ok", "battery.ok", volts=volts, least=least)
