"""A bench's camera in lockstep, as an experiment of the host's is given one."""

from __future__ import annotations

from collections import deque

from hil.bench.lockstep import Bench
from host.sensors.camera_stream import Picture


class YardCamera:
    """Takes a picture whenever one is due and it is looked at, and shows it after the delay of the
    scenario's lens."""

    problem: str | None = None

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._next = bench.now
        self._under_way: deque[Picture] = deque()

    def take(self) -> Picture | None:
        """The newest picture that has arrived since."""
        bench, lens = self._bench, self._bench.world.lens
        if bench.now >= self._next - 1e-9:
            self._next += 1 / lens.fps
            bgr = bench.camera.develop(bench.shutter())
            self._under_way.append(Picture(bench.now + lens.delay_s, None, bgr))
        newest = None
        while self._under_way and self._under_way[0].stamp <= bench.now + 1e-9:
            newest = self._under_way.popleft()
        return newest
