#include "supervisor.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;
using protocol::Result;
using protocol::State;

namespace {

constexpr uint16_t ticks(uint16_t ms) { return ms / kTickMs; }

// The command was taken up to one tick after its last byte came: 245 + 5 ms.
constexpr uint8_t kLinkTicks = static_cast<uint8_t>(ticks(250) - 1);
constexpr uint16_t kPotTicks = 2;
constexpr uint16_t kCurrentTicks = ticks(50);      // longer than a motor's inrush behind the slew
constexpr uint16_t kBatteryLowTicks = ticks(600);  // longer than the sag of a start
constexpr uint16_t kBatteryHighTicks = ticks(100);
constexpr uint16_t kHallNoiseTicks = ticks(100);
constexpr uint16_t kWheelFastTicks = ticks(400);  // a hand's push or a pothole is shorter
// The e-stop's loop: 2.2 kOhm to 5 V, and 470 Ohm at the button's end. Closed it gives 0.88 V.
constexpr uint16_t kEstopShort = 102 * 16;  // 0.5 V: the wires touch, or the chassis
constexpr uint16_t kEstopOpen = 307 * 16;   // 1.5 V
constexpr int16_t kStillBand = 60;          // centidegree: more than the pot's noise
constexpr uint8_t kForget = 6;  // what was driven is forgotten while it is not: 64 ticks
constexpr int16_t kFullDuty = 255;
constexpr int16_t kLagMs = 100;     // the slowest motor's time constant; 107 in powers of two
constexpr int16_t kLeastMs = 50;    // of full speed, whatever stall_time is
constexpr int16_t kPushOne = 64;    // a count of duty
constexpr int16_t kRunaway = 1000;  // centidegree: more than a reversing motor coasts

}  // namespace

uint32_t MotionWatch::step(const Params &params, const Observation &seen) {
  if (!primed_) {
    last_angle_ = anchor_ = seen.angle;
    primed_ = true;
  }
  uint32_t found = 0;
  const int32_t moved = static_cast<int32_t>(seen.angle) - last_angle_;
  last_angle_ = seen.angle;
  // deg/s times ms is 0.1 centidegree.
  if (magnitude(moved) * 10 > static_cast<int32_t>(params[Param::steer_rate_max]) * kTickMs) {
    found |= protocol::POT_JUMP;
  }

  // A motor moves the faster the farther its duty is above the minimum, once it has come to speed:
  // what counts is the way that it should have turned meanwhile, so that full duty is judged
  // soonest, and the lag is waited for once and not in proportion. Back and forth is no way.
  const int16_t floor = params[Param::steer_min_duty];
  const int16_t effort = static_cast<int16_t>(magnitude(seen.steer_duty) - floor);
  const int16_t drive = effort < 0 ? int16_t{0} : effort;
  const int16_t lacking =
      static_cast<int16_t>((seen.steer_duty < 0 ? -drive : drive) * kPushOne - push_);
  push_ = static_cast<int16_t>(push_ + (lacking >> 5) + (lacking >> 6));
  if (magnitude(static_cast<int32_t>(seen.angle) - anchor_) > kStillBand) {
    anchor_ = seen.angle;
    way_ = 0;
  } else if (effort >= kDrivenHard) {
    way_ += push_;
  } else {
    way_ -= way_ >> kForget;
  }
  const int16_t stall = params[Param::stall_time];
  const int16_t after_lag = static_cast<int16_t>(stall - least(kLagMs, stall - kLeastMs));
  if (way_ != 0 &&
      magnitude(way_) / kPushOne * kTickMs >= after_lag * static_cast<int32_t>(kFullDuty - floor)) {
    const bool loaded = seen.steer_current >= params[Param::stall_current];
    found |= loaded ? protocol::STEER_STALL : protocol::POT_FROZEN;
    way_ = 0;
  }

  const int32_t along = seen.steer_duty < 0 ? -moved : moved;
  against_ = static_cast<int16_t>(seen.steer_duty == 0 ? 0 : clamp(against_ - along, 0, kRunaway));
  if (against_ == kRunaway) found |= protocol::STEER_RUNAWAY;
  return found;
}

void Supervisor::boot(uint8_t reset_cause, bool copy_bad) {
  constexpr uint8_t kWorst = protocol::BY_UNKNOWN | protocol::WHILE_ARMED;
  if (reset_cause & protocol::BY_BROWN_OUT) faults_ |= protocol::BROWN_OUT;
  if (reset_cause & protocol::BY_WATCHDOG) faults_ |= protocol::WATCHDOG;
  if ((reset_cause & kWorst) == kWorst) faults_ |= protocol::RESET_UNKNOWN;
  if (copy_bad) faults_ |= protocol::PARAMS_COPY;
  state_ = faults_ == 0 ? State::SAFE : State::FAULT;
}

void Supervisor::stop() {
  stopped_ = true;
  if (live()) state_ = State::SAFE;
}

Result Supervisor::arm(uint8_t version, bool set_up, bool standstill_asked) {
  if (version != protocol::kVersion) return Result::WRONG_VERSION;
  if (stopped_ || state_ != State::SAFE) return Result::WRONG_STATE;
  if (!set_up) return Result::NOT_SET_UP;
  if (!standstill_asked) return Result::NOT_PLAUSIBLE;
  state_ = State::ARMED;
  quiet_ = 0;
  return Result::OK;
}

Result Supervisor::clear() {
  faults_ &= active_;
  if (faults_ != 0) return Result::NOT_PLAUSIBLE;
  if (state_ == State::FAULT) state_ = State::SAFE;
  return Result::OK;
}

void Supervisor::command(bool moving) {
  quiet_ = 0;
  if (live()) state_ = moving ? State::RUNNING : State::ARMED;
}

uint32_t Supervisor::conditions(const Params &params, const Observation &seen) {
  uint32_t found = motion_.step(params, seen);
  const auto note = [&found](bool bad, uint32_t bit) {
    if (bad) found |= bit;
  };
  note(seen.estop_open || seen.estop > kEstopOpen, protocol::ESTOP_OPEN);
  note(estop_short_.step(seen.estop < kEstopShort, kPotTicks), protocol::ESTOP_SHORT);
  note(seen.params_bad, protocol::PARAMS_BAD);
  note(seen.hall_silent, protocol::HALL_LOST);
  note(hall_noise_.step(seen.hall_noisy, kHallNoiseTicks), protocol::HALL_NOISE);
  note(wheel_fast_.step(live() && seen.wheel_fast, kWheelFastTicks), protocol::WHEEL_RUNAWAY);
  note(live() && seen.wrong_way, protocol::WRONG_WAY);
  note(seen.blade_lost, protocol::BLADE_LOST);
  note(seen.blade_stuck, protocol::BLADE_STUCK);
  note(seen.ident_limit, protocol::IDENT_LIMIT);
  note(pot_open_.step(seen.pot > params[Param::pot_high] * 16, kPotTicks), protocol::POT_OPEN);
  note(pot_short_.step(seen.pot < params[Param::pot_low] * 16, kPotTicks), protocol::POT_SHORT);
  note(steer_current_.step(seen.steer_current > params[Param::steer_current_max], kCurrentTicks),
       protocol::STEER_OVERCURRENT);
  note(drive_current_.step(seen.drive_current > params[Param::drive_current_max], kCurrentTicks),
       protocol::DRIVE_OVERCURRENT);
  note(seen.steer_mean > params[Param::steer_current_cont], protocol::STEER_OVERCURRENT);
  note(seen.drive_mean > params[Param::drive_current_cont], protocol::DRIVE_OVERCURRENT);
  note(battery_low_.step(seen.battery < params[Param::battery_low], kBatteryLowTicks),
       protocol::BATTERY_LOW);
  note(battery_high_.step(seen.battery > params[Param::battery_high], kBatteryHighTicks),
       protocol::BATTERY_HIGH);
  if (live()) {
    if (quiet_ < kLinkTicks) {
      ++quiet_;
    } else {
      found |= protocol::LINK_LOST;
    }
  }
  return found;
}

void Supervisor::watch(const Params &params, const Observation &seen) {
  active_ = conditions(params, seen);
  faults_ |= active_;
  if (faults_ != 0) state_ = State::FAULT;
  stopped_ = false;
}

}  // namespace daranti
