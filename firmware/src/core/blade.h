// The blade's relay: when it may close, and whether the blade does what the relay says.
#pragma once
#include <stdint.h>

#include "params.h"

namespace daranti {

class Blade {
 public:
  void configure(const Params &params);
  // A fresh command came while armed: the blade runs only after one that did not ask for it.
  void request(bool wanted);
  // One tick. permitted: armed and not reversing; turns: the sensor's pulses, modulo 65536.
  // Returns whether the relay is closed.
  bool step(bool permitted, uint16_t turns);
  // Disarmed: off, and the next request must be a new one.
  void release();
  bool on() const { return on_; }

  // With a sensor only: switched on yet not turning, and turning although switched off.
  bool lost() const { return fitted() && on_ && !turning_ && since_ >= spin_; }
  bool stuck() const { return fitted() && !on_ && turning_ && since_ >= spin_; }

 private:
  bool fitted() const { return window_ != 0; }
  void set(bool on);

  uint16_t rest_ = 0;          // ticks that it stays off at least
  uint16_t spin_ = 0;          // ticks that it may take to start or stop, and to be seen to
  uint16_t turn_min_ = 0;      // pulses in a window while turning
  uint16_t window_ = 0;        // ticks in which pulses are counted; 0: no sensor
  uint16_t since_ = 0;         // ticks since the relay last changed, saturating
  uint16_t off_ = UINT16_MAX;  // ticks since it opened, saturating
  uint16_t last_turns_ = 0;
  uint16_t counted_ = 0;  // ticks into the window
  bool on_ = false;
  bool wanted_ = false;
  bool fresh_ = false;  // a command that did not ask for it has come since it was armed
  bool turning_ = false;
};

}  // namespace daranti
