"""`daranti-hil`: the bench's console script. A command's module is imported when it is run."""

from __future__ import annotations

from typing import NoReturn

from host.commands.cli import LazyGroup
from host.core.errors import run

cli = LazyGroup(
    "daranti-hil",
    {
        "beliefs": ("hil.commands.beliefs:beliefs", "Harvest with wrong beliefs, one by one."),
        "campaign": (
            "hil.commands.campaign:campaign",
            "Run scenarios x seeds, and print the table.",
        ),
        "commission": (
            "hil.commands.commission:commission_command",
            "Do what an owner does before the first harvest.",
        ),
        "consistency": (
            "hil.commands.consistency:consistency",
            "Whether the estimator knows how well it knows.",
        ),
        "constants": (
            "hil.commands.constants:constants",
            "Count the tuned constants, and vary each.",
        ),
        "eyes": ("hil.commands.eyes:eyes", "Fit and judge the model eyes."),
        "faults": ("hil.commands.faults:faults", "Make everything fail that can fail."),
        "harvest": ("hil.commands.harvest:harvest_command", "Harvest a field in lockstep."),
        "moments": (
            "hil.commands.moments:command",
            "Make one fault at many moments of a harvest.",
        ),
        "outlines": (
            "hil.commands.outlines:outlines",
            "Plan outlines as farm programs export them.",
        ),
        "plot": ("hil.commands.plot:plot", "Draw a record."),
        "replay": (
            "hil.commands.replay:command",
            "Feed a record through today's pilot and firmware.",
        ),
        "report": ("hil.commands.report:report", "Write report.html of results."),
        "identify": (
            "hil.commands.identify:command",
            "Identify and tune simulated actuators.",
        ),
        "rig": (
            "hil.commands.rig:rig",
            "Serve the machine in wall-clock time for `daranti drive`.",
        ),
        "sweep": (
            "hil.commands.sweep:sweep",
            "Tune firmware parameters on a population of actuators.",
        ),
        "vision": (
            "hil.commands.vision:vision",
            "Measure the detectors on drives along edges.",
        ),
        "world": (
            "hil.commands.world:world",
            "Contact sheets and videos of the simulated world.",
        ),
    },
    "The bench: puts firmware, simulated plant and host together.",
)


def main() -> NoReturn:
    """Entry point."""
    run(cli, "daranti-hil")
