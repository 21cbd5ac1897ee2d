"""`daranti calibrate camera`: lens and mount from a printed checkerboard, so that pixels become
metres."""

from __future__ import annotations

import itertools
from pathlib import Path

import click
import yaml

from host.commands.options import mount_option, written_vehicle_option
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_file
from host.core.terminal import echo
from host.core.vehicle import Mount
from host.core.vehicle_file import load_vehicle, mount_of, save_vehicle
from host.core.whole_file import save_text
from host.runs.pictures import frames
from host.tune.camera import lens_fields, lens_of, mount_from
from host.tune.checkerboard import Board

DOUBTFUL_PX = 1.0
"""Mean distance of the board's corners from where the lens has them."""
FARTHEST_M = 20.0
"""Of the board on the ground: farther off its corners are not seen."""


@click.command()
@click.argument("pictures", nargs=-1, required=True, metavar="PHOTO|FOLDER|VIDEO...")
@click.option("--columns", type=WholeRange(3, 30), default=9, show_default=True)
@click.option("--rows", type=WholeRange(3, 30), default=6, show_default=True)
@click.option(
    "--square",
    "square_m",
    type=NumberRange(0.002, 1),
    default=0.04,
    show_default=True,
    help="Side of a square, m. Columns and rows are inner corners.",
)
@click.option(
    "--ground",
    type=click.Path(path_type=Path),
    metavar="PHOTO",
    help="From the mount: the board flat on the ground, longer side across the machine.",
)
@click.option(
    "--ahead",
    "ahead_m",
    type=NumberRange(-FARTHEST_M, FARTHEST_M),
    default=2.0,
    show_default=True,
    help="The board's middle on the ground, ahead of the rear axle, m.",
)
@click.option(
    "--left",
    "left_m",
    type=NumberRange(-FARTHEST_M, FARTHEST_M),
    default=0.0,
    show_default=True,
    help="The same, to the left, m.",
)
@written_vehicle_option("the mount")
@mount_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("mount.yaml"),
    show_default=True,
    help="Without --vehicle: for you to copy from.",
)
def calibrate_camera(
    pictures: tuple[str, ...],
    columns: int,
    rows: int,
    square_m: float,
    ground: Path | None,
    ahead_m: float,
    left_m: float,
    vehicle: Path | None,
    mount: str,
    out: Path,
) -> None:
    """Measures the lens from pictures of the board at many angles and, with --ground, where the
    camera sits; writes the mount into the vehicle file."""
    check_file(vehicle or out)
    machine = load_vehicle(vehicle if vehicle is not None and vehicle.exists() else None)
    before = mount_of(machine, mount)
    board = Board(columns, rows, square_m)
    every = itertools.chain.from_iterable(frames(source) for source in pictures)
    lens, size = lens_of(every, board, echo)
    echo(f"focal length {lens.focal_px:.1f} px, error {lens.error_px:.2f} px")
    if lens.error_px > DOUBTFUL_PX:
        echo("the error is large: take sharper pictures, keep the board flat", err=True)
    fields = lens_fields(lens, size)
    if ground is not None:
        found = mount_from(ground, lens, size, board, ahead_m, left_m)
        fields = found.model_dump(mode="json")
        echo(
            f"camera {found.z_m:.3f} m high, pitch {found.pitch_deg:.2f}, yaw {found.yaw_deg:.2f}, "
            f"roll {found.roll_deg:.2f} degrees"
        )
    if vehicle is None:
        save_text(out, yaml.safe_dump(fields, sort_keys=False))
        echo(f"{out}: copy it into the vehicle file under mounts, or give --vehicle")
        return
    measured = Mount.model_validate(before.model_dump() | fields)
    save_vehicle(vehicle, machine.model_copy(update={"mounts": machine.mounts | {mount: measured}}))
    echo(f"{vehicle}: the mount {mount} has the lens that was measured")
    if ground is None:
        echo(
            f"it is still said to be {before.z_m:g} m high and pitched by {before.pitch_deg:g} "
            "degrees; --ground measures that"
        )
