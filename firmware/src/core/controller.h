// The firmware: everything that happens in a tick. Reads no clock, does not block or allocate.
#pragma once
#include <stdint.h>

#include "blade.h"
#include "board.h"
#include "bridge.h"
#include "current.h"
#include "drive.h"
#include "fault_log.h"
#include "frame.h"
#include "params.h"
#include "steering.h"
#include "supervisor.h"

namespace daranti {

constexpr uint8_t kFirmwareMajor = 2;
constexpr uint8_t kFirmwareMinor = 1;

class Controller {
 public:
  // Once after reset, before the first tick: outputs off, parameters loaded.
  void boot(Board &board);
  // Every kTickUs.
  void tick(Board &board);

  const Params &params() const { return params_; }
  const Supervisor &supervisor() const { return supervisor_; }

 private:
  // What the latest DRIVE or IDENT asks for; forgotten when the machine is armed.
  struct Asked {
    int16_t steer = 0;        // centidegree
    int16_t speed = 0;        // mm/s
    bool ident = false;       // raw duty on the steering instead of `steer`
    int16_t duty = 0;         // for `ident`
    uint16_t ident_left = 0;  // ticks
  };

  static constexpr uint8_t kNoEntry = UINT8_MAX;

  // Whether it was taken: what is refused, old or repeated changes nothing.
  bool take(Board &board, const Command &command);
  bool fresh(uint8_t seq);
  protocol::Result take_ident(const Command &command);
  protocol::Result take_param_set(const protocol::ParamSet &set);
  void configure_steering();
  void configure_rest(Board &board);
  bool set_up() const;
  void observe(Board &board);
  void actuate(Board &board);
  int16_t steer();
  void off(Board &board);
  void report(Board &board);
  void show_state(Board &board);
  // Whether the result is OK.
  bool acknowledge(Board &board, const Command &command, protocol::Result result);
  void report_readings(Board &board);
  template <typename Message>
  void answer(Board &board, const Message &message);

  Params params_;
  FaultLog log_;
  Parser parser_;
  Supervisor supervisor_;
  Pot pot_;
  Steering steering_;
  Drive drive_;
  Hall hall_;
  Pulses pulses_{0, 0, 0};
  Asked asked_;
  Command save_request_{};  // answered when the save, or the clearing of the log, is done
  Blade blade_;
  Current steer_current_;
  Current drive_current_;
  BridgeStyle steer_style_ = BridgeStyle::kNotSet;
  BridgeStyle drive_style_ = BridgeStyle::kNotSet;
  uint8_t steer_gap_ = 0;  // bridge_gap() of either PWM
  uint8_t drive_gap_ = 0;
  uint8_t unconfigured_ = 0;       // parts that have not heard of changed parameters
  bool greeted_ = false;           // Hello was answered in this tick
  bool restored_ = false;          // ParamDefaults was answered in this tick
  uint8_t log_wanted_ = kNoEntry;  // index of the log's entry to be answered
  bool params_bad_ = false;
  bool ident_limit_ = false;
  bool hil_ = false;  // HilSensors came in this tick
  bool set_up_ = false;
  uint8_t sent_ = 0;  // sequence number of the next frame
  uint8_t last_seq_ = 0;
  uint8_t command_seq_ = 0;  // of the last ARM, DRIVE or IDENT taken
  uint16_t stale_ = 0;
  uint8_t beat_ = 0;         // ticks, modulo 256
  uint16_t ident_used_ = 0;  // ticks driven since identification began
  int16_t angle_ = 0;        // centidegree
  int16_t steer_duty_ = 0;
  int16_t drive_duty_ = 0;
  bool holds_ = false;         // no duty brakes: since the outputs came on, it has moved or must
  int16_t battery_ = 0;        // mV
  int32_t battery_scale_ = 0;  // mV per 1/16 count, 2^-14
};

}  // namespace daranti
