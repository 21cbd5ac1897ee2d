#include "controller.h"

#include "fixed.h"

namespace daranti {

using protocol::Param;
using protocol::Result;
using protocol::State;

namespace {

constexpr uint8_t kTelemetryTicks = 4;  // 50 Hz
constexpr uint8_t kFewCommands = 2;     // in a tick that has time for configure()

// What a channel measures: `scale` is what 5 V mean times 2^14 / kAnalogMax.
int16_t measured(const Board &board, Analog channel, int32_t scale) {
  return static_cast<int16_t>((board.analog(channel) * scale) >> 14);
}
constexpr int32_t kBatteryScale = 20020;  // 20000 mV: 1:4 divider
constexpr int32_t kCurrentScale = 5005;   // 5000 times 0.01 A: 100 mV/A

}  // namespace

void Controller::boot(Board &board) {
  params_bad_ = !params_.load(board);
  configure();
  steer_style_ = static_cast<BridgeStyle>(params_[Param::steer_driver]);
  drive_style_ = static_cast<BridgeStyle>(params_[Param::drive_driver]);
  board.set_pwm_frequency(static_cast<uint16_t>(params_[Param::steer_pwm_freq]),
                          static_cast<uint16_t>(params_[Param::drive_pwm_freq]));
  supervisor_.boot(board.reset_cause());
  off(board);
}

void Controller::configure() {
  unconfigured_ = false;
  pot_.configure(params_);
  steering_.configure(params_);
  drive_.configure(params_);
  hall_.configure(params_);
  supervisor_.recalibrated();
}

void Controller::tick(Board &board) {
  board.kick_watchdog();
  hil_ = false;
  Command command;
  uint8_t byte;
  uint8_t commands = 0;
  while (board.receive(&byte)) {
    if (!parser_.feed(byte, &command)) continue;
    take(board, command);
    ++commands;
  }
  // Full of divisions: it waits for a tick that a full line leaves time for, and ARM waits for it.
  if (unconfigured_ && commands <= kFewCommands) configure();
  const Params::Saving saving = params_.step_save(board);
  if (saving == Params::Saving::kDone || saving == Params::Saving::kFailed) {
    const bool done = saving == Params::Saving::kDone;
    params_bad_ = !done;
    acknowledge(board, save_request_, done ? Result::OK : Result::STORE_FAILED);
  }
  observe(board);
  actuate(board);
  show_state(board);
  report(board);
  ++beat_;
}

void Controller::take(Board &board, const Command &command) {
  using namespace protocol;
  last_seq_ = command.seq;
  const bool idle = !supervisor_.live() && !params_.saving();
  switch (command.id) {
    case Hello::kId:
      answer(board,
             Version{kVersion, kFirmwareMajor, kFirmwareMinor, board.build(), board.reset_cause()});
      break;
    case Arm::kId: {
      const Arm arm = Arm::read(command.payload);
      const bool still = asked_.speed == 0 && !params_.saving() && !unconfigured_;
      const Result result = supervisor_.arm(arm.protocol_version, still);
      if (result == Result::OK) asked_ = Asked{};
      acknowledge(board, command, result);
      break;
    }
    case Stop::kId:
      supervisor_.stop();
      break;
    case Clear::kId:
      acknowledge(board, command, supervisor_.clear());
      break;
    case protocol::Drive::kId: {
      const auto drive = protocol::Drive::read(command.payload);
      asked_ = Asked{};
      asked_.steer = drive.steer;
      asked_.speed = drive.speed;
      asked_.blade = drive.blade != 0;
      ident_used_ = 0;
      supervisor_.command(drive.speed != 0);
      break;
    }
    case Ident::kId:
      acknowledge(board, command, take_ident(Ident::read(command.payload)));
      break;
    case ParamGet::kId: {
      const ParamGet get = ParamGet::read(command.payload);
      if (get.param < kParams) {
        answer(board, ParamValue{get.param, params_.value(get.param)});
      } else {
        acknowledge(board, command, Result::UNKNOWN);
      }
      break;
    }
    case ParamSet::kId: {
      const ParamSet set = ParamSet::read(command.payload);
      const Result result = idle ? params_.set(set.param, set.value) : Result::WRONG_STATE;
      if (result == Result::OK) unconfigured_ = true;
      acknowledge(board, command, result);
      break;
    }
    case ParamSave::kId:
      if (idle) {
        save_request_ = command;
        params_.begin_save();
      } else {
        acknowledge(board, command, Result::WRONG_STATE);
      }
      break;
    case ParamDefaults::kId:
      if (idle) {
        params_.set_defaults();
        unconfigured_ = true;
      }
      acknowledge(board, command, idle ? Result::OK : Result::WRONG_STATE);
      break;
    default:  // HilSensors: the parser lets no other id through
      hil_ = board.inject(HilSensors::read(command.payload));
      if (!hil_) acknowledge(board, command, Result::UNKNOWN);
      break;
  }
}

Result Controller::take_ident(const protocol::Ident &ident) {
  if (supervisor_.state() != State::ARMED) return Result::WRONG_STATE;
  if (magnitude(ident.duty) > params_[Param::ident_duty_max]) return Result::OUT_OF_RANGE;
  if (ident.duration > static_cast<uint16_t>(params_[Param::ident_time_max])) {
    return Result::OUT_OF_RANGE;
  }
  asked_ = Asked{};
  asked_.ident = true;
  asked_.duty = ident.duty;
  asked_.ident_left = static_cast<uint16_t>(ident.duration / kTickMs);
  supervisor_.command(false);
  return Result::OK;
}

void Controller::observe(Board &board) {
  Observation seen{};
  seen.pot = static_cast<int16_t>(board.analog(Analog::kPot));
  // Beyond its range the potentiometer says nothing; two ticks later the supervisor says so.
  if (seen.pot >= params_[Param::pot_low] * 16 && seen.pot <= params_[Param::pot_high] * 16 &&
      pot_.calibrated()) {
    angle_ = pot_.angle(seen.pot);
  }
  hall_.step(board.hall_pulses(), drive_duty_, drive_.setpoint());
  battery_ = measured(board, Analog::kBattery, kBatteryScale);
  seen.angle = angle_;
  seen.battery = battery_;
  seen.steer_current = measured(board, Analog::kSteerCurrent, kCurrentScale);
  seen.drive_current = measured(board, Analog::kDriveCurrent, kCurrentScale);
  seen.estop_open = board.pin(pins::kEstop);
  seen.hall_silent = hall_.lost();
  seen.params_bad = params_bad_ || !pot_.calibrated();
  seen.ident_limit = ident_limit_;
  seen.steer_duty = steer_duty_;
  ident_limit_ = false;
  supervisor_.watch(params_, seen);
}

int16_t Controller::steer() {
  if (!asked_.ident) return steering_.step(asked_.steer, angle_);
  steering_.release();
  if (asked_.ident_left == 0 || asked_.duty == 0) return 0;
  --asked_.ident_left;
  ++ident_used_;
  const int16_t limit = params_[Param::ident_angle_max];
  const bool outward = (angle_ > limit && asked_.duty > 0) || (angle_ < -limit && asked_.duty < 0);
  if (outward || ident_used_ > static_cast<uint16_t>(params_[Param::ident_time_max]) / kTickMs) {
    ident_limit_ = true;
    return 0;
  }
  return asked_.duty;
}

void Controller::actuate(Board &board) {
  if (!supervisor_.live()) {
    off(board);
    return;
  }
  steer_duty_ = steer();
  drive_duty_ = drive_.step(asked_.speed, hall_.speed(), battery_);
  const bool rolls_back = hall_.speed() < 0 && hall_.speed() != Hall::kNone;
  blade_ = asked_.blade && asked_.speed >= 0 && drive_.setpoint() >= 0 && !rolls_back;
  drive_bridge(board, kSteerBridge, steer_style_, steer_duty_);
  // A machine that has driven and is told to stand must stand on a slope, too.
  if (drive_.setpoint() != 0) driven_ = true;
  if (asked_.ident) driven_ = false;
  const Idle idle = driven_ && drive_.setpoint() == 0 ? Idle::kBrake : Idle::kCoast;
  drive_bridge(board, kDriveBridge, drive_style_, drive_duty_, idle);
  board.set_pin(pins::kBlade, blade_);
}

void Controller::off(Board &board) {
  steering_.release();
  drive_.release();
  ident_used_ = 0;
  steer_duty_ = 0;
  drive_duty_ = 0;
  driven_ = false;
  blade_ = false;
  drive_bridge(board, kSteerBridge, steer_style_, 0);
  drive_bridge(board, kDriveBridge, drive_style_, 0);
  board.set_pin(pins::kBlade, false);
}

void Controller::report(Board &board) {
  if (hil_) answer(board, protocol::HilOutputs{steer_duty_, drive_duty_, blade_});
  if (beat_ % kTelemetryTicks != 0) return;
  protocol::Telemetry message{};
  message.time = board.time_us();
  message.state = static_cast<uint8_t>(supervisor_.state());
  message.faults = supervisor_.faults();
  message.setpoint = steering_.setpoint();
  message.angle = angle_;
  message.steer_duty = steer_duty_;
  message.drive_duty = drive_duty_;
  message.blade = blade_;
  message.speed = hall_.speed();
  message.distance = hall_.distance();
  message.battery = static_cast<uint16_t>(battery_);
  message.last_seq = last_seq_;
  message.frames_bad = parser_.bad();
  answer(board, message);
}

// SAFE blinks slowly, FAULT fast, live is on.
void Controller::show_state(Board &board) {
  const uint8_t half = supervisor_.state() == State::FAULT ? 16 : 128;
  board.set_pin(pins::kLed, supervisor_.live() || beat_ % (2 * half) < half);
}

void Controller::acknowledge(Board &board, const Command &command, Result result) {
  answer(board, protocol::Ack{command.id, command.seq, static_cast<uint8_t>(result)});
}

template <typename Message>
void Controller::answer(Board &board, const Message &message) {
  uint8_t payload[Message::kSize];
  message.write(payload);
  uint8_t frame[Message::kSize + kFrameOverhead];
  const uint8_t count = encode(Message::kId, sent_, payload, Message::kSize, frame);
  if (board.send(frame, count)) ++sent_;
}

}  // namespace daranti
