#include "pid.h"

#include "fixed.h"

namespace daranti {

namespace {
constexpr int32_t kUnit = 10000;       // the sum's unit is 1e-4 duty
constexpr int32_t kErrorMax = 10000;   // 100 deg, keeps every product within 32 bits
constexpr int32_t kRateMax = 100000L;  // 1000 deg/s
constexpr int16_t kTrackingMs = 50;    // how fast the integral gives way at the limit
constexpr int32_t kIntegralMax = 255L * kUnit;
}  // namespace

int16_t pid_step(PidState& state, const PidGains& gains, int16_t setpoint, int16_t measurement,
                 int16_t limit, uint8_t dt_ms) {
  const int32_t error = clamp(static_cast<int32_t>(setpoint) - measurement, -kErrorMax, kErrorMax);

  const int32_t moved = state.primed ? static_cast<int32_t>(measurement) - state.last : 0;
  const int32_t rate = clamp(moved * 1000 / dt_ms, -kRateMax, kRateMax) * 16;
  state.rate += divide((rate - state.rate) * dt_ms, gains.filter_ms + dt_ms);
  state.last = measurement;
  state.primed = true;

  const int32_t proportional = gains.kp * error;
  const int32_t derivative = divide(gains.kd * divide(state.rate, 16), 10);
  const int32_t sum = proportional + state.integral - derivative;
  const int32_t output = clamp(sum, -limit * kUnit, limit * kUnit);

  const int32_t grown = state.integral + divide(gains.ki * error * dt_ms, 1000);
  const int32_t excess = divide(output - sum, kTrackingMs + dt_ms) * dt_ms;
  state.integral = clamp(grown + excess, -kIntegralMax, kIntegralMax);
  return static_cast<int16_t>(divide(output, kUnit));
}

}  // namespace daranti
