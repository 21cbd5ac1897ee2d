// The firmware: everything that happens in a tick. Reads no clock, does not block or allocate.
#pragma once
#include <stdint.h>

#include "board.h"
#include "bridge.h"
#include "drive.h"
#include "frame.h"
#include "params.h"
#include "steering.h"
#include "supervisor.h"

namespace daranti {

constexpr uint8_t kFirmwareMajor = 1;
constexpr uint8_t kFirmwareMinor = 0;

class Controller {
 public:
  // Once after reset, before the first tick: outputs off, parameters loaded.
  void boot(Board &board);
  // Every kTickUs.
  void tick(Board &board);

  const Params &params() const { return params_; }
  const Supervisor &supervisor() const { return supervisor_; }

 private:
  // The last command of its kind; forgotten when the outputs go off.
  struct Asked {
    int16_t steer = 0;  // centidegree
    int16_t speed = 0;  // mm/s
    bool blade = false;
    bool ident = false;       // raw duty on the steering instead of `steer`
    int16_t duty = 0;         // for `ident`
    uint16_t ident_left = 0;  // ticks
  };

  void take(Board &board, const Command &command);
  protocol::Result take_ident(const protocol::Ident &ident);
  protocol::Result take_param_set(const protocol::ParamSet &set);
  void configure();
  void observe(Board &board);
  void actuate(Board &board);
  int16_t steer();
  void off(Board &board);
  void report(Board &board);
  void show_state(Board &board);
  void acknowledge(Board &board, const Command &command, protocol::Result result);
  template <typename Message>
  void answer(Board &board, const Message &message);

  Params params_;
  Parser parser_;
  Supervisor supervisor_;
  Pot pot_;
  Steering steering_;
  Drive drive_;
  Hall hall_;
  Asked asked_;
  Command save_request_{};  // answered when the save is done
  BridgeStyle steer_style_ = BridgeStyle::kL298n;
  BridgeStyle drive_style_ = BridgeStyle::kL298n;
  bool unconfigured_ = false;  // parameters have changed since configure()
  bool params_bad_ = false;
  bool ident_limit_ = false;
  bool hil_ = false;  // HilSensors came in this tick
  bool blade_ = false;
  uint8_t sent_ = 0;  // sequence number of the next frame
  uint8_t last_seq_ = 0;
  uint8_t beat_ = 0;         // ticks, modulo 256
  uint16_t ident_used_ = 0;  // ticks driven since identification began
  int16_t angle_ = 0;        // centidegree
  int16_t steer_duty_ = 0;
  int16_t drive_duty_ = 0;
  bool driven_ = false;  // a speed was asked for since the outputs were last off
  int16_t battery_ = 0;  // mV
};

}  // namespace daranti
