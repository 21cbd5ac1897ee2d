"""Facts about the conversation with the firmware, without and with a (pseudo-)serial port."""

from __future__ import annotations

import errno
import math
import os
import pty
import socket
import threading
import time
from dataclasses import replace

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.messages import Command, Request, State
from host.link import protocol
from host.link.port import check_port, open_port
from host.link.session import HELLO_EVERY_S, Link, Session
from tests.helpers.fake_firmware import RESTING, FakeFirmware

LIMIT_S = 10.0
VERSION = protocol.Version(protocol.VERSION, 2, 1, 1, 1, 0, 0)


def sent(data: bytes) -> list[protocol.Message]:
    return [message for _, message in protocol.Parser().feed(data)]


def met() -> Session:
    session = Session()
    session.feed(0.0, protocol.encode(VERSION, 0))
    return session


@pytest.mark.parametrize(
    "why", ["[Errno -2] Name or service not known", "[Errno 111] Connection refused"]
)
def test_a_network_port_that_does_not_answer_says_why(
    monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    port = "socket://reaper.invalid:3"

    def refused(*_: object, **__: object) -> None:
        raise serial.SerialException(f"Could not open port {port}: {why}")

    monkeypatch.setattr("serial.serial_for_url", refused)
    with pytest.raises(UserError) as error:
        open_port(port)
    plain = why.partition("] ")[2]
    assert str(error.value) == f"cannot connect to {port}: {plain}; check address and network"


# ---- the session, without I/O --------------------------------------------------------------------


def test_commands_turn_into_hello_until_the_firmware_has_answered() -> None:
    session = Session()
    assert sent(session.encode(0.0, Command(Request.ARM))) == [protocol.Hello(protocol.VERSION)]
    assert session.encode(HELLO_EVERY_S / 2, Command(Request.DRIVE)) == b""
    assert sent(session.encode(HELLO_EVERY_S, Command(Request.DRIVE))) == [
        protocol.Hello(protocol.VERSION)
    ]
    session.feed(0.3, protocol.encode(VERSION, 0))
    assert sent(session.encode(0.3, Command(Request.ARM))) == [protocol.Arm(protocol.VERSION)]


def test_stop_goes_out_before_any_handshake() -> None:
    assert sent(Session().encode(0.0, Command(Request.STOP)))[0] == protocol.Stop()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (Command(Request.STOP, 1.0, 1.0, True), protocol.Stop()),
        (Command(Request.CLEAR), protocol.Clear()),
        (Command(Request.ARM), protocol.Arm(protocol.VERSION)),
    ],
)
def test_requests_carry_no_motion(command: Command, message: protocol.Message) -> None:
    assert sent(met().encode(0.0, command)) == [message]


@given(st.floats(-1.5, 1.5), st.floats(-3, 3), st.booleans())
def test_a_motion_crosses_the_wire_to_its_resolution(
    steer: float, speed: float, blade: bool
) -> None:
    (drive,) = sent(met().encode(0.0, Command(Request.DRIVE, steer, speed, blade)))
    assert isinstance(drive, protocol.Drive)
    assert drive.steer == pytest.approx(steer, abs=math.radians(0.0051))
    assert drive.speed == pytest.approx(speed, abs=0.00051)
    assert drive.blade == blade


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_motion_that_is_no_number_is_never_sent(value: float) -> None:
    for command in (Command(Request.DRIVE, value), Command(Request.DRIVE, 0.0, value)):
        with pytest.raises(ValueError, match="not finite"):
            met().encode(0.0, command)


def test_sequence_numbers_count_modulo_256() -> None:
    session = met()
    frames = b"".join(session.encode(0.0, Command(Request.DRIVE)) for _ in range(300))
    assert [seq for seq, _ in protocol.Parser().feed(frames)] == [n % 256 for n in range(300)]


def test_telemetry_is_stamped_by_the_host_and_in_si() -> None:
    session = Session()
    message = replace(RESTING, state=protocol.State.ARMED, angle=0.1, speed=0.5, blade=1)
    (telemetry,) = session.feed(5.0, protocol.encode(message, 3))
    assert telemetry.stamp == 5.0
    assert telemetry.state is State.ARMED
    assert telemetry.angle_rad == pytest.approx(0.1, abs=1e-4)
    assert telemetry.speed_mps == pytest.approx(0.5)
    assert telemetry.blade
    assert session.telemetry is telemetry


def test_no_hall_sensor_is_no_speed() -> None:
    (telemetry,) = Session().feed(0.0, protocol.encode(replace(RESTING, speed=None), 0))
    assert telemetry.speed_mps is None


@pytest.mark.parametrize("version", [protocol.VERSION - 1, protocol.VERSION + 1])
def test_another_protocol_version_is_one_clear_message(version: int) -> None:
    with pytest.raises(UserError, match=rf"protocol version {version}.*daranti flash"):
        Session().feed(0.0, protocol.encode(replace(VERSION, protocol_version=version), 0))


def test_a_refused_request_is_said_in_words_until_one_is_taken() -> None:
    session = met()
    ack = protocol.Ack(protocol.Arm.ID, 0, protocol.Result.NOT_PLAUSIBLE)
    session.feed(0.0, protocol.encode(ack, 1))
    assert session.refusal.startswith("Arm refused: a precondition fails")
    (telemetry,) = session.feed(0.0, protocol.encode(RESTING, 2))
    assert telemetry.refusal == session.refusal
    session.feed(0.0, protocol.encode(replace(ack, result=protocol.Result.OK), 3))
    assert session.refusal == ""


def test_every_result_has_its_words() -> None:
    for result in protocol.Result:
        session = Session()
        session.feed(0.0, protocol.encode(protocol.Ack(2, 0, result), 0))
        assert bool(session.refusal) == (result is not protocol.Result.OK)


def test_a_reset_of_the_firmware_is_counted_and_the_clocks_wrap_is_not() -> None:
    session = Session()
    told = [
        session.feed(0.0, protocol.encode(replace(RESTING, time=time_s), 0))[0].firmware_s
        for time_s in (10.0, 10.02, 0.1, 4294.95, 0.01, 4294.96, 0.02, 5.0, 1.0)
    ]
    assert session.resets == 2
    round_s = 2**32 * 1e-6
    assert told[:5] == pytest.approx([10.0, 10.02, 0.1, 4294.95, round_s + 0.01])
    assert told[5:] == pytest.approx([round_s + 4294.96, 2 * round_s + 0.02, 2 * round_s + 5, 1.0])


@given(st.lists(st.binary(max_size=80)))
def test_after_any_garbage_telemetry_is_taken_again(chunks: list[bytes]) -> None:
    session = Session()
    for chunk in chunks:
        session.feed(0.0, chunk)
    frame = protocol.encode(RESTING, 7)
    assert len(session.feed(1.0, b"\0" + frame)) == 1


# ---- the port ------------------------------------------------------------------------------------


def test_the_handshake_tells_the_firmwares_version(board: FakeFirmware) -> None:
    with Link(board.port, time.monotonic) as link:
        assert link.meet(LIMIT_S) == VERSION


def test_closing_sends_stop(board: FakeFirmware) -> None:
    with Link(board.port, time.monotonic) as link:
        link.meet(LIMIT_S)
    assert board.wait_for(protocol.Stop)


def test_a_crash_of_the_caller_sends_stop(board: FakeFirmware) -> None:
    with pytest.raises(ZeroDivisionError), Link(board.port, time.monotonic):
        _ = 1 / 0
    assert board.wait_for(protocol.Stop)


def test_what_passes_is_tapped_and_counted(board: FakeFirmware) -> None:
    seen: dict[str, bytes] = {"to_firmware": b"", "to_host": b""}

    def tap(direction: str, _stamp: float, data: bytes) -> None:
        seen[direction] += data

    with Link(board.port, time.monotonic) as link:
        link.tap = tap
        link.meet(LIMIT_S)
        assert link.bytes_in == len(seen["to_host"])
    assert sent(seen["to_firmware"])[0] == protocol.Hello(protocol.VERSION)
    assert VERSION in sent(seen["to_host"])


def test_a_lost_request_is_sent_again(board: FakeFirmware) -> None:
    board.deaf_to[protocol.ParamSave] = 1
    with Link(board.port, time.monotonic) as link:
        answer = link.ask(protocol.ParamSave(), timeout_s=0.3)
    assert isinstance(answer, protocol.Ack)


@pytest.mark.parametrize("late", [protocol.Result.OK, protocol.Result.STORE_FAILED])
@pytest.mark.parametrize("result", [protocol.Result.OK, protocol.Result.WRONG_STATE])
def test_a_late_answer_to_an_earlier_request_is_none_to_this(
    board: FakeFirmware, late: protocol.Result, result: protocol.Result
) -> None:
    board.stale = late
    board.refuse[protocol.ParamSave] = result
    with Link(board.port, time.monotonic) as link:
        if result is protocol.Result.OK:
            answer = link.ask(protocol.ParamSave())
            assert isinstance(answer, protocol.Ack)
            assert answer.result is protocol.Result.OK
        else:
            with pytest.raises(UserError, match="not allowed in the present state"):
                link.ask(protocol.ParamSave())


def test_a_value_of_before_or_of_another_parameter_is_no_answer(board: FakeFirmware) -> None:
    asked, other = list(board.params)[:2]
    with Link(board.port, time.monotonic) as link:
        link.meet()
        link.session.answers.append(protocol.ParamValue(asked, board.params[asked] + 1))
        board.write(protocol.encode(protocol.ParamValue(other, board.params[other]), 0))
        answer = link.ask(protocol.ParamGet(asked))
    assert answer == protocol.ParamValue(asked, board.params[asked])


def test_a_refused_request_raises_its_reason(board: FakeFirmware) -> None:
    board.refuse[protocol.ParamSave] = protocol.Result.WRONG_STATE
    with (
        Link(board.port, time.monotonic) as link,
        pytest.raises(UserError, match="ParamSave refused: not allowed in the present state"),
    ):
        link.ask(protocol.ParamSave())


def test_no_answer_is_said(board: FakeFirmware) -> None:
    board.deaf_to[protocol.ParamSave] = 99
    with (
        Link(board.port, time.monotonic) as link,
        pytest.raises(UserError, match="no answer to ParamSave"),
    ):
        link.ask(protocol.ParamSave(), timeout_s=0.05)


def test_a_silent_port_is_said() -> None:
    firmware = FakeFirmware(silent=True)
    with (
        Link(firmware.port, time.monotonic) as link,
        pytest.raises(UserError, match=r"nobody answers within 0\.3 s"),
    ):
        link.meet(0.3)
    firmware.unplug()


def test_somebody_elses_device_is_said() -> None:
    firmware = FakeFirmware(babble=b"GPS ready\r\n")
    with (
        Link(firmware.port, time.monotonic) as link,
        pytest.raises(UserError, match="not Daranti's firmware"),
    ):
        link.meet(0.3)
    firmware.unplug()


def test_a_vanished_port_is_one_message_however_it_is_noticed(board: FakeFirmware) -> None:
    with Link(board.port, time.monotonic) as link:
        link.meet(LIMIT_S)
        board.unplug()
        with pytest.raises(UserError, match=r"vanished.*250 ms"):
            for _ in range(100):
                link.poll(0.1)
        with pytest.raises(UserError, match=r"vanished.*250 ms"):
            link.send(Command(Request.STOP))


def test_a_port_that_takes_no_bytes_is_said() -> None:
    master, slave = pty.openpty()
    with (
        Link(os.ttyname(slave), time.monotonic) as link,
        pytest.raises(UserError, match="takes no bytes"),
    ):
        for _ in range(100_000):
            link.send(Command(Request.STOP))
    os.close(master)
    os.close(slave)


def test_a_missing_port_names_those_that_are_there() -> None:
    with pytest.raises(UserError, match=r"/dev/no-such-port does not exist; ports there now: "):
        Link("/dev/no-such-port", time.monotonic)


@pytest.mark.parametrize("port", ["/dev/null", "/dev/zero", "/tmp", "/etc/hostname"])
def test_what_is_no_serial_port_is_told_without_opening_it(port: str) -> None:
    with pytest.raises(UserError, match="is not a serial port"):
        check_port(port)


def test_a_port_that_is_there_is_not_opened_to_be_checked(board: FakeFirmware) -> None:
    check_port(board.port)
    assert board.received == []


def test_a_taken_port_is_said(board: FakeFirmware) -> None:
    with (
        Link(board.port, time.monotonic),
        pytest.raises(UserError, match="in use by another program"),
    ):
        Link(board.port, time.monotonic)


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ("/etc/hostname", "not a serial port"),
        ("/tmp", "cannot open /tmp"),
        ("socket://127.0.0.1:1", "cannot connect"),
        ("nonsense://x", "cannot connect"),
        ("nonsense://x", "nonsense:// is unknown; give a serial port, socket://HOST:PORT or"),
        ("socket://x", "socket://x: the address needs a host and a port from 1 to 65535"),
        ("socket://127.0.0.1:x", "needs a host and a port"),
        ("socket://127.0.0.1:70000", "needs a host and a port"),
        ("socket://:5000", "needs a host and a port"),
        ("socket://[::1", "needs a host and a port"),
        ("rfc2217://x", "as rfc2217://192.168.1.7:5000"),
        ("", "--port is empty"),
    ],
)
def test_what_is_no_port_is_refused(port: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        Link(port, time.monotonic)


def test_a_port_that_another_program_keeps_for_itself_is_said_to_be_in_use(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As minicom, screen or the system's modem manager do (TIOCEXCL, tty_ioctl(4))."""

    def busy(*_: object, **_more: object) -> None:
        raise OSError(errno.EBUSY, "Device or resource busy")

    monkeypatch.setattr("serial.serial_for_url", busy)
    with pytest.raises(UserError, match="in use by another program"):
        Link("/dev/ttyACM0", time.monotonic)


def test_a_forbidden_port_names_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object, **_more: object) -> None:
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("serial.serial_for_url", forbidden)
    with pytest.raises(UserError, match="dialout"):
        Link("/dev/ttyACM0", time.monotonic)


def test_the_link_works_over_tcp() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            peer, _ = listener.accept()
            with peer:
                parser = protocol.Parser()
                while data := peer.recv(4096):
                    for _, message in parser.feed(data):
                        if isinstance(message, protocol.Hello):
                            peer.sendall(protocol.encode(VERSION, 0))

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with Link(f"socket://127.0.0.1:{listener.getsockname()[1]}", time.monotonic) as link:
            assert link.meet(LIMIT_S) == VERSION
        thread.join(LIMIT_S)
