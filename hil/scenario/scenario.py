"""Scenarios: one typed, validated file says everything a run depends on.

A scenario has two halves. The world is what is: `field`, `machine`, `lens`, `weather`, `gnss`,
`start`. The belief is what the host is told of it. Only this package sees both: plant and judge get
`world`, the host gets `told`. Named scenarios lie in hil/scenario/files/*.yaml. An error names the
file and the line, or the command line, the field and what was expected.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from hil.firmware.provision import Firmware
from hil.firmware.wiring import Wiring
from hil.scenario.belief import Belief, Told, corner_like, spelled_out, told
from hil.scenario.faults import Fault
from hil.scenario.world import Start, World
from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.strict import Strict
from host.core.vehicle import Mount, Vehicle
from host.core.yaml_file import OnceLoader
from host.route.plan import Plan
from host.route.side import NO_EDGE
from sim_plant.camera import MOUNTS, CameraSpec
from sim_plant.field_spec import FieldSpec
from sim_plant.gnss import GnssSpec
from sim_plant.gyro import GyroSpec
from sim_plant.machine import MachineSpec
from sim_plant.sky import WeatherSpec

FOLDER = Path(__file__).parent / "files"


class Limits(Strict):
    """When a run is broken off."""

    time_s: Annotated[float, Field(gt=0)] = 3600.0
    """Simulated time."""


class Recording(Strict):
    """What goes into the record besides messages."""

    pictures_every: Annotated[int, Field(ge=0)] = 10
    """Every n-th picture; 1 keeps all (a replay through vision needs that), 0 none."""
    film: bool = True
    """Write camera.mp4, annotated."""
    files: Literal["all", "figures"] = "all"
    """Or but the figures and the pilot's changes of state: a run gives the same again at any time.
    """
    live_port: Annotated[int, Field(ge=0, lt=65536)] | None = None
    """Serve a live view for Foxglove there; 0 takes any free port."""


class Scenario(Strict):
    """Everything that a run depends on, the seed included."""

    name: str = "default"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    firmware: Firmware = "desk"
    camera: str = "mast"
    """Which of the machine's mounts carries the camera."""
    mode: Literal["paper", "robust"] = "robust"
    """Which detector steers."""
    eyes: Literal["picture", "model"] = "picture"
    """Whether it sees simulated pictures, or what it would say of them is drawn
    (hil/bench/model_eyes.py)."""
    machine: MachineSpec = MachineSpec()
    wiring: Wiring = Wiring()
    """The drivers behind the pins, and what holds these while nobody drives them."""
    lens: dict[str, Any] = Field(default_factory=dict)
    """Of CameraSpec, what is not as the mount's drawing has it."""
    field: FieldSpec = FieldSpec()
    weather: WeatherSpec = WeatherSpec()
    gnss: GnssSpec = GnssSpec()
    gyro: GyroSpec = GyroSpec()
    start: Start = Start()
    belief: Belief = Belief()
    turn: Literal["three_point", "arc"] = "three_point"
    faults: tuple[Fault, ...] = ()
    limits: Limits = Limits()
    record: Recording = Recording()

    @model_validator(mode="after")
    def _camera_is_mounted(self) -> Scenario:
        if self.camera not in MOUNTS:
            known = ", ".join(sorted(MOUNTS))
            raise ValueError(f"no camera mount is named {self.camera!r}; the machine has {known}")
        unknown = sorted(set(self.lens) - set(CameraSpec.model_fields))
        if unknown:
            raise ValueError(f"lens.{unknown[0]}: no such field")
        try:
            assert self.world.lens
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            what = "no such field" if first["type"] == "extra_forbidden" else first["msg"]
            raise ValueError(f"lens.{where}: {what}") from error
        return self

    @property
    def world(self) -> World:
        """What is: all that plant and judge may know."""
        drawing = MOUNTS[self.camera].model_dump()
        lens = CameraSpec.model_validate(drawing | self.lens)
        return World(
            self.seed,
            self.field,
            self.machine,
            self.wiring,
            lens,
            self.weather,
            self.gnss,
            self.gyro,
            self.start,
        )

    @property
    def told(self) -> Told:
        """What the host is given: all that it may know. UserError where it cannot be."""
        return told(self.belief, self.world, self.camera)

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle file that the host reads."""
        return self.told.vehicle

    @property
    def mount(self) -> Mount:
        """The camera mount as the host knows it."""
        return self.told.mount

    def plan(self) -> Plan:
        """What the host makes of the field that it is told of."""
        return self.told.plan(self.turn)

    def start_pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle where the operator has put the machine down: truly, at a
        true corner. Which one, whether inside the crop, and how far a lane beside a narrow strip is
        to lie from the usual one, the operator takes from the plan; who was told another corner
        (`belief.corner`) stands at `start.corner` all the same."""
        world, known = self.world, self.told
        plan = known.plan(self.turn)
        first = plan.sides[0]
        corner = world.start.corner
        if self.belief.corner is None:
            x, y, heading = first.x_m, first.y_m, first.heading_rad
            begins = known.side_of(x, y, heading)
            if begins != known.corner:
                corner = corner_like(known.boundary, begins, world.corners)
        in_crop = plan.begins_inside != NO_EDGE
        return world.stood_at(corner, first.shift_m, in_crop=in_crop)


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
        if key == "belief":
            old = spelled_out(old)
        new = spelled_out(value) if key == "belief" else value
        both = isinstance(old, dict) and isinstance(new, dict)
        out[key] = merge(old, new) if both else new  # type: ignore[arg-type]
    return out


def assigned(setting: str) -> dict[str, Any]:
    """The overrides of `field.name=value`, the value as in YAML. Raises UserError."""
    path, equals, value = setting.partition("=")
    if not equals or not path or not value:
        raise UserError(f"{setting!r}: say FIELD=VALUE, such as weather.hour=9.5")
    try:
        nested: Any = yaml.safe_load(value)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f"{setting!r}: {value!r} is not YAML") from error
    for name in reversed(path.split(".")):
        nested = {name: nested}
    return dict(nested)


def changed(base: Scenario, overrides: dict[str, Any]) -> Scenario:
    """A scenario with other values in some fields (nested like the file). UserError naming them."""
    try:
        data = base.model_dump(mode="json")
        return Scenario.model_validate(merge(data, overrides))
    except ValidationError as error:
        raise UserError(_explain(error, lambda _: COMMAND_LINE)) from error


def load(name_or_file: str, overrides: dict[str, Any] | None = None) -> Scenario:
    """A scenario by name or path, with the command line's overrides (nested like the file).

    Raises UserError naming file, line and field."""
    path = Path(name_or_file)
    if not path.suffix and (path.is_dir() or not path.exists()):
        path = FOLDER / f"{name_or_file}.yaml"
        if not path.exists():
            raise UserError(
                f"no scenario is named {name_or_file!r}; there are {', '.join(named())} "
                "(or give a YAML file's path)"
            )
    check_input(path, "the scenario")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"cannot read the scenario {path}: {why}") from error
    try:
        data = yaml.load(text, OnceLoader)
        lines = _lines(yaml.compose(text, Loader=OnceLoader))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "not readable"
        raise UserError(f"{path}{where}: not YAML: {problem}") from error
    if data is None:
        raise UserError(f"{path} is empty; give fields, such as 'seed: 1'")
    if not isinstance(data, dict):
        raise UserError(f"{path}: a scenario is a mapping of fields, such as 'seed: 1'")
    data.setdefault("name", path.stem)
    over = overrides or {}
    try:
        return Scenario.model_validate(merge(data, over))
    except ValidationError as error:
        sound = _is_sound(data)

        def origin(loc: tuple[int | str, ...]) -> str:
            if sound or _is_given(over, loc):
                return COMMAND_LINE
            line = next((lines[loc[:n]] for n in range(len(loc), 0, -1) if loc[:n] in lines), None)
            return f"{path}, line {line}" if line else str(path)

        raise UserError(_explain(error, origin)) from error


COMMAND_LINE: Final = "the command line"
"""Where a wrong field is from that no file has."""


def _is_sound(data: dict[str, Any]) -> bool:
    """Whether a file is a scenario by itself."""
    try:
        Scenario.model_validate(data)
    except ValidationError:
        return False
    return True


def _is_given(overrides: dict[str, Any], loc: tuple[int | str, ...]) -> bool:
    """Whether the field that lies there is one of the overrides."""
    here: Any = overrides
    for name in loc:
        if not isinstance(here, dict) or name not in here:
            break
        here = here[name]
    return here is not overrides and not isinstance(here, dict)


def _explain(error: ValidationError, where: Callable[[tuple[int | str, ...]], str]) -> str:
    """Every wrong field in words; `where` tells where it was written."""
    parts = []
    for problem in error.errors():
        loc = problem["loc"]
        field = ".".join(str(part) for part in loc)
        what = problem["msg"].removeprefix("Value error, ")
        if problem["type"] == "extra_forbidden":
            what = "no such field"
        got = problem["input"]
        if isinstance(got, bool):
            what += "; YAML reads on, off, yes and no as true or false: put a word in quotes"
        shown = f" (got {got!r})" if isinstance(got, str | int | float | bool | None) else ""
        parts.append(f"{where(loc)}: {field + ': ' if field else ''}{what}{shown}")
    return "; ".join(parts)
