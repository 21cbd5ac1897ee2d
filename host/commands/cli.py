"""The console script `daranti`. Commands are imported when they are run: the vision libraries take
seconds to load and `daranti params` needs none of them."""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
from collections.abc import Mapping
from typing import NoReturn

import click

from host.core.errors import run
from host.core.terminal import echo


def _version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        echo(f"{ctx.find_root().info_name} {importlib.metadata.version('daranti')}")
        ctx.exit()


class LazyGroup(click.Group):
    """A group whose commands are named by `module:attribute` and imported on first use."""

    def __init__(self, name: str, lazy: Mapping[str, tuple[str, str]], help: str) -> None:
        """`lazy` maps a command's name to (`module:attribute`, one line of help)."""
        super().__init__(name=name, help=help)
        self._lazy = lazy
        self.params.append(
            click.Option(
                ["--version"],
                is_flag=True,
                is_eager=True,
                expose_value=False,
                callback=_version,
                help="Print the version and exit.",
            )
        )

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted([*super().list_commands(ctx), *self._lazy])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._lazy:
            return super().get_command(ctx, cmd_name)
        module, attribute = self._lazy[cmd_name][0].split(":")
        command = getattr(importlib.import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click's; a name that does not exist is answered with its likes."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = difflib.get_close_matches(args[0], self.list_commands(ctx))
            if not near:
                raise
            raise click.UsageError(
                f"No such command {args[0]!r}. Did you mean {' or '.join(near)}?", ctx
            ) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        rows = [(name, text) for name, (_, text) in self._lazy.items()]
        rows += [(name, command.get_short_help_str()) for name, command in self.commands.items()]
        with formatter.section("Commands"):
            formatter.write_dl(sorted(rows))


daranti = LazyGroup(
    "daranti",
    {
        "drive": ("host.commands.drive:drive", "Harvest: camera, GNSS and firmware together."),
        "check": ("host.commands.check:check", "Check the machine before a harvest."),
        "panel": ("host.commands.panel:panel", "Serve the operator's page to phone and laptop."),
        "see": ("host.commands.see:see", "Show what the vision finds in photographs."),
        "monitor": (
            "host.commands.monitor:monitor",
            "Show the firmware's telemetry, faults in words.",
        ),
        "identify": (
            "host.commands.identify:identify",
            "Measure the steering actuator, and its potentiometer.",
        ),
        "params": (
            "host.commands.params:params",
            "List, read, change and save the firmware's parameters.",
        ),
        "plan": (
            "host.commands.plan:plan",
            "Preview the harvest of a field before anything moves.",
        ),
        "survey": ("host.commands.survey:survey", "The field's boundary from a walk around it."),
        "convert": ("host.commands.convert:convert", "Write a field's boundary in another format."),
        "clear": (
            "host.commands.clear:clear",
            "Clear the firmware's latched faults, once their cause is gone.",
        ),
        "faultlog": (
            "host.commands.faultlog:faultlog",
            "Show and empty the board's log of faults.",
        ),
        "completion": (
            "host.commands.completion:completion",
            "Print the shell's completion of names and options.",
        ),
        "flash": ("host.commands.flash:flash", "Write the firmware onto the board."),
    },
    "The reaper's laptop: drive, look, tune, calibrate.",
)
daranti.add_command(
    LazyGroup(
        "tune",
        {
            "confidence": (
                "host.commands.tune_confidence:tune_confidence",
                "Learn from labelled photographs how far edges can be trusted.",
            ),
            "pid": (
                "host.commands.tune_pid:pid",
                "The steering loop, from the identified actuator.",
            ),
            "follow": (
                "host.commands.tune_follow:follow",
                "Margins of the loop that follows the edge.",
            ),
            "vision": (
                "host.commands.tune_vision:tune_vision",
                "Colour thresholds, from photographs.",
            ),
        },
        "Adjust on the machine.",
    )
)
daranti.add_command(
    LazyGroup(
        "calibrate",
        {
            "camera": (
                "host.commands.calibrate_camera:calibrate_camera",
                "Lens and mount from pictures.",
            ),
            "drive": (
                "host.commands.calibrate_drive:calibrate_drive",
                "Speed over duty, wheel sensor and straight ahead, beside a tape.",
            ),
            "delay": (
                "host.commands.calibrate_delay:calibrate_delay",
                "How late the camera's pictures come, from a drive in curves.",
            ),
        },
        "Measure what the machine file needs.",
    )
)
daranti.add_command(
    LazyGroup(
        "bench",
        {
            "vision": (
                "host.commands.bench_vision:bench_vision",
                "Score the detectors on labelled photographs.",
            )
        },
        "Measure how good and how fast.",
    )
)


def main() -> NoReturn:
    """Entry point of the console script."""
    run(daranti, "daranti")
