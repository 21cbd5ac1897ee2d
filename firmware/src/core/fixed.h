// Saturating integer arithmetic. `int` is 16 bits on the AVR, so every width is written out.
#pragma once
#include <stdint.h>

namespace daranti {

inline int32_t clamp(int32_t value, int32_t low, int32_t high) {
  return value < low ? low : value > high ? high : value;
}

inline int32_t least(int32_t a, int32_t b) { return a < b ? a : b; }

inline int16_t saturate16(int32_t value) {
  return static_cast<int16_t>(clamp(value, INT16_MIN, INT16_MAX));
}

inline int32_t magnitude(int32_t value) { return value < 0 ? -value : value; }

// Towards `target` by at most `step` (not negative).
inline int32_t approach(int32_t value, int32_t target, int32_t step) {
  return clamp(target, value - step, value + step);
}

// Rounded to nearest, halves away from zero; divisor positive.
inline int32_t divide(int32_t value, int32_t divisor) {
  return (value + (value < 0 ? -divisor : divisor) / 2) / divisor;
}

}  // namespace daranti
