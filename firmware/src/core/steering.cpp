#include "steering.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;

namespace {

constexpr int32_t kRestRate = 384;   // 3 deg/s in PidState's unit: slower may come to rest
constexpr uint8_t kSmoothShift = 3;  // time constant 8 ticks
constexpr int16_t kSignOn = 3;       // duty at which the minimum duty takes a direction

}  // namespace

void Pot::configure(const Params &params) {
  // 1/10 to 1/16 counts.
  const int16_t left = static_cast<int16_t>(divide(params[Param::pot_left] * int32_t{8}, 5));
  const int16_t right = static_cast<int16_t>(divide(params[Param::pot_right] * int32_t{8}, 5));
  centre_ = static_cast<int16_t>(divide(params[Param::pot_centre] * int32_t{8}, 5));
  rising_ = left > centre_;
  const int16_t left_span = static_cast<int16_t>(rising_ ? left - centre_ : centre_ - left);
  const int16_t right_span = static_cast<int16_t>(rising_ ? centre_ - right : right - centre_);
  const int32_t left_angle = params[Param::angle_left];
  const int32_t right_angle = -params[Param::angle_right];
  calibrated_ =
      left_span * int32_t{100} >= left_angle * 16 && right_span * int32_t{100} >= right_angle * 16;
  if (!calibrated_) return;
  left_ = divide(left_angle * (int32_t{1} << 14), left_span);
  right_ = divide(right_angle * (int32_t{1} << 14), right_span);
}

int16_t Pot::angle(int16_t reading) const {
  const int32_t off = rising_ ? reading - centre_ : centre_ - reading;
  return saturate16((off * (off > 0 ? left_ : right_) + (int32_t{1} << 13)) >> 14);
}

void Steering::configure(const Params &params) {
  coefficients_ = pid_prepare({params[Param::steer_kp], params[Param::steer_ki],
                               params[Param::steer_kd], params[Param::steer_d_filter]},
                              kTickMs);
  limit_ = params[Param::steer_limit];
  // A tick's share of 0.1 deg/s and of duty/s, rounded, within 16 bits.
  static_assert(kTickMs * 20 == 100 && kTickMs * 200 == 1000, "of a tick");
  slew_ = static_cast<int16_t>((params[Param::steer_slew] + 20 / 2) / 20);
  deadband_ = params[Param::steer_deadband];
  floor_ = params[Param::steer_min_duty];
  const int16_t ceiling = params[Param::steer_duty_max];
  headroom_ = static_cast<int16_t>(ceiling > floor_ ? ceiling - floor_ : 0);
  growth_ = static_cast<int16_t>((params[Param::steer_duty_slew] + 200 / 2) / 200);
}

void Steering::release() {
  released_ = true;
  duty_ = 0;
}

int16_t Steering::step(int16_t target, int16_t angle) {
  if (released_) {
    released_ = false;
    resting_ = true;
    pid_ = PidState{};
    setpoint_ = angle;
    sign_ = 0;
    smooth_ = 0;
  }
  setpoint_ = static_cast<int16_t>(approach(setpoint_, clamp(target, -limit_, limit_), slew_));
  const int16_t output = pid_step(pid_, coefficients_, setpoint_, angle, headroom_);

  // Whether to rest is judged on a smoothed error, or the pot's noise would wake the motor.
  smooth_ += (((static_cast<int32_t>(setpoint_) - angle) * 256) - smooth_) >> kSmoothShift;
  const int32_t off = magnitude(smooth_) >> 8;
  if (off > deadband_) resting_ = false;
  if (off * 3 <= deadband_ * int32_t{2} && magnitude(pid_.rate) < kRestRate) resting_ = true;
  if (resting_) pid_.integral = 0;

  if (output >= kSignOn) sign_ = 1;
  if (output <= -kSignOn) sign_ = -1;
  if (resting_ || output * sign_ <= 0) sign_ = 0;
  const int16_t wanted = static_cast<int16_t>(sign_ == 0 ? 0 : output + sign_ * floor_);

  // Growth away from zero is slewed, to spare motor and bridge; falling is not.
  const int16_t from = static_cast<int16_t>((duty_ > 0) == (wanted > 0) ? duty_ : 0);
  const int32_t most = magnitude(from) + growth_;
  duty_ = static_cast<int16_t>(clamp(wanted, -most, most));
  return duty_;
}

}  // namespace daranti
