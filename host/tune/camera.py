"""Lens and mount of a camera from pictures of a checkerboard."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from host.core.errors import UserError
from host.core.vehicle import Mount
from host.tune.checkerboard import Board, Lens, calibrate_lens, calibrate_mount, corners
from host.vision.pictures import Picture, read_photo

Size = tuple[int, int]
"""Width and height, pixels."""


def lens_of(
    pictures: Iterable[tuple[str, Picture]], board: Board, say: Callable[[str], None]
) -> tuple[Lens, Size]:
    """From pictures of the board at many angles; `say` is told of each. UserError where their sizes
    differ or too few show the board."""
    seen, size = [], None
    for name, bgr in pictures:
        this = _size(bgr)
        size = size or this
        if this != size:
            raise UserError(
                f"{name}: {this[0]}x{this[1]} pixels, the pictures before had "
                f"{size[0]}x{size[1]}; use one camera at one setting, held one way up"
            )
        found = corners(bgr, board)
        say(f"{name}: {'board found' if found is not None else 'no whole board'}")
        if found is not None:
            seen.append(found)
    if size is None:
        raise UserError("there is no picture; name photographs, a folder or a video")
    return calibrate_lens(seen, size, board), size


def mount_from(
    ground: Path, lens: Lens, size: Size, board: Board, ahead_m: float, left_m: float
) -> Mount:
    """From a picture of the board flat on the ground, its middle so far ahead and to the left."""
    bgr = read_photo(ground)
    if _size(bgr) != size:
        raise UserError(
            f"{ground}: not the size of the other pictures, {size[0]}x{size[1]}; use the same "
            "camera at the same setting"
        )
    found = corners(bgr, board)
    if found is None:
        raise UserError(
            f"{ground}: no whole board of {board.columns}x{board.rows} inner corners found"
        )
    return calibrate_mount(found, lens, board, ahead_m, left_m)


def lens_fields(lens: Lens, size: Size) -> dict[str, object]:
    """The lens as it goes into the vehicle file."""
    return {
        "width_px": size[0],
        "height_px": size[1],
        "focal_px": round(lens.focal_px, 3),
        "centre_px": [round(c, 3) for c in lens.centre_px],
        "distortion": [round(k, 6) for k in lens.distortion],
    }


def _size(bgr: Picture) -> Size:
    return bgr.shape[1], bgr.shape[0]
