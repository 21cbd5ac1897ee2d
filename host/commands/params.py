"""`daranti params`: list, read, change, save and reset the firmware's parameters."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import yaml
from rich.table import Table

from host.commands.options import port_option
from host.core.errors import UnfinishedError, UserError
from host.core.output_place import check_file
from host.core.terminal import PlainConsole, echo
from host.core.whole_file import save_text
from host.link import protocol
from host.link.params import (
    default_of,
    differs,
    raw_of,
    read,
    read_all,
    read_file,
    save,
    spec_of,
    write,
    write_all,
)
from host.link.protocol import ParamSpec
from host.link.session import connect


def table(rows: Sequence[tuple[ParamSpec, float]]) -> Table:
    """Values beside their units, ranges and defaults; what differs from its default stands out."""
    out = Table(box=None, pad_edge=False)
    for heading in ("parameter", "value", "unit", "range", "default", "meaning", ""):
        out.add_column(heading, justify="right" if heading == "value" else "left")
    for spec, value in rows:
        default = spec.from_raw(spec.default_raw)
        low, high = spec.from_raw(spec.min_raw), spec.from_raw(spec.max_raw)
        out.add_row(
            spec.name,
            f"{value:g}",
            spec.unit,
            f"{low:g} to {high:g}",
            f"{default:g}",
            spec.doc,
            "" if value == default else "changed",
            style="bold" if value != default else "",
        )
    return out


def _show(spec: ParamSpec, value: float) -> None:
    echo(f"{spec.name} = {value:g} {spec.unit}".rstrip())


@click.group()
def params() -> None:
    """List, read, change and save the firmware's parameters.

    Changes live in the firmware's memory until they are saved. They need a machine at rest (SAFE
    or FAULT)."""


@params.command("list")
@port_option
def list_(port: str) -> None:
    """All parameters with units, ranges and meanings."""
    with connect(port) as link:
        rows = [(spec, read(link, spec)) for spec in protocol.PARAMS.values()]
    PlainConsole().print_table(table(rows))


@params.command()
@click.argument("name")
@port_option
def get(name: str, port: str) -> None:
    """One parameter."""
    spec = spec_of(name)
    with connect(port) as link:
        _show(spec, read(link, spec))


@params.command("set", context_settings={"ignore_unknown_options": True})  # negative values
@click.argument("name")
@click.argument("value", type=float)
@click.option("--save", "keep", is_flag=True, help="Store all parameters as well.")
@port_option
def set_(name: str, value: float, keep: bool, port: str) -> None:
    """Changes one parameter, in its unit."""
    spec = spec_of(name)
    raw_of(spec, value)  # what is out of range needs no board to say so
    with connect(port) as link:
        _show(spec, write(link, spec, value))
        if keep:
            save(link)
    echo("saved" if keep else "not saved: lost at the next reset (`daranti params save`)")


@params.command("save")
@port_option
def save_(port: str) -> None:
    """Stores all parameters in the board's EEPROM."""
    with connect(port) as link:
        save(link)
    echo("saved")


@params.command()
@click.option("--save", "keep", is_flag=True, help="Store them as well.")
@click.option("--yes", is_flag=True, help="Without asking.")
@port_option
def defaults(keep: bool, yes: bool, port: str) -> None:
    """Sets all parameters to their defaults, calibration and hall sensor included."""
    with connect(port) as link:
        held = read_all(link)
        lost = [name for name, value in held.items() if value != default_of(name)]
        if lost and not yes:
            echo(f"not at their defaults: {', '.join(f'{n} = {held[n]:g}' for n in lost)}")
            if not sys.stdin.isatty():
                raise UserError(
                    f"{len(lost)} parameters would be lost: `daranti params export FILE` keeps "
                    "them; --yes sets the defaults all the same"
                )
            click.confirm("set them to their defaults?", abort=True)
        link.ask(protocol.ParamDefaults())
        if keep:
            save(link)
    echo("defaults" + (", saved" if keep else ", not saved (`daranti params save`)"))


@params.command()
@click.argument("path", type=click.Path(path_type=Path), metavar="FILE")
@port_option
def export(path: Path, port: str) -> None:
    """Writes all parameters to a file, for `load` and `diff`."""
    if path.exists():
        raise UserError(f"{path} is there already; name a new file")
    check_file(path)
    with connect(port) as link:
        values = read_all(link)
    save_text(path, yaml.safe_dump(values, sort_keys=False))
    echo(f"written: {path}, {len(values)} parameters")


@params.command()
@click.argument("path", type=click.Path(path_type=Path), metavar="FILE")
@click.option("--save", "keep", is_flag=True, help="Store them as well.")
@port_option
def load(path: Path, keep: bool, port: str) -> None:
    """Sets the parameters of a file that `export` wrote; those that it lacks stay."""
    wanted = read_file(path)
    with connect(port) as link:
        held = read_all(link)
        changes = {
            name: value for name, value in wanted.items() if differs(name, held[name], value)
        }
        write_all(link, changes)
        if keep:
            save(link)
    for name, value in changes.items():
        echo(f"{name}: {held[name]:g} -> {value:g}")
    _say_missing(path, held, wanted)
    how = "saved" if keep else "not saved: lost at the next reset (`daranti params save`)"
    echo(f"{len(changes)} of {len(wanted)} changed; {how}")


@params.command()
@click.argument("path", type=click.Path(path_type=Path), metavar="FILE")
@port_option
def diff(path: Path, port: str) -> None:
    """What differs between the firmware and a file; exits with 3 where something does."""
    wanted = read_file(path)
    with connect(port) as link:
        held = read_all(link)
    found = [name for name, value in wanted.items() if differs(name, held[name], value)]
    for name in found:
        echo(f"{name}: {held[name]:g} in the firmware, {wanted[name]:g} in {path}")
    _say_missing(path, held, wanted)
    if found:
        raise UnfinishedError(f"{len(found)} of {len(wanted)} parameters differ")
    echo("the same")


def _say_missing(path: Path, held: Mapping[str, float], wanted: Mapping[str, float]) -> None:
    """A file that was cut off has whole lines, too."""
    missing = [name for name in held if name not in wanted]
    if missing:
        echo(f"not in {path}: {', '.join(missing)}")
