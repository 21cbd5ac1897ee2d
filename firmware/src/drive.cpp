#include "drive.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;

namespace {
constexpr uint16_t kStandsTicks = 1000 / kTickMs;  // no pulse for so long: standing
constexpr int32_t kUnit = 10000;                   // the loop's sum is in 1e-4 duty
constexpr int32_t kErrorMax = 10000;               // mm/s, keeps the products within 32 bits
}  // namespace

void Hall::step(const Params& params, uint16_t pulses, int16_t duty) {
  const uint16_t fresh = static_cast<uint16_t>(pulses - last_);
  last_ = pulses;
  const int16_t per_metre = params[Param::hall_per_metre];  // 0.1 pulses/m
  if (per_metre == 0) {
    speed_ = kNone;
    return;
  }
  if (duty != 0) backward_ = duty < 0;
  if (silent_ != UINT16_MAX) ++silent_;

  // A pulse is 10000/per_metre mm; so many mm/s if one comes in `silent_` ticks.
  const int32_t ticks = silent_ == 0 ? 1 : silent_;
  const int32_t one = divide(10000000 / kTickMs / ticks, per_metre);
  int32_t speed = magnitude(speed_ == kNone ? 0 : speed_);
  if (fresh != 0) {
    speed = silent_ > kStandsTicks ? 0 : one * fresh;
    silent_ = 0;
    remainder_ += fresh * int32_t{10000};
    const int32_t whole = remainder_ / per_metre;
    remainder_ -= whole * per_metre;
    distance_ += backward_ ? -whole : whole;
  } else if (silent_ >= kStandsTicks) {
    speed = 0;
  } else if (speed > one) {
    speed = one;
  }
  speed_ = saturate16(backward_ ? -speed : speed);
  if (speed_ == kNone) ++speed_;
}

void Drive::release() {
  integral_ = 0;
  setpoint_ = 0;
}

int16_t Drive::step(const Params& params, int16_t target, int16_t measured, int16_t battery) {
  const int16_t limit = params[Param::speed_max];
  const int32_t ramp = divide(static_cast<int32_t>(params[Param::drive_accel]) * kTickMs, 1000);
  setpoint_ = static_cast<int16_t>(approach(setpoint_, clamp(target, -limit, limit), ramp));
  if (setpoint_ == 0) {
    integral_ = 0;
    return 0;
  }
  const int16_t floor = params[Param::drive_min_duty];
  int32_t duty = divide(setpoint_ * (int32_t{255} - floor), params[Param::speed_full]);
  duty += setpoint_ < 0 ? -floor : floor;
  const int16_t nominal = params[Param::battery_nominal];
  if (nominal != 0)
    duty = divide(clamp(duty, -255, 255) * nominal, battery < 1000 ? 1000 : battery);
  if (measured != Hall::kNone) {
    const int32_t error = clamp(static_cast<int32_t>(setpoint_) - measured, -kErrorMax, kErrorMax);
    // 0.1 duty s/m times mm/s is 1e-4 duty. Never against the setpoint: plugging strains the gear.
    const int32_t sum = duty * kUnit + params[Param::drive_kp] * error + integral_;
    const int32_t output = setpoint_ > 0 ? clamp(sum, 0, 255 * kUnit) : clamp(sum, -255 * kUnit, 0);
    if (sum == output) integral_ += divide(params[Param::drive_ki] * error, 1000) * kTickMs;
    duty = divide(output, kUnit);
  }
  return static_cast<int16_t>(clamp(duty, -255, 255));
}

}  // namespace daranti
