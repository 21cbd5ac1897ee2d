#include "blade.h"

namespace daranti {

using protocol::Param;

namespace {
constexpr uint8_t kWindow = 20;  // ticks: 100 ms
constexpr int16_t kWindowsPerSecond = 1000 / (kWindow * kTickMs);

uint16_t later(uint16_t ticks) {
  return ticks == UINT16_MAX ? ticks : static_cast<uint16_t>(ticks + 1);
}
}  // namespace

void Blade::configure(const Params &params) {
  rest_ = static_cast<uint16_t>(params[Param::blade_rest] / kTickMs);
  spin_ = static_cast<uint16_t>(params[Param::blade_spin_time] / kTickMs);
  const int16_t turn_min = params[Param::blade_turn_min];
  turn_min_ = static_cast<uint16_t>((turn_min + kWindowsPerSecond - 1) / kWindowsPerSecond);
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
  if (++window_ == kWindow) {
    window_ = 0;
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
