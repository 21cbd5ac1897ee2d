"""Faults: what may fail, how, when, and where on the bench it is made to fail.

The vocabulary is PX4's: a component and one of {off, stuck, garbage, wrong, slow, delayed,
intermittent}. PAIRS lists every supported pair with its meaning, and what the machine must do about
it; any other pair is refused. Faults act at the seams only: wires (hil/firmware/signal_wires.py),
the plant's inputs, power, serial bytes, pictures, NMEA sentences, and whether the host gets to run.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from hil.firmware import signal_wires
from host.core.strict import Strict
from host.pilot.phase import Doing

Component = Literal[
    "pot",
    "steering_motor",
    "steering_bridge",
    "drive_motor",
    "blade_relay",
    "battery",
    "hall",
    "estop",
    "serial",
    "camera",
    "gnss",
    "gyro",
    "phone",
    "host",
    "firmware",
]
Failure = Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"]


class Expect(enum.Enum):
    """What the machine must do about a fault."""

    STOP = "stop"
    """Drive and blade off within the bound."""
    RIDE = "ride through"
    """Stop, or harvest on as if nothing were: no harm, and never far off the edge."""


@dataclass(frozen=True, slots=True)
class Pair:
    """One way to fail. A stop is in time within bound_s, or within bound_m of travel, both counted
    from when the fault first made a difference."""

    doc: str
    expect: Expect
    bound_s: float = 0.25
    bound_m: float = 0.0
    value: float | None = None
    """Default of the fault's `value`; its meaning is in `doc`."""
    hows: tuple[str, ...] = ()
    """Which of several the failure is; the first is the default."""
    limit: str = ""
    """Why nothing on board can notice it without the optional sensors, and what reduces the harm:
    on a machine without them a bad outcome is a known limit, and never counts as a pass."""
    blade_stays: bool = False
    """Whether the blade turns whatever the firmware does: it must name that, and stop the wheels.
    """


_STOP, _RIDE = Expect.STOP, Expect.RIDE
_NO_BLADE_SENSOR: Final = "not detectable: no sensor on the blade"
_SLOW: Final = (1.0, 0.5)
"""Bound in s, and in m of travel, of what only a motion that does not come can tell."""
_STEERING: Final = (2.0, 0.5)
"""A turn's leg holds an angle for nearly two seconds, and so long a motor that does not turn makes
no difference that could be seen."""

PAIRS: Final[dict[tuple[Component, Failure], Pair]] = {
    ("pot", "off"): Pair("wire open: the pin reads `value` V", _STOP, value=5.0),
    ("pot", "stuck"): Pair("reads what it read", _STOP),
    ("pot", "garbage"): Pair("reads anything", _STOP),
    ("pot", "wrong"): Pair("reads `value` counts more", _STOP, value=100.0),
    ("pot", "slow"): Pair("follows with `value` s", _RIDE, value=0.2),
    ("pot", "delayed"): Pair("reads what it was `value` s ago", _RIDE, value=0.1),
    ("pot", "intermittent"): Pair("the wiper lifts now and then", _STOP),
    ("steering_motor", "off"): Pair("winding open", _STOP, *_STEERING),
    ("steering_motor", "stuck"): Pair("jammed", _STOP, *_STEERING),
    ("steering_motor", "wrong"): Pair("turns the wrong way", _STOP, *_STEERING),
    ("steering_motor", "slow"): Pair("has `value` of its strength", _RIDE, value=0.4),
    ("steering_motor", "intermittent"): Pair("loose brush", _RIDE),
    ("steering_bridge", "off"): Pair("gives no current", _STOP, *_STEERING),
    ("steering_bridge", "stuck"): Pair("keeps its output", _STOP, *_STEERING),
    ("steering_bridge", "garbage"): Pair("gives anything", _STOP, *_STEERING),
    ("steering_bridge", "wrong"): Pair("reversed", _STOP, *_STEERING),
    ("steering_bridge", "slow"): Pair("gives `value` of the duty", _RIDE, value=0.5),
    ("steering_bridge", "delayed"): Pair("follows `value` s later", _RIDE, value=0.05),
    ("steering_bridge", "intermittent"): Pair("loose contact", _RIDE),
    ("drive_motor", "off"): Pair("no torque", _STOP, *_SLOW),
    ("drive_motor", "stuck"): Pair("the wheels are blocked", _STOP, *_SLOW),
    ("drive_motor", "wrong"): Pair(
        "turns the wrong way",
        _STOP,
        *_SLOW,
        limit="not detectable in time: only the positions, one a second, tell a direction, and "
        "after a metre one way; no leg of a turn is that long",
    ),
    ("drive_motor", "slow"): Pair("has `value` of its strength", _RIDE, value=0.7),
    ("drive_motor", "intermittent"): Pair("loose brush", _RIDE),
    ("blade_relay", "off"): Pair(
        "does not close",
        _STOP,
        5.0,
        1.0,
        limit=f"{_NO_BLADE_SENSOR}; a side that does not end stops the machine",
    ),
    ("blade_relay", "stuck"): Pair(
        "welded: stays as it is",
        _STOP,
        0.5,
        limit=f"{_NO_BLADE_SENSOR}; the e-stop button must break the blade's own supply as well",
        blade_stays=True,
    ),
    ("blade_relay", "delayed"): Pair("follows `value` s later", _RIDE, value=0.2),
    ("blade_relay", "intermittent"): Pair(
        "chatters", _RIDE, limit=f"{_NO_BLADE_SENSOR}; what it leaves standing is seen as the edge"
    ),
    ("battery", "off"): Pair("cable off: everything without power", _STOP),
    ("battery", "stuck"): Pair("its measurement stays", _RIDE),
    ("battery", "garbage"): Pair("its measurement is anything", _STOP, 1.5, 1.0),
    ("battery", "wrong"): Pair("measures `value` V", _STOP, 1.5, 1.0, value=8.5),
    ("battery", "intermittent"): Pair("loose terminal: power comes and goes", _STOP),
    ("hall", "off"): Pair("no pulses", _STOP, *_SLOW),
    ("hall", "stuck"): Pair("its level stays", _STOP, *_SLOW),
    ("hall", "garbage"): Pair("pulses at random", _STOP, *_SLOW),
    ("hall", "intermittent"): Pair("loses pulses", _RIDE),
    ("estop", "off"): Pair("the loop is opened", _STOP),
    ("estop", "stuck"): Pair("its wire touches the chassis: the button would do nothing", _STOP),
    ("estop", "intermittent"): Pair("loose contact in the loop", _STOP),
    ("serial", "off"): Pair("unplugged; replugged after `for_s`", _STOP),
    ("serial", "garbage"): Pair("a bit of `value` of the bytes flips", _RIDE, value=0.01),
    ("serial", "wrong"): Pair("bursts of `value` bytes of rubbish", _RIDE, value=40.0),
    ("serial", "slow"): Pair("carries `value` bytes a second each way", _RIDE, value=1500.0),
    ("serial", "delayed"): Pair("`value` s each way", _RIDE, value=0.08),
    ("serial", "intermittent"): Pair("`value` of the time nothing passes", _RIDE, value=0.3),
    ("camera", "off"): Pair("no pictures", _STOP, *_SLOW),
    ("camera", "stuck"): Pair("the same picture again and again", _STOP, *_SLOW),
    ("camera", "garbage"): Pair("`value` of the file's bytes wrong", _STOP, *_SLOW, value=0.01),
    ("camera", "wrong"): Pair(
        "a useless picture", _STOP, *_SLOW, hows=("black", "overexposed", "covered")
    ),
    ("camera", "slow"): Pair("one picture in `value` s", _RIDE, *_SLOW, value=0.5),
    ("camera", "delayed"): Pair("pictures come `value` s later", _RIDE, *_SLOW, value=0.2),
    ("camera", "intermittent"): Pair("pictures come and go", _RIDE, *_SLOW),
    ("gnss", "off"): Pair("no sentences", _RIDE, *_SLOW),
    ("gnss", "stuck"): Pair("the same position and speed", _RIDE, *_SLOW),
    ("gnss", "garbage"): Pair("`value` of the characters wrong", _RIDE, *_SLOW, value=0.05),
    ("gnss", "wrong"): Pair(
        "off by `value` m at once (jump), or by `value` m more each minute (drift)",
        _RIDE,
        *_SLOW,
        value=20.0,
        hows=("jump", "drift"),
    ),
    ("gnss", "slow"): Pair("one position in `value` s", _RIDE, *_SLOW, value=5.0),
    ("gnss", "delayed"): Pair("positions come `value` s later", _RIDE, *_SLOW, value=2.0),
    ("gnss", "intermittent"): Pair("positions come and go", _RIDE, *_SLOW),
    ("gyro", "off"): Pair("no samples", _RIDE, *_SLOW),
    ("gyro", "stuck"): Pair("the same rate in every sample", _RIDE, *_SLOW),
    ("gyro", "garbage"): Pair("any rate in `value` of the samples", _RIDE, *_SLOW, value=0.2),
    ("gyro", "wrong"): Pair("shows `value` deg/s more on every axis", _RIDE, *_SLOW, value=5.0),
    ("gyro", "slow"): Pair("one answer in `value` s", _RIDE, *_SLOW, value=1.0),
    ("gyro", "delayed"): Pair("samples come `value` s later", _RIDE, *_SLOW, value=0.5),
    ("gyro", "intermittent"): Pair("samples come and go", _RIDE, *_SLOW),
    ("phone", "off"): Pair("gone, camera and positions; back after `for_s`", _STOP, *_SLOW),
    ("phone", "intermittent"): Pair("the phone's network comes and goes", _RIDE, *_SLOW),
    ("host", "off"): Pair("killed; started again after `for_s`", _STOP),
    ("host", "stuck"): Pair("stands still for `for_s`, then goes on", _STOP),
    ("host", "slow"): Pair("takes `value` s for a step", _RIDE, value=0.15),
    ("firmware", "off"): Pair("reset", _STOP),
    ("firmware", "stuck"): Pair("hangs: the watchdog must end it", _STOP),
    ("firmware", "intermittent"): Pair("reset every `value` s", _STOP, value=0.5),
}


class Place(Strict):
    """Where the rear axle comes near."""

    x_m: float
    y_m: float
    radius_m: Annotated[float, Field(gt=0)] = 0.5


class At(Strict):
    """When a fault begins: `after_s` behind exactly one of a time, a pilot's state, one of its
    behaviours and a place; where a direction is given, the machine has moved that way for so long
    by then."""

    time_s: Annotated[float, Field(ge=0)] | None = None
    state: (
        Literal["connect", "align", "follow", "turn", "search", "hesitate", "finished", "fault"]
        | None
    ) = None
    doing: Doing | None = None
    """A state has several: at a side's end the pilot looks and lays out before it turns."""
    place: Place | None = None
    moving: Literal["forward", "backward"] | None = None
    after_s: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _one_of(self) -> Self:
        names = ("time_s", "state", "doing", "place")
        if sum(getattr(self, name) is not None for name in names) != 1:
            raise ValueError("give exactly one of time_s, state, doing and place")
        return self


class Fault(Strict):
    """One fault of a scenario."""

    component: Component
    failure: Failure
    at: At
    for_s: Annotated[float, Field(gt=0)] | None = None
    """None: to the end of the run."""
    value: float | None = None
    how: str | None = None

    @model_validator(mode="after")
    def _supported(self) -> Self:
        pair = PAIRS.get((self.component, self.failure))
        if pair is None:
            known = ", ".join(f for c, f in PAIRS if c == self.component)
            raise ValueError(
                f"{self.component} cannot be {self.failure!r}; {self.component} can be: {known}"
            )
        if self.how is not None and self.how not in pair.hows:
            known = ", ".join(pair.hows) or "none"
            raise ValueError(f"how {self.how!r}: {self.component} {self.failure} knows: {known}")
        if self.value is not None and pair.value is None:
            raise ValueError(f"value: {self.component} {self.failure} has none ({pair.doc})")
        if self.failure == "delayed" and not 0 < self.amount < signal_wires.DELAY_MS / 1000:
            wires = ("pot", "steering_bridge", "blade_relay")
            if self.component in wires or self.amount <= 0:
                raise ValueError(
                    f"value: a delay lies between 0 and {signal_wires.DELAY_MS / 1000:g} s"
                )
        if self.failure == "slow" and self.amount <= 0:
            raise ValueError("value: must be above 0")
        return self

    @property
    def pair(self) -> Pair:
        """What it means."""
        return PAIRS[self.component, self.failure]

    @property
    def amount(self) -> float:
        """`value`, or the pair's default."""
        return self.value if self.value is not None else (self.pair.value or 0.0)

    @property
    def kind(self) -> str:
        """`how`, or the pair's default; empty where there is none."""
        return self.how or (self.pair.hows[0] if self.pair.hows else "")

    @property
    def name(self) -> str:
        """In words, as tables show it."""
        return " ".join(part for part in (self.component, self.failure, self.kind) if part)
