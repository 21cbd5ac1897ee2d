"""The compiled loop over slices of 10 ms: the ground under the machine, firmware and machine, the
blade in the crop, the gyroscope. All slices up to the host's next step take one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hil.firmware import coupling
from hil.firmware.coupling import Native, entry_point
from hil.firmware.real_board import Board, Controller
from hil.firmware.targets import Target
from sim_plant import machine
from sim_plant.field import Field, Figures, mow, slopes_at
from sim_plant.gyro import Floats, Gyro, Part, Sample, feel

SLICE_US: Final = 10_000
"""Serial bytes are stamped to this."""
SLICES_PER_CUT: Final = 2
"""The blade cuts every 10 ms: 5 mm of way."""
MOST_SLICES: Final = 64
"""In one call."""
SAID_BYTES: Final = 4096
"""What is kept of a slice: forty times what the line carries in it."""

TALLY: Final = np.dtype(
    [
        ("cells", np.int64),  # cut
        ("j0", np.int64),  # around what changed, half-open
        ("j1", np.int64),
        ("i0", np.int64),
        ("i1", np.int64),
        ("samples", np.int64),  # of the gyroscope
        ("x", np.float64),  # where the next cut begins
        ("y", np.float64),
        ("yaw", np.float64),
    ],
    align=True,
)


class Around(NamedTuple):
    """The field and the gyroscope of a bench, as the compiled loop has them."""

    figures: Figures
    kind: NDArray[np.uint8]
    counts: NDArray[np.int64]
    """Of the field."""
    blade: tuple[float, float]
    """Its line ahead of the rear axle, and its width, m."""
    every: int
    """Slices between two samples of the gyroscope; 0: there is none."""
    part: Part
    axes: Floats
    offset: Floats
    """Of the gyroscope."""
    felt: Floats
    """(MOST_SLICES, 6) its samples."""


@njit(cache=True, nogil=True)
def _clear(tally: Any) -> None:
    """Nothing has been cut or felt yet."""
    t = tally[0]
    t.cells, t.samples = 0, 0
    t.j0, t.j1, t.i0, t.i1 = 1 << 30, 0, 1 << 30, 0


@njit(cache=True, nogil=True)
def _begin(number: int, figures: Figures, state: Any, given: Any, tally: Any) -> None:
    """The ground under the machine, and where the blade's next cut begins."""
    if number % SLICES_PER_CUT == 0:
        s, t, u = state[0], tally[0], given[0]
        u.roll, u.pitch = slopes_at(figures, s.x, s.y, s.yaw)
        t.x, t.y, t.yaw = s.x, s.y, s.yaw


@njit(cache=True, nogil=True)
def _end(number: int, state: Any, given: Any, tally: Any, around: Around, drawn: Floats) -> None:
    """What the blade has cut, and every so many slices a sample of the gyroscope."""
    s, t, u = state[0], tally[0], given[0]
    figures, every = around.figures, around.every
    ahead_m, width_m = around.blade
    if (number + 1) % SLICES_PER_CUT == 0:
        cut = 0
        if s.blade_spinning != 0:
            box = np.empty(4, np.int64)
            old, new = (t.x, t.y, t.yaw), (s.x, s.y, s.yaw)
            cut = mow(figures, around.kind, old, new, ahead_m, width_m, around.counts, box)
            t.cells += cut
            if box[0] < box[1]:
                t.j0, t.j1 = min(t.j0, box[0]), max(t.j1, box[1])
                t.i0, t.i1 = min(t.i0, box[2]), max(t.i1, box[3])
        step = max(1e-6, abs(s.v) * SLICE_US * 1e-6 * SLICES_PER_CUT)
        full = width_m * step / figures.cell_m**2
        u.cutting = min(1.0, cut / full)
    if every > 0 and (number + 1) % every == 0:
        k = t.samples
        feel(
            around.part, around.axes, around.offset, drawn[k], s.yaw_rate, u.roll, u.pitch, s.v,
            around.felt[k],
        )  # fmt: skip
        t.samples += 1


@njit(cache=True, nogil=True)
def _together(
    run_until: Any,
    set_analog: Any,
    set_pin: Any,
    output: Any,
    read: Any,
    handle: int,
    first: int,
    count: int,
    said: NDArray[np.uint8],
    sizes: NDArray[np.int64],
    params: Any,
    wires: Any,
    log: Any,
    layout: Any,
    state: Any,
    given: Any,
    tally: Any,
    around: Around,
    drawn: Floats,
) -> int:
    """Slices with a firmware whose functions the loop may call. Returns the target's status, and in
    `sizes` how many bytes each slice said, -1 where it did not come to its end."""
    _clear(tally)
    sizes[:] = -1
    for k in range(count):
        number = first + k
        _begin(number, around.figures, state, given, tally)
        status: int = coupling.run(
            run_until, set_analog, set_pin, output, handle, number * SLICE_US,
            (number + 1) * SLICE_US, state, params, given, wires, log, layout,
        )  # fmt: skip
        if status != 0:
            return status
        sizes[k] = read(handle, said[k].ctypes, said.shape[1])
        _end(number, state, given, tally, around, drawn)
    return 0


Run = Callable[[int, int, Floats], int]
"""Of first, count and what was drawn for the gyroscope: the target's status."""


class Slices:
    """Those of one bench."""

    def __init__(
        self,
        field: Field,
        gyro: Gyro,
        records: tuple[machine.Record, machine.Record, machine.Record],
        blade: tuple[float, float],
        target: Controller,
        wires: machine.Record,
        layout: machine.Record,
    ) -> None:
        """`records`: machine.STATE, PARAMS and INPUTS, (1,) each; `blade`: its line ahead of the
        rear axle and its width, m; `layout`: what the pins are wired to; of a real board, which
        bridges take its duties."""
        self._field, self._gyro, self._records = field, gyro, records
        every = max(1, round(1e6 / gyro.spec.rate_hz / SLICE_US)) if gyro.spec.fitted else 0
        self._around = Around(
            field.figures, field.kind, field.counts, blade, every, gyro.part, gyro.axes,
            gyro.offset, np.zeros((MOST_SLICES, 6)),
        )  # fmt: skip
        self._tally = np.zeros(1, TALLY)
        self._said = np.zeros((MOST_SLICES, SAID_BYTES), np.uint8)
        self._sizes = np.zeros(MOST_SLICES, np.int64)
        self._run: Run = (
            self._on_board(target, wires, layout)
            if isinstance(target, Board)
            else self._on_target(target, wires, layout)
        )
        self.cells = 0
        """Cut during the last `run`."""
        self.samples: list[Sample] = []
        """Taken during the last `run`."""

    def _on_target(self, target: Controller, wires: machine.Record, layout: machine.Record) -> Run:
        assert isinstance(target, Target)
        state, params, given = self._records
        f = target.pointers
        functions = tuple(
            Native(k) for k in (f.run_until, f.set_analog_mv, f.set_pin, f.output, f.read)
        )
        first = (*functions, target.handle)
        fixed = (
            self._said, self._sizes, params, wires, coupling.NO_LOG, layout, state, given,
            self._tally, self._around,
        )  # fmt: skip
        entry = entry_point(_together, (*first, 0, 0, *fixed, np.empty((0, 9))))
        return lambda number, count, drawn: int(entry(*first, number, count, *fixed, drawn))

    def _on_board(self, board: Board, wires: machine.Record, layout: machine.Record) -> Run:
        state, params, given = self._records
        around, tally = self._around, self._tally
        inner = board.bind(state, params, given, wires, layout)

        def run(first: int, count: int, drawn: Floats) -> int:
            _clear(tally)
            self._sizes[:] = -1
            for k in range(count):
                number = first + k
                _begin(number, around.figures, state, given, tally)
                inner(number * SLICE_US, (number + 1) * SLICE_US)
                said = np.frombuffer(board.read(), np.uint8)[:SAID_BYTES]
                self._said[k, : len(said)], self._sizes[k] = said, len(said)
                _end(number, state, given, tally, around, drawn)
            return 0

        return run

    def run(self, first: int, count: int) -> tuple[int, list[bytes]]:
        """`count` slices, MOST_SLICES at most, from number `first` on. Returns the target's status
        and what the firmware sent in each slice that came to its end: where the status is not 0, it
        crashed in the next."""
        every = self._around.every
        due = (first + count) // every - first // every if every else 0
        status = self._run(first, count, self._gyro.drawn(due))
        sizes = self._sizes[:count].tolist()
        said = [
            self._said[k, :size].tobytes() if size else b""
            for k, size in enumerate(sizes)
            if size >= 0
        ]
        self.cells, *changed, samples, _, _, _ = self._tally[0].item()
        self._field.changed(*changed)
        numbers = range(first + every - first % every, first + count + 1, every) if every else ()
        taken = zip(numbers, self._around.felt[:samples], strict=False)
        self.samples = [self._gyro.sampled(k * SLICE_US / 1e6, felt) for k, felt in taken]
        return status, said
