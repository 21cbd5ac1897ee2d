// PID with the derivative on the filtered measurement and back-calculated anti-windup, in integers.
//
// A pure function of setpoint, measurement and dt; the state is the caller's.
#pragma once
#include <stdint.h>

namespace daranti {

struct PidGains {
  int16_t kp;         // 0.01 duty/deg
  int16_t ki;         // 0.01 duty/(deg s)
  int16_t kd;         // 0.001 duty s/deg
  int16_t filter_ms;  // time constant of the derivative's low-pass
};

struct PidState {
  int32_t integral = 0;  // 1e-4 duty
  int32_t rate = 0;      // filtered rate of the measurement, 1/16 centidegree/s
  int16_t last = 0;      // measurement, centidegree
  bool primed = false;   // `last` holds a measurement
};

// setpoint, measurement: centidegree. limit: largest |output|, duty. dt_ms: 1..20.
// Returns the output in duty, within +-limit.
int16_t pid_step(PidState& state, const PidGains& gains, int16_t setpoint, int16_t measurement,
                 int16_t limit, uint8_t dt_ms);

}  // namespace daranti
