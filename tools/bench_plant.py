"""What the simulated world costs: `python tools/bench_plant.py [--quick] [--no-avr]`.

Camera: 640x480 with everything on (wind, dust, haze, lens, rolling shutter, motion blur, noise,
exposure, JPEG), per mount and number of threads, then against field size and stalk density. Plant:
the machine alone, with the desk firmware and with the AVR binary in the loop, armed and steering.
CPU time is of the whole process, so that a busy neighbour shows as wall time only.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable

import cv2
import numpy as np
from numba import njit

from hil.firmware import coupling, provision
from host.core.errors import UserError
from host.link import protocol
from sim_plant import machine
from sim_plant.camera import LOW, MAST, Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.machine import MachineSpec
from sim_plant.sky import WeatherSpec

WEATHER = WeatherSpec(dust=0.5, wind_mps=5.0, haze=0.01)


def _timed(work: Callable[[int], None], count: int) -> tuple[float, float]:
    """(median wall ms, mean CPU ms) of `work(k)`."""
    wall = []
    cpu = time.process_time()
    for k in range(count):
        begin = time.perf_counter()
        work(k)
        wall.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(wall)), 1e3 * (time.process_time() - cpu) / count


def camera_cost(
    spec: FieldSpec, mount: CameraSpec, threads: int, frames: int
) -> tuple[float, float]:
    """(wall, CPU) ms per frame while cutting the second ring of a field at 0.5 m/s and 10 Hz."""
    crop = Field(spec, 1)
    crop.clear(((-1, -1), (99, -1), (99, 1), (-1, 1)))
    camera = Camera(crop, mount, WEATHER, 1, threads=threads)
    cv2.setNumThreads(threads)

    def frame(k: int) -> None:
        x = 0.05 * k
        crop.cut((x, 1.5, 0.0), (x + 0.05, 1.5, 0.0))
        rate = 0.1 * math.sin(0.3 * k)
        camera.encode(camera.capture(0.1 * k, x, 1.5, 0.0, 0.01, 0.01, 0.5, rate, blade_on=True))

    for k in range(3):
        frame(k)
    return _timed(lambda k: frame(k + 3), frames)


@njit
def _alone(state: machine.Record, params: machine.Record, given: machine.Record, n: int) -> None:
    for k in range(n):
        given[0].steer_duty = 0.5 if k % 1000 < 500 else -0.5
        machine.step(state, params, given, 0.001)


def _records() -> tuple[machine.Record, machine.Record, machine.Record]:
    spec = MachineSpec()
    given = machine.inputs()
    given["drive_duty"] = 0.5
    return machine.initial(spec), machine.parameters(spec, 1), given


def plant_alone(seconds: float) -> float:
    """Simulated over CPU time of the machine without firmware."""
    state, params, given = _records()
    _alone(state, params, given, 10)
    begin = time.process_time()
    _alone(state, params, given, round(1000 * seconds))
    return seconds / (time.process_time() - begin)


def with_firmware(name: str, seconds: float) -> float:
    """Simulated over CPU time of machine and firmware, armed, commanded at 10 Hz."""
    state, params, given = _records()
    with provision.fitted(name) as target:  # type: ignore[arg-type]
        run = coupling.bind(target, state, params, given)
        run(0, 1000)
        now, seq = 1000, itertools.count()
        begin = 0.0
        for k in itertools.count(-5):
            if k == 0:
                begin = time.process_time()
            if k == round(10 * seconds):
                break
            steer = 0.5 if k % 20 < 10 else -0.5
            order: protocol.Message = protocol.Drive(steer=steer, speed=0.5, blade=1)
            if k < -1:
                order = protocol.Clear()
            elif k < 0:
                order = protocol.Arm(protocol_version=protocol.VERSION)
            target.write(protocol.encode(order, next(seq) % 256))
            if run(now, now + 100_000) != 0:
                raise UserError(f"the {name} firmware crashed at {now / 1e6:.1f} s")
            now += 100_000
            target.read()
        spent = time.process_time() - begin
    if abs(float(state[0]["distance"])) < 0.1 * seconds:
        raise UserError(f"the {name} firmware did not drive: the figure would be of an idle loop")
    return seconds / spent


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few frames, small fields")
    parser.add_argument("--no-avr", action="store_true", help="leave the AVR binary out")
    parser.add_argument("--no-camera", action="store_true", help="the plant only")
    args = parser.parse_args()
    frames = 20 if args.quick else 100

    print("plant without camera (times real time, one core)")
    print(f"  machine alone            {plant_alone(100):10.0f}")
    print(f"  with the desk firmware   {with_firmware('desk', 60):10.0f}")
    if not args.no_avr:
        print(f"  with the AVR binary      {with_firmware('avr', 10):10.1f}")
    if args.no_camera:
        return

    print("\ncamera 640x480, everything on, 10 m field, 400 stalks/m2")
    print("  mount  threads   wall ms    CPU ms   frames/s")
    for (name, mount), threads in itertools.product((("low", LOW), ("mast", MAST)), (1, 2)):
        wall, cpu = camera_cost(FieldSpec(), mount, threads, frames)
        print(f"  {name:5}  {threads:7}  {wall:8.1f}  {cpu:8.1f}  {1e3 / wall:9.0f}")

    print("\ncamera, mast, 2 threads: wall ms (CPU ms) per frame")
    densities = (200, 400, 800)
    print("  field m" + "".join(f"{d:>10} /m2" for d in densities))
    for size in (10, 20) if args.quick else (10, 20, 50):
        cells = []
        for density in densities:
            spec = FieldSpec(size_m=(size, size), stalks_per_m2=density)
            wall, cpu = camera_cost(spec, MAST, 2, frames // 2)
            cells.append(f"{wall:6.1f} ({cpu:4.1f})")
        print(f"  {size:7}" + "".join(f"{c:>14}" for c in cells))


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        raise SystemExit(f"bench_plant: {error}") from None
