// PID with the derivative on the filtered measurement and back-calculated anti-windup, in integers.
//
// A pure function of setpoint, measurement and dt: dt enters with the gains, once, in
// pid_prepare(), so that a step needs no division. The state is the caller's.
#pragma once
#include <stdint.h>

namespace daranti {

struct PidGains {
  int16_t kp;         // 0.01 duty/deg, 0..10000
  int16_t ki;         // 0.01 duty/(deg s), 0..10000
  int16_t kd;         // 0.001 duty s/deg, 0..20000
  int16_t filter_ms;  // time constant of the derivative's low-pass, 0..200
};

// The gains per centidegree and step.
struct PidCoefficients {
  int32_t kp;      // duty, 2^-16
  int32_t ki;      // duty, 2^-20
  int32_t kd;      // duty, 2^-8
  int16_t smooth;  // share of a new rate in the filtered one, 2^-14
  int16_t track;   // share of the excess over the limit taken back from the integral, 2^-14
};

struct PidState {
  int32_t integral = 0;  // duty, 2^-20
  int32_t rate = 0;      // filtered change of the measurement, centidegree a step, 2^-8
  int16_t last = 0;      // measurement, centidegree
  bool primed = false;   // `last` holds a measurement
};

// dt_ms: 1..13.
PidCoefficients pid_prepare(const PidGains &gains, uint8_t dt_ms);

// setpoint, measurement: centidegree. limit: largest |output|, 0..255 duty.
// Returns the output in duty, within +-limit.
int16_t pid_step(PidState &state, const PidCoefficients &coefficients, int16_t setpoint,
                 int16_t measurement, int16_t limit);

}  // namespace daranti
