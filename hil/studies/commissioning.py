"""What an owner does before the first harvest, with the host's own code against the simulated
machine: walk the field, calibrate lens and mount, drive beside a tape, weave for the camera's
delay, tape the rest. Leaves the files that a harvest is given, and a page: found against true."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import shapely
import yaml
from numba import njit
from numpy.typing import NDArray

from hil.bench.lockstep import Bench
from hil.firmware.provision import FITTED
from hil.scenario.belief import (
    FIELD_FILE,
    PARAMETER_FILE,
    VEHICLE_FILE,
    Draw,
    Errors,
    Walk,
    boundary_off_m,
    drawn_walk,
    measured_vehicle,
    taped_keep_outs,
    walked,
)
from hil.scenario.scenario import Scenario, changed
from hil.scenario.world import World
from hil.studies.actuators import truth
from hil.studies.identification import MIN_DUTY_OFF, defaults
from hil.studies.steering_setup import steering_setup
from hil.studies.yard_camera import YardCamera
from hil.studies.yard_wire import BenchWire
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import save_vehicle
from host.core.whole_file import save_text
from host.field.boundary_file import boundary_of, save_field
from host.tune.actuator_model import ActuatorModel
from host.tune.checkerboard import Board, Lens, calibrate_lens, calibrate_mount, corners
from host.tune.measured_drive import MeasuredDrive, Taped, Way, measure_drive
from host.tune.taped_drive import TAPE_SIGMA_M
from host.tune.weaving import measured_delay
from sim_plant.camera import CameraSpec
from sim_plant.drive_response import drive_response

HAND_BOARD: Final = Board()
GROUND_BOARD: Final = Board(square_m=0.08)
"""A printed sheet, and boards on the ground."""
PICTURES: Final = 12
"""Of the board held by hand: what the manual asks for."""
GROUND_AHEAD_M: Final = (2.5, 2.0, 1.6, 1.3)
"""Where it is tried, until it is seen whole."""
LAID_M, LAID_DEG = 0.01, 0.5
"""How well a board is laid where the tape says."""
TAPE: Final = Errors(gap_m=0.05, crop_m=0.05)
"""Of what is taped: gap and crop as well, here."""
FINER: Final = 2
"""Pixels each way that are averaged into one."""
DRIVE_M: Final = 10.0
"""What the manual asks the owner to drive and tape."""
STOP_DEG: Final = 1.0
"""How well the owner measures the wheel's angle at its stops."""
BY_HAND: Final = 0.05
"""Share of the pulses a metre by ten turns of a wheel on stands (docs/build/first-power-up.md)."""
LAG_SHARE: Final = 0.15
"""Of the drive's lag: what bumps under the starts leave of it."""


@dataclass(frozen=True, slots=True)
class Value:
    """One thing that was found out."""

    found: float
    sigma: float
    """As the owner would state it."""
    true: float
    unit: str
    how: str

    @property
    def off(self) -> float:
        """Found less true."""
        return self.found - self.true


# ---- pictures of boards --------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _rays(lens: CameraSpec) -> NDArray[np.float64]:
    """(n, 3) directions (right, down, ahead) of a lens's finer pixels, row by row. One lens takes
    many pictures."""
    width, height = lens.width_px * FINER, lens.height_px * FINER
    focal = lens.focal_px * FINER
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    # a pixel's middle lies at half the finer pixels it is made of
    offset = (FINER - 1) / 2
    pixels = np.stack([u - offset, v - offset], axis=-1).reshape(-1, 1, 2)
    bent = np.array([lens.k1, lens.k2, 0.0, 0.0])
    straight = cv2.undistortPoints(pixels, matrix, bent).reshape(-1, 2)
    return np.column_stack([straight, np.ones(len(straight))])


@njit(cache=True, nogil=True, error_model="numpy")
def _greys(
    rays: NDArray[np.float64],
    origin: NDArray[np.float64],
    square: float,
    columns: int,
    rows: int,
    out: NDArray[np.float64],
) -> None:
    """What a lens at `origin` sees of a board in each pixel, (height, width), by its finer pixels'
    rays, in the board's frame. A field's commissioning takes a dozen such pictures."""
    height, width = out.shape
    for y in range(height):
        for x in range(width):
            total = 0.0
            for k in range(FINER * FINER):
                ray = rays[(y * FINER + k // FINER) * width * FINER + x * FINER + k % FINER]
                scale = -origin[2] / ray[2]
                column = math.floor((origin[0] + scale * ray[0]) / square)
                row = math.floor((origin[1] + scale * ray[1]) / square)
                grey = 90.0
                if scale > 0.0:
                    across = abs(column - (columns - 1) / 2) < columns / 2 + 1.6
                    if across and abs(row - (rows - 1) / 2) < rows / 2 + 1.6:
                        grey = 225.0
                    inside = -1 <= column < columns and -1 <= row < rows
                    if inside and (column + row) % 2 == 0:
                        grey = 30.0
                total += grey
            out[y, x] = total / (FINER * FINER)


def board_picture(
    lens: CameraSpec,
    board: Board,
    rotation: NDArray[np.float64],
    shift: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.uint8]:
    """What a camera with this lens and sensor takes of a board: a point p of the board's plane lies
    at rotation @ p + shift of the camera's frame (right, down, ahead)."""
    rays, origin = _rays(lens) @ rotation, -rotation.T @ shift
    fine = np.empty((lens.height_px, lens.width_px))
    _greys(rays, origin, board.square_m, board.columns, board.rows, fine)
    noisy = cv2.GaussianBlur(fine, (0, 0), 0.5) + rng.normal(0, lens.noise, fine.shape)
    return np.repeat(np.clip(noisy, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def found_lens(world: World, rng: np.random.Generator) -> Lens:
    """The lens, from pictures of a board held at many angles."""
    seen = []
    for _k in range(4 * PICTURES):
        tilt = rng.uniform(-0.5, 0.5, 3) * (1.0, 1.0, 0.4)
        rotation = np.asarray(cv2.Rodrigues(tilt)[0], np.float64)
        middle = np.array([4.0, 2.5, 0.0]) * HAND_BOARD.square_m
        far = rng.uniform(0.45, 0.9)
        at = np.array([rng.uniform(-0.28, 0.28) * far, rng.uniform(-0.2, 0.2) * far, far])
        picture = board_picture(world.lens, HAND_BOARD, rotation, at - rotation @ middle, rng)
        points = corners(picture, HAND_BOARD)
        if points is not None:
            seen.append(points)
        if len(seen) == PICTURES:
            break
    return calibrate_lens(seen, (world.lens.width_px, world.lens.height_px), HAND_BOARD)


def found_mount(world: World, lens: Lens, rng: np.random.Generator) -> Mount:
    """Where the camera sits, from a board that lies ahead on the ground as the tape says."""
    for ahead_m in GROUND_AHEAD_M:
        seen = corners(_ground_picture(world, ahead_m, rng), GROUND_BOARD)
        if seen is not None:
            return calibrate_mount(seen, lens, GROUND_BOARD, ahead_m)
    raise UserError("the board on the ground is not seen whole at any distance: turn the camera")


def _ground_picture(world: World, ahead_m: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    turned = math.radians(rng.uniform(-LAID_DEG, LAID_DEG))
    off_x, off_y = rng.uniform(-LAID_M, LAID_M, 2)
    place = np.array([ahead_m + off_x, off_y, 0.0])
    c, s = math.cos(turned), math.sin(turned)
    # the board's columns run to the right, its rows towards the machine
    on_ground = np.array([[s, -c, 0.0], [-c, -s, 0.0], [0.0, 0.0, -1.0]]).T
    axes = world.lens.axes
    position = np.array([world.lens.x_m, world.lens.y_m, world.lens.z_m])
    middle = 0.5 * GROUND_BOARD.square_m * np.array([8.0, 5.0, 0.0])
    rotation = axes @ on_ground
    shift = axes @ (place - position) - rotation @ middle
    return board_picture(world.lens, GROUND_BOARD, rotation, shift, rng)


# ---- drives --------------------------------------------------------------------------------------


def free_ground(scenario: Scenario, parameters: dict[str, float]) -> Bench:
    """The machine on mown ground, its board with these parameters, else as it is delivered."""
    yard = changed(
        scenario,
        {
            "eyes": "picture",
            "field": {"neighbours": "none", "size_m": [30.0, 30.0], "polygon": None,
                      "keep_outs": [], "trees": [], "houses": []},
            "start": {"corner": 0, "lateral_error_m": 10.0, "heading_error_deg": 0.0},
            "belief": {"errors": "exact", "folder": None, "boundary": None, "vehicle": {},
                       "keep_outs": None, "corner": None,
                       "parameters": defaults() | parameters},
            "faults": [],
        },
    )  # fmt: skip
    bench = Bench(yard)
    bench.field.clear(((-5.0, -5.0), (35.0, -5.0), (35.0, 35.0), (-5.0, 35.0)))
    return bench


def found_by_tape(
    scenario: Scenario, vehicle: Vehicle, parameters: dict[str, float], rng: np.random.Generator
) -> MeasuredDrive:
    """Two speeds there and back, and a tape along the first way."""
    with free_ground(scenario, parameters) as bench:
        wire = BenchWire(bench)
        stood = bench.pose

        def tape(_: Way) -> Taped:
            nonlocal stood
            (x, y, yaw), stood = stood, bench.pose
            dx, dy = stood[0] - x, stood[1] - y
            along = abs(dx * math.cos(yaw) + dy * math.sin(yaw)) + rng.normal(0, TAPE_SIGMA_M)
            aside = dy * math.cos(yaw) - dx * math.sin(yaw) + rng.normal(0, TAPE_SIGMA_M)
            return Taped(along, aside)

        held = defaults() | parameters
        return measure_drive(wire, "the machine", vehicle, held, DRIVE_M, tape)


def found_delay(
    scenario: Scenario, vehicle: Vehicle, parameters: dict[str, float]
) -> tuple[float, float]:
    """The camera's delay and its standard deviation, from a drive in curves."""
    with free_ground(scenario, parameters) as bench:
        found = measured_delay(BenchWire(bench), "the machine", vehicle, YardCamera(bench))
    return found.delay_s, found.sigma_s


# ---- the whole -----------------------------------------------------------------------------------


def walk_of(scenario: Scenario) -> Walk:
    """The walk around a scenario's field, by the phone and in the laps that its seed draws."""
    return drawn_walk(scenario.belief.errors, Draw(scenario.seed)) or Walk()


def commission(
    scenario: Scenario, out: Path, walk: Walk, say: Callable[[str], None] = lambda _: None
) -> dict[str, Value]:
    """Does all of it and writes vehicle.yaml, field.geojson, parameters.yaml and commissioning.json
    into `out`. UserError where a step fails as it would for the owner."""
    out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)  # sums of many threads differ in their last digits from call to call
    world, camera = scenario.world, scenario.camera
    draw = Draw(world.seed)
    rng = draw.rng("commissioning")

    say(f"walk around the field, {walk.laps} laps")
    ring, ring_sigma, recorded = walked(world, walk)
    boundary = Value(
        boundary_off_m(ring, world), math.hypot(ring_sigma, ring_sigma), 0.0, "m",
        f"{walk.laps} laps with a phone of {walk.cep_m:g} m CEP; rms over the sides' places",
    )  # fmt: skip
    say("tape: machine, gap, crop")
    taped = measured_vehicle(world, camera, TAPE, draw)
    by_tape = _taped(world, taped, draw)
    say("lens and mount: a board in the hand, then on the ground")
    lens = found_lens(world, rng)
    mount = found_mount(world, lens, rng)
    by_board = _boarded(world, lens, mount)
    say("steering: into its stops, identified, tuned")
    measured_deg = world.machine.steering.stop_deg + draw("stop", STOP_DEG)
    parameters, model = steering_setup(partial(free_ground, scenario), FITTED, measured_deg)
    say(f"drive {DRIVE_M:g} m beside a tape, and back, at two speeds")
    true_pulses = world.machine.drive.hall_pulses_per_m
    parameters["hall_per_metre"] = round(true_pulses * (1.0 + draw("turns", BY_HAND)), 1)
    drive = found_by_tape(scenario, taped, parameters, rng)
    parameters |= drive.params(parameters)
    by_drive = _driven(world, drive, parameters)
    say("weave for the camera's delay")
    known = drive.told(taped)
    delay, sigma = found_delay(scenario, known, parameters)
    by_weave = Value(delay, sigma, world.lens.delay_s, "s", "weaving drive")

    values = {
        "boundary_m": boundary,
        **by_tape,
        **by_board,
        **_steered(world, model),
        **by_drive,
        "camera_delay_s": by_weave,
    }
    vehicle = known.model_copy(
        update={
            "camera_delay_s": round(max(0.0, delay), 3),
            "mounts": known.mounts | {camera: mount},
        }
    )
    _write(out, scenario, vehicle, ring, ring_sigma, recorded, parameters, values, draw)
    return values


def _taped(world: World, taped: Vehicle, draw: Draw) -> dict[str, Value]:
    gap = max(0.0, world.field.gap_m + draw("gap", TAPE.gap_m))
    values = {"gap_m": Value(gap, TAPE.gap_m, world.field.gap_m, "m", "tape")}
    for name, true in (
        ("wheelbase_m", world.machine.wheelbase_m),
        ("blade_width_m", world.machine.blade_width_m),
        ("crop_height_m", world.field.crop_height_m),
    ):
        bound = TAPE.crop_m if name == "crop_height_m" else TAPE.tape_m
        values[name] = Value(getattr(taped, name), bound, true, "m", "tape")
    return values


def _boarded(world: World, lens: Lens, mount: Mount) -> dict[str, Value]:
    truth = world.lens
    focal = truth.focal_px
    values = {"focal_px": Value(lens.focal_px, 0.003 * focal, focal, "px", "board")}
    for name in ("pitch_deg", "yaw_deg", "roll_deg"):
        found = getattr(mount, name)
        values[name] = Value(found, LAID_DEG, getattr(truth, name), "deg", "board on the ground")
    for name in ("x_m", "y_m", "z_m"):
        values[name] = Value(getattr(mount, name), 0.02, getattr(truth, name), "m", "the same")
    return values


def _driven(
    world: World, drive: MeasuredDrive, parameters: Mapping[str, float]
) -> dict[str, Value]:
    true = drive_response(world.machine)
    pulses = world.machine.drive.hall_pulses_per_m
    steering, curve, taped = world.machine.steering, drive.curve, drive.taped
    how = "drive there and back"
    values = {
        "pot_centre_counts": Value(
            parameters["pot_centre"],
            steering.pot_counts_per_deg * taped.steer_sigma_deg,
            steering.pot_centre_counts,
            "counts",
            "taped drive",
        ),
        "full_duty_speed_mps": Value(curve.full_mps, curve.full_sigma, true.full_mps, "m/s", how),
        "dead_duty": Value(curve.dead, curve.dead_sigma, true.dead, "", how),
    }
    if taped.pulses_per_m is not None:
        values["hall_pulses_per_m"] = Value(
            taped.pulses_per_m, taped.pulses_sigma, pulses, "1/m", "taped drive"
        )
    if curve.lag_s is not None:
        values["drive_lag_s"] = Value(curve.lag_s, LAG_SHARE * curve.lag_s, true.lag_s, "s", how)
    return values


def _steered(world: World, model: ActuatorModel) -> dict[str, Value]:
    true = truth(world.machine)
    left = Value(model.min_left, MIN_DUTY_OFF, true.min_duty, "counts", "identified")
    off = model.slew_degps * STOP_DEG / world.machine.steering.stop_deg
    slew = Value(model.slew_degps, off, true.slew_degps, "deg/s", "identified")
    return {"steer_slew_degps": slew, "steer_min_duty_left": left}


def _write(
    out: Path,
    scenario: Scenario,
    vehicle: Vehicle,
    ring: tuple[tuple[float, float], ...],
    ring_sigma: float,
    recorded: bool,
    parameters: dict[str, float],
    values: dict[str, Value],
    draw: Draw,
) -> None:
    save_vehicle(out / VEHICLE_FILE, vehicle)
    world = scenario.world
    outs = taped_keep_outs(world, ring, TAPE, draw)
    frame = LocalFrame(world.gnss.lat_deg, world.gnss.lon_deg)
    save_field(
        out / FIELD_FILE,
        boundary_of(shapely.Polygon(ring, outs), frame, "commissioned", ring_sigma, recorded),
    )
    save_text(out / PARAMETER_FILE, yaml.safe_dump(parameters))
    data = {name: asdict(value) | {"off": value.off} for name, value in values.items()}
    save_text(out / "commissioning.json", json.dumps(data, indent=1))
    save_text(out / "commissioning.md", page_of(values))


def page_of(values: dict[str, Value]) -> str:
    """Found against true, as a page."""
    lines = [
        "# Commissioning: found against true",
        "",
        "| value | found | ± | true | off | unit | how |",
        "|---|---:|---:|---:|---:|---|---|",
    ]
    for name, v in values.items():
        figures = " | ".join(f"{x:.4g}" for x in (v.found, v.sigma, v.true, v.off))
        lines.append(f"| {name} | {figures} | {v.unit} | {v.how} |")
    return "\n".join(lines) + "\n"
