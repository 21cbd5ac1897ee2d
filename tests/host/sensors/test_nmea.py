"""NMEA in, fixes out: facts about the receiver, the local frame and the sources."""

from __future__ import annotations

import itertools
import math
import os
import pty
import socket
import termios
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.link.port import open_port
from host.sensors.newest import Feed
from host.sensors.nmea import COMPANION_S, UNREAD_BYTES, Receiver, _from_port, gnss_feed
from tests.helpers.real_data import real

LIMIT_S = 10.0


def sentence(body: str) -> bytes:
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def gga(time_of_day: str = "112511", quality: int = 2, lat: str = "4930.157756") -> bytes:
    position = f"{lat},N,00556.246941,E" if quality else ",,,"
    return sentence(f"GPGGA,{time_of_day},{position},{quality},12,0.6,314.0,M,48.0,M,,")


def rmc(
    time_of_day: str = "112511", knots: str = "2.7", course: str = "90.0", status: str = "A"
) -> bytes:
    position = f"{status},4930.157756,N,00556.246941,E"
    return sentence(f"GPRMC,{time_of_day},{position},{knots},{course},271022,1.1,W,D")


def vtg(knots: str, kmh: str) -> bytes:
    return sentence(f"GPVTG,90.0,T,90.0,M,{knots},N,{kmh},K,A")


@pytest.mark.parametrize(
    ("order", "speed_mps"),
    [
        pytest.param((vtg("1.0", "1.8"), rmc(knots="1.0"), gga()), 0.5, id="a phone"),
        pytest.param((rmc(knots="1.0"), vtg("1.0", "1.9"), gga()), 1.9 / 3.6, id="u-blox"),
        pytest.param((vtg("1.1", "2.0"), rmc(knots="1.0"), gga()), 0.5144, id="of another epoch"),
        pytest.param(
            (vtg("1.0", "5.0"), rmc(knots="1.0"), gga()), 0.5144, id="it contradicts itself"
        ),
        pytest.param((vtg("1.0", ""), rmc(knots="1.0"), gga()), 0.5144, id="it says none"),
        pytest.param((vtg("1.0", "x"), rmc(knots="1.0"), gga()), 0.5144, id="nobody reads it"),
        pytest.param((rmc(knots="1.0"), gga()), 0.5144, id="there is none"),
    ],
)
def test_a_speed_is_as_fine_as_the_receiver_says_it(
    order: tuple[bytes, ...], speed_mps: float
) -> None:
    """RMC says tenths of a knot, VTG tenths of a km/h besides."""
    receiver = Receiver()
    (fix,) = receiver.feed(0.0, b"".join(order))
    assert fix.speed_mps == pytest.approx(speed_mps, abs=1e-4)
    assert (receiver.bad["VTG field"] == 1) is (b",x,K" in b"".join(order))


def test_a_vtg_counts_for_one_epoch() -> None:
    receiver = Receiver()
    receiver.feed(0.0, vtg("1.0", "1.8") + rmc(knots="1.0") + gga())
    (fix,) = receiver.feed(1.0, rmc("112512", knots="1.0") + gga("112512"))
    assert fix.speed_mps == pytest.approx(0.5144, abs=1e-4)


def test_gga_and_rmc_of_one_epoch_make_one_fix() -> None:
    for order in ((gga(), rmc()), (rmc(), gga())):
        (fix,) = Receiver().feed(7.0, b"".join(order))
        assert fix.stamp == 7.0
        assert fix.lat_deg == pytest.approx(49 + 30.157756 / 60, abs=1e-9)
        assert fix.lon_deg == pytest.approx(5 + 56.246941 / 60, abs=1e-9)
        assert (fix.quality, fix.hdop, fix.satellites) == (2, 0.6, 12)
        assert fix.speed_mps == pytest.approx(2.7 * 0.514444, abs=1e-5)
        assert fix.course_rad == pytest.approx(0.0, abs=1e-12), "east is heading 0"


@pytest.mark.parametrize(
    ("compass_deg", "heading_rad"),
    [("0.0", math.pi / 2), ("90.0", 0.0), ("180.0", -math.pi / 2), ("225.0", -3 * math.pi / 4)],
)
def test_course_becomes_a_counter_clockwise_heading(compass_deg: str, heading_rad: float) -> None:
    (fix,) = Receiver().feed(0.0, gga() + rmc(course=compass_deg))
    assert fix.course_rad == pytest.approx(heading_rad)


def test_the_same_epoch_written_with_a_fraction_is_still_one() -> None:
    (fix,) = Receiver().feed(0.0, gga("112511") + rmc("112511.00"))
    assert fix.speed_mps is not None


def test_an_epoch_without_its_companion_is_emitted_late_but_with_its_own_stamp() -> None:
    receiver = Receiver()
    assert receiver.feed(1.0, gga()) == []
    assert receiver.feed(1.0 + COMPANION_S / 2, b"") == []
    (fix,) = receiver.feed(1.0 + 2 * COMPANION_S, b"")
    assert fix.stamp == 1.0
    assert fix.speed_mps is None


def test_a_companion_that_comes_after_its_epoch_was_emitted_is_no_second_fix() -> None:
    receiver = Receiver()
    receiver.feed(1.0, gga())
    assert len(receiver.feed(2.0, b"")) == 1
    assert receiver.feed(2.1, rmc()) == []
    assert len(receiver.feed(3.0, gga("112512") + rmc("112512"))) == 1


def test_a_lost_sentence_costs_no_neighbouring_epoch() -> None:
    receiver = Receiver()
    fixes = receiver.feed(0.0, gga("112511") + gga("112512") + rmc("112512"))
    assert [fix.speed_mps is None for fix in fixes] == [True, False]


def test_no_fix_is_said_as_quality_0_and_nan() -> None:
    (fix,) = Receiver().feed(0.0, b"$GPRMC,,V,,,,,,,,,,N*53\r\n$GPGGA,,,,,,0,,,,,,,,*66\r\n")
    assert fix.quality == 0
    assert math.isnan(fix.lat_deg)
    assert math.isnan(fix.lon_deg)
    assert fix.speed_mps is None


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (gga().replace(b"4930", b"4931"), "checksum"),
        (gga().split(b"*")[0] + b"\r\n", "checksum"),
        (b"\xff\xfe\x00hello\r\n", "not ASCII"),
        (b"hello\r\n", "malformed"),
        (gga()[:20] + gga("112512"), "cut off"),
        (b"x" * 1000, "endless line"),
        (gga(lat="ABCD"), "GGA field"),
        (gga(lat="9930.157756"), "GGA field"),
    ],
)
def test_bad_sentences_are_counted_by_reason_and_the_next_good_one_is_taken(
    line: bytes, reason: str
) -> None:
    receiver = Receiver()
    receiver.feed(0.0, line)
    receiver.feed(1.0, b"\r\n" if b"\n" not in line else b"")
    assert receiver.bad[reason] == 1
    fixes = receiver.feed(2.0, gga("112520") + rmc("112520"))
    assert fixes[-1].speed_mps is not None


@pytest.mark.parametrize(
    "body",
    [
        "GPGGA,112511,4930.157756,N,00556.246941,E,-1,12,0.6,314.0,M,48.0,M,,",
        "GPGGA,112511,4930.157756,N,00556.246941,E,9,12,0.6,314.0,M,48.0,M,,",
        "GPGGA,112511,4930.157756,N,00556.246941,X,1,12,0.6,314.0,M,48.0,M,,",
        "GPGGA,112511,4930.157756,Q,00556.246941,E,1,12,0.6,314.0,M,48.0,M,,",
        "GPGGA,112511,4930.157756,N,00556.246941,E,1,-3,0.6,314.0,M,48.0,M,,",
        "GPGGA,112511,4930.157756,N,00556.246941,E,1,12,-0.6,314.0,M,48.0,M,,",
    ],
)
def test_what_no_receiver_can_mean_is_no_fix(body: str) -> None:
    receiver = Receiver()
    assert receiver.feed(0.0, sentence(body)) + receiver.flush() == []
    assert receiver.bad == {"GGA field": 1}


def test_a_sentence_after_one_that_was_cut_off_is_taken() -> None:
    receiver = Receiver()
    (fix,) = receiver.feed(0.0, gga("112511")[:20] + gga("112512") + rmc("112512"))
    assert fix.speed_mps is not None
    assert receiver.bad == {"cut off": 1}


@pytest.mark.parametrize("form", [b"NMEA,%s,1780142400123\r\n", b"2026-06-01 10:00:00 %s\n"])
def test_what_a_logger_writes_around_a_sentence_costs_nothing(form: bytes) -> None:
    receiver = Receiver()
    stream = b"".join(form % line.strip() for line in (gga(), rmc()))
    assert receiver.feed(0.0, stream) == Receiver().feed(0.0, gga() + rmc()) != []


@pytest.mark.parametrize("quality", [6, 7, 8])
def test_a_place_that_no_satellite_tells_is_no_fix(quality: int) -> None:
    (fix,) = Receiver().feed(0.0, gga(quality=quality) + rmc())
    assert fix.quality == 0
    assert math.isnan(fix.lat_deg)


@pytest.mark.parametrize("mode", ["E", "M", "S", "N"])
def test_a_receiver_that_sends_rmc_alone_says_so_too(mode: str) -> None:
    receiver = Receiver()
    said = sentence(f"GPRMC,112511,A,4930.157756,N,00556.246941,E,2.7,90,271022,1.1,W,{mode}")
    assert receiver.feed(0.0, said) == []
    (fix,) = receiver.flush()
    assert (fix.quality, fix.speed_mps, fix.course_rad) == (0, None, None)


@pytest.mark.parametrize("mode", [",A", ",D", ",R", ",F", ""])
def test_of_an_rmc_alone_every_fix_by_satellites_counts(mode: str) -> None:
    receiver = Receiver()
    receiver.feed(0.0, sentence(f"GPRMC,112511,A,4930.157,N,00556.246,E,2.7,90,271022,1.1,W{mode}"))
    (fix,) = receiver.flush()
    assert fix.quality == 1


def test_a_speed_that_the_receiver_itself_calls_void_is_none() -> None:
    (fix,) = Receiver().feed(0.0, gga() + rmc(status="V"))
    assert fix.quality == 2
    assert (fix.speed_mps, fix.course_rad) == (None, None)


@given(st.lists(st.one_of(st.binary(max_size=200), st.sampled_from([gga(), rmc(), b"$", b"\n"]))))
def test_garbage_never_raises(chunks: list[bytes]) -> None:
    receiver = Receiver()
    for now, chunk in enumerate(chunks):
        for fix in receiver.feed(float(now), chunk):
            assert isinstance(fix, Fix)
    receiver.feed(1e6, b"\n")
    (fix,) = receiver.feed(1e6, gga("235959") + rmc("235959"))
    assert fix.quality == 2


@given(
    st.text(st.characters(codec="ascii", exclude_characters="*$\r\n"), max_size=60),
    st.sampled_from(["GPGGA,", "GPRMC,", "GNGGA,112511,", "GPRMC,112511,A,", "PUBX,", ""]),
)
def test_well_summed_nonsense_never_raises(body: str, kind: str) -> None:
    receiver = Receiver()
    receiver.feed(0.0, sentence(kind + body))
    receiver.flush()


@given(st.integers(1, 400))
def test_fixes_do_not_depend_on_how_the_bytes_are_cut(size: int) -> None:
    stream = b"".join(gga(f"1125{n:02d}") + rmc(f"1125{n:02d}") for n in range(10))
    receiver = Receiver()
    fixes = [
        fix
        for start in range(0, len(stream), size)
        for fix in receiver.feed(0.0, stream[start : start + size])
    ]
    assert fixes == Receiver().feed(0.0, stream)
    assert len(fixes) == 10


def test_a_real_phones_stream_is_understood_to_the_last_sentence() -> None:
    path = real("gps/phone-walk.nmea")
    receiver = Receiver()
    fixes = receiver.feed(0.0, path.read_bytes()) + receiver.flush()
    assert sum(receiver.sentences.values()) == 27_093
    assert not receiver.bad
    found = [fix for fix in fixes if fix.quality > 0]
    assert len(found) == 2_628
    frame = LocalFrame(found[0].lat_deg, found[0].lon_deg)
    track = [frame.to_local(fix.lat_deg, fix.lon_deg) for fix in found]
    steps = [math.dist(a, b) for a, b in pairwise(track)]
    assert sum(steps) == pytest.approx(3_700, rel=0.01)
    assert max(steps) == pytest.approx(40, abs=0.1), "its one jump"


@given(
    st.floats(-60, 60),
    st.floats(-179, 179),
    st.floats(-2000, 2000),
    st.floats(-2000, 2000),
)
def test_the_local_frame_goes_there_and_back(lat: float, lon: float, x: float, y: float) -> None:
    frame = LocalFrame(lat, lon)
    # PROJ takes what is within 1e-10 of the radius, 0.64 mm, for the origin itself.
    assert frame.to_local(*frame.to_wgs84(x, y)) == pytest.approx((x, y), abs=1e-3)


def test_the_local_frame_is_east_and_north_in_true_metres() -> None:
    lat, lon = 31.5, 74.3
    frame = LocalFrame(lat, lon)
    # Radii of curvature of the WGS 84 ellipsoid at this latitude.
    a, e2 = 6378137.0, 6.69437999014e-3
    w = 1 - e2 * math.sin(math.radians(lat)) ** 2
    north, east = a * (1 - e2) / w**1.5, a / math.sqrt(w) * math.cos(math.radians(lat))
    step = 1e-3
    assert frame.to_local(lat + step, lon) == pytest.approx(
        (0, math.radians(step) * north), abs=1e-3
    )
    assert frame.to_local(lat, lon + step) == pytest.approx(
        (math.radians(step) * east, 0), abs=1e-3
    )


@pytest.mark.parametrize(
    "url", ["tcp://", "tcp://host:x", "udp://", "udp://:x", "ftp://host/x", "/dev/no-such-port", ""]
)
def test_a_source_that_cannot_be_is_refused_in_one_message(url: str) -> None:
    with pytest.raises(UserError, match="GNSS"):
        gnss_feed(url, time.monotonic, print)


@contextmanager
def server(*conversations: bytes) -> Iterator[str]:
    """Serves one conversation a connection over TCP, closing after each."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            for data in conversations:
                peer, _ = listener.accept()
                with peer:
                    peer.sendall(data)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(LIMIT_S)


def test_a_phone_that_goes_and_comes_back_is_reported_and_heard_again() -> None:
    reports: list[str] = []
    with server(gga() + rmc(), gga("112520") + rmc("112520")) as url:
        feed, receiver = gnss_feed(url, time.monotonic, reports.append)
        feed.start()
        while feed.count < 2:
            assert feed.wait(LIMIT_S)
            assert feed.take() is not None
        feed.close()
    assert receiver.sentences["GGA"] == 2
    assert reports[0].startswith("GNSS lost")
    assert "GNSS is back" in reports


def test_a_phone_that_falls_silent_is_reported() -> None:
    reports: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:
        clock = itertools.count(0.0, 1.0)  # a second a look
        url = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        feed, _ = gnss_feed(url, lambda: next(clock), reports.append)
        feed.start()
        peer, _ = listener.accept()
        with peer:
            deadline = time.monotonic() + LIMIT_S
            while not reports and time.monotonic() < deadline:
                threading.Event().wait(0.01)
        feed.close()
    assert reports[0] == "GNSS lost: silent for 3 s"


@pytest.mark.parametrize("end", [b"\r\n", b""])
def test_an_app_that_sends_datagrams_is_heard(end: bytes) -> None:
    reports: list[str] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as phone:
        phone.bind(("127.0.0.1", 0))  # a port that is free, given back below
        port = phone.getsockname()[1]
    feed, _ = gnss_feed(f"udp://127.0.0.1:{port}", time.monotonic, reports.append)
    feed.start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as phone:
        deadline = time.monotonic() + LIMIT_S
        fix = None
        for second in itertools.count():  # what is sent before it listens is lost
            assert time.monotonic() < deadline, reports
            for said in (gga(f"1125{second % 60:02d}"), rmc(f"1125{second % 60:02d}")):
                phone.sendto(said.strip() + end, ("127.0.0.1", port))
            if feed.wait(0.05):
                fix = feed.take()
            if fix is not None and fix.quality == 2:  # of the first second half may be lost
                break
    feed.close()
    assert fix.speed_mps == pytest.approx(2.7 * 1852 / 3600)


GSV = sentence("GPGSV,1,1,01,01,40,083,46,1")


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        pytest.param(GSV, "without a position: switch GGA and RMC on", id="GSV alone"),
        pytest.param(b"\x80\xf8x\n", "no NMEA: is the address right", id="another baud rate"),
        pytest.param(GSV + gga() + rmc(), "repeats an old position", id="an old position"),
    ],
)
def test_a_receiver_that_speaks_and_gives_no_new_position_is_said_once(
    said: bytes, problem: str
) -> None:
    """It is connected and never silent: the screen would say that all is well."""
    clock = itertools.count()
    reports: list[str] = []
    receiver = Receiver()
    stream = itertools.chain([gga() + rmc()], itertools.repeat(said, 30), [gga("112520")])
    reader = itertools.chain(stream, [b""])
    feed: Feed[Fix] = Feed(
        "GNSS",
        partial(_from_port, lambda: reader, receiver),
        lambda: float(next(clock)),
        reports.append,
    )
    feed.start()
    while feed.count < 2:
        assert feed.wait(LIMIT_S)
        feed.take()
    feed.close()
    assert [report for report in reports if problem in report] == reports[:1]
    assert reports[1] == "GNSS is back"


def test_of_two_systems_that_tell_one_epoch_the_first_counts_with_its_speed() -> None:
    both = gga() + sentence("GNGGA,112511,4930.158756,N,00556.246941,E,2,20,0.5,314.0,M,48.0,M,,")
    both += rmc() + sentence("GNRMC,112511,A,4930.158756,N,00556.246941,E,2.7,90.0,271022,1.1,W,D")
    (fix,) = Receiver().feed(0.0, both)
    assert fix.satellites == 12
    assert fix.speed_mps == pytest.approx(2.7 * 1852 / 3600)


def test_a_port_that_the_board_holds_is_not_read_from_besides() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    port = os.ttyname(theirs)
    reports: list[str] = []
    with open_port(port):
        feed, _ = gnss_feed(port, time.monotonic, reports.append)
        feed.start()
        assert not feed.wait(0.3)
        os.write(ours, gga() + rmc())
        assert not feed.wait(0.3)
        feed.close()
    assert reports == [f"GNSS lost: {port} is in use by another program; close it first"]
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize("speed", [termios.B9600, termios.B38400, termios.B57600])
def test_a_receiver_is_heard_at_whatever_speed_it_sends(speed: int) -> None:
    """One of another speed is garbage."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    reports: list[str] = []
    feed, _ = gnss_feed(os.ttyname(theirs), time.monotonic, reports.append)
    feed.start()
    until = time.monotonic() + 10.0
    while not feed.wait(0.02) and time.monotonic() < until:
        heard = termios.tcgetattr(ours)[4] == speed
        os.write(ours, gga() + rmc() if heard else bytes(range(0x80, 0x100)) * 2)
    fix = feed.take()
    assert fix is not None and fix.satellites == 12
    for second in range(12, 12 + 2 * UNREAD_BYTES // len(gga() + rmc())):
        os.write(ours, gga(f"1125{second}") + rmc(f"1125{second}"))
        assert feed.wait(LIMIT_S)
        assert feed.take().satellites == 12
    assert termios.tcgetattr(ours)[4] == speed, "it stays with the speed that it has found"
    feed.close()
    assert reports == []
    os.close(ours)
    os.close(theirs)


def test_a_file_is_played_and_its_end_is_final(tmp_path: Path) -> None:
    path = tmp_path / "walk.nmea"
    path.write_bytes(gga())
    reports: list[str] = []
    feed, _ = gnss_feed(str(path), time.monotonic, reports.append)
    feed.start()
    assert feed.wait(LIMIT_S)
    assert feed.take() is not None
    assert not feed.wait(LIMIT_S), "nothing comes after the end"
    assert reports == ["GNSS lost: end of the file"]
