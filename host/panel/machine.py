"""The machine's process: the one owner of board, camera and receiver while the panel runs.

It is a process of its own so that no page, browser or panel can delay the loop that drives. The
panel is a peer on a Unix socket that is never waited for. What a page asks for is a JSON object
with `do`; STOP is sent to the board in the very step that reads it. While it drives with
`presence`, a driver that is not heard of for PRESENCE_S makes the machine stand with its blade off
until somebody says to go on.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from host.core.errors import UserError
from host.core.messages import Command, Fix, Request, Telemetry, Turned
from host.core.strict import Strict
from host.core.vehicle_file import load_vehicle, mount_of
from host.link.session import Link
from host.panel import snapshot
from host.panel.snapshot import Json, number
from host.panel.wire import Peer, WireError, frame, packed
from host.runs.drive import AT_REST
from host.runs.preflight import Problem
from host.sensors.camera_stream import Picture, camera_feed
from host.sensors.gyro import gyro_of
from host.sensors.newest import Feed
from host.sensors.nmea import gnss_feed
from host.vision.mounted.detector import Mode

SAY_EVERY_S: Final = 0.2
"""Between states sent to the pages."""
PICTURE_EVERY_S: Final = 0.4
"""Between pictures sent to the driver's page."""
PRESENCE_S: Final = 2.0
"""Without a sign of the driver's page, after which the machine stands."""
AGAIN_S: Final = 1.0
"""Between attempts to open the port."""
SILENT_S: Final = 1.0
"""Without telemetry, after which the board counts as gone."""
STOP_EVERY_S: Final = 0.05
"""Between repeated STOPs."""
UNCONFIRMED_S: Final = 1.0
"""After so long without the board's word a STOP counts as not confirmed; it is sent on."""
PANEL_LOST_S: Final = 120.0
"""A run that stands and hears of no panel for so long ends, its progress saved."""
POLL_S: Final = 0.02
"""Longest wait for telemetry: a message's distance."""


class Settings(Strict):
    """What the machine consists of. Addresses as in `daranti drive`."""

    port: str
    camera: str | None = None
    gnss: str | None = None
    gyro: str | None = None
    vehicle: Path | None = None
    mount: str = "mast"
    mode: Mode = "robust"
    folder: Path = Path("out/panel")
    presence: bool = True


class StoppedError(Exception):
    """The operator has pressed STOP: whatever was going on ends."""


class NotYetError(UserError):
    """The machine must not start from where it stands."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.text)
        self.problem = problem


class Machine:
    """One machine for as long as the process lives."""

    def __init__(
        self, settings: Settings, listener: socket.socket, clock: Callable[[], float]
    ) -> None:
        self.settings = settings
        self.clock = clock
        self.vehicle = load_vehicle(settings.vehicle)
        self.mount = mount_of(self.vehicle, settings.mount)
        self.link: Link | None = None
        self.events: deque[str] = deque(maxlen=50)
        self.camera: Feed[Picture] | None = None
        self.gnss: Feed[Fix] | None = None
        self.gyro: Feed[Turned] | None = None
        self.mode = "idle"
        self.more: Callable[[], Json] = dict
        """What the present mode adds to a snapshot."""
        self.wishes: deque[Json] = deque(maxlen=50)
        """What the pages ask for and the present mode answers."""
        self.meetings = 0
        """How many panels have come so far."""
        self.heard = clock()
        """When the driving page last gave a sign of life."""
        self._listener = listener
        self._peer: Peer | None = None
        self._peer_lost = clock()
        self._said = self._pictured = self._tried = self._stop_sent = -1e9
        self._picture: Picture | None = None
        self._link_problem = "not connected yet"
        self._stop: Json | None = None
        """The STOP that waits for the board's word."""
        self._stop_begun = -1e9

    # ---- devices ---------------------------------------------------------------------------------

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's latest word, None where there is no board."""
        return None if self.link is None else self.link.session.telemetry

    @property
    def board_ready(self) -> bool:
        """Whether the board answers in our protocol, now."""
        last = self.telemetry
        return (
            self.link is not None
            and self.link.session.version is not None
            and last is not None
            and self.clock() - last.stamp < SILENT_S
        )

    @property
    def board_problem(self) -> str:
        """Why the board does not answer, in words; empty where it does."""
        if self.link is None:
            return self._link_problem
        return "" if self.board_ready else "silent"

    def plug(self) -> None:
        """Starts camera and receiver; they connect and reconnect by themselves."""
        settings = self.settings
        if settings.camera:
            self.camera = camera_feed(settings.camera, self.clock, self.events.append)
            self.camera.start()
        if settings.gnss:
            self.gnss, _ = gnss_feed(settings.gnss, self.clock, self.events.append)
            self.gnss.start()
        self.gyro = gyro_of(settings.gyro, settings.camera or "", self.clock, self.events.append)
        if self.gyro is not None:
            self.gyro.start()

    def unplug(self) -> None:
        """Leaves the board stopped."""
        for feed in (self.camera, self.gnss, self.gyro):
            if feed is not None:
                feed.close()
        if self.link is not None:
            self.link.close()

    # ---- time passes -----------------------------------------------------------------------------

    def pump(self, seconds: float) -> list[Telemetry]:
        """Lets time pass with everybody served; returns the telemetry that came. Raises
        StoppedError
        after a STOP, where something was going on that it ends."""
        until = self.clock() + seconds
        arrived: list[Telemetry] = []
        while True:
            arrived += self._listen(min(POLL_S, max(0.0, until - self.clock())))
            self.serve()
            if self.clock() >= until:
                return arrived

    def _listen(self, seconds: float) -> list[Telemetry]:
        now = self.clock()
        if self.link is None:
            if now - self._tried >= AGAIN_S:
                self._tried = now
                try:
                    self.link = Link(self.settings.port, self.clock)
                    self._link_problem = "no answer yet"
                except UserError as error:
                    self._link_problem = str(error)
            time.sleep(seconds)
            return []
        try:
            if self.link.session.version is None:
                self.link.forward(self.link.session.hello(now))
            return self.link.poll(seconds)
        except UserError as error:
            self.lost(error)
            return []

    def lost(self, error: UserError) -> None:
        """The port is gone; it is opened again when it is back."""
        self._link_problem = str(error)
        self._tried = self.clock()
        if self.link is not None:
            with contextlib.suppress(UserError):
                self.link.close()
        self.link = None

    def send(self, command: Command) -> None:
        """To the board, if there is one."""
        if self.link is None:
            return
        try:
            self.link.send(command)
        except UserError as error:
            self.lost(error)

    # ---- the panel -------------------------------------------------------------------------------

    def serve(self) -> None:
        """Takes what the panel asks, tells it what is new, never waits. Raises StoppedError after a
        STOP while something is going on."""
        self._meet_panel()
        stopped = False
        for wish in self._asked():
            match wish.get("do"):
                case "stop":
                    self._begin_stop(wish)
                    stopped = True
                case "here":
                    self.heard = self.clock()
                case _:
                    self.wishes.append(wish)
        self._press_on()
        now = self.clock()
        if now - self._said >= SAY_EVERY_S or stopped:
            self.say(now)
        self._show(now)
        if stopped and self.mode != "idle":
            raise StoppedError

    def _meet_panel(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._listener.accept()
            if self._peer is not None:
                self._peer.close()
            self._peer = Peer(connection)
            self.meetings += 1
            settings = self.settings.model_dump(mode="json")
            self.post({"kind": "machine", "settings": settings, "mode": self.mode})
            self._picture = None
            self._said = -1e9

    def _asked(self) -> list[Json]:
        if self._peer is None:
            return []
        try:
            return self._peer.read()
        except WireError:
            self._hang_up()
            return []

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None
            self._peer_lost = self.clock()

    @property
    def panel_away_s(self) -> float:
        """For how long there has been no panel."""
        return 0.0 if self._peer is not None else self.clock() - self._peer_lost

    @property
    def driver_away_s(self) -> float:
        """For how long the driving page has not been heard of."""
        return self.clock() - self.heard

    @property
    def deserted(self) -> bool:
        """Whether nobody is at the driving page, where somebody has to be."""
        return self.settings.presence and self.driver_away_s > PRESENCE_S

    def need_driver(self) -> None:
        """UserError where what moves could be stopped by nobody at the driving page."""
        if self.deserted:
            raise UserError("the page that drives is gone: ended")

    def post(self, message: Json) -> None:
        """Tells the panel something that must not be lost while it is there."""
        if self._peer is not None:
            try:
                self._peer.post(message)
            except WireError:
                self._hang_up()

    def say(self, now: float) -> None:
        """One snapshot."""
        self._said = now
        if self._peer is None:
            return
        try:
            self._peer.offer(packed(self.snapshot(now)))
        except WireError:
            self._hang_up()

    def _show(self, now: float) -> None:
        """The newest picture, if it is new and the panel keeps up."""
        if self._peer is None or self.camera is None or now - self._pictured < PICTURE_EVERY_S:
            return
        picture = self.camera.latest
        if picture is None or picture is self._picture or picture.jpeg is None:
            return
        try:
            if self._peer.offer(frame("P", picture.jpeg)):
                self._picture, self._pictured = picture, now
        except WireError:
            self._hang_up()

    def snapshot(self, now: float) -> Json:
        """What a page is told."""
        session = None if self.link is None else self.link.session
        last = self.telemetry
        silent = last is None or now - last.stamp > SILENT_S
        problem = self._link_problem if self.link is None or silent else ""
        camera, gnss = self.camera, self.gnss
        picture = None if camera is None else camera.latest
        fix = None if gnss is None else gnss.latest
        return {
            "kind": "now",
            "t": number(now, 2),
            "mode": self.mode,
            "link": {
                "port": self.settings.port,
                "problem": problem or ("silent" if silent else ""),
                "firmware": None
                if session is None or session.version is None
                else f"{session.version.firmware_major}.{session.version.firmware_minor}",
                "refusal": "" if session is None else session.refusal,
            },
            "board": None if last is None else snapshot.of_telemetry(last, now),
            "camera": {
                "there": camera is not None,
                "problem": None if camera is None else camera.problem,
                "count": 0 if camera is None else camera.count,
                "age_s": None if picture is None else number(now - picture.stamp, 1),
                "size": [self.mount.width_px, self.mount.height_px],
            },
            "gnss": {
                "there": gnss is not None,
                "problem": None if gnss is None else gnss.problem,
                "fix": None if fix is None else snapshot.of_fix(fix, now),
            },
            "stop": self._stop,
            "presence": self.settings.presence,
            "events": list(self.events)[-8:],
            **self.more(),
        }

    # ---- STOP ------------------------------------------------------------------------------------

    def _begin_stop(self, wish: Json) -> None:
        """A page repeats its STOP until it is confirmed: the same one goes on, its time runs."""
        self.wishes.clear()
        name, waits = wish.get("id"), self._stop
        again = waits is not None and not waits["confirmed"] and name and name == waits["id"]
        self._stop_sent = -1e9
        if again:
            self._press_on()
            return
        self._stop = {"id": name, "confirmed": False, "ms": None, "problem": ""}
        self._stop_begun = self.clock()
        self._press_on()

    def _press_on(self) -> None:
        """Sends STOP again and again until the board itself says that its outputs are off."""
        stop = self._stop
        if stop is None or stop["confirmed"]:
            return
        now = self.clock()
        last = self.telemetry
        sent = self._stop_sent > self._stop_begun - 1
        if sent and last is not None and last.stamp > self._stop_begun and last.state in AT_REST:
            stop |= {
                "confirmed": True,
                "ms": round((last.stamp - self._stop_begun) * 1e3),
                "problem": "",
            }
            self.say(now)
            return
        if now - self._stop_begun > UNCONFIRMED_S and not stop["problem"]:
            stop["problem"] = self._link_problem if self.link is None else "silent"
        if now - self._stop_sent >= STOP_EVERY_S:
            self._stop_sent = now
            self.send(Command(Request.STOP, reason="the operator"))

    @property
    def stopped_s(self) -> float:
        """For how long nobody has pressed STOP."""
        return self.clock() - self._stop_begun

    def settle(self) -> None:
        """After something that moved: STOP until the board confirms, or says nothing any more."""
        if self._stop is None or self._stop["confirmed"]:
            self._begin_stop({"id": None})
        deadline = self.clock() + UNCONFIRMED_S
        while self._stop is not None and not self._stop["confirmed"] and self.clock() < deadline:
            self.pump(POLL_S)

    # ---- what it does ----------------------------------------------------------------------------

    @contextlib.contextmanager
    def doing(self, mode: str, more: Callable[[], Json]) -> Iterator[None]:
        """While something goes on that STOP ends; leaves the board stopped."""
        self.mode, self.more = mode, more
        self.heard = self.clock()
        try:
            yield
        except StoppedError:
            pass
        except UserError as error:
            failed: Json = {"kind": "failed", "what": self.mode, "why": str(error)}
            if isinstance(error, NotYetError):
                failed |= {"code": error.problem.code, "values": dict(error.problem.values)}
            self.post(failed)
            self.events.append(str(error))
        finally:
            self.mode = "idle"
            self.settle()
            self.more = dict

    def run(self, deeds: dict[str, Callable[[Machine, Json], None]]) -> None:
        """Until the panel asks to end, or is gone for good."""
        while self.panel_away_s < PANEL_LOST_S:
            self.pump(POLL_S)
            while self.wishes:
                wish = self.wishes.popleft()
                if wish.get("do") == "end":
                    return
                deed = deeds.get(str(wish.get("do")))
                if deed is not None:
                    deed(self, wish)


def listen(path: Path) -> socket.socket:
    """The socket that a panel connects to: its owner's alone."""
    path.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    old = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(old)
    listener.listen(2)
    listener.setblocking(False)
    return listener
