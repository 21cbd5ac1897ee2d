"""The link to the firmware: `Session` is its logic without I/O or clock, `Link` adds a serial port.

The lockstep rig and a replay use the Session alone, so all three speak byte for byte alike.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable
from typing import Literal

import serial

from host.core.errors import UserError
from host.core.messages import Command, Request, State, Telemetry
from host.link import protocol
from host.link.port import WRITE_TIMEOUT_S, open_port

HELLO_EVERY_S = 0.2
"""Between greetings while the board does not answer."""
HELLO_TIMEOUT_S = 5.0
"""A Uno's boot loader keeps the port for up to two seconds after opening it."""
ANSWER_TIMEOUT_S = 1.0
"""A board answers within a tick, and later only while it writes its EEPROM."""
FIRMWARE_CLOCK_S = 2**32 * 1e-6
"""The firmware's microseconds wrap here, after 71 minutes, which is no reset."""

_STATES = {int(state): state for state in State}
Direction = Literal["to_firmware", "to_host"]
Answer = protocol.Ack | protocol.ParamValue | protocol.LogEntry | protocol.HilOutputs


class Session:
    """One conversation with the firmware. Bytes in give telemetry, commands give bytes out.

    Until a Version of this host's protocol has come, commands turn into Hello; only STOP always
    goes out. Sequence numbers count the frames sent, modulo 256.
    """

    def __init__(self) -> None:
        self.version: protocol.Version | None = None
        self.telemetry: Telemetry | None = None
        """The latest."""
        self.readings: protocol.Readings | None = None
        """The latest of the slow ones: currents, raw readings, line errors."""
        self.answers: deque[Answer] = deque(maxlen=64)
        """What the firmware answered to requests, oldest first, for the caller to take."""
        self.refusal = ""
        """The last request, in words, if it was refused; empty if it was taken."""
        self.resets = 0
        """How often the firmware's clock started again."""
        self._parser = protocol.Parser()
        self._seq = 0
        self._hello_at = -math.inf
        self._firmware_time = -math.inf
        self._rounds_s = 0.0
        """What the firmware's clock has gone round since it started."""

    @property
    def frames_bad(self) -> int:
        """Frames dropped on their way to the host."""
        return self._parser.frames_bad

    def feed(self, now: float, data: bytes) -> list[Telemetry]:
        """Takes what the port gave at `now`. Raises UserError when the firmware turns out to speak
        another protocol version; drops anything that is no valid frame."""
        arrived: list[Telemetry] = []
        for _, message in self._parser.feed(data):
            if isinstance(message, protocol.Telemetry):
                arrived.append(self._telemetry(now, message))
            elif isinstance(message, protocol.Readings):
                self.readings = message
            elif isinstance(message, protocol.Version):
                self._meet(message)
            elif isinstance(message, protocol.Ack):
                self.refusal = _refusal(message)
                self.answers.append(message)
            elif isinstance(message, protocol.ParamValue | protocol.LogEntry | protocol.HilOutputs):
                self.answers.append(message)
        return arrived

    def encode(self, now: float, command: Command) -> bytes:
        """The command's frames: none where Hello is out and not answered yet. Raises ValueError on
        a motion that is not finite or does not fit the wire."""
        if self.version is None:
            stop = self.request(protocol.Stop()) if command.request is Request.STOP else b""
            return stop + self.hello(now)
        return self.request(_message(command))

    def hello(self, now: float) -> bytes:
        """Hello, if the last one is not too fresh."""
        if now - self._hello_at < HELLO_EVERY_S:
            return b""
        self._hello_at = now
        return self.request(protocol.Hello(protocol_version=protocol.VERSION))

    def request(self, message: protocol.Message) -> bytes:
        """Any message as the next frame; `next_seq` before the call is its sequence number."""
        frame = protocol.encode(message, self._seq)
        self._seq = (self._seq + 1) % 256
        return frame

    @property
    def next_seq(self) -> int:
        """The sequence number of the next frame."""
        return self._seq

    def _telemetry(self, now: float, message: protocol.Telemetry) -> Telemetry:
        if message.time < self._firmware_time < FIRMWARE_CLOCK_S - 1:
            self.resets += 1
            self._rounds_s = 0.0
        elif message.time < self._firmware_time:
            self._rounds_s += FIRMWARE_CLOCK_S
        self._firmware_time = message.time
        self.telemetry = Telemetry(
            stamp=now,
            state=_STATES[message.state],
            faults=int(message.faults),
            setpoint_rad=message.setpoint,
            angle_rad=message.angle,
            steer_duty=message.steer_duty,
            drive_duty=message.drive_duty,
            blade=bool(message.blade),
            speed_mps=message.speed,
            distance_m=message.distance,
            battery_v=message.battery,
            last_seq=message.last_seq,
            frames_bad=message.frames_bad,
            firmware_s=self._rounds_s + message.time,
            refusal=self.refusal,
        )
        return self.telemetry

    def _meet(self, version: protocol.Version) -> None:
        if version.protocol_version != protocol.VERSION:
            raise UserError(
                f"the firmware speaks protocol version {version.protocol_version}, this program "
                f"{protocol.VERSION}: write the matching firmware with `daranti flash`"
            )
        self.version = version


def _message(command: Command) -> protocol.Message:
    match command.request:
        case Request.STOP:
            return protocol.Stop()
        case Request.CLEAR:
            return protocol.Clear()
        case Request.ARM:
            return protocol.Arm(protocol_version=protocol.VERSION)
        case Request.DRIVE:
            if not (math.isfinite(command.steer_rad) and math.isfinite(command.speed_mps)):
                raise ValueError(f"a motion that is not finite: {command}")
            return protocol.Drive(command.steer_rad, command.speed_mps, int(command.blade))


REQUEST_NAMES = {kind.ID: kind.__name__ for kind in protocol.MESSAGES}
RESULT_TEXTS = {
    protocol.Result.WRONG_VERSION: "another protocol version",
    protocol.Result.WRONG_STATE: "not allowed in the present state",
    protocol.Result.NOT_PLAUSIBLE: "a precondition fails (potentiometer, e-stop, battery, speed)",
    protocol.Result.OUT_OF_RANGE: "a value out of its range",
    protocol.Result.UNKNOWN: "unknown to this firmware",
    protocol.Result.STORE_FAILED: "the EEPROM did not keep it",
    protocol.Result.NOT_SET_UP: (
        "this machine is not set up: tell the firmware which drivers it has (`daranti params set "
        "steer_driver N --save` and drive_driver), keep the limits and steer_pwm_freq within what "
        "drivers and sensors stand and show, and steer_duty_max at least 40 above steer_min_duty, "
        "and hall_per_metre and ..._current_scale at least 10 where their sensor is fitted"
    ),
    protocol.Result.STALE: "a repeated or old command",
}


def _refusal(ack: protocol.Ack) -> str:
    if ack.result is protocol.Result.OK:
        return ""
    name = REQUEST_NAMES.get(ack.request_id, f"message {ack.request_id}")
    return f"{name} refused: {RESULT_TEXTS[ack.result]}"


class Link(contextlib.AbstractContextManager["Link"]):
    """A Session on a serial port. Single-threaded: `poll` and `send` are called in turn.

    `tap(direction, stamp, bytes)`, when set, sees everything that passes: for the record.
    """

    def __init__(self, port: str, clock: Callable[[], float]) -> None:
        """`port`: a serial device, or pyserial's socket://HOST:PORT or rfc2217://HOST:PORT.
        Raises UserError where it is missing, taken, or not a port."""
        self.port = port
        self.session = Session()
        self.bytes_in = 0
        self.tap: Callable[[Direction, float, bytes], None] | None = None
        self.clock = clock
        self._serial = open_port(port)

    def poll(self, timeout_s: float = 0.0) -> list[Telemetry]:
        """Takes what has arrived, waiting up to `timeout_s` for the first byte. Raises UserError
        when the port has vanished."""
        deadline = self.clock() + timeout_s
        data = b""
        try:
            while not data and self.clock() < deadline:
                data = self._serial.read(1)
            while waiting := self._serial.in_waiting:  # socket:// counts at most one
                data += self._serial.read(waiting)
        except (OSError, TypeError) as error:  # pyserial's own, and its use of a closed descriptor
            raise self._vanished() from error
        if not data:
            return []
        now = self.clock()
        self.bytes_in += len(data)
        if self.tap:
            self.tap("to_host", now, data)
        return self.session.feed(now, data)

    def send(self, command: Command) -> None:
        """Raises UserError when the port has vanished or takes no bytes."""
        self._write(self.session.encode(self.clock(), command))

    def request(self, message: protocol.Message) -> None:
        """Sends any message, once; raises as `send` does."""
        self._write(self.session.request(message))

    def forward(self, frames: bytes) -> None:
        """Sends whole frames that somebody else has encoded; raises as `send` does."""
        self._write(frames)

    def meet(self, timeout_s: float = HELLO_TIMEOUT_S) -> protocol.Version:
        """The handshake. Raises UserError when nobody answers in this protocol."""
        deadline = self.clock() + timeout_s
        while self.session.version is None:
            if (now := self.clock()) > deadline:
                raise UserError(f"{self.port}: {self._silence(timeout_s)}")
            self._write(self.session.hello(now))
            self.poll(HELLO_EVERY_S / 4)
        return self.session.version

    def ask(
        self, message: protocol.Message, timeout_s: float = ANSWER_TIMEOUT_S, attempts: int = 3
    ) -> Answer:
        """Sends a request until it is answered. Only for requests that may be repeated; raises
        UserError when it is refused or never answered."""
        for _ in range(attempts):
            self.session.answers.clear()
            seq = self.session.next_seq
            self._write(self.session.request(message))
            deadline = self.clock() + timeout_s
            while (now := self.clock()) < deadline:
                self.poll(deadline - now)
                for answer in self.session.answers:
                    if _answers(answer, message, seq):
                        why = _refusal(answer) if isinstance(answer, protocol.Ack) else ""
                        if why:
                            raise UserError(f"{self.port}: {why}")
                        return answer
        raise UserError(
            f"{self.port}: no answer to {type(message).__name__} in {attempts} attempts of "
            f"{timeout_s:g} s; check the cable"
        )

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Asks for STOP, if the port still takes it, and closes (the system sends what is queued
        first). What a vanished port cannot stop, the firmware's own 250 ms watchdog does."""
        with contextlib.suppress(UserError):
            self.send(Command(Request.STOP, reason="closing"))
        self._serial.close()

    def _write(self, data: bytes) -> None:
        if not data:
            return
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException as error:
            raise UserError(
                f"{self.port} takes no bytes for {WRITE_TIMEOUT_S:g} s: the board hangs or the "
                "cable is broken; the firmware stops by itself. Reset the board and start again"
            ) from error
        except (OSError, TypeError) as error:
            raise self._vanished() from error
        if self.tap:
            self.tap("to_firmware", self.clock(), data)

    def _vanished(self) -> UserError:
        return UserError(
            f"{self.port} vanished (unplugged, or the board lost power); the firmware switches its "
            "outputs off within 250 ms. Plug it in again and restart"
        )

    def _silence(self, timeout_s: float) -> str:
        if self.bytes_in == 0:
            return (
                f"nobody answers within {timeout_s:g} s; is the firmware on the board (`daranti "
                "flash`) and is this the right port?"
            )
        if self.session.telemetry is None:
            return "something talks there, but not Daranti's firmware; is this the right port?"
        return "the firmware sends telemetry but does not answer Hello; reset the board"


def connect(port: str, clock: Callable[[], float] = time.monotonic) -> Link:
    """An open link after the handshake."""
    link = Link(port, clock)
    try:
        link.meet()
    except BaseException:
        link.close()
        raise
    return link


def _answers(answer: Answer, message: protocol.Message, seq: int) -> bool:
    if isinstance(answer, protocol.Ack):
        return answer.request_id == message.ID and answer.request_seq == seq
    if isinstance(answer, protocol.ParamValue):
        return isinstance(message, protocol.ParamGet) and answer.param == message.param
    if isinstance(answer, protocol.LogEntry):
        return isinstance(message, protocol.LogGet) and answer.index == message.index
    return isinstance(message, protocol.HilSensors)
