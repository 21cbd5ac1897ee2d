"""Facts about dead reckoning: what it learns from, what it does not, and how far."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.messages import Fix, State, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.duty_speed import MOST_MPS
from host.estimate.odometry import Odometry
from host.estimate.rolling import Slope

VEHICLE = Vehicle()
DUTY = 128


def telemetry(
    t: float, *, angle: float = 0.0, duty: int = DUTY, blade: bool = False,
    speed: float | None = None, distance: float = 0.0,
) -> Telemetry:  # fmt: skip
    return Telemetry(t, State.RUNNING, 0, angle, angle, 0, duty, blade, speed, distance, 12.0, 0, 0)


def driven(
    shown_mps: float,
    seconds: int,
    odometry: Odometry | None = None,
    *,
    angle: float = 0.0,
    duty: int = DUTY,
    blade: bool = False,
    speed: float | None = None,
    quality: int = 1,
) -> Odometry:
    """After a drive whose Doppler speed was so much."""
    made = odometry or Odometry(VEHICLE)
    begin = made.now.stamp if math.isfinite(made.now.stamp) else 0.0
    for k in range(1, 50 * seconds + 1):
        now = begin + 0.02 * k
        told = telemetry(now, angle=angle, duty=duty, blade=blade, speed=speed)
        made.update(told)
        if k % 50 == 0:
            made.learn(Fix(now, 31.5, 74.3, quality, 1.0, 8, shown_mps), told, 1.0)
    return made


LEVEL = VEHICLE.duty_speed(DUTY, 12.0)


def turned(made: Odometry, radians: float) -> Odometry:
    """The same, standing, on another heading."""
    for k in range(1, 51):
        made.update(telemetry(made.now.stamp + 0.02, duty=0))
        if k == 25:
            made.now = replace(made.now, yaw_rad=made.now.yaw_rad + radians)
    return made


def test_what_the_duty_gives_is_learned_on_straights_only() -> None:
    assert driven(0.8 * LEVEL, 60, angle=math.radians(20)).now.speed_mps == pytest.approx(LEVEL)
    assert driven(0.8 * LEVEL, 60).now.speed_mps == pytest.approx(0.8 * LEVEL, rel=0.02)
    assert driven(0.8 * LEVEL, 60, quality=0).now.speed_mps == pytest.approx(LEVEL)


def test_at_a_crawl_nothing_is_learned() -> None:
    level = VEHICLE.duty_speed(30, 12.0)
    assert driven(0.0, 60, duty=30).now.speed_mps == pytest.approx(level)


def test_where_the_wheels_are_counted_there_is_nothing_to_learn() -> None:
    made = driven(0.3, 60, speed=0.5)
    made.update(telemetry(made.now.stamp + 0.02))
    assert driven(0.6 * LEVEL, 1, made).now.speed_mps > 0.6 * LEVEL


def test_a_loss_beyond_belief_is_not_taken() -> None:
    assert driven(3.0, 300).now.speed_mps == pytest.approx(LEVEL + MOST_MPS, abs=0.01)
    full = VEHICLE.duty_speed(255, 12.0)
    assert driven(0.1, 300, duty=255).now.speed_mps == pytest.approx(full - MOST_MPS, abs=0.01)


def test_what_the_crop_takes_is_learned_apart_from_the_ground() -> None:
    made = driven(0.7 * LEVEL, 60, driven(1.0 * LEVEL, 60), blade=True)
    assert made.now.speed_mps == pytest.approx(0.7 * LEVEL, rel=0.03)
    for _ in range(200):
        made.update(telemetry(made.now.stamp + 0.02))
    assert made.now.speed_mps == pytest.approx(LEVEL, rel=0.06)


def test_what_was_learned_long_ago_can_be_learned_anew() -> None:
    """A battery runs down in an hour."""
    made = driven(LEVEL, 1800)
    assert driven(0.9 * LEVEL, 120, made).now.speed_mps == pytest.approx(0.9 * LEVEL, rel=0.02)


@pytest.mark.parametrize("heading", [math.pi / 2, math.pi / 3, -2.0])
def test_what_a_slope_takes_uphill_it_gives_downhill(heading: float) -> None:
    """Learned as a ratio, uphill's was 40 % of the way wrong down the other side."""
    across = driven(LEVEL, 40, turned(Odometry(VEHICLE), heading - math.pi / 2))
    made = driven(LEVEL - 0.1, 40, turned(across, math.pi / 2))
    assert made.now.speed_mps == pytest.approx(LEVEL - 0.1, abs=0.02)
    made = turned(made, math.pi)
    for _ in range(200):
        made.update(telemetry(made.now.stamp + 0.02))
    assert made.now.speed_mps == pytest.approx(LEVEL + 0.1, abs=0.04)
    back = turned(made, 0.0)
    for _ in range(200):
        back.update(telemetry(back.now.stamp + 0.02, duty=-DUTY))
    assert back.now.speed_mps == pytest.approx(-(LEVEL - 0.1), abs=0.04)


def test_a_way_by_the_duty_is_as_unsure_as_what_is_not_learned_yet() -> None:
    new, learned = Odometry(VEHICLE), driven(LEVEL, 60)
    new.update(telemetry(0.0))
    new.update(telemetry(2.0))
    assert new.scale_sigma > 0.15
    assert learned.scale_sigma < 0.07
    across = turned(learned, math.pi / 2)
    for _ in range(100):
        across.update(telemetry(across.now.stamp + 0.02))
    assert across.scale_sigma > 2 * 0.07, "nobody knows that direction's slope"


def test_what_a_receiver_shows_late_of_each_start_is_no_slope() -> None:
    made = Odometry(VEHICLE)
    shown, stamp = 0.0, 0.0
    for k in range(1, 50 * 60):
        stamp += 0.02
        told = telemetry(stamp, duty=DUTY if k % 200 < 120 else 0)  # 2.4 s on, 1.6 s off
        made.update(told)
        shown += (made.now.speed_mps - shown) * 0.02 / 1.5
        if k % 50 == 0:
            made.learn(Fix(stamp, 31.5, 74.3, 1, 1.0, 8, shown), told, 1.0)
    for _ in range(150):
        made.update(telemetry(made.now.stamp + 0.02))
    assert made.now.speed_mps == pytest.approx(LEVEL, abs=0.035)


def creeping(told_radps: float) -> Odometry:
    """At full lock by the duty alone, beside a gyroscope whose offset is known."""
    made = Odometry(VEHICLE)
    made.gyroscope.offset_sigma = math.radians(0.01)
    yaw = 0.0
    for k in range(1, 50 * 12):
        stamp = 0.02 * k
        made.update(telemetry(stamp, angle=math.radians(40), duty=60))
        yaw += told_radps * 0.02
        if k % 5 == 0:
            made.take_turned(Turned(stamp, yaw, 0.0))
    return made


def test_a_turn_on_a_way_that_nobody_counts_does_not_tell_against_the_gyroscope() -> None:
    """Down a slope it turned twice as fast as by its duty, and the gyroscope was believed to be
    wrong: the machine then headed 177 degrees otherwise than it thought."""
    reckoned = VEHICLE.duty_speed(60, 12.0) * math.tan(math.radians(40)) / VEHICLE.wheelbase_m
    made = creeping(2.0 * reckoned)
    assert not made.gyroscope.contradicted
    assert made.now.yaw_rad == pytest.approx(2.0 * reckoned * 12.0, rel=0.1)
    assert creeping(-3.0 * reckoned).gyroscope.contradicted, "that no slope does"


def test_at_a_creep_that_nobody_counts_the_trim_is_not_learned() -> None:
    made = Odometry(VEHICLE)
    made.gyroscope.offset_sigma = math.radians(0.01)
    for k in range(1, 50 * 20):
        stamp = 0.02 * k
        made.update(telemetry(stamp, duty=50))
        if k % 5 == 0:
            made.take_turned(Turned(stamp, math.radians(1.0) * stamp, 0.0))
    assert made.trim_rad == 0.0


def test_a_drive_that_is_off_gives_no_speed_whatever_the_slope() -> None:
    made = driven(LEVEL + 0.1, 60)
    for _ in range(500):
        made.update(telemetry(made.now.stamp + 0.02, duty=0))
    assert made.now.speed_mps == pytest.approx(0.0, abs=1e-3)


def test_a_trim_beyond_belief_is_not_taken() -> None:
    made = Odometry(VEHICLE)
    for curvature, trim_deg in ((1.0, 5.0), (-2.0, -5.0)):
        made.turn_trim(curvature)
        assert math.degrees(made.trim_rad) == pytest.approx(trim_deg)
        assert made.pot_off_rad == made.trim_rad


def test_a_pot_that_is_off_by_less_is_none_to_be_named() -> None:
    made = Odometry(VEHICLE)
    made.turn_trim(math.tan(math.radians(4.0)) / VEHICLE.wheelbase_m)
    assert math.degrees(made.trim_rad) == pytest.approx(4.0)
    assert made.pot_off_rad == 0.0


def test_a_late_picture_finds_the_motion_of_its_own_time() -> None:
    made = Odometry(VEHICLE)
    for k in range(101):
        made.update(telemetry(0.02 * k, speed=0.5, distance=0.01 * k))
    for late in (0.0, 0.1, 0.5, 1.0):
        assert made.at(2.0 - late).distance_m == pytest.approx(1.0 - 0.5 * late, abs=0.011)
    assert made.at(-5.0).stamp == pytest.approx(0.5, abs=0.021), "as far back as it remembers"


def test_what_the_machine_turns_is_learned_from_turns_whose_result_is_known() -> None:
    made = Odometry(VEHICLE)
    for _ in range(5):
        before = made.now.yaw_rad
        driven(1.0, 5, made, angle=math.radians(40))
        reckoned = made.now.yaw_rad - before
        made.turned(reckoned, 0.96 * reckoned / made.yaw_gain)
    assert made.yaw_gain == pytest.approx(0.96, abs=0.005)


def test_one_turn_that_went_wrong_does_not_undo_many() -> None:
    made = Odometry(VEHICLE)
    for _ in range(20):
        made.turned(math.pi / 2 * made.yaw_gain, math.pi / 2)
    made.turned(math.pi / 2, math.pi / 2 - 0.2)
    assert made.yaw_gain == pytest.approx(1.0, abs=0.01)


PULSE_M = 0.02


class Slide:
    """A machine with one hall sensor on a slope: what it truly does, and what it reports."""

    def __init__(self, uphill: float) -> None:
        self.uphill = uphill
        """By how much slower than its duty says the machine drives forward, m/s; braked it creeps
        downhill with a third of it."""
        self.odometry = Odometry(VEHICLE)
        self.now = self.speed = self.place = self.way = self.counted = 0.0
        self.pulses, self.pulsed_s, self.pulse_s = 0, 0.0, 1.0
        self.sign = 1.0

    def drive(self, seconds: float, duty: int, angle: float = 0.0) -> None:
        level = math.copysign(VEHICLE.duty_speed(abs(duty), 12.0), duty) if duty else 0.0
        for _ in range(round(50 * seconds)):
            self.now += 0.02
            steady = level - self.uphill if duty else -self.uphill / 3
            self.speed += (steady - self.speed) * 0.02 / 0.1
            step = self.speed * 0.02
            self.place += step
            self.way += abs(step)
            self.sign = math.copysign(1.0, duty) if duty else self.sign
            if int(self.way / PULSE_M) > self.pulses:
                self.pulses += 1
                self.counted += self.sign * PULSE_M
                self.pulse_s, self.pulsed_s = self.now - self.pulsed_s, self.now
            speed = PULSE_M / max(self.pulse_s, self.now - self.pulsed_s)
            told = telemetry(
                self.now, angle=angle, duty=duty, speed=self.sign * speed, distance=self.counted
            )
            self.odometry.update(told)

    @property
    def lost_m(self) -> float:
        return self.place - self.odometry.now.distance_m


@pytest.mark.parametrize("uphill", [0.35, -0.35])
@pytest.mark.parametrize("duty", [90, -90])
def test_a_machine_that_rolls_while_it_stands_is_not_counted_as_going_on(
    uphill: float, duty: int
) -> None:
    """Once it has driven a little it knows where downhill is. Between two pulses it turns round."""
    slide = Slide(uphill)
    slide.drive(4.0, 110)
    slide.drive(4.0, -110)
    slide.drive(2.0, duty)
    before = slide.lost_m
    slide.drive(5.0, 0)
    assert abs(slide.lost_m - before) < 0.1
    assert slide.odometry.now.speed_mps == pytest.approx(slide.speed, abs=0.03)


def test_uphill_too_a_machine_runs_out_before_it_rolls_back() -> None:
    slide = Slide(0.35)
    slide.drive(4.0, 110)
    slide.drive(4.0, -110)
    slide.drive(2.0, 200)
    slide.drive(0.1, 0)
    assert slide.speed > 0.0
    assert slide.odometry.now.speed_mps > 0.0


@pytest.mark.parametrize("uphill", [0.2, 0.35])
@pytest.mark.parametrize("duty", [90, -90])
def test_a_machine_that_turns_round_shows_it_by_its_speed_alone(
    monkeypatch: pytest.MonkeyPatch, uphill: float, duty: int
) -> None:
    """Nothing is known of the slope: it rolls back where driving was uphill, on where it was
    downhill."""
    monkeypatch.setattr(Slope, "rolls", lambda *_: 0)
    slide = Slide(uphill)
    slide.drive(2.0, duty)
    before = slide.lost_m
    slide.drive(5.0, 0)
    assert abs(slide.lost_m - before) < 3 * PULSE_M
    assert slide.odometry.now.speed_mps == pytest.approx(slide.speed, abs=0.02)


def test_a_machine_that_runs_away_has_not_turned_round() -> None:
    """Its outputs are off and the brake is: downhill it only becomes the faster."""
    slide = Slide(-0.9)
    slide.drive(2.0, 30)
    slide.drive(0.4, 0)
    slide.uphill = -2.4
    before = slide.lost_m
    slide.drive(2.0, 0)
    assert slide.speed > 0.7
    assert abs(slide.lost_m - before) < 0.05


@pytest.mark.parametrize("duty", [90, -90])
def test_a_machine_that_never_slowed_goes_on_whatever_is_believed_of_the_slope(
    monkeypatch: pytest.MonkeyPatch, duty: int
) -> None:
    """Told to stand it rolls on downhill, at the creep of its brake; the slope is taken for the
    opposite."""
    ahead = math.copysign(1.0, duty)
    monkeypatch.setattr(Slope, "rolls", lambda *_: -int(ahead))
    slide = Slide(-0.6 * ahead)
    slide.drive(2.0, duty)
    before = slide.lost_m
    slide.drive(3.0, 0)
    assert ahead * slide.speed > 0.1
    assert abs(slide.lost_m - before) < 0.05
    assert slide.odometry.now.speed_mps == pytest.approx(slide.speed, abs=0.03)


def test_on_the_level_a_machine_that_runs_out_counts_as_it_goes() -> None:
    slide = Slide(0.0)
    slide.drive(2.0, 90)
    slide.drive(2.0, 0)
    assert abs(slide.lost_m) < 0.03


def test_the_slope_is_known_in_every_direction() -> None:
    slope = Slope()
    for yaw, loss in ((0.0, 0.15), (math.pi / 2, 0.05), (math.pi, -0.05), (-math.pi / 2, 0.05)):
        for _ in range(100):
            slope.learn(yaw, 0.3, 0.3 + loss, cutting=False)
    assert [slope.rolls(k * math.pi / 2) for k in range(4)] == [-1, 0, 1, 0]


def test_crop_before_the_blade_is_no_slope() -> None:
    """It takes as much in every direction."""
    slope = Slope()
    for k in range(8):
        for _ in range(100):
            slope.learn(k * math.pi / 2, 0.3, 0.5, cutting=True)
    assert [slope.rolls(k * math.pi / 2) for k in range(4)] == [0, 0, 0, 0]
    for _ in range(100):
        slope.learn(0.0, 0.3, 0.6, cutting=True)
        slope.learn(math.pi, 0.3, 0.4, cutting=True)
    assert [slope.rolls(k * math.pi) for k in range(2)] == [-1, 1]


def test_a_machine_that_moves_with_its_drive_off_rolls() -> None:
    """Not while it runs out, nor where it stands."""
    slide = Slide(0.35)
    slide.drive(2.0, 110)
    assert not slide.odometry.now.rolls
    rolled = []
    for _ in range(250):
        slide.drive(0.02, 0)
        rolled.append(slide.odometry.now.rolls)
    assert not any(rolled[:10])
    assert any(rolled)
    level = Slide(0.0)
    level.drive(2.0, 110)
    level.drive(5.0, 0)
    assert not level.odometry.now.rolls
