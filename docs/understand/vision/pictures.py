"""Draws docs/understand/vision/photo.jpg from rendered views, in a minute:
`python docs/understand/vision/pictures.py`. Also prints how the photographs' detector does on all
of the views: it was chosen on photographs, none of it on the renderer.

`--data FOLDER` draws labelled photographs instead, into out/, for who has them; they carry no
licence, and nothing made from them belongs into the repository.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.terminal import echo
from host.vision.figure import draw
from host.vision.photo.detector import RobustPhoto
from host.vision.photo.score import labelled_set, miou
from host.vision.photo.split import Side
from sim_plant import labels
from sim_plant.camera import Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.sky import WeatherSpec

HERE = Path(__file__).parent
VIEWS = 40
RIGHT, WRONG = 0.93, 0.80
"""mIoU from which an edge counts as right, and below which as wrong."""
SIZE = (640, 480)

View = tuple[str, NDArray[np.uint8], NDArray[np.bool_], Side]


def rendered() -> Iterator[View]:
    """Views from a cab along the edge of random fields, without the sky."""
    for seed in range(VIEWS):
        rng = np.random.default_rng(seed)
        spec = FieldSpec(
            size_m=(25.0, 12.0),
            drilled=bool(rng.random() < 0.5),
            crop_height_m=float(rng.uniform(0.6, 1.1)),
            lodged=float(rng.choice([0.0, 0.05, 0.15])),
            neighbours="none",
        )
        weather = WeatherSpec(
            hour=float(rng.uniform(8, 18)),
            cloud=float(rng.choice([0.0, 0.5, 1.0])),
            dust=float(rng.choice([0.0, 0.3])),
            haze=float(rng.uniform(0.002, 0.02)),
        )
        lens = CameraSpec(
            x_m=0.0,
            z_m=float(rng.uniform(2.0, 4.0)),
            pitch_deg=float(rng.uniform(32, 50)),
            yaw_deg=float(rng.uniform(-15, 25)),
            hfov_deg=float(rng.uniform(45, 65)),
            width_px=SIZE[0],
            height_px=SIZE[1],
            vibration_deg=0.0,
        )
        field = Field(spec, seed)
        depth = float(rng.uniform(0.0, 3.0))
        field.clear(((-50, -50), (80, -50), (80, depth), (-50, depth)))
        camera = Camera(field, lens, weather, seed, threads=1)
        place = (0.0, 5.0, depth - float(rng.uniform(0.2, 1.5)), 0.0)
        bgr = camera.capture(*place)
        # straw, weeds and stubble are not crop
        standing = np.asarray(camera.labels(*place) == labels.STANDING)
        closed = cv2.morphologyEx(standing.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9)))
        if 0.15 < closed.mean() < 0.85:
            yield f"view {seed}", bgr.copy(), closed > 0, "left"


def photographs(folder: Path) -> Iterator[View]:
    """Of a labelled folder."""
    for item in labelled_set(folder):
        yield item.name, item.picture(), item.standing(), item.side


@click.command()
@click.option("--data", type=click.Path(path_type=Path))
def main(data: Path | None) -> None:
    """Right, doubtful and wrong ones, as many as are found, each with what the detector said."""
    shown: dict[str, list[NDArray[np.uint8]]] = {"right": [], "doubtful": [], "wrong": []}
    scores = []
    for name, bgr, standing, side in photographs(data) if data else rendered():
        view = RobustPhoto(side).see(bgr)
        assert view.standing is not None
        score = miou(standing, view.standing)
        scores.append((score, view.confidence))
        kind = "wrong" if score < WRONG else "right" if view.confidence >= 0.5 else "doubtful"
        if kind == "right" and score < RIGHT:
            continue
        picture = draw(bgr, view)
        outline, _ = cv2.findContours(
            standing.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(picture, outline, -1, (235, 120, 30), max(1, bgr.shape[1] // 320))
        picture = np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA), np.uint8)
        text = f"{kind}: {name}, mIoU {score:.2f}"
        cv2.putText(picture, text, (6, 20), 0, 0.55, (255, 255, 255), 2, cv2.LINE_AA)
        shown[kind].append(picture)
    made = np.array(scores)
    sure, wrong = made[:, 1] >= 0.5, made[:, 0] < WRONG
    echo(
        f"{len(made)} pictures: mIoU {made[:, 0].mean():.3f}, sure of {sure.mean():.0%}, wrong "
        f"{wrong.mean():.0%}, sure and wrong {(sure & wrong).mean():.0%}"
    )
    rows = [np.hstack(pictures[:2]) for pictures in shown.values() if len(pictures) >= 2]
    out = Path("out") / "photographs.jpg" if data else HERE / "photo.jpg"
    out.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(out), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 80])
    echo(f"written: {out}")


if __name__ == "__main__":
    main()
