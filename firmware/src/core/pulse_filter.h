// From the levels of the hall sensors, sampled at a fixed rate, to pulses. Whatever the inputs do,
// a sample costs the same: noise cannot take time from the tick.
#pragma once
#include <stdint.h>

#include "board.h"

namespace daranti {

class PulseFilter {
 public:
  static constexpr uint8_t kA = 1;  // wheel
  static constexpr uint8_t kB = 2;  // wheel, a quarter of a pulse apart: high as A falls, forward
  static constexpr uint8_t kTurn = 4;  // blade

  // levels: bits of the above. A level counts once it has held for two samples.
  void sample(uint8_t levels) {
    const uint8_t steady = static_cast<uint8_t>(~(levels ^ before_));
    before_ = levels;
    const uint8_t changed = static_cast<uint8_t>(steady & (levels ^ level_));
    if (changed == 0) return;
    level_ = static_cast<uint8_t>(level_ ^ changed);
    const uint8_t fell = static_cast<uint8_t>(changed & ~level_);
    if (fell & kA) ++pulses_.wheel;
    // Of A's two edges in a pulse the one at which B is high counts, forward and, crossed back,
    // backward: a wheel that rocks on an edge, whichever, comes nowhere.
    if ((changed & kA) != 0 && (level_ & kB) != 0) {
      if (fell & kA) {
        ++pulses_.way;
      } else {
        --pulses_.way;
      }
    }
    if (fell & kTurn) ++pulses_.blade;
  }
  const Pulses &pulses() const { return pulses_; }

 private:
  uint8_t before_ = kA | kB | kTurn;  // the last sample
  uint8_t level_ = kA | kB | kTurn;   // what has held
  Pulses pulses_{0, 0, 0};
};

}  // namespace daranti
