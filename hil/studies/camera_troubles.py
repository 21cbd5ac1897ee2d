"""What may be wrong with a camera, for judging how a detector bears it: by name, a setting of the
scenario's lens drawn from a range, and the weather that it takes to show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from sim_plant.camera import CameraSpec
from sim_plant.sky import WeatherSpec

NONE: Final = "none"
Range = tuple[float, float]
Key = tuple[int, int]
"""A drive's seed and number."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One kind of trouble; how bad it is differs from drive to drive."""

    disturbance: Mapping[str, Range] = field(default_factory=dict)
    """Of `DisturbanceSpec`."""
    camera: Mapping[str, Any] = field(default_factory=dict)
    """Of `CameraSpec`, outright."""
    jpeg_quality: Range | None = None
    hour: Range | None = None
    """A clear sky with the sun ahead of a machine that drives east."""

    def lens(self, key: Key) -> dict[str, Any]:
        """A scenario's `lens` for one drive."""
        rng = np.random.default_rng((*key, 2))
        drawn: dict[str, Any] = {k: float(rng.uniform(*r)) for k, r in self.disturbance.items()}
        if "straws" in drawn:
            drawn["straws"] = round(drawn["straws"])
        out = dict(self.camera)
        if drawn:
            out["disturbance"] = drawn
        if self.jpeg_quality is not None:
            out["jpeg_quality"] = round(float(rng.uniform(*self.jpeg_quality)))
        return out

    def air(self, weather: WeatherSpec, key: Key) -> WeatherSpec:
        """The weather of one drive."""
        if self.hour is None:
            return weather
        rng = np.random.default_rng((*key, 3))
        return weather.model_copy(update={"hour": float(rng.uniform(*self.hour)), "cloud": 0.0})


def of_size(width_px: int, height_px: int) -> Trouble:
    """Pictures of another size by the same phone. Its sensor has 4:3 and sees 62° along its longer
    side; a wide picture leaves out rows, an upright one is the phone turned by a quarter."""
    usual = CameraSpec().hfov_deg
    longer, shorter = max(width_px, height_px), min(width_px, height_px)
    across = usual
    if width_px < height_px:
        tangent = math.tan(math.radians(usual) / 2) * shorter / longer
        across = math.degrees(2 * math.atan(tangent))
    return Trouble(camera={"width_px": width_px, "height_px": height_px, "hfov_deg": across})


FORMATS: Final[Mapping[str, Trouble]] = {
    f"{width}x{height}": of_size(width, height)
    for width, height in (
        (320, 240), (426, 240), (854, 480), (480, 640), (480, 854), (1440, 1080), (1920, 1080),
        (1080, 1440), (1080, 1920),
    )
}  # fmt: skip
"""4:3 and 16:9 at 240 to 1080 rows, lying and upright."""
DISTURBED: Final[Mapping[str, Trouble]] = {
    "white balance": Trouble({"white_balance_mired": (30.0, 120.0)}),
    "exposure": Trouble({"hunting_ev": (0.5, 2.0)}),
    "flare": Trouble({"flare": (0.1, 1.0)}, hour=(7.0, 9.0)),
    "spots": Trouble({"spots": (0.03, 0.4)}),
    "straw": Trouble({"straws": (1, 10)}),
    "mud": Trouble({"mud": (0.03, 0.35)}),
    "shake": Trouble({"shake_deg": (0.1, 1.5), "shake_hz": (15.0, 60.0)}),
    "JPEG": Trouble(jpeg_quality=(5, 25)),
    "all": Trouble(
        {
            "white_balance_mired": (0.0, 60.0),
            "hunting_ev": (0.0, 1.0),
            "flare": (0.0, 0.5),
            "spots": (0.0, 0.1),
            "straws": (0, 3),
            "mud": (0.0, 0.08),
            "shake_deg": (0.0, 0.5),
        },
        jpeg_quality=(20, 60),
    ),
}
TROUBLES: Final[Mapping[str, Trouble]] = {NONE: Trouble(), **DISTURBED, **FORMATS}
"""Every one, by name."""
