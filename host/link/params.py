"""The firmware's parameters over the link, by name and in their units."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path

from host.core.errors import UserError
from host.core.yaml_file import load_yaml
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


def raw_of(spec: ParamSpec, value: float) -> int:
    """The value as it goes over the wire. UserError where it is out of range, or lies between two
    of a few kinds: what it was rounded to would be another bridge."""
    if spec.scale == 1 and not spec.unit and math.isfinite(value) and not value.is_integer():
        raise UserError(f"{spec.name} must be a whole number, not {value:g}")
    try:
        return spec.to_raw(value)
    except ValueError as error:
        raise UserError(str(error)) from error


def write(link: Link, spec: ParamSpec, value: float) -> float:
    """Sets a parameter in the firmware's RAM and returns what it reads back. UserError where the
    value is out of range or the firmware refuses."""
    link.ask(protocol.ParamSet(spec.id, raw_of(spec, value)))
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


def default_of(name: str) -> float:
    """In the parameter's unit."""
    spec = protocol.PARAMS[name]
    return spec.from_raw(spec.default_raw)


def differs(name: str, held: float, wanted: float) -> bool:
    """Whether two values of a parameter are two on the wire as well."""
    spec = protocol.PARAMS[name]
    return spec.to_raw(held) != spec.to_raw(wanted)


def read_file(path: Path) -> dict[str, float]:
    """Parameters by name in their units, from YAML. UserError where it holds another thing, or a
    value out of its range."""
    data = load_yaml(path, "parameters")
    if not isinstance(data, dict) or not data:
        raise UserError(f"parameters {path}: give lines such as 'steer_kp: 75'")
    for name, value in data.items():
        spec = spec_of(str(name))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UserError(f"parameters {path}: {name}: {value!r} is no number")
        try:
            raw_of(spec, float(value))
        except (UserError, OverflowError) as error:
            raise UserError(f"parameters {path}: {error}") from error
    return {name: float(value) for name, value in data.items()}
