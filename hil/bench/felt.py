"""What the host reads in the answer of the phone's app, without the answer: in lockstep it would
take a twentieth of all that is done to write and to read it. A rig's phone serves the text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from host.sensors.gyro import Samples
from sim_plant.gyro import Sample

DIGITS: Final = 6
"""Of a reading, that the text keeps; of the phone's time, whole milliseconds."""


def heard(samples: Iterable[Sample]) -> tuple[Samples, Samples]:
    """`host.sensors.gyro.parsed` of `sim_plant.gyro.sensors_json`."""
    clock: list[float] = []
    rates: list[tuple[float, float, float]] = []
    forces: list[tuple[float, float, float]] = []
    for clock_s, (x, y, z), (fx, fy, fz) in samples:
        clock.append(round(clock_s * 1e3) / 1e3)
        rates.append((round(x, DIGITS), round(y, DIGITS), round(z, DIGITS)))
        forces.append((round(fx, DIGITS), round(fy, DIGITS), round(fz, DIGITS)))
    return Samples(clock, rates), Samples(clock, forces)
