#include <doctest.h>

#include <initializer_list>

#include "board.h"
#include "current.h"
#include "fixed.h"

using namespace daranti;

TEST_CASE("A current counts as 100 A at most") {
  Current current;
  current.configure(0, 20);
  current.step(kAnalogMax);
  CHECK(current.now() == 10000);
}

TEST_CASE("A scale below 10 mV/A counts as 10") {
  for (const int16_t scale : {10, 3}) {
    Current current;
    current.configure(0, scale);
    current.step(kAnalogMax / 20);  // 0.25 V
    CHECK(current.now() == doctest::Approx(2500).epsilon(0.01));
  }
}

TEST_CASE("What is shown is what flows, or the sensor shows nothing that may be relied on") {
  for (int16_t scale = 0; scale <= 40; ++scale) {
    Current current;
    current.configure(2500, scale);
    // 0.4 V above the sensor's zero.
    current.step(static_cast<uint16_t>(int32_t{2900} * kAnalogMax / 5000));
    const double flows = scale == 0 ? 0.0 : 40000.0 / scale;
    const bool shown = magnitude(current.now() - static_cast<int32_t>(flows)) <= flows / 50 + 2;
    CHECK(shown == current.shows(100));
  }
}

TEST_CASE("A second after a step the mean has come 63 % of the way, after three 95 %") {
  Current current;
  current.configure(0, 50);
  for (int tick = 1; tick <= 600; ++tick) {
    current.step(kAnalogMax);
    // 1 - (1 - 0.005)^200 and ^600, with the share's 328 / 65536.
    if (tick == 200) CHECK(magnitude(current.mean() - 6334) <= 4);
    if (tick == 600) CHECK(magnitude(current.mean() - 9507) <= 4);
  }
}

TEST_CASE("A sensor shows what its output can reach, to the last hundredth") {
  Current current;
  current.configure(0, 100);
  CHECK(current.shows(4894));  // 4.895 V
  CHECK(!current.shows(4895));
}
