"""What a page may ask of the machine besides STOP: start, clear, jog, check.

Each deed runs in the machine's process until it is done or stopped; meanwhile the operator's wishes
reach it through the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from host.core.errors import UserError
from host.core.messages import Command, Request, State
from host.panel.checking import check
from host.panel.harvesting import Order, harvest, prepare
from host.panel.machine import Machine
from host.panel.snapshot import Json, number
from host.panel.tuning import tune

COUNTDOWN_S: Final = 5.0
"""From the operator's start to the first motion, with a sound a second."""
CLEAR_S: Final = 1.0
"""For the board to answer CLEAR."""
JOG_MPS: Final = 0.15
"""Creeping at full deflection: a walking person keeps up."""
JOG_HOLD_S: Final = 0.5
"""The finger that jogs is asked again so often; else the machine stands."""
JOG_IDLE_S: Final = 20.0
"""Without a touch, after which jogging ends."""
AFTER_STOP_S: Final = 1.0
"""After STOP, before jogging moves anything again."""
STEP_S: Final = 0.05
"""Between commands: the pilot's period."""


def start(machine: Machine, wish: Json) -> None:
    """Harvests, after a look at place and direction, and a countdown that STOP or an absent driver
    ends."""
    try:
        order = Order.model_validate(wish.get("order", {}))
    except ValueError as error:
        machine.post({"kind": "failed", "what": "start", "why": str(error)})
        return

    def more() -> Json:
        return {"countdown_s": number(until - machine.clock(), 1)}

    with machine.doing("prepare", dict):
        _ready(machine)
        errand = prepare(machine, order)
        until = machine.clock() + COUNTDOWN_S
        machine.mode, machine.more = "countdown", more
        while machine.clock() < until:
            machine.pump(STEP_S)
            if machine.deserted:
                raise UserError("the page that started it is gone: not started")
        harvest(machine, order, errand)


def _ready(machine: Machine) -> None:
    """UserError where the machine is in no state to move."""
    if not machine.board_ready:
        raise UserError("the board does not answer")
    last = machine.telemetry
    if last is not None and last.state is State.FAULT:
        raise UserError("the board holds a fault: look at it and clear it first")


def clear(machine: Machine, _wish: Json) -> None:
    """Clears the board's latched faults; those whose cause is still there stay."""
    machine.send(Command(Request.CLEAR, reason="the operator"))
    machine.pump(CLEAR_S / 4)


def jog(machine: Machine, wish: Json) -> None:
    """Moves at a creep with the blade off, as long as a finger asks for it. What a finger that was
    still down at a STOP asks for begins nothing."""
    asked = jog_asked(wish)
    if not asked["speed"] or machine.stopped_s < AFTER_STOP_S:
        return
    begun = machine.clock()
    last = begun

    def more() -> Json:
        return {"jog": asked}

    with machine.doing("jog", more):
        _ready(machine)
        while machine.clock() - last < JOG_IDLE_S:
            for telemetry in machine.pump(STEP_S):
                if telemetry.state is State.FAULT:
                    return
            now = machine.clock()
            while machine.wishes:
                wish = machine.wishes.popleft()
                if wish.get("do") == "jog_end":
                    return
                if wish.get("do") == "jog":
                    asked = jog_asked(wish)
                    last = now
            held = now - last < JOG_HOLD_S
            state = machine.telemetry.state if machine.telemetry is not None else None
            if state is State.SAFE:
                # The board arms only where the last speed asked for was none.
                machine.send(Command(Request.DRIVE, reason="jog"))
                machine.send(Command(Request.ARM, reason="jog"))
            else:
                speed = asked["speed"] * JOG_MPS if held else 0.0
                steer = asked["steer_deg"] * 0.017453293
                machine.send(Command(Request.DRIVE, steer, speed, False, "jog"))


def jog_asked(wish: Json) -> Json:
    """Speed as -1, 0 or 1 and a steering angle within half of the machine's range."""
    speed, steer = wish.get("speed", 0), wish.get("steer_deg", 0)
    if not isinstance(speed, int | float) or not isinstance(steer, int | float):
        return {"speed": 0.0, "steer_deg": 0.0}
    return {
        "speed": float((speed > 0) - (speed < 0)),
        "steer_deg": float(max(-25.0, min(25.0, steer))),
    }


DEEDS: Final[dict[str, Callable[[Machine, Json], None]]] = {
    "start": start,
    "clear": clear,
    "jog": jog,
    "check": check,
    "pid": tune,
}
