// The whole controller's fuzz target: any parameters within their ranges, any bytes, any messages
// and any sensors, in any order. What is not live drives nothing, nothing is live without an ARM
// that was granted, a STOP is obeyed in its tick, no blade turns in reverse, no duty passes its
// limit, no parameter leaves its range, and a machine that nobody speaks to stops.
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "controller.h"
#include "fake_board.h"

namespace {

using namespace daranti;
using protocol::Param;

void demand(bool fact, const char *what) {
  if (fact) return;
  fprintf(stderr, "%s\n", what);
  abort();
}

// Of all inputs: facts about a machine that is never live hold of themselves.
struct Tally {
  long ticks = 0, live = 0, reverse = 0, blade = 0;
  ~Tally() {
    printf("live in %ld of %ld ticks, %ld in reverse, %ld with the blade on\n", live, ticks,
           reverse, blade);
  }
} tally;

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
  uint64_t u64() {
    uint64_t out = 0;
    for (int i = 0; i < 8; ++i) out = out << 8 | u8();
    return out;
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

// Numbers that depend on a seed alone (Marsaglia's xorshift, 2003).
class Draw {
 public:
  explicit Draw(uint64_t seed) : state_(seed | 1) {}
  uint64_t operator()() {
    state_ ^= state_ << 13;
    state_ ^= state_ >> 7;
    state_ ^= state_ << 17;
    return state_ >> 11;
  }
  int16_t among(int32_t low, int32_t high) {
    return static_cast<int16_t>(low + static_cast<int32_t>((*this)() % (high - low + 1)));
  }

 private:
  uint64_t state_;
};

// Each parameter at an end of its range, at its default or anywhere, and of most machines only what
// a machine that is set up may have.
Params drawn(Draw &draw) {
  Params params;
  const auto set = [&params](Param param, int32_t value) {
    const ParamRange range = param_range(static_cast<uint8_t>(param));
    params.set(static_cast<uint8_t>(param),
               static_cast<int16_t>(std::clamp<int32_t>(value, range.low, range.high)));
  };
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    const ParamRange range = param_range(id);
    const int16_t values[] = {range.low, range.high, range.initial,
                              draw.among(range.low, range.high)};
    params.set(id, values[draw() % 4]);
  }
  if (draw() % 8 == 0) return params;
  struct Bridge {
    Param driver, most, mean, zero, scale;
  };
  for (const Bridge &each :
       {Bridge{Param::steer_driver, Param::steer_current_max, Param::steer_current_cont,
               Param::steer_current_zero, Param::steer_current_scale},
        Bridge{Param::drive_driver, Param::drive_current_max, Param::drive_current_cont,
               Param::drive_current_zero, Param::drive_current_scale}}) {
    set(each.driver, draw.among(1, 3));
    const auto style = static_cast<BridgeStyle>(params[each.driver]);
    set(each.most, std::min(params[each.most], bridge_peak(style)));
    set(each.mean, std::min(params[each.mean], bridge_rating(style)));
    Current sensor;
    sensor.configure(params[each.zero], params[each.scale]);
    if (!sensor.shows(params[each.most])) set(each.scale, 0);
  }
  const auto steers = static_cast<BridgeStyle>(params[Param::steer_driver]);
  set(Param::steer_pwm_freq, std::min(params[Param::steer_pwm_freq], bridge_fastest(steers)));
  set(Param::steer_duty_max,
      std::max<int16_t>(params[Param::steer_duty_max],
                        static_cast<int16_t>(params[Param::steer_min_duty] + 40)));
  set(Param::battery_scale, std::max<int16_t>(params[Param::battery_scale], 8000));
  set(Param::battery_high,
      std::min<int16_t>(params[Param::battery_high], params[Param::battery_scale] / 50 * 49));
  if (params[Param::battery_low] >= params[Param::battery_high]) set(Param::battery_low, 5000);
  if (params[Param::hall_per_metre] != 0) {
    set(Param::hall_per_metre, std::max<int16_t>(params[Param::hall_per_metre], 100));
  }
  int16_t points[3] = {draw.among(0, 10230), draw.among(0, 10230), draw.among(0, 10230)};
  std::sort(points, points + 3);
  if (draw() % 2 == 0) std::swap(points[0], points[2]);
  const bool wide = abs(points[0] - points[1]) * 10 > params[Param::angle_left] &&
                    abs(points[2] - points[1]) * 10 > -params[Param::angle_right];
  const int16_t usual[3] = {7370, 5120, 2870};
  const int16_t *taken = wide ? points : usual;
  if (!wide) set(Param::angle_left, 1000), set(Param::angle_right, -1000);
  set(Param::pot_left, taken[0]);
  set(Param::pot_centre, taken[1]);
  set(Param::pot_right, taken[2]);
  return params;
}

// Sensors with which the machine arms: straight ahead or near it, half a battery, no currents.
void rest(FakeBoard &board, const Params &params) {
  const auto of_5v = [](double volt) { return static_cast<uint16_t>(volt / 5.0 * kAnalogMax); };
  const int32_t low = params[Param::pot_low] * 16 + 32, high = params[Param::pot_high] * 16 - 32;
  const int32_t centre = params[Param::pot_centre] * 8 / 5;
  board.analog_in[0] = static_cast<uint16_t>(std::clamp(centre, low, high));
  const double battery = (params[Param::battery_low] + params[Param::battery_high]) / 2.0;
  board.analog_in[1] = of_5v(std::min(5.0, 5.0 * battery / params[Param::battery_scale]));
  board.analog_in[2] = of_5v(params[Param::steer_current_zero] / 1000.0);
  board.analog_in[3] = of_5v(params[Param::drive_current_zero] / 1000.0);
  board.set_estop(0.88);
}

// From SAFE or FAULT to ARMED, where nothing stands against it, and a DRIVE that lets the blade on.
void arm(FakeBoard &board) {
  board.type(protocol::Drive::kId, {0, 0, 0, 0, 0});
  board.type(protocol::Clear::kId);
  board.type(protocol::Arm::kId, {protocol::kVersion});
  board.type(protocol::Drive::kId, {0, 0, 0, 0, 0});
}

bool is_off(const FakeBoard &board) {
  for (const BridgeWires &wires : {board.steer, board.drive}) {
    if (wires.pwm != 0 || wires.lpwm != 0 || wires.in1 || wires.in2) return false;
  }
  return !board.blade;
}

// Whether an ARM was granted in what the firmware sent.
bool granted(FakeBoard &board) {
  for (const Answer &answer : board.answers(true)) {
    const bool of_arm = answer.id == protocol::Ack::kId && answer.payload[0] == protocol::Arm::kId;
    if (of_arm && answer.payload[2] == static_cast<uint8_t>(protocol::Result::OK)) return true;
  }
  return false;
}

struct Told {
  int unheard = 0;  // ticks since a message that could keep the link alive
  bool stop = false;
  bool was_live = false;
};

void check(FakeBoard &board, const Controller &controller, const Told &told) {
  const Supervisor &supervisor = controller.supervisor();
  const Params &params = controller.params();
  const bool live = supervisor.live();
  demand(live || is_off(board), "an output is on while SAFE or in FAULT");
  demand(supervisor.faults() == 0 || supervisor.state() == protocol::State::FAULT,
         "a fault does not hold the machine");
  demand(!board.loop_open || !live, "it runs with the e-stop open");
  demand(told.unheard < 50 || !live, "it runs though nobody speaks");
  demand(!told.stop || !live, "a STOP is not obeyed in its tick");
  demand(!live || told.was_live || board.line_full || granted(board), "it runs without an ARM");
  demand(!live || (params[Param::steer_driver] != 0 && params[Param::drive_driver] != 0),
         "it runs with a bridge that is not named");
  for (const BridgeWires &wires : {board.steer, board.drive}) {
    demand(wires.pwm == 0 || wires.lpwm == 0, "a bridge is driven both ways");
    demand(!wires.in1 || !wires.in2, "both inputs are high");
  }
  // Of a VNH5019 the longest duty is made a full one (bridge_gap).
  if (static_cast<BridgeStyle>(params[Param::steer_driver]) != BridgeStyle::kVnh5019) {
    const int16_t most = std::max(params[Param::steer_duty_max], params[Param::ident_duty_max]);
    demand(std::max(board.steer.pwm, board.steer.lpwm) <= most, "a duty beyond its limit");
  }
  const bool reverses = board.drive.lpwm != 0 || board.drive.in2;
  demand(!board.blade || !reverses, "the blade is on in reverse");
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    const ParamRange range = param_range(id);
    const int16_t value = params.value(id);
    demand(value >= range.low && value <= range.high, "a parameter is out of its range");
  }
  ++tally.ticks;
  tally.live += live;
  tally.reverse += reverses;
  tally.blade += board.blade;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  Input input(data, size);
  FakeBoard board;
  Draw draw(input.u64());
  Params params = drawn(draw);
  params.begin_save();
  while (params.saving()) params.step_save(board);
  rest(board, params);
  board.cause = draw() % 4 == 0 ? static_cast<uint8_t>(draw()) : uint8_t{1};
  Controller controller;
  controller.boot(board);
  Told told;
  if (draw() % 4 != 0) arm(board);
  while (!input.empty()) {
    const uint8_t what = input.u8();
    told.stop = false;
    switch (what % 8) {
      case 0:
        for (const uint8_t byte : input.bytes(what / 8)) board.input.push_back(byte);
        told.unheard = 0;
        break;
      case 1: {
        const uint8_t id = input.u8() % 16;
        const int8_t length = protocol::command_size(id);
        if (length >= 0) board.type(id, input.bytes(static_cast<size_t>(length)));
        told.stop = id == protocol::Stop::kId;
        told.unheard = 0;
        break;
      }
      case 2:
        if (what & 8) rest(board, controller.params());
        arm(board);
        told.unheard = 0;
        break;
      case 3:
        board.type(protocol::Drive::kId, input.bytes(protocol::Drive::kSize));
        told.unheard = 0;
        break;
      case 4:
        board.analog_in[what / 8 % kAnalogs] = input.u16() % (kAnalogMax + 1);
        break;
      case 5:
        board.analog_in[0] =
            static_cast<uint16_t>(board.analog_in[0] + input.u8() - 128) % (kAnalogMax + 1);
        break;
      case 6: {
        const uint8_t fell = input.u8();
        board.wheel = static_cast<uint16_t>(board.wheel + fell);
        board.way = static_cast<uint16_t>(board.way + (what & 16 ? fell : -fell));
        board.blade_turns = static_cast<uint16_t>(board.blade_turns + input.u8());
        board.line_full = what & 8;
        break;
      }
      default:
        board.loop_open = (what & 0x38) == 0;
        break;
    }
    for (int ticks = input.u8() % 64; ticks >= 0; --ticks) {
      controller.tick(board);
      check(board, controller, told);
      ++told.unheard;
      told.stop = false;
      told.was_live = controller.supervisor().live();
      board.clock_us += kTickUs;
      board.output.clear();
    }
  }
  return 0;
}
