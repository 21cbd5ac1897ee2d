// A bridge's current from its sensor's voltage, now and as a mean over a second.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace daranti {

class Current {
 public:
  // zero: the sensor's output at no current, mV. scale: mV/A; 0: none fitted, which reads nothing.
  void configure(int16_t zero, int16_t scale);
  // One tick. reading: 0..kAnalogMax.
  void step(uint16_t reading);
  // 0.01 A, without sign: a bridge's sensor sits in its supply or in the motor's wire.
  int16_t now() const { return now_; }
  int16_t mean() const { return static_cast<int16_t>(mean_ >> 8); }
  // Whether the sensor can show so much, 0.01 A; true where none is fitted, and false where its
  // scale is below 10 mV/A and above 0: it would be shown as less than it is.
  bool shows(int16_t most) const;

 private:
  int32_t per_step_ = 0;  // 0.01 A per 1/16 count, 2^-14
  int32_t mean_ = 0;      // 0.01 A, 2^-8
  int16_t zero_ = 0;      // 1/16 counts
  int16_t now_ = 0;
  bool fine_ = true;  // the scale is what it was configured with
};

}  // namespace daranti
