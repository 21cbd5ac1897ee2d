"""`daranti-hil harvest`: one field from the first picture to the last strip, in lockstep."""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hil.bench.eyes import Eyes, PictureEyes
from hil.bench.live_view import LiveView
from hil.bench.lockstep import Bench
from hil.bench.model_eyes import ModelEyes
from hil.judge import pictures
from hil.judge.decisions import Decisions
from hil.judge.metrics import Truth
from hil.scenario.faults import Fault
from hil.scenario.scenario import Scenario
from host.core.messages import Fix, Frame, Turned
from host.core.whole_file import save_text
from host.link.session import Session
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.pilot.snapshot import snapshot
from host.runs.record import Recorder
from host.sensors.gyro import Turning
from host.sensors.jpeg import NOTHING, Bgr
from host.sensors.nmea import Receiver
from host.vision.view import Detector
from sim_plant.gyro import sensors_json
from sim_plant.network import Stream

HOST_HZ = 20
"""Times are whole ticks over this rate, not multiples of a period, so that the nanoseconds of a
record give exactly the same times again."""
FIX_TICKS = HOST_HZ
VIDEO_EVERY = 4
"""Pictures, of which one goes into the film."""
SWITCH_S = 0.0005
"""How long Python lets one thread run, so that the camera's are not kept waiting."""
LINGER_S = 1.0
"""Simulated time after the pilot is done, so that the outputs are seen to be off."""


@dataclass(frozen=True, slots=True)
class Progress:
    """What a progress bar shows."""

    time_s: float
    coverage: float
    phase: Phase
    reason: str


class Picture(Protocol):
    """A picture that is being developed."""

    def result(self) -> tuple[bytes, Bgr]:
        """It, once it is there."""
        ...


class _Developed:
    def __init__(self, picture: tuple[bytes, Bgr]) -> None:
        self._picture = picture

    def result(self) -> tuple[bytes, Bgr]:
        return self._picture


def eyes_of(bench: Bench) -> Eyes:
    """The eyes that the scenario names."""
    return ModelEyes(bench) if bench.scenario.eyes == "model" else PictureEyes(bench)


def _whole_ns(seconds: float) -> float:
    """As a record keeps a time."""
    return round(seconds * 1e9) / 1e9


class Harvest:
    """One lockstep run. The camera develops each shot in `darkroom` (a thread, where none is given)
    while machine and firmware go on: the picture is due only after the camera's delay, so the
    result does not depend on it."""

    def __init__(
        self,
        scenario: Scenario,
        record: Path | None = None,
        video: Path | None = None,
        detector: Callable[[Bench], Detector] | None = None,
        *,
        camera_threads: int = 1,
        darkroom: Executor | None = None,
        eyes: Callable[[Bench], Eyes] | None = None,
        recorded_as: Scenario | None = None,
    ) -> None:
        """`eyes`: what takes the pictures and makes the detector, as the scenario says where none
        are given; `detector`: another one for the same pictures. Eyes that take no pictures leave
        none in record and film. `recorded_as`: the same scenario as the record is to name it, whose
        files will lie elsewhere."""
        self.scenario = scenario
        self._recorded_as = recorded_as or scenario
        self.bench = Bench(scenario, camera_threads=camera_threads)
        self.eyes: Eyes = (eyes or eyes_of)(self.bench)
        self._detector = detector or (lambda _: self.eyes.detector())
        self._told = scenario.told
        self._plan = scenario.plan()
        self.session = Session()
        self.pilot = self._new_pilot()
        self._recorded = self._plan
        self.truth = Truth(self.bench.world, self.bench.field)
        self.decisions = Decisions(self.bench.field, self._told.vehicle)
        self.steering: list[tuple[float, float, float, float]] = []
        self.frames = 0
        self.seconds = dict.fromkeys(("bench", "picture wait", "pilot", "record", "video"), 0.0)
        self._receiver = Receiver()
        self._turning = Turning()
        self._turned: Turned | None = None
        self._restarts = 0
        self._events = 0
        self._inbox: list[tuple[float, bytes]] = []
        self._host_at = 0.0
        self._frame: tuple[Frame, bytes] | None = None
        self._fix: Fix | None = None
        self._darkroom = darkroom or ThreadPoolExecutor(1)
        self._videos = ThreadPoolExecutor(1)
        self._due: deque[tuple[float, Picture]] = deque()
        """(when it arrives, the picture), in order."""
        self._video: pictures.Video | None = None
        self._video_work: deque[Future[None]] = deque()
        lens = self.bench.world.lens
        self._stream = Stream(lens, self.bench.world.seed)
        self._frame_ticks = max(1, round(HOST_HZ / lens.fps))
        if video is not None and self.eyes.takes_pictures:
            fps = lens.fps / VIDEO_EVERY * 4
            self._video = pictures.Video(video, fps, lens.width_px, lens.height_px)
        self._record: Recorder | None = None
        self.live: LiveView | None = None
        if record is not None:
            self._record = self._opened(record)

    def _opened(self, path: Path) -> Recorder:
        """The record and, where the scenario wants it, the live view of what goes into it."""
        scenario = self.scenario
        if scenario.record.live_port is not None:
            self.live = LiveView(scenario.record.live_port)
        tee = self.live.put if self.live is not None else None
        seen = {**scenario.vehicle.mounts, scenario.camera: scenario.mount}
        vehicle = scenario.vehicle.model_copy(update={"mounts": seen})
        about = {
            "scenario": self._recorded_as.model_dump_json(),
            # as a drive's record has them, so that `daranti see` reads either
            "vehicle": vehicle.model_dump_json(),
            "mount": scenario.camera,
            "mode": scenario.mode,
        }
        return Recorder(path, about, tee)

    def _new_pilot(self) -> Pilot:
        return Pilot(self._told.vehicle, self._detector(self.bench), self._plan)

    def run(
        self,
        progress: Callable[[Progress], None] | None = None,
        enough: Callable[[], bool] | None = None,
    ) -> None:
        """To the pilot's end, the scenario's time limit, or until there is `enough`; called again,
        it goes on."""
        tick = round(self.bench.now * HOST_HZ)
        limit = self.scenario.limits.time_s
        done_at: float | None = None
        while tick / HOST_HZ < limit and not (enough is not None and enough()):
            tick += 1
            now = tick / HOST_HZ
            self._step(tick, now)
            if progress is not None and tick % 20 == 0:
                coverage = self.bench.field.coverage()
                progress(Progress(now, coverage, self.pilot.phase, self.pilot.reason))
            if self.pilot.done:
                done_at = done_at or now
                if now - done_at >= LINGER_S:
                    break

    @property
    def fault_is_next(self) -> bool:
        """Whether the scenario's first fault begins within the host's next step."""
        return self.bench.faults.begins_before(self.bench.now + 1 / HOST_HZ)

    def fail_with(self, faults: tuple[Fault, ...]) -> None:
        """Makes other faults of the scenario's, which begin when those would have."""
        self.bench.faults.replace(faults)
        self.scenario = self.scenario.model_copy(update={"faults": faults})

    def _step(self, tick: int, now: float) -> None:
        clock = time.perf_counter
        seconds = self.seconds
        start = clock()
        record = self._record
        for stamp, data in self.bench.advance(now):
            self._inbox.append((stamp, data))
            if record is not None:
                record.put("/serial/to_host", stamp, {"data": data})
        if tick % self._frame_ticks == 0:
            shot = self.eyes.shutter()
            work: Picture = (
                self._darkroom.submit(self.eyes.develop, shot)
                if self.eyes.takes_pictures
                else _Developed(self.eyes.develop(shot))
            )
            self._due.append((self._stream.arrives_s(now), work))
        if tick % FIX_TICKS == 0:
            data = "".join(line.rstrip("\r\n") + "\r\n" for line in self.bench.fix()).encode()
            self._fix = next(reversed(self._receiver.feed(now, data)), self._fix)
        felt = self.bench.felt()
        turned = self._turning.feed(now, sensors_json(felt)) if felt else None
        if turned is not None:
            stamp = _whole_ns(turned.stamp)
            self._turned = Turned(stamp, turned.yaw_rad, turned.since, turned.nose_up_rad)
        mark = clock()
        seconds["bench"] += mark - start
        self._picture(now)
        start = clock()
        seconds["picture wait"] += start - mark

        self._note_faults()
        if self.bench.faults.host_runs(now):
            self._host(now)
        self.truth.step(now, self.bench.pose, self.bench.cut_cells, self.pilot)
        self.decisions.step(now, self.bench.pose, self.pilot)
        seconds["pilot"] += clock() - start

    def _picture(self, now: float) -> None:
        """Takes what the camera sends now; the newest waits for the host."""
        arrived: tuple[float, bytes] | None = None
        decoded = NOTHING
        work: Picture | None = None
        at = now
        while self._due and self._due[0][0] <= now + 1e-9:
            at, work = self._due.popleft()
        if work is not None:
            jpeg, decoded = work.result()
            # The host knows when it came, and how long pictures usually take.
            arrived = (_whole_ns(max(0.0, at - self._told.vehicle.camera_delay_s)), jpeg)
        got = self.bench.faults.camera(now, arrived)
        if got is None:
            return
        if got is not arrived:
            decoded = self.eyes.decode(got[1])
        self._frame = (Frame(got[0], decoded), got[1])

    def _host(self, now: float) -> None:
        """One step of the host: takes what has come, lets the pilot decide, sends, records."""
        record = self._record
        if self._restarts != self.bench.faults.host_restarts:
            self._restarts = self.bench.faults.host_restarts
            self.session, self.pilot = Session(), self._new_pilot()
            self._inbox.clear()
        late = now - self._host_at > 1.5 / HOST_HZ
        self._host_at = now
        for stamp, data in self._inbox:
            for telemetry in self.session.feed(now if late else stamp, data):
                self.steering.append(
                    (
                        telemetry.stamp,
                        telemetry.setpoint_rad,
                        telemetry.angle_rad,
                        telemetry.steer_duty,
                    )
                )
                if record is not None:
                    record.telemetry(telemetry)
        self._inbox.clear()
        frame, jpeg = self._frame or (None, b"")
        fix, self._frame, self._fix = self._fix, None, None
        turned, self._turned = self._turned, None
        command = self.pilot.step(now, frame, fix, self.session.telemetry, turned)
        if record is not None and turned is not None:
            record.turned(turned)
        self.bench.faults.phase = self.pilot.phase.value
        self.bench.faults.doing = self.pilot.doing
        data = self.session.encode(now, command)
        self.bench.send(data)
        start = time.perf_counter()
        if record is not None:
            self._write(record, now, frame, jpeg, fix, data)
            record.command(now, command)
        mark = time.perf_counter()
        self.seconds["record"] += mark - start
        if frame is not None:
            self._film(frame)
            self.frames += 1
        self.seconds["video"] += time.perf_counter() - mark

    def _note_faults(self) -> None:
        events = self.bench.faults.events
        for event in events[self._events :]:
            if self._record is not None:
                name = self.scenario.faults[event.index].name
                message = {"index": event.index, "fault": name, "begins": event.begins}
                self._record.put("/fault", event.stamp, message)
        self._events = len(events)

    def _write(
        self,
        record: Recorder,
        now: float,
        frame: Frame | None,
        jpeg: bytes,
        fix: Fix | None,
        data: bytes,
    ) -> None:
        pilot = self.pilot
        every = self.scenario.record.pictures_every if self.eyes.takes_pictures else 0
        if frame is not None:
            if every and self.frames % every == 0:
                record.picture(frame.stamp, jpeg)
            if pilot.view is not None:
                record.view(frame.stamp, pilot.view)
            record.pilot(now, snapshot(pilot))
            record.innovations(now, pilot.take_innovations())
            if pilot.plan is not self._recorded:
                self._recorded = pilot.plan
                record.plan(now, pilot.plan)
            state = self.bench.state
            x, y, yaw = self.bench.pose
            field = self.bench.field
            record.put(
                "/truth",
                now,
                {
                    "x_m": x,
                    "y_m": y,
                    "yaw_rad": yaw,
                    "speed_mps": float(state["v"]),
                    "steer_rad": float(state["steer_angle"]),
                    "coverage": field.coverage(),
                    "missed_m2": field.missed_m2(),
                    "neighbour_cut_m2": field.neighbour_cut_m2(),
                },
            )
        if fix is not None:
            record.fix(fix)
        if data:
            record.put("/serial/to_firmware", now, {"data": data})

    def _film(self, frame: Frame) -> None:
        if self._video is None or self.frames % VIDEO_EVERY or not frame.bgr.size:
            return
        pilot, video = self.pilot, self._video
        view, phase, reason = pilot.view, pilot.phase.value, pilot.reason

        def work() -> None:
            video.add(pictures.annotate(frame.bgr, view, frame.stamp, phase, reason))

        self._video_work.append(self._videos.submit(work))
        while len(self._video_work) > 8:
            self._video_work.popleft().result()

    def close(self) -> None:
        """Ends the target, the workers and the files; what was recorded stays readable."""
        for work in self._video_work:
            work.result()
        self._darkroom.shutdown()
        self._videos.shutdown()
        if self._video is not None:
            self._video.close()
        if self._record is not None:
            self._record.close()
        if self.live is not None:
            self.live.close()
        self.bench.close()


def _events(run: Harvest) -> list[dict[str, Any]]:
    """The pilot's changes of state, and where the rear axle truly was."""
    path = run.truth.path
    found = []
    for change in run.pilot.transitions:
        at = max(0, min(len(path) - 1, round(change.stamp * HOST_HZ) - 1))
        _, x, y, _, _ = path[at] if path else (0.0, math.nan, math.nan, 0.0, None)
        found.append(
            {
                "t": round(change.stamp, 2),
                "phase": change.phase.value,
                "reason": change.reason,
                "x_m": round(x, 2),
                "y_m": round(y, 2),
            }
        )
    return found


def harvest(
    scenario: Scenario,
    out: Path,
    progress: Callable[[Progress], None] | None = None,
    *,
    camera_threads: int = 1,
    eyes: Callable[[Bench], Eyes] | None = None,
    recorded_as: Scenario | None = None,
) -> dict[str, Any]:
    """Runs a scenario and writes summary.json, map.png, decisions.png, steering.png, camera.mp4,
    record.mcap and events.json into `out`, of which a scenario may want the two JSON files only.
    Returns the summary. The number of threads changes nothing but the time it takes.
    `recorded_as`: as Harvest has it."""
    lean = scenario.record.files == "figures"
    film = out / "camera.mp4" if scenario.record.film and not lean else None
    out.mkdir(parents=True, exist_ok=True)
    begin, used = time.perf_counter(), time.process_time()
    record = None if lean else out / "record.mcap"
    run = Harvest(
        scenario,
        record,
        film,
        camera_threads=camera_threads,
        eyes=eyes,
        recorded_as=recorded_as,
    )
    try:
        run.run(progress)
    finally:
        run.close()
    wall, used = time.perf_counter() - begin, time.process_time() - used
    simulated = run.bench.now
    summary: dict[str, Any] = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "firmware": scenario.firmware,
        "camera": scenario.camera,
        "mode": scenario.mode,
        "eyes": scenario.eyes,
        "outcome": run.pilot.phase.value if run.pilot.done else "broken off",
        "reason": run.pilot.reason
        if run.pilot.done
        else f"at {simulated:g} s, limits.time_s, in {run.pilot.phase.value}: {run.pilot.reason}",
        **run.truth.summary(),
        "believed_wrong": run.pilot.believed_wrong,
        "turns": run.pilot.turns,
        "simulated_s": round(simulated, 2),
        "frames": run.frames,
        "hesitations": sum(t.phase is Phase.HESITATE for t in run.pilot.transitions),
        "realtime_factor": round(simulated / wall, 2),
        "processor_s": round(used, 2),
        "wall_share": {name: round(value / wall, 3) for name, value in run.seconds.items()},
    }
    save_text(out / "events.json", json.dumps(_events(run)) + "\n")
    save_text(out / "summary.json", json.dumps(summary, indent=2) + "\n")
    if lean:
        return summary
    title = (
        f"{scenario.name}, {scenario.firmware} firmware, seed {scenario.seed}: "
        f"coverage {summary['coverage']:.3f}, {summary['outcome']}"
    )
    pictures.draw_map(out / "map.png", run.bench.field, run.truth.path, title)
    run.decisions.draw(out / "decisions.png", [(t, x, y) for t, x, y, *_ in run.truth.path])
    if run.steering:
        pictures.draw_steering(out / "steering.png", np.array(run.steering))
    return summary
