"""`daranti-hil world`: contact sheets of the simulated view, and a drive through it as video.

Every sheet varies one thing (hour, weather, cut, crop) for both reference mounts, so that a person
can judge the realism; where it helps, the label picture stands beside the view.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_plant import labels
from sim_plant.camera import Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec, House, Tree
from sim_plant.sky import WeatherSpec

Picture = NDArray[np.uint8]
Pose = tuple[float, float, float]

BLADE_AHEAD: Final = 1.5
"""Metres from the rear axle to the blade, as the default machine has it."""
WIDTH: Final = 1.0
"""Metres of its blade."""
PALETTE: Final = {
    labels.BACKGROUND: ("background", (205, 180, 150)),
    labels.STANDING: ("standing crop", (40, 190, 250)),
    labels.STUBBLE: ("stubble", (130, 150, 170)),
    labels.STRAW: ("straw", (170, 225, 240)),
    labels.SOIL: ("soil", (70, 90, 110)),
    labels.NEIGHBOUR: ("neighbour's crop", (40, 110, 190)),
    labels.WEEDS: ("weeds, grass", (70, 150, 70)),
    labels.MACHINE: ("machine", (80, 80, 80)),
    labels.EDGE: ("true edge", (30, 30, 230)),
}
SCENERY: Final[dict[str, Any]] = {
    "trees": (
        Tree(x_m=13.0, y_m=-3.5),
        Tree(x_m=14.5, y_m=4.0, height_m=5.0, crown_radius_m=1.4),
        Tree(x_m=6.0, y_m=14.5, height_m=7.0, crown_radius_m=2.2),
    ),
    "houses": (House(x_m=16.0, y_m=9.0, yaw_deg=15.0),),
}


@dataclass(frozen=True, slots=True)
class View:
    """One tile of a sheet: what the machine sees at a stage of the harvest."""

    title: str
    stage: str = "first edge"
    crop: dict[str, Any] = field(default_factory=dict)
    weather: dict[str, Any] = field(default_factory=dict)
    blade: bool = False


SHEETS: Final[dict[str, tuple[bool, tuple[View, ...]]]] = {
    "hours": (
        False,
        tuple(View(f"{h:02d}:00", weather={"hour": h}) for h in (9, 11, 13, 16)),
    ),
    "weather": (
        False,
        (
            View("haze", weather={"haze": 0.05}),
            View("overcast", weather={"cloud": 1.0}),
            View("wind 9 m/s", weather={"wind_mps": 9.0}),
            View("dust", weather={"dust": 1.0, "wind_mps": 1.0}, blade=True),
        ),
    ),
    "cut": (
        True,
        (
            View("at the first corner", "start"),
            View("along the outer edge", "first edge"),
            View("second ring", "second ring"),
            View("end of the field", "end"),
        ),
    ),
    "crop": (
        True,
        (
            View("lodged", crop={"lodged": 0.3}),
            View("weeds and green patches", crop={"weeds": 0.15, "green": 0.15}),
            View("thin and bare", crop={"thin": 0.7, "bare": 0.06}),
            View("drilled rows", crop={"drilled": True}),
        ),
    ),
}
"""Name of the sheet: (with labels, its views)."""


def stage(spec: FieldSpec, seed: int, name: str) -> tuple[Field, Pose]:
    """A field as the harvest has left it at a stage, and where the machine is. The machine follows
    the southern edge eastward with the crop to its left."""
    crop = Field(spec, seed)
    x_max = spec.boundary.bounds[2]
    if name == "start":
        return crop, (-BLADE_AHEAD - 0.3, WIDTH / 2, 0.0)
    side = 0.0 if name != "second ring" else WIDTH
    if side:
        _cut_along(crop, -BLADE_AHEAD, x_max - BLADE_AHEAD + 0.3, WIDTH / 2)
        crop.clear(((-1, -1), (side, -1), (side, 99), (-1, 99)))
    start = -BLADE_AHEAD
    end = {"first edge": 0.3, "second ring": 0.8, "end": x_max - BLADE_AHEAD - 0.8}[name]
    _cut_along(crop, start, end, side + WIDTH / 2)
    return crop, (end, side + WIDTH / 2, 0.0)


def _cut_along(crop: Field, start: float, end: float, y: float) -> None:
    """The machine drives eastward at y, cutting, its rear axle from x = start to end."""
    for a, b in itertools.pairwise(np.linspace(start, end, 1 + round((end - start) / 0.02))):
        crop.cut((float(a), y, 0.0), (float(b), y, 0.0))


def colour_labels(label: NDArray[np.uint8]) -> Picture:
    """The label picture in PALETTE's colours, BGR."""
    table = np.zeros((256, 3), np.uint8)
    for value, (_, colour) in PALETTE.items():
        table[value] = colour
    return np.asarray(table[label], np.uint8)


def _caption(picture: Picture, text: str) -> Picture:
    out = np.ascontiguousarray(picture)
    cv2.rectangle(out, (0, 0), (12 + 11 * len(text), 28), (25, 25, 25), -1)
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(out, text, (6, 20), font, 0.6, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def _legend(width: int) -> Picture:
    strip = np.full((34, width, 3), 250, np.uint8)
    x = 10
    for name, colour in PALETTE.values():
        cv2.rectangle(strip, (x, 9), (x + 16, 25), colour, -1)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(strip, name, (x + 22, 22), font, 0.5, (20, 20, 20), 1, cv2.LINE_AA)
        x += 44 + 9 * len(name)
    return strip


def _through_jpeg(camera: Camera, picture: Picture) -> Picture:
    data = np.frombuffer(camera.encode(picture), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def sheet(name: str, seed: int, mounts: dict[str, CameraSpec]) -> Picture:
    """One contact sheet: a row per mount (two with labels), a column per view."""
    with_labels, views = SHEETS[name]
    rows: list[list[Picture]] = []
    for mount_name, mount in mounts.items():
        pictures, labels = [], []
        for view in views:
            spec = FieldSpec(**SCENERY, **view.crop)
            crop, pose = stage(spec, seed, view.stage)
            weather = WeatherSpec(**view.weather)
            camera = Camera(crop, mount, weather, seed)
            picture = camera.capture(4.0, *pose, v=0.5, blade_on=view.blade)
            picture = _through_jpeg(camera, picture)
            pictures.append(_caption(picture, f"{mount_name}: {view.title}"))
            if with_labels:
                labels.append(colour_labels(camera.labels(4.0, *pose)))
        rows.append(pictures)
        if with_labels:
            rows.append(labels)
    image = np.vstack([np.hstack(r) for r in rows])
    small = cv2.resize(image, None, fx=0.62, fy=0.62, interpolation=cv2.INTER_AREA)
    if with_labels:
        small = np.vstack([small, _legend(small.shape[1])])
    return np.asarray(small, np.uint8)


def drive(seed: int, mount: CameraSpec, seconds: float, fps: float) -> Iterator[Picture]:
    """Pictures of a drive along the southern edge, cutting, with the ground's unevenness and a
    slight snaking; view and label picture side by side."""
    spec = FieldSpec(**SCENERY, lodged=0.05)
    crop, (x, y, yaw) = stage(spec, seed, "start")
    camera = Camera(crop, mount, WeatherSpec(dust=0.5, wind_mps=4.0), seed)
    steps = round(100 / fps)
    for k in range(round(seconds * fps)):
        for n in range(steps):
            t = (k * steps + n) / 100
            rate = 0.06 * math.cos(1.3 * t)
            new = (x + 0.005 * math.cos(yaw), y + 0.005 * math.sin(yaw), yaw + rate / 100)
            crop.cut((x, y, yaw), new)
            x, y, yaw = new
        roll, pitch = crop.bumps(x, y, yaw)
        picture = camera.capture(t, x, y, yaw, roll, pitch, 0.5, rate, blade_on=True)
        label = colour_labels(camera.labels(t, x, y, yaw, roll, pitch, 0.5, rate))
        yield np.hstack([_through_jpeg(camera, picture), label])


def _write_video(path: Path, frames: Iterator[Picture], fps: float) -> None:
    import av  # noqa: PLC0415  (slow to load, and sheets need none of it)

    with av.open(str(path), "w") as container:
        stream = None
        for bgr in frames:
            if stream is None:
                stream = container.add_stream("h264", rate=round(fps))
                stream.height, stream.width = bgr.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.options = {"crf": "26"}
            container.mux(stream.encode(av.VideoFrame.from_ndarray(bgr, format="bgr24")))
        if stream is not None:
            container.mux(stream.encode())
