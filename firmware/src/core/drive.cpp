#include "drive.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;

namespace {
constexpr uint16_t kStandsTicks = 1000 / kTickMs;  // no pulse for so long: standing
constexpr int32_t kTicksPerSecond = 1000 / kTickMs;
constexpr int32_t kLostDistance = int32_t{250} * kTicksPerSecond;  // mm/s times ticks
constexpr uint16_t kLostTicks = 900 / kTickMs;
constexpr int32_t kPushLost = 500;                                      // mm
constexpr int32_t kBreakAway = (int32_t{150} << 20) / kTicksPerSecond;  // duty a tick, 2^-20
constexpr int32_t kWrongWay = 150;  // mm: a start on a slope of five degrees rolls back less
constexpr int32_t kPulse = 10000;   // mm times per_metre
constexpr int16_t kSlow = 100;      // mm/s: a machine in mud may stand still at less
// In kStandsTicks a pulse at kSlow, 0.1 pulses/m.
constexpr int16_t kLeastPerMetre =
    static_cast<int16_t>(kPulse * kTicksPerSecond / kStandsTicks / kSlow);
constexpr int32_t kErrorMax = 10000;  // mm/s, keeps the products within 32 bits
constexpr int32_t kFreshMax = 1000;   // pulses in a tick
constexpr int32_t kFull = int32_t{255} << 16;
constexpr int32_t kHalf = int32_t{1} << 15;
constexpr int32_t kWhole = int32_t{1} << 14;  // the share that is all of it
}  // namespace

void Hall::configure(const Params &params) {
  per_metre_ = params[Param::hall_per_metre];
  two_ = params[Param::hall_phases] == 2;
  excess_ = params[Param::speed_excess];
  impossible_ = 2 * int32_t{params[Param::speed_max]} + 1000;
  if (per_metre_ == 0) {
    speed_ = kNone;
    noisy_ = false;
    return;
  }
  // A pulse is 10000 / per_metre_ mm.
  one_ = divide(int32_t{10000} * 1000 / kTickMs, per_metre_);
  two_pulses_ = int32_t{20000} / per_metre_ * kTicksPerSecond;
  floor_ = params[Param::drive_min_duty];
  full_ = params[Param::speed_full];
  push_lost_ = kPushLost * kTicksPerSecond * (255 - floor_);
  wrong_way_ = clamp(kWrongWay * int32_t{per_metre_}, 3 * kPulse, INT32_MAX);
}

void Hall::step(const Pulses &pulses, int16_t duty, int16_t setpoint) {
  const uint16_t fell = static_cast<uint16_t>(pulses.wheel - last_.wheel);
  const int16_t way = static_cast<int16_t>(pulses.way - last_.way);
  last_ = pulses;
  if (per_metre_ == 0) return;
  listen(fell);
  if (silent_ != UINT16_MAX) ++silent_;
  if (still_ != UINT16_MAX) ++still_;
  uint16_t took = still_;
  int32_t come = fell;
  if (two_) {
    // The first pulse back is of the edge that gave the last one forward, and so is the next one
    // forward: no way lies between. What goes beyond is way.
    const int32_t ahead = (backward_ ? -int32_t{way} : way) - behind_;
    come = ahead > 0 ? ahead : 0;
    if (ahead < -1) {
      come = -1 - ahead;
      took = silent_;
      backward_ = !backward_;
    }
    behind_ = ahead == -1;
  } else if (duty != 0) {
    backward_ = duty < 0;
  }
  if (!two_ || setpoint == 0 || (way != 0 && (way < 0) == (setpoint < 0))) {
    against_ = 0;
  } else {
    against_ = least(against_ + magnitude(way) * kPulse, wrong_way_);
  }
  if (duty == 0 || come != 0) {
    // A machine that rolls back as it is driven gives pulses too, but ever more slowly. Its creep
    // before it was driven tells nothing, so two intervals count that were driven throughout.
    gone_ = duty == 0 ? 0 : least(gone_ + least(come, kFreshMax) * kPulse, wrong_way_);
    const bool faster = gone_ > 2 * kPulse && int32_t{took} * 5 < int32_t{interval_} * 4;
    rolls_ = duty != 0 && (rolls_ || faster || gone_ >= wrong_way_);
    awaited_ = 0;
    waited_ = 0;
    pushed_ = 0;
  } else if (magnitude(setpoint) >= kSlow) {
    awaited_ += magnitude(setpoint);
    const int32_t push = magnitude(duty) - floor_;
    if (push > 0) pushed_ = least(pushed_ + push * full_, push_lost_);
    ++waited_;
  }

  int32_t size = magnitude(speed_ == kNone ? 0 : speed_);
  if (come != 0) {
    // The first pulse after standing tells nothing about the time since the one before.
    size = took > kStandsTicks ? 0 : least(one_ * least(come, kFreshMax) / took, INT16_MAX);
    interval_ = took;
    still_ = 0;
  } else if (still_ >= kStandsTicks) {
    size = 0;
  } else if (size * still_ > one_) {
    size = one_ / still_;
  }
  if (way != 0) silent_ = 0;
  remainder_ += (two_ ? way : backward_ ? -come : come) * kPulse;
  const int32_t whole = remainder_ / per_metre_;
  remainder_ -= whole * per_metre_;
  // It wraps, as unsigned numbers may.
  distance_ = static_cast<int32_t>(static_cast<uint32_t>(distance_) + static_cast<uint32_t>(whole));
  speed_ = static_cast<int16_t>(backward_ ? -size : size);
}

void Hall::listen(uint16_t fell) {
  if (since_ != UINT16_MAX) ++since_;
  if (fell != 0) {
    noisy_ = one_ * least(fell, kFreshMax) > impossible_ * since_;
    since_ = 0;
  } else if (one_ <= impossible_ * since_) {
    noisy_ = false;  // a pulse that came now would be none
  }
}

bool Hall::shows() const { return per_metre_ == 0 || per_metre_ >= kLeastPerMetre; }

bool Hall::wrong_way() const { return per_metre_ != 0 && against_ >= wrong_way_; }

bool Hall::lost() const {
  if (per_metre_ == 0) return false;
  return awaited_ >= two_pulses_ &&
         (awaited_ >= kLostDistance || pushed_ >= push_lost_ || (rolls_ && waited_ >= kLostTicks));
}

void Drive::configure(const Params &params) {
  floor_ = params[Param::drive_min_duty];
  forward_ = divide((255 - floor_) * (int32_t{1} << 16), params[Param::speed_full]);
  kp_ = divide(params[Param::drive_kp] * (int32_t{1} << 16), 10000);
  ki_ = divide(params[Param::drive_ki] * (int32_t{1} << 14) * kTickMs, 156250);  // 1e7 / 2^6
  limit_ = params[Param::speed_max];
  // 16ths of a mm/s a tick are 2/25 of mm/s2, which 16 bits hold.
  static_assert(kTickMs * 16 * 25 == 2 * 1000, "of a tick");
  ramp_ = static_cast<int16_t>((2 * params[Param::drive_accel] + 25 / 2) / 25);
  follows_ = divide(kWhole * kTickMs, params[Param::drive_lag] + kTickMs);
  nominal_ = params[Param::battery_nominal];
  lowest_ = params[Param::battery_low];
  beyond_ = static_cast<int16_t>((params[Param::speed_excess] * forward_) >> 16);
}

bool Drive::slows(int16_t duty, int16_t measured, int16_t battery) const {
  if (measured == Hall::kNone || (duty > 0) != (measured > 0)) return false;
  const int32_t own = (least(magnitude(measured), kErrorMax) * forward_) >> 16;
  return nominal_ == 0 ? magnitude(duty) < own : magnitude(duty) * supply(battery) < own * nominal_;
}

int32_t Drive::supply(int16_t battery) const { return battery < lowest_ ? lowest_ : battery; }

int16_t Drive::awaited() const {
  const int16_t asked = setpoint();
  if (!hard_ || magnitude(asked) >= kSlow) return asked;
  return static_cast<int16_t>(asked < 0 ? -kSlow : kSlow);
}

void Drive::release() {
  hard_ = false;
  integral_ = 0;
  expected_ = 0;
  setpoint_ = 0;
  wanted_ = 0;
}

void Drive::update_allowed() {
  const int32_t asked = magnitude(setpoint_) << 8;
  const int32_t above = allowed_ - asked;
  allowed_ = above > 0 ? allowed_ - (((above >> 8) * follows_) >> 6) : asked;
}

int16_t Drive::step(int16_t target, int16_t measured, int16_t battery, bool stuck) {
  setpoint_ = approach(setpoint_, clamp(target, -limit_, limit_) * 16, ramp_);
  const int16_t wanted = static_cast<int16_t>(setpoint_ / 16);
  wanted_ = wanted;
  expected_ += (setpoint_ - expected_ / 256) * follows_ / (kWhole / 256);
  hard_ = false;
  if (wanted == 0) {
    integral_ = 0;
    expected_ = 0;
    return 0;
  }
  const bool backward = wanted < 0;
  int32_t size = least(((magnitude(wanted) * forward_ + kHalf) >> 16) + floor_, 255);
  if (nominal_ != 0) size = least(size * nominal_ / supply(battery), 255);
  int32_t duty = backward ? -size : size;
  if (measured != Hall::kNone) {
    // What the machine cannot have done yet winds nothing up: while it slowed, the integral let it
    // starve on the next bump, where a sensor without pulses counts as lost. One that stands
    // follows nothing.
    const int32_t lack = clamp(static_cast<int32_t>(wanted) - measured, -kErrorMax, kErrorMax);
    const int32_t behind = clamp(expected_ / 4096 - measured, -kErrorMax, kErrorMax);
    const int32_t error = measured == 0 ? lack : behind;
    // Never against the setpoint: plugging strains the gear.
    const int32_t sum = duty * 65536 + kp_ * lack + (integral_ >> 4);
    const int32_t output = backward ? clamp(sum, -kFull, 0) : clamp(sum, 0, kFull);
    const bool deeper = (sum > output && error > 0) || (sum < output && error < 0);
    // Uphill the integral alone takes seconds to the duty that breaks away. What it adds for that
    // ends where a machine on level ground, whose sensor says nothing, would run away with it.
    const bool more = stuck && magnitude(output) < (size + beyond_) * 65536;
    const int32_t extra = more ? (backward ? -kBreakAway : kBreakAway) : 0;
    if (!deeper) integral_ = clamp(integral_ + ki_ * error + extra, -16 * kFull, 16 * kFull);
    duty = (output + kHalf) >> 16;
    hard_ = magnitude(duty) >= size + beyond_;
  }
  return static_cast<int16_t>(duty);
}

}  // namespace daranti
