"""The pilot in wall-clock time, between real devices.

`Drive` is the loop: every 50 ms it gives the pilot what is newest and sends what it decides.
Whatever ends it, an exception included, the last thing sent is STOP; should even that be
impossible, the firmware's own watchdog stops the machine 250 ms after the last command.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2

from host.core.errors import FaultError
from host.core.messages import Command, Fix, Frame, Request, State, Telemetry, Turned
from host.core.vehicle import Mount, Vehicle
from host.field.fence import Fence
from host.link import protocol
from host.link.session import Link
from host.pilot.pilot import Pilot
from host.pilot.snapshot import snapshot
from host.runs.record import Recorder
from host.runs.resume import Keeper
from host.sensors.camera_stream import Picture
from host.sensors.jpeg import JpegDecoder
from host.sensors.newest import Feed

PERIOD_S = 0.05
"""Of the pilot's steps and the commands: a fifth of the firmware's 250 ms."""
TELEMETRY_TIMEOUT_S = 1.0
"""Fifty telemetry messages that did not come."""
HALT_S = 0.5
"""For the board to confirm STOP, repeated meanwhile."""
AT_REST = (State.SAFE, State.FAULT)


def fitted(picture: Picture, decoder: JpegDecoder, mount: Mount, delay_s: float) -> Frame:
    """The picture in the mount's size, stamped with its shutter's time. One of other proportions,
    or without pixels, stays as it is, for the picture watch to refuse."""
    frame = picture.frame(decoder)
    height, width = frame.bgr.shape[:2]
    bgr = frame.bgr
    size = (mount.width_px, mount.height_px)
    if bgr.size and (width, height) != size and width * mount.height_px == height * mount.width_px:
        bgr = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA).astype("uint8", copy=False)
    return Frame(picture.stamp - delay_s, bgr)


def fits(frame: Frame, mount: Mount) -> bool:
    """Whether a frame has the mount's size."""
    return frame.bgr.shape[:2] == (mount.height_px, mount.width_px)


def halt(link: Link, clock: Callable[[], float], timeout_s: float = HALT_S) -> bool:
    """Sends STOP every 50 ms until the firmware says that it holds still; False when it has not in
    time."""
    deadline = clock() + timeout_s
    while clock() < deadline:
        link.send(Command(Request.STOP, reason="the run ends"))
        again = clock() + PERIOD_S
        while (left := again - clock()) > 0:
            if any(telemetry.state in AT_REST for telemetry in link.poll(left)):
                return True
    return False


class Drive:
    """One run. The devices are handed in and stay their owner's; nothing here is global."""

    def __init__(
        self,
        pilot: Pilot,
        link: Link,
        camera: Feed[Picture],
        gnss: Feed[Fix] | None,
        mount: Mount,
        vehicle: Vehicle,
        clock: Callable[[], float],
        recorder: Recorder | None = None,
        fence: Fence | None = None,
        paused: Callable[[], bool] | None = None,
        keeper: Keeper | None = None,
        gyro: Feed[Turned] | None = None,
    ) -> None:
        """`paused`: whether the operator wants the machine to stand still."""
        self.pilot = pilot
        self.link = link
        self.camera = camera
        self.gnss = gnss
        self.gyro = gyro
        self.command = Command(Request.STOP, reason="not started")
        self.fix: Fix | None = None
        self._decoder = JpegDecoder()
        self.pictures = 0
        self.pictures_bad = 0
        self.pictures_repeated = 0
        self.late = 0
        """Steps that could not begin in time."""
        self.latencies_s: list[float] = []
        """From a picture's shutter to the telemetry that names the command made from it."""
        self._asked: tuple[int, float] | None = None
        """(sequence number, shutter) of the command that is on its way."""
        self.step_s = 0.0
        """How long the longest step since the last look took; the looker sets it back."""
        self._jpeg: bytes | None = None
        self._recorded = pilot.plan
        self._mount = mount
        self._delay_s = vehicle.camera_delay_s
        self._clock = clock
        self._recorder = recorder
        self._fence = fence
        self._paused = paused
        self.keeper = keeper

    def stopped(self) -> None:
        """What is on the wire from now on: the run is over."""
        self.command = Command(Request.STOP, reason=self.pilot.reason)

    @property
    def telemetry(self) -> Telemetry | None:
        """The latest."""
        return self.link.session.telemetry

    def run(self, show: Callable[[Drive], None]) -> None:
        """Until the pilot is done. `show` is called after every step. Raises FaultError when a
        device is lost for good."""
        begun = self._clock()
        resets = self.link.session.resets
        due = begun
        while not self.pilot.done:
            due += PERIOD_S
            self._listen(due)
            now = self._clock()
            if now > due + PERIOD_S:  # what was missed is not caught up
                self.late += 1
                due = now
            telemetry = self.telemetry
            heard = telemetry.stamp if telemetry is not None else begun
            if now - max(heard, begun) > TELEMETRY_TIMEOUT_S:
                raise FaultError(
                    f"{self.link.port}: no telemetry for {TELEMETRY_TIMEOUT_S:g} s; the firmware "
                    "hangs or the cable is broken. Reset the board and start again"
                )
            if telemetry is not None and self.link.session.resets != resets:
                texts = protocol.fault_texts(protocol.Fault(telemetry.faults))
                raise FaultError(
                    f"{self.link.port}: the firmware restarted in the middle of the run; its "
                    f"outputs are off. {'; '.join(texts) or 'Check the 5 V supply'}"
                )
            self._step(now)
            self.step_s = max(self.step_s, self._clock() - now)
            show(self)

    def _listen(self, until: float) -> None:
        """Takes telemetry as it comes, at least what is there."""
        while True:
            left = until - self._clock()
            for telemetry in self.link.poll(max(0.0, left)):
                if self._asked is not None and telemetry.last_seq == self._asked[0]:
                    self.latencies_s.append(telemetry.stamp - self._asked[1])
                    self._asked = None
                if self._recorder is not None:
                    self._recorder.telemetry(telemetry)
            if left <= 0:
                return

    def _step(self, now: float) -> None:
        picture = self._new_picture()
        frame = None
        if picture is not None:
            frame = fitted(picture, self._decoder, self._mount, self._delay_s)
            self.pictures += 1
            self.pictures_bad += not fits(frame, self._mount)
        fix = self.gnss.take() if self.gnss is not None else None
        if fix is not None:
            self.fix = fix
            beyond = self._fence.breach(fix) if self._fence is not None else None
            if beyond is not None:
                raise FaultError(
                    f"stopped: the positions lie {beyond:.0f} m outside the boundary; look at the "
                    "machine, then check the boundary file and the receiver"
                )
        paused = self._paused is not None and self._paused()
        if paused is not self.pilot.paused:
            self.pilot.paused = paused
            if self._recorder is not None:
                self._recorder.put("/operator", now, {"paused": paused})
        turned = self.gyro.take() if self.gyro is not None else None
        self.command = self.pilot.step(now, frame, fix, self.telemetry, turned)
        seq = self.link.session.next_seq
        self.link.send(self.command)
        if frame is not None:
            self._asked = (seq, frame.stamp)
        if self.keeper is not None:
            self.keeper.note(self.pilot)
        if self._recorder is not None:
            if turned is not None:
                self._recorder.turned(turned)
            self._write(self._recorder, now, picture, frame, fix)

    def _new_picture(self) -> Picture | None:
        """The camera's newest, unless it is byte for byte the one before: a phone that is back, or
        whose camera hangs, sends what it had, and that is no view of now."""
        picture = self.camera.take()
        if picture is None or picture.jpeg is None:
            return picture
        repeated = picture.jpeg == self._jpeg
        self._jpeg = picture.jpeg
        self.pictures_repeated += repeated
        return None if repeated else picture

    def _write(
        self,
        recorder: Recorder,
        now: float,
        picture: Picture | None,
        frame: Frame | None,
        fix: Fix | None,
    ) -> None:
        if picture is not None and frame is not None:
            jpeg = picture.jpeg or cv2.imencode(".jpg", frame.bgr)[1].tobytes()
            recorder.picture(frame.stamp, jpeg)
            if self.pilot.view is not None:
                recorder.view(frame.stamp, self.pilot.view)
            recorder.pilot(now, snapshot(self.pilot))
            recorder.innovations(now, self.pilot.take_innovations())
        if self.pilot.plan is not self._recorded:
            self._recorded = self.pilot.plan
            recorder.plan(now, self._recorded)
        if fix is not None:
            recorder.fix(fix)
        recorder.command(now, self.command)
