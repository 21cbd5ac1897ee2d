#include "pid.h"

#include "fixed.h"

namespace daranti {

namespace {
// Bounds that keep every product and sum below within 32 bits.
constexpr int32_t kErrorMax = 10000;  // 100 deg
constexpr int32_t kMovedMax = 200;    // centidegree a step: 400 deg/s at 5 ms
constexpr int32_t kIntegralMax = int32_t{255} << 20;
constexpr int32_t kShareOne = int32_t{1} << 14;
constexpr int32_t kTrackingMs = 50;  // how fast the integral gives way at the limit
}  // namespace

PidCoefficients pid_prepare(const PidGains &gains, uint8_t dt_ms) {
  const int32_t dt = dt_ms;
  PidCoefficients out;
  out.kp = divide(gains.kp * (int32_t{1} << 16), 10000);
  out.ki = divide(gains.ki * dt * (int32_t{1} << 14), 156250);  // 1e7 / 2^6
  out.kd = divide(gains.kd * (int32_t{1} << 8), 100 * dt);
  out.smooth = static_cast<int16_t>(divide(dt * kShareOne, gains.filter_ms + dt));
  out.track = static_cast<int16_t>(divide(dt * kShareOne, kTrackingMs + dt));
  return out;
}

int16_t pid_step(PidState &state, const PidCoefficients &coefficients, int16_t setpoint,
                 int16_t measurement, int16_t limit) {
  const int32_t error = clamp(static_cast<int32_t>(setpoint) - measurement, -kErrorMax, kErrorMax);

  const int32_t change = state.primed ? static_cast<int32_t>(measurement) - state.last : 0;
  const int32_t moved = clamp(change, -kMovedMax, kMovedMax) * 256;
  state.rate += ((moved - state.rate) * coefficients.smooth) >> 14;
  state.last = measurement;
  state.primed = true;

  const int32_t proportional = coefficients.kp * error;
  const int32_t derivative = coefficients.kd * state.rate;
  const int32_t sum = proportional + (state.integral >> 4) - derivative;
  const int32_t most = static_cast<int32_t>(limit) << 16;
  const int32_t output = clamp(sum, -most, most);

  // At the limit the excess is taken back from the integral, but not through zero: with a short
  // tracking time a large proportional part would otherwise wind it up the other way.
  const int32_t grown =
      clamp(state.integral + coefficients.ki * error, -kIntegralMax, kIntegralMax);
  const int32_t back =
      least((magnitude(output - sum) >> 14) * coefficients.track, kIntegralMax >> 4) * 16;
  state.integral = grown > 0 ? clamp(grown - (sum > output ? back : 0), 0, grown)
                             : clamp(grown + (sum < output ? back : 0), grown, 0);
  return static_cast<int16_t>((output + (int32_t{1} << 15)) >> 16);
}

}  // namespace daranti
