// Wheel speed from hall pulses, and from speed setpoint to drive duty.
#pragma once
#include <stdint.h>

#include "params.h"

namespace daranti {

// Speed and distance from a wheel's pulses. Whether the wheel turns forward or backward is taken
// from the duty's sign: one sensor does not tell.
class Hall {
 public:
  // One tick. pulses: counter modulo 65536; duty: the one that was applied.
  void step(const Params& params, uint16_t pulses, int16_t duty);
  // mm/s; kNone where no sensor is configured.
  int16_t speed() const { return speed_; }
  // mm, signed, since boot.
  int32_t distance() const { return distance_; }
  // Ticks since the last pulse, saturating.
  uint16_t silent() const { return silent_; }

  static constexpr int16_t kNone = INT16_MIN;

 private:
  int32_t distance_ = 0;
  int32_t remainder_ = 0;  // of a millimetre, in units of 1/(10 pulses_per_metre) mm
  uint16_t last_ = 0;
  uint16_t silent_ = UINT16_MAX;
  int16_t speed_ = kNone;
  bool backward_ = false;
};

// Soft start, feed-forward, and a speed loop where a hall sensor is configured.
class Drive {
 public:
  // One tick. target, measured: mm/s (measured may be Hall::kNone); battery: mV.
  // Returns the duty, -255..255, positive forward.
  int16_t step(const Params& params, int16_t target, int16_t measured, int16_t battery);
  void release();
  // The ramped setpoint, mm/s; 0 while released.
  int16_t setpoint() const { return setpoint_; }

 private:
  int32_t integral_ = 0;  // 1e-4 duty
  int16_t setpoint_ = 0;
};

}  // namespace daranti
