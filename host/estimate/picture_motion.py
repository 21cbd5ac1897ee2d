"""Whether the pictures move as the machine does. A picture that does not is none of now, or none of
what lies before the machine.

Three facts tell, each of which no good camera shows:

- A picture is the same as one that was taken elsewhere: the stream hangs, or repeats itself.
- While the machine drives on, the ground in the pictures goes away from it: they are upside down.
- While the machine turns, the pictures turn otherwise: the other way (mirrored), later (they come
  later than was said), or not at all.

The wheels cannot feign the first unless they spin, nor the last two at all.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.vision.view import CropView

ELSEWHERE_M: Final = 0.25
"""From where an earlier picture was taken, that is elsewhere. Less tells sooner; a delay that is
said wrong by 0.3 s looks like 0.15 m."""
AHEAD_M: Final = 2.0
"""To what a picture shows: a turn moves that as such a way's share does."""
IN_A_ROW: Final = 5
"""Pictures that are the same as ones from elsewhere: half a second."""
MEMORY: Final = 128
"""Places of so many pictures: more than the picture watch remembers."""
WAY_M: Final = 1.5
"""Driven, over which the way that pictures show is compared with the wheels'."""
BACKWARD_SHARE: Final = -0.06
"""Of that way, which pictures that are upside down show: from the mast -0.1 and less, where good
ones show 0.4 and more. Pictures that stand still show none, but so do wheels that spin."""
TURN_S: Final = 6.0
"""Over which turns are compared: a turn at a corner takes half of it."""
BIN_S: Final = 0.5
"""In such steps, for single pictures' times are not known that well."""
TURNED_RAD: Final = math.radians(20.0)
"""That machine or pictures must have turned in that time, to and fro."""
AS_ONE: Final = 0.3
"""Least likeness of the two: their product over the larger one's square. 0.7 and more of good
pictures, -1 of mirrored ones."""
LATEST_S: Final = 3.5
"""By which pictures that come late are looked for;"""
LAG_S: Final = 0.2
"""in such steps;"""
LATE_S: Final = 0.35
"""and told of: less shows at no turn, and the machine bears it."""
MISFIT_RAD: Final = math.radians(6.0)
"""Of the steps together, that pictures which are late make at least. Good ones make up to 4.6
degrees."""
EXPLAINED_SHARE: Final = 0.5
"""Of it, that is left at most if they are taken to be late."""
GAINS: Final = (0.6, 1.3)
"""What the pictures may show of a turn, as a share of it."""


class _Pair(NamedTuple):
    """From one picture to the next."""

    stamp: float
    """Of the later one's shutter."""
    lasted_s: float
    driven_m: float
    shown_m: float
    """In the direction in which the machine drives; NaN: not shown."""
    shown_rad: float


class PictureMotion:
    """Fed with every picture that is looked at."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._said_s = vehicle.camera_delay_s
        self._places: deque[tuple[Motion, float]] = deque(maxlen=MEMORY)
        """Of every picture, and what had been driven by then, to and fro."""
        self._again = 0
        self._pairs: deque[_Pair] = deque()
        self._turns: deque[tuple[float, float]] = deque()
        """(stamp, yaw) of the machine, for longer than of the pairs."""
        self._usable = False
        """Whether the last picture was."""
        self.wrong = ""
        """What they show, what is wrong and what to do, in words; empty where nothing is known to
        be wrong."""

    def take(self, view: CropView, then: Motion) -> None:
        """A picture, and how far the machine had come at its shutter."""
        usable, self._usable = self._usable, view.usable
        last, driven_m = self._places[-1] if self._places else (then, 0.0)
        step_m = then.distance_m - last.distance_m
        # What rolls or is pushed with its drive off may be a sensor that counts by itself.
        self._places.append((then, driven_m + (0.0 if then.rolls else abs(step_m))))
        self._turns.append((then.stamp, then.yaw_rad))
        while self._turns[0][0] < then.stamp - TURN_S - LATEST_S:
            self._turns.popleft()
        if not (usable and view.usable):
            return
        lasted_s = then.stamp - last.stamp
        way_m = math.copysign(1.0, then.speed_mps) * view.shown_way_m
        self._pairs.append(_Pair(then.stamp, lasted_s, abs(step_m), way_m, view.shown_turn_rad))
        while self._pairs[0].stamp < then.stamp - TURN_S:
            self._pairs.popleft()
        self.wrong = self.wrong or self._elsewhere(view) or self._backward() or self._turned()

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
            "repeats itself or comes late, or the wheels spin; restart the phone's camera app"
        )

    def _backward(self) -> str:
        """Whether they show the machine driving the other way."""
        shown_m = driven_m = 0.0
        for pair in reversed(self._pairs):
            if math.isfinite(pair.shown_m):
                shown_m, driven_m = shown_m + pair.shown_m, driven_m + pair.driven_m
            if driven_m > WAY_M:
                break
        if driven_m <= WAY_M or shown_m > BACKWARD_SHARE * driven_m:
            return ""
        return (
            f"over {driven_m:.1f} m of way the ground in them went the other way: the camera's "
            "picture is upside down; turn the phone, or the picture in its app"
        )

    def _turned(self) -> str:
        """Whether they turn otherwise."""
        pairs = [pair for pair in self._pairs if math.isfinite(pair.shown_rad)]
        if not pairs or pairs[-1].stamp - pairs[0].stamp < TURN_S - 2.0 * BIN_S:
            return ""
        stamps = np.array([pair.stamp for pair in pairs])
        begins = stamps - np.array([pair.lasted_s for pair in pairs])
        bins = ((stamps - stamps[0]) / BIN_S).astype(int)
        shown = np.bincount(bins, [pair.shown_rad for pair in pairs])
        at, yaw = np.array(self._turns).T

        def turned(lag_s: float) -> np.ndarray:
            """What the machine has turned so long before, in the same steps."""
            steps = np.interp(stamps - lag_s, at, yaw) - np.interp(begins - lag_s, at, yaw)
            return np.bincount(bins, steps)

        now = turned(0.0)
        if max(np.abs(now).sum(), np.abs(shown).sum()) < TURNED_RAD:
            return ""
        misfit = _misfit(shown, now)
        lags = np.arange(0.0, LATEST_S, LAG_S)
        known = misfit > MISFIT_RAD and np.abs(shown).sum() > TURNED_RAD
        late = [_misfit(shown, turned(lag)) for lag in lags] if known else [misfit]
        best = int(np.argmin(late))
        if lags[best] > LATE_S and late[best] < EXPLAINED_SHARE * misfit:
            said_s = self._said_s
            return (
                f"they turn {lags[best]:.1f} s after it: the camera's pictures come "
                f"{said_s + lags[best]:.1f} s late, and camera_delay_s says {said_s:.1f} s; "
                "restart the phone's camera app, look after its network, or measure the delay anew"
            )
        alike = float(shown @ now) / max(float(shown @ shown), float(now @ now))
        if alike > AS_ONE:
            return ""
        both = f"it turned {_deg(now)}, they turned {_deg(shown)}"
        if alike < -AS_ONE:
            return (
                f"{both}: the camera's picture is mirrored or upside down; turn that off in the "
                "phone's app"
            )
        if np.abs(now).sum() < 2.0 * TURNED_RAD:
            return ""  # pictures that come late may show it still
        return (
            f"{both}: the camera's stream is late, or the phone is loose; restart its camera app, "
            "and check how it is fastened"
        )


def _misfit(shown: np.ndarray, turned: np.ndarray) -> float:
    """What is left of a turn that pictures show, rad, with the best share of the machine's taken
    off."""
    square = float(turned @ turned)
    gain = min(max(float(shown @ turned) / square, GAINS[0]), GAINS[1]) if square > 0.0 else 1.0
    return float(np.linalg.norm(shown - gain * turned))


def _deg(steps: np.ndarray) -> str:
    turned = math.degrees(float(steps.sum()))
    return f"{abs(turned):.0f} deg to the {'left' if turned > 0.0 else 'right'}"
