"""What each part of the bench costs, in a figure that holds on a noisy machine.

    python tools/speed.py                 # today's figures, against the stored baseline
    python tools/speed.py --write         # stores today's as the baseline

For each part: processor seconds per simulated second, over the processor seconds of a fixed kernel
that is timed in the same run, in turn with the part. A busy neighbour slows both, and leaves their
ratio. A neighbour that fills the shared caches slows only what has much data. So there are two
kernels: `memory` misses the nearer caches as pictures, vision and the pilot do, `processor` stays
in them as the firmware, its simulator and JPEG do. Each ratio is the median over the rounds. Exits
with 0 whatever it finds: CI prints it.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from bench_plant import WEATHER, with_firmware
from numba import njit
from numpy.typing import NDArray

from hil.bench.harvest import Harvest
from hil.scenario.scenario import load
from host.core.number_range import WholeRange, argument
from host.core.vehicle import Mount, Vehicle
from host.vision.mounted.detector import make_detector
from sim_plant.camera import LOW, MAST, Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec

BASELINE = Path(__file__).with_name("speed_baseline.json")
PICTURES_PER_S = 10


@njit
def _mixed(table: NDArray[np.float32], rounds: int, shift: np.uint32) -> float:
    """Multiplications, branches and lookups in a table of 2 ** (32 - shift): about 10 ms."""
    x = np.uint32(1)
    total = 0.0
    for _ in range(rounds):
        x = np.uint32(x * np.uint32(1664525) + np.uint32(1013904223))
        value = table[x >> shift]
        total += value * value if value > 0.5 else math.sqrt(value)
    return total


def kernel(bits: int) -> Callable[[], None]:
    """Looks up a table of 2 ** bits floats."""
    table = np.linspace(0, 1, 1 << bits, dtype=np.float32)
    shift = np.uint32(32 - bits)
    return lambda: print(end="" if _mixed(table, 1_500_000, shift) > 0 else "?")


KERNELS: Final = {"memory": kernel(22), "processor": kernel(10)}
"""16 MB and 4 KB."""
ON_PROCESSOR: Final = ("JPEG", "firmware")
"""How the names of parts begin that stay in the nearer caches."""


class Drive:
    """A camera on its way along the crop of a 20 m field, the blade at work."""

    def __init__(self, mount: CameraSpec) -> None:
        self.field = Field(FieldSpec(size_m=(20.0, 20.0)), 1)
        self.field.clear(((-1, -1), (99, -1), (99, 1), (-1, 1)))
        # What the blade has cut by now: without it the camera would stand amid the crop.
        self.field.clear(((-1, 1), (3.5, 1), (3.5, 2), (-1, 2)))
        self.camera = Camera(self.field, mount, WEATHER, 1, threads=1)
        self.k = 0
        self.picture = self.take()

    def take(self) -> NDArray[np.uint8]:
        """The next picture, 5 cm on."""
        x = 2.0 + 0.05 * (self.k % 300)
        self.field.cut((x, 1.5, 0.0), (x + 0.05, 1.5, 0.0))
        rate = 0.1 * math.sin(0.3 * self.k)
        self.picture = self.camera.capture(
            0.1 * self.k, x, 1.5, 0.0, 0.01, 0.01, 0.5, rate, blade_on=True
        )
        self.k += 1
        return self.picture

    def jpeg(self) -> None:
        """Into the file format and back."""
        data = np.frombuffer(self.camera.encode(self.picture), np.uint8)
        cv2.imdecode(data, cv2.IMREAD_COLOR)


def parts() -> dict[str, tuple[float, Callable[[], object]]]:
    """By name: how many of it there are in a simulated second, and it."""
    out: dict[str, tuple[float, Callable[[], object]]] = {}
    for name, mount in (("low", LOW), ("mast", MAST)):
        drive = Drive(mount)
        given = {k: v for k, v in mount.model_dump().items() if k in Mount.model_fields}
        detector = make_detector("robust", Vehicle(), Mount(**given))
        out[f"picture, {name}"] = PICTURES_PER_S, drive.take
        out[f"JPEG there and back, {name}"] = PICTURES_PER_S, drive.jpeg
        out[f"mounted vision, {name}"] = (
            PICTURES_PER_S,
            lambda drive=drive, detector=detector: detector.see(drive.picture),
        )
    return out


def firmware(name: str, seconds: float) -> float:
    """Processor seconds per simulated second of firmware and machine."""
    return 1.0 / with_firmware(name, seconds)


class Loop:
    """A harvest of the default field. By the model of the eyes, which leaves out pictures and
    vision, it costs what firmware, machine, field, link and pilot cost."""

    def __init__(self, eyes: str, firmware: str) -> None:
        self.run = Harvest(load("default", {"eyes": eyes, "firmware": firmware}))
        self.pilot_s = 0.0
        step = self.run.pilot.step

        def timed(*args: Any) -> Any:
            begin = time.process_time()
            command = step(*args)
            self.pilot_s += time.process_time() - begin
            return command

        self.run.pilot.step = timed  # type: ignore[method-assign]

    def drive(self, seconds: float) -> tuple[float, float]:
        """Processor seconds per simulated second: of the pilot, and of it all."""
        until, pilot_s = self.run.bench.now + seconds, self.pilot_s
        whole = spent(lambda: self.run.run(enough=lambda: self.run.bench.now >= until))
        return (self.pilot_s - pilot_s) / seconds, whole / seconds


def spent(work: Callable[[], object]) -> float:
    """Processor seconds of one call."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


class Costs:
    """Processor seconds per simulated second by part, and their ratios to the part's kernel."""

    def __init__(self) -> None:
        self.cost: dict[str, list[float]] = {}
        self.ratio: dict[str, list[float]] = {}
        self.kernel: dict[str, list[float]] = {name: [] for name in KERNELS}
        for work in KERNELS.values():
            work()

    def time(self, names: tuple[str, ...], work: Callable[[], tuple[float, ...]]) -> None:
        """Notes what work says that these parts cost, between two runs of the kernels they need."""
        kinds = ["processor" if name.startswith(ON_PROCESSOR) else "memory" for name in names]
        before = {kind: spent(KERNELS[kind]) for kind in kinds}
        costs = work()
        after = {kind: spent(KERNELS[kind]) for kind in kinds}
        for kind, seconds in before.items():
            self.kernel[kind] += seconds, after[kind]
        for name, kind, seconds in zip(names, kinds, costs, strict=True):
            self.cost.setdefault(name, []).append(seconds)
            self.ratio.setdefault(name, []).append(2 * seconds / (before[kind] + after[kind]))

    def medians(self) -> dict[str, tuple[float, float]]:
        """By part: processor ms per simulated second, and that over its kernel's ms."""
        return {
            name: (1e3 * float(np.median(seconds)), float(np.median(self.ratio[name])))
            for name, seconds in self.cost.items()
        }


def measure(rounds: int, drives: int, avr: bool) -> Costs:
    """All parts: a picture's so many times, what takes seconds a time so many `drives`."""
    costs, each = Costs(), parts()
    # As a campaign does: what is imported is not looked through for garbage.
    gc.collect()
    gc.freeze()
    for _, work in each.values():
        work()
    for _ in range(rounds):
        for name, (per_s, work) in each.items():
            costs.time((name,), lambda per_s=per_s, work=work: (per_s * spent(work),))
    boards = ("desk", "avr") if avr else ("desk",)
    for eyes, board in itertools.product(("model", "picture"), boards):
        loop = Loop(eyes, board)
        loop.drive(15.0)
        harvest = f"harvest by {'pictures' if eyes == 'picture' else 'the model'}, {board}"
        names = ("pilot", harvest) if (eyes, board) == ("model", "desk") else (harvest,)
        for _ in range(drives):
            costs.time(names, lambda loop=loop, names=names: loop.drive(10.0)[-len(names) :])
        loop.run.close()
    for board in boards:
        firmware(board, 1.0)
        for _ in range(drives):
            seconds = 60.0 if board == "desk" else 3.0
            costs.time(
                (f"firmware and plant, {board}",), lambda b=board, s=seconds: (firmware(b, s),)
            )
    return costs


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--rounds", type=argument(WholeRange(1)), default=40, help="of a picture and of its parts"
    )
    parser.add_argument(
        "--drives", type=argument(WholeRange(1)), default=5, help="of a harvest, 10 s each"
    )
    parser.add_argument("--no-avr", action="store_true", help="leave the AVR binary out")
    parser.add_argument("--write", action="store_true", help="stores these figures as the baseline")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    costs = measure(args.rounds, args.drives, not args.no_avr)
    found = costs.medians()
    stored = json.loads(BASELINE.read_text()) if BASELINE.exists() else {}
    kernels = ", ".join(f"{n} {1e3 * float(np.median(v)):.1f} ms" for n, v in costs.kernel.items())
    print(f"reference kernels: {kernels}")
    print(f"{'part':28}  ms per simulated s   times real time   per kernel   stored   change")
    for name, (cost_ms, ratio) in found.items():
        before = stored.get(name)
        change = f"{before:7.3f}  {100 * (ratio / before - 1):+6.0f} %" if before else "      -"
        print(f"{name:28}  {cost_ms:18.2f}   {1e3 / cost_ms:15.1f}   {ratio:10.3f}  {change}")
    if args.write:
        kept = {name: round(ratio, 3) for name, (_, ratio) in found.items()}
        BASELINE.write_text(json.dumps({**stored, **kept}, indent=1) + "\n")


if __name__ == "__main__":
    main()
