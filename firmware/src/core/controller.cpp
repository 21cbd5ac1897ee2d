#include "controller.h"

#include "fixed.h"
#include "version.h"

namespace daranti {

using protocol::Param;
using protocol::Result;
using protocol::State;

namespace {

constexpr uint8_t kTelemetryTicks = 4;  // 50 Hz
constexpr uint8_t kFewCommands = 2;     // in a tick that has time to configure a part
constexpr uint8_t kParts = 2;

constexpr uint8_t kReadingsTicks = 32;   // 6 Hz
constexpr uint8_t kReadingsAt = 2;       // not in a tick with telemetry
constexpr int16_t kDriveFastest = 3922;  // Hz: what the drive's timer gives at most
constexpr uint8_t kNewest = 127;         // a sequence number further ahead is behind

}  // namespace

void Controller::boot(Board &board) {
  off(board);
  const Params::Loaded loaded = params_.load(board);
  params_bad_ = loaded == Params::Loaded::kDamaged;
  supervisor_.boot(board.reset_cause(), loaded == Params::Loaded::kOneCopy);
  log_.boot(board);
  configure_steering();
  configure_rest(board);
}

// Both only while the outputs are off, and in different ticks: they are full of divisions.
void Controller::configure_steering() {
  pot_.configure(params_);
  steering_.configure(params_);
  supervisor_.recalibrated();
}

void Controller::configure_rest(Board &board) {
  steer_style_ = static_cast<BridgeStyle>(params_[Param::steer_driver]);
  drive_style_ = static_cast<BridgeStyle>(params_[Param::drive_driver]);
  board.set_pwm_frequency(static_cast<uint16_t>(params_[Param::steer_pwm_freq]),
                          static_cast<uint16_t>(params_[Param::drive_pwm_freq]));
  steer_gap_ = bridge_gap(static_cast<uint16_t>(params_[Param::steer_pwm_freq]));
  drive_gap_ =
      bridge_gap(static_cast<uint16_t>(least(params_[Param::drive_pwm_freq], kDriveFastest)));
  battery_scale_ = divide(params_[Param::battery_scale] * (int32_t{1} << 14), kAnalogMax);
  steer_current_.configure(params_[Param::steer_current_zero], params_[Param::steer_current_scale]);
  drive_current_.configure(params_[Param::drive_current_zero], params_[Param::drive_current_scale]);
  blade_.configure(params_);
  drive_.configure(params_);
  hall_.configure(params_);
  set_up_ = set_up();
}

// Both bridges are named, no limit is beyond what its sensor shows, no current and no PWM beyond
// what the driver stands, and the steering may be driven so hard that a stuck one shows. The
// drive's timer is slower than any driver.
bool Controller::set_up() const {
  const int32_t battery_top = params_[Param::battery_scale] / 50 * 49;
  return params_[Param::steer_current_cont] <= bridge_rating(steer_style_) &&
         params_[Param::drive_current_cont] <= bridge_rating(drive_style_) &&
         params_[Param::steer_current_max] <= bridge_peak(steer_style_) &&
         params_[Param::drive_current_max] <= bridge_peak(drive_style_) &&
         params_[Param::steer_pwm_freq] <= bridge_fastest(steer_style_) &&
         steer_current_.shows(params_[Param::steer_current_max]) &&
         drive_current_.shows(params_[Param::drive_current_max]) && hall_.shows() &&
         params_[Param::battery_high] <= battery_top &&
         params_[Param::steer_duty_max] - params_[Param::steer_min_duty] >=
             MotionWatch::kDrivenHard;
}

void Controller::tick(Board &board) {
  board.kick_watchdog();
  hil_ = false;
  greeted_ = false;
  restored_ = false;
  Command command;
  uint8_t byte;
  uint8_t commands = 0;
  while (board.receive(&byte)) {
    if (!parser_.feed(byte, &command)) continue;
    if (take(board, command)) last_seq_ = command.seq;
    ++commands;
  }
  // They wait for ticks that a full line leaves time for, and ARM waits for them.
  if (unconfigured_ != 0 && commands <= kFewCommands) {
    if (unconfigured_ == kParts) {
      configure_steering();
    } else {
      configure_rest(board);
    }
    --unconfigured_;
  }
  if (log_wanted_ != kNoEntry && !board.storing()) {
    answer(board, log_.read(board, log_wanted_));
    log_wanted_ = kNoEntry;
  }
  const Params::Saving saving = params_.step_save(board);
  if (saving == Params::Saving::kDone || saving == Params::Saving::kFailed) {
    const bool done = saving == Params::Saving::kDone;
    params_bad_ = !done;
    acknowledge(board, save_request_, done ? Result::OK : Result::STORE_FAILED);
  }
  const State before = supervisor_.state();
  observe(board);
  actuate(board);
  show_state(board);  // what is seen from outside comes before what is written down
  log_.note(supervisor_.faults(), before);
  if (!params_.saving() && log_.step(board)) acknowledge(board, save_request_, Result::OK);
  report(board);
  board.remember_armed(supervisor_.live());
  ++beat_;
}

bool Controller::fresh(uint8_t seq) {
  const uint8_t ahead = static_cast<uint8_t>(seq - command_seq_);
  if (ahead == 0 || ahead > kNewest) {
    if (stale_ != UINT16_MAX) ++stale_;
    return false;
  }
  command_seq_ = seq;
  return true;
}

bool Controller::take(Board &board, const Command &command) {
  using namespace protocol;
  const bool idle = !supervisor_.live() && !params_.saving() && !log_.clearing();
  switch (command.id) {
    case Hello::kId:
      if (greeted_) return false;  // a line full of them would take too long
      greeted_ = true;
      answer(board, Version{kVersion, kFirmwareMajor, kFirmwareMinor, board.build(),
                            board.reset_cause(), kCommit, kModified});
      return true;
    case Arm::kId: {
      const Arm arm = Arm::read(command.payload);
      const bool still = asked_.speed == 0 && !params_.saving() && unconfigured_ == 0;
      const Result result = supervisor_.arm(arm.protocol_version, set_up_, still);
      if (result == Result::OK) {
        asked_ = Asked{};
        command_seq_ = command.seq;
      }
      return acknowledge(board, command, result);
    }
    case Stop::kId:
      supervisor_.stop();
      return true;
    case Clear::kId:
      return acknowledge(board, command, supervisor_.clear());
    case protocol::Drive::kId: {
      // While nothing is on there is nothing to keep alive, and a new host counts from anywhere.
      if (supervisor_.live() && !fresh(command.seq)) return false;
      const auto drive = protocol::Drive::read(command.payload);
      asked_ = Asked{};
      asked_.steer = drive.steer;
      asked_.speed = drive.speed;
      if (supervisor_.live()) blade_.request(drive.blade != 0);
      ident_used_ = 0;
      supervisor_.command(drive.speed != 0);
      return true;
    }
    case Ident::kId:
      return acknowledge(board, command, take_ident(command));
    case ParamGet::kId: {
      const ParamGet get = ParamGet::read(command.payload);
      if (get.param >= kParams) return acknowledge(board, command, Result::UNKNOWN);
      answer(board, ParamValue{get.param, params_.value(get.param)});
      return true;
    }
    case ParamSet::kId: {
      const ParamSet set = ParamSet::read(command.payload);
      const Result result = idle ? params_.set(set.param, set.value) : Result::WRONG_STATE;
      if (result == Result::OK) unconfigured_ = kParts;
      return acknowledge(board, command, result);
    }
    case ParamSave::kId:
      if (!idle) return acknowledge(board, command, Result::WRONG_STATE);
      save_request_ = command;
      params_.begin_save();
      return true;
    case ParamDefaults::kId:
      if (restored_) return false;  // as of Hello
      restored_ = true;
      if (idle) {
        params_.set_defaults();
        unconfigured_ = kParts;
      }
      return acknowledge(board, command, idle ? Result::OK : Result::WRONG_STATE);
    case LogGet::kId: {
      const LogGet get = LogGet::read(command.payload);
      if (get.index >= FaultLog::kEntries) return acknowledge(board, command, Result::UNKNOWN);
      log_wanted_ = get.index;
      return true;
    }
    case LogClear::kId:
      if (!idle) return acknowledge(board, command, Result::WRONG_STATE);
      save_request_ = command;
      log_.begin_clear();
      return true;
    default:  // HilSensors: the parser lets no other id through
      hil_ = board.inject(HilSensors::read(command.payload));
      return hil_ || acknowledge(board, command, Result::UNKNOWN);
  }
}

Result Controller::take_ident(const Command &command) {
  if (supervisor_.state() != State::ARMED) return Result::WRONG_STATE;
  const auto ident = protocol::Ident::read(command.payload);
  if (magnitude(ident.duty) > params_[Param::ident_duty_max]) return Result::OUT_OF_RANGE;
  if (ident.duration > static_cast<uint16_t>(params_[Param::ident_time_max])) {
    return Result::OUT_OF_RANGE;
  }
  if (!fresh(command.seq)) return Result::STALE;
  blade_.request(false);
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
  pulses_ = board.pulses();
  hall_.step(pulses_, drive_duty_, drive_.awaited());
  steer_current_.step(board.analog(Analog::kSteerCurrent));
  drive_current_.step(board.analog(Analog::kDriveCurrent));
  battery_ = static_cast<int16_t>((board.analog(Analog::kBattery) * battery_scale_) >> 14);
  seen.angle = angle_;
  seen.battery = battery_;
  seen.steer_current = steer_current_.now();
  seen.drive_current = drive_current_.now();
  seen.steer_mean = steer_current_.mean();
  seen.drive_mean = drive_current_.mean();
  seen.estop = board.analog(Analog::kEstop);
  seen.estop_open = board.estop_open();
  seen.hall_silent = hall_.lost();
  seen.hall_noisy = hall_.noisy();
  if (hall_.speed() != Hall::kNone) {
    drive_.update_allowed();
    seen.wheel_fast = hall_.fast(drive_.allowed());
  }
  seen.wrong_way = hall_.wrong_way();
  seen.blade_lost = blade_.lost();
  seen.blade_stuck = blade_.stuck();
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
  drive_duty_ = drive_.step(asked_.speed, hall_.speed(), battery_, hall_.stuck());
  const bool rolls_back = hall_.speed() < 0 && hall_.speed() != Hall::kNone;
  const bool forward = asked_.speed >= 0 && drive_.setpoint() >= 0 && !rolls_back;
  board.set_blade(blade_.step(forward, pulses_.blade));
  board.set_bridge(Motor::kSteer, bridge_wires(steer_style_, steer_duty_, steer_gap_));
  // A machine that is told to stand must stand on a slope, too; and one that the slope drives
  // faster than it is told is braked. Until it rolls or is driven nothing is on: what brakes one
  // driver is full power where another is fitted.
  const bool rolls = hall_.speed() != 0 && hall_.speed() != Hall::kNone;
  if (rolls || drive_.setpoint() != 0) holds_ = true;
  const bool brakes = drive_duty_ == 0
                          ? holds_
                          : hall_.directed() && drive_.slows(drive_duty_, hall_.speed(), battery_);
  board.set_bridge(Motor::kDrive, bridge_wires(drive_style_, drive_duty_, drive_gap_,
                                               brakes ? Bridging::kBrake : Bridging::kDrive));
}

void Controller::off(Board &board) {
  steering_.release();
  drive_.release();
  ident_used_ = 0;
  steer_duty_ = 0;
  drive_duty_ = 0;
  holds_ = false;
  blade_.release();
  blade_.step(false, pulses_.blade);
  board.set_blade(false);
  board.set_bridge(Motor::kSteer, {0, 0, false, false});
  board.set_bridge(Motor::kDrive, {0, 0, false, false});
}

void Controller::report(Board &board) {
  if (hil_) answer(board, protocol::HilOutputs{steer_duty_, drive_duty_, blade_.on()});
  if (beat_ % kReadingsTicks == kReadingsAt) report_readings(board);
  if (beat_ % kTelemetryTicks != 0) return;
  protocol::Telemetry message{};
  message.time = board.time_us();
  message.state = static_cast<uint8_t>(supervisor_.state());
  message.faults = supervisor_.faults();
  message.setpoint = steering_.setpoint();
  message.angle = angle_;
  message.steer_duty = steer_duty_;
  message.drive_duty = drive_duty_;
  message.blade = blade_.on();
  message.speed = hall_.speed();
  message.distance = hall_.distance();
  message.battery = static_cast<uint16_t>(battery_);
  message.last_seq = last_seq_;
  message.frames_bad = parser_.bad();
  answer(board, message);
}

void Controller::report_readings(Board &board) {
  const Troubles troubles = board.troubles();
  protocol::Readings message{};
  message.steer_current = steer_current_.now();
  message.drive_current = drive_current_.now();
  message.pot = board.analog(Analog::kPot);
  message.battery = board.analog(Analog::kBattery);
  message.steer_sense = board.analog(Analog::kSteerCurrent);
  message.drive_sense = board.analog(Analog::kDriveCurrent);
  message.estop = board.analog(Analog::kEstop);
  message.hall = pulses_.wheel;
  message.blade_turns = pulses_.blade;
  message.overruns = troubles.overruns;
  message.line_errors = troubles.line_errors;
  message.stale = stale_;
  answer(board, message);
}

// SAFE blinks slowly, FAULT fast, live is on.
void Controller::show_state(Board &board) {
  const uint8_t half = supervisor_.state() == State::FAULT ? 16 : 128;
  board.set_lamp(supervisor_.live() || beat_ % (2 * half) < half);
}

bool Controller::acknowledge(Board &board, const Command &command, Result result) {
  answer(board, protocol::Ack{command.id, command.seq, static_cast<uint8_t>(result)});
  return result == Result::OK;
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
