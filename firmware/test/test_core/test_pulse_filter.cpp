#include <doctest.h>

#include <initializer_list>

#include "pulse_filter.h"

using namespace daranti;

namespace {
constexpr uint8_t kA = PulseFilter::kA, kB = PulseFilter::kB, kTurn = PulseFilter::kTurn;

void hold(PulseFilter &filter, uint8_t levels, int samples) {
  for (int i = 0; i < samples; ++i) filter.sample(levels);
}
}  // namespace

TEST_CASE("A pulse is a level that falls and holds for two samples") {
  PulseFilter filter;
  hold(filter, kA | kB | kTurn, 5);
  filter.sample(kB | kTurn);
  CHECK(filter.pulses().wheel == 0);
  filter.sample(kB | kTurn);
  CHECK(filter.pulses().wheel == 1);
  hold(filter, kB | kTurn, 50);
  CHECK(filter.pulses().wheel == 1);
  hold(filter, kA | kB | kTurn, 2);
  CHECK(filter.pulses().wheel == 1);
  hold(filter, kB | kTurn, 2);
  CHECK(filter.pulses().wheel == 2);
  CHECK(filter.pulses().blade == 0);
}

TEST_CASE("What is shorter than two samples is noise, at either level") {
  PulseFilter filter;
  for (int i = 0; i < 100; ++i) {
    hold(filter, kA | kB | kTurn, 3);
    hold(filter, 0, 1);
  }
  CHECK(filter.pulses().wheel == 0);
  CHECK(filter.pulses().blade == 0);
  hold(filter, kB, 4);
  for (int i = 0; i < 100; ++i) {
    hold(filter, kB, 3);
    hold(filter, kA | kB | kTurn, 1);
  }
  CHECK(filter.pulses().wheel == 1);
  CHECK(filter.pulses().blade == 1);
}

TEST_CASE("The second sensor's level as the first changes tells the direction") {
  PulseFilter filter;
  // A quarter of a pulse apart: forward B is high as A falls.
  for (int i = 0; i < 10; ++i) {
    for (const uint8_t levels : {kA, static_cast<uint8_t>(kA | kB), kB, uint8_t{0}}) {
      hold(filter, levels, 4);
    }
  }
  CHECK(filter.pulses().wheel == 10);
  CHECK(filter.pulses().way == 10);
  for (int i = 0; i < 10; ++i) {
    for (const uint8_t levels : {kB, static_cast<uint8_t>(kA | kB), kA, uint8_t{0}}) {
      hold(filter, levels, 4);
    }
  }
  CHECK(filter.pulses().wheel == 20);
  CHECK(filter.pulses().way == 0);
}

TEST_CASE("A wheel that rocks on an edge of either sensor is where it was") {
  // The two positions that the edge parts.
  for (const auto &edge :
       {std::initializer_list<uint8_t>{kA | kB, kB}, {kB, 0}, {0, kA}, {kA, kA | kB}}) {
    PulseFilter filter;
    for (const uint8_t levels : edge) hold(filter, levels, 4);
    const uint16_t start = filter.pulses().way;
    for (int i = 0; i < 50; ++i) {
      for (const uint8_t levels : edge) hold(filter, levels, 4);
      CHECK(filter.pulses().way == start);
    }
  }
}

TEST_CASE("One sensor alone counts whatever the second one's input reads") {
  for (const uint8_t second : {kB, uint8_t{0}}) {
    PulseFilter filter;
    hold(filter, static_cast<uint8_t>(kA | second), 4);
    for (int i = 0; i < 10; ++i) {
      hold(filter, second, 4);
      hold(filter, static_cast<uint8_t>(kA | second), 4);
    }
    CHECK(filter.pulses().wheel == 10);
    CHECK(filter.pulses().way == 0);
  }
}

TEST_CASE("The blade's sensor counts by itself") {
  PulseFilter filter;
  for (int i = 0; i < 7; ++i) {
    hold(filter, kA | kB, 2);
    hold(filter, kA | kB | kTurn, 2);
  }
  CHECK(filter.pulses().blade == 7);
  CHECK(filter.pulses().wheel == 0);
}
