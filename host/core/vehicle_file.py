"""Reads and writes the vehicle file (YAML)."""

from __future__ import annotations

from pathlib import Path

import yaml
from pydantic import ValidationError

from host.core.errors import UserError
from host.core.vehicle import Mount, Vehicle
from host.core.whole_file import write_whole
from host.core.yaml_file import load_yaml


def load_vehicle(path: Path | None) -> Vehicle:
    """The vehicle of a file, the default one without. UserError names the file and every wrong
    field."""
    if path is None:
        return Vehicle()
    data = load_yaml(path, "vehicle file")
    if data is None:
        raise UserError(
            f"vehicle file {path} is empty; give fields, such as 'wheelbase_m: 1.0', or no file "
            "for the default machine"
        )
    if not isinstance(data, dict):
        raise UserError(f"vehicle file {path}: give fields, such as 'wheelbase_m: 1.0'")
    try:
        return Vehicle.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(map(str, problem['loc'])) or 'the machine'}: "
            + (
                "no such field"
                if problem["type"] == "extra_forbidden"
                else problem["msg"].removeprefix("Value error, ")
            )
            for problem in error.errors()
        )
        raise UserError(f"vehicle file {path}: {problems}") from error


def save_vehicle(path: Path, vehicle: Vehicle) -> None:
    """Writes a file that `load_vehicle` reads back as the same vehicle."""
    text = yaml.safe_dump(vehicle.model_dump(mode="json"), sort_keys=False)
    try:
        write_whole(path, text)
    except OSError as error:
        raise UserError(f"cannot write the vehicle file {path}: {error.strerror}") from error


def mount_of(vehicle: Vehicle, name: str) -> Mount:
    """A mount by its name. UserError names those that there are."""
    if name not in vehicle.mounts:
        there = ", ".join(sorted(vehicle.mounts))
        raise UserError(f"the vehicle has no camera mount {name!r}; it has {there}")
    return vehicle.mounts[name]
