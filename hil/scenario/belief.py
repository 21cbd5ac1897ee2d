"""The belief's half of a scenario: all that the host is given, and how it differs from the world.

What is not given outright is what an owner would have found with a tape, a level, a phone and the
calibration commands: the world's value with an error drawn by the scenario's seed, each error from
numbers of its own. docs/use/bench.md lists the sizes.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator, model_validator

from hil.firmware.provision import FITTED, raw_values
from hil.scenario.world import World
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.input_file import check_input
from host.core.strict import Strict
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle
from host.core.yaml_file import load_yaml
from host.field.boundary_file import UNKNOWN_SIGMA_M, load_field
from host.field.corners import MAX_CORNERS
from host.field.survey import survey_track
from host.field.walk import read_fixes, track_of
from host.link import protocol
from host.route.plan import Plan, spiral
from host.route.standing import edge_goes_on
from host.sensors.nmea import Receiver
from host.tune.stall_time import stall_time_ms
from sim_plant.drive_response import drive_response
from sim_plant.field_spec import Point
from sim_plant.gnss import Gnss, GnssSpec
from sim_plant.machine import STEER_PWM_HZ, MachineSpec
from sim_plant.strict import NotNegative

Ring = tuple[Point, ...]
WALK_MPS: Final = 1.3
"""A person's usual pace."""
CORNER_PAUSE_S: Final = 2
"""Seconds that a surveyor stands at each corner,"""
STOPS_RAD: Final = math.radians(30.0)
"""which turns by more: what turns by less is walked along."""
WOBBLE_M: Final = 0.1
"""How far a walker strays from the edge (standard deviation),"""
WOBBLE_LENGTH_M: Final = 5.0
"""and over how much way that changes."""
WALKS: Final = 5
"""How often an owner walks a field whose walk does not close, before giving up."""
LEARNED_LENS: Final = ("k1", "k2")
VEHICLE_FILE, FIELD_FILE, PARAMETER_FILE = "vehicle.yaml", "field.geojson", "parameters.yaml"
"""What commissioning leaves in its folder."""


class Errors(Strict):
    """How wrong the owner's values are: bounds of uniform draws, each to either side."""

    tape_m: NotNegative = 0.01
    """Of every length of the machine."""
    mount_m: NotNegative = 0.03
    mount_deg: NotNegative = 1.5
    """Pitch, yaw and roll of the camera, by a level and by eye."""
    lens: Literal["exact", "calibrated", "uncalibrated", "either"] = "either"
    calibrated_deg: NotNegative = 0.3
    """Of the horizontal field of view, with a lens that `calibrate camera` has measured;"""
    uncalibrated_deg: NotNegative = 3.0
    """and by the phone's data sheet, which knows no distortion."""
    hall: NotNegative = 0.01
    """Share of the pulses a metre."""
    drive: NotNegative = 0.03
    """Share of the speed at full duty,"""
    dead_duty: NotNegative = 0.01
    """and of the full duty that only just moves the machine;"""
    drive_lag: NotNegative = 0.2
    """share of the lag of its speed: what `calibrate drive` leaves of them."""
    pot_deg: NotNegative = 1.0
    """Of the steering pot's middle."""
    delay_s: NotNegative = 0.05
    """Of the picture's delay."""
    gap_m: NotNegative = 0.2
    crop_m: NotNegative = 0.1
    walk_cep_m: tuple[NotNegative, NotNegative] | None = (0.5, 2.5)
    """Of the phone with which the boundary is walked, and"""
    walk_laps: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = (1, 3)
    """in how many laps. None: the boundary is exact."""
    keep_out_m: NotNegative = 0.1
    """Of a keep-out's place, taped from the field's edges."""


EXACT: Final[dict[str, Any]] = {
    **{name: 0.0 for name, f in Errors.model_fields.items() if isinstance(f.default, float)},
    "lens": "exact",
    "walk_cep_m": None,
}
"""Errors of a host that knows the truth."""


MOST_LAPS: Final = 20
"""Of a walk: nobody goes around a field more often, and the survey's time grows with them."""
MOST_CEP_M: Final = 50.0
"""Of a phone: a position that errs by more is none to walk a boundary with."""


class Walk(Strict):
    """The boundary as `daranti survey` makes it from a simulated walk."""

    laps: Annotated[int, Field(ge=1, le=MOST_LAPS)] = 1
    cep_m: Annotated[float, Field(ge=0, le=MOST_CEP_M)] = 2.5
    seed: int | None = None
    """Of the phone's errors; None: by the scenario's."""


class Belief(Strict):
    """What a scenario says of the host's knowledge; what is None is drawn with `errors`."""

    errors: Errors = Errors()
    folder: str | None = None
    """Of `daranti-hil commission`: vehicle, field and parameters come from there."""
    boundary: Ring | Walk | str | None = None
    """Corners in metres of the world's frame, a walk, or a file that `daranti` reads."""
    boundary_sigma_m: NotNegative | None = None
    """How surely corners given in place are known; None: not said, and 0 where errors are exact."""
    keep_outs: tuple[Ring, ...] | None = None
    gap_m: NotNegative | None = None
    corner: Annotated[int, Field(ge=0)] | None = None
    """Of the boundary as believed; None: where the machine stands."""
    vehicle: dict[str, Any] | str = Field(default_factory=dict)
    """Fields of the vehicle file that are given outright, or the file."""
    parameters: dict[str, float] = Field(default_factory=dict)
    """The firmware's, by name and in their units, where the calibration has left others."""

    @model_validator(mode="before")
    @classmethod
    def _spelled_out(cls, data: Any) -> Any:
        return spelled_out(data)

    @field_validator("parameters")
    @classmethod
    def _known(cls, parameters: dict[str, float]) -> dict[str, float]:
        raw_values(parameters)
        return parameters

    @field_validator("vehicle")
    @classmethod
    def _sound(cls, vehicle: dict[str, Any] | str) -> dict[str, Any] | str:
        if isinstance(vehicle, dict):
            try:
                _vehicle(Vehicle(), vehicle)
            except ValidationError as error:
                first = error.errors()[0]
                where = ".".join(map(str, first["loc"]))
                what = "no such field" if first["type"] == "extra_forbidden" else first["msg"]
                raise ValueError(f"{where}: {what}") from error
        return vehicle


def spelled_out(data: Any) -> Any:
    """A belief as a mapping: `exact`, for all of it or for its errors, is short for no errors."""
    if data == "exact":
        data = {"errors": "exact"}
    if isinstance(data, dict) and data.get("errors") == "exact":
        data = {**data, "errors": EXACT}
    return data


@dataclass(frozen=True, slots=True)
class Told:
    """All that the host is given."""

    vehicle: Vehicle
    camera: str
    boundary: Ring
    """Counter-clockwise, metres of the world's frame."""
    boundary_sigma_m: float
    """Standard deviation per axis of a corner against the others."""
    boundary_recorded: bool | None
    """Whether it was recorded point by point; None: nobody has said it."""
    keep_outs: tuple[Ring, ...]
    gap_m: float
    corner: int
    parameters: dict[str, float]
    """In the microcontroller's memory, where they are not the firmware's defaults."""

    @property
    def mount(self) -> Mount:
        """Of the camera that is fitted."""
        return self.vehicle.mounts[self.camera]

    def side_of(self, x_m: float, y_m: float, heading_rad: float) -> int:
        """Which corner the boundary's side leaves that has this direction and passes here."""
        middles, headings = _midpoints(self.boundary)
        c, s = np.cos(headings), np.sin(headings)
        beside = np.abs(c * (y_m - middles[:, 1]) - s * (x_m - middles[:, 0]))
        askew = np.abs(np.remainder(headings - heading_rad + math.pi, math.tau) - math.pi)
        return int(np.argmin(beside + TURNED_M_RAD * askew))

    def plan(self, turn: str) -> Plan:
        """As `daranti plan` lays it out."""
        return _laid_out(
            self.vehicle.model_dump_json(),
            self.boundary,
            self.corner,
            turn,
            self.gap_m,
            self.keep_outs,
            self.boundary_sigma_m,
            self.boundary_recorded,
        )


@lru_cache(maxsize=16)
def _laid_out(
    vehicle_json: str,
    boundary: Ring,
    corner: int,
    turn: str,
    gap_m: float,
    keep_outs: tuple[Ring, ...],
    sigma_m: float,
    recorded: bool | None,
) -> Plan:
    """Once for all who ask: who puts the machine down, the host, the judge. On an irregular field
    it takes half a second."""
    vehicle = Vehicle.model_validate_json(vehicle_json)
    holes = [list(ring) for ring in keep_outs]
    return spiral(
        list(boundary), corner, vehicle, turn, gap_m, holes, sigma_m=sigma_m, recorded=recorded
    )


def told(belief: Belief, world: World, camera: str) -> Told:
    """What the owner of this world's machine and field would give the host. UserError where a file
    cannot be read, or the walk gives no field."""
    folder = Path(belief.folder) if belief.folder is not None else None
    draw = Draw(world.seed)
    if isinstance(belief.vehicle, str):
        vehicle = load_vehicle(Path(belief.vehicle))
    elif folder is not None:
        vehicle = _vehicle(load_vehicle(folder / VEHICLE_FILE), belief.vehicle)
    else:
        vehicle = _vehicle(measured_vehicle(world, camera, belief.errors, draw), belief.vehicle)
    if camera not in vehicle.mounts:
        known = ", ".join(sorted(vehicle.mounts))
        raise UserError(f"no camera mount is named {camera!r}; the vehicle has {known}")
    given = belief.boundary
    if given is None and folder is not None:
        given = str(folder / FIELD_FILE)
    outs, recorded = None, None
    if given is None:
        walk = drawn_walk(belief.errors, draw)
        ring, sigma, recorded = (world.corners, 0.0, None) if walk is None else walked(world, walk)
    elif isinstance(given, Walk):
        ring, sigma, recorded = walked(world, given)
    elif isinstance(given, str):
        ring, outs, sigma, recorded = _read(Path(given), world.gnss)
    else:
        ring = given
        sigma = 0.0 if belief.errors.walk_cep_m is None else UNKNOWN_SIGMA_M
    if belief.boundary_sigma_m is not None:
        sigma = belief.boundary_sigma_m
    gap = belief.gap_m
    if gap is None and folder is not None:
        gap = _gap_of(folder)
    if gap is None:
        gap = max(0.0, world.field.gap_m + draw("gap", belief.errors.gap_m))
    if belief.keep_outs is not None:
        outs = belief.keep_outs
    if outs is None:
        outs = taped_keep_outs(world, ring, belief.errors, draw)
    parameters = calibrated_parameters(world, vehicle, belief.errors, draw)
    if folder is not None:
        parameters = _parameters_of(folder)
    corner = belief.corner
    if corner is None:
        # Who has recorded an edge that goes on there knows where he began to walk, and no more.
        goes_on = recorded and edge_goes_on(shapely.Polygon(ring), ring[0])
        begun = goes_on and world.start.corner == 0
        corner = 0 if begun else corner_like(world.corners, world.start.corner, ring)
    if corner >= len(ring):
        raise UserError(f"belief.corner: the boundary has {len(ring)} corners, numbered from 0")
    parameters |= belief.parameters
    return Told(vehicle, camera, ring, sigma, recorded, outs, gap, corner, parameters)


class Draw:
    """Errors by name: another one more changes none of the rest."""

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def rng(self, name: str) -> np.random.Generator:
        """Of one name."""
        return np.random.default_rng([self._seed, 0xBE11, zlib.crc32(name.encode())])

    def __call__(self, name: str, bound: float) -> float:
        """Uniform within +-bound."""
        return float(self.rng(name).uniform(-1.0, 1.0)) * bound


# ---- the vehicle file ----------------------------------------------------------------------------


def _vehicle(base: Vehicle, over: Mapping[str, Any]) -> Vehicle:
    data = base.model_dump(mode="json")
    mounts = {**data["mounts"]}
    for name, mount in (over.get("mounts") or {}).items():
        mounts[name] = {**mounts.get(name, {}), **mount}
    return Vehicle.model_validate({**data, **over, "mounts": mounts})


def measured_vehicle(world: World, camera: str, errors: Errors, draw: Draw) -> Vehicle:
    """The vehicle file of an owner who has measured the world's machine so well."""
    m, lens = world.machine, world.lens
    lengths = (
        *("wheelbase_m", "half_width_m", "rear_overhang_m"),
        *("blade_width_m", "blade_ahead_m", "blade_height_m"),
    )
    values = {name: getattr(m, name) + draw(name, errors.tape_m) for name in lengths}
    hall = m.drive.hall_pulses_per_m * (1 + draw("hall", errors.hall))
    # Of a wheel, nobody writes that it runs outside of the machine.
    left, half = m.drive.hall_left_m, values["half_width_m"]
    drive = drive_response(m)
    base = Vehicle(
        **values,
        hall_pulses_per_m=hall,
        hall_left_m=max(-half, min(half, left + draw("hall left", errors.tape_m))) if left else 0.0,
        full_duty_speed_mps=drive.full_mps * (1 + draw("drive", errors.drive)),
        dead_duty=max(0.0, drive.dead + draw("dead", errors.dead_duty)),
        drive_lag_s=drive.lag_s * (1 + draw("lag", errors.drive_lag)),
        crop_height_m=max(0.1, world.field.crop_height_m + draw("crop", errors.crop_m)),
        camera_delay_s=max(0.0, lens.delay_s + draw("delay", errors.delay_s)),
    )
    return base.model_copy(
        update={"mounts": base.mounts | {camera: measured_mount(world, errors, draw)}}
    )


def measured_mount(world: World, errors: Errors, draw: Draw) -> Mount:
    """Where the camera is believed to sit, with the lens as far as it is known."""
    lens = world.lens
    places = {k: getattr(lens, k) + draw(k, errors.mount_m) for k in ("x_m", "y_m", "z_m")}
    angles = {
        k: getattr(lens, k) + draw(k, errors.mount_deg)
        for k in ("pitch_deg", "yaw_deg", "roll_deg")
    }
    known = errors.lens
    if known == "either":
        known = "calibrated" if draw.rng("lens").random() < 0.5 else "uncalibrated"
    off = {"exact": 0.0, "calibrated": errors.calibrated_deg}.get(known, errors.uncalibrated_deg)
    bent = (0.0, 0.0) if known == "uncalibrated" else tuple(getattr(lens, k) for k in LEARNED_LENS)
    return Mount(
        **places,
        **angles,
        width_px=lens.width_px,
        height_px=lens.height_px,
        hfov_deg=lens.hfov_deg + draw("hfov", off),
        distortion=(*bent, 0.0, 0.0, 0.0),
    )


def calibrated_parameters(
    world: World, vehicle: Vehicle, errors: Errors, draw: Draw
) -> dict[str, float]:
    """What the workshop has stored in the microcontroller, where it is not the default."""
    steering = world.machine.steering
    off = draw("pot", errors.pot_deg) * steering.pot_counts_per_deg
    defaults = {name: spec.from_raw(spec.default_raw) for name, spec in protocol.PARAMS.items()}
    values = FITTED | {
        "hall_per_metre": vehicle.hall_pulses_per_m,
        "speed_full": vehicle.full_duty_speed_mps,
        "drive_min_duty": float(round(255 * vehicle.dead_duty)),
        "drive_lag": vehicle.drive_lag_s,
        "stall_time": stall_time_ms(_slew_degps(world.machine), steering.backlash_deg),
    }
    for name, angle in (
        ("pot_left", "angle_left"),
        ("pot_centre", ""),
        ("pot_right", "angle_right"),
    ):
        degrees = defaults.get(angle, 0.0)
        counts = steering.pot_centre_counts + degrees * steering.pot_counts_per_deg
        values[name] = float(round(counts + off))
    return {name: value for name, value in values.items() if value != defaults[name]}


def _slew_degps(machine: MachineSpec) -> float:
    """What identification finds at full duty: of the battery's voltage, bridge and friction leave
    the rest for the motor's speed."""
    steering, bridge = machine.steering, machine.steering.bridge
    friction_v = steering.coulomb_nm / steering.k_vs * (steering.r_ohm + bridge.r_ohm)
    full_v = (machine.battery.full_v - bridge.drop_v) * (1 - bridge.dead_time_s * STEER_PWM_HZ)
    return math.degrees((full_v - friction_v) / (steering.k_vs * steering.gear))


# ---- the field -----------------------------------------------------------------------------------


def drawn_walk(errors: Errors, draw: Draw) -> Walk | None:
    """With which phone, and how often, the boundary was walked."""
    if errors.walk_cep_m is None:
        return None
    rng = draw.rng("walk")
    low, high = errors.walk_laps
    cep = round(float(rng.uniform(*errors.walk_cep_m)), 2)
    return Walk(laps=int(rng.integers(low, high + 1)), cep_m=cep)


def walked(world: World, walk: Walk) -> tuple[Ring, float, bool]:
    """The boundary that the host's own survey makes of a walk around the true one with the world's
    phone, how surely it knows the corners, and whether it kept the edge as it was walked."""
    phone = world.gnss.model_copy(update={"cep_m": walk.cep_m, "first_fix_s": 0.0})
    seed = world.seed if walk.seed is None else walk.seed
    return _walked(world.corners, phone, walk.laps, seed)


@lru_cache(maxsize=256)
def _walked(ring: Ring, phone: GnssSpec, laps: int, seed: int) -> tuple[Ring, float, bool]:
    home = LocalFrame(phone.lat_deg, phone.lon_deg)
    problem: UserError | None = None
    straight = len(ring) if len(ring) <= MAX_CORNERS else None
    # Whose walks have no straight sides takes the message's advice: --irregular.
    for corners, attempt in product(dict.fromkeys((straight, None)), range(WALKS)):
        lines = [f"{line}\r\n".encode() for line in walk_lines(ring, phone, laps, seed + attempt)]
        track = track_of(read_fixes(lines, Receiver()))
        if track is None:
            continue
        try:
            found = survey_track(track, corners=corners, irregular=corners is None)
        except UserError as error:
            problem = error
            continue
        local, home_of = track.frame, home.to_local
        places = ccw(found.polygon.exterior.coords)[:-1]
        walked_ring = tuple(home_of(*local.to_wgs84(x, y)) for x, y in places)
        return walked_ring, found.sigma_m, found.corners is None
    why = problem or "not one position was good enough"
    raise UserError(f"belief.boundary: {WALKS} walks around the field gave none: {why}")


def ccw(coords: Any) -> list[Point]:
    """A closed ring's points, counter-clockwise."""
    points = [(float(x), float(y)) for x, y, *_ in coords]
    area = sum(ax * by - bx * ay for (ax, ay), (bx, by) in pairwise(points))
    return points if area > 0 else points[::-1]


def walk_lines(ring: Ring, phone: GnssSpec, laps: int, seed: int) -> list[str]:
    """NMEA of a phone carried `laps` times around, with a pause where the walk begins and at each
    corner; where the edge only bends nobody stops."""
    rng = np.random.default_rng([seed, 0x3A1C])
    gnss = Gnss(phone, int(rng.integers(2**31)))
    way = np.array([*ring * laps, ring[0]], float)
    headings = np.arctan2(*np.diff(way, axis=0).T[::-1])
    turns = np.remainder(np.diff(headings) + math.pi, math.tau) - math.pi
    stops = [0, *(np.flatnonzero(np.abs(turns) > STOPS_RAD) + 1).tolist(), len(way) - 1]
    legs = [way[:1]]
    for a, b in pairwise(stops):
        done = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way[a : b + 1], axis=0).T))])
        at = np.linspace(0.0, done[-1], max(1, round(done[-1] / WALK_MPS)) + 1)[1:]
        leg = np.column_stack([np.interp(at, done, way[a : b + 1, k]) for k in (0, 1)])
        legs += [np.tile(way[a], (CORNER_PAUSE_S, 1)), leg]
    legs.append(np.tile(way[-1], (CORNER_PAUSE_S, 1)))
    places = np.concatenate(legs)
    keep = math.exp(-WALK_MPS / WOBBLE_LENGTH_M)
    pushes = rng.normal(0.0, WOBBLE_M * math.sqrt(1 - keep**2), places.shape)
    moving = np.hypot(*np.diff(places, axis=0, prepend=places[:1]).T) > 0
    strayed = np.zeros(2)
    for k in range(len(places)):
        strayed = keep * strayed + pushes[k] if moving[k] else strayed
        places[k] += strayed
    # Doppler of a second is the way of that second: positions and velocities agree.
    steps = np.diff(places, axis=0, prepend=places[:1])
    return [
        line
        for t, ((x, y), (vx, vy)) in enumerate(zip(places.tolist(), steps.tolist(), strict=True))
        for line in gnss.epoch(float(t), x, y, vx, vy)
    ]


def _midpoints(ring: Ring) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 2) middles of the sides and (n,) their headings; side k leaves corner k."""
    points = np.array(ring, float)
    after = np.roll(points, -1, axis=0)
    way = after - points
    return (points + after) / 2, np.arctan2(way[:, 1], way[:, 0])


TURNED_M_RAD: Final = 5.0
"""A side that is turned by a radian is as unlike as one that lies so far away."""


def corner_like(ring: Ring, corner: int, other: Ring) -> int:
    """The corner of another ring that is most like that of this one, by where it is and by the side
    that leaves it; both counter-clockwise, about the same field. Of rings with as many corners by
    the side alone: with it a corner stays itself, however far it lies off."""
    middles, headings = _midpoints(ring)
    others, turned = _midpoints(other)
    at = corner % len(ring)
    if len(ring) == len(other):
        centre = np.mean(middles, axis=0) - np.mean(others, axis=0)
        away = np.hypot(*(others + centre - middles[at]).T)
    else:
        one, two = (np.array(shapely.Polygon(k).centroid.coords[0]) for k in (ring, other))
        away = np.hypot(*(np.array(other) + one - two - ring[at]).T)
    askew = np.abs(np.remainder(turned - headings[at] + math.pi, math.tau) - math.pi)
    return int(np.argmin(away + TURNED_M_RAD * askew))


def boundary_off_m(ring: Ring, world: World) -> float:
    """Root mean square distance of believed from true corners, the place of the whole aside; NaN
    where they are not as many."""
    said, true = np.array(ring), np.array(world.corners)
    if len(said) != len(true):
        return math.nan
    said = np.roll(said, -corner_like(world.corners, 0, ring), axis=0)
    apart = said - said.mean(axis=0) - true + true.mean(axis=0)
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def wrong_by(told: Told, world: World) -> dict[str, float]:
    """How far the host's beliefs are off the world, in the units of their names."""
    v, m, mount, lens = told.vehicle, world.machine, told.mount, world.lens
    usual = protocol.PARAMS["pot_centre"]
    centre = told.parameters.get("pot_centre", usual.from_raw(usual.default_raw))
    hall = m.drive.hall_pulses_per_m
    drive = drive_response(m)
    return {
        "boundary_m": boundary_off_m(told.boundary, world),
        "gap_m": told.gap_m - world.field.gap_m,
        "crop_height_m": v.crop_height_m - world.field.crop_height_m,
        "pitch_deg": mount.pitch_deg - lens.pitch_deg,
        "yaw_deg": mount.yaw_deg - lens.yaw_deg,
        "camera_height_m": mount.z_m - lens.z_m,
        "focal_percent": 100 * (mount.focal / lens.focal_px - 1),
        "camera_delay_s": v.camera_delay_s - lens.delay_s,
        "wheelbase_m": v.wheelbase_m - m.wheelbase_m,
        "wheel_sensor_m": v.hall_left_m - m.drive.hall_left_m,
        "hall_percent": 100 * (v.hall_pulses_per_m / hall - 1) if hall > 0 else 0.0,
        "full_speed_percent": 100 * (v.full_duty_speed_mps / drive.full_mps - 1),
        "dead_duty_percent": 100 * (v.dead_duty - drive.dead),
        "pot_deg": (centre - m.steering.pot_centre_counts) / m.steering.pot_counts_per_deg,
    }


def in_words(wrong: Mapping[str, float]) -> str:
    """One line: what was believed wrong, and by how much."""
    units = {"m": "m", "deg": "deg", "percent": "%", "s": "s"}
    parts = []
    for name, value in wrong.items():
        what, _, unit = name.rpartition("_")
        sign = "" if name == "boundary_m" else "+"
        parts.append(f"{what.replace('_', ' ')} {value:{sign}.2f} {units[unit]}")
    return "believed wrong: " + ", ".join(parts)


def taped_keep_outs(world: World, ring: Ring, errors: Errors, draw: Draw) -> tuple[Ring, ...]:
    """Keep-outs as taped from the edges: where the believed boundary lies elsewhere, so do they."""
    outs = []
    true, said = np.array(world.corners), np.array(ring)
    for index, hole in enumerate(world.field.keep_outs):
        middle = np.mean(np.array(hole), axis=0)
        moved = np.zeros(2)
        if len(true) == len(said):
            # by the displacement of the corners, the near ones' more
            first = corner_like(world.corners, 0, ring)
            shifts = np.roll(said, -first, axis=0) - true
            near = 1 / (np.hypot(*(true - middle).T) ** 2 + 1e-6)
            moved = (shifts * near[:, None]).sum(axis=0) / near.sum()
        off = moved + [draw(f"keep-out {index}{axis}", errors.keep_out_m) for axis in "xy"]
        outs.append(tuple((float(x + off[0]), float(y + off[1])) for x, y in hole))
    return tuple(outs)


def _read(path: Path, gnss: GnssSpec) -> tuple[Ring, tuple[Ring, ...], float, bool | None]:
    """A boundary file's ring and keep-outs in the world's frame, how surely it knows them, and
    whether it says that they were recorded point by point."""
    boundary = load_field(path)
    polygon = boundary.polygon(LocalFrame(gnss.lat_deg, gnss.lon_deg))
    holes = tuple(tuple(ccw(hole.coords)[:-1]) for hole in polygon.interiors)
    ring = tuple(ccw(polygon.exterior.coords)[:-1])
    return ring, holes, boundary.known_to_m, boundary.recorded


def _parameters_of(folder: Path) -> dict[str, float]:
    path = folder / PARAMETER_FILE
    try:
        data = load_yaml(path, "belief.folder:") or {}
        return {str(name): float(value) for name, value in data.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise UserError(f"belief.folder: cannot read {path}: {error}") from error


def _gap_of(folder: Path) -> float | None:
    path = folder / "commissioning.json"
    check_input(path, "belief.folder:", once=False)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        return float(data["gap_m"]["found"])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UserError(f"belief.folder: cannot read {path}: {error}") from error
