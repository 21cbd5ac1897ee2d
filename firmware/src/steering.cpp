#include "steering.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;

namespace {
constexpr int32_t kRestRate = 300 * int32_t{16};  // 3 deg/s: slower than this may come to rest
constexpr int16_t kSignOn = 3;  // duty at which the minimum duty takes a direction
}  // namespace

bool calibrated(const Params& params) {
  constexpr int16_t kApart = 200;  // 0.1 counts
  const int16_t left =
      saturate16(static_cast<int32_t>(params[Param::pot_left]) - params[Param::pot_centre]);
  const int16_t right =
      saturate16(static_cast<int32_t>(params[Param::pot_right]) - params[Param::pot_centre]);
  return (left >= kApart && right <= -kApart) || (left <= -kApart && right >= kApart);
}

int16_t pot_to_angle(const Params& params, int16_t pot) {
  // In 1/160 counts, the common unit of pot (1/16) and the parameters (1/10).
  const int32_t centre = params[Param::pot_centre] * int32_t{16};
  const int32_t off = pot * int32_t{10} - centre;
  const int32_t left = params[Param::pot_left] * int32_t{16} - centre;
  const bool to_left = (off > 0) == (left > 0);
  const int32_t span = to_left ? left : params[Param::pot_right] * int32_t{16} - centre;
  const int16_t angle = params[to_left ? Param::angle_left : Param::angle_right];
  const int32_t product = off * angle;
  return saturate16(span < 0 ? divide(-product, -span) : divide(product, span));
}

void Steering::release() {
  released_ = true;
  duty_ = 0;
}

int16_t Steering::step(const Params& params, int16_t target, int16_t angle) {
  if (released_) {
    pid_ = PidState{};
    setpoint_ = angle;
    resting_ = true;
    released_ = false;
    sign_ = 0;
  }
  const int16_t limit = params[Param::steer_limit];
  const int32_t slew = divide(params[Param::steer_slew] * int32_t{10} * kTickMs, 1000);
  setpoint_ = static_cast<int16_t>(approach(setpoint_, clamp(target, -limit, limit), slew));

  const int16_t floor = params[Param::steer_min_duty];
  const int16_t ceiling = params[Param::steer_duty_max];
  const PidGains gains{params[Param::steer_kp], params[Param::steer_ki], params[Param::steer_kd],
                       params[Param::steer_d_filter]};
  const int16_t headroom = static_cast<int16_t>(ceiling > floor ? ceiling - floor : 0);
  const int16_t output = pid_step(pid_, gains, setpoint_, angle, headroom, kTickMs);

  const int32_t error = magnitude(static_cast<int32_t>(setpoint_) - angle);
  const int16_t band = params[Param::steer_deadband];
  if (error > band) resting_ = false;
  if (error * 2 <= band && magnitude(pid_.rate) < kRestRate) resting_ = true;
  if (resting_) pid_.integral = 0;

  if (output >= kSignOn) sign_ = 1;
  if (output <= -kSignOn) sign_ = -1;
  if (resting_ || output * sign_ <= 0) sign_ = 0;
  const int16_t wanted = static_cast<int16_t>(sign_ == 0 ? 0 : output + sign_ * floor);

  // Growth away from zero is slewed, to spare motor and bridge; falling is not.
  const int32_t growth =
      divide(static_cast<int32_t>(params[Param::steer_duty_slew]) * kTickMs, 1000);
  const int16_t from = static_cast<int16_t>((duty_ > 0) == (wanted > 0) ? duty_ : 0);
  const int32_t most = magnitude(from) + growth;
  duty_ = static_cast<int16_t>(clamp(wanted, -most, most));
  return duty_;
}

}  // namespace daranti
