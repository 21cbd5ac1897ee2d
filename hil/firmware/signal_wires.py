"""Faulty wires: what a signal becomes between the machine and the controller, compiled.

Every signal of the inner loop passes its tap once a millisecond. An honest tap gives the truth; the
others give it held, shifted, noisy, late or now and then something else. `shown_us` notes when the
result first differed from the truth by more than `tolerance`: only from then on can anybody notice.
"""

from __future__ import annotations

import enum
import math
from typing import Any, Final

import numpy as np
from numba import njit

from sim_plant import noise

DELAY_MS: Final = 1024
"""Longest delay, exclusive."""
FLICKER_US: Final = 20_000
"""A loose contact opens or closes this often, by chance."""
NEVER: Final = -1
"""No time."""


class Signal(enum.IntEnum):
    """The wires, in the order of the taps. Voltages are in mV at the pin (the e-stop's loop too),
    duties -1..1 as the motors get them, levels 0 or 1."""

    POT = 0
    BATTERY_SENSE = 1
    STEER_SENSE = 2
    DRIVE_SENSE = 3
    STEER_DUTY = 4
    DRIVE_DUTY = 5
    BLADE = 6
    HALL = 7
    ESTOP = 8
    HALL_B = 9
    BLADE_TURN = 10


TOLERANCE: Final = (45.0, 125.0, 200.0, 80.0, 0.1, 0.1, 0.5, 0.5, 300.0, 0.5, 0.5)
"""What passes for the truth: 2 degrees, 0.5 V, 2 A, a tenth of the duty."""


class Mode(enum.IntEnum):
    """What a tap does with the truth, with its `value`."""

    HONEST = 0
    HELD = 1
    """Stays at the last honest value."""
    FIXED = 2
    """Is `value`."""
    SHIFTED = 3
    """Truth plus `value`."""
    SCALED = 4
    """Truth times `value`."""
    NOISY = 5
    """Anything between `low` and `value`, anew each millisecond."""
    LAGGING = 6
    """Follows with the time constant `value` (s)."""
    LATE = 7
    """Comes `value` seconds later."""
    FLICKERING = 8
    """Is `value` half of the time, by chance, 20 ms and more at once."""


TAP: Final = np.dtype(
    [
        ("mode", np.int64),
        ("value", np.float64),
        ("low", np.float64),
        ("seed", np.int64),
        ("held", np.float64),
        ("count", np.int64),
        ("tolerance", np.float64),
        ("shown_us", np.int64),
        ("alive_us", np.int64),  # when the result was last other than 0
        ("past", np.float64, (DELAY_MS,)),
    ],
    align=True,
)


def honest() -> np.ndarray[Any, Any]:
    """(len(Signal),) TAP records that change nothing."""
    taps = np.zeros(len(Signal), TAP)
    taps["tolerance"] = TOLERANCE
    taps["shown_us"] = NEVER
    return taps


@njit(cache=True, nogil=True)
def tap(taps: Any, index: int, truth: float, now_us: int) -> float:
    """What arrives where the wire `index` carries `truth`."""
    t = taps[index]
    if t.mode == 0:
        t.held = truth
        t.count = 0
        if truth != 0.0:
            t.alive_us = now_us
        return truth
    out = truth
    if t.mode == 1:
        out = t.held
    elif t.mode == 2:
        out = t.value
    elif t.mode == 3:
        out = truth + t.value
    elif t.mode == 4:
        out = truth * t.value
    elif t.mode == 5:
        out = t.low + (t.value - t.low) * noise.uniform(t.seed, now_us // 1000, index)
    elif t.mode == 6:
        t.held += (truth - t.held) * (1.0 - math.exp(-0.001 / t.value))
        out = t.held
    elif t.mode == 7:
        t.past[t.count % DELAY_MS] = truth
        back = t.count - int(t.value * 1000.0)
        out = t.held if back < 0 else t.past[back % DELAY_MS]
        t.count += 1
    elif t.mode == 8 and noise.uniform(t.seed, now_us // FLICKER_US, index) < 0.5:
        out = t.value
    if t.shown_us < 0 and abs(out - truth) > t.tolerance:
        t.shown_us = now_us
    if out != 0.0:
        t.alive_us = now_us
    return out
