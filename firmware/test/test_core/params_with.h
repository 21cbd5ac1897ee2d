// Parameters that differ from their defaults in a few places, raw.
#pragma once
#include <doctest.h>

#include <initializer_list>

#include "params.h"

namespace daranti {

struct Set {
  protocol::Param param;
  int16_t value;
};

inline Params with(std::initializer_list<Set> sets, Params params = {}) {
  for (const Set &set : sets) {
    REQUIRE(params.set(static_cast<uint8_t>(set.param), set.value) == protocol::Result::OK);
  }
  return params;
}

}  // namespace daranti
