// The whole controller's fuzz target: any bytes, any messages and any sensors, in any order. What
// is not live drives nothing, no blade turns in reverse, no parameter leaves its range, and a
// machine that nobody speaks to stops.
#include <cstdio>
#include <cstdlib>

#include "../firmware/test/test_core/fake_board.h"
#include "controller.h"

namespace {

using namespace daranti;

void demand(bool fact, const char *what) {
  if (fact) return;
  fprintf(stderr, "%s\n", what);
  abort();
}

// Reads the input; zeros behind its end.
class Input {
 public:
  Input(const uint8_t *data, size_t size) : at_(data), end_(data + size) {}
  bool empty() const { return at_ == end_; }
  uint8_t u8() { return empty() ? uint8_t{0} : *at_++; }
  uint16_t u16() {
    const uint16_t low = u8();
    return static_cast<uint16_t>(low | u8() << 8);
  }
  std::vector<uint8_t> bytes(size_t count) {
    std::vector<uint8_t> out(count);
    for (uint8_t &byte : out) byte = u8();
    return out;
  }

 private:
  const uint8_t *at_;
  const uint8_t *end_;
};

bool is_off(const FakeBoard &board) {
  for (const uint8_t pin : {3, 9, 10, 11}) {
    if (board.pwm[pin] != 0) return false;
  }
  for (const uint8_t pin : {4, 5, 6, 7, 8}) {
    if (board.pin_out[pin]) return false;
  }
  return true;
}

void check(const FakeBoard &board, const Controller &controller, int unheard) {
  const Supervisor &supervisor = controller.supervisor();
  demand(supervisor.live() || is_off(board), "an output is on while SAFE or in FAULT");
  demand(supervisor.faults() == 0 || supervisor.state() == protocol::State::FAULT,
         "a fault does not hold the machine");
  demand(!board.estop_open || !supervisor.live(), "it runs with the e-stop open");
  const bool reverses = board.pwm[pins::kDriveLpwm] != 0 || board.pin_out[pins::kDriveIn2];
  demand(!board.pin_out[pins::kBlade] || !reverses, "the blade is on in reverse");
  demand(unheard < 50 || !supervisor.live(), "it runs though nobody speaks");
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    const ParamRange range = param_range(id);
    const int16_t value = controller.params().value(id);
    demand(value >= range.low && value <= range.high, "a parameter is out of its range");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  Input input(data, size);
  FakeBoard board;
  Controller controller;
  board.cause = input.u8();
  controller.boot(board);
  int unheard = 0;  // ticks since a message that could keep the link alive
  while (!input.empty()) {
    const uint8_t what = input.u8();
    switch (what % 8) {
      case 0:
        for (const uint8_t byte : input.bytes(what / 8)) board.input.push_back(byte);
        unheard = 0;
        break;
      case 1: {
        const uint8_t id = input.u8() % 16;
        const int8_t length = protocol::command_size(id);
        if (length >= 0) board.type(id, input.bytes(static_cast<size_t>(length)));
        unheard = 0;
        break;
      }
      case 2:
        board.type(protocol::Clear::kId);
        board.type(protocol::Arm::kId, {protocol::kVersion});
        unheard = 0;
        break;
      case 3:
        board.type(protocol::Drive::kId, input.bytes(protocol::Drive::kSize));
        unheard = 0;
        break;
      case 4:
        board.analog_in[what / 8 % kAnalogs] = input.u16() % (kAnalogMax + 1);
        break;
      case 5:
        board.analog_in[0] =
            static_cast<uint16_t>(board.analog_in[0] + input.u8() - 128) % (kAnalogMax + 1);
        break;
      case 6:
        board.pulses = static_cast<uint16_t>(board.pulses + input.u16());
        board.line_full = what & 8;
        break;
      default:
        board.estop_open = what & 8;
        break;
    }
    for (int ticks = input.u8() % 64; ticks >= 0; --ticks) {
      controller.tick(board);
      check(board, controller, unheard);
      ++unheard;
      board.clock_us += kTickUs;
    }
    board.output.clear();
    board.order.clear();
  }
  return 0;
}
