#include <doctest.h>

#include <initializer_list>

#include "params_with.h"
#include "supervisor.h"

using namespace daranti;
using protocol::Param;
using protocol::Result;
using protocol::State;

namespace {

Observation calm() {
  Observation seen{};
  seen.pot = 512 * 16;
  seen.battery = 12000;
  seen.estop = 180 * 16;
  return seen;
}

struct Rig {
  Supervisor supervisor;
  Params params;
  Observation seen = calm();
  Rig() : params(with({{Param::steer_min_duty, 70}})) {
    supervisor.boot(protocol::BY_POWER_ON, false);
  }
  void watch(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) supervisor.watch(params, seen);
  }
  // Keeps the link alive meanwhile.
  void live(int ticks = 1) {
    for (int i = 0; i < ticks; ++i) {
      supervisor.command(true);
      watch();
    }
  }
  void run() {
    watch();
    REQUIRE(supervisor.arm(protocol::kVersion, true, true) == Result::OK);
    supervisor.command(true);
    watch();
    REQUIRE(supervisor.state() == State::RUNNING);
  }
  // After how many watches the fault latches, the link kept alive; `most` where it does not.
  int latches_after(uint32_t bit, int most = 2000) {
    for (int i = 1; i <= most; ++i) {
      live();
      if (supervisor.faults() & bit) return i;
    }
    return most;
  }
};

}  // namespace

TEST_CASE("It boots SAFE, and FAULT where the reset was no good sign") {
  using namespace protocol;
  for (const uint32_t cause : {uint32_t{BY_POWER_ON}, uint32_t{BY_RESET_PIN},
                               BY_RESET_PIN | WHILE_ARMED, uint32_t{BY_UNKNOWN}}) {
    Supervisor supervisor;
    supervisor.boot(static_cast<uint8_t>(cause), false);
    CHECK(supervisor.state() == State::SAFE);
    CHECK(supervisor.faults() == 0);
    CHECK(!supervisor.live());
  }
  Supervisor brown;
  brown.boot(BY_BROWN_OUT | BY_POWER_ON, false);
  CHECK(brown.state() == State::FAULT);
  CHECK(brown.faults() == protocol::BROWN_OUT);
  Supervisor hung;
  hung.boot(BY_WATCHDOG, false);
  CHECK(hung.state() == State::FAULT);
  CHECK(hung.faults() == protocol::WATCHDOG);
  CHECK(hung.clear() == Result::OK);
  CHECK(hung.state() == State::SAFE);
  CHECK(hung.faults() == 0);
  Supervisor hidden;
  hidden.boot(BY_UNKNOWN | WHILE_ARMED, false);
  CHECK(hidden.faults() == RESET_UNKNOWN);
  CHECK(hidden.state() == State::FAULT);
  Supervisor damaged;
  damaged.boot(BY_POWER_ON, true);
  CHECK(damaged.faults() == PARAMS_COPY);
  CHECK(damaged.clear() == Result::OK);
}

TEST_CASE("ARM wants the right version, SAFE, and zero speed asked") {
  Rig rig;
  rig.watch();
  CHECK(rig.supervisor.arm(protocol::kVersion + 1, true, true) == Result::WRONG_VERSION);
  CHECK(rig.supervisor.arm(protocol::kVersion, true, false) == Result::NOT_PLAUSIBLE);
  CHECK(rig.supervisor.arm(protocol::kVersion, false, true) == Result::NOT_SET_UP);
  CHECK(rig.supervisor.state() == State::SAFE);
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::OK);
  CHECK(rig.supervisor.state() == State::ARMED);
  CHECK(rig.supervisor.live());
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::WRONG_STATE);
}

TEST_CASE("A speed other than zero makes it RUNNING, zero ARMED again") {
  Rig rig;
  rig.run();
  CHECK(rig.supervisor.live());
  rig.supervisor.command(false);
  CHECK(rig.supervisor.state() == State::ARMED);
  rig.supervisor.command(true);
  CHECK(rig.supervisor.state() == State::RUNNING);
}

TEST_CASE("A command changes nothing while SAFE or in FAULT") {
  Rig rig;
  rig.supervisor.command(true);
  CHECK(rig.supervisor.state() == State::SAFE);
  rig.seen.estop_open = true;
  rig.watch();
  rig.supervisor.command(true);
  CHECK(rig.supervisor.state() == State::FAULT);
}

TEST_CASE("STOP makes it SAFE and wins over an ARM before or after it in the same tick") {
  Rig rig;
  rig.run();
  rig.supervisor.stop();
  CHECK(rig.supervisor.state() == State::SAFE);
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::WRONG_STATE);
  rig.supervisor.command(true);
  CHECK(rig.supervisor.state() == State::SAFE);
  rig.watch();
  CHECK(rig.supervisor.state() == State::SAFE);
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::OK);
  rig.supervisor.stop();
  CHECK(rig.supervisor.state() == State::SAFE);
}

TEST_CASE("STOP does not clear a fault") {
  Rig rig;
  rig.seen.estop_open = true;
  rig.watch();
  rig.supervisor.stop();
  CHECK(rig.supervisor.state() == State::FAULT);
}

TEST_CASE("A fault latches in any state, and CLEAR needs its cause gone") {
  Rig rig;
  rig.run();
  rig.seen.estop_open = true;
  rig.watch();
  CHECK(rig.supervisor.state() == State::FAULT);
  CHECK(rig.supervisor.faults() == protocol::ESTOP_OPEN);
  CHECK(rig.supervisor.clear() == Result::NOT_PLAUSIBLE);
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::WRONG_STATE);
  rig.seen.estop_open = false;
  rig.watch(100);
  CHECK(rig.supervisor.state() == State::FAULT);
  CHECK(rig.supervisor.clear() == Result::OK);
  CHECK(rig.supervisor.state() == State::SAFE);
  CHECK(rig.supervisor.faults() == 0);
}

TEST_CASE("CLEAR forgets the faults that are gone and keeps the others") {
  Rig rig;
  rig.seen.estop_open = true;
  rig.watch();
  rig.seen.estop_open = false;
  rig.seen.params_bad = true;
  rig.watch();
  CHECK(rig.supervisor.faults() == (protocol::ESTOP_OPEN | protocol::PARAMS_BAD));
  CHECK(rig.supervisor.clear() == Result::NOT_PLAUSIBLE);
  CHECK(rig.supervisor.faults() == protocol::PARAMS_BAD);
  CHECK(rig.supervisor.state() == State::FAULT);
}

TEST_CASE("CLEAR without a fault changes nothing") {
  Rig rig;
  CHECK(rig.supervisor.clear() == Result::OK);
  CHECK(rig.supervisor.state() == State::SAFE);
  rig.run();
  CHECK(rig.supervisor.clear() == Result::OK);
  CHECK(rig.supervisor.state() == State::RUNNING);
}

TEST_CASE("The link is lost in the 50th tick that saw no command: at most 250 ms") {
  Rig rig;
  rig.run();
  rig.live(200);
  rig.watch(48);
  CHECK(rig.supervisor.state() == State::RUNNING);
  rig.watch();
  CHECK(rig.supervisor.state() == State::FAULT);
  CHECK(rig.supervisor.faults() == protocol::LINK_LOST);
  rig.watch();
  CHECK(rig.supervisor.clear() == Result::OK);
}

TEST_CASE("Arming starts the link's time afresh") {
  Rig rig;
  rig.run();
  rig.watch(40);
  rig.supervisor.stop();
  rig.watch();
  CHECK(rig.supervisor.arm(protocol::kVersion, true, true) == Result::OK);
  rig.watch(49);
  CHECK(rig.supervisor.state() == State::ARMED);
  rig.watch();
  CHECK(rig.supervisor.faults() == protocol::LINK_LOST);
}

TEST_CASE("A machine that is SAFE needs no host") {
  Rig rig;
  rig.watch(1000);
  CHECK(rig.supervisor.state() == State::SAFE);
  CHECK(rig.supervisor.faults() == 0);
}

TEST_CASE("What the controller reports at once becomes a fault at once") {
  struct Case {
    bool Observation::*flag;
    uint32_t bit;
  };
  for (const Case &each : {Case{&Observation::estop_open, protocol::ESTOP_OPEN},
                           Case{&Observation::params_bad, protocol::PARAMS_BAD},
                           Case{&Observation::hall_silent, protocol::HALL_LOST},
                           Case{&Observation::ident_limit, protocol::IDENT_LIMIT}}) {
    Rig rig;
    rig.run();
    rig.seen.*each.flag = true;
    rig.watch();
    CHECK(rig.supervisor.faults() == each.bit);
    CHECK(rig.supervisor.state() == State::FAULT);
  }
}

TEST_CASE("Each measured limit latches after its time beyond it, and not at it") {
  struct Case {
    int16_t Observation::*value;
    int16_t good;
    int16_t bad;
    uint32_t bit;
    int ticks;
  };
  for (const Case &each :
       {Case{&Observation::pot, 904 * 16, 904 * 16 + 1, protocol::POT_OPEN, 2},
        Case{&Observation::pot, 120 * 16, 120 * 16 - 1, protocol::POT_SHORT, 2},
        Case{&Observation::steer_current, 2000, 2001, protocol::STEER_OVERCURRENT, 10},
        Case{&Observation::drive_current, 4000, 4001, protocol::DRIVE_OVERCURRENT, 10},
        Case{&Observation::battery, 10000, 9999, protocol::BATTERY_LOW, 120},
        Case{&Observation::battery, 15500, 15501, protocol::BATTERY_HIGH, 20}}) {
    Rig rig;
    rig.run();
    rig.seen.*each.value = each.good;
    rig.live(300);
    CHECK(rig.supervisor.faults() == 0);
    rig.seen.*each.value = each.bad;
    CHECK(rig.latches_after(each.bit) == each.ticks);
    CHECK(rig.supervisor.faults() == each.bit);
    CHECK(rig.supervisor.clear() == Result::NOT_PLAUSIBLE);
    rig.seen.*each.value = each.good;
    rig.watch();
    CHECK(rig.supervisor.clear() == Result::OK);
  }
}

TEST_CASE("The e-stop's loop is open or shorted beyond its bounds, and not at them") {
  struct Case {
    uint16_t value;
    uint32_t fault;
  };
  for (const Case &each : {Case{307 * 16, 0}, Case{307 * 16 + 1, protocol::ESTOP_OPEN},
                           Case{102 * 16, 0}, Case{102 * 16 - 1, protocol::ESTOP_SHORT}}) {
    Rig rig;
    rig.run();
    rig.seen.estop = each.value;
    rig.live(5);
    CHECK(rig.supervisor.faults() == each.fault);
  }
}

TEST_CASE("A mean current at the driver's rating is none too much, beyond it is at once") {
  struct Case {
    int16_t Observation::*value;
    int16_t rating;
    uint32_t fault;
  };
  for (const Case &each : {Case{&Observation::steer_mean, 400, protocol::STEER_OVERCURRENT},
                           Case{&Observation::drive_mean, 1000, protocol::DRIVE_OVERCURRENT}}) {
    Rig rig;
    rig.run();
    rig.seen.*each.value = each.rating;
    rig.live(5);
    CHECK(rig.supervisor.faults() == 0);
    ++(rig.seen.*each.value);
    rig.live();
    CHECK(rig.supervisor.faults() == each.fault);
  }
}

TEST_CASE("A limit passed for a fifth of the time is forgiven, for more it is not") {
  for (const int good : {4, 3}) {
    Rig rig;
    rig.run();
    for (int i = 0; i < 60; ++i) {
      rig.seen.steer_current = 3000;
      rig.live(1);
      rig.seen.steer_current = 0;
      rig.live(good);
    }
    CHECK(rig.supervisor.faults() == (good == 3 ? protocol::STEER_OVERCURRENT : 0U));
  }
}

TEST_CASE("A battery that reads anything is low within 2 s") {
  Rig rig;
  rig.run();
  uint32_t noise = 1;
  int ticks = 0;
  while (rig.supervisor.faults() == 0 && ticks < 400) {
    noise = noise * 1664525 + 1013904223;
    rig.seen.battery = static_cast<int16_t>((noise >> 16) % 15500);
    rig.live();
    ++ticks;
  }
  CHECK(rig.supervisor.faults() == protocol::BATTERY_LOW);
}

TEST_CASE("An angle that changes faster than 400 deg/s is a jump") {
  for (const int16_t sign : {1, -1}) {
    Rig rig;
    rig.seen.angle = 1000;
    rig.run();
    rig.seen.angle = static_cast<int16_t>(1000 + sign * 200);
    rig.live();
    CHECK(rig.supervisor.faults() == 0);
    rig.seen.angle = static_cast<int16_t>(1000 - sign * 1);
    rig.live();
    CHECK(rig.supervisor.faults() == protocol::POT_JUMP);
    rig.watch();
    CHECK(rig.supervisor.clear() == Result::OK);
  }
}

TEST_CASE("The first angle after boot is no jump") {
  Rig rig;
  rig.seen.angle = 5000;
  rig.watch();
  CHECK(rig.supervisor.faults() == 0);
}

TEST_CASE("Full duty without movement for 250 ms: frozen, or stalled where the current is high") {
  for (const int16_t sign : {1, -1}) {
    for (const int16_t current : {0, 299, 300, 2000}) {
      Rig rig;
      rig.seen.angle = 200;
      rig.run();
      rig.seen.steer_duty = static_cast<int16_t>(sign * 255);
      rig.seen.steer_current = current;
      CHECK(rig.latches_after(protocol::POT_FROZEN | protocol::STEER_STALL) == 49);
      CHECK(rig.supervisor.faults() ==
            (current >= 300 ? protocol::STEER_STALL : protocol::POT_FROZEN));
    }
  }
}

TEST_CASE("Less duty takes longer, in proportion to what is above the minimum, the lag apart") {
  // The minimum is 70: 150 ms * 185 = (t - 107 ms) * (duty - 70), and a little less where the lag
  // has not passed by then.
  struct Case {
    int16_t duty;
    int ticks;
  };
  for (const Case &each : {Case{110, 161}, Case{144, 96}, Case{-255, 49}}) {
    Rig rig;
    rig.run();
    rig.seen.steer_duty = each.duty;
    CHECK(rig.latches_after(protocol::POT_FROZEN) == each.ticks);
  }
  Rig easy;
  easy.run();
  easy.seen.steer_duty = 109;
  easy.live(2000);
  CHECK(easy.supervisor.faults() == 0);
}

TEST_CASE("Movement beyond the noise begins the time anew, and from the new place") {
  Rig moving;
  moving.run();
  moving.seen.steer_duty = 255;
  moving.live(18);
  for (int i = 0; i < 20; ++i) {
    moving.live(30);
    moving.seen.angle = static_cast<int16_t>(moving.seen.angle + 61);
    moving.live();
  }
  CHECK(moving.supervisor.faults() == 0);
  // The motor is at speed: 150 ms, and no lag.
  CHECK(moving.latches_after(protocol::POT_FROZEN) == 31);
  Rig noisy;
  noisy.run();
  noisy.seen.steer_duty = 255;
  noisy.live(30);
  noisy.seen.angle = -60;
  noisy.live(18);
  CHECK(noisy.supervisor.faults() == 0);
  noisy.live();
  CHECK(noisy.supervisor.faults() == protocol::POT_FROZEN);
}

TEST_CASE("A moment without drive begins nothing anew, but a second does") {
  const auto after_rest = [](int ticks) {
    Rig rig;
    rig.run();
    rig.seen.steer_duty = 255;
    rig.live(48);
    rig.seen.steer_duty = 0;
    rig.live(ticks);
    CHECK(rig.supervisor.faults() == 0);
    rig.seen.steer_duty = 255;
    return rig.latches_after(protocol::POT_FROZEN);
  };
  // A 64th is forgotten in a tick, and the motor loses a twentieth of its speed.
  CHECK(after_rest(1) == 1);
  CHECK(after_rest(10) == 8);
  CHECK(after_rest(400) == 49);
}

TEST_CASE("Movement while it rests begins the time anew") {
  Rig rig;
  rig.run();
  rig.seen.steer_duty = 255;
  rig.live(48);
  rig.seen.steer_duty = 0;
  rig.seen.angle = 61;
  rig.live();
  rig.seen.steer_duty = 255;
  CHECK(rig.latches_after(protocol::POT_FROZEN) == 33);
}

TEST_CASE("Back and forth within the play is no way") {
  Rig rig;
  rig.run();
  for (int i = 0; i < 50; ++i) {
    rig.seen.steer_duty = 255;
    rig.live(30);
    rig.seen.steer_duty = -255;
    rig.live(30);
  }
  CHECK(rig.supervisor.faults() == 0);
}

TEST_CASE("What is found once is found again only after the same time") {
  Rig rig;
  rig.run();
  rig.seen.steer_duty = 255;
  CHECK(rig.latches_after(protocol::POT_FROZEN) == 49);
  rig.seen.steer_duty = 0;
  rig.watch();
  CHECK(rig.supervisor.clear() == Result::OK);
  rig.seen.steer_duty = 255;
  CHECK(rig.latches_after(protocol::POT_FROZEN) == 33);  // the motor is still at speed
}

TEST_CASE("A motor that is turned round must come to speed the other way before it counts") {
  for (const int16_t sign : {1, -1}) {
    Rig rig;
    rig.run();
    rig.seen.steer_duty = static_cast<int16_t>(sign * 255);
    rig.live(40);
    rig.seen.angle = static_cast<int16_t>(sign * 100);
    rig.live();
    rig.seen.steer_duty = static_cast<int16_t>(-sign * 255);
    rig.seen.angle = static_cast<int16_t>(sign * 100);
    // 70 ms to stand still, then as from rest, and the way that it went on meanwhile.
    CHECK(rig.latches_after(protocol::POT_FROZEN) == 67);
  }
}

TEST_CASE("The way is judged to the count") {
  struct Case {
    int16_t floor, stall, duty;
    int ticks;
  };
  // In the last tick the first has just the way that is allowed, the second less than a count more.
  for (const Case &each : {Case{0, 159, 150, 37}, Case{2, 264, 150, 77}}) {
    Rig rig;
    rig.params = with({{Param::steer_min_duty, each.floor}, {Param::stall_time, each.stall}});
    rig.run();
    rig.live();
    rig.seen.steer_duty = each.duty;
    CHECK(rig.latches_after(protocol::POT_FROZEN) == each.ticks);
  }
}

TEST_CASE("The time to stall is 100 ms of lag and the rest, which is at least 50 ms") {
  struct Case {
    int16_t stall;
    int ticks;
  };
  for (const Case &each : {Case{100, 24}, Case{150, 24}, Case{160, 27}, Case{183, 33}}) {
    Rig rig;
    rig.params = with({{Param::stall_time, each.stall}});
    rig.run();
    rig.seen.steer_duty = 255;
    CHECK(rig.latches_after(protocol::POT_FROZEN) == each.ticks);
  }
}

TEST_CASE("After a calibration the first angle is no jump and no movement") {
  Rig rig;
  rig.run();
  rig.seen.steer_duty = 255;
  rig.live(30);
  rig.supervisor.recalibrated();
  rig.seen.angle = 3000;
  rig.live(48);
  CHECK(rig.supervisor.faults() == 0);
  rig.live();
  CHECK(rig.supervisor.faults() == protocol::POT_FROZEN);
}

TEST_CASE("Ten degrees against the duty are a runaway, with either sign") {
  for (const int16_t sign : {1, -1}) {
    Rig rig;
    rig.run();
    rig.seen.steer_duty = static_cast<int16_t>(sign * 80);
    for (int i = 1; i <= 9; ++i) {
      rig.seen.angle = static_cast<int16_t>(-sign * i * 100);
      rig.live();
    }
    rig.seen.angle = static_cast<int16_t>(-sign * 999);
    rig.live();
    CHECK(rig.supervisor.faults() == 0);
    rig.seen.angle = static_cast<int16_t>(-sign * 1000);
    rig.live();
    CHECK(rig.supervisor.faults() == protocol::STEER_RUNAWAY);
  }
}

TEST_CASE("Movement along the duty, or without one, is no runaway") {
  Rig along;
  along.run();
  along.seen.steer_duty = 80;
  for (int i = 0; i < 40; ++i) {
    along.seen.angle = static_cast<int16_t>(along.seen.angle + 100);
    along.live();
  }
  // And what went along does not pay for what goes against.
  for (int i = 0; i < 10; ++i) {
    along.seen.angle = static_cast<int16_t>(along.seen.angle - 100);
    along.live();
  }
  CHECK(along.supervisor.faults() == protocol::STEER_RUNAWAY);
  Rig released;
  released.run();
  for (int i = 0; i < 40; ++i) {
    released.seen.angle = static_cast<int16_t>(released.seen.angle - 100);
    released.live();
  }
  CHECK(released.supervisor.faults() == 0);
  // A tick without duty forgets.
  released.seen.steer_duty = 80;
  for (int k = 0; k < 4; ++k) {
    for (int i = 0; i < 9; ++i) {
      released.seen.angle = static_cast<int16_t>(released.seen.angle - 100);
      released.live();
    }
    released.seen.steer_duty = 0;
    released.live();
    released.seen.steer_duty = 80;
  }
  CHECK(released.supervisor.faults() == 0);
  // What goes along counts for nothing, not even for a hundredth of a degree.
  released.seen.angle = static_cast<int16_t>(released.seen.angle + 100);
  released.live();
  for (int i = 0; i < 9; ++i) {
    released.seen.angle = static_cast<int16_t>(released.seen.angle - 111);
    released.live();
  }
  CHECK(released.supervisor.faults() == 0);
  // A tick without duty forgets all of it.
  released.seen.steer_duty = 0;
  released.live();
  released.seen.steer_duty = 80;
  for (int i = 0; i < 9; ++i) {
    released.seen.angle = static_cast<int16_t>(released.seen.angle - 111);
    released.live();
  }
  CHECK(released.supervisor.faults() == 0);
  released.seen.angle = static_cast<int16_t>(released.seen.angle - 1);
  released.live();
  CHECK(released.supervisor.faults() == protocol::STEER_RUNAWAY);
}

TEST_CASE("A debounce is full after so many bad ticks, and speaks in bad ticks only") {
  Debounce debounce;
  CHECK(!debounce.step(true, 3));
  CHECK(!debounce.step(true, 3));
  CHECK(debounce.step(true, 3));
  CHECK(debounce.step(true, 3));
  CHECK(!debounce.step(false, 3));
  CHECK(debounce.step(true, 3));
  Debounce one;
  CHECK(one.step(true, 1));
}

TEST_CASE("A debounce drains four times slower than it fills, down to nothing") {
  for (const int good : {3, 4}) {
    Debounce debounce;
    CHECK(!debounce.step(true, 2));
    for (int i = 0; i < good; ++i) CHECK(!debounce.step(false, 2));
    CHECK(!debounce.step(true, 2));
    // What is left of the first makes up for one good tick.
    CHECK(!debounce.step(false, 2));
    CHECK(debounce.step(true, 2) == (good == 3));
  }
  Debounce empty;
  for (int i = 0; i < 10; ++i) CHECK(!empty.step(false, 2));
  CHECK(!empty.step(true, 2));
  CHECK(empty.step(true, 2));
}

TEST_CASE("A debounce of the longest time does not overflow") {
  Debounce debounce;
  int full = 0;
  for (int i = 1; i < 16000; ++i) full += debounce.step(true, 16000);
  CHECK(full == 0);
  for (int i = 0; i < 20000; ++i) full += debounce.step(true, 16000);
  CHECK(full == 20000);
}
