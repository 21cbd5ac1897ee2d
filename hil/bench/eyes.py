"""The machine's eyes on the bench: what takes a picture, what becomes of it on its way, and which
detector reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

from hil.bench.lockstep import Bench
from hil.bench.misread import Misreading
from hil.bench.sight import Sight, look
from host.sensors.jpeg import NOTHING, Bgr, JpegDecoder
from host.vision.mounted.detector import make_detector
from host.vision.view import CropView, Detector
from host.vision.watched import watched_detector
from sim_plant.camera import CameraSpec


class Eyes(Protocol):
    """One camera of one run."""

    takes_pictures: bool
    """Whether a shot becomes a picture that a person can look at. Where none does, to develop costs
    next to nothing, and there is nothing to film or to keep."""

    def shutter(self) -> Any:
        """Freezes what the camera sees now; called on the bench's own thread."""
        ...

    def develop(self, shot: Any) -> tuple[bytes, Bgr]:
        """A shot's file and its pixels as the host decodes them; shot after shot, in any thread."""
        ...

    def decode(self, data: bytes) -> Bgr:
        """A file that came otherwise than it was sent."""
        ...

    def detector(self) -> Detector:
        """A new one, as the host makes it when it starts."""
        ...


class PictureEyes:
    """The simulated camera, and the detector that the scenario names: of the bench it sees nothing
    but pictures."""

    takes_pictures = True

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._camera = bench.camera
        self._decoder = JpegDecoder()

    def shutter(self) -> Any:
        """A `sim_plant.camera.Shot`, and the camera that took it."""
        return self._bench.shutter(), self._camera

    def develop(self, shot: Any) -> tuple[bytes, Bgr]:
        """Rendered, JPEG there and back."""
        taken, camera = shot
        jpeg = camera.encode(camera.develop(taken))
        return jpeg, self._decoder.decode(jpeg)

    def knock(self, lens: CameraSpec) -> None:
        """The camera is this one from now on; what it took before is developed as it was taken."""
        bench = self._bench
        self._camera = bench.camera = bench.new_camera(lens)

    def decode(self, data: bytes) -> Bgr:
        """As the host decodes a JPEG file."""
        return self._decoder.decode(data)

    def detector(self) -> Detector:
        """The host's own."""
        told = self._bench.scenario.told
        return watched_detector(self._bench.scenario.mode, told.vehicle, told.mount)


class PerfectEye:
    """What is true of the crop before a bench's machine, and how its host would misread it."""

    def __init__(self, bench: Bench) -> None:
        scenario = bench.scenario
        self._bench = bench
        self._blade = scenario.machine.blade_x_m, scenario.machine.blade_width_m
        self.knock(scenario.world.lens)

    def knock(self, lens: CameraSpec) -> None:
        """The camera is this one from now on."""
        told = self._bench.scenario.told
        self._lens_m = lens.x_m, lens.y_m
        self._misreading = Misreading(lens, self._blade[0], told.mount, told.vehicle)

    def sight(self) -> Sight:
        """Now."""
        bench, state = self._bench, self._bench.state
        return look(
            bench.field,
            bench.pose,
            *self._blade,
            float(state["v"]),
            bool(state["blade_spinning"]),
            self._misreading,
            self._lens_m,
        )


class WitnessedEyes(PictureEyes):
    """Pictures and their detector, with what was true of every picture that it read.

    `looks` says whether the pilot reads pictures now. Through a turn it only glances at them, and
    none is rendered: then the last one stands in, nobody watches for a camera that hangs, and what
    the detector says of it again does not count."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench)
        self.looks: Callable[[], bool] = lambda: True
        self._last: tuple[bytes, Bgr] = (b"", NOTHING)
        self._eye = PerfectEye(bench)
        self.seen: list[tuple[float, Sight, CropView, bool]] = []
        """(the shutter's time, the truth, the answer, whether the detector had been restarted)."""
        self._truths: dict[int, tuple[float, Sight, Bgr]] = {}

    def shutter(self) -> Any:
        """The shot and its truth; None for a picture that nobody reads."""
        if not self.looks():
            return None
        return super().shutter(), self._bench.now, self._eye.sight()

    def develop(self, shot: Any) -> tuple[bytes, Bgr]:
        """As without a witness."""
        if shot is None:
            return self._last
        taken, stamp, sight = shot
        jpeg, bgr = self._last = super().develop(taken)
        self._truths[id(bgr)] = (stamp, sight, bgr)  # kept, so that no other array takes its id
        while len(self._truths) > 16:
            self._truths.pop(next(iter(self._truths)))
        return jpeg, bgr

    def detector(self) -> Detector:
        """The host's own, listened to."""
        s = self._bench.scenario
        unwatched = make_detector(s.mode, s.vehicle, s.mount)
        return _Listened(unwatched, self)

    def note(self, bgr: Bgr, view: CropView, fresh: bool) -> None:
        """What the detector answered to a picture."""
        known = self._truths.pop(id(bgr), None)
        if known is not None:
            numbers = replace(view, standing=None, edge_px=None, stages={})
            self.seen.append((known[0], known[1], numbers, fresh))


class _Listened:
    def __init__(self, detector: Detector, witness: WitnessedEyes) -> None:
        self._detector = detector
        self._witness = witness
        self._fresh = True

    def see(self, bgr: Bgr, *, stages: bool = False) -> CropView:
        view = self._detector.see(bgr, stages=stages)
        self._witness.note(bgr, view, self._fresh)
        self._fresh = False
        return view

    def glance(self, bgr: Bgr) -> CropView:
        return self._detector.glance(bgr)

    def next_crop(self, gap_m: float) -> None:
        self._detector.next_crop(gap_m)

    def restart(self, *, turned: bool = True) -> None:
        self._fresh = True
        self._detector.restart(turned=turned)
