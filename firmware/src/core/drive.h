// Wheel speed from hall pulses, and from speed setpoint to drive duty.
#pragma once
#include <stdint.h>

#include "fixed.h"
#include "params.h"

namespace daranti {

// Speed and distance from a wheel's pulses. Whether the wheel turns forward or backward is told by
// a second sensor, or taken from the duty's sign where there is none. With two, a wheel that rocks
// on an edge stands, as far as speed goes.
class Hall {
 public:
  void configure(const Params &params);
  // One tick. pulses: counters modulo 65536; duty, setpoint (mm/s): those that were applied.
  void step(const Pulses &pulses, int16_t duty, int16_t setpoint);
  // mm/s; kNone where no sensor is configured.
  int16_t speed() const { return speed_; }
  // mm, signed, since boot; wraps.
  int32_t distance() const { return distance_; }
  // Driven without a pulse for 0.25 m of the setpoint or 0.5 m of the duty, or for 0.9 s since the
  // last one where the machine had broken away (for that it may take longer); always two were due.
  bool lost() const;
  // Driven from a stand, and two pulses were due: it takes more to break away.
  bool stuck() const { return per_metre_ != 0 && !rolls_ && awaited_ >= two_pulses_; }
  // Whether it is known which way it goes: by two sensors, or since it has broken away. A machine
  // that rolls back before it climbs seems to go as it is driven, and must not be braked for it.
  bool directed() const { return two_ || rolls_; }
  // Counts more than a machine can drive: noise, or a wrong hall_per_metre.
  // By the first sensor alone: with two, noise on it goes to and fro, and comes nowhere.
  bool noisy() const { return noisy_; }
  // Turns faster than `asked` (mm/s) and the parameter speed_excess allow.
  bool fast(int16_t asked) const {
    return per_metre_ != 0 && magnitude(speed_) > magnitude(asked) + excess_;
  }
  // Has gone 0.15 m, and three pulses, against the direction asked; with two sensors only.
  bool wrong_way() const;
  // Whether the slowest speed that is judged, 0.1 m/s, gives a pulse a second: with fewer a machine
  // that drives seems to stand, and is driven harder. True where no sensor is configured.
  bool shows() const;

  static constexpr int16_t kNone = INT16_MIN;

 private:
  // One tick's pulses of the first sensor: whether they are more than a machine gives.
  void listen(uint16_t fell);

  int16_t per_metre_ = 0;  // 0.1 pulses/m; 0: no sensor
  int32_t one_ = 0;        // mm/s where a pulse comes in every tick
  int32_t distance_ = 0;
  int32_t remainder_ = 0;   // of a millimetre, in 1/per_metre_ mm, signed
  int32_t awaited_ = 0;     // mm/s times ticks that should have been travelled since the last pulse
  int32_t two_pulses_ = 0;  // of them
  int32_t pushed_ = 0;      // duty above the minimum times full_ times ticks since the last pulse
  int32_t push_lost_ = 0;   // of them, with which a machine on level ground comes 0.5 m
  int32_t against_ = 0;     // pulses gone against the direction asked, in mm times per_metre_
  int32_t wrong_way_ = 0;   // of them
  int32_t gone_ = 0;        // pulses since it is driven, in mm times per_metre_, up to wrong_way_
  int32_t impossible_ = 0;  // mm/s
  int16_t excess_ = 0;      // mm/s
  Pulses last_{0, 0, 0};
  uint16_t waited_ = 0;           // ticks in awaited_
  uint16_t still_ = UINT16_MAX;   // ticks since the last pulse that was way
  uint16_t silent_ = UINT16_MAX;  // since the last of two sensors, to and fro, too
  uint16_t interval_ = 0;         // ticks of way between the last two
  uint16_t since_ = UINT16_MAX;   // ticks since the first sensor's last pulse
  int16_t floor_ = 0;             // minimum duty
  int16_t full_ = 0;              // speed at full duty, mm/s
  int16_t speed_ = kNone;
  bool backward_ = false;  // as the last way went, or the last duty drove
  bool behind_ = false;    // the last edge has been crossed back
  bool noisy_ = false;
  bool two_ = false;    // sensors
  bool rolls_ = false;  // since it is driven, it has broken away
};

// Soft start, feed-forward, and, where a hall sensor is configured, a speed loop. Its integral is
// of what lacks to the speed that the machine's lag lets it have (a reference model: Åström and
// Murray, Feedback Systems, 2nd ed., 12.2).
class Drive {
 public:
  void configure(const Params &params);
  // One tick. target, measured: mm/s (measured may be Hall::kNone); battery: mV; stuck: it takes
  // more to break away. Returns the duty, -255..255, positive forward.
  int16_t step(int16_t target, int16_t measured, int16_t battery, bool stuck);
  // Whether a machine that goes at `measured` (mm/s) turns its motors faster than `duty` would, and
  // the same way: they must take current back to slow it. battery: mV.
  bool slows(int16_t duty, int16_t measured, int16_t battery) const;
  void release();
  // The ramped setpoint, mm/s; 0 while released.
  int16_t setpoint() const { return wanted_; }
  // The speed whose pulses are awaited, mm/s. A creep gives too few to be judged by, but one that
  // has come to the duty of the parameter speed_excess more speed on level ground is judged as the
  // slowest speed that is: a silent sensor would have it driven at full duty.
  int16_t awaited() const;
  // Once a tick where speed is known: what a sound machine may go at rises with the setpoint, and
  // falls as its lag lets it. One that is told to stand rolls on at first.
  void update_allowed();
  // That speed, mm/s, 0 or more.
  int16_t allowed() const { return static_cast<int16_t>(allowed_ >> 12); }

 private:
  // The battery's voltage (mV) that the duty is reckoned with: none below the parameter
  // battery_low. A torn wire reads 0 V, and until that is a fault (0.6 s) the machine would go at
  // full duty.
  int32_t supply(int16_t battery) const;

  int32_t forward_ = 0;   // duty per mm/s, 2^-16
  int32_t kp_ = 0;        // duty per mm/s, 2^-16
  int32_t ki_ = 0;        // duty per mm/s and tick, 2^-20
  int32_t integral_ = 0;  // duty, 2^-20
  int32_t setpoint_ = 0;  // mm/s, 1/16
  int32_t expected_ = 0;  // mm/s, 1/4096: what it should have come to by now
  int32_t allowed_ = 0;   // mm/s, 1/4096: what it may still go at
  int32_t follows_ = 0;   // share of what it lacks that it takes in a tick, 2^-14
  int16_t wanted_ = 0;    // setpoint_, mm/s
  int16_t limit_ = 0;     // mm/s
  int16_t ramp_ = 0;      // mm/s a tick, 1/16
  int16_t floor_ = 0;     // minimum duty
  int16_t beyond_ = 0;    // duty that makes the speed the parameter speed_excess higher
  int16_t nominal_ = 0;   // battery, mV; 0: no compensation
  int16_t lowest_ = 0;    // battery, mV
  bool hard_ = false;     // the last duty was of speed_excess more than was asked, or beyond it
};

}  // namespace daranti
