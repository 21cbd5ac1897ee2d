#include <doctest.h>

#include <algorithm>
#include <cstdlib>

#include "drive.h"
#include "params_with.h"

using namespace daranti;
using protocol::Param;

namespace {

// Of a machine whose speed follows at once; what drive_lag does has cases of its own.
Drive drive_with(std::initializer_list<Set> sets) {
  Drive drive;
  drive.configure(with(sets, with({{Param::drive_lag, 0}})));
  return drive;
}

Pulses at(int wheel) { return {static_cast<uint16_t>(wheel), 0, 0}; }

Hall hall_with(int16_t tenths_per_metre) {
  Hall hall;
  hall.configure(with({{Param::hall_per_metre, tenths_per_metre}}));
  return hall;
}

int16_t settle(Drive &drive, int16_t target, int16_t measured = Hall::kNone,
               int16_t battery = 12000, int ticks = 1000) {
  int16_t duty = 0;
  for (int i = 0; i < ticks; ++i) duty = drive.step(target, measured, battery, false);
  return duty;
}

int16_t allowed_after_a_tick(Drive &drive) {
  drive.update_allowed();
  return drive.allowed();
}

}  // namespace

TEST_CASE("Half of the full speed at nominal battery is half of the duty") {
  Drive drive = drive_with({});
  CHECK(settle(drive, 500) == 128);
  CHECK(settle(drive, 1000) == 255);
  CHECK(settle(drive, -500) == -128);
  CHECK(settle(drive, -1000) == -255);
  CHECK(settle(drive, 0) == 0);
}

TEST_CASE("What a machine may go at rises at once, and falls as its lag lets it") {
  for (const int16_t target : {500, -500}) {
    Drive drive = drive_with({{Param::drive_accel, 5000}, {Param::drive_lag, 370}});
    settle(drive, target);
    CHECK(allowed_after_a_tick(drive) == 500);
    int16_t allowed = 500;
    // 0.1 s of ramp, and one lag: between e^-1.27 and e^-1 of it.
    for (int ticks = 0; ticks < 20 + 74; ++ticks) {
      drive.step(0, Hall::kNone, 12000, false);
      const int16_t now = allowed_after_a_tick(drive);
      CHECK(now <= allowed);
      allowed = now;
    }
    CHECK(drive.setpoint() == 0);
    CHECK(allowed > 140);
    CHECK(allowed < 184);
    drive.release();
    for (int ticks = 0; ticks < 740; ++ticks) allowed = allowed_after_a_tick(drive);
    CHECK(allowed <= 1);
    settle(drive, target);
    CHECK(allowed_after_a_tick(drive) == 500);
  }
  Drive quick = drive_with({});
  settle(quick, 500);
  CHECK(allowed_after_a_tick(quick) == 500);
  quick.release();
  CHECK(allowed_after_a_tick(quick) == 0);
}

TEST_CASE("A weak battery is compensated, a strong one too, and the duty stays within its bounds") {
  Drive drive = drive_with({});
  CHECK(settle(drive, 500, Hall::kNone, 10000) == 153);
  CHECK(settle(drive, 500, Hall::kNone, 15000) == 102);
  CHECK(settle(drive, 1000, Hall::kNone, 10000) == 255);
  CHECK(settle(drive, -1000, Hall::kNone, 10000) == -255);
  CHECK(settle(drive, 1000, Hall::kNone, 0) == 255);
  Drive bare = drive_with({{Param::battery_nominal, 0}});
  CHECK(settle(bare, 500, Hall::kNone, 10000) == 128);
}

TEST_CASE("A battery below battery_low is compensated as one that is just there") {
  Drive drive = drive_with({{Param::battery_low, 8000}});
  CHECK(settle(drive, 500, Hall::kNone, 8001) == 191);
  CHECK(settle(drive, 500, Hall::kNone, 8000) == 192);
  CHECK(settle(drive, 500, Hall::kNone, 7000) == 192);
  CHECK(settle(drive, -500, Hall::kNone, 0) == -192);
  CHECK(!drive.slows(100, 261, 7000));
  CHECK(drive.slows(100, 270, 7000));
}

TEST_CASE("The minimum duty is added in the direction of travel") {
  Drive drive = drive_with({{Param::drive_min_duty, 55}});
  CHECK(settle(drive, 500) == 155);
  CHECK(settle(drive, -500) == -155);
  CHECK(settle(drive, 0) == 0);
}

TEST_CASE("Soft start: the setpoint changes by 1 m/s each second, up and down") {
  Drive drive = drive_with({});
  for (int i = 0; i < 100; ++i) drive.step(1000, Hall::kNone, 12000, false);
  CHECK(drive.setpoint() == 500);
  for (int i = 0; i < 50; ++i) drive.step(-1000, Hall::kNone, 12000, false);
  CHECK(drive.setpoint() == 250);
  for (int i = 0; i < 100; ++i) drive.step(-1000, Hall::kNone, 12000, false);
  CHECK(drive.setpoint() == -250);
  Drive slow = drive_with({{Param::drive_accel, 100}});
  for (int i = 0; i < 200; ++i) slow.step(1000, Hall::kNone, 12000, false);
  CHECK(slow.setpoint() == 100);
}

TEST_CASE("The setpoint keeps to the largest speed on either side") {
  Drive drive = drive_with({{Param::speed_max, 700}});
  settle(drive, 32767);
  CHECK(drive.setpoint() == 700);
  settle(drive, -32768);
  CHECK(drive.setpoint() == -700);
}

TEST_CASE("Motors slow the machine where they turn faster than their duty, the same way") {
  // 1 m/s is full duty at 12 V.
  Drive drive = drive_with({});
  CHECK(drive.slows(100, 400, 12000));
  CHECK(!drive.slows(100, 390, 12000));
  CHECK(drive.slows(-100, -400, 12000));
  CHECK(!drive.slows(-100, -390, 12000));
  CHECK(!drive.slows(100, -400, 12000));
  CHECK(!drive.slows(-100, 400, 12000));
  CHECK(!drive.slows(1, Hall::kNone, 12000));
  CHECK(!drive.slows(-1, Hall::kNone, 12000));
  CHECK(drive.slows(255, 32767, 12000));
  // The same duty of a fuller battery turns them faster.
  CHECK(!drive.slows(100, 400, 12500));
  CHECK(drive.slows(100, 390, 11500));
  Drive plain = drive_with({{Param::battery_nominal, 0}});
  CHECK(plain.slows(100, 400, 5000));
  CHECK(!plain.slows(100, 390, 5000));
  // Just as fast as the duty is not faster; nothing is driven, nothing is slowed.
  CHECK(!drive.slows(102, 400, 12000));
  CHECK(!plain.slows(102, 400, 5000));
  CHECK(drive.slows(1, 400, 12000));
  CHECK(!drive.slows(0, 400, 12000));
  Drive widest = drive_with({{Param::speed_full, 100}, {Param::battery_nominal, 30000}});
  CHECK(widest.slows(1, 1, 30000));
  CHECK(widest.slows(255, 32767, 30000));
}

TEST_CASE("Released, it starts again from standstill") {
  Drive drive = drive_with({});
  settle(drive, 1000);
  drive.release();
  CHECK(drive.setpoint() == 0);
  CHECK(drive.step(1000, Hall::kNone, 12000, false) == 1);
}

TEST_CASE("The speed loop adds duty while the machine is too slow, and never reverses") {
  Drive drive = drive_with({{Param::drive_ki, 0}});
  CHECK(settle(drive, 500, 500) == 128);
  // 0.1 m/s short at 80 duty s/m.
  CHECK(settle(drive, 500, 400) == 136);
  CHECK(settle(drive, 500, 600) == 120);
  CHECK(settle(drive, -500, -400) == -136);
  CHECK(settle(drive, 100, 32767) == 0);
  CHECK(settle(drive, -100, -32767) == 0);
  CHECK(settle(drive, 1000, 0) == 255);
  CHECK(settle(drive, -1000, 0) == -255);
}

TEST_CASE("The speed loop's integral: 0.1 m/s short for a second at 200 duty/m gives 20") {
  Drive drive = drive_with({{Param::drive_kp, 0}});
  settle(drive, 500);
  CHECK(settle(drive, 500, 400, 12000, 201) == 148);
  CHECK(settle(drive, 500, 600, 12000, 400) == 108);
}

TEST_CASE("The speed loop does not wind up at the limit") {
  for (const int16_t sign : {1, -1}) {
    Drive drive = drive_with({{Param::drive_kp, 0}});
    settle(drive, static_cast<int16_t>(sign * 900));
    settle(drive, static_cast<int16_t>(sign * 900), 0, 12000, 20000);
    // 0.3 m/s too fast at 200 duty/m sheds 60 duty in a second.
    const int16_t before = settle(drive, static_cast<int16_t>(sign * 900),
                                  static_cast<int16_t>(sign * 1200), 12000, 1);
    const int16_t after = settle(drive, static_cast<int16_t>(sign * 900),
                                 static_cast<int16_t>(sign * 1200), 12000, 200);
    CHECK(sign * (before - after) >= 55);
  }
}

TEST_CASE("At the limit even the smallest error winds nothing up") {
  for (const int16_t sign : {1, -1}) {
    const auto speed = [sign](int mmps) { return static_cast<int16_t>(sign * mmps); };
    Drive drive = drive_with({{Param::drive_kp, 1000}, {Param::drive_ki, 2000}});
    settle(drive, speed(1000));
    settle(drive, speed(1000), speed(999), 12000, 20000);
    Drive fresh = drive_with({{Param::drive_kp, 1000}, {Param::drive_ki, 2000}});
    settle(fresh, speed(1000));
    CHECK(drive.step(speed(1000), speed(1200), 12000, false) ==
          fresh.step(speed(1000), speed(1200), 12000, false));
  }
}

TEST_CASE("The integral holds at most the full duty") {
  for (const int16_t sign : {1, -1}) {
    const auto speed = [sign](int mmps) { return static_cast<int16_t>(sign * mmps); };
    Drive drive =
        drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 2000}, {Param::speed_full, 10000}});
    CHECK(settle(drive, speed(1), speed(-20000), 12000, 60) == sign * 255);
    // 10 m/s too fast at 200 duty/m: 10.0 duty a tick.
    drive.step(speed(1), speed(20000), 12000, false);
    CHECK(drive.step(speed(1), speed(20000), 12000, false) == sign * 245);
  }
}

TEST_CASE("A speed error beyond 10 m/s counts as 10 m/s") {
  // 5 raw is 0.5 duty/m or, rounded to 2^-20, 0.0286 duty a tick at 10 m/s: 10.49 after 367 ticks.
  Drive drive =
      drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 5}, {Param::speed_full, 10000}});
  CHECK(settle(drive, 1, -20000, 12000, 368) == 10);
}

TEST_CASE("Gains and ramps are rounded to their last digit") {
  Drive loop =
      drive_with({{Param::drive_kp, 999}, {Param::drive_ki, 0}, {Param::speed_full, 10000}});
  CHECK(settle(loop, 1, -865) == 87);
  Drive slow =
      drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 350}, {Param::speed_full, 10000}});
  // 183.5 rounds to 184 in 2^-20 duty per mm/s and tick.
  CHECK(settle(slow, 1, -9999, 12000, 58) == 100);
  // 399.52 and 398.48 of 1/16 mm/s a tick.
  for (const auto &each : {Set{Param::drive_accel, 4994}, Set{Param::drive_accel, 4981}}) {
    Drive ramp = drive_with({each, {Param::speed_max, 3000}});
    for (int i = 0; i < 16; ++i) ramp.step(3000, Hall::kNone, 12000, false);
    CHECK(ramp.setpoint() == (each.value == 4994 ? 400 : 398));
  }
  Drive sum = drive_with({{Param::drive_kp, 125}, {Param::drive_ki, 0}, {Param::speed_full, 1275}});
  CHECK(settle(sum, 1000) == 200);
  CHECK(settle(sum, 1000, 800) == 202);
}

TEST_CASE("At no duty, too much speed winds the integral down by one tick only") {
  for (const int16_t sign : {1, -1}) {
    const auto speed = [sign](int mmps) { return static_cast<int16_t>(sign * mmps); };
    Drive drive =
        drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 2000}, {Param::speed_full, 10000}});
    settle(drive, speed(1), speed(20000), 12000, 50);
    CHECK(drive.step(speed(1), speed(-20000), 12000, false) == 0);
    CHECK(drive.step(speed(1), speed(-20000), 12000, false) == 0);
    CHECK(drive.step(speed(1), speed(-20000), 12000, false) == sign * 10);
  }
}

TEST_CASE("In reverse too the integral stands still as soon as the sum is forward") {
  Drive drive =
      drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 1}, {Param::speed_full, 10000}});
  drive.step(-1, -1 - 16, 12000, false);
  drive.step(-1, -20000, 12000, false);
  // 2^-16 of a duty is what the first step left; half a duty and a bit turn it into one.
  for (int i = 0; i < 52; ++i) drive.step(-1, -1 + 10000, 12000, false);
  drive.step(-1, -1 + 4305, 12000, false);
  CHECK(drive.step(-1, -1, 12000, false) == -1);
}

TEST_CASE("The duty may be nothing while a speed is asked, and never more than full") {
  Drive crawl = drive_with({{Param::speed_full, 10000}});
  CHECK(settle(crawl, 1) == 0);
  CHECK(settle(crawl, -1) == 0);
  Drive bare = drive_with({{Param::battery_nominal, 0}, {Param::speed_full, 500}});
  CHECK(settle(bare, 1000) == 255);
  Drive weak = drive_with({});
  CHECK(settle(weak, 825, Hall::kNone, 10000) == 252);
}

TEST_CASE("A release empties ramp and integral") {
  for (const int16_t sign : {1, -1}) {
    const auto speed = [sign](int mmps) { return static_cast<int16_t>(sign * mmps); };
    Drive drive = drive_with({{Param::drive_kp, 0}, {Param::drive_accel, 5000}});
    settle(drive, speed(500), speed(300), 12000, 400);
    drive.release();
    Drive fresh = drive_with({{Param::drive_kp, 0}, {Param::drive_accel, 5000}});
    CHECK(drive.step(speed(500), speed(25), 12000, false) ==
          fresh.step(speed(500), speed(25), 12000, false));
  }
  // Half a duty, less the last bit, is none.
  const auto last_bit = [](Drive drive) {
    for (int i = 0; i < 52; ++i) drive.step(1, 1 - 10000, 12000, false);
    drive.step(1, 1 - 4287, 12000, false);
    return drive.step(1, 1, 12000, false);
  };
  Drive fine = drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 1}, {Param::speed_full, 10000}});
  CHECK(last_bit(fine) == 0);
  fine.release();
  CHECK(last_bit(fine) == 0);
  fine.step(0, 0, 12000, false);
  CHECK(last_bit(fine) == 0);
  // 15/16 mm/s a tick.
  Drive slow = drive_with({{Param::drive_accel, 188}});
  slow.release();
  slow.step(1000, Hall::kNone, 12000, false);
  CHECK(slow.setpoint() == 0);
}

namespace {

// How far the loop's duty is at most from the feed-forward's, while a machine that follows with
// `lag_ms` goes from one speed to the next, by a board that was told `told_ms`.
int unrest(int16_t told_ms, int lag_ms, int sign) {
  Drive drive = drive_with({{Param::drive_kp, 0}, {Param::drive_lag, told_ms}});
  Drive plain = drive_with({});
  double speed = 0.0;
  int worst = 0;
  for (const int target : {800, 150, 500}) {
    for (int i = 0; i < 1000; ++i) {
      const auto asked = static_cast<int16_t>(sign * target);
      const int duty = drive.step(asked, static_cast<int16_t>(speed), 12000, false);
      const int forward = plain.step(asked, Hall::kNone, 12000, false);
      worst = std::max(worst, std::abs(duty - forward));
      speed += (drive.setpoint() - speed) * kTickMs / (lag_ms + kTickMs);
    }
  }
  return worst;
}

}  // namespace

TEST_CASE(
    "A machine that follows with its lag makes no error while it slows, and winds nothing up") {
  for (const int16_t lag : {100, 250, 1000}) {
    for (const int sign : {1, -1}) {
      CHECK(unrest(lag, lag, sign) <= 2);
      CHECK(unrest(0, lag, sign) > 8);
    }
  }
}

TEST_CASE("What the machine lacks beside its lag is made up as without one") {
  Drive drive = drive_with({{Param::drive_kp, 0}, {Param::drive_lag, 250}});
  settle(drive, 500);
  CHECK(settle(drive, 500, 400, 12000, 201) == 148);
}

TEST_CASE("What the integral is spared is the speed times the lag") {
  // At 5 duty/m, of a machine that has just begun to move and stays there, asked for 1 m/s.
  const auto after = [](int16_t lag_ms) {
    Drive drive = drive_with({{Param::drive_kp, 0},
                              {Param::drive_ki, 50},
                              {Param::drive_lag, lag_ms},
                              {Param::speed_full, 10000}});
    return settle(drive, 1000, 1, 12000, 20000 / kTickMs);
  };
  CHECK(after(0) - after(400) == 2);
  CHECK(after(0) - after(2000) == 10);
}

TEST_CASE("A machine that stands lacks all that is asked, whatever its lag") {
  const auto after = [](int16_t lag_ms) {
    Drive drive = drive_with({{Param::drive_kp, 0}, {Param::drive_lag, lag_ms}});
    return settle(drive, 150, 0, 12000, 1000 / kTickMs);
  };
  CHECK(after(2000) == after(0));
}

TEST_CASE("From standing and from a release what is expected begins at nothing") {
  const auto begun = [] {
    return drive_with({{Param::drive_kp, 0},
                       {Param::drive_lag, 2000},
                       {Param::drive_accel, 5000},
                       {Param::speed_full, 10000}});
  };
  // Of a machine that has just begun to move: what it should have come to winds the integral up.
  const auto wound = [](Drive &drive) { return settle(drive, 1000, 1, 12000, 100); };
  Drive fresh = begun();
  const int16_t first = wound(fresh);
  Drive drive = begun();
  settle(drive, 1000, 1000);
  drive.release();
  CHECK(wound(drive) == first);
  drive.release();
  settle(drive, 1000, 1000);
  settle(drive, 0, 0);
  CHECK(wound(drive) == first);
}

TEST_CASE("Standstill empties the speed loop") {
  Drive drive = drive_with({{Param::drive_kp, 0}});
  settle(drive, 500, 300);
  CHECK(settle(drive, 500, 500) > 140);
  settle(drive, 0);
  settle(drive, 500);
  CHECK(settle(drive, 500, 500, 12000, 1) == 128);
}

TEST_CASE("Without a sensor there is neither speed nor distance") {
  Hall hall = hall_with(0);
  hall.step(at(5), 100, 0);
  hall.step(at(50), 100, 0);
  CHECK(hall.speed() == Hall::kNone);
  CHECK(hall.distance() == 0);
  for (int i = 0; i < 2000; ++i) hall.step(at(50), 100, 3000);
  CHECK(!hall.lost());
}

TEST_CASE("One pulse every 0.1 s at 20 pulses a metre is 0.5 m/s") {
  for (const int16_t sign : {1, -1}) {
    Hall hall = hall_with(200);
    uint16_t pulses = 65530;  // the counter wraps on the way
    hall.step(at(pulses), static_cast<int16_t>(sign * 100), 0);
    const int32_t start = hall.distance();
    for (int i = 1; i <= 400; ++i) {
      if (i % 20 == 0) ++pulses;
      hall.step(at(pulses), static_cast<int16_t>(sign * 100), 0);
      if (i > 60) CHECK(hall.speed() == sign * 500);
    }
    CHECK(hall.distance() - start == sign * 1000);
  }
}

TEST_CASE("Several pulses in a tick are several times the speed") {
  Hall hall = hall_with(200);
  uint16_t pulses = 0;
  for (int i = 0; i < 10; ++i) {
    pulses = static_cast<uint16_t>(pulses + 2);
    hall.step(at(pulses), 100, 0);
  }
  CHECK(hall.speed() == 20000);
  for (int i = 0; i < 10; ++i) {
    pulses = static_cast<uint16_t>(pulses + 60000);
    hall.step(at(pulses), 100, 0);
  }
  CHECK(hall.speed() == INT16_MAX);
}

TEST_CASE("Fractions of a millimetre add up") {
  Hall hall = hall_with(30);  // 333.33 mm a pulse
  for (uint16_t pulse = 1; pulse <= 300; ++pulse) hall.step(at(pulse), 100, 0);
  CHECK(hall.distance() == 100000);
}

TEST_CASE("Without pulses the speed falls with the time since the last, and is zero after 1 s") {
  Hall hall = hall_with(200);
  uint16_t pulses = 0;
  for (int i = 1; i <= 100; ++i) {
    if (i % 10 == 0) ++pulses;
    hall.step(at(pulses), 100, 0);
  }
  CHECK(hall.speed() == 1000);
  for (int i = 0; i < 10; ++i) hall.step(at(pulses), 100, 0);
  CHECK(hall.speed() == 1000);
  for (int i = 0; i < 10; ++i) hall.step(at(pulses), 100, 0);
  CHECK(hall.speed() == 500);
  for (int i = 0; i < 179; ++i) hall.step(at(pulses), 100, 0);
  CHECK(hall.speed() == 50);
  hall.step(at(pulses), 100, 0);
  CHECK(hall.speed() == 0);
}

TEST_CASE("The first pulse after standing tells no speed") {
  Hall hall = hall_with(200);
  for (int i = 0; i < 300; ++i) hall.step(at(0), 100, 0);
  hall.step(at(1), 100, 0);
  CHECK(hall.speed() == 0);
  for (int i = 0; i < 19; ++i) hall.step(at(1), 100, 0);
  hall.step(at(2), 100, 0);
  CHECK(hall.speed() == 500);
}

TEST_CASE("Coasting keeps the direction of the last duty") {
  Hall hall = hall_with(200);
  uint16_t pulses = 0;
  for (int i = 1; i <= 100; ++i)
    hall.step(at(static_cast<uint16_t>(i % 10 == 0 ? ++pulses : pulses)), -100, 0);
  for (int i = 1; i <= 10; ++i)
    hall.step(at(static_cast<uint16_t>(i % 10 == 0 ? ++pulses : pulses)), 0, 0);
  CHECK(hall.speed() == -1000);
}

TEST_CASE("The sensor counts as lost after 0.25 m without a pulse") {
  // 0.5 m/s is 2.5 mm a tick.
  for (const int16_t setpoint : {500, -500}) {
    Hall hall = hall_with(200);
    for (int i = 0; i < 99; ++i) hall.step(at(0), 100, setpoint);
    CHECK(!hall.lost());
    hall.step(at(0), 100, setpoint);
    CHECK(hall.lost());
    hall.step(at(1), 100, setpoint);
    CHECK(!hall.lost());
    for (int i = 0; i < 99; ++i) hall.step(at(1), 100, setpoint);
    CHECK(!hall.lost());
    hall.step(at(1), 0, setpoint);
    hall.step(at(1), 100, setpoint);
    CHECK(!hall.lost());
  }
}

// Driven at 150 mm/s, duty 50, until it has given `count` pulses, one each `ticks` ticks.
uint16_t driven(Hall &hall, uint16_t pulses, int count, int32_t ticks) {
  for (; count > 0; --count) {
    for (int32_t i = 1; i < ticks; ++i) hall.step(at(pulses), 50, 150);
    hall.step(at(++pulses), 50, 150);
  }
  return pulses;
}

TEST_CASE("A creeping machine's sensor counts as lost after 0.9 s") {
  Hall hall = hall_with(200);
  uint16_t pulses = driven(hall, 0, 3, 60);
  for (int i = 0; i < 179; ++i) hall.step(at(pulses), 50, 150);
  CHECK(!hall.lost());
  hall.step(at(pulses), 50, 150);
  CHECK(hall.lost());
  pulses = driven(hall, pulses, 1, 1);
  CHECK(!hall.lost());
  for (int i = 0; i < 179; ++i) hall.step(at(pulses), 50, 150);
  CHECK(!hall.lost());
  hall.step(at(pulses), 50, 150);
  CHECK(hall.lost());
}

TEST_CASE("To break away a machine may take until it should have come 0.25 m") {
  Hall hall = hall_with(200);
  for (int i = 0; i < 333; ++i) hall.step(at(0), 50, 150);
  CHECK(!hall.lost());
  hall.step(at(0), 50, 150);
  CHECK(hall.lost());
  hall.step(at(1), 50, 150);
  hall.step(at(2), 0, 150);  // rolls on without duty, and stands: again it must break away
  for (int i = 0; i < 333; ++i) hall.step(at(2), 50, 150);
  CHECK(!hall.lost());
  hall.step(at(2), 50, 150);
  CHECK(hall.lost());
}

TEST_CASE("A machine that rolls back as it is driven must break away too") {
  struct Case {
    int32_t before, first, second;
  };
  // It creeps back braked, by a bump or a slope faster and faster; then more and more slowly.
  for (const Case &each : {Case{50, 40, 100}, Case{145, 95, 100}, Case{150, 199, 200}}) {
    Hall hall = hall_with(200);
    uint16_t pulses = 1;
    hall.step(at(pulses), -100, -150);
    for (int32_t i = 1; i < each.before; ++i) hall.step(at(pulses), 0, 0);
    hall.step(at(++pulses), 0, 0);
    pulses = driven(hall, pulses, 1, each.first);
    pulses = driven(hall, pulses, 1, each.second);
    for (int i = 0; i < 333; ++i) hall.step(at(pulses), 50, 150);
    CHECK(!hall.lost());
    hall.step(at(pulses), 50, 150);
    CHECK(hall.lost());
  }
}

TEST_CASE("A machine has broken away that becomes faster, or has come 0.15 m as it is driven") {
  const auto away = [](int32_t first, int32_t second, int32_t third) {
    Hall hall = hall_with(400);
    uint16_t pulses = driven(hall, 0, 1, first);
    pulses = driven(hall, pulses, 1, second);
    pulses = driven(hall, pulses, 1, third);
    for (int i = 0; i < 180; ++i) hall.step(at(pulses), 50, 150);
    return hall.lost();
  };
  CHECK(away(30, 50, 39));
  CHECK(!away(30, 50, 40));
  // The first interval began before it was driven, or as it stood.
  CHECK(!away(50, 39, 39));
  Hall hall = hall_with(400);
  uint16_t pulses = driven(hall, 0, 5, 100);
  for (int i = 0; i < 180; ++i) hall.step(at(pulses), 50, 150);
  CHECK(!hall.lost());
  pulses = driven(hall, pulses, 1, 1);
  for (int i = 0; i < 179; ++i) hall.step(at(pulses), 50, 150);
  CHECK(!hall.lost());
  hall.step(at(pulses), 50, 150);
  CHECK(hall.lost());
}

TEST_CASE("Two pulses since it is driven are one interval, and tell nothing") {
  Hall hall = hall_with(200);
  int wheel = 0;
  const auto pulse_after = [&](int ticks, int16_t duty) {
    for (int i = 1; i < ticks; ++i) hall.step(at(wheel), duty, 300);
    hall.step(at(++wheel), duty, 300);
  };
  pulse_after(60, 0);  // it creeps
  pulse_after(40, 100);
  pulse_after(20, 100);
  CHECK(!hall.directed());
  pulse_after(10, 100);
  CHECK(hall.directed());
}

TEST_CASE("Driven as far as a machine on level ground comes half a metre, its sensor is lost") {
  struct Case {
    int16_t floor, full, duty;
    int ticks;
  };
  // Half a metre at 1 m/s for 255 above the minimum is 25500 of them.
  for (const Case &each : {Case{0, 1000, 100, 255}, Case{0, 1000, -100, 255},
                           Case{55, 1000, 155, 200}, Case{0, 2000, 209, 62}}) {
    Hall hall;
    hall.configure(with({{Param::hall_per_metre, 4000},
                         {Param::drive_min_duty, each.floor},
                         {Param::speed_full, each.full}}));
    for (int start = 0; start < 2; ++start) {
      hall.step(at(start), 0, 100);
      // A duty below the minimum moves nothing.
      for (int i = 0; i < 20; ++i) hall.step(at(start), static_cast<int16_t>(each.floor / 2), 100);
      for (int i = 0; i < each.ticks - 1; ++i) hall.step(at(start), each.duty, 100);
      CHECK(!hall.lost());
      hall.step(at(start), each.duty, 100);
      CHECK(hall.lost());
    }
  }
}

TEST_CASE("Even the least duty above the minimum counts for the way") {
  Hall hall;
  hall.configure(with({{Param::hall_per_metre, 4000}, {Param::speed_full, 2000}}));
  hall.step(at(0), 1, 100);
  for (int i = 0; i < 60; ++i) hall.step(at(0), 209, 100);
  CHECK(!hall.lost());
  hall.step(at(0), 209, 100);
  CHECK(hall.lost());
}

TEST_CASE("A machine is stuck that gives no two pulses in time as it is driven from a stand") {
  CHECK(!hall_with(0).stuck());
  for (const int16_t sign : {1, -1}) {
    Hall hall = hall_with(200);  // 50 mm a pulse
    const auto driven = [&hall, sign](uint16_t pulse) {
      hall.step(at(pulse), static_cast<int16_t>(sign * 50), static_cast<int16_t>(sign * 500));
    };
    for (int i = 0; i < 39; ++i) driven(0);
    CHECK(!hall.stuck());
    driven(0);
    CHECK(hall.stuck());
    driven(1);
    CHECK(!hall.stuck());
    for (int i = 0; i < 40; ++i) driven(1);
    CHECK(hall.stuck());
    driven(2);
    driven(3);
    CHECK(!hall.stuck());
    // It has broken away: what comes after is no start.
    for (int i = 0; i < 60; ++i) driven(3);
    CHECK(!hall.stuck());
    hall.step(at(3), 0, 0);
    for (int i = 0; i < 40; ++i) driven(3);
    CHECK(hall.stuck());
  }
  Hall crawls = hall_with(200);
  for (int i = 0; i < 400; ++i) crawls.step(at(0), 50, 99);
  CHECK(!crawls.stuck());
}

TEST_CASE(
    "Stuck, a machine gets 150 duty a second more, as far as speed_excess would have it run") {
  for (const int16_t sign : {1, -1}) {
    // 0.353 m/s more is 90.0 duty more, which 120 ticks add.
    Drive drive =
        drive_with({{Param::drive_kp, 0}, {Param::drive_ki, 0}, {Param::speed_excess, 353}});
    const int16_t target = static_cast<int16_t>(sign * 200);
    CHECK(settle(drive, target, 0) == sign * 51);
    const auto stuck = [&drive, target](int ticks, int16_t measured = 0) {
      int16_t duty = 0;
      for (int i = 0; i < ticks; ++i) duty = drive.step(target, measured, 12000, true);
      return duty;
    };
    CHECK(stuck(41) == sign * 81);  // what is added shows in the next tick
    CHECK(stuck(1000) == sign * 141);
    CHECK(drive.step(target, Hall::kNone, 12000, true) == sign * 51);
  }
  Drive lame = drive_with({{Param::drive_kp, 0},
                           {Param::drive_ki, 0},
                           {Param::speed_excess, 100},
                           {Param::speed_full, 500}});
  settle(lame, 200, 0);
  for (int i = 0; i < 1000; ++i) lame.step(200, 0, 12000, true);
  CHECK(lame.step(200, 0, 12000, true) == 152);
}

TEST_CASE(
    "Pulses are awaited for 0.1 m/s where a creep's duty is of speed_excess more, else for what is "
    "asked") {
  for (const int16_t sign : {1, -1}) {
    const auto asked = [sign](int mmps) { return static_cast<int16_t>(sign * mmps); };
    // 200 mm/s at full duty are 0.784 mm/s a duty; 0.1 m/s more are 127 duty more.
    Drive drive = drive_with({{Param::drive_kp, 0},
                              {Param::drive_ki, 2000},
                              {Param::speed_full, 200},
                              {Param::speed_excess, 100}});
    settle(drive, asked(50), asked(50));
    CHECK(drive.awaited() == asked(50));
    int16_t duty = 0;
    for (int i = 0; i < 4000 && magnitude(duty) < 64 + 127; ++i) {
      CHECK(drive.awaited() == asked(50));
      duty = drive.step(asked(50), 0, 12000, false);
    }
    CHECK(duty == asked(64 + 127));
    CHECK(drive.awaited() == asked(100));
    // What is judged anyway is awaited as it is asked.
    settle(drive, asked(100), 0);
    CHECK(drive.awaited() == asked(100));
    settle(drive, asked(101), 0);
    CHECK(drive.awaited() == asked(101));
    settle(drive, asked(99), 0);
    CHECK(drive.awaited() == asked(100));
    drive.release();
    CHECK(drive.awaited() == 0);
    // What is asked after a release is a creep again, though all before was driven hard.
    drive.step(asked(50), 0, 12000, false);
    CHECK(magnitude(drive.awaited()) < 50);
  }
  // Without a sensor nothing is awaited.
  Drive blind = drive_with({{Param::speed_full, 200}, {Param::speed_excess, 100}});
  settle(blind, 99, 0, 12000, 4000);
  CHECK(blind.awaited() == 100);
  settle(blind, 99, Hall::kNone);
  CHECK(blind.awaited() == 99);
  // Where a stand is asked, too.
  settle(blind, 99, 0, 12000, 4000);
  settle(blind, 0, 0);
  CHECK(blind.awaited() == 0);
}

TEST_CASE("A sensor of few pulses is given two of them") {
  Hall hall = hall_with(50);  // 200 mm a pulse
  for (int i = 0; i < 159; ++i) hall.step(at(0), 100, 500);
  CHECK(!hall.lost());
  hall.step(at(0), 100, 500);
  CHECK(hall.lost());
  hall.step(at(1), 40, 150);
  for (int i = 0; i < 533; ++i) hall.step(at(1), 40, 150);
  CHECK(!hall.lost());
  hall.step(at(1), 40, 150);
  CHECK(hall.lost());
}

TEST_CASE("A sensor of one pulse in 10 m is given 20 m to the last millimetre") {
  Hall hall = hall_with(1);
  hall.step(at(1), 100, 2001);
  for (int i = 0; i < 1999; ++i) hall.step(at(1), 100, 2001);  // 10.005 mm a tick, 5 um short
  CHECK(!hall.lost());
  hall.step(at(1), 100, 2001);
  CHECK(hall.lost());
}

TEST_CASE("What the machine crawls does not count against the sensor") {
  Hall hall = hall_with(200);
  for (int i = 0; i < 2000; ++i) hall.step(at(0), 255, 99);
  CHECK(!hall.lost());
  for (int i = 0; i < 499; ++i) hall.step(at(0), 50, -100);
  CHECK(!hall.lost());
  hall.step(at(0), 50, 100);
  CHECK(hall.lost());
}

TEST_CASE("The time of silence does not overflow") {
  Hall hall = hall_with(200);
  for (int32_t i = 0; i < 70000; ++i) hall.step(at(0), 100, 0);
  hall.step(at(1), 100, 0);
  CHECK(hall.speed() == 0);
}

TEST_CASE("A pulse just 1 s after the one before still tells a speed") {
  Hall hall = hall_with(200);
  hall.step(at(1), 100, 0);
  for (int i = 0; i < 199; ++i) hall.step(at(1), 100, 0);
  hall.step(at(2), 100, 0);
  CHECK(hall.speed() == 50);
}

TEST_CASE("The distance wraps as the link's 32 bits do") {
  // Noise alone, with a pulse of 10 m: 600 km a tick.
  Hall hall = hall_with(1);
  for (int i = 1; i <= 4; ++i) hall.step(at(60000 * i), 100, 0);
  CHECK(hall.distance() == 4 * 600'000'000LL - (1LL << 32));
}

TEST_CASE("At most 1000 pulses count in a tick") {
  Hall hall = hall_with(4000);
  hall.step(at(1), 100, 0);
  for (int i = 0; i < 199; ++i) hall.step(at(1), 100, 0);
  hall.step(at(2001), 100, 0);
  CHECK(hall.speed() == 2500);  // 500 mm/s * 1000 / 200
}

TEST_CASE("A sensor that is configured again knows no speed yet") {
  Hall hall = hall_with(200);
  for (uint16_t pulse = 1; pulse < 10; ++pulse) hall.step(at(pulse), 100, 0);
  hall.configure(with({}));
  hall.configure(with({{Param::hall_per_metre, 200}}));
  hall.step(at(9), 100, 0);
  CHECK(hall.speed() == 0);
}

TEST_CASE("Half a metre in reverse after a metre forward leaves half a metre") {
  Hall hall = hall_with(200);
  uint16_t pulses = 0;
  for (int i = 0; i < 20; ++i) hall.step(at(++pulses), 100, 0);
  CHECK(hall.distance() == 1000);
  for (int i = 0; i < 10; ++i) hall.step(at(++pulses), -1, 0);
  CHECK(hall.distance() == 500);
  hall.step(at(++pulses), 1, 0);
  CHECK(hall.distance() == 550);
}

TEST_CASE("Taking the sensor's parameter away takes the speed away") {
  Hall hall = hall_with(200);
  for (uint16_t pulse = 1; pulse < 10; ++pulse) hall.step(at(pulse), 100, 0);
  CHECK(hall.speed() != Hall::kNone);
  CHECK(hall.noisy());
  hall.configure(with({}));
  CHECK(hall.speed() == Hall::kNone);
  CHECK(!hall.noisy());
}

namespace {

// A wheel with two sensors.
struct TwoHalls {
  Hall hall;
  Pulses pulses{0, 0, 0};
  explicit TwoHalls(int16_t tenths_per_metre) {
    hall.configure(with({{Param::hall_per_metre, tenths_per_metre}, {Param::hall_phases, 2}}));
  }
  void step(int16_t setpoint, int forward, int backward) {
    pulses.wheel = static_cast<uint16_t>(pulses.wheel + forward + backward);
    pulses.way = static_cast<uint16_t>(pulses.way + forward - backward);
    hall.step(pulses, setpoint, setpoint);
  }
};

}  // namespace

TEST_CASE("Of a tick's pulses the greater part tells the direction") {
  struct Case {
    int forward, backward;
    bool back;
  };
  for (const Case &each : {Case{1, 1, false}, Case{2, 1, false}, Case{2, 2, false},
                           Case{1, 2, true}, Case{0, 1, true}, Case{1, 0, false}}) {
    TwoHalls two(1000);
    two.step(500, 0, 5);
    const int32_t before = two.hall.distance();
    two.step(500, each.forward, each.backward);
    CHECK((two.hall.distance() < before) == each.back);
  }
}

TEST_CASE("A wheel that rocks on an edge stands, however often") {
  for (const int phase : {0, 1}) {
    // 12.5 mm a pulse: the half of a millimetre must not add up either.
    TwoHalls two(800);
    two.step(0, 1, 0);
    for (int i = 0; i < 250; ++i) two.step(0, 0, 0);
    const int32_t start = two.hall.distance();
    for (int k = 0; k < 400; ++k) {
      two.step(0, k % 2 != phase, k % 2 == phase);
      for (int i = 0; i < 4; ++i) two.step(0, 0, 0);
      CHECK(two.hall.speed() == 0);
      CHECK(magnitude(two.hall.distance() - start) <= 13);
    }
    CHECK(magnitude(two.hall.distance() - start) <= 1);
    CHECK(!two.hall.fast(0));
    CHECK(!two.hall.noisy());
  }
}

TEST_CASE("Turned round, a wheel has a speed again at its second pulse") {
  for (const bool back : {true, false}) {
    TwoHalls two(1000);  // 10 mm a pulse
    for (int k = 0; k < 5; ++k) {
      for (int i = 0; i < 3; ++i) two.step(0, 0, 0);
      two.step(0, back, !back);
    }
    CHECK(two.hall.speed() == (back ? 500 : -500));
    for (int i = 0; i < 3; ++i) two.step(0, 0, 0);
    two.step(0, !back, back);
    CHECK(two.hall.speed() == (back ? 500 : -500));
    for (int i = 0; i < 4; ++i) two.step(0, 0, 0);
    two.step(0, !back, back);
    CHECK(two.hall.speed() == (back ? -400 : 400));
    // Of three pulses back in a tick the first is of the edge that was crossed before.
    two.step(0, 3 * back, 3 * !back);
    CHECK(two.hall.speed() == (back ? 4000 : -4000));
  }
}

TEST_CASE("What goes to and fro on the way is no way, and its speed neither") {
  TwoHalls two(1000);  // 10 mm a pulse
  two.step(0, 1, 0);
  for (int k = 0; k < 20; ++k) {
    // A pulse each eight ticks is 0.25 m/s; between two of them the last edge is crossed twice.
    for (int i = 1; i < 8; ++i) two.step(0, i == 5, i == 2);
    two.step(0, 1, 0);
    CHECK(two.hall.speed() == 250);
  }
  CHECK(two.hall.distance() == 210);
  for (int i = 1; i <= 16; ++i) two.step(0, i % 3 == 2, i % 3 == 1);
  CHECK(two.hall.speed() == 125);
  for (int i = 17; i < 200; ++i) two.step(0, i % 3 == 2, i % 3 == 1);
  CHECK(two.hall.speed() == 10);
  two.step(0, 0, 0);
  CHECK(two.hall.speed() == 0);
}

TEST_CASE("A second sensor whose wire is torn is a lost one: the way comes to nothing") {
  TwoHalls two(1000);
  // Each pulse of the first sensor counts forward and backward.
  two.step(100, 1, 0);
  for (int i = 0; i < 254; ++i) two.step(100, i % 4 == 3, i % 4 == 1);
  CHECK(!two.hall.lost());
  two.step(100, 1, 0);
  CHECK(two.hall.lost());
}

TEST_CASE("Noise on the first of two sensors is noise, though it comes nowhere") {
  TwoHalls two(2000);  // 5 mm a pulse
  for (int i = 0; i < 8; ++i) two.step(100, 2, 2);
  CHECK(two.hall.speed() == 0);
  CHECK(two.hall.noisy());
  two.step(100, 0, 0);
  CHECK(!two.hall.noisy());
}

TEST_CASE("The wrong way is 0.15 m against the direction asked, and at least three pulses") {
  struct Case {
    int16_t per_metre;
    int pulses;
  };
  for (const Case &each : {Case{1000, 15}, Case{200, 3}, Case{100, 3}, Case{201, 4}}) {
    for (const int16_t sign : {1, -1}) {
      TwoHalls two(each.per_metre);
      for (int k = 1; k <= each.pulses; ++k) {
        CHECK(!two.hall.wrong_way());
        two.step(static_cast<int16_t>(300 * sign), sign < 0, sign > 0);
      }
      CHECK(two.hall.wrong_way());
    }
  }
}

TEST_CASE("A stand that is asked, or a pulse the right way, forgives the wrong way") {
  for (const bool stand : {true, false}) {
    TwoHalls two(1000);
    for (int half = 0; half < 2; ++half) {
      for (int k = 0; k < 14; ++k) two.step(300, 0, 1);
      two.step(stand ? 0 : 300, !stand, 0);
    }
    CHECK(!two.hall.wrong_way());
    for (int k = 0; k < 15; ++k) two.step(300, 0, 1);
    for (int k = 0; k < 20; ++k) two.step(300, 0, 0);
    CHECK(two.hall.wrong_way());  // silence forgives nothing
  }
}

TEST_CASE("Without a wheel sensor, or with one, no way is the wrong one") {
  TwoHalls none(0);
  none.step(300, 0, 30);
  CHECK(!none.hall.wrong_way());
  Hall one = hall_with(1000);
  for (int k = 1; k < 40; ++k) {
    one.step({static_cast<uint16_t>(k), static_cast<uint16_t>(k), 0}, 100, 300);
  }
  CHECK(!one.wrong_way());
}

TEST_CASE("Noise is faster than twice the largest speed and 1 m/s, and not just as fast") {
  struct Case {
    int16_t speed_max, per_metre;
    int pulses;
    bool noisy;
  };
  for (const Case &each : {Case{1000, 2000, 3, false}, Case{1500, 2000, 4, false},
                           Case{1500, 2000, 5, true}, Case{1001, 1998, 3, true}}) {
    Hall hall;
    hall.configure(
        with({{Param::hall_per_metre, each.per_metre}, {Param::speed_max, each.speed_max}}));
    for (int k = 1; k <= 3; ++k) hall.step(at(k * each.pulses), 100, 100);
    CHECK(hall.noisy() == each.noisy);
  }
}

TEST_CASE(
    "The first pulse is no noise, and noise ends with the time that a machine's pulse takes") {
  Hall hall;  // 10 mm a pulse, 2 m/s are not too much
  hall.configure(with({{Param::hall_per_metre, 1000}, {Param::speed_max, 500}}));
  hall.step(at(1), 100, 100);
  CHECK(!hall.noisy());
  hall.step(at(2), 100, 100);
  CHECK(!hall.noisy());
  hall.step(at(4), 100, 100);
  CHECK(hall.noisy());
  hall.step(at(4), 100, 100);
  CHECK(!hall.noisy());
  Hall coarse = hall_with(400);  // 25 mm a pulse: one in a tick is 5 m/s, in two 2.5 m/s
  coarse.step(at(1), 100, 100);
  CHECK(!coarse.noisy());
  coarse.step(at(2), 100, 100);
  CHECK(coarse.noisy());
  coarse.step(at(2), 100, 100);
  CHECK(coarse.noisy());
  coarse.step(at(2), 100, 100);
  CHECK(!coarse.noisy());
}

TEST_CASE("Too fast is above what is asked and its margin, and not just at them") {
  Hall hall = hall_with(2000);
  for (int k = 1; k <= 3; ++k) hall.step(at(k), 100, 100);
  REQUIRE(hall.speed() == 1000);
  CHECK(!hall.fast(650));
  CHECK(hall.fast(649));
  CHECK(!hall.fast(-650));
  CHECK(!hall_with(0).fast(0));
}
