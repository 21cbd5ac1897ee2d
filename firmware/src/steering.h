// From potentiometer to angle, and from angle setpoint to motor duty.
#pragma once
#include <stdint.h>

#include "params.h"
#include "pid.h"

namespace daranti {

// Steering angle in centidegrees, positive left: two straight lines through the calibration's
// left, centre and right points. pot: 1/16 counts. Needs calibrated(params).
int16_t pot_to_angle(const Params& params, int16_t pot);

// The three calibration points are at least 20 counts apart and in order, whichever way the
// potentiometer turns.
bool calibrated(const Params& params);

// PID with setpoint slew, rest band, minimum duty and soft growth of the duty.
class Steering {
 public:
  // One tick. target, angle: centidegree. Returns the duty, -255..255, positive left.
  int16_t step(const Params& params, int16_t target, int16_t angle);
  // The motor is not controlled; the next step starts afresh from the angle then measured.
  void release();
  // The slewed setpoint, centidegree; the last one while released.
  int16_t setpoint() const { return setpoint_; }

 private:
  PidState pid_;
  int16_t setpoint_ = 0;
  int16_t duty_ = 0;
  int8_t sign_ = 0;  // direction of the minimum duty, 0 while none is added
  bool released_ = true;
  bool resting_ = true;
};

}  // namespace daranti
