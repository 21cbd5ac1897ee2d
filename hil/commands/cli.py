"""`daranti-hil`: the bench's console script. A command's module is imported when it is run."""

from __future__ import annotations

from typing import NoReturn

from host.commands.cli import LazyGroup
from host.core.errors import run

cli = LazyGroup(
    "daranti-hil",
    {
        "campaign": (
            "hil.studies.campaign:campaign",
            "Run scenarios x seeds, and print the table.",
        ),
        "faults": ("hil.studies.fault_matrix:faults", "Make everything fail that can fail."),
        "harvest": ("hil.bench.harvest:harvest_command", "Harvest a field in lockstep."),
        "plot": ("hil.judge.plots:plot", "Draw a record."),
        "replay": ("hil.bench.replay:command", "Feed a record through today's pilot and firmware."),
        "report": ("hil.report.report:report", "Write report.html of results."),
        "identify": (
            "hil.studies.identification:command",
            "Identify and tune simulated actuators.",
        ),
        "rig": ("hil.bench.rig:rig", "Serve the machine in wall-clock time for `daranti drive`."),
        "sweep": (
            "hil.studies.sweep:sweep",
            "Tune firmware parameters on a population of actuators.",
        ),
        "vision": (
            "hil.studies.vision_drives:vision",
            "Measure the detectors on drives along edges.",
        ),
        "world": (
            "hil.studies.contact_sheets:world",
            "Contact sheets and videos of the simulated world.",
        ),
    },
    "The bench: puts firmware, simulated plant and host together.",
)


def main() -> NoReturn:
    """Entry point."""
    run(cli, "daranti-hil")
