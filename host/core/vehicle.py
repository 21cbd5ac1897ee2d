"""The machine as the host believes it to be: one typed, validated file.

The simulated plant has a truth of its own. `hil` derives this file from that, with the errors of an
owner who measures.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from host.core.strict import Strict

Positive = Annotated[float, Field(gt=0)]
Metres = Annotated[float, Field(gt=0, le=10)]
Near = Annotated[float, Field(ge=-10, le=10)]
"""Metres in the vehicle frame."""
Speed = Annotated[float, Field(gt=0, le=3)]
"""m/s; the firmware takes no more."""
Angle = Annotated[float, Field(ge=-180, le=180)]
"""Degrees."""


class Mount(Strict):
    """Where the camera sits in the vehicle frame (x forward from the rear axle, y left, z up) and
    how it looks. Pitch is positive downward, yaw positive to the left, roll positive clockwise as
    seen from behind. Pinhole intrinsics follow from width, height and hfov unless `calibrate
    camera` measured them (focal_px, centre_px, distortion k1, k2, p1, p2, k3 as in OpenCV)."""

    x_m: Near
    y_m: Near = 0.0
    z_m: Metres
    pitch_deg: Annotated[float, Field(ge=-90, le=90)]
    yaw_deg: Angle = 0.0
    roll_deg: Angle = 0.0
    width_px: Annotated[int, Field(ge=16, le=8192)] = 640
    height_px: Annotated[int, Field(ge=16, le=8192)] = 480
    hfov_deg: Annotated[float, Field(gt=10, lt=150)] = 62.0
    focal_px: Positive | None = None
    centre_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        if self.focal_px is not None:
            return self.focal_px
        return self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)

    @property
    def lens_measured(self) -> bool:
        """Whether more is known of the lens than its data sheet says."""
        return self.focal_px is not None or any(self.distortion)

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point (u, v) in pixels."""
        return self.centre_px or (self.width_px / 2, self.height_px / 2)


LOW = Mount(x_m=0.1, z_m=0.6, pitch_deg=5.0)
"""Below the crop's top, as the paper's end-of-field rule needs."""
MAST = Mount(x_m=0.0, z_m=1.6, pitch_deg=28.0)
"""Looking over the crop; sees the blade's line at its lower border."""


class Vehicle(Strict):
    """Tricycle: the front wheel steers, the two rear wheels drive together.

    The vehicle frame's origin is on the ground below the rear axle's middle; x forward, y left."""

    wheelbase_m: Metres = 1.0
    steer_limit_deg: Annotated[float, Field(gt=0, lt=80)] = 50.0
    half_width_m: Metres = 0.4
    """Body and wheels, the blade apart."""
    rear_overhang_m: Annotated[float, Field(ge=0, le=10)] = 0.25
    """From the rear axle to the body's rear end."""
    blade_width_m: Metres = 1.0
    blade_ahead_m: Near = 0.5
    """The blade's line, ahead of the front axle."""
    blade_height_m: Annotated[float, Field(gt=0, le=2)] = 0.12
    cutting_speed_mps: Speed = 0.5
    manoeuvre_speed_mps: Speed = 0.3
    follow_frequency_1pm: Annotated[float, Field(gt=0, le=20)] = 1.14
    """Of the steering law beside the edge, in radians a metre travelled: how briskly it returns."""
    follow_damping: Annotated[float, Field(gt=0, le=10)] = 0.92
    """Of the same: below 0.7 it swings."""
    full_duty_speed_mps: Annotated[float, Field(gt=0, le=10)] = 1.1
    """Speed on level stubble at a drive duty of 255 and the nominal battery voltage."""
    dead_duty: Annotated[float, Field(ge=0, lt=0.5)] = 0.07
    """Share of the full duty that only just overcomes bridge and friction."""
    nominal_battery_v: Annotated[float, Field(gt=0, le=60)] = 12.0
    hall_pulses_per_m: Annotated[float, Field(ge=0, le=500)] = 50.0
    """Of the drive wheels' hall sensor (paper, II: "the accuracy of the motors can be increased by
    using hall sensors"); 0: none fitted, the speed is a model of the duty then."""
    hall_left_m: Near = 0.35
    """How far left of the machine's middle the wheel runs that carries the sensor's magnets, to the
    middle of its tread; 0: they turn with the axle, before a differential."""
    drive_lag_s: Annotated[float, Field(gt=0, le=10)] = 0.25
    """First-order lag from drive duty to speed."""
    crop_height_m: Annotated[float, Field(gt=0, le=5)] = 0.9
    overlap_m: Annotated[float, Field(ge=0, lt=0.5)] = 0.08
    """How far the blade's right end runs outside the crop's edge, so that no sliver stays."""
    steering_law: Literal["state", "proportional"] = "state"
    """`state`: offset, heading and curvature; `proportional`: the paper's
    (host/pilot/steering_law.py)."""
    steer_lag_s: Annotated[float, Field(gt=0, lt=1)] = 0.15
    """From the angle asked for to the angle driven: the closed steering loop as a first order."""
    camera_delay_s: Annotated[float, Field(ge=0, lt=2)] = 0.1
    """From the shutter to the host, where a source cannot tell."""
    mounts: dict[str, Mount] = Field(default_factory=lambda: {"low": LOW, "mast": MAST})

    @model_validator(mode="after")
    def _the_blade_cuts(self) -> Vehicle:
        if self.overlap_m > self.blade_width_m / 2:
            raise ValueError(
                f"overlap_m {self.overlap_m:g} is more than half of blade_width_m "
                f"{self.blade_width_m:g}: nothing would be cut"
            )
        if self.half_width_m > self.blade_width_m / 2:
            raise ValueError(
                f"half_width_m {self.half_width_m:g} is more than half of blade_width_m "
                f"{self.blade_width_m:g}: the wheels would roll crop down. It is measured from the "
                "machine's middle to the outside of its wheels"
            )
        if abs(self.hall_left_m) > self.half_width_m:
            raise ValueError(
                f"hall_left_m {self.hall_left_m:g} lies outside of half_width_m "
                f"{self.half_width_m:g}: no wheel runs there. Give it in the file (without it a "
                f"machine has {Vehicle.model_fields['hall_left_m'].default:g}): from the machine's "
                "middle to the middle of the tread of the wheel with the sensor, positive to the "
                "left, negative to the right; 0 where the sensor counts the axle before a "
                "differential"
            )
        if self.blade_x_m <= 0:
            raise ValueError(
                f"blade_ahead_m {self.blade_ahead_m:g} puts the blade behind the rear axle: the "
                "wheels would roll crop down. It is measured from the front axle, forward"
            )
        if self.blade_height_m >= self.crop_height_m:
            raise ValueError(
                f"blade_height_m {self.blade_height_m:g} is not below crop_height_m "
                f"{self.crop_height_m:g}: nothing would be cut"
            )
        return self

    def duty_speed(self, duty: int, battery_v: float) -> float:
        """Steady speed (m/s) at a signed drive duty (-255..255) on level stubble."""
        effective = abs(duty) / 255 * battery_v / self.nominal_battery_v - self.dead_duty
        speed = max(0.0, effective) / (1 - self.dead_duty) * self.full_duty_speed_mps
        return math.copysign(speed, duty)

    @property
    def pass_m(self) -> float:
        """What a full pass takes off the crop: the blade's width less the overlap."""
        return self.blade_width_m - self.overlap_m

    @property
    def inset_m(self) -> float:
        """How far inside the crop's edge the blade's middle runs."""
        return self.blade_width_m / 2 - self.overlap_m

    @property
    def blade_x_m(self) -> float:
        """The blade's line in the vehicle frame."""
        return self.wheelbase_m + self.blade_ahead_m
