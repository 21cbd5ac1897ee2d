"""Scenarios: one typed, validated file says everything a run depends on.

Named ones lie in hil/scenario/files/*.yaml. An error names the file, the line, the field and what
was expected. The host's vehicle file is part of it; the plant's truth follows from that file
where the scenario does not say otherwise.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import shapely
import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from hil.firmware.provision import Firmware, raw_values
from hil.scenario.faults import Fault
from host.core.errors import UserError
from host.core.vehicle import Mount, Vehicle
from host.field.areas import GAP_MARGIN_M, outline_of, placed
from host.route.plan import Plan, spiral
from sim_plant.camera import CameraSpec
from sim_plant.field import FieldSpec
from sim_plant.gnss import GnssSpec
from sim_plant.machine import DriveSpec, MachineSpec
from sim_plant.sky import WeatherSpec

NEARER_M = 1.0
NEARER_STEP_M = 0.01
"""How an operator moves the machine up where there is no room behind it."""
FOLDER = Path(__file__).parent / "files"


class Limits(BaseModel):
    """When a run is broken off."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    time_s: Annotated[float, Field(gt=0)] = 3600.0
    """Simulated time."""


class Recording(BaseModel):
    """What goes into the record besides messages."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pictures_every: Annotated[int, Field(ge=0)] = 10
    """Every n-th picture; 1 keeps all (a replay through vision needs that), 0 none."""
    film: bool = True
    """Write camera.mp4, annotated."""
    live_port: Annotated[int, Field(ge=0, lt=65536)] | None = None
    """Serve a live view for Foxglove there; 0 takes any free port."""


class Start(BaseModel):
    """Where the operator puts the machine: at a corner, the blade's right end on the outer edge."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    corner: Annotated[int, Field(ge=0)] = 1
    """Index into the boundary (counter-clockwise from the lower left); the first side runs on
    from it."""
    before_m: Annotated[float, Field(ge=0)] = 0.0
    """The blade's line before the crop, at most."""
    lateral_error_m: float = 0.0
    heading_error_deg: float = 0.0


class Scenario(BaseModel):
    """Everything that a run depends on, the seed included."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = "default"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    firmware: Firmware = "desk"
    camera: str = "mast"
    """One of the vehicle's mounts."""
    mode: Literal["paper", "robust"] = "robust"
    """Which detector steers."""
    eyes: Literal["picture", "model"] = "picture"
    """Whether it sees simulated pictures, or what it would say of them is drawn
    (hil/bench/model_eyes.py)."""
    parameters: dict[str, float] = {}
    """The firmware's, by name and in their units, where they are not the defaults."""
    vehicle: Vehicle = Vehicle()
    machine: MachineSpec | None = None
    """The plant's truth; None: as the vehicle file says."""
    lens: CameraSpec | None = None
    """The camera's truth; None: the mount, with the plant's default lens and sensor."""
    field: FieldSpec = FieldSpec()
    weather: WeatherSpec = WeatherSpec()
    gnss: GnssSpec = GnssSpec()
    turn: Literal["three_point", "arc"] = "three_point"
    start: Start = Start()
    faults: tuple[Fault, ...] = ()
    limits: Limits = Limits()
    record: Recording = Recording()

    @model_validator(mode="after")
    def _camera_is_mounted(self) -> Scenario:
        if self.camera not in self.vehicle.mounts:
            known = ", ".join(sorted(self.vehicle.mounts))
            raise ValueError(f"no camera mount is named {self.camera!r}; the vehicle has {known}")
        return self

    @field_validator("parameters")
    @classmethod
    def _known(cls, parameters: dict[str, float]) -> dict[str, float]:
        raw_values(parameters)
        return parameters

    @property
    def mount(self) -> Mount:
        """The camera mount as the host knows it, its lens calibrated."""
        mount = self.vehicle.mounts[self.camera]
        lens = self.lens_truth
        return mount.model_copy(update={"distortion": (lens.k1, lens.k2, 0.0, 0.0, 0.0)})

    @property
    def lens_truth(self) -> CameraSpec:
        """The simulated camera."""
        if self.lens is not None:
            return self.lens
        names = ("x_m", "y_m", "z_m", "pitch_deg", "yaw_deg", "roll_deg", "width_px", "height_px")
        mount = self.vehicle.mounts[self.camera]
        values = {name: getattr(mount, name) for name in (*names, "hfov_deg")}
        return CameraSpec(**values)

    @property
    def machine_truth(self) -> MachineSpec:
        """The simulated machine."""
        if self.machine is not None:
            return self.machine
        v = self.vehicle
        return MachineSpec(
            wheelbase_m=v.wheelbase_m,
            blade_width_m=v.blade_width_m,
            blade_ahead_m=v.blade_ahead_m,
            blade_height_m=v.blade_height_m,
            half_width_m=v.half_width_m,
            rear_overhang_m=v.rear_overhang_m,
            drive=DriveSpec(hall_pulses_per_m=v.hall_pulses_per_m),
        )

    @property
    def firmware_parameters(self) -> dict[str, float]:
        """What the workshop stores in the microcontroller: what the vehicle file says, then
        `parameters`."""
        return {"hall_per_metre": self.vehicle.hall_pulses_per_m} | self.parameters

    def corners(self) -> list[tuple[float, float]]:
        """The boundary as surveyed, counter-clockwise; a rectangle's from its lower left."""
        if self.field.polygon is None:
            width, height = self.field.size_m
            return [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
        return [(x, y) for x, y in list(self.field.boundary.exterior.coords)[:-1]]

    def plan(self) -> Plan:
        """What the host is told of the field: the spiral of its boundary."""
        v = self.vehicle
        holes = [list(ring) for ring in self.field.keep_outs]
        return spiral(self.corners(), self.start.corner, v, self.turn, self.field.gap_m, holes)

    def start_pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle: on the lane beside the plan's first side, the blade before
        it, but nearer than `start.before_m` where the machine would stand outside the permitted
        area."""
        side = self.plan().sides[0]
        yaw = side.heading_rad
        v, start = self.vehicle, self.start
        inside = v.inset_m - side.shift_m + start.lateral_error_m
        room = max(0.0, self.field.gap_m - GAP_MARGIN_M)
        permitted = self.field.boundary.buffer(room, join_style="mitre")
        outline = outline_of(v)
        heading = yaw + math.radians(start.heading_error_deg)

        def pose(nearer_m: float) -> tuple[float, float, float]:
            back = v.blade_x_m + start.before_m - nearer_m
            x = side.x_m - back * math.cos(yaw) - inside * math.sin(yaw)
            y = side.y_m - back * math.sin(yaw) + inside * math.cos(yaw)
            return x, y, heading

        tries = (pose(k * NEARER_STEP_M) for k in range(1 + round(NEARER_M / NEARER_STEP_M)))
        fits = (at for at in tries if permitted.contains(shapely.Polygon(placed(outline, *at))))
        return next(fits, pose(0.0))


def named() -> list[str]:
    """Names of the scenarios in the folder."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def _lines(node: yaml.Node | None, path: tuple[str | int, ...] = ()) -> dict[tuple[Any, ...], int]:
    """Line (from 1) of every key path in a YAML document."""
    out: dict[tuple[Any, ...], int] = {}
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*path, key.value)
            out[here] = key.start_mark.line + 1
            out |= _lines(value, here)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            here = (*path, index)
            out[here] = value.start_mark.line + 1
            out |= _lines(value, here)
    return out


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """`base` with the fields of `over`, nested mappings field by field."""
    out = dict(base)
    for key, value in over.items():
        old = out.get(key)
        both = isinstance(old, dict) and isinstance(value, dict)
        out[key] = merge(old, value) if both else value  # type: ignore[arg-type]
    return out


def assigned(setting: str) -> dict[str, Any]:
    """The overrides of `field.name=value`, the value as in YAML. Raises UserError."""
    path, equals, value = setting.partition("=")
    if not equals or not path or not value:
        raise UserError(f"{setting!r}: say FIELD=VALUE, such as weather.hour=9.5")
    try:
        nested: Any = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise UserError(f"{setting!r}: {value!r} is not YAML") from error
    for name in reversed(path.split(".")):
        nested = {name: nested}
    return dict(nested)


def changed(base: Scenario, overrides: dict[str, Any]) -> Scenario:
    """A scenario with other values in some fields (nested like the file). UserError naming them."""
    try:
        return Scenario.model_validate(merge(base.model_dump(mode="json"), overrides))
    except ValidationError as error:
        raise UserError(_explain(Path(base.name), {}, error)) from error


def load(name_or_file: str, overrides: dict[str, Any] | None = None) -> Scenario:
    """A scenario by name or path, with the command line's overrides (nested like the file).

    Raises UserError naming file, line and field."""
    path = Path(name_or_file)
    if not path.suffix and not path.exists():
        path = FOLDER / f"{name_or_file}.yaml"
        if not path.exists():
            raise UserError(
                f"no scenario is named {name_or_file!r}; there are {', '.join(named())} "
                "(or give a YAML file's path)"
            )
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"cannot read the scenario {path}: {error}") from error
    try:
        data = yaml.safe_load(text) or {}
        lines = _lines(yaml.compose(text, Loader=yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "not readable"
        raise UserError(f"{path}{where}: not YAML: {problem}") from error
    if not isinstance(data, dict):
        raise UserError(f"{path}: a scenario is a mapping of fields, such as 'seed: 1'")
    data.setdefault("name", path.stem)
    try:
        return Scenario.model_validate(merge(data, overrides or {}))
    except ValidationError as error:
        raise UserError(_explain(path, lines, error)) from error


def _explain(path: Path, lines: dict[tuple[Any, ...], int], error: ValidationError) -> str:
    parts = []
    for problem in error.errors():
        loc = problem["loc"]
        line = next((lines[loc[:n]] for n in range(len(loc), 0, -1) if loc[:n] in lines), None)
        where = f"{path}, line {line}" if line else f"{path}, or the command line"
        field = ".".join(str(part) for part in loc)
        what = problem["msg"].removeprefix("Value error, ")
        if problem["type"] == "extra_forbidden":
            what = "no such field"
        got = problem["input"]
        shown = f" (got {got!r})" if isinstance(got, str | int | float | bool | None) else ""
        parts.append(f"{where}: {field + ': ' if field else ''}{what}{shown}")
    return "; ".join(parts)
