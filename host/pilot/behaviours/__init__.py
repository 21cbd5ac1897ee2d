"""What the machine does, one behaviour a file; the table of them all."""

from __future__ import annotations

from collections.abc import Mapping

from host.pilot.behaviours.align import Align
from host.pilot.behaviours.back_off import BackOff
from host.pilot.behaviours.base import Behaviour
from host.pilot.behaviours.connect import Connect
from host.pilot.behaviours.fault import Fault
from host.pilot.behaviours.finish import Finish
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.gather import Gather
from host.pilot.behaviours.lay_out import LayOut
from host.pilot.behaviours.look_at_edge import LookAtEdge
from host.pilot.behaviours.look_at_end import LookAtEnd
from host.pilot.behaviours.look_beyond import LookBeyond
from host.pilot.behaviours.regain import Regain
from host.pilot.behaviours.retrace import Retrace
from host.pilot.behaviours.search import Search
from host.pilot.behaviours.turn import DriveTurn
from host.pilot.behaviours.wait_for_camera import WaitForCamera
from host.pilot.phase import Doing

BEHAVIOURS: Mapping[Doing, type[Behaviour]] = {
    Doing.CONNECT: Connect,
    Doing.ALIGN: Align,
    Doing.FOLLOW: Follow,
    Doing.LOOK_AT_EDGE: LookAtEdge,
    Doing.LOOK_AT_END: LookAtEnd,
    Doing.BACK_OFF: BackOff,
    Doing.LOOK_BEYOND: LookBeyond,
    Doing.LAY_OUT: LayOut,
    Doing.GATHER: Gather,
    Doing.RETRACE: Retrace,
    Doing.REGAIN: Regain,
    Doing.TURN: DriveTurn,
    Doing.WAIT_FOR_CAMERA: WaitForCamera,
    Doing.SEARCH: Search,
    Doing.FINISH: Finish,
    Doing.FAULT: Fault,
}
