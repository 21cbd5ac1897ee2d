"""The list that the machine walks itself before its blade may be armed.

Each line looks at one thing. Lines that move the machine come last, and only where those before
them allow it. The blade is switched once, with its own supply off.
"""

from __future__ import annotations

from host.check import board, camera, files_and_laptop, receiver, rolling, switches
from host.check.gyroscope import gyroscope
from host.check.lines import NAMES, Hands, Line, Target
from host.check.notes import Notes


def walk(hands: Hands, target: Target) -> list[Line]:
    """All lines, in the order of `NAMES`; what was not looked at is skipped."""
    notes = Notes(hands)
    notes.note("vehicle", "ok", "vehicle.ok")
    boundary = files_and_laptop.field(notes, target)
    files_and_laptop.laptop(notes)
    rest = board.board(notes)
    picture = camera.camera(notes)
    receiver.receiver(notes, boundary, target.corner)
    gyroscope(notes)
    if (
        rest is not None
        and switches.estop(notes)
        and switches.steering(notes)
        and switches.stops(notes)
        and rolling.Roll(notes, rest).run(picture)
    ):
        switches.blade(notes)
    notes.skip(*NAMES[NAMES.index("estop") :])
    return notes.lines
