"""Pictures of known poses around a half-cut field, for judging the detectors against the truth.

python tools/vision_poses.py --mount low --count 200 --mode robust
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Vehicle
from sim_plant.camera import Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.sky import WeatherSpec

SIDE_M = 9.0


@dataclass(frozen=True, slots=True)
class Pose:
    """One picture and what is true of it."""

    kind: str
    bgr: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    offset_m: float
    heading_rad: float
    ahead_m: float
    note: str


def poses(
    mount: str, count: int, seed: int, overlap_m: float = 0.05, kinds: str = "follow,approach,end"
) -> Iterator[Pose]:
    """`count` pictures over hours, rings, offsets, headings and distances."""
    rng = np.random.default_rng(seed)
    vehicle = Vehicle()
    choice = kinds.split(",")
    for n in range(count):
        kind = choice[n % len(choice)]
        ring = int(rng.integers(0, 4))
        hour = float(rng.uniform(9, 16))
        spec = FieldSpec(
            size_m=(SIDE_M, SIDE_M),
            drilled=bool(rng.random() < 0.3),
            crop_height_m=float(rng.uniform(0.8, 1.0)),
            windrow_m=(0.1, 0.45),
        )
        field = Field(spec, seed=int(rng.integers(1 << 30)))
        weather = WeatherSpec(
            hour=hour,
            dust=float(rng.uniform(0, 0.5)),
            wind_mps=float(rng.uniform(0, 5)),
            cloud=float(rng.random() < 0.2),
        )
        quarter = int(rng.integers(4))
        turn = quarter * math.pi / 2

        def world(x: float, y: float, k: int = quarter) -> tuple[float, float]:
            """The field's south side is followed in a frame turned by quarters about its middle."""
            dx, dy = x - SIDE_M / 2, y - SIDE_M / 2
            for _ in range(k):
                dx, dy = -dy, dx
            return dx + SIDE_M / 2, dy + SIDE_M / 2

        def clear(x0: float, y0: float, x1: float, y1: float, f: Field = field) -> None:
            corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
            f.clear(tuple(world(*c) for c in corners))

        swath = vehicle.blade_width_m - overlap_m
        depth = ring * swath
        far = 30.0
        if ring:
            clear(-far, -far, far, depth)
            clear(SIDE_M - depth, -far, far, far)
            clear(-far, SIDE_M - depth, far, far)
        start = depth + swath if kind == "approach" else depth
        reach = 1.2 if ring == 0 else 2.0
        clear(-far, -far, start, far)
        offset = float(rng.uniform(-0.3, 0.3) if kind != "end" else rng.uniform(-0.1, 0.1))
        heading = math.radians(
            float(rng.uniform(-15, 15) if kind == "follow" else rng.uniform(-6, 6))
        )
        # the blade's right end is `overlap` to the right of the edge at offset 0
        expected = -(vehicle.blade_width_m / 2 - overlap_m)
        if kind == "follow":
            bx = float(rng.uniform(start + 0.5, SIDE_M - depth - 0.6))
        elif kind == "approach":
            bx = start - float(rng.uniform(0.0, reach))
        else:
            bx = SIDE_M - depth + float(rng.uniform(-0.8, 0.6))
        # the edge lies at `expected + offset` across the vehicle from the blade's middle
        yaw = heading
        x = bx - vehicle.blade_x_m * math.cos(yaw)
        y = depth - (expected + offset) * math.cos(yaw) - vehicle.blade_x_m * math.sin(yaw)
        wx, wy = world(x, y)
        wyaw = yaw + turn
        if kind != "approach":
            back = 3.0
            steps = 60
            for i in range(steps):
                a = -back + back * i / steps
                b = -back + back * (i + 1) / steps
                c, s = math.cos(wyaw), math.sin(wyaw)
                field.cut((wx + a * c, wy + a * s, wyaw), (wx + b * c, wy + b * s, wyaw))
            # whatever stood right of the path so far went with the way here
            c, s = math.cos(yaw), math.sin(yaw)
            right = [
                (-2.0, -0.5),
                (vehicle.blade_x_m, -0.5),
                (vehicle.blade_x_m, -4.0),
                (-2.0, -4.0),
            ]
            field.clear(tuple(world(x + a * c - b * s, y + a * s + b * c) for a, b in right))
        m = {"low": LOW, "mast": MAST}[mount]
        camera = Camera(
            field,
            CameraSpec(x_m=m.x_m, y_m=m.y_m, z_m=m.z_m, pitch_deg=m.pitch_deg, hfov_deg=m.hfov_deg),
            weather,
            seed=int(rng.integers(1 << 30)),
        )
        roll, pitch = field.slopes(wx, wy, wyaw)
        t = float(rng.uniform(0, 100))
        bgr = camera.capture(t, wx, wy, wyaw, roll, pitch, 0.5, 0.0, kind != "approach")
        bgr = cv2.imdecode(np.frombuffer(camera.encode(bgr), np.uint8), cv2.IMREAD_COLOR)
        labels = camera.labels(t, wx, wy, wyaw, roll, pitch, 0.5, 0.0, kind != "approach")
        blade = (
            wx + (vehicle.blade_x_m + 0.05) * math.cos(wyaw),
            wy + (vehicle.blade_x_m + 0.05) * math.sin(wyaw),
        )
        ahead = field.crop_ahead(
            wx + vehicle.blade_x_m * math.cos(wyaw), wy + vehicle.blade_x_m * math.sin(wyaw), wyaw
        )
        true = offset
        if kind == "follow":
            edge = field.true_edge_offset(*blade, wyaw)
            true = edge - expected
        note = (
            f"{kind} ring {ring} h {hour:.1f} q {quarter} off {true:+.2f} "
            f"head {math.degrees(-heading):+.1f} ahead {ahead:.2f}"
        )
        yield Pose(kind, bgr, labels, true, -heading, ahead, note)
