"""What the board switches and turns on the spot: e-stop, steering, its stops, the blade."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.check.notes import Notes
from host.core.messages import Command, Request, State

STEP_DEG: Final = 25.0
"""Half of the common steering range, to either side."""
SLOWEST_DEGPS: Final = 20.0
"""The slowest actuator of the design (docs/build/README.md),"""
SETTLES_S: Final = 0.6
"""and how long a wheel has for coming to rest, and is then watched there."""
OFF_DEG: Final = 3.0
"""How far from the angle asked the wheel may rest: backlash of 2 degrees and the pot's noise."""
OVERSHOOT: Final = 0.35
"""Share of a step; gains that were tuned give less than 0.1, untuned ones swing."""
RESTLESS_DEG: Final = 1.5
"""Standard deviation of a wheel that does not settle; a settled one shows the pot's 0.4."""
STOP_ROOM_DEG: Final = 3.0
"""Kept off the limit, so that no stop is driven into."""
BLADE_S: Final = 1.2
"""Long enough to hear a relay, short enough for a blade whose supply was not off after all."""


def _turn_s(from_deg: float, to_deg: float) -> float:
    """How long any good wheel takes."""
    return abs(to_deg - from_deg) / SLOWEST_DEGPS + SETTLES_S


def estop(notes: Notes) -> bool:
    """Pressed, it opens the loop; released, the board can be cleared."""
    hands = notes.hands

    def open_() -> bool:
        return "ESTOP_OPEN" in notes.faults

    answer = notes.ask("estop_press", "pressed", until=open_)
    if answer is not None:
        notes.until(1.0, open_)
    if not open_():
        return notes.note("estop", "bad", "estop.bridged")
    tried = hands.clock()

    def closed() -> bool:
        nonlocal tried
        if notes.state is State.SAFE:
            return True
        if hands.clock() - tried > 0.4:
            tried = hands.clock()
            hands.send(Command(Request.CLEAR, reason="check"))
        return False

    answer = notes.ask("estop_release", "released", until=closed)
    if answer is not None:
        notes.until(2.0, closed)
    if not closed():
        return notes.note("estop", "bad", "estop.stuck")
    return notes.note("estop", "ok", "estop.ok")


def steering(notes: Notes) -> bool:
    """The wheel goes where it is sent, the right way round, and how well it settles there."""
    if not notes.arm():
        return notes.note("steering", "bad", "steering.not_armed", faults=notes.fault_texts)
    first = notes.drive(_turn_s(0.0, STEP_DEG), steer_deg=STEP_DEG)
    across_s = _turn_s(-STEP_DEG, STEP_DEG)
    second = notes.drive(across_s, steer_deg=-STEP_DEG) if notes.faults == [] else []
    third = notes.drive(across_s, steer_deg=STEP_DEG) if notes.faults == [] else []
    names = notes.faults
    notes.halt()
    findings = {
        "STEER_RUNAWAY": "steering.reversed",
        "POT_FROZEN": "steering.frozen",
        "STEER_STALL": "steering.stalled",
    }
    known = next((findings[name] for name in names if name in findings), None)
    if known is not None:
        return notes.note("steering", "bad", known)
    if names or not third:
        faults = [f"fault.{name}" for name in names]
        return notes.note("steering", "bad", "steering.fault", faults=faults)
    reached = math.degrees(first[-1].angle_rad)
    if abs(reached - STEP_DEG) > OFF_DEG:
        return notes.note("steering", "bad", "steering.short", asked=STEP_DEG, reached=reached)
    answer = notes.ask("steered", "left", "right", "not_at_all")
    if answer == "right":
        return notes.note("steering", "bad", "steering.mirrored")
    if answer != "left":
        return notes.note("steering", "bad", "steering.unseen")
    notes.note("steering", "ok", "steering.ok", asked=STEP_DEG, reached=reached)
    angles = np.degrees([t.angle_rad for t in second])
    swing = float(-STEP_DEG - angles.min()) / (2 * STEP_DEG)
    rest = float(np.std(angles[-15:]))
    good = swing < OVERSHOOT and rest < RESTLESS_DEG
    percent = round(100 * max(0.0, swing))
    notes.judge("gains", good, "gains.swing", percent=percent, restless=rest)
    return True


def stops(notes: Notes) -> bool:
    """The wheel reaches nearly both limits, as far as drawn, and points straight ahead at 0."""
    limit = notes.hands.vehicle.steer_limit_deg - STOP_ROOM_DEG
    # It stands anywhere when the first turn begins.
    across_s = _turn_s(-limit, limit)
    for side, angle in (("left", limit), ("right", -limit)):
        seen = notes.drive(across_s, steer_deg=angle) if notes.arm() else []
        names = notes.faults
        if names or not seen:
            notes.halt()
            faults = [f"fault.{name}" for name in names]
            return notes.note(
                "stops", "bad", "stops.blocked", side=f"word.{side}", asked=angle, faults=faults
            )
        reached = math.degrees(seen[-1].angle_rad)
        if abs(reached - angle) > OFF_DEG + 1:
            notes.halt()
            return notes.note(
                "stops", "bad", "stops.short", side=f"word.{side}", asked=angle, reached=reached
            )
        if side == "left":
            notes.halt()
            answer = notes.ask("turned_far", "as_drawn", "less", "more", degrees=round(limit))
            if answer != "as_drawn":
                return notes.note("stops", "bad", "stops.scale", answer=f"answer.{answer}")
    notes.drive(_turn_s(limit, 0.0))
    notes.halt()
    answer = notes.ask("straight", "yes", "points_left", "points_right")
    if answer != "yes":
        return notes.note("stops", "bad", "stops.centre", answer=f"answer.{answer}")
    return notes.note("stops", "ok", "stops.ok", degrees=round(limit))


def blade(notes: Notes) -> None:
    """Its relay clicks, once, with its own supply off."""
    if notes.ask("blade_supply", "supply_off", "cannot") != "supply_off":
        notes.note("blade", "bad", "blade.supply")
        return
    if notes.ask("blade_rest", "lamp_off", "lamp_on") != "lamp_off":
        notes.note("blade", "bad", "blade.inverted")
        return
    if not notes.arm():
        notes.note("blade", "bad", "blade.not_armed")
        return
    notes.drive(0.4)
    notes.drive(BLADE_S, blade=True)
    notes.drive(0.3)
    notes.halt()
    if notes.ask("blade_seen", "clicked", "silent") != "clicked":
        notes.note("blade", "bad", "blade.dead")
        return
    notes.note("blade", "ok", "blade.ok")
