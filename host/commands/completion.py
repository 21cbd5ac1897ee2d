"""`daranti completion`: what a shell needs to complete command names and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from host.core.terminal import echo


@click.command()
@click.argument("shell", type=click.Choice(["bash", "fish", "zsh"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Prints the completion script of a shell; in ~/.bashrc: eval "$(daranti completion bash)"."""
    root = ctx.find_root()
    name = root.info_name or "daranti"
    kind = get_completion_class(shell)
    assert kind is not None  # the choices are click's own
    variable = f"_{name.replace('-', '_')}_COMPLETE".upper()
    echo(kind(root.command, {}, name, variable).source())
