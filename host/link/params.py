"""The firmware's parameters over the link, by name and in their units."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from host.core.errors import UserError
from host.link import protocol
from host.link.protocol import ParamSpec
from host.link.session import Link


def spec_of(name: str) -> ParamSpec:
    """A parameter by name; UserError names its likes."""
    if name not in protocol.PARAMS:
        near = difflib.get_close_matches(name, protocol.PARAMS)
        hint = f"did you mean {' or '.join(near)}?" if near else "`daranti params list` shows all"
        raise UserError(f"no parameter is named {name!r}; {hint}")
    return protocol.PARAMS[name]


def read(link: Link, spec: ParamSpec) -> float:
    """The value in the parameter's unit."""
    answer = link.ask(protocol.ParamGet(spec.id))
    assert isinstance(answer, protocol.ParamValue)
    return spec.from_raw(answer.value)


def write(link: Link, spec: ParamSpec, value: float) -> float:
    """Sets a parameter in the firmware's RAM and returns what it reads back. UserError where the
    value is out of range or the firmware refuses."""
    try:
        raw = spec.to_raw(value)
    except ValueError as error:
        raise UserError(str(error)) from error
    link.ask(protocol.ParamSet(spec.id, raw))
    return read(link, spec)


def save(link: Link) -> None:
    """Stores all parameters in EEPROM; the firmware reads them back before it says so."""
    link.ask(protocol.ParamSave(), timeout_s=3.0)


def read_all(link: Link) -> dict[str, float]:
    """All of the firmware's parameters, in their units."""
    return {name: read(link, spec) for name, spec in protocol.PARAMS.items()}


def write_all(link: Link, values: Mapping[str, float]) -> None:
    """Sets parameters and reads each one back. UserError where the firmware holds another value."""
    for name, value in values.items():
        spec = protocol.PARAMS[name]
        held = write(link, spec, value)
        if spec.to_raw(held) != spec.to_raw(value):
            raise UserError(f"{name}: wrote {value:g}, but the firmware holds {held:g}")
