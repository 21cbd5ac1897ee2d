"""NMEA 0183 from a phone into fixes.

`Receiver` is the parser without I/O; `gnss_feed` runs it on a TCP or UDP port, a serial port or a
file.
"""

from __future__ import annotations

import datetime
import itertools
import math
import re
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import pynmea2

from host.core.errors import UserError
from host.core.messages import Fix
from host.link.port import open_port
from host.sensors.newest import Feed, SourceLostError

KNOT_MPS = 1852 / 3600
"""A knot is a nautical mile, 1852 m, an hour."""
KMH_MPS = 1000 / 3600
"""A kilometre an hour."""
COMPANION_S = 0.3
"""How long GGA waits for the RMC of its epoch, or RMC for GGA: a phone sends them in one burst."""
QUALITIES = range(9)
"""Of GGA: 0 none to 8 simulated."""
NO_SATELLITES = range(6, 9)
"""Of them: estimated, typed in, simulated. No satellite tells such a place, and nobody knows how
far it is off."""
NO_SATELLITES_RMC = ("E", "M", "S", "N")
"""The same as RMC's mode, and none."""
MAX_SENTENCE = 82
"""Characters from `$` to the line's end (NMEA 0183). Phones exceed it; thrice it is garbage."""
NO_VTG = (math.nan, math.nan)
SENTENCE = re.compile(rb"\$[^*]*\*[0-9A-Fa-f]{2}")
"""Up to its checksum. Loggers write the time of arrival behind it, as GnssLogger does."""


@dataclass
class _Epoch:
    """The sentences that share one time of day."""

    time: datetime.time | None
    stamp: float
    gga: pynmea2.GGA | None = None
    rmc: pynmea2.RMC | None = None
    vtg: tuple[float, float] = NO_VTG
    """Knots and km/h of the last one before the epoch was whole: it says no time."""

    @property
    def kinds(self) -> frozenset[str]:
        return frozenset(k for k, s in (("GGA", self.gga), ("RMC", self.rmc)) if s is not None)


def _number(text: object) -> float:
    """A field's number; empty is NaN. Raises ValueError on anything that is not a finite number."""
    if text is None or text == "":
        return math.nan
    value = float(str(text))
    if not math.isfinite(value):
        raise ValueError("not finite")
    return value


def _fix(epoch: _Epoch) -> Fix:
    """Merges an epoch. Raises ValueError where a field is not what NMEA allows."""
    gga = epoch.gga
    rmc = epoch.rmc if epoch.rmc is not None and _tells(epoch.rmc) else None
    quality, hdop, satellites = 0, math.nan, 0
    position = None
    if gga is not None:
        quality = int(_number(gga.gps_qual) if gga.gps_qual not in (None, "") else 0)
        hdop = _number(gga.horizontal_dil)
        satellites = int(gga.num_sats or 0)
        if quality not in QUALITIES or satellites < 0 or hdop < 0:
            raise ValueError("a quality, a count or an HDOP that there is not")
        quality = 0 if quality in NO_SATELLITES else quality
        position = gga
    elif rmc is not None:
        quality = 1
        position = rmc
    speed = course = None
    if rmc is not None:
        if not math.isnan(knots := _number(rmc.spd_over_grnd)):
            speed = _finer_mps(knots, epoch.vtg)
        if not math.isnan(degrees := _number(rmc.true_course)):
            course = math.remainder(math.pi / 2 - math.radians(degrees), math.tau)
    if position is None or quality == 0:
        return Fix(epoch.stamp, math.nan, math.nan, 0, hdop, satellites)
    if "" in (position.lat, position.lon, position.lat_dir, position.lon_dir):
        raise ValueError("a fix without a position")
    if position.lat_dir not in ("N", "S") or position.lon_dir not in ("E", "W"):
        raise ValueError("a direction that there is not")
    lat, lon = float(position.latitude), float(position.longitude)
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise ValueError("position out of range")
    return Fix(epoch.stamp, lat, lon, quality, hdop, satellites, speed, course)


def _tells(rmc: pynmea2.RMC) -> bool:
    """Whether satellites tell what it says. The mode came with NMEA 2.3."""
    return rmc.status == "A" and getattr(rmc, "mode_indicator", "") not in NO_SATELLITES_RMC


def _finer_mps(knots: float, vtg: tuple[float, float]) -> float:
    """The speed that RMC says. Phones say it in tenths of a knot, which is 10 % of a machine's
    speed, and what that errs no mean of many fixes takes away. VTG of the same epoch, which says
    the same knots, has it in tenths of a km/h besides."""
    also_knots, kmh = vtg
    same = also_knots == knots and abs(kmh * KMH_MPS - knots * KNOT_MPS) < KNOT_MPS / 10
    return kmh * KMH_MPS if same else knots * KNOT_MPS


class Receiver:
    """Bytes in, fixes out: GGA and RMC of one epoch make one Fix, quality 0 and NaN without a fix.

    Never raises on what it is fed. `sentences` counts what was understood by type, `bad` what was
    dropped by reason; a sentence without a checksum is dropped, for it proves nothing.
    """

    def __init__(self, tap: Callable[[bytes], object] | None = None) -> None:
        """`tap` is given every byte that comes, as it comes."""
        self._tap = tap
        self.sentences: Counter[str] = Counter()
        self.bad: Counter[str] = Counter()
        self._rest = b""
        self._epoch: _Epoch | None = None
        self._vtg = NO_VTG
        self._emitted: datetime.time | None = None

    def feed(self, now: float, data: bytes) -> list[Fix]:
        """`now` is the bytes' arrival time; a fix carries that of its epoch's first sentence. Call
        it with b"" when nothing came: an epoch does not wait for its second sentence for ever."""
        if self._tap is not None and data:
            self._tap(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > 3 * MAX_SENTENCE:
            self._rest = b""
            self.bad["endless line"] += 1
        fixes: list[Fix] = []
        for line in lines:
            fixes += self._line(now, line.strip())
        if self._epoch is not None and now - self._epoch.stamp > COMPANION_S:
            fixes += self.flush()
        return fixes

    def flush(self) -> list[Fix]:
        """The epoch that still waits for its second sentence, as it is."""
        epoch, self._epoch = self._epoch, None
        if epoch is None:
            return []
        self._emitted = epoch.time
        epoch.vtg, self._vtg = self._vtg, NO_VTG
        try:
            return [_fix(epoch)]
        except (ValueError, TypeError, AttributeError):
            for kind in epoch.kinds:
                self._drop(kind)
            return []

    def _line(self, now: float, line: bytes) -> list[Fix]:
        if not line:
            return []
        start = line.rfind(b"$")
        if start > 0:
            self.bad["cut off"] += 1
        try:
            line = line[max(start, 0) :]
            whole = SENTENCE.match(line)
            text = (whole.group() if whole else line).decode("ascii")
            sentence = pynmea2.parse(text, check=True)
        except UnicodeDecodeError:
            self.bad["not ASCII"] += 1
        except pynmea2.ChecksumError:
            self.bad["checksum"] += 1
        except pynmea2.SentenceTypeError:
            self.sentences["other"] += 1
        except (ValueError, TypeError, IndexError, AttributeError):
            self.bad["malformed"] += 1
        else:
            return self._sentence(now, sentence)
        return []

    def _sentence(self, now: float, sentence: pynmea2.NMEASentence) -> list[Fix]:
        kind = str(getattr(sentence, "sentence_type", "other"))
        self.sentences[kind] += 1
        if isinstance(sentence, pynmea2.VTG):
            try:
                said = sentence.spd_over_grnd_kts, sentence.spd_over_grnd_kmph
                self._vtg = _number(said[0]), _number(said[1])
            except (ValueError, TypeError, ArithmeticError):
                self._vtg = NO_VTG
                self._drop(kind)
        if not isinstance(sentence, (pynmea2.GGA, pynmea2.RMC)):
            return []
        time = sentence.timestamp
        if time is not None and not isinstance(time, datetime.time):
            self._drop(kind)
            return []
        fixes: list[Fix] = []
        epoch = self._epoch
        if epoch is not None and epoch.time == time is not None and kind in epoch.kinds:
            return []  # of another receiver, or of another of its systems: the first one counts
        if epoch is None or epoch.time != time or kind in epoch.kinds:
            fixes = self.flush()
            if time is not None and time == self._emitted:
                return fixes
            epoch = self._epoch = _Epoch(time, now)
        if isinstance(sentence, pynmea2.GGA):
            epoch.gga = sentence
        else:
            epoch.rmc = sentence
        if epoch.kinds == {"GGA", "RMC"}:
            fixes += self.flush()
        return fixes

    def _drop(self, kind: str) -> None:
        self.sentences[kind] -= 1
        self.bad[f"{kind} field"] += 1


BAUDS = (9600, 38400, 115200, 4800, 57600)
"""Of a receiver's serial port, the usual first: u-blox's modules up to the M8 have 9600, later ones
38400 (their interface descriptions, UART1); over USB and Bluetooth it counts for nothing."""
UNREAD_BYTES = 1000
"""Without one sentence: two epochs' at the right speed, so this is another one."""
EPOCHLESS_S = 5.0
"""A receiver that speaks and gives no new epoch for so long gives none that one could drive by."""
READ_S = 0.1
"""Longest wait for bytes, so that a feed that is closed ends soon."""
CONNECT_S = 5.0
"""Longest wait for the phone to take the connection."""
BYTES_AT_ONCE = 4096
"""Several epochs; a receiver sends 500 bytes a second."""


DATAGRAM_BYTES = 65_536
"""More than any holds; the rest of a longer one would be lost."""


def _serial_reader(path: str, receiver: Receiver) -> Iterator[bytes]:
    """What came within READ_S, perhaps nothing, for ever; at another speed where what comes is
    nothing that the receiver reads."""
    try:
        opened = open_port(path, BAUDS[0], READ_S)
    except UserError as error:
        raise SourceLostError(str(error)) from error
    with opened as port:
        for baud in itertools.cycle(BAUDS):
            port.baudrate = baud
            unread, before = 0, receiver.sentences.total()
            while unread < UNREAD_BYTES:
                data = port.read(max(1, min(BYTES_AT_ONCE, port.in_waiting)))
                yield data
                unread = 0 if receiver.sentences.total() > before else unread + len(data)


def _tcp_reader(host: str, tcp_port: int) -> Iterator[bytes]:
    """The same from a TCP server. (pyserial's socket:// discards what has come when it opens.)"""
    with socket.create_connection((host, tcp_port), CONNECT_S) as connection:
        connection.settimeout(READ_S)
        while True:
            try:
                data = connection.recv(BYTES_AT_ONCE)
            except TimeoutError:
                yield b""
                continue
            if not data:
                raise OSError("the phone has closed the connection")
            yield data


def _udp_reader(host: str, udp_port: int) -> Iterator[bytes]:
    """The same of an app that sends datagrams to this laptop, each of whole sentences: some end
    them without a line's end."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM) as at:
        at.bind((host, udp_port))
        at.settimeout(READ_S)
        while True:
            try:
                yield at.recv(DATAGRAM_BYTES) + b"\n"
            except TimeoutError:
                yield b""


def _from_port(
    reader: Callable[[], Iterator[bytes]], receiver: Receiver, feed: Feed[Fix]
) -> Iterator[Fix]:
    heard = told = feed.clock()
    before = receiver.sentences.copy()
    try:
        for data in reader():
            now = feed.clock()
            if data:
                heard = now
            elif now - heard > feed.silence_s:
                raise SourceLostError(f"silent for {feed.silence_s:.0f} s")
            for fix in receiver.feed(now, data):
                told, before = now, receiver.sentences.copy()
                yield fix
            if now - told > EPOCHLESS_S:
                feed.doubt(_epochless(receiver.sentences - before))
                told, before = now, receiver.sentences.copy()
            if feed.stopping:
                return
    except (OSError, ValueError) as error:
        raise SourceLostError(str(error)) from error


def _epochless(heard: Counter[str]) -> str:
    """Why no position comes of the sentences that have been heard meanwhile, by their types."""
    if not heard:
        return (
            "what it sends is no NMEA: is the address right, and does a serial port run at one of "
            f"{', '.join(map(str, sorted(BAUDS)))} baud?"
        )
    if heard["GGA"] + heard["RMC"] == 0:
        return "it sends NMEA without a position: switch GGA and RMC on in its settings"
    return "it repeats an old position: restart it, or the phone's app"


def _from_file(path: Path, receiver: Receiver, feed: Feed[Fix]) -> Iterator[Fix]:
    """Plays a recorded stream at one epoch a second, once."""
    with path.open("rb") as lines:
        for line in lines:
            for fix in receiver.feed(feed.clock(), line):
                yield fix
                feed.pause(1.0)
    yield from receiver.flush()
    raise SourceLostError("end of the file", final=True)


def gnss_feed(
    url: str,
    clock: Callable[[], float],
    report: Callable[[str], None],
    tap: Callable[[bytes], object] | None = None,
) -> tuple[Feed[Fix], Receiver]:
    """`url`: tcp://HOST:PORT (what phone apps offer), udp://:PORT (where they send to), a serial
    port (/dev/ttyUSB0), or a file.

    The feed runs when it is started; the receiver carries the counts and hands every byte to `tap`,
    in the feed's thread. Raises UserError on a URL that cannot mean any of these.
    """
    receiver = Receiver(tap)
    parts = urlsplit(url)
    path = Path(url)
    source: Callable[[Feed[Fix]], Iterator[Fix]]
    if parts.scheme in ("tcp", "socket"):
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if not host or not port:
            raise UserError(
                f"GNSS address {url}: needs a host and a port, as tcp://192.168.1.7:2947"
            )
        source = partial(_from_port, partial(_tcp_reader, host, port), receiver)
    elif parts.scheme == "udp":
        try:
            port = parts.port
        except ValueError:
            port = None
        if not port:
            raise UserError(
                f"GNSS address {url}: needs the port that the app sends to, as udp://:5005"
            )
        source = partial(_from_port, partial(_udp_reader, parts.hostname or "", port), receiver)
    elif path.is_file():
        source = partial(_from_file, path, receiver)
    elif path.is_char_device():
        source = partial(_from_port, partial(_serial_reader, url, receiver), receiver)
    elif path.exists() and not parts.scheme:
        raise UserError(f"GNSS source {url} is neither a serial port nor an NMEA file; name one")
    elif parts.scheme:
        raise UserError(
            f"GNSS address {url}: scheme {parts.scheme}:// is unknown; use tcp://HOST:PORT or "
            "udp://:PORT"
        )
    else:
        raise UserError(
            f"GNSS source {url} does not exist; give tcp://HOST:PORT, a serial port or an NMEA file"
        )
    return Feed("GNSS", source, clock, report), receiver
