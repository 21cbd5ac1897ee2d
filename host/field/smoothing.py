"""A walk's track smoothed by the receiver's own speed and course over ground.

A phone's position is wrong by metres that wander over minutes. Its velocity comes from Doppler and
is wrong by centimetres a second that hardly last. One weighted least squares over the whole walk
weighs both: the place walked p, the position's wandering error b (a first-order Gauss-Markov
process; Brown and Hwang, Introduction to Random Signals), and what is wrong with the receiver all
the time: the scale and direction of its velocity, how far the velocity lags behind the position,
and how far the position lags behind the walker. All of it is linear in what was measured. Cauchy's
weights (Barfoot, State Estimation for Robotics, 5.3) let an error that jumps count for little.

Where the field has straight sides, the sides' lines are unknowns of the same least squares: the
walker comes back to the same lines, lap for lap, and that ties the walk's ends together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from host.field.walk import PAUSE_S, STANDING_MPS, WALKING_MPS, Points, Track

Values = NDArray[np.float64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]

CORRELATION_S = 180.0
"""Of the position's wandering error;"""
ERROR_M = (0.2, 2.0, 5.0)
"""its standard deviation per axis: least, before the walk has told it, most. Where positions and
velocities differ by more than the most explains, it is the velocities that are wrong: in a street,
a phone's log has walking speeds a fifth too low for minutes."""
WHITE_M = 0.1
"""Standard deviation per axis of what is new in every position, rounding included."""
DOPPLER_MPS = 0.06
"""Standard deviation per axis of a velocity, new once a second, rounding to 0.1 kn included;"""
DOPPLER_SHARE = 0.05
"""and its variance is at least this share of what positions and velocities differ by in a second: a
receiver whose positions wander hears echoes, and so does its Doppler."""
NEARBY_S = 90.0
"""That difference is a matter of so long a part of the walk."""
SLOW = 0.3
"""Share of a velocity below STANDING_MPS that counts as its error: its course means little."""
SCALE = 0.005
"""Standard deviation of the speed's scale: Doppler has hardly any error of scale in the open (a
phone's log: 0.009 over 1.2 km, the position's wandering included). More, and a street would teach
it one that is wrong in the field."""
COURSE_RAD = 0.015
"""Standard deviation of the course's direction; 0.02 in that log."""
LAG_S = 1.0
"""Standard deviation of the velocity's lag behind the position."""
BEHIND_S = (0.4, 0.4)
"""The position's lag behind the walker: mean and standard deviation."""
DIFFERENCE_S = 8.0
"""Over so long positions and velocities are compared to learn how much the error wanders."""
KNOWN_SHARE = 0.8
"""Of the fixes must have a velocity, or the track stays as it is;"""
UNEXPLAINED_SHARE = 0.5
"""and velocities may leave at most so much of what was walked within DIFFERENCE_S unexplained, or
they are none: some apps say 0 all the time, or km/h as knots (0.85). In a street a phone left 0.2.
"""
CAUCHY = 3.0
"""A residual of so many standard deviations has half of its weight."""
ROUNDS = 5
"""Of reweighting; the weights hardly change after."""
SIDE_ENDS = 0.05
"""Share of a side at each end that does not tell where it lies: the walker rounds the corner."""
ALONG_RAD = math.radians(60)
"""Who walks along a side goes in its direction so nearly,"""
BESIDE_M = 3.0
"""and so near to it."""
WOBBLE_M = (0.1, 0.5)
"""How far a walker strays from a straight line (standard deviation): least and most believed;"""
WOBBLE_LENGTH_M = 5.0
"""what he strays after so much way is independent of what he strayed before."""
FIRST_M = 2.0
"""Standard deviation of the place of the lines that the fit begins with: it holds where nobody
walked,"""
FIRST_RAD = 0.5
"""and of their direction."""
FITS = 3
"""Times that the sides are laid anew; they move by millimetres after."""


@dataclass(frozen=True)
class _Rows:
    """Measurements of one kind: `a` (m, unknowns) times the unknowns is `y` (m,) but for `sigma`
    (m,). `robust`: some of them may be plainly wrong."""

    a: csr_matrix
    y: Values
    sigma: Values
    robust: bool = False

    def weights(self, x: Values) -> Values:
        """(m,): of each by what is left of it, from 0 to 1."""
        if not self.robust:
            return np.ones(len(self.y))
        left: Values = (self.a @ x - self.y) / self.sigma
        return 1 / (1 + (left / CAUCHY) ** 2)


@dataclass(frozen=True)
class _Lines:
    """A polygon's sides as lines: (n, 2) their middles, unit directions and unit normals to the
    left, (n,) their lengths."""

    middle: Points
    along: Points
    left: Points
    length: Values

    @classmethod
    def of(cls, corners: Points) -> _Lines:
        way = np.roll(corners, -1, axis=0) - corners
        length = np.hypot(*way.T)
        along = way / length[:, None]
        return cls(corners + way / 2, along, np.column_stack([-along[:, 1], along[:, 0]]), length)

    def moved(self, shifts: Points) -> _Lines:
        """Each shifted to its left (m) and turned (rad)."""
        along = self.along + shifts[:, 1:] * self.left
        along /= np.hypot(*along.T)[:, None]
        left = np.column_stack([-along[:, 1], along[:, 0]])
        return _Lines(self.middle + shifts[:, :1] * self.left, along, left, self.length)

    def corners(self) -> Points:
        """(n, 2): corner k is where side k - 1 meets side k. LinAlgError where they do not."""
        before = np.roll(self.left, 1, axis=0)
        offsets = (self.left * self.middle).sum(1)
        both = np.stack([before, self.left], axis=1)
        right = np.column_stack([np.roll(offsets, 1), offsets])
        found: Points = np.linalg.solve(both, right[..., None])[..., 0]
        return found

    def moves(self, corners: Points) -> Values:
        """(2 n, 2 n): how corners x0, y0, x1, ... move with shift and turn of each line."""
        count = len(corners)
        out = np.zeros((2 * count, 2 * count))
        for k in range(count):
            inverse = np.linalg.inv(self.left[[k - 1, k]])
            for column, side in enumerate(((k - 1) % count, k)):
                lever = float(self.along[side] @ (corners[k] - self.middle[side]))
                out[2 * k : 2 * k + 2, 2 * side] = inverse[:, column]
                out[2 * k : 2 * k + 2, 2 * side + 1] = lever * inverse[:, column]
        return out


@dataclass(frozen=True)
class Sides:
    """A polygon that was walked."""

    corners: Points
    covariance: Values
    """(2 n, 2 n) of x0, y0, x1, ...; m2."""


def smoothable(track: Track) -> bool:
    """Whether the receiver said how fast the walker went and where to."""
    if len(track.xy) < 4 or len(track.velocities) < len(track.xy):
        return False
    if np.isfinite(track.velocities).all(axis=1).mean() < KNOWN_SHARE:
        return False
    way, known = _by_velocities(track)
    first, last = _windows(track.stamps, known & (track.jumps_m[1:] == 0))
    walked = track.xy[last] - track.xy[first]
    summed = np.vstack([np.zeros(2), np.cumsum(np.where(known[:, None], way, 0.0), axis=0)])
    left = walked - (summed[last] - summed[first])
    return len(first) > 0 and float(np.hypot(*left.T).sum()) <= UNEXPLAINED_SHARE * float(
        np.hypot(*walked.T).sum()
    )


def _by_velocities(track: Track) -> tuple[Points, Flags]:
    """(n - 1, 2): the way from each point to the next by their velocities (m); (n - 1,): whether
    these say it."""
    seen: Flags = np.isfinite(track.velocities.sum(axis=1))
    v = np.nan_to_num(track.velocities)
    dt = np.diff(track.stamps)
    return (v[1:] + v[:-1]) / 2 * dt[:, None], seen[1:] & seen[:-1] & (dt <= PAUSE_S)


def _windows(stamps: Values, good: Flags) -> tuple[Indices, Indices]:
    """First and last point of every part of DIFFERENCE_S all of whose steps are good."""
    last = np.searchsorted(stamps, stamps + DIFFERENCE_S)
    first = np.flatnonzero(last < len(stamps))
    bad = np.concatenate([[0], np.cumsum(~good)])
    first = first[bad[last[first]] == bad[first]]
    return first, last[first]


def relative_sigma_m(covariance: Values) -> float:
    """Of places x0, y0, x1, ... of this covariance (m2): the standard deviation per axis that
    independent places would have that lie as far off each other. A common shift is none."""
    count = len(covariance) // 2
    centred = np.kron(np.eye(count) - 1 / count, np.eye(2))
    total = float(np.trace(centred @ covariance @ centred))
    return math.sqrt(max(0.0, total) / (2 * (count - 1)))


class _Factor:
    """A symmetric and positive definite matrix, factored without pivoting. Its unknowns are taken
    in time, p and b of a point beside each other, and the few that all points share come last: so
    its factors are as narrow a band as it is itself."""

    def __init__(self, matrix: csc_matrix, in_time: Indices) -> None:
        self._order = np.concatenate([in_time, np.arange(len(in_time), matrix.shape[0])])
        self._lu = splu(
            matrix[self._order][:, self._order].tocsc(),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def solve(self, right: Values) -> Values:
        """Of one right side (n,), or of many (n, k)."""
        found = np.empty_like(right)
        found[self._order] = self._lu.solve(right[self._order])
        return found


class Smoother:
    """The least squares of one walk. Its unknowns are p (x0, y0, x1, ...), b likewise, the scale
    and direction of velocities, their lag, the position's lag, and of each side, when they are
    looked for, its shift to the left and its turn."""

    def __init__(self, track: Track) -> None:
        """`track` must be `smoothable`."""
        self._track = track
        self._n = len(track.xy)
        self._globals = 4 * self._n
        each = np.arange(2 * self._n).reshape(-1, 2)
        self._in_time = np.hstack([each, 2 * self._n + each]).ravel()
        self._v = np.nan_to_num(track.velocities)
        self._dt = np.maximum(np.diff(track.stamps), 1e-3)
        self._way, self._known = _by_velocities(track)
        self._error_m = ERROR_M[1]
        self._doppler_mps = np.full(self._n - 1, DOPPLER_MPS)
        self._solve([])
        self._learn()
        self._solve([])

    @property
    def xy(self) -> Points:
        """(n, 2): where the walker was."""
        p = self._x[: 2 * self._n].reshape(-1, 2)
        lag, behind = self._x[self._globals + 2 : self._globals + 4]
        walked: Points = p + (lag + behind) * self._v
        return walked

    def smoothed(self) -> Track:
        """The track without the wandering. A jump that velocities bridge is none any more."""
        jumps = self._track.jumps_m.copy()
        jumps[1:][self._known] = 0.0
        return replace(self._track, xy=self.xy, jumps_m=jumps)

    def sigma_m(self, chosen: Indices) -> float:
        """Standard deviation per axis of the chosen points of the walk against each other."""
        which = np.column_stack([2 * chosen, 2 * chosen + 1]).ravel()
        pick = np.zeros((len(self._x), len(which)))
        pick[which, np.arange(len(which))] = 1.0
        return relative_sigma_m(pick.T @ self._factor.solve(pick))

    # ---- measurements ----------------------------------------------------------------------------

    def _matrix(self, size: int, *parts: tuple[Indices | int, Values | float]) -> csr_matrix:
        """Row k has of every part (columns, values) the k-th."""
        count = np.broadcast(*(column for column, _ in parts)).size
        rows = np.tile(np.arange(count), len(parts))
        columns = np.concatenate([np.broadcast_to(column, count) for column, _ in parts])
        values = np.concatenate([np.broadcast_to(value, count) for _, value in parts])
        return csr_matrix((values.astype(float), (rows, columns)), (count, size))

    def _measurements(self, size: int) -> list[_Rows]:
        """Of the walk itself."""
        n, dt, g = self._n, self._dt, self._globals
        p = np.arange(2 * n)
        b = 2 * n + p
        way, turned = self._way.ravel(), (self._way[:, ::-1] * (-1, 1)).ravel()
        known = np.repeat(self._known, 2)
        speed = np.hypot(*self._v.T)
        slow = np.where(speed < STANDING_MPS, SLOW * speed, 0.0)
        sure = np.hypot(self._doppler_mps * np.sqrt(dt), np.maximum(slow[1:], slow[:-1]) * dt)
        steps = self._matrix(size, (p[2:], 1.0), (p[:-2], -1.0), (g, -way), (g + 1, -turned))
        places = self._matrix(size, (p, 1.0), (b, 1.0), (g + 2, self._v.ravel()))
        keep = np.exp(-dt / CORRELATION_S)
        wander = np.hypot(self._error_m * np.sqrt(1 - keep**2), self._track.jumps_m[1:])
        wanders = self._matrix(size, (b[2:], 1.0), (b[:-2], -np.repeat(keep, 2)))
        return [
            _Rows(
                steps,
                np.where(known, way, 0.0),
                np.where(known, np.repeat(sure, 2), np.repeat(WALKING_MPS * dt, 2)),
                robust=True,
            ),
            _Rows(places, self._track.xy.ravel(), np.full(2 * n, WHITE_M)),
            _Rows(wanders, np.zeros(2 * n - 2), np.repeat(wander, 2), robust=True),
            _Rows(self._matrix(size, (b[:2], 1.0)), np.zeros(2), np.full(2, self._error_m)),
            _Rows(
                self._matrix(size, (g + np.arange(4), 1.0)),
                np.array([0.0, 0.0, 0.0, BEHIND_S[0]]),
                np.array([SCALE, COURSE_RAD, LAG_S, BEHIND_S[1]]),
            ),
        ]

    def _on_sides(self, lines: _Lines, walked: Indices, wobble_m: float) -> list[_Rows]:
        """What the walked points say of the lines, and what the lines were before."""
        count = len(lines.length)
        size = self._globals + 4 + 2 * count
        v = self._v[walked]
        speed = np.hypot(*v.T)
        off = self.xy[walked][:, None] - lines.middle
        ahead, beside = (off * lines.along).sum(-1), np.abs((off * lines.left).sum(-1))
        across = np.abs(v @ lines.left.T)
        on = (
            (np.abs(ahead) < (0.5 - SIDE_ENDS) * lines.length)
            & (across < math.sin(ALONG_RAD) * speed[:, None])
            & (speed > STANDING_MPS)[:, None]
            & (beside < BESIDE_M)
        )
        side = np.where(on, beside, np.inf).argmin(axis=1)
        some = on.any(axis=1)
        k, side, v, ahead = walked[some], side[some], v[some], ahead[some, side[some]]
        left = lines.left[side]
        lag = (v * left).sum(1)
        shift = self._globals + 4 + 2 * side
        a = self._matrix(
            size,
            (2 * k, left[:, 0]),
            (2 * k + 1, left[:, 1]),
            (self._globals + 2, lag),
            (self._globals + 3, lag),
            (shift, -1.0),
            (shift + 1, -ahead),
        )
        a_point_m = np.maximum(speed[some] * float(np.median(self._dt)), 1e-3)
        sigma = wobble_m * np.sqrt(np.maximum(1.0, WOBBLE_LENGTH_M / a_point_m))
        before = self._matrix(size, (self._globals + 4 + np.arange(2 * count), 1.0))
        return [
            _Rows(a, (left * lines.middle[side]).sum(1), sigma, robust=True),
            _Rows(before, np.zeros(2 * count), np.tile([FIRST_M, FIRST_RAD], count)),
        ]

    # ---- solution --------------------------------------------------------------------------------

    def _solve(self, more: list[_Rows]) -> None:
        size = more[0].a.shape[1] if more else self._globals + 4
        groups = [*self._measurements(size), *more]
        weights = [np.ones(len(rows.y)) for rows in groups]
        for _ in range(ROUNDS):
            normal, right = csc_matrix((size, size)), np.zeros(size)
            for rows, weight in zip(groups, weights, strict=True):
                weighted = rows.a.multiply((weight / rows.sigma**2)[:, None]).T.tocsr()
                normal = normal + weighted @ rows.a
                right += weighted @ rows.y
            self._factor = _Factor(normal.tocsc(), self._in_time)
            self._x = self._factor.solve(right)
            weights = [rows.weights(self._x) for rows in groups]

    def _learn(self) -> None:
        """How much the position's error wanders in this walk, and what that says of Doppler."""
        scale, turn, lag = self._x[self._globals : self._globals + 3]
        way = self._way * (1 + scale) + self._way[:, ::-1] * (-turn, turn)
        apart = self._track.xy - lag * self._v
        apart[1:] -= np.cumsum(way, axis=0)
        stamps = self._track.stamps
        first, last = _windows(stamps, self._known)
        differ = (apart[last] - apart[first]) ** 2 / (stamps[last] - stamps[first])[:, None]
        # The median of the mean of two squared normal variables is ln 2 of its expectation; jumps
        # leave it alone.
        variance = differ.mean(axis=1) / math.log(2)
        usual = float(np.median(variance)) - DOPPLER_MPS**2 - 2 * WHITE_M**2 / DIFFERENCE_S
        error = math.sqrt(max(0.0, usual) * CORRELATION_S / 2)
        self._error_m = min(max(error, ERROR_M[0]), ERROR_M[2])
        nearby = max(3, round(NEARBY_S / float(np.median(self._dt))))
        local = median_filter(variance, min(nearby, len(variance)), mode="nearest")
        local = np.interp(stamps[:-1], stamps[first], local)
        rest = local - 2 * ERROR_M[2] ** 2 / CORRELATION_S
        least = np.maximum(DOPPLER_MPS**2, DOPPLER_SHARE * local)
        self._doppler_mps = np.sqrt(np.maximum(least, rest))

    def sides(self, corners: Points, spans: list[tuple[int, int]]) -> Sides | None:
        """The polygon whose sides were walked, from corners (n, 2) that are nearly right and the
        first and last point of every lap. None where its sides do not meet."""
        walked = np.concatenate([np.arange(first, last + 1) for first, last in spans])
        lines = _Lines.of(corners)
        wobble_m = WOBBLE_M[1]
        try:
            for _ in range(FITS):
                rows = self._on_sides(lines, walked, wobble_m)
                self._solve(rows)
                moves = lines.moves(lines.corners())
                lines = lines.moved(self._x[self._globals + 4 :].reshape(-1, 2))
                lines = _Lines.of(lines.corners())
                strayed = rows[0].a @ self._x - rows[0].y
                rms = math.sqrt(float(np.average(strayed**2, weights=rows[0].weights(self._x))))
                wobble_m = min(max(rms, WOBBLE_M[0]), WOBBLE_M[1])
        except (np.linalg.LinAlgError, ZeroDivisionError):
            return None
        pick = np.zeros((len(self._x), len(moves)))
        pick[self._globals + 4 :] = moves.T
        return Sides(lines.corners(), pick.T @ self._factor.solve(pick))
