"""What the pilot is doing, as the operator and the record name it, and how it came to that."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Phase(enum.Enum):
    """What is being done; several behaviours may be one phase to the operator."""

    CONNECT = "connect"
    ALIGN = "align"
    FOLLOW = "follow"
    TURN = "turn"
    SEARCH = "search"
    HESITATE = "hesitate"
    FINISHED = "finished"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Transition:
    """One change of behaviour, for the record and the operator."""

    stamp: float
    phase: Phase
    reason: str
    code: str = ""
    """The reason's, without what it speaks of: "follow.EDGE_LOST"."""


class Doing(enum.Enum):
    """The behaviours by name; the classes are those of host.pilot.behaviours."""

    CONNECT = "connect"
    ALIGN = "align"
    FOLLOW = "follow"
    WAIT_FOR_CAMERA = "wait for the camera"
    LOOK_AT_EDGE = "look at the edge"
    LOOK_AT_END = "look at the end"
    BACK_OFF = "back off"
    LOOK_BEYOND = "look beyond"
    LAY_OUT = "lay out"
    GATHER = "gather"
    RETRACE = "retrace"
    REGAIN = "regain"
    TURN = "turn"
    SEARCH = "search"
    FINISH = "finish"
    FAULT = "fault"


class Reason(enum.Enum):
    """Why one behaviour gives way to another. A member's value is (the next behaviour, the text for
    the operator, in which {names} stand for what it speaks of)."""

    def __init__(self, to: Doing, text: str) -> None:
        self.to = to
        self.text = text

    def go(self, **words: str) -> Go:
        """The transition, its words filled in."""
        return Go(self, self.text.format(**words))


@dataclass(frozen=True, slots=True)
class Go:
    """A behaviour's wish for a transition."""

    reason: Reason
    text: str
