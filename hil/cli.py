"""`daranti-hil`: the bench's console script. A command's module is imported when it is run."""

from __future__ import annotations

from typing import NoReturn

from host.cli import LazyGroup
from host.errors import run

cli = LazyGroup(
    "daranti-hil",
    {
        "campaign": ("hil.campaign:campaign", "Run scenarios x seeds, and print the table."),
        "faults": ("hil.fault_matrix:faults", "Make everything fail that can fail."),
        "harvest": ("hil.harvest:harvest_command", "Harvest a field in lockstep."),
        "plot": ("hil.plot:plot", "Draw a record."),
        "replay": ("hil.replay:command", "Feed a record through today's pilot and firmware."),
        "report": ("hil.report:report", "Write report.html of results."),
        "identify": ("hil.identify:command", "Identify and tune simulated actuators."),
        "rig": ("hil.virtual:rig", "Serve the machine in wall-clock time for `daranti drive`."),
        "sweep": ("hil.sweep:sweep", "Tune firmware parameters on a population of actuators."),
        "vision": ("hil.vision_drives:vision", "Measure the detectors on drives along edges."),
        "world": ("hil.world:world", "Contact sheets and videos of the simulated world."),
    },
    "The bench: puts firmware, simulated plant and host together.",
)


def main() -> NoReturn:
    """Entry point."""
    run(cli, "daranti-hil")
