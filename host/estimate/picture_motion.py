"""Whether the pictures move as the machine does. A picture that does not is none of now, or none of
what lies before the machine.

Three facts tell, each of which no good camera shows:

- A picture is the same as one that was taken elsewhere: the stream hangs, or repeats itself.
- While the machine drives on, the ground in the pictures does not come towards it: it stands still,
  or goes the other way, as where they are upside down.
- While the machine turns, the pictures turn otherwise: the other way (mirrored), later (they come
  later than was said), or not at all.

Wheels that spin, or whose sensor counts by itself, look like a stream that hangs. Nothing else of
the machine does.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.vision.view import CropView

Floats = NDArray[np.float64]

ELSEWHERE_M: Final = 0.25
"""From where an earlier picture was taken, that is elsewhere. Less tells sooner; a delay that is
said wrong by 0.3 s looks like 0.15 m."""
AHEAD_M: Final = 2.0
"""To what a picture shows: a turn moves that as such a way's share does."""
IN_A_ROW: Final = 5
"""Pictures that are the same as ones from elsewhere: half a second."""
MEMORY: Final = 128
"""Places of so many pictures: more than the picture watch remembers."""
BIN_S: Final = 0.5
"""In such steps ways and turns are compared, for a single picture's time is not known that well."""
BINS: Final = 120
"""So many are remembered, a minute's."""
WAY_M: Final = 0.8
"""Driven, over which the way that pictures show is compared with the wheels'. Less tells sooner."""
STEP_M: Final = 0.06
"""Driven in a step, from which on it counts: pictures of a machine that stands drift by up to half
as much."""
SHOWN_SHARE: Final = 0.1
"""Of that way, which pictures show at least: good ones 0.36 and more, such that stand still none,
as where wheels spin;"""
UNSURE_SIGMAS: Final = 2.0
"""and by so many standard errors of its mean less. Crop before a low camera, cut as it comes,
stands there as if it moved along: over 0.8 m good pictures showed -0.1, between -0.5 and 0.2 from
step to step. A stream that hangs shows as little in every step."""
BACKWARD_SHARE: Final = -0.06
"""Of it, which pictures that are upside down show at most: from the mast -0.1 and less."""
ENOUGH_RAD: Final = math.radians(7.0)
"""Root of the squares of the machine's turns, step by step, by which their direction is told: what
the pictures err a step, up to 0.8 degrees, is a ninth of it. Less tells sooner."""
OTHER_WAY: Final = -0.4
"""Share of the machine's turns that pictures show at most which are turned over: they show -0.7 and
less, good ones 0 and more, and 0.7 but for a gyroscope that finds its offset."""
TURN_S: Final = 8.0
"""Over which turns are compared for pictures that come late: longer than one at a corner takes, at
whose beginning and at whose end such pictures are off. Over 6 s, crop that comes before the lens at
its end, and shifts by up to five times the turn, looks late."""
TURNED_RAD: Final = math.radians(20.0)
"""That both must have turned in that time, to and fro."""
AS_ONE: Final = 0.3
"""Least likeness of the two, their product over the larger one's square, once the machine has
turned twice as much: good pictures show 0.7 and more, such of another place none."""
LATEST_S: Final = 3.5
"""By which pictures that come late are looked for;"""
LAG_S: Final = 0.2
"""in such steps;"""
LATE_S: Final = 0.35
"""and told of: less shows at no turn, and the machine bears it."""
MISFIT_RAD: Final = math.radians(6.0)
"""Root of the squares of what pictures that are late show otherwise, step by step, at least: half a
second's 6.4 degrees and more in 16 picture drives. Of what good ones show a delay explains
nothing there."""
EXPLAINED_SHARE: Final = 0.5
"""Of it, that is left at most if they are taken to be late."""
OR_WHEELS: Final = (
    "or the wheels spin or their sensor counts by itself; restart the phone's camera app, look at "
    "the wheels"
)
GAINS: Final = (0.6, 1.3)
"""What the pictures may show of a turn, as a share of it."""


@dataclass(slots=True)
class _Bin:
    """Of some pictures in a row, all of which can be believed."""

    begin: float
    end: float
    turned_rad: float = 0.0
    shown_rad: float = 0.0
    driven_m: float = 0.0
    """To and fro, where the pictures show a way;"""
    shown_m: float = 0.0
    """and that, in the direction in which the machine drives."""


class PictureMotion:
    """Fed with every picture that is looked at."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._said_s = vehicle.camera_delay_s
        self._places: deque[tuple[Motion, float]] = deque(maxlen=MEMORY)
        """Of every picture, and what had been driven by then, to and fro."""
        self._ahead = 1.0
        """1 where the machine drives forward, as it last was; -1: back."""
        self._again = 0
        """Pictures in a row that are the same as ones from elsewhere."""
        self._turns: deque[tuple[float, float]] = deque()
        """(stamp, yaw) of the machine at every picture, for longer than turns are compared."""
        self._bin: _Bin | None = None
        """What is being added up, if the last picture can be believed;"""
        self._bins: deque[_Bin] = deque(maxlen=BINS)
        """and what has been."""
        self.wrong = ""
        """What they show, what is wrong and what to do, in words; empty where nothing is known to
        be wrong."""

    def take(self, view: CropView, then: Motion) -> None:
        """A picture, and how far the machine had come at its shutter."""
        last, driven_m = self._places[-1] if self._places else (then, 0.0)
        step_m = then.distance_m - last.distance_m
        # Between two pulses, or while some are lost, the wheels do not say where it drives.
        self._ahead = math.copysign(1.0, step_m or then.speed_mps or self._ahead)
        # What rolls or is pushed with its drive off may be a sensor that counts by itself.
        step_m = 0.0 if then.rolls else abs(step_m)
        self._places.append((then, driven_m + step_m))
        self._turns.append((then.stamp, then.yaw_rad))
        while self._turns[0][0] < then.stamp - TURN_S - LATEST_S:
            self._turns.popleft()
        if not view.usable or view.hidden:
            # What stands right before the lens hides what tells of motion.
            self._bin = None
            return
        found = self._elsewhere(view)
        if self._add(view, last, then, step_m):
            found = found or self._still() or self._other_way() or self._late(then)
        self.wrong = self.wrong or found

    def _add(self, view: CropView, last: Motion, then: Motion, step_m: float) -> bool:
        """What this picture shows since the last one; whether a bin is full."""
        bin_, turn_rad = self._bin, view.shown_turn_rad
        if bin_ is None or math.isnan(turn_rad):
            self._bin = _Bin(then.stamp, then.stamp)
            return False
        bin_.end = then.stamp
        bin_.turned_rad += then.yaw_rad - last.yaw_rad
        bin_.shown_rad += turn_rad
        if math.isfinite(view.shown_way_m):
            bin_.driven_m += step_m
            bin_.shown_m += self._ahead * view.shown_way_m
        if bin_.end - bin_.begin < BIN_S - 1e-6:
            return False
        self._bins.append(bin_)
        self._bin = _Bin(then.stamp, then.stamp)
        return True

    def _elsewhere(self, view: CropView) -> str:
        """Whether the pictures are the same as ones from elsewhere."""
        off_m = 0.0
        if 0 < view.same_ago < len(self._places):
            (then, driven_m), (now, by_now_m) = self._places[-1 - view.same_ago], self._places[-1]
            way_m = math.hypot(now.x_m - then.x_m, now.y_m - then.y_m)
            off_m = min(way_m, by_now_m - driven_m) + AHEAD_M * abs(now.yaw_rad - then.yaw_rad)
        self._again = self._again + 1 if off_m > ELSEWHERE_M else 0
        if self._again < IN_A_ROW:
            return ""
        return (
            f"they show again what they showed {off_m:.1f} m before: the camera's stream hangs, "
            f"repeats itself or comes late, {OR_WHEELS}"
        )

    def _still(self) -> str:
        """Whether they show the machine stand, or drive the other way."""
        shown_m = driven_m = 0.0
        shares: list[float] = []
        for bin_ in filter(_tells_way, reversed(self._bins)):
            shown_m, driven_m = shown_m + bin_.shown_m, driven_m + bin_.driven_m
            shares.append(bin_.shown_m / bin_.driven_m)
            if driven_m > WAY_M:
                break
        if driven_m <= WAY_M:
            return ""
        unsure_m = UNSURE_SIGMAS * statistics.pstdev(shares) / math.sqrt(len(shares)) * driven_m
        if shown_m + unsure_m > SHOWN_SHARE * driven_m:
            return ""
        if shown_m > BACKWARD_SHARE * driven_m:
            return (
                f"over {driven_m:.1f} m of way the ground in them stood still: the camera's stream "
                f"hangs or comes late, {OR_WHEELS}"
            )
        return (
            f"over {driven_m:.1f} m of way the ground in them went the other way: the camera's "
            "picture is upside down, or comes late; look at it in the phone's app"
        )

    def _other_way(self) -> str:
        """Whether they turn to the other side."""
        turned, shown = np.array([(b.turned_rad, b.shown_rad) for b in reversed(self._bins)]).T
        known = np.flatnonzero(np.cumsum(turned**2) > ENOUGH_RAD**2)
        if not known.size:
            return ""
        turned, shown = turned[: known[0] + 1], shown[: known[0] + 1]
        if float(shown @ turned) > OTHER_WAY * float(turned @ turned):
            return ""
        side = np.sign(turned)
        return (
            f"it turned by {_deg(side @ turned)}, and they by {_deg(-side @ shown)} the other way: "
            "the camera's picture is mirrored or upside down; turn that off in the phone's app"
        )

    def _late(self, then: Motion) -> str:
        """Whether they turn later than the machine, or not at all."""
        bins = [b for b in self._bins if b.begin > then.stamp - TURN_S]
        shown = np.array([b.shown_rad for b in bins])
        ends = np.array([(b.begin, b.end) for b in bins])
        at, yaw = np.array(self._turns).T

        def turned(lag_s: float) -> Floats:
            """What the machine has turned so long before, in the same steps."""
            return np.asarray(np.diff(np.interp(ends - lag_s, at, yaw))[:, 0])

        now = turned(0.0)
        misfit, turned_rad, shown_rad = _misfit(shown, now), np.abs(now).sum(), np.abs(shown).sum()
        if turned_rad < TURNED_RAD or misfit < MISFIT_RAD:
            return ""
        if shown_rad > TURNED_RAD:
            lags = np.arange(0.0, LATEST_S, LAG_S)
            left = [_misfit(shown, turned(lag)) for lag in lags]
            late_s = float(lags[np.argmin(left)])
            if late_s > LATE_S and min(left) < EXPLAINED_SHARE * misfit:
                return (
                    f"they turn {late_s:.1f} s after it: the camera's pictures come "
                    f"{self._said_s + late_s:.1f} s late, and camera_delay_s says "
                    f"{self._said_s:.1f} s; restart the phone's camera app, look after its "
                    "network, or measure the delay anew: `daranti calibrate delay`"
                )
        alike = float(shown @ now) / max(float(shown @ shown), float(now @ now))
        # Less than twice as much may be pictures' that come late. And where the steering angle
        # alone tells of a turn, it may as well be the angle that is wrong.
        if alike > AS_ONE or turned_rad < 2.0 * TURNED_RAD or not then.by_gyro:
            return ""
        return (
            f"it turned by {_deg(turned_rad)}, and they otherwise, by {_deg(shown_rad)}: the "
            "camera's stream is late, or the phone is loose; restart its camera app, and check how "
            "it is fastened"
        )


def _tells_way(bin_: _Bin) -> bool:
    """Whether the ground in the pictures has moved more by the machine's way than by its turning:
    of what moves both ways at once, the picture watch shows the turn alone."""
    return bin_.driven_m > max(STEP_M, AHEAD_M * abs(bin_.turned_rad))


def _misfit(shown: Floats, turned: Floats) -> float:
    """What is left of a turn that pictures show, rad, with the best share of the machine's taken
    off."""
    square = float(turned @ turned)
    gain = min(max(float(shown @ turned) / square, GAINS[0]), GAINS[1]) if square > 0.0 else 1.0
    return float(np.linalg.norm(shown - gain * turned))


def _deg(turned_rad: float) -> str:
    return f"{math.degrees(turned_rad):.0f} deg"
