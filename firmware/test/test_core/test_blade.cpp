#include <doctest.h>

#include "blade.h"
#include "params_with.h"

using namespace daranti;
using protocol::Param;

namespace {

constexpr int kRest = 100;   // ticks of blade_rest
constexpr int kSpin = 300;   // ticks of blade_spin_time
constexpr int kWindow = 20;  // ticks in which the sensor's pulses are counted

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

TEST_CASE("A tenth of a second with a tenth of the pulses counts as turning, one less does not") {
  struct Case {
    int16_t least;
    uint16_t pulses;
    bool turns;
  };
  for (const Case &each : {Case{20, 2, true}, Case{20, 1, false}, Case{11, 2, true},
                           Case{11, 1, false}, Case{21, 3, true}, Case{21, 2, false}}) {
    Rig rig({{Param::blade_turn_min, each.least}, {Param::blade_spin_time, 200}});
    rig.start();
    for (int tick = 2; tick <= 4 * kWindow; ++tick) {
      rig.step(1, tick % kWindow == 1 ? each.pulses : 0);
    }
    CHECK(rig.blade.lost() == !each.turns);
  }
}

TEST_CASE("Pulses are counted from one tenth of a second to the next") {
  Rig rig({{Param::blade_turn_min, 20}, {Param::blade_spin_time, 200}});
  rig.start();
  rig.step(2 * kWindow - 1);
  rig.step(1, 1);  // the third tenth's first tick
  rig.step(kWindow - 2);
  CHECK(rig.blade.lost());
  rig.step(1, 1);  // its last
  CHECK(!rig.blade.lost());
  rig.step(kWindow - 1);
  CHECK(!rig.blade.lost());
  rig.step();
  CHECK(rig.blade.lost());
}
