#include <doctest.h>

#include "blade.h"
#include "params_with.h"

using namespace daranti;
using protocol::Param;

namespace {

constexpr int kRest = 100;  // ticks of blade_rest
constexpr int kSpin = 300;  // ticks of blade_spin_time

struct Rig {
  Blade blade;
  uint16_t turns = 0;
  explicit Rig(std::initializer_list<Set> sets = {}) { blade.configure(with(sets)); }
  void step(int ticks = 1, uint16_t pulses_a_tick = 0) {
    for (int i = 0; i < ticks; ++i) {
      turns = static_cast<uint16_t>(turns + pulses_a_tick);
      blade.step(true, turns);
    }
  }
  // Asked for anew, and on with this tick.
  void start(uint16_t pulses = 0) {
    blade.request(false);
    blade.request(true);
    step(1, pulses);
    REQUIRE(blade.on());
  }
};

}  // namespace

TEST_CASE("The blade runs only after a command that did not ask for it") {
  Rig rig;
  rig.blade.request(true);
  rig.step(2 * kRest);
  CHECK(!rig.blade.on());
  rig.start();
}

TEST_CASE("A released blade is off at once, and wants to be asked anew") {
  Rig rig;
  rig.start();
  rig.blade.release();
  CHECK(!rig.blade.on());
  rig.step(2 * kRest);
  CHECK(!rig.blade.on());
  rig.blade.request(true);
  rig.step(2 * kRest);
  CHECK(!rig.blade.on());
}

TEST_CASE("Switched off, the blade rests for its time, to the tick") {
  Rig rig;
  rig.start();
  rig.blade.request(false);
  rig.step();
  CHECK(!rig.blade.on());
  rig.blade.request(true);
  rig.step(kRest - 1);
  CHECK(!rig.blade.on());
  rig.step();
  CHECK(rig.blade.on());
}

TEST_CASE("A blade that does not turn is lost after its time to start, to the tick") {
  Rig rig({{Param::blade_turn_min, 20}});
  rig.step(2 * kSpin);
  CHECK(!rig.blade.lost());  // off, it need not turn
  rig.start();
  rig.step(kSpin - 1);
  CHECK(!rig.blade.lost());
  rig.step();
  CHECK(rig.blade.lost());
  CHECK(!rig.blade.stuck());
}

TEST_CASE("A blade that turns on is stuck after its time to stop, to the tick") {
  Rig rig({{Param::blade_turn_min, 20}});
  rig.step(2 * kSpin);
  CHECK(!rig.blade.stuck());
  rig.start(1);
  rig.step(2 * kSpin, 1);
  CHECK(!rig.blade.lost());
  CHECK(!rig.blade.stuck());  // on, it may turn
  rig.blade.request(false);
  rig.step(kSpin, 1);
  CHECK(!rig.blade.stuck());
  rig.step(1, 1);
  CHECK(rig.blade.stuck());
}

TEST_CASE("Without a sensor the blade is neither lost nor stuck") {
  Rig rig;
  rig.step(2 * kSpin);
  CHECK(!rig.blade.stuck());
  rig.start();
  rig.step(2 * kSpin);
  CHECK(!rig.blade.lost());
}

TEST_CASE(
    "A sensor that gives what was set, or more, is turning; one that gives less than half is not") {
  for (const int16_t least : {1, 3, 4, 8, 9, 10, 11, 15, 19, 20, 21, 29, 100, 999, 1000}) {
    for (const int phase : {0, 7, 13}) {
      for (const int percent : {100, 101, 150, 45}) {
        Rig rig({{Param::blade_turn_min, least}, {Param::blade_spin_time, 10000}});
        rig.start();
        // Pulses evenly spaced: 200 ticks a second.
        const auto given = [&](int tick) { return (tick + phase) * least * percent / 20000; };
        bool lost = false;
        for (int tick = 1; tick < 4000; ++tick) {
          rig.step(1, static_cast<uint16_t>(given(tick) - given(tick - 1)));
          lost = lost || rig.blade.lost();
        }
        CAPTURE(least);
        CAPTURE(percent);
        CHECK(lost == (percent < 100));
        CHECK(rig.blade.lost() == lost);
      }
    }
  }
}

TEST_CASE(
    "A blade that starts and stops at once is neither lost nor stuck, however slow its sensor") {
  for (const int16_t least : {1, 2, 4, 10, 20, 1000}) {
    for (int phase = 0; phase < 200; phase += 23) {
      Rig rig({{Param::blade_turn_min, least}, {Param::blade_spin_time, 200}});
      CAPTURE(least);
      CAPTURE(phase);
      rig.start();
      const auto given = [&](int tick) { return (tick + phase) * least / 200; };
      bool lost = false, stuck = false;
      for (int tick = 1; tick < 3000 + phase; ++tick) {
        rig.step(1, static_cast<uint16_t>(given(tick) - given(tick - 1)));
        lost = lost || rig.blade.lost();
      }
      CHECK(!lost);
      rig.blade.release();
      for (int tick = 0; tick < 3000; ++tick) {
        rig.step();
        stuck = stuck || rig.blade.stuck();
      }
      CHECK(!stuck);
    }
  }
}

TEST_CASE("A blade that never turns is lost after two windows of a slow sensor, to the tick") {
  struct Case {
    int16_t least;
    int ticks;
  };
  for (const Case &each : {Case{1, 800}, Case{4, 200}, Case{10, 80}, Case{20, 40}}) {
    CAPTURE(each.least);
    Rig rig({{Param::blade_turn_min, each.least}, {Param::blade_spin_time, 200}});
    rig.start();
    rig.step(each.ticks - 1);
    CHECK(!rig.blade.lost());
    rig.step();
    CHECK(rig.blade.lost());
  }
}

TEST_CASE("Pulses are counted for a tenth of a second, or as long as two take, and then anew") {
  struct Case {
    int16_t least;
    uint16_t pulses;
    int ticks;
  };
  for (const Case &each :
       {Case{20, 2, 20}, Case{21, 2, 20}, Case{29, 2, 14}, Case{30, 3, 20}, Case{10, 2, 40},
        Case{11, 2, 37}, Case{1, 2, 400}, Case{1000, 100, 20}}) {
    CAPTURE(each.least);
    Rig rig({{Param::blade_turn_min, each.least}, {Param::blade_spin_time, 200}});
    rig.start();
    rig.step(10 * each.ticks - 1);
    rig.step(1, static_cast<uint16_t>(each.pulses - 1));  // the next window's first tick
    rig.step(each.ticks - 2);
    CHECK(rig.blade.lost());
    rig.step(1, 1);  // its last
    CHECK(!rig.blade.lost());
    rig.step(1, static_cast<uint16_t>(each.pulses - 1));  // one too few
    rig.step(each.ticks - 2);
    CHECK(!rig.blade.lost());
    rig.step();
    CHECK(rig.blade.lost());
  }
}

TEST_CASE("A sensor that is configured as a faster one is counted by its own time at once") {
  Rig rig({{Param::blade_turn_min, 1}, {Param::blade_spin_time, 200}});
  rig.step(300);
  rig.blade.configure(with({{Param::blade_turn_min, 20}, {Param::blade_spin_time, 200}}));
  rig.step(60, 1);
  CHECK(rig.blade.stuck());
}
