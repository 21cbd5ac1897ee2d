#include "blade.h"

namespace daranti {

using protocol::Param;

namespace {
constexpr uint16_t kTicksPerSecond = 1000 / kTickMs;
constexpr uint16_t kTenths = 10;      // of a second: how long pulses are counted
constexpr uint16_t kLeastPulses = 2;  // a single one is no turning; slow sensors are counted longer

uint16_t later(uint16_t ticks) {
  return ticks == UINT16_MAX ? ticks : static_cast<uint16_t>(ticks + 1);
}
}  // namespace

void Blade::configure(const Params &params) {
  rest_ = static_cast<uint16_t>(params[Param::blade_rest] / kTickMs);
  spin_ = static_cast<uint16_t>(params[Param::blade_spin_time] / kTickMs);
  // In as many whole ticks as these pulses take at blade_turn_min a faster sensor gives no fewer.
  const uint16_t rate = static_cast<uint16_t>(params[Param::blade_turn_min]);
  const uint16_t least = rate / kTenths;
  turn_min_ = least < kLeastPulses ? kLeastPulses : least;
  window_ = rate == 0 ? uint16_t{0}
                      : static_cast<uint16_t>((turn_min_ * kTicksPerSecond + rate - 1) / rate);
  // The window in which the blade starts or stops tells of neither; the next does.
  const uint16_t told = static_cast<uint16_t>(2 * window_);
  if (spin_ < told) spin_ = told;
}

void Blade::request(bool wanted) {
  if (!wanted) fresh_ = true;
  wanted_ = wanted && fresh_;
}

void Blade::set(bool on) {
  if (on == on_) return;
  on_ = on;
  since_ = 0;
  if (!on) off_ = 0;
}

bool Blade::step(bool permitted, uint16_t turns) {
  since_ = later(since_);
  if (!on_) off_ = later(off_);
  if (++counted_ >= window_) {
    counted_ = 0;
    turning_ = static_cast<uint16_t>(turns - last_turns_) >= turn_min_;
    last_turns_ = turns;
  }
  set(permitted && wanted_ && (on_ || off_ >= rest_));
  return on_;
}

void Blade::release() {
  set(false);
  wanted_ = false;
  fresh_ = false;
}

}  // namespace daranti
