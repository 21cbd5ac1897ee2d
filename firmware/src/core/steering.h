// From potentiometer to angle, and from angle setpoint to motor duty.
#pragma once
#include <stdint.h>

#include "params.h"
#include "pid.h"

namespace daranti {

// Potentiometer to steering angle: two straight lines through the calibration's left, centre and
// right points.
class Pot {
 public:
  void configure(const Params &params);
  // The points are in order, whichever way the potentiometer turns, with at least one count per
  // degree on either side. Without that no angle means anything.
  bool calibrated() const { return calibrated_; }
  // reading: 0..kAnalogMax. Centidegree, positive left.
  int16_t angle(int16_t reading) const;

 private:
  int32_t left_ = 0;  // centidegree per 1/16 count left of the centre, 2^-14
  int32_t right_ = 0;
  int16_t centre_ = 0;  // 1/16 counts
  bool rising_ = true;  // left reads more than right
  bool calibrated_ = false;
};

// PID with setpoint slew, rest band, minimum duty and soft growth of the duty.
class Steering {
 public:
  void configure(const Params &params);
  // One tick. target, angle: centidegree. Returns the duty, -255..255, positive left.
  int16_t step(int16_t target, int16_t angle);
  // The motor is not controlled; the next step starts afresh from the angle then measured.
  void release();
  // The slewed setpoint, centidegree; the last one while released.
  int16_t setpoint() const { return setpoint_; }

 private:
  PidCoefficients coefficients_{};
  PidState pid_;
  int32_t smooth_ = 0;    // error, centidegree, 2^-8
  int16_t limit_ = 0;     // centidegree
  int16_t slew_ = 0;      // centidegree a tick
  int16_t deadband_ = 0;  // centidegree
  int16_t floor_ = 0;     // minimum duty
  int16_t headroom_ = 0;  // from the minimum to the maximum duty
  int16_t growth_ = 0;    // duty a tick
  int16_t setpoint_ = 0;
  int16_t duty_ = 0;
  int8_t sign_ = 0;  // direction of the minimum duty, 0 while none is added
  bool released_ = true;
  bool resting_ = true;
};

}  // namespace daranti
