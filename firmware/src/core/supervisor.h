// What the machine may do: SAFE, ARMED, RUNNING or FAULT, and why.
//
// Faults latch in any state and put everything off; CLEAR forgets those whose cause is gone.
#pragma once
#include <stdint.h>

#include "params.h"
#include "protocol.h"

namespace daranti {

// What one tick sees of the machine.
struct Observation {
  int16_t pot;            // 1/16 counts
  int16_t angle;          // centidegree; meaningless with a pot fault
  int16_t battery;        // mV
  int16_t steer_current;  // 0.01 A
  int16_t drive_current;  // 0.01 A
  int16_t steer_mean;     // 0.01 A, over a second
  int16_t drive_mean;     // 0.01 A
  uint16_t estop;         // 1/16 counts of the loop
  bool estop_open;        // as the pin sees it now
  bool hall_silent;       // driven, yet the configured hall sensor shows nothing
  bool hall_noisy;        // counts more than the machine can drive
  bool wheel_fast;        // turns faster than asked
  bool wrong_way;         // turns against the direction asked
  bool blade_lost;        // switched on, not turning
  bool blade_stuck;       // switched off, turning
  bool params_bad;        // stored parameters corrupt or the calibration out of order
  bool ident_limit;       // identification reached a limit of its own
  int16_t steer_duty;     // applied during the last tick
};

// Fills while bad and drains while good, four times slower: a spike is forgiven, but what is bad
// for more than a fifth of the time adds up, however it is interrupted.
class Debounce {
 public:
  // True where this tick is bad and there have been `enough` of them; enough: 1..16000.
  bool step(bool bad, uint16_t enough) {
    const uint16_t full = static_cast<uint16_t>(enough * kFill);
    if (bad) {
      fill_ = static_cast<uint16_t>(full - fill_ > kFill ? fill_ + kFill : full);
    } else if (fill_ != 0) {
      --fill_;
    }
    return bad && fill_ == full;
  }

 private:
  static constexpr uint8_t kFill = 4;
  uint16_t fill_ = 0;
};

// Steering that moves although, against, or not at all as it is driven.
class MotionWatch {
 public:
  // One tick; returns the bits of POT_JUMP, POT_FROZEN, STEER_STALL and STEER_RUNAWAY that hold.
  uint32_t step(const Params &params, const Observation &seen);

  // Duty above the minimum with which every motor of the design moves: to break away it takes 90 at
  // most, and the default minimum is 53. A motor that gets less is not judged.
  static constexpr int16_t kDrivenHard = 40;

 private:
  int16_t last_angle_ = 0;
  int16_t anchor_ = 0;   // angle where the wheel last moved
  int16_t against_ = 0;  // centidegrees moved against the duty
  int16_t push_ = 0;     // duty above the minimum, signed, as a motor's speed follows it; 1/64
  int32_t way_ = 0;      // sum of push_ over the ticks in vain since then
  bool primed_ = false;
};

class Supervisor {
 public:
  // reset_cause: protocol::ResetCause. copy_bad: a stored copy of the parameters is damaged.
  void boot(uint8_t reset_cause, bool copy_bad);

  // Requests, in the order of arrival. A STOP wins over all that comes in the same tick.
  void stop();
  protocol::Result arm(uint8_t version, bool set_up, bool standstill_asked);
  protocol::Result clear();
  // The angle means something else from now on: its next change is no movement.
  void recalibrated() { motion_ = MotionWatch(); }
  // A fresh DRIVE or IDENT came: the link lives. moving: a speed other than zero is asked.
  void command(bool moving);

  // Once a tick, after the requests: watches the machine and the link.
  void watch(const Params &params, const Observation &seen);

  protocol::State state() const { return state_; }
  uint32_t faults() const { return faults_; }
  // Whether outputs may be on.
  bool live() const {
    return state_ == protocol::State::ARMED || state_ == protocol::State::RUNNING;
  }

 private:
  uint32_t conditions(const Params &params, const Observation &seen);

  protocol::State state_ = protocol::State::SAFE;
  uint32_t faults_ = 0;
  uint32_t active_ = 0;   // faults whose cause held at the last watch
  uint8_t quiet_ = 0;     // ticks since the last valid command
  bool stopped_ = false;  // STOP came since the last watch
  MotionWatch motion_;
  Debounce pot_open_, pot_short_, steer_current_, drive_current_, battery_low_, battery_high_;
  Debounce estop_short_, hall_noise_, wheel_fast_;
};

}  // namespace daranti
