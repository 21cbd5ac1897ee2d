"""The phone's gyroscope, for the yaw of dead reckoning.

The steering angle says what the machine turns only as well as its pot, its tyres and its way are
known: some 3 % of a turn, and a few tenths of a degree a metre. A gyroscope has none of that; it
has an offset, a state of the filter (`host.estimate.position`): every stand shows it
(`host.estimate.measurements.rest`), and a straight edge does.

The two watch each other. Where they differ by more than both err together, and by more than a pot
whose middle is off makes, which shows soon enough (`Odometry.trim_rad`), or a roll that may have
gone either way, the steering angle is believed, as on a machine without a gyroscope, until a turn
has shown that they agree again.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.core.messages import Turned

OFFSET_SIGMA: Final = math.radians(3.0)
"""Of the offset, rad/s, before the machine has stood: a data sheet's over life."""
OFFSET_KNOWN: Final = math.radians(0.1)
"""rad/s; known less well it is of no use beside the steering angle."""
REST_NOISE: Final = math.radians(0.03)
"""What a gyroscope at rest errs at least, rad over the square root of a second; a phone's is half
of it. One that is shaken at rest shows more from word to word, and is taken at that."""
REST_WORDS: Final = 20
"""Of which that is the mean, some two seconds of rest."""
PUSHED: Final = math.radians(2.0)
"""rad/s: a machine that turns so while its wheels stand is moved by somebody."""
MOVING_NOISE: Final = math.radians(0.08)
"""What it errs on a machine that drives, rad over the square root of a second, before that has
shown: most of it is what the machine shakes it by."""
MOVING_WORDS: Final = 100
"""Of which its mean is taken, some ten seconds of driving straight;"""
STRAIGHT: Final = math.radians(5.0)
"""rad/s: less is straight. In a turn the two differ by what one lags behind the other."""
WINDOW_S: Final = 4.0
"""Over which it is compared with the steering angle."""
DIFFER_RAD: Final = math.radians(4.0)
DIFFER_SHARE: Final = 0.3
"""By which the two may differ, and as a share of what was turned, to and fro: the pot's slack, the
slip of tyres at full lock, and a gyroscope that tells of a turn when the machine turns back."""
AGREE_RAD: Final = math.radians(60.0)
"""To be turned in agreement before a gyroscope that was contradicted is believed again: one that
hangs agrees as long as nothing turns."""


class Stand(NamedTuple):
    """The machine stands, as far as its wheels show."""

    lasted_s: float
    unseen_radps: float
    """That it may turn meanwhile, for all that they show: its brake lets it creep, and its steering
    is at an angle."""


class Rest(NamedTuple):
    """What it shows of its offset at rest, besides what is taken off it: rad/s, and variance."""

    rate_radps: float
    variance: float


class _Sums(NamedTuple):
    """Over a window, rad."""

    seen: float
    reckoned: float
    to_and_fro: float
    """What was reckoned, whichever way;"""
    taken: float
    """what the yaw was corrected by;"""
    doubt: float
    """and what the angle may be off by."""


class _Window:
    """What both said of late, step by step."""

    def __init__(self) -> None:
        self._rows = np.empty((256, 6))
        self._begin = self._end = 0
        """Of those that count."""

    def add(
        self,
        stamp: float,
        seen_rad: float,
        reckoned_rad: float,
        taken_rad: float,
        doubt_rad: float,
    ) -> _Sums:
        """A step; `taken_rad`: what it corrected the yaw by; `doubt_rad`: what the angle
        may be off by. What is too old is forgotten. Returns what those of late come to."""
        if self._end == len(self._rows):
            left = self._rows[self._begin :].copy()
            if 2 * len(left) > len(self._rows):
                self._rows = np.empty((2 * len(self._rows), 6))
            self._rows[: len(left)] = left
            self._begin, self._end = 0, len(left)
        row = stamp, seen_rad, reckoned_rad, abs(reckoned_rad), taken_rad, doubt_rad
        self._begin, *sums = _add(self._rows, self._begin, self._end, row)
        self._end += 1
        return _Sums(*sums)

    def clear(self) -> None:
        """Forgets all."""
        self._begin = self._end = 0


@compiled("(f8[:, ::1], i8, i8, UniTuple(f8, 6))")
def _add(
    rows: NDArray[np.float64],
    begin: int,
    end: int,
    row: tuple[float, float, float, float, float, float],
) -> tuple[int, float, float, float, float, float]:
    """Puts a row (stamp and five numbers) behind those from `begin` to `end`. Returns where they
    begin from now on, and the sum of each of the five from there. Compiled: it is due at each
    step, and adds up some eighty."""
    for k in range(6):
        rows[end, k] = row[k]
    while rows[begin, 0] < row[0] - WINDOW_S:
        begin += 1
    a = b = c = d = e = 0.0
    for k in range(begin, end + 1):
        a += rows[k, 1]
        b += rows[k, 2]
        c += rows[k, 3]
        d += rows[k, 4]
        e += rows[k, 5]
    return begin, a, b, c, d, e


class Gyroscope:
    """What it shows beyond what the steering angle does."""

    def __init__(self) -> None:
        self._last: Turned | None = None
        self._reckoned = 0.0
        self.offset, self.offset_sigma = 0.0, OFFSET_SIGMA
        """What is taken off the rate, rad/s, and how surely: the filter says it."""
        self._rests: list[Rest] = []
        self._scale = 1.0
        self._leg = (0.0, 0.0)
        self.known_to = -math.inf
        """The latest time up to which it told what was turned without a gap."""
        self._rest_rate: float | None = None
        """The word before, where it was one of rest."""
        self._rest_power = REST_NOISE**2
        self._moving_rate: float | None = None
        """What it showed besides the steering angle at the word before, rad/s, driving straight."""
        self._moving_power = MOVING_NOISE**2
        self._steps = _Window()
        self._agreed_rad: float | None = None
        """Turned in agreement since it was contradicted; None: it is believed."""

    @property
    def contradicted(self) -> bool:
        """Whether the steering angle says otherwise, so that it is not believed."""
        return self._agreed_rad is not None

    @property
    def useful(self) -> bool:
        """Whether its offset is known, and nothing contradicts it."""
        return self.offset_sigma < OFFSET_KNOWN and not self.contradicted

    @property
    def noise(self) -> float:
        """What it errs while the machine drives, as it has shown: rad over the square root of a
        second."""
        return math.sqrt(self._moving_power)

    @property
    def stamp(self) -> float:
        """Of what it said last."""
        return self._last.stamp if self._last is not None else -math.inf

    def take(
        self,
        turned: Turned,
        reckoned_rad: float | None,
        stand: Stand | None,
        doubt_rad: float = 0.0,
    ) -> float:
        """What the yaw is to be corrected by, rad. `reckoned_rad`: the yaw by the steering angle at
        its stamp, None where that is not known any more; `stand`: since what it said last, None
        where the machine moves or may turn unseen; `doubt_rad`: what the steering angle
        may err of the way since then: its pot's middle may be off, and a machine that rolled may
        have rolled the other way."""
        last, before = self._last, self._reckoned
        self._last = turned
        if reckoned_rad is not None:
            self._reckoned = reckoned_rad
        if last is None or turned.since != last.since or reckoned_rad is None:
            self._steps.clear()
            return 0.0
        dt = turned.stamp - last.stamp
        if dt <= 0.0:
            return 0.0
        rate = (turned.yaw_rad - last.yaw_rad) / dt
        self.known_to = turned.stamp
        if stand is not None:
            self._moving_rate = None
            self._rest(rate, dt, stand)
            return 0.0
        self._rest_rate = None
        seen = self._scale * (rate - self.offset) * dt
        reckoned = reckoned_rad - before
        self._shaken((seen - reckoned) / dt, reckoned / dt, dt)
        self._leg = (self._leg[0] + seen, self._leg[1] + reckoned)
        taken = seen - reckoned if self.useful else 0.0
        late = self._steps.add(turned.stamp, seen, reckoned, taken, doubt_rad)
        return taken + self._compared(reckoned, late)

    def take_rests(self) -> list[Rest]:
        """What stands have shown since the last call."""
        rests, self._rests = self._rests, []
        return rests

    def _rest(self, rate: float, dt: float, stand: Stand) -> None:
        before, self._rest_rate = self._rest_rate, rate
        if before is None:
            return
        power = (rate - before) ** 2 * dt / 2
        self._rest_power += (power - self._rest_power) / REST_WORDS
        # A creep lasts: all words of the stand together tell the offset no better than it.
        lasting = stand.unseen_radps**2 * stand.lasted_s
        variance = (max(REST_NOISE**2, self._rest_power) + lasting) / dt
        off = rate - self.offset
        if abs(off) <= PUSHED + 3.0 * math.sqrt(self.offset_sigma**2 + variance):
            self._rests.append(Rest(off, variance))

    def _shaken(self, besides: float, reckoned: float, dt: float) -> None:
        """From word to word the rate besides what is reckoned (rad/s) changes by its noise."""
        straight = abs(reckoned) < STRAIGHT and abs(besides) < STRAIGHT
        last, self._moving_rate = self._moving_rate, besides if straight else None
        if last is not None and straight:
            power = (besides - last) ** 2 * dt / 2
            self._moving_power += (power - self._moving_power) / MOVING_WORDS

    def rescale(self, by: float) -> None:
        """Its scale is found to be so many times what it was taken to be."""
        self._scale *= by

    def _compared(self, reckoned: float, late: _Sums) -> float:
        """Believes it or not from here on; what was taken of late is given back."""
        seen, by_angle, to_and_fro, taken, doubt = late
        most = math.hypot(DIFFER_RAD, doubt) + DIFFER_SHARE * max(abs(seen), to_and_fro)
        if abs(seen - by_angle) > most:
            self._steps.clear()
            self._agreed_rad = 0.0
            return -taken
        if self._agreed_rad is not None:
            self._agreed_rad += abs(reckoned)
            if self._agreed_rad > AGREE_RAD:
                self._agreed_rad = None
        return 0.0

    @property
    def leg(self) -> tuple[float, float]:
        """What was turned since `take_leg`, rad: as it shows, and by the steering angle."""
        return self._leg

    def take_leg(self) -> tuple[float, float]:
        """The same; what comes from here on is another leg."""
        leg, self._leg = self._leg, (0.0, 0.0)
        return leg
