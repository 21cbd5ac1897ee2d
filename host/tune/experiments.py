"""Bounded raw-PWM experiments on the steering actuator, which `host.tune.actuator_model` explains.

They speak to the machine through a `Wire` (a serial port, or the bench in lockstep) and use the
firmware's identification mode alone, which bounds duty, angle and time on its own account.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.messages import State, Telemetry
from host.link import protocol
from host.tune.actuator_model import TICK_S, Findings, Run, relay_figures, speed_of
from host.tune.wire import Wire, armed_wire, why

Floats = NDArray[np.float64]

REFRESH_S: Final = 0.05
"""Between repeated commands; the firmware's link watchdog takes 250 ms."""
BYTE_S: Final = 10 / protocol.BAUD
"""On the line: start bit, eight bits, stop bit."""
OFFSETS: Final = 12
"""Telemetry, a quarter of a second, whose quickest tells how host's and firmware's clock differ."""
SILENT_S: Final = 1.0
"""Without telemetry, of which 50 come in a second: the board hangs, or its wire is broken."""
REST_S: Final = 0.2
"""Motor off at least so long: twice the slowest motor's lag."""
STILL_DEG: Final = 0.15
"""Between means of five samples: a wheel that coasts moves more."""
STILL_SAMPLES: Final = 14
"""Telemetry samples in the mean of a resting angle."""
MOVED_DEG: Final = 0.14
"""Between two such means: more than the pot's noise, less than the slowest motion."""
TRY_S: Final = 0.25
"""Of a try which way a duty moves the wheel: half of that, while nothing is known yet."""
PULSE_S: Final = 0.5
"""Of a try whether a duty moves the wheel: below the firmware's suspicion of a stall."""
START_DEG: Final = 24.0
"""Runs begin here on one side ..."""
TURN_DEG: Final = 14.0
"""... and are released here on the other, ..."""
REACH_DEG: Final = 28.0
"""... or earlier, where the motor would coast beyond this: the firmware ends it at 35."""
COAST_DEG: Final = 20.0
"""How far a released motor is taken to coast until it has been seen."""
RUN_S: Final = 1.0
"""Of a step: over that range the slowest motor takes no longer."""
RELAY_S: Final = 3.0
"""Of the relay's oscillation, at the longest."""
RELAY_TURNS: Final = 9
"""A relay's oscillation ends by time or after so many turns, of which the second half counts."""


@dataclass
class _Segment:
    """One Ident message as the firmware took it."""

    sent_s: float
    duty: int
    duration_s: float
    taken_s: float = math.nan
    """On the firmware's clock, by the acknowledgement's arrival."""
    after_s: float = -math.inf
    """Times of the telemetry before and at which the firmware had taken it."""
    until_s: float = math.inf


@dataclass
class Experimenter:
    """Runs the experiments on an armed machine; `say` hears what is going on.

    Raises UserError when the firmware refuses, faults or falls silent, or when the motor turns the
    wrong way. Whoever calls sends STOP whatever happens: use `armed`.
    """

    wire: Wire
    say: Callable[[str], None] = lambda _: None
    duty_max: int = 200
    trace: list[Telemetry] = field(default_factory=list)
    _segments: dict[int, _Segment] = field(default_factory=dict)
    _offsets_s: deque[float] = field(default_factory=lambda: deque(maxlen=OFFSETS))
    """Host's clock less the firmware's, of the latest telemetry: the two drift apart."""
    _heard_s: float | None = None
    """When telemetry came last, on the host's clock."""
    _way: int = 0
    _coasts_deg: list[float] = field(default_factory=list)
    """How far the released motor ran on, run by run."""

    # -- talking

    def wait(self, seconds: float, until: Callable[[Telemetry], bool] | None = None) -> bool:
        """Lets time pass, to the first telemetry that `until` likes. The link stays fed."""
        end = self.wire.now + seconds
        while self.wire.now < end - 1e-9:
            arrived = self.wire.poll()
            if arrived or self._heard_s is None:
                self._heard_s = self.wire.now
            elif self.wire.now - self._heard_s > SILENT_S:
                raise UserError(
                    f"no telemetry for {SILENT_S:g} s; the firmware hangs or the cable is broken. "
                    "Reset the board and start again"
                )
            for telemetry in arrived:
                self._take(telemetry)
                if until is not None and until(telemetry):
                    return True
            self._acknowledged()
        return False

    def _take(self, telemetry: Telemetry) -> None:
        firmware_s = telemetry.firmware_s
        self.trace.append(telemetry)
        segment = self._segments.get(telemetry.last_seq)
        if segment is not None and segment.until_s == math.inf:
            segment.until_s = firmware_s
            if len(self.trace) > 1:
                segment.after_s = self.trace[-2].firmware_s
        self._offsets_s.append(telemetry.stamp - _wire_s(protocol.Telemetry) - firmware_s)
        if telemetry.state is not State.ARMED:
            raise UserError(f"the firmware ended the identification: {why(telemetry)}")

    def _acknowledged(self) -> None:
        answers = self.wire.session.answers
        while answers:
            answer = answers.popleft()
            if not isinstance(answer, protocol.Ack) or answer.request_id != protocol.Ident.ID:
                continue
            if answer.result is not protocol.Result.OK:
                refusal = self.wire.session.refusal
                self.wait(0.1)  # its telemetry says why
                raise UserError(f"the firmware refused: {refusal}")
            segment = self._segments.get(answer.request_seq)
            if segment is not None and math.isnan(segment.taken_s):
                sent_s = self.wire.now - _wire_s(protocol.Ack)
                segment.taken_s = sent_s - min(self._offsets_s, default=math.nan)

    def _ident(self, duty: int, duration_s: float) -> _Segment:
        session = self.wire.session
        segment = _Segment(self.wire.now, duty, duration_s)
        self._segments[session.next_seq] = segment  # replaces the one of 256 messages ago
        self.wire.request(protocol.Ident(duty, duration_s))
        return segment

    def drive(
        self, duty: int, seconds: float, until: Callable[[Telemetry], bool] | None = None
    ) -> list[_Segment]:
        """Raw duty for a time, or until a telemetry says enough. Does not release."""
        segments = []
        left = seconds
        while left > 1e-9:
            span = min(left, REFRESH_S)
            # The motor is released by itself soon after, should the next message be lost.
            segments.append(self._ident(duty, span + 2 * REFRESH_S if duty else 0.0))
            if self.wait(span, until):
                break
            left -= span
        return segments

    def release(self) -> _Segment:
        """Motor off, until the wheel has come to rest."""
        segment = self.drive(0, REST_S)[0]
        for _ in range(40):
            angles = [t.angle_rad for t in self.trace[-10:]]
            moved = float(np.mean(angles[5:]) - np.mean(angles[:5]))
            if len(angles) == 10 and abs(math.degrees(moved)) < STILL_DEG:
                break
            self.drive(0, 0.04)
        return segment

    def angle(self, samples: int = STILL_SAMPLES) -> float:
        """Mean of the resting angle, degrees."""
        begin = len(self.trace)
        while len(self.trace) < begin + samples:
            self.drive(0, TICK_S * 4)
        return math.degrees(float(np.mean([t.angle_rad for t in self.trace[begin:]])))

    def _fresh_budget(self) -> None:
        """The firmware bounds the time in identification mode until the next Drive; one to the
        angle where the wheel stands moves nothing."""
        here = self.trace[-1].angle_rad
        self.wire.request(protocol.Drive(here, 0.0, 0))
        self.drive(0, 2 * TICK_S)

    # -- the pieces

    def find_direction(self, enough_deg: float = 1.5) -> int:
        """The duty that surely moves the wheel. Raises UserError where it moves the wrong way."""
        way = -1 if self.angle() > 0 else 1
        for duty in range(40, self.duty_max + 1, 20):
            before = self.angle()
            self.drive(way * duty, TRY_S, _far_from(before, 2 * enough_deg))
            self.release()
            moved = self.angle() - before
            if abs(moved) > enough_deg:
                self._way = way
                if moved * way < 0:
                    raise UserError(
                        "motor and potentiometer disagree: a duty to the left moved the wheel's "
                        "reading to the right. If the wheel truly turned left, exchange the "
                        "potentiometer's outer wires, else the motor's wires"
                    )
                return duty
        raise UserError(
            f"the steering does not move at a duty of {self.duty_max}, or by less than "
            f"{enough_deg:.2g} degrees in {TRY_S:g} s: check the motor, its supply, its gear and "
            "the bridge, or raise ident_duty_max"
        )

    def go_to(self, angle_deg: float, duty: int) -> None:
        """Roughly there, by pulses, brisk from afar; the wheel comes to rest."""
        brisk = (duty + self.duty_max) // 2
        for _ in range(12):
            self._fresh_budget()
            off = angle_deg - self.angle(4)
            if abs(off) < 3.0:
                return
            way = 1 if off > 0 else -1
            if abs(off) > 12.0:
                self.drive(way * brisk, 1.5, _past(way, angle_deg - way * 9.0))
            else:
                self.drive(way * duty, 1.5, _past(way, angle_deg - way * 2.5))
            self.release()
            self._way = way

    def find_min_duty(self, way: int, moving_duty: int) -> float:
        """The duty that just moves the wheel from rest, `way` +1 left or -1 right: by bisection,
        the backlash closed, between pulses that do and that do not."""
        self.go_to(-way * START_DEG * 0.6, moving_duty)
        self._fresh_budget()
        before = self.angle(4)
        self.drive(way * moving_duty, 1.5, _past(way, before + way))
        self.release()
        low, high = moving_duty // 4, moving_duty
        before = self.angle()
        while high - low > 2:
            duty = (low + high) // 2
            self._fresh_budget()
            self.drive(way * duty, PULSE_S, _past(way, before + way))
            self.release()
            after = self.angle()
            if way * (after - before) > MOVED_DEG:
                high = duty
            else:
                low = duty
            before = after
        self._way = way
        return (low + high) / 2

    def find_stop(self, way: int, duty: int, scale: float) -> float:
        """Creeps `way` until the wheel no longer moves; the angle there, as the firmware reads it.
        `scale`: true degrees in one that it reads. Short pulses, so that no stall is suspected."""
        before = self.angle(4)
        stuck = 0
        for _ in range(400):
            self._fresh_budget()
            self.drive(way * duty, 0.3)
            self.drive(0, 0.1)
            here = self.angle(4)
            # The backlash takes a pulse or two that move nothing either.
            stuck = stuck + 1 if abs(here - before) * scale < 0.25 else 0
            if stuck == 4:
                self.release()
                return self.angle()
            before = here
        raise UserError("no stop found: the steering goes on and on; check the potentiometer")

    def run(self, kind: str, play: Iterator[tuple[int, float]], way: int) -> Run:
        """One excitation, the duties and seconds of `play`, recorded from rest to release."""
        self._fresh_budget()
        start = self.angle()
        slack = way != self._way
        begin = len(self.trace)
        segments: list[_Segment] = []
        last = way
        bound = max(3.0, min(TURN_DEG, REACH_DEG - max(self._coasts_deg, default=COAST_DEG)))
        for duty, seconds in play:
            last = 1 if duty > 0 else -1
            segments += self.drive(duty, seconds, _past(last, last * bound))
        released = math.degrees(self.trace[-1].angle_rad)
        stop = self.release()
        self._coasts_deg.append(abs(math.degrees(self.trace[-1].angle_rad) - released))
        self._way = last
        times, duties = self._edges([*segments, stop])
        clock = np.array([t.firmware_s for t in self.trace[begin:]])
        angle = np.degrees([t.angle_rad for t in self.trace[begin:]])
        keep = (clock >= times[0] - TICK_S) & (clock <= times[-1] + TICK_S)
        return Run(
            kind=kind,
            edges_s=tuple((times - times[0]).tolist()),
            duties=tuple(duties),
            slack=slack,
            time_s=tuple((clock[keep] - times[0]).tolist()),
            angle_deg=tuple(angle[keep].tolist()),
            start_deg=start,
        )

    def _edges(self, segments: Sequence[_Segment]) -> tuple[Floats, list[int]]:
        """When each change of the duty happened on the firmware's clock, and the duties.

        Acknowledgements leave in the tick that took the message, as telemetry does; the quickest
        of the latest telemetry gives the clocks' offset, the telemetry that first names the
        message bounds the error, and the tick's grid does the rest.
        """
        times: list[float] = []
        duties: list[int] = []
        phase = self.trace[-1].firmware_s % TICK_S
        for segment in segments:
            if duties and segment.duty == duties[-1]:
                continue
            if math.isnan(segment.taken_s):
                raise UserError("an acknowledgement got lost during a run: check the cable")
            taken = min(segment.until_s, max(segment.after_s + TICK_S, segment.taken_s))
            times.append(round((taken - phase) / TICK_S) * TICK_S + phase)
            duties.append(segment.duty)
        return np.array(times), duties[:-1]

    # -- the whole

    def identify(self) -> Findings:
        """All experiments, some 45 s on the machine's clock."""
        begin = self.wire.now
        self.drive(0, 0.1)
        self.say("direction")
        moving = self.find_direction()
        quiet = len(self.trace)
        self.angle(25)
        noise = float(np.std(np.degrees([t.angle_rad for t in self.trace[quiet:]])))
        mins = {}
        for way, name in ((1, "left"), (-1, "right")):
            self.say(f"minimum duty to the {name}")
            mins[way] = self.find_min_duty(way, moving)
        runs = []
        low = max(mins.values())
        strong = max(self.duty_max, round(low))
        middle = round(low + 0.45 * (strong - low))
        self.go_to(-START_DEG, moving)
        for level in (strong, middle, strong):
            for way in (1, -1):
                self.say(f"step of duty {way * level:+d}")
                runs.append(self.run("step", iter([(way * level, RUN_S)]), way))
        dwell = min(0.4, max(0.12, 5.0 / speed_of(runs[0])))
        for number in range(3):
            self.go_to(0.0, moving)
            self.say("pseudo-random binary sequence")
            runs.append(self.run("prbs", self._prbs(strong, dwell, number), 1))
        self.go_to(0.0, moving)
        self.say("relay")
        relay = self.run("relay", self._relay(strong), 1)
        runs.append(relay)
        gain, period = relay_figures(relay)
        return Findings(
            runs=tuple(runs),
            min_left=mins[1],
            min_right=mins[-1],
            noise_deg=noise,
            battery_v=float(np.mean([t.battery_v for t in self.trace])),
            relay_gain=gain,
            relay_period_s=period,
            duration_s=self.wire.now - begin,
        )

    def _prbs(self, level: int, dwell_s: float, number: int) -> Iterator[tuple[int, float]]:
        """Full duty either way, changing at random multiples of the dwell, kept round the middle.
        The dwell is long enough for the wheel to move, or the firmware would see a stall."""
        random = np.random.default_rng(number)
        way = 1
        end = self.wire.now + max(1.2, 5 * dwell_s)
        while self.wire.now < end:
            yield way * level, dwell_s * int(random.integers(1, 4))
            here = math.degrees(self.trace[-1].angle_rad)
            way = -way if abs(here) < TURN_DEG * 0.6 else (-1 if here > 0 else 1)

    def _relay(self, level: int) -> Iterator[tuple[int, float]]:
        """Duty against the angle's sign, with hysteresis above the noise."""
        way = 1
        end = self.wire.now + RELAY_S
        turns = 0
        while self.wire.now < end and turns < RELAY_TURNS:
            yield way * level, 4 * TICK_S
            here = math.degrees(self.trace[-1].angle_rad)
            if way * here > 0.6:
                way = -way
                turns += 1


def _past(way: int, angle_deg: float) -> Callable[[Telemetry], bool]:
    """Whether the wheel is beyond an angle, `way` +1 to the left of it, -1 to the right."""
    return lambda telemetry: way * (math.degrees(telemetry.angle_rad) - angle_deg) > 0


def _far_from(angle_deg: float, far_deg: float) -> Callable[[Telemetry], bool]:
    return lambda telemetry: abs(math.degrees(telemetry.angle_rad) - angle_deg) > far_deg


@contextmanager
def armed(wire: Wire, name: str, params: Mapping[str, float]) -> Iterator[Experimenter]:
    """An armed machine for experiments, stopped whatever happens. `params`: the firmware's
    parameters that bound them. Raises UserError where it does not arm."""
    with armed_wire(wire, name):
        yield Experimenter(wire, duty_max=round(params["ident_duty_max"]))


def _wire_s(kind: type[protocol.Message]) -> float:
    """How long a message takes on the line: payload, id, seq, CRC and COBS's two bytes."""
    return (kind.LAYOUT.size + 6) * BYTE_S
