"""`daranti faultlog`: the faults that the board remembers."""

from __future__ import annotations

import sys

import click

from host.commands.options import port_option
from host.core.errors import UserError
from host.core.terminal import echo
from host.link import fault_log, protocol
from host.link.session import connect


@click.group()
def faultlog() -> None:
    """Show and empty the log of faults that the board keeps over a reset.

    It holds the newest 16. Faults that latch together, or within two seconds, are one entry."""


@faultlog.command("list")
@port_option
def list_(port: str) -> None:
    """All entries, newest first: when, in what state, and what it was."""
    with connect(port) as link:
        entries = fault_log.read_all(link)
    for entry in entries:
        echo(f"{entry.number:5}  {fault_log.text_of(entry)}")
        for text in protocol.fault_texts(entry.faults):
            echo(f"       {text}")
    if not entries:
        echo("the log is empty")


@faultlog.command()
@click.option("--yes", is_flag=True, help="Without asking.")
@port_option
def clear(yes: bool, port: str) -> None:
    """Empties the log. The machine must be at rest (SAFE or FAULT); faults that are latched now
    stay latched (`daranti clear`)."""
    with connect(port) as link:
        found = len(fault_log.read_all(link))
        count = "1 entry" if found == 1 else f"{found} entries"
        if found and not yes:
            if not sys.stdin.isatty():
                raise UserError(
                    f"{count} would be lost: `daranti faultlog list` shows the log; --yes "
                    "empties it all the same"
                )
            click.confirm(f"forget {count}?", abort=True)
        fault_log.clear(link)
    echo(f"emptied: {count}")
