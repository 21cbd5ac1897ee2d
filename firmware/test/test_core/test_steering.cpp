#include <doctest.h>

#include "fixed.h"
#include "params_with.h"
#include "steering.h"

using namespace daranti;
using protocol::Param;

namespace {

Pot pot_with(std::initializer_list<Set> sets) {
  Pot pot;
  pot.configure(with(sets));
  return pot;
}

// At how many readings the next one gives a smaller angle.
int falls(const Pot &pot) {
  int count = 0;
  for (int16_t reading = 0; reading < kAnalogMax; ++reading) {
    count += pot.angle(reading) > pot.angle(static_cast<int16_t>(reading + 1));
  }
  return count;
}

// Proportional action only, 1 duty/deg, no minimum duty, nothing slewed.
Steering plain(std::initializer_list<Set> sets = {}) {
  const Params params = with({{Param::steer_kp, 100},
                              {Param::steer_ki, 0},
                              {Param::steer_kd, 0},
                              {Param::steer_min_duty, 0},
                              {Param::steer_slew, 3000},
                              {Param::steer_duty_slew, 25500},
                              {Param::steer_deadband, 0}});
  Steering steering;
  steering.configure(with(sets, params));
  return steering;
}

int16_t settle(Steering &steering, int16_t target, int16_t angle, int ticks = 100) {
  int16_t duty = 0;
  for (int i = 0; i < ticks; ++i) duty = steering.step(target, angle);
  return duty;
}

}  // namespace

TEST_CASE("The potentiometer's default calibration: 4.5 counts per degree round 512") {
  const Pot pot = pot_with({});
  CHECK(pot.calibrated());
  CHECK(pot.angle(512 * 16) == 0);
  CHECK(pot.angle(737 * 16) == 5000);
  CHECK(pot.angle(287 * 16) == -5000);
  CHECK(pot.angle(512 * 16 + 72) == 100);
  CHECK(pot.angle(512 * 16 - 72) == -100);
}

TEST_CASE("Either side of the potentiometer has its own slope") {
  const Pot pot = pot_with({{Param::pot_left, 7120}, {Param::pot_right, 4120}});
  CHECK(pot.angle(712 * 16) == 5000);
  CHECK(pot.angle(612 * 16) == 2500);
  CHECK(pot.angle(412 * 16) == -5000);
  CHECK(pot.angle(462 * 16) == -2500);
}

TEST_CASE("The calibration angles need not be 50 degrees") {
  const Pot pot = pot_with({{Param::angle_left, 3000}, {Param::angle_right, -2000}});
  CHECK(pot.angle(737 * 16) == 3000);
  CHECK(pot.angle(287 * 16) == -2000);
}

TEST_CASE("A potentiometer mounted the other way round works as well") {
  const Pot pot = pot_with({{Param::pot_left, 2870}, {Param::pot_right, 7370}});
  CHECK(pot.calibrated());
  CHECK(pot.angle(512 * 16) == 0);
  CHECK(pot.angle(287 * 16) == 5000);
  CHECK(pot.angle(737 * 16) == -5000);
  CHECK(pot.angle(400 * 16) > 0);
}

TEST_CASE("A calibration in disorder or with too little travel is refused") {
  CHECK(!pot_with({{Param::pot_right, 7370}}).calibrated());
  CHECK(!pot_with({{Param::pot_left, 2870}}).calibrated());
  CHECK(!pot_with({{Param::pot_left, 5120}}).calibrated());
  CHECK(!pot_with({{Param::pot_right, 5120}}).calibrated());
  // One count per degree is enough, less is not.
  CHECK(pot_with({{Param::pot_left, 5620}}).calibrated());
  CHECK(!pot_with({{Param::pot_left, 5610}}).calibrated());
  CHECK(pot_with({{Param::pot_right, 4620}}).calibrated());
  CHECK(!pot_with({{Param::pot_right, 4630}}).calibrated());
}

TEST_CASE("The coarsest calibration does not overflow over the whole converter") {
  const Pot pot = pot_with({{Param::pot_centre, 0},
                            {Param::pot_left, 800},
                            {Param::angle_left, 8000},
                            {Param::pot_right, 0}});
  CHECK(!pot.calibrated());
  const Pot wide = pot_with({{Param::pot_centre, 9430},
                             {Param::pot_left, 10230},
                             {Param::pot_right, 8630},
                             {Param::angle_left, 8000},
                             {Param::angle_right, -8000}});
  REQUIRE(wide.calibrated());
  CHECK(wide.angle(kAnalogMax) == 8000);
  CHECK(wide.angle(8630 * 8 / 5) == -8000);
  CHECK(falls(wide) == 0);
}

TEST_CASE("The angle grows with the reading at every count") {
  const Pot pot = pot_with({});
  CHECK(falls(pot) == 0);
}

TEST_CASE("The duty has the error's sign") {
  Steering steering = plain();
  CHECK(settle(steering, 2000, 0) == 20);
  CHECK(settle(steering, -2000, 0) == -20);
  CHECK(settle(steering, 2000, 4000) == -20);
}

TEST_CASE("The setpoint starts where the wheel stands") {
  Steering steering = plain({{Param::steer_slew, 1000}});
  steering.step(3000, 1000);
  // 100 deg/s is 0.5 deg a tick.
  CHECK(steering.setpoint() == 1050);
  steering.step(3000, 1000);
  CHECK(steering.setpoint() == 1100);
  steering.release();
  CHECK(steering.setpoint() == 1100);
  steering.step(-3000, -2000);
  CHECK(steering.setpoint() == -2050);
}

TEST_CASE("The setpoint keeps to the limit on either side, whatever is asked") {
  Steering steering = plain({{Param::steer_limit, 3000}});
  settle(steering, 32767, 0);
  CHECK(steering.setpoint() == 3000);
  settle(steering, -32768, 0);
  CHECK(steering.setpoint() == -3000);
}

TEST_CASE("The minimum duty is added in the output's direction") {
  Steering steering = plain({{Param::steer_min_duty, 60}});
  CHECK(settle(steering, 2000, 0) == 80);
  CHECK(settle(steering, -2000, 0) == -80);
}

TEST_CASE("The minimum duty takes a direction at 3 duty and keeps it to zero") {
  Steering steering = plain({{Param::steer_min_duty, 60}});
  CHECK(settle(steering, 200, 0) == 0);
  CHECK(settle(steering, 300, 0) == 63);
  CHECK(settle(steering, 200, 0) == 62);
  CHECK(settle(steering, 100, 0) == 61);
  CHECK(settle(steering, 0, 0) == 0);
  CHECK(settle(steering, 200, 0) == 0);
  CHECK(settle(steering, -200, 0) == 0);
  CHECK(settle(steering, -300, 0) == -63);
  CHECK(settle(steering, -100, 0) == -61);
  CHECK(settle(steering, 100, 0) == 0);
}

TEST_CASE("The duty never leaves its maximum, minimum duty included") {
  Steering steering =
      plain({{Param::steer_kp, 10000}, {Param::steer_min_duty, 60}, {Param::steer_duty_max, 200}});
  CHECK(settle(steering, 5000, 0) == 200);
  CHECK(settle(steering, -5000, 0) == -200);
  Steering odd = plain({{Param::steer_min_duty, 100}, {Param::steer_duty_max, 80}});
  CHECK(settle(odd, 5000, 0) == 0);
}

TEST_CASE("The duty grows no faster than its slew, and falls at once") {
  Steering steering = plain({{Param::steer_duty_slew, 1000}, {Param::steer_kp, 1000}});
  CHECK(steering.step(5000, 0) == 5);
  CHECK(steering.step(5000, 0) == 10);
  settle(steering, 2000, 0, 100);
  CHECK(settle(steering, 2000, 0, 1) == 200);
  CHECK(steering.step(2000, 2000) == 0);
  settle(steering, 2000, 0, 100);
  // Reversing starts at nothing, not at the old duty.
  CHECK(steering.step(2000, 4000) == -5);
  CHECK(steering.step(2000, 4000) == -10);
  CHECK(steering.step(2000, 0) == 5);
}

TEST_CASE("A released wheel at its setpoint stays released within the rest band") {
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 45, 0) == 0);
  CHECK(settle(steering, -45, 0) == 0);
  CHECK(settle(steering, 60, 0) != 0);
}

TEST_CASE("A driven wheel comes to rest within two thirds of the band, and only when slow") {
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 1000, 0) != 0);
  CHECK(settle(steering, 1000, 960) != 0);
  CHECK(settle(steering, 1000, 971) == 0);
  // It passes the setpoint at 10 deg/s: it must be braked, not released.
  Steering passing = plain({{Param::steer_deadband, 500}, {Param::steer_kp, 10000}});
  settle(passing, 1000, 0);
  bool released = false;
  for (int16_t angle = 0; angle <= 990; angle = static_cast<int16_t>(angle + 5)) {
    released = passing.step(1000, angle) == 0 || released;
  }
  CHECK(!released);
}

TEST_CASE("Noise of the potentiometer does not wake a resting wheel") {
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 0, 0) == 0);
  for (int i = 0; i < 400; ++i) {
    CHECK(steering.step(0, static_cast<int16_t>(i % 2 == 0 ? 60 : -60)) == 0);
  }
}

TEST_CASE("At rest the integral is empty") {
  Steering steering = plain({{Param::steer_ki, 10000}, {Param::steer_deadband, 45}});
  CHECK(settle(steering, 20, 0, 1000) == 0);
  steering.step(1020, 0);
  CHECK(steering.step(1020, 0) <= 11 + 100);
}

TEST_CASE("After a release nothing of the past acts") {
  Steering fresh = plain({{Param::steer_ki, 5000}, {Param::steer_kd, 500}});
  Steering used = fresh;
  settle(used, 3000, 500, 300);
  used.release();
  for (int i = 0; i < 20; ++i) CHECK(used.step(2000, 100) == fresh.step(2000, 100));
}

TEST_CASE("After a release the duty grows from nothing") {
  Steering steering = plain({{Param::steer_duty_slew, 1000}, {Param::steer_kp, 1000}});
  settle(steering, 2000, 0);
  steering.release();
  CHECK(steering.step(2000, 0) == 5);
}

TEST_CASE("After a release a wheel near its setpoint rests, whatever it did before") {
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  for (const int16_t before : {3000, -3000}) {
    CHECK(settle(steering, before, 0) != 0);
    steering.release();
    for (int i = 0; i < 50; ++i) CHECK(steering.step(40, 0) == 0);
    CHECK(settle(steering, 60, 0) != 0);
    steering.release();
  }
}

TEST_CASE("After a release a wheel rests until its error has left the band") {
  // The first tick's 150 of slew make 18 of smoothed error.
  Steering steering = plain({{Param::steer_deadband, 20}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 3000, 0) != 0);
  steering.release();
  CHECK(steering.step(5000, 0) == 0);
  CHECK(steering.step(5000, 0) != 0);
}

TEST_CASE("A resting wheel wakes when the error smoothed over 8 ticks leaves the band") {
  // 1 - (7/8)^n of 100 passes 45 in the fifth tick.
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  for (int i = 0; i < 4; ++i) CHECK(steering.step(100, 0) == 0);
  CHECK(steering.step(100, 0) != 0);
}

TEST_CASE("An error of just the band wakes nothing") {
  Steering steering = plain({{Param::steer_deadband, 300}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 300, 0, 1000) == 0);
  CHECK(settle(steering, -300, 0, 1000) == 0);
}

TEST_CASE("Two thirds of the band are near enough to rest") {
  Steering steering = plain({{Param::steer_deadband, 45}, {Param::steer_kp, 10000}});
  CHECK(settle(steering, 1000, 0) != 0);
  CHECK(settle(steering, 1000, 970, 200) == 0);
}

TEST_CASE("At 3 deg/s a wheel does not rest yet") {
  // 6 deg/s, then half of it as the filter sees the halt, with half a tick's share.
  Steering steering =
      plain({{Param::steer_deadband, 500}, {Param::steer_kp, 10000}, {Param::steer_d_filter, 5}});
  settle(steering, 1000, 0);
  int16_t angle = 0;
  for (; angle < 900; angle = static_cast<int16_t>(angle + (angle < 400 ? 4 : 3))) {
    CHECK(steering.step(1000, angle) != 0);
  }
  angle = static_cast<int16_t>(angle - 3);
  CHECK(steering.step(1000, angle) != 0);
  CHECK(steering.step(1000, angle) == 0);
}

TEST_CASE("A wheel that passes its setpoint is not pushed on") {
  Steering steering = plain({{Param::steer_min_duty, 60}, {Param::steer_deadband, 45}});
  settle(steering, 1000, 0);
  for (int16_t angle = 0; angle < 1000; angle = static_cast<int16_t>(angle + 50)) {
    CHECK(steering.step(1000, angle) >= 0);
  }
  CHECK(steering.step(1000, 1000) == 0);
}

TEST_CASE("The integral acts while the wheel is driven, and is gone at rest") {
  Steering steering = plain({{Param::steer_kp, 0}, {Param::steer_ki, 2000}});
  // 10 deg at 20 duty/(deg s).
  CHECK(settle(steering, 1000, 0, 101) > 90);
  Steering resting = plain({{Param::steer_ki, 10000}, {Param::steer_deadband, 500}});
  Steering fresh = resting;
  CHECK(settle(resting, 300, 0, 1000) == 0);
  fresh.step(300, 0);
  for (int i = 0; i < 10; ++i) {
    resting.step(4000, 0);
    fresh.step(4000, 0);
  }
  // What the smoothing makes of the different past is one tick's worth.
  CHECK(magnitude(resting.step(4000, 0) - fresh.step(4000, 0)) <= 20);
}

TEST_CASE("Rest empties the integral to its last bit") {
  // 2.5 duty, less 2^-20, are no 3 duty, at which the motor gets any.
  Steering steering =
      plain({{Param::steer_kp, 0}, {Param::steer_ki, 2}, {Param::steer_deadband, 45}});
  steering.step(0, 0);
  for (int i = 0; i < 262; ++i) steering.step(0, -10000);
  steering.step(0, -1439);
  CHECK(steering.step(0, 0) == 0);
  steering.release();
  steering.step(0, 0);
  for (int i = 0; i < 262; ++i) steering.step(0, -10000);
  steering.step(0, -1440);
  CHECK(steering.step(0, 0) == 3);
}

TEST_CASE("Slews are rounded to their last digit") {
  Steering fast = plain();
  fast.step(5000, 0);
  CHECK(fast.setpoint() == 150);
  Steering half = plain({{Param::steer_slew, 1190}});
  half.step(5000, 0);
  CHECK(half.setpoint() == 60);
  Steering less = plain({{Param::steer_slew, 1189}});
  less.step(5000, 0);
  CHECK(less.setpoint() == 59);
  Steering strong = plain({{Param::steer_kp, 10000}});
  CHECK(strong.step(5000, 0) == 128);
}

TEST_CASE("The slowest growth of the duty is one a tick, from one on") {
  Steering steering = plain({{Param::steer_duty_slew, 200}, {Param::steer_kp, 1000}});
  for (int16_t duty = 1; duty < 20; ++duty) CHECK(steering.step(5000, 0) == duty);
}

TEST_CASE("Just left of the centre the left slope holds") {
  const Pot pot = pot_with({{Param::pot_left, 5920}, {Param::angle_left, 8000}});
  REQUIRE(pot.calibrated());
  CHECK(pot.angle(512 * 16 + 1) == 6);
  CHECK(pot.angle(512 * 16) == 0);
  CHECK(pot.angle(512 * 16 - 1) == -1);
}
