#include <doctest.h>

#include <algorithm>
#include <initializer_list>

#include "controller.h"
#include "fake_board.h"
#include "fixed.h"

using namespace daranti;
using protocol::Param;
using protocol::Result;
using protocol::State;

namespace {

std::vector<uint8_t> i16(int16_t value) {
  return {static_cast<uint8_t>(value), static_cast<uint8_t>(value >> 8)};
}

struct Rig {
  FakeBoard board;
  Controller controller;
  int16_t steer = 0;
  int16_t speed = 0;
  bool blade = false;

  explicit Rig(bool boot = true) {
    fit(board);
    if (boot) controller.boot(board);
  }
  // A BTS7960 steers, a bridge of 25 A with a VNH5019's inputs drives.
  static void fit(FakeBoard &board) {
    Params params;
    params.set(static_cast<uint8_t>(Param::steer_driver), 2);
    params.set(static_cast<uint8_t>(Param::drive_driver), 3);
    params.set(static_cast<uint8_t>(Param::drive_current_cont), 2500);
    params.begin_save();
    while (params.saving()) params.step_save(board);
  }
  void tick(int count = 1) {
    for (int i = 0; i < count; ++i) {
      controller.tick(board);
      board.clock_us += kTickUs;
    }
  }
  void drive() {
    std::vector<uint8_t> payload = i16(steer);
    for (const uint8_t byte : i16(speed)) payload.push_back(byte);
    payload.push_back(blade);
    board.type(protocol::Drive::kId, payload);
  }
  void ask(int16_t speed_, int16_t steer_ = 0, bool blade_ = false) {
    speed = speed_;
    steer = steer_;
    blade = blade_;
  }
  // Ticks with a DRIVE in each.
  void drive_for(int ticks) {
    for (int i = 0; i < ticks; ++i) {
      drive();
      tick();
    }
  }
  // blade_offered: with a DRIVE that does not ask for the blade, so that the next one may.
  void arm(bool blade_offered = true) {
    board.type(protocol::Arm::kId, {protocol::kVersion});
    if (blade_offered) board.type(protocol::Drive::kId, {0, 0, 0, 0, 0});
    tick();
    REQUIRE(state() == State::ARMED);
  }
  void set(Param param, int16_t value) {
    board.type(protocol::ParamSet::kId, {static_cast<uint8_t>(param), static_cast<uint8_t>(value),
                                         static_cast<uint8_t>(value >> 8)});
    tick();
    REQUIRE(controller.params()[param] == value);
    tick();  // the second part of what depends on it
  }
  void ident(int16_t duty, uint16_t ms) {
    std::vector<uint8_t> payload = i16(duty);
    for (const uint8_t byte : i16(static_cast<int16_t>(ms))) payload.push_back(byte);
    board.type(protocol::Ident::kId, payload);
  }
  State state() const { return controller.supervisor().state(); }
  uint32_t faults() const { return controller.supervisor().faults(); }

  // The result of the only Ack since the last look; -1 where there was none.
  int result() {
    int found = -1;
    for (const Answer &answer : board.answers()) {
      if (answer.id == protocol::Ack::kId) found = answer.payload.at(2);
    }
    return found;
  }
  // What the fields of the newest Telemetry are.
  std::vector<uint8_t> telemetry() {
    board.answers();
    for (int i = 0; i < 4; ++i) {
      tick();
      for (const Answer &answer : board.answers()) {
        if (answer.id == protocol::Telemetry::kId) return answer.payload;
      }
    }
    FAIL("no telemetry");
    return {};
  }
  // Both low inputs and the PWM high short a VNH5019's motor.
  bool brakes() const {
    const BridgeWires &wires = board.drive;
    return wires.pwm == 255 && wires.lpwm == 0 && !wires.in1 && !wires.in2;
  }
  bool off() const {
    const auto low = [](const BridgeWires &wires) {
      return wires.pwm == 0 && wires.lpwm == 0 && !wires.in1 && !wires.in2;
    };
    return low(board.steer) && low(board.drive) && !board.blade;
  }
};

int result_of(Rig &rig) {
  rig.tick();
  return rig.result();
}

int as_int(Result result) { return static_cast<int>(result); }

}  // namespace

TEST_CASE("Boot puts everything off and sets the PWM frequencies") {
  Rig rig(false);
  rig.board.steer = rig.board.drive = {255, 255, true, true};
  rig.board.blade = true;
  rig.controller.boot(rig.board);
  CHECK(rig.off());
  CHECK(rig.board.steer_hz == 20000);
  CHECK(rig.board.drive_hz == 3922);
  CHECK(rig.state() == State::SAFE);
}

TEST_CASE("Boot reads the reset's cause and the stored parameters") {
  Rig rig(false);
  rig.board.cause = protocol::BY_WATCHDOG;
  rig.board.eeprom[0] = 0;
  rig.board.eeprom[Params::kSecond] = 0;
  rig.controller.boot(rig.board);
  rig.tick();
  CHECK(rig.faults() == (protocol::WATCHDOG | protocol::PARAMS_BAD));
  CHECK(rig.state() == State::FAULT);
}

TEST_CASE("Every tick kicks the watchdog once") {
  Rig rig;
  rig.tick(10);
  CHECK(rig.board.kicks == 10);
  // Neither do bytes: a main loop that never comes to the end of a line must be found.
  for (int i = 0; i < 20; ++i) rig.board.type(protocol::Hello::kId, {1});
  rig.tick();
  CHECK(rig.board.kicks == 11);
}

TEST_CASE("Hello is answered by Version") {
  Rig rig;
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::Hello::kId, {1});
  rig.tick();
  const auto answers = rig.board.answers();
  REQUIRE(answers.size() == 1);
  CHECK(answers[0].id == protocol::Version::kId);
  CHECK(answers[0].payload == std::vector<uint8_t>{protocol::kVersion, kFirmwareMajor,
                                                   kFirmwareMinor, 1, 1, 0, 0, 0, 0, 0});
}

TEST_CASE("An Ack names the request and its sequence number") {
  Rig rig;
  rig.board.next_seq = 77;
  rig.board.type(protocol::Arm::kId, {99});
  rig.tick();
  for (const Answer &answer : rig.board.answers()) {
    if (answer.id != protocol::Ack::kId) continue;
    CHECK(answer.payload == std::vector<uint8_t>{protocol::Arm::kId, 77,
                                                 static_cast<uint8_t>(Result::WRONG_VERSION)});
  }
  CHECK(rig.state() == State::SAFE);
}

TEST_CASE("Telemetry names the last command that was taken, and none that was refused") {
  using Message = std::pair<uint8_t, std::vector<uint8_t>>;
  constexpr size_t kLastSeq = 26;
  const std::vector<uint8_t> none{};
  for (const Message &each :
       {Message{protocol::Arm::kId, {protocol::kVersion + 1}},
        Message{protocol::Ident::kId, {255, 0, 100, 0}},  // too much duty
        Message{protocol::ParamGet::kId, {255}}, Message{protocol::ParamSet::kId, {0, 2, 0}},
        Message{protocol::ParamSave::kId, none}, Message{protocol::ParamDefaults::kId, none},
        Message{protocol::LogGet::kId, {255}}, Message{protocol::LogClear::kId, none},
        Message{protocol::HilSensors::kId, std::vector<uint8_t>(16)}}) {
    CAPTURE(each.first);
    Rig rig;
    rig.arm();
    const uint8_t taken = rig.board.next_seq;
    rig.drive();
    REQUIRE(rig.telemetry().at(kLastSeq) == taken);
    rig.board.type(each.first, each.second);
    CHECK(rig.telemetry().at(kLastSeq) == taken);
    // A Drive that is repeated is not taken either.
    rig.board.next_seq = taken - 1;
    rig.drive();
    CHECK(rig.telemetry().at(kLastSeq) == taken);
  }
  for (const Message &each :
       {Message{protocol::Hello::kId, {protocol::kVersion}}, Message{protocol::Stop::kId, none},
        Message{protocol::Arm::kId, {protocol::kVersion}}, Message{protocol::ParamGet::kId, {0}},
        Message{protocol::ParamSave::kId, none}, Message{protocol::ParamDefaults::kId, none},
        Message{protocol::LogGet::kId, {0}}, Message{protocol::LogClear::kId, none}}) {
    CAPTURE(each.first);
    Rig rig;
    rig.board.next_seq = 77;
    rig.board.type(each.first, each.second);
    CHECK(rig.telemetry().at(kLastSeq) == 77);
  }
}

TEST_CASE("Frames to the host count modulo 256; one that did not fit is not counted") {
  Rig rig;
  rig.tick(4 * 300);
  const auto answers = rig.board.answers(true);
  REQUIRE(answers.size() > 300);
  const size_t count = answers.size();
  for (size_t i = 0; i < count; ++i) CHECK(answers[i].seq == i % 256);
  rig.board.line_full = true;
  rig.tick(8);
  rig.board.line_full = false;
  rig.tick(4);
  const auto later = rig.board.answers();
  REQUIRE(later.size() == 1);
  CHECK(later[0].seq == count % 256);
}

TEST_CASE("Telemetry comes in every fourth tick and says what is") {
  Rig rig;
  rig.arm();
  rig.ask(500, 1000, true);
  rig.board.next_seq = 50;
  rig.drive_for(40);
  rig.board.set_battery(11);
  rig.board.set_angle(2);
  rig.drive();
  rig.drive();
  rig.board.answers();
  rig.tick(4);
  const auto answers = rig.board.answers();
  REQUIRE(answers.size() == 1);
  const uint8_t *p = answers[0].payload.data();
  using protocol::get;
  CHECK(get<uint32_t>(p) % (4 * kTickUs) == 0);
  CHECK(get<uint32_t>(p) <= rig.board.clock_us);
  CHECK(get<uint32_t>(p) + 4 * kTickUs >= rig.board.clock_us);
  CHECK(p[4] == static_cast<uint8_t>(State::RUNNING));
  CHECK(get<uint32_t>(p + 5) == 0);
  CHECK(get<int16_t>(p + 9) == 1000);
  CHECK(get<int16_t>(p + 11) == 200);
  CHECK(get<int16_t>(p + 13) == rig.board.steer.pwm);
  CHECK(get<int16_t>(p + 15) == rig.board.drive.pwm);
  CHECK(p[17] == 1);
  CHECK(get<int16_t>(p + 18) == -32768);
  CHECK(get<int32_t>(p + 20) == 0);
  CHECK(get<uint16_t>(p + 24) > 10980);
  CHECK(get<uint16_t>(p + 24) < 11020);
  CHECK(p[26] == static_cast<uint8_t>(rig.board.next_seq - 1));
  CHECK(get<uint16_t>(p + 27) == 0);
}

TEST_CASE("Telemetry counts bad frames and carries faults and the duties' signs") {
  Rig rig;
  rig.arm();
  rig.ask(-300, -2000);
  rig.drive_for(50);
  rig.board.input = {1, 2, 3, 0};
  auto payload = rig.telemetry();
  CHECK(protocol::get<uint16_t>(payload.data() + 27) == 1);
  CHECK(protocol::get<int16_t>(payload.data() + 13) < 0);
  CHECK(protocol::get<int16_t>(payload.data() + 15) < 0);
  rig.board.set_estop(5);
  payload = rig.telemetry();
  CHECK(payload[4] == static_cast<uint8_t>(State::FAULT));
  CHECK(protocol::get<uint32_t>(payload.data() + 5) == protocol::ESTOP_OPEN);
}

TEST_CASE("Nothing moves before ARM") {
  Rig rig;
  rig.ask(500, 2000, true);
  for (int i = 0; i < 50; ++i) {
    rig.drive_for(1);
    CHECK(rig.off());
  }
  CHECK(rig.state() == State::SAFE);
}

TEST_CASE("ARM is refused while a speed is asked") {
  Rig rig;
  rig.ask(500);
  rig.drive_for(1);
  rig.board.answers();
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  rig.ask(0);
  rig.drive_for(1);
  rig.board.answers();
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::OK));
  CHECK(rig.state() == State::ARMED);
}

TEST_CASE("ARM is refused with an open e-stop loop or a potentiometer out of range") {
  for (const int which : {0, 1, 2}) {
    Rig rig;
    if (which == 0) rig.board.set_estop(5);
    if (which == 1) rig.board.set_pot(1000);
    if (which == 2) rig.board.set_pot(20);
    rig.tick(3);
    rig.board.answers();
    rig.board.type(protocol::Arm::kId, {protocol::kVersion});
    CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
    CHECK(rig.state() == State::FAULT);
  }
}

TEST_CASE("What was asked before ARM is forgotten by it") {
  Rig rig;
  rig.ask(0, 3000, true);
  rig.drive_for(1);
  rig.arm(false);
  rig.tick(20);
  CHECK(rig.off());
  rig.drive_for(200);
  CHECK(!rig.board.blade);
}

TEST_CASE("Armed, the steering and the blade work; the wheels only with a speed") {
  Rig rig;
  rig.arm();
  rig.ask(0, 2000, true);
  rig.drive_for(20);
  CHECK(rig.state() == State::ARMED);
  CHECK(rig.board.steer.pwm > 0);
  CHECK(rig.board.steer.lpwm == 0);
  CHECK(rig.board.drive.pwm == 0);
  CHECK(rig.board.blade);
  rig.ask(500, 0, false);
  rig.drive_for(200);
  CHECK(rig.state() == State::RUNNING);
  CHECK(rig.board.drive.pwm == 128);
  CHECK(rig.board.drive.in1);
  CHECK(!rig.board.drive.in2);
  CHECK(!rig.board.blade);
}

TEST_CASE("The blade is off in reverse, from the asking until the machine goes forward again") {
  Rig rig;
  rig.arm();
  rig.ask(500, 0, true);
  rig.drive_for(100);
  CHECK(rig.board.blade);
  rig.ask(-500, 0, true);
  rig.drive_for(1);
  CHECK(!rig.board.blade);
  CHECK(rig.board.drive.in1);
  rig.drive_for(200);
  CHECK(rig.board.drive.in2);
  rig.ask(500, 0, true);
  rig.drive_for(50);
  CHECK(rig.board.drive.in2);
  CHECK(!rig.board.blade);
  rig.drive_for(100);
  CHECK(rig.board.blade);
}

TEST_CASE("The blade is off while the hall sensor shows the machine rolling backward") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.arm();
  rig.ask(-500);
  for (int i = 0; i < 200; ++i) {
    rig.board.wheel = static_cast<uint16_t>(i / 4);
    rig.drive_for(1);
  }
  rig.ask(0, 0, true);
  int off_ticks = 0;
  for (int i = 0; i < 600; ++i) {
    rig.drive_for(1);
    off_ticks += !rig.board.blade;
  }
  // The ramp down takes 100 ticks, the last pulse counts for 200.
  CHECK(off_ticks > 150);
  CHECK(rig.board.blade);
}

TEST_CASE("STOP puts all outputs off in its own tick and wins over what comes with it") {
  Rig rig;
  rig.arm();
  rig.ask(500, 2000, true);
  rig.drive_for(50);
  CHECK(!rig.off());
  rig.drive();
  rig.board.type(protocol::Stop::kId);
  rig.drive();
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  rig.tick();
  CHECK(rig.off());
  CHECK(rig.state() == State::SAFE);
  rig.drive_for(5);
  CHECK(rig.off());
}

TEST_CASE("What comes with a STOP cannot arm again in its tick, with CLEAR neither") {
  Rig rig;
  rig.arm();
  rig.board.type(protocol::Stop::kId);
  rig.board.type(protocol::Clear::kId);
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  rig.tick();
  CHECK(rig.state() == State::SAFE);
  CHECK(rig.off());
}

TEST_CASE("Every fault puts all outputs off in the tick that finds it") {
  Rig rig;
  rig.arm();
  rig.ask(500, 2000, true);
  rig.drive_for(50);
  rig.board.set_estop(5);
  rig.drive_for(1);
  CHECK(rig.state() == State::FAULT);
  CHECK(rig.off());
}

TEST_CASE("250 ms without a command put everything off") {
  Rig rig;
  rig.arm();
  rig.ask(500, 0, true);
  rig.drive_for(50);
  rig.tick(48);
  CHECK(!rig.off());
  rig.tick();
  CHECK(rig.off());
  CHECK(rig.faults() == protocol::LINK_LOST);
  rig.drive_for(10);
  CHECK(rig.off());
  rig.board.answers();
  rig.board.type(protocol::Clear::kId);
  CHECK(result_of(rig) == as_int(Result::OK));
  CHECK(rig.state() == State::SAFE);
}

TEST_CASE("Other messages do not feed the link's watchdog") {
  Rig rig;
  rig.arm();
  for (int i = 0; i < 60; ++i) {
    rig.board.type(protocol::Hello::kId, {1});
    rig.board.type(protocol::ParamGet::kId, {0});
    rig.tick();
  }
  CHECK(rig.faults() == protocol::LINK_LOST);
}

TEST_CASE("What is refused does not feed the link's watchdog, nor does CLEAR") {
  using Message = std::pair<uint8_t, std::vector<uint8_t>>;
  for (const Message &each :
       {Message{protocol::Clear::kId, {}}, Message{protocol::Arm::kId, {protocol::kVersion}},
        Message{protocol::Arm::kId, {protocol::kVersion + 1}},
        Message{protocol::Ident::kId, {255, 0, 100, 0}},   // too much duty
        Message{protocol::Ident::kId, {50, 0, 255, 100}},  // too long
        Message{protocol::ParamSet::kId, {0, 2, 0}}, Message{protocol::ParamSave::kId, {}},
        Message{protocol::ParamDefaults::kId, {}}, Message{protocol::LogGet::kId, {0}},
        Message{protocol::LogClear::kId, {}},
        Message{protocol::HilSensors::kId, std::vector<uint8_t>(16)}}) {
    CAPTURE(each.first);
    Rig rig;
    rig.arm();
    for (int i = 0; i < 60 && rig.state() == State::ARMED; ++i) {
      rig.board.type(each.first, each.second);
      rig.tick();
    }
    CHECK(rig.faults() == protocol::LINK_LOST);
    CHECK(rig.off());
  }
}

TEST_CASE("A fault whose cause lasts is not cleared") {
  Rig rig;
  rig.board.set_estop(5);
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::Clear::kId);
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  CHECK(rig.state() == State::FAULT);
}

TEST_CASE("Every measured limit reaches the supervisor with its scale") {
  struct Case {
    void (FakeBoard::*set)(double);
    double good, bad;
    uint32_t bit;
    int ticks = 400;
  };
  for (const Case &each :
       {Case{&FakeBoard::set_steer_current, 19.9, 20.1, protocol::STEER_OVERCURRENT, 15},
        Case{&FakeBoard::set_drive_current, 39.9, 40.1, protocol::DRIVE_OVERCURRENT, 15},
        Case{&FakeBoard::set_battery, 10.01, 9.98, protocol::BATTERY_LOW},
        Case{&FakeBoard::set_battery, 15.48, 15.52, protocol::BATTERY_HIGH},
        Case{&FakeBoard::set_pot, 904, 905, protocol::POT_OPEN},
        Case{&FakeBoard::set_pot, 120, 119, protocol::POT_SHORT}}) {
    Rig rig;
    (rig.board.*each.set)(each.good);
    rig.tick(each.ticks);
    CHECK(rig.faults() == 0);
    (rig.board.*each.set)(each.bad);
    rig.tick(each.ticks);
    CHECK(rig.faults() == each.bit);
  }
}

TEST_CASE("A potentiometer out of range is that fault alone, and the last angle stays") {
  for (const double counts : {1000.0, 20.0}) {
    Rig rig;
    rig.board.set_angle(10);
    rig.tick();
    rig.board.set_pot(counts);
    rig.tick(5);
    CHECK((rig.faults() == protocol::POT_OPEN || rig.faults() == protocol::POT_SHORT));
    CHECK(protocol::get<int16_t>(rig.telemetry().data() + 11) == 1000);
  }
}

TEST_CASE("At the ends of its range, and not beyond, the potentiometer gives the angle") {
  for (const double counts : {120.0, 904.0}) {
    Rig rig(false);
    rig.board.set_pot(counts);
    rig.controller.boot(rig.board);
    const int16_t angle = protocol::get<int16_t>(rig.telemetry().data() + 11);
    CHECK(magnitude(angle) == doctest::Approx(392 / 4.5 * 100).epsilon(0.001));
  }
  for (const double counts : {120 - 1.0 / 16, 904 + 1.0 / 16}) {
    Rig rig(false);
    rig.board.set_pot(counts);
    rig.controller.boot(rig.board);
    CHECK(protocol::get<int16_t>(rig.telemetry().data() + 11) == 0);
  }
}

TEST_CASE("Without a calibration the last angle stays") {
  Rig rig;
  rig.board.set_angle(10);
  rig.tick();
  rig.set(Param::pot_left, 2870);
  rig.board.set_angle(20);
  rig.tick();
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 11) == 1000);
}

TEST_CASE("A new calibration is no jump of the angle, a jump after it is one") {
  Rig rig;
  rig.board.set_angle(30);
  rig.tick();
  rig.set(Param::pot_left, 8000);
  rig.tick();
  CHECK(rig.faults() == 0);
  rig.board.set_angle(35);
  rig.tick();
  CHECK(rig.faults() == protocol::POT_JUMP);
}

TEST_CASE("A current is reckoned to the last of the converter's steps") {
  // 5005 / 2^14 of 0.01 A a step, from 8184 for 2.5 V: 6550 are 20.00 A, 6551 are 20.01 A.
  for (const uint16_t reading : {6550, 6551}) {
    Rig rig;
    rig.board.analog_in[2] = static_cast<uint16_t>(8184 + reading);
    rig.tick(20);
    CHECK(rig.faults() == (reading == 6551 ? protocol::STEER_OVERCURRENT : 0U));
  }
}

TEST_CASE("A jump of the angle latches") {
  Rig rig;
  rig.tick();
  rig.board.set_angle(5);
  rig.tick();
  CHECK(rig.faults() == protocol::POT_JUMP);
}

TEST_CASE("A steering that is driven and does not move latches, by its current as a stall") {
  for (const double ampere : {0.0, 3.5}) {
    Rig rig;
    rig.board.set_steer_current(ampere);
    rig.arm();
    rig.ask(0, 3000);
    rig.drive_for(200);
    CHECK(rig.faults() == (ampere > 0 ? protocol::STEER_STALL : protocol::POT_FROZEN));
  }
}

// With less between them nothing was judged at all, and the machine armed.
TEST_CASE(
    "However close steer_duty_max is to steer_min_duty, a steering that arms and is stuck "
    "latches") {
  int armed = 0;
  for (const int16_t floor : {0, 53, 150}) {
    for (const int16_t above : {1, 39, 40, 41, 105}) {
      Rig rig;
      rig.set(Param::steer_min_duty, floor);
      rig.set(Param::steer_duty_max, static_cast<int16_t>(floor + above < 30 ? 30 : floor + above));
      rig.board.answers();
      rig.board.type(protocol::Arm::kId, {protocol::kVersion});
      rig.tick();
      if (rig.state() != State::ARMED) continue;
      ++armed;
      rig.ask(0, 3000);
      rig.drive_for(400);
      CHECK(rig.faults() == protocol::POT_FROZEN);
    }
  }
  CHECK(armed == 9);
}

TEST_CASE("A steering motor with its wires swapped latches as a runaway") {
  Rig rig;
  rig.arm();
  rig.ask(0, 1000);
  double angle = 0;
  for (int i = 0; i < 100; ++i) {
    if (rig.board.steer.pwm > 0) angle -= 0.3;
    rig.board.set_angle(angle);
    rig.drive_for(1);
  }
  CHECK(rig.faults() == protocol::STEER_RUNAWAY);
}

TEST_CASE("A silent hall sensor latches after 0.25 m that should have given pulses") {
  Rig rig;
  rig.set(Param::hall_per_metre, 200);
  rig.arm();
  rig.ask(500);
  // 0.125 m in the ramp's 100 ticks, of which the first 19 are too slow to count; then 2.5 mm each.
  rig.drive_for(147);
  CHECK(rig.faults() == 0);
  rig.drive_for(10);
  CHECK(rig.faults() == protocol::HALL_LOST);
}

// A creep gives too few pulses to be judged by. Its loop went on to full duty with a silent sensor.
TEST_CASE("Told to creep, a machine with a silent hall sensor is stopped before it is a runaway") {
  for (const int16_t phases : {1, 2}) {
    for (const int16_t asked : {20, 50, 99, -50, -99}) {
      Rig rig;
      rig.set(Param::hall_per_metre, 500);
      rig.set(Param::hall_phases, phases);
      rig.arm();
      rig.ask(asked);
      int ticks = 0, most = 0;
      for (; rig.state() == State::RUNNING || ticks == 0; ++ticks) {
        rig.drive_for(1);
        most = std::max<int>(most, rig.board.drive.pwm);
        REQUIRE(ticks < 6000);
      }
      CHECK(rig.faults() == protocol::HALL_LOST);
      // speed_excess is 0.35 m/s, 89 of 255 at the default speed_full. What the duty gives comes
      // half a metre beyond that, which is 1.1 s.
      const int beyond = most - 89 - magnitude(asked) * 255 / 1000;
      CHECK(beyond >= 0);
      CHECK(beyond <= 25);
    }
  }
}

TEST_CASE("Told to creep uphill, a machine whose sensor counts is driven as hard as it takes") {
  Rig rig;
  rig.set(Param::hall_per_metre, 500);
  rig.arm();
  rig.ask(80);
  // It turns its wheels a pulse in half a second, 0.04 m/s, however hard it is driven.
  for (int i = 0; i < 8000; ++i) {
    if (i % 100 == 99) ++rig.board.wheel;
    rig.drive_for(1);
    REQUIRE(rig.state() == State::RUNNING);
  }
  CHECK(rig.board.drive.pwm == 255);
}

TEST_CASE("Hall pulses show as speed and distance, and close the loop") {
  Rig rig;
  rig.set(Param::hall_per_metre, 200);
  rig.arm();
  rig.ask(500);
  for (int i = 1; i <= 400; ++i) {
    rig.board.wheel = static_cast<uint16_t>(i / 20);
    rig.drive_for(1);
  }
  const auto payload = rig.telemetry();
  CHECK(protocol::get<int16_t>(payload.data() + 18) == 500);
  CHECK(protocol::get<int32_t>(payload.data() + 20) == 1000);
}

TEST_CASE("A BTS7960 gets its two PWMs and no direction pins") {
  Rig rig;
  rig.set(Param::steer_driver, 2);
  rig.set(Param::drive_driver, 2);
  rig.tick(2);
  rig.arm();
  rig.ask(500, 2000);
  rig.drive_for(20);
  CHECK(rig.board.steer.pwm > 0);
  CHECK(rig.board.steer.lpwm == 0);
  CHECK(rig.board.drive.pwm > 0);
  CHECK(rig.board.drive.lpwm == 0);
  rig.ask(-500, -2000);
  rig.drive_for(60);
  CHECK(rig.board.steer.pwm == 0);
  CHECK(rig.board.steer.lpwm > 0);
  CHECK(rig.board.drive.pwm == 0);
  CHECK(rig.board.drive.lpwm > 0);
  for (const BridgeWires &wires : {rig.board.steer, rig.board.drive}) {
    CHECK(!wires.in1);
    CHECK(!wires.in2);
  }
}

TEST_CASE("A bridge's wires follow its style, and a duty beyond 255 counts as 255") {
  const auto same = [](const BridgeWires &a, const BridgeWires &b) {
    return a.pwm == b.pwm && a.lpwm == b.lpwm && a.in1 == b.in1 && a.in2 == b.in2;
  };
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, 100, 0), {100, 0, true, false}));
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, -100, 0), {100, 0, false, true}));
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, 1, 0), {1, 0, true, false}));
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, 300, 0), {255, 0, true, false}));
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, -300, 0), {255, 0, false, true}));
  CHECK(same(bridge_wires(BridgeStyle::kVnh5019, 0, 0), {0, 0, false, false}));
  for (const Bridging bridging : {Bridging::kDrive, Bridging::kBrake}) {
    for (const BridgeStyle style : {BridgeStyle::kL298n, BridgeStyle::kBts7960}) {
      CHECK(same(bridge_wires(style, 100, 0, bridging), {100, 0, false, false}));
      CHECK(same(bridge_wires(style, -100, 0, bridging), {0, 100, false, false}));
      CHECK(same(bridge_wires(style, 1, 0, bridging), {1, 0, false, false}));
      CHECK(same(bridge_wires(style, -1, 0, bridging), {0, 1, false, false}));
      CHECK(same(bridge_wires(style, -300, 0, bridging), {0, 255, false, false}));
      CHECK(same(bridge_wires(style, 0, 0, bridging), {0, 0, false, false}));
    }
    for (const int16_t duty : {int16_t{-255}, int16_t{0}, int16_t{255}}) {
      CHECK(same(bridge_wires(BridgeStyle::kNotSet, duty, 0, bridging), {0, 0, false, false}));
    }
  }
}

TEST_CASE("A VNH5019 brakes with both inputs low, the more the less is asked") {
  // At 12 V the motor may give 12 V * duty: it is open for so much of the period, in which its
  // current flows back over two diodes into 13.6 V.
  for (int16_t duty = -255; duty <= 255; ++duty) {
    const BridgeWires wires = bridge_wires(BridgeStyle::kVnh5019, duty, 0, Bridging::kBrake);
    CHECK(!wires.in1);
    CHECK(!wires.in2);
    CHECK(wires.lpwm == 0);
    const double open = (255 - wires.pwm) / 255.0 * 13.6;
    CHECK(open == doctest::Approx(12.0 * (duty < 0 ? -duty : duty) / 255).epsilon(0.01).scale(12));
  }
  CHECK(bridge_wires(BridgeStyle::kVnh5019, 0, 0, Bridging::kBrake).pwm == 255);
}

TEST_CASE(
    "A VNH5019's PWM is low for more than 6 us, or not at all; the others' for as long as asked") {
  // VNH2SP30-E data sheet, table 9, note 1: "to avoid false short to battery detection".
  for (const double hz : {123.0, 3922.0, 20000.0}) {
    const uint8_t gap = bridge_gap(static_cast<uint16_t>(hz));
    for (int16_t duty = -255; duty <= 255; ++duty) {
      for (const Bridging bridging : {Bridging::kDrive, Bridging::kBrake}) {
        const BridgeWires asked = bridge_wires(BridgeStyle::kVnh5019, duty, 0, bridging);
        const BridgeWires given = bridge_wires(BridgeStyle::kVnh5019, duty, gap, bridging);
        const double low_us = (255 - given.pwm) / 255.0 / hz * 1e6;
        CHECK((given.pwm == 255 || low_us > 6.0));
        // The nearest that there is.
        const double off_us = (given.pwm - asked.pwm) / 255.0 / hz * 1e6;
        CHECK((off_us < 4.0 && off_us > -4.0));
        CHECK(given.in1 == asked.in1);
        CHECK(given.in2 == asked.in2);
      }
      for (const BridgeStyle style : {BridgeStyle::kL298n, BridgeStyle::kBts7960}) {
        const BridgeWires given = bridge_wires(style, duty, gap);
        CHECK(given.pwm == (duty > 0 ? duty : 0));
        CHECK(given.lpwm == (duty < 0 ? -duty : 0));
      }
    }
  }
}

TEST_CASE("The pause in a VNH5019's PWM, to the count") {
  CHECK(bridge_gap(20000) == 31);
  CHECK(bridge_gap(3922) == 7);
  CHECK(bridge_gap(653) == 1);
  CHECK(bridge_gap(654) == 2);
  CHECK(bridge_gap(3268) == 6);  // 500004 / 100000
  CHECK(bridge_gap(24183) == 37);
  const auto pwm = [](int16_t duty, uint8_t gap) {
    return bridge_wires(BridgeStyle::kVnh5019, duty, gap).pwm;
  };
  CHECK(pwm(223, 31) == 223);
  CHECK(pwm(224, 31) == 224);
  CHECK(pwm(225, 31) == 224);
  CHECK(pwm(239, 31) == 224);
  CHECK(pwm(240, 31) == 255);
  CHECK(pwm(244, 31) == 255);
  CHECK(pwm(240, 30) == 225);
  CHECK(pwm(241, 30) == 255);
  CHECK(bridge_fastest(BridgeStyle::kL298n) == 25000);
  CHECK(bridge_fastest(BridgeStyle::kBts7960) == 25000);
  CHECK(bridge_fastest(BridgeStyle::kVnh5019) == 20000);
  CHECK(bridge_fastest(BridgeStyle::kNotSet) == 0);
}

TEST_CASE("ARM is refused where a driver is not named") {
  for (const Param driver : {Param::steer_driver, Param::drive_driver}) {
    Rig rig;
    rig.set(driver, 0);
    rig.tick(2);
    rig.board.answers();
    rig.board.type(protocol::Arm::kId, {protocol::kVersion});
    CHECK(result_of(rig) == as_int(Result::NOT_SET_UP));
    CHECK(rig.state() == State::SAFE);
  }
}

TEST_CASE("A VNH5019's pauses are those of its own motor's frequency") {
  for (const int16_t hz : {3922, 25000}) {  // the drive's timer gives no more than 3922
    CAPTURE(hz);
    Rig rig;
    rig.set(Param::drive_pwm_freq, hz);
    rig.set(Param::battery_nominal, 0);
    rig.set(Param::speed_full, 500);
    rig.arm();
    rig.ask(490);  // duty 250: 5 of 255 low, of 7 at least
    rig.drive_for(400);
    REQUIRE(rig.state() == State::RUNNING);
    CHECK(rig.board.drive.pwm == 248);
  }
  Rig rig;
  rig.set(Param::steer_driver, 3);
  rig.set(Param::steer_duty_max, 239);  // at 20 kHz 31 of 255 are low at least
  rig.arm();
  rig.ask(0, 2000);
  int most = 0;
  for (int i = 0; i < 40; ++i) {
    rig.drive_for(1);
    REQUIRE(rig.state() == State::ARMED);  // it steers at a stand, too
    most = rig.board.steer.pwm > most ? rig.board.steer.pwm : most;
  }
  CHECK(most == 224);
}

TEST_CASE("ARM is refused where a limit is beyond what driver or sensor stand or show") {
  struct Case {
    Param param;
    int16_t good, bad;
    int16_t driver = 2;
  };
  // An L298N's two channels stand 4 A, and 5 A for a moment; the others' means no parameter
  // exceeds, and their peaks they limit themselves. 2.4 V are 24 and 60 A.
  for (const Case &each :
       {Case{Param::steer_current_cont, 400, 401, 1}, Case{Param::steer_current_max, 500, 501, 1},
        Case{Param::steer_current_max, 2390, 2400}, Case{Param::drive_current_max, 5980, 5990},
        Case{Param::battery_high, 19600, 19601}, Case{Param::hall_per_metre, 100, 99},
        Case{Param::hall_per_metre, 0, 1}, Case{Param::steer_current_scale, 10, 9},
        Case{Param::drive_current_scale, 0, 1}, Case{Param::steer_duty_max, 93, 92}}) {
    for (const bool good : {true, false}) {
      Rig rig;
      rig.set(Param::steer_driver, each.driver);
      if (each.driver == 1) rig.set(Param::steer_current_max, 500);
      rig.set(each.param, good ? each.good : each.bad);
      rig.tick(2);
      rig.board.answers();
      rig.board.type(protocol::Arm::kId, {protocol::kVersion});
      CHECK(result_of(rig) == as_int(good ? Result::OK : Result::NOT_SET_UP));
    }
  }
  // VNH5019A-E data sheet, table 8: 20 kHz. The others take the 25 kHz that the parameter allows.
  for (const int16_t driver : {1, 2, 3}) {
    for (const int16_t hz : {20000, 20001, 25000}) {
      Rig rig;
      rig.set(Param::steer_driver, driver);
      rig.set(Param::steer_current_max, 500);
      rig.set(Param::steer_pwm_freq, hz);
      rig.tick(2);
      rig.board.answers();
      rig.board.type(protocol::Arm::kId, {protocol::kVersion});
      const bool good = driver != 3 || hz == 20000;
      CHECK(result_of(rig) == as_int(good ? Result::OK : Result::NOT_SET_UP));
    }
  }
  Rig rig;
  rig.set(Param::drive_driver, 1);
  rig.tick(2);
  rig.board.answers();
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::NOT_SET_UP));
  rig.set(Param::drive_current_max, 500);
  for (const int16_t mean : {401, 400}) {
    rig.set(Param::drive_current_cont, mean);
    rig.tick(2);
    rig.board.answers();
    rig.board.type(protocol::Arm::kId, {protocol::kVersion});
    CHECK(result_of(rig) == as_int(mean == 400 ? Result::OK : Result::NOT_SET_UP));
  }
  rig.board.type(protocol::Stop::kId);
  rig.tick();
  for (const int16_t most : {501, 500}) {
    rig.set(Param::drive_current_max, most);
    rig.tick(2);
    rig.board.answers();
    rig.board.type(protocol::Arm::kId, {protocol::kVersion});
    CHECK(result_of(rig) == as_int(most == 500 ? Result::OK : Result::NOT_SET_UP));
  }
}

TEST_CASE("Without a current sensor nothing is measured and nothing is refused") {
  Rig rig;
  rig.set(Param::steer_current_scale, 0);
  rig.set(Param::steer_current_max, 9000);
  rig.set(Param::steer_current_max, 2000);
  rig.tick(2);
  rig.arm();
  rig.board.set_steer_current(20);
  rig.drive_for(400);
  CHECK(rig.faults() == 0);
}

TEST_CASE("A mean current beyond the driver's rating latches, a peak does not") {
  for (const double ampere : {3.9, 4.2, -4.2}) {
    Rig rig;
    rig.arm();
    rig.board.set_steer_current(ampere);
    rig.drive_for(1500);
    CHECK(rig.faults() == (ampere == 3.9 ? 0U : protocol::STEER_OVERCURRENT));
  }
  Rig rig;
  rig.arm();
  for (int i = 0; i < 600; ++i) {
    rig.board.set_drive_current(i % 10 < 5 ? 38 : 10);
    rig.drive_for(1);
  }
  CHECK(rig.faults() == 0);
  rig.board.set_drive_current(30);
  rig.drive_for(400);
  CHECK(rig.faults() == protocol::DRIVE_OVERCURRENT);
}

TEST_CASE("A repeated or old command is not taken and keeps nothing alive") {
  for (const int back : {0, 1, 60, 128}) {
    Rig rig;
    rig.arm();
    rig.ask(500, 0);
    rig.drive_for(10);
    rig.tick();
    const uint8_t last = static_cast<uint8_t>(rig.board.next_seq - 1);
    rig.ask(0, 3000);
    for (int i = 0; i < 60; ++i) {
      rig.board.next_seq = static_cast<uint8_t>(last - back);
      rig.drive_for(1);
      if (i < 40) {
        CHECK(rig.state() == State::RUNNING);
        CHECK(rig.board.drive.pwm > 0);
        CHECK(rig.board.steer.pwm == 0);
      }
    }
    CHECK(rig.faults() == protocol::LINK_LOST);
  }
  for (const int ahead : {1, 127, 128, 255}) {
    Rig rig;
    rig.arm();
    rig.board.next_seq = static_cast<uint8_t>(rig.board.next_seq - 1 + ahead);
    rig.ask(500);
    rig.drive_for(1);
    CHECK((rig.state() == State::RUNNING) == (ahead <= 127));
  }
}

TEST_CASE("Commands that are not taken are counted, and the count does not overflow") {
  Rig rig;
  rig.arm();
  const auto stale = [&rig] {
    uint16_t found = 0;
    for (int i = 0; i < 32; ++i) {
      rig.drive_for(1);
      for (const Answer &answer : rig.board.answers(true)) {
        if (answer.id == protocol::Readings::kId) {
          found = protocol::get<uint16_t>(answer.payload.data() + 22);
        }
      }
    }
    return found;
  };
  CHECK(stale() == 0);
  for (int i = 0; i < 3; ++i) {
    --rig.board.next_seq;
    rig.drive_for(1);
  }
  CHECK(stale() == 3);
  uint8_t frame[16];
  const uint8_t seq = static_cast<uint8_t>(rig.board.next_seq - 1);
  const uint8_t payload[protocol::Drive::kSize] = {};
  const uint8_t count = encode(protocol::Drive::kId, seq, payload, sizeof payload, frame);
  for (int i = 0; i < 65536; ++i)
    rig.board.input.insert(rig.board.input.end(), frame, frame + count);
  rig.tick();
  CHECK(stale() == 65535);
}

TEST_CASE("The readings come in every 32nd tick, from the third on") {
  Rig rig;
  for (int tick = 0; tick < 100; ++tick) {
    rig.tick();
    int found = 0;
    for (const Answer &answer : rig.board.answers(true)) {
      found += answer.id == protocol::Readings::kId;
    }
    CHECK(found == (tick % 32 == 2));
  }
}

TEST_CASE("A repeated identification is refused") {
  Rig rig;
  rig.arm();
  rig.ident(100, 20);
  rig.tick();
  rig.board.answers();
  --rig.board.next_seq;
  rig.ident(100, 20);
  CHECK(result_of(rig) == as_int(Result::STALE));
}

TEST_CASE("A new host may count from anywhere: ARM begins the count") {
  Rig rig;
  rig.arm();
  rig.board.next_seq = 100;
  rig.drive_for(5);
  rig.board.type(protocol::Stop::kId);
  rig.tick();
  rig.board.next_seq = 3;
  rig.arm();
  rig.ask(500);
  rig.drive_for(100);
  CHECK(rig.state() == State::RUNNING);
}

TEST_CASE("Whether it is armed is remembered in every tick") {
  Rig rig;
  rig.tick();
  CHECK(!rig.board.armed);
  rig.arm();
  CHECK(rig.board.armed);
  rig.board.type(protocol::Stop::kId);
  rig.tick();
  CHECK(!rig.board.armed);
  rig.arm();
  rig.board.set_estop(5);
  rig.tick();
  CHECK(rig.state() == State::FAULT);
  CHECK(!rig.board.armed);
}

TEST_CASE("The e-stop's loop is closed at its own voltage only") {
  struct Case {
    double volt;
    uint32_t fault;
  };
  for (const Case &each : {Case{0.88, 0}, Case{0.52, 0}, Case{0.48, protocol::ESTOP_SHORT},
                           Case{0, protocol::ESTOP_SHORT}, Case{1.48, 0},
                           Case{1.52, protocol::ESTOP_OPEN}, Case{5, protocol::ESTOP_OPEN}}) {
    Rig rig;
    rig.arm();
    rig.board.set_estop(each.volt);
    rig.drive_for(5);
    CHECK(rig.faults() == each.fault);
  }
  Rig rig;  // the pin alone, before the converter has seen it
  rig.arm();
  rig.board.loop_open = true;
  rig.drive_for(1);
  CHECK(rig.faults() == protocol::ESTOP_OPEN);
}

TEST_CASE("A wheel that turns faster than asked latches after 0.4 s, armed only") {
  for (const bool armed : {true, false}) {
    Rig rig;
    rig.set(Param::hall_per_metre, 1000);
    rig.tick(2);
    if (armed) rig.arm();
    int ticks = 0;
    for (; ticks < 400 && rig.faults() == 0; ++ticks) {
      rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + 1);  // 2 m/s
      rig.drive_for(1);
    }
    CHECK(rig.faults() == (armed ? protocol::WHEEL_RUNAWAY : 0U));
    if (armed) CHECK(ticks <= 85);
  }
}

TEST_CASE("A machine that slows as its lag lets it is no runaway, and one without a lag is") {
  for (const int16_t lag_ms : {1000, 0}) {
    Rig rig;
    rig.set(Param::hall_per_metre, 1000);
    rig.set(Param::drive_lag, lag_ms);
    rig.set(Param::drive_accel, 5000);
    rig.arm();
    rig.ask(1000);
    const auto roll = [&rig](int ticks, int ticks_a_pulse) {
      for (int k = 0; k < ticks; ++k) {
        if (k % ticks_a_pulse == 0) rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + 1);
        rig.drive_for(1);
      }
    };
    roll(400, 2);  // 1 m/s
    rig.ask(200);
    roll(130, 3);  // 0.67 m/s, 0.35 and more above what is asked, for half a second
    CHECK(rig.faults() == (lag_ms == 0 ? protocol::WHEEL_RUNAWAY : 0U));
    rig.ask(0);
    roll(600, 3);  // and it does not slow at all
    CHECK(rig.faults() == protocol::WHEEL_RUNAWAY);
  }
}

TEST_CASE("Pulses that no machine can give are noise") {
  Rig rig;
  rig.set(Param::hall_per_metre, 200);
  rig.tick(2);
  for (int i = 0; i < 40; ++i) {
    rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + 3);
    rig.tick();
  }
  CHECK(rig.faults() == protocol::HALL_NOISE);
}

TEST_CASE("A torn battery wire makes the machine no faster than the lowest battery would") {
  Rig rig;  // without a wheel sensor nothing else holds the speed
  rig.arm();
  rig.ask(300);
  rig.drive_for(200);
  REQUIRE(rig.state() == State::RUNNING);
  const int whole = rig.board.drive.pwm;
  REQUIRE(whole == 77);
  rig.board.set_battery(0);
  int ticks = 0;
  for (; rig.state() == State::RUNNING; ++ticks) {
    CHECK(rig.board.drive.pwm <= whole * 12 / 10);  // nominal over battery_low
    rig.drive_for(1);
  }
  CHECK(ticks == 120);
  CHECK(rig.faults() == protocol::BATTERY_LOW);
  CHECK(rig.off());
}

TEST_CASE("With two hall sensors the wrong way latches") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.set(Param::hall_phases, 2);
  rig.tick(2);
  rig.arm();
  rig.ask(300);
  for (int i = 0; i < 112; ++i) {
    if (i % 8 == 0) {
      ++rig.board.wheel;
      --rig.board.way;
    }
    rig.drive_for(1);
  }
  CHECK(rig.faults() == 0);
  for (int i = 0; i < 16; ++i) {
    if (i % 8 == 0) {
      ++rig.board.wheel;
      --rig.board.way;
    }
    rig.drive_for(1);
  }
  CHECK(rig.faults() == protocol::WRONG_WAY);
  CHECK(protocol::get<int32_t>(rig.telemetry().data() + 20) < -100);
}

TEST_CASE("The blade's sensor shows a blade that does not turn, and one that does not stop") {
  for (const bool welded : {false, true}) {
    Rig rig;
    rig.set(Param::blade_turn_min, 20);
    rig.tick(2);
    rig.arm();
    rig.ask(0, 0, !welded);
    int ticks = 0;
    for (; ticks < 1000 && rig.faults() == 0; ++ticks) {
      if (welded && ticks % 5 == 0) ++rig.board.blade_turns;
      rig.drive_for(1);
    }
    CHECK(rig.faults() == (welded ? protocol::BLADE_STUCK : protocol::BLADE_LOST));
    CHECK(ticks >= 295);
    CHECK(ticks < 325);
  }
}

TEST_CASE("The readings say what the sensors read and what went wrong underneath") {
  Rig rig;
  rig.board.trouble = {3, 4};
  rig.board.wheel = 7;
  rig.board.blade_turns = 8;
  rig.board.set_steer_current(-2);
  rig.board.set_drive_current(5);
  rig.tick(64);
  int found = 0;
  for (const Answer &answer : rig.board.answers(true)) {
    if (answer.id != protocol::Readings::kId) continue;
    ++found;
    const uint8_t *p = answer.payload.data();
    using protocol::get;
    CHECK(get<int16_t>(p) == doctest::Approx(200).epsilon(0.02));
    CHECK(get<int16_t>(p + 2) == doctest::Approx(500).epsilon(0.02));
    for (int i = 0; i < 5; ++i) {
      const int order[] = {0, 1, 2, 3, 4};
      CHECK(get<uint16_t>(p + 4 + 2 * i) == rig.board.analog_in[order[i]]);
    }
    CHECK(get<uint16_t>(p + 14) == 7);
    CHECK(get<uint16_t>(p + 16) == 8);
    CHECK(get<uint16_t>(p + 18) == 3);
    CHECK(get<uint16_t>(p + 20) == 4);
    CHECK(get<uint16_t>(p + 22) == 0);
  }
  CHECK(found == 2);
}

TEST_CASE("Of many Hellos in a tick one is answered") {
  Rig rig;
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 5; ++i) rig.board.type(protocol::Hello::kId, {protocol::kVersion});
    rig.tick();
    int found = 0;
    for (const Answer &answer : rig.board.answers()) found += answer.id == protocol::Version::kId;
    CHECK(found == 1);
  }
}

TEST_CASE("A machine that a slope drives faster than it is told gets no duty, and is braked") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.set(Param::drive_kp, 10000);
  rig.arm();
  rig.ask(300);
  for (int tick = 0; tick < 70; ++tick) {
    rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + 1);  // 2 m/s
    rig.drive_for(1);
  }
  CHECK(rig.state() == State::RUNNING);
  CHECK(rig.brakes());
}

TEST_CASE(
    "A machine that a slope drives is braked as far as it is too fast, and let go on the flat") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.set(Param::drive_kp, 0);
  rig.set(Param::drive_ki, 0);
  rig.arm();
  rig.ask(500);
  // A pulse each 10 mm: at 0.5 m/s four ticks, at 1 m/s two.
  const auto roll = [&rig](int ticks, int each) {
    for (int tick = 0; tick < ticks; ++tick) {
      if (tick % each == 0) rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + 1);
      rig.drive_for(1);
    }
  };
  roll(150, 5);  // 0.4 m/s
  CHECK(rig.board.drive.in1);
  CHECK(rig.board.drive.pwm == 128);
  roll(40, 2);
  CHECK(!rig.board.drive.in1);
  CHECK(!rig.board.drive.in2);
  CHECK(rig.board.drive.pwm == 255 - 128 + 16);
  roll(40, 5);
  CHECK(rig.board.drive.in1);
  CHECK(rig.board.drive.pwm == 128);
}

TEST_CASE("A machine that rolls back as it is told to climb is driven, not braked") {
  for (const int16_t phases : {1, 2}) {
    Rig rig;
    rig.set(Param::hall_per_metre, 1000);
    rig.set(Param::hall_phases, phases);
    rig.set(Param::drive_kp, 0);
    rig.set(Param::drive_ki, 0);
    rig.arm();
    const auto creep = [&rig](int ticks) {  // 0.2 m/s, held by its brake
      for (int tick = 0; tick < ticks; ++tick) {
        const bool pulse = tick % 10 == 0;
        rig.board.wheel = static_cast<uint16_t>(rig.board.wheel + pulse);
        rig.board.way = static_cast<uint16_t>(rig.board.way - pulse);
        rig.drive_for(1);
      }
    };
    creep(60);
    CHECK(rig.brakes());
    rig.ask(100);
    creep(60);
    CHECK(rig.board.drive.in1);
    CHECK(rig.board.drive.pwm == 26);
  }
}

TEST_CASE("A machine that does not move off is driven harder") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.arm();
  rig.ask(200);
  rig.drive_for(100);
  // 51 for the speed, 16 and 40 a second for what is missing, 150 a second from 0.2 s on.
  CHECK(rig.board.drive.pwm > 100);
}

TEST_CASE("Told to stand after it has driven, the machine holds its wheels until it is stopped") {
  Rig rig;
  rig.arm();
  rig.drive_for(20);
  CHECK(rig.board.drive.pwm == 0);
  rig.ask(300);
  rig.drive_for(100);
  CHECK(rig.board.drive.in1);
  rig.ask(0);
  rig.drive_for(200);
  CHECK(rig.brakes());
  rig.ident(0, 100);
  rig.tick(2);
  CHECK(rig.brakes());
  rig.board.type(protocol::Stop::kId, {});
  rig.tick();
  CHECK(rig.off());
  rig.arm();
  rig.drive_for(20);
  CHECK(rig.board.drive.pwm == 0);
}

TEST_CASE("Armed, a machine that begins to roll is held before it was ever driven") {
  Rig rig;
  rig.set(Param::hall_per_metre, 500);
  rig.board.wheel = 1;
  rig.tick(20);
  rig.board.wheel = 2;
  rig.tick();
  CHECK(rig.off());
  rig.tick(300);
  rig.arm();
  rig.board.wheel = 3;  // the first pulse after standing may be a wheel that settles
  rig.drive_for(20);
  CHECK(rig.board.drive.pwm == 0);
  rig.board.wheel = 4;
  rig.drive_for(1);
  CHECK(rig.brakes());
  rig.drive_for(400);
  CHECK(rig.brakes());
  rig.board.type(protocol::Stop::kId, {});
  rig.tick();
  CHECK(rig.off());
}

TEST_CASE("Without a wheel sensor nothing is held before the machine was driven") {
  Rig rig;
  CHECK(rig.controller.params()[Param::hall_per_metre] == 0);
  rig.arm();
  for (uint16_t pulse = 0; pulse < 20; ++pulse) {
    rig.board.wheel = pulse;
    rig.drive_for(10);
  }
  CHECK(rig.board.drive.pwm == 0);
}

TEST_CASE("Driver style and PWM frequency act at once") {
  Rig rig;
  rig.set(Param::steer_driver, 3);
  rig.set(Param::steer_pwm_freq, 4000);
  rig.tick(2);
  rig.arm();
  rig.ask(0, 2000);
  rig.drive_for(10);
  CHECK(rig.board.steer.in1);
  CHECK(rig.board.steer.pwm > 0);
  CHECK(rig.board.steer_hz == 4000);
}

TEST_CASE("Parameters are read in any state, and unknown ones refused") {
  Rig rig;
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::ParamGet::kId, {static_cast<uint8_t>(Param::steer_kp)});
  rig.tick();
  const auto answers = rig.board.answers();
  REQUIRE(answers.size() == 1);
  CHECK(answers[0].id == protocol::ParamValue::kId);
  CHECK(answers[0].payload[0] == static_cast<uint8_t>(Param::steer_kp));
  CHECK(protocol::get<int16_t>(answers[0].payload.data() + 1) ==
        rig.controller.params()[Param::steer_kp]);
  rig.board.type(protocol::ParamGet::kId, {protocol::kParams});
  CHECK(result_of(rig) == as_int(Result::UNKNOWN));
  rig.board.type(protocol::ParamSet::kId, {protocol::kParams, 0, 0});
  CHECK(result_of(rig) == as_int(Result::UNKNOWN));
  rig.board.type(protocol::ParamSet::kId, {0, 4, 0});
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
}

TEST_CASE("Parameters change in SAFE and FAULT only, and act at once") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.arm();
  rig.ask(0, 3000);
  rig.drive_for(40);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) == 1000);
  rig.board.answers();
  rig.board.type(protocol::ParamSet::kId, {static_cast<uint8_t>(Param::steer_limit), 0, 8});
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.board.type(protocol::ParamSave::kId);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.board.type(protocol::ParamDefaults::kId);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  CHECK(rig.controller.params()[Param::steer_limit] == 1000);
  rig.board.set_estop(5);
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::ParamDefaults::kId);
  CHECK(result_of(rig) == as_int(Result::OK));
  CHECK(rig.controller.params()[Param::steer_limit] == 5000);
}

TEST_CASE("One ParamDefaults a tick is taken: a line full of them would take too long") {
  Rig rig;
  for (int tick = 0; tick < 2; ++tick) {
    rig.board.answers();
    rig.board.type(protocol::ParamDefaults::kId);
    rig.board.type(protocol::ParamSet::kId, {static_cast<uint8_t>(Param::steer_limit), 0, 8});
    rig.board.type(protocol::ParamDefaults::kId);
    rig.tick();
    int acks = 0;
    for (const Answer &answer : rig.board.answers()) acks += answer.id == protocol::Ack::kId;
    CHECK(acks == 2);
    CHECK(rig.controller.params()[Param::steer_limit] == 0x800);
  }
}

TEST_CASE("Defaults act at once") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.board.type(protocol::ParamDefaults::kId);
  rig.tick(2);
  rig.set(Param::steer_driver, 2);
  rig.set(Param::drive_driver, 3);
  rig.arm();
  rig.ask(0, 3000);
  rig.drive_for(90);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) == 3000);
}

TEST_CASE("A save is acknowledged when it is done, and nothing changes or arms meanwhile") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.board.answers();
  rig.board.next_seq = 9;
  rig.board.type(protocol::ParamSave::kId);
  rig.tick();
  CHECK(rig.result() == -1);
  rig.board.type(protocol::ParamSet::kId, {0, 1, 0});
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  int ticks = 0;
  for (bool done = false; !done && ticks < 1000; ++ticks) {
    rig.tick();
    for (const Answer &answer : rig.board.answers()) {
      if (answer.id != protocol::Ack::kId) continue;
      CHECK(answer.payload ==
            std::vector<uint8_t>{protocol::ParamSave::kId, 9, static_cast<uint8_t>(Result::OK)});
      done = true;
    }
  }
  CHECK(ticks < 1000);
  Rig again(false);
  memcpy(again.board.eeprom, rig.board.eeprom, sizeof rig.board.eeprom);
  again.controller.boot(again.board);
  CHECK(again.controller.params()[Param::steer_limit] == 1000);
  again.arm();
}

TEST_CASE("A save that does not read back is refused and keeps the machine from arming") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.board.worn_out = 2 + 2 * static_cast<int>(Param::steer_limit);
  rig.board.answers();
  rig.board.type(protocol::ParamSave::kId);
  rig.tick(400);
  CHECK(rig.result() == as_int(Result::STORE_FAILED));
  CHECK(rig.faults() == protocol::PARAMS_BAD);
  rig.board.worn_out = -1;
  rig.board.type(protocol::ParamSave::kId);
  rig.tick(400);
  CHECK(rig.result() == as_int(Result::OK));
  rig.board.type(protocol::Clear::kId);
  CHECK(result_of(rig) == as_int(Result::OK));
}

TEST_CASE("A calibration in disorder is a parameter fault until it is mended") {
  Rig rig;
  rig.set(Param::pot_left, 2870);
  CHECK(rig.faults() == protocol::PARAMS_BAD);
  rig.board.answers();
  rig.board.type(protocol::Clear::kId);
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  rig.set(Param::pot_left, 7370);
  rig.board.answers();
  rig.board.type(protocol::Clear::kId);
  CHECK(result_of(rig) == as_int(Result::OK));
}

TEST_CASE("Identification gives the asked duty for the asked time, ARMED only") {
  Rig rig;
  rig.ident(100, 50);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.arm();
  rig.ident(-100, 50);
  CHECK(result_of(rig) == as_int(Result::OK));
  for (int i = 1; i < 10; ++i) {
    CHECK(rig.board.steer.lpwm == 100);
    CHECK(rig.board.steer.pwm == 0);
    rig.tick();
  }
  CHECK(rig.board.steer.lpwm == 100);
  rig.tick();
  CHECK(rig.off());
  rig.tick(30);
  CHECK(rig.faults() == 0);
  rig.tick(20);
  CHECK(rig.faults() == protocol::LINK_LOST);
}

TEST_CASE("Identification refuses too much duty and too long a time") {
  Rig rig;
  rig.arm();
  rig.ident(200, 3000);
  CHECK(result_of(rig) == as_int(Result::OK));
  rig.ident(201, 10);
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
  rig.ident(-201, 10);
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
  rig.ident(-32768, 10);
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
  rig.ident(10, 3001);
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
  rig.ident(10, 65535);
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
}

TEST_CASE("Identification is refused while the machine drives") {
  Rig rig;
  rig.arm();
  rig.ask(500);
  rig.drive_for(5);
  rig.board.answers();
  rig.ident(100, 50);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
}

TEST_CASE("Identification stops at its angle, to either side, but may come back") {
  for (const int sign : {1, -1}) {
    Rig rig;
    rig.board.set_angle(sign * 36);
    rig.arm();
    rig.ident(static_cast<int16_t>(-sign * 100), 100);
    rig.tick(3);
    CHECK(rig.faults() == 0);
    CHECK(rig.board.steer.pwm - rig.board.steer.lpwm == -sign * 100);
    rig.ident(static_cast<int16_t>(sign * 100), 100);
    rig.tick();
    CHECK(rig.off());
    rig.tick();
    CHECK(rig.faults() == protocol::IDENT_LIMIT);
    rig.board.answers();
    rig.tick();
    rig.board.type(protocol::Clear::kId);
    CHECK(result_of(rig) == as_int(Result::OK));
  }
}

TEST_CASE("At its angle limit exactly, identification goes on") {
  for (const int sign : {1, -1}) {
    Rig rig;
    rig.board.set_angle(sign * 35);
    rig.arm();
    rig.ident(static_cast<int16_t>(sign * 100), 100);
    rig.tick(3);
    CHECK(rig.faults() == 0);
    CHECK(rig.board.steer.pwm - rig.board.steer.lpwm == sign * 100);
  }
}

TEST_CASE("The time of identification adds up; after a DRIVE it has all of it again") {
  for (const int drive_at : {-1, 30}) {
    Rig rig;
    rig.set(Param::ident_time_max, 300);
    rig.arm();
    double angle = 0;
    int driven = 0;
    for (int i = 0; i < 120 && rig.faults() == 0; ++i) {
      if (i == drive_at) {
        rig.ask(0, static_cast<int16_t>(angle * 100));
        rig.drive_for(1);
        driven = 0;
      }
      rig.ident(100, 20);
      rig.tick();
      driven += rig.board.steer.pwm != 0;
      rig.board.set_angle(angle += 0.1);
    }
    CHECK(rig.faults() == protocol::IDENT_LIMIT);
    CHECK(driven == 60);
  }
}

TEST_CASE("Identification with no duty releases the motor, and that costs none of its time") {
  Rig rig;
  rig.set(Param::ident_time_max, 100);
  rig.arm();
  for (int i = 0; i < 60; ++i) {
    rig.ident(0, 100);
    rig.tick();
    CHECK(rig.off());
  }
  CHECK(rig.faults() == 0);
  CHECK(rig.state() == State::ARMED);
}

TEST_CASE("The smallest duty identifies too, inward and outward") {
  Rig rig;
  rig.arm();
  rig.ident(1, 5);
  rig.tick();
  CHECK(rig.board.steer.pwm == 1);
  rig.tick();
  CHECK(rig.off());
  for (const int sign : {1, -1}) {
    Rig outside;
    outside.board.set_angle(sign * 36);
    outside.arm();
    outside.ident(static_cast<int16_t>(sign), 100);
    outside.tick(2);
    CHECK(outside.faults() == protocol::IDENT_LIMIT);
  }
}

TEST_CASE("After identification the steering starts afresh from where the wheel is") {
  Rig rig;
  rig.set(Param::steer_slew, 1000);
  rig.arm();
  rig.ask(0, 1000);
  rig.drive_for(40);
  for (int degrees = 0; degrees <= 20; ++degrees) {
    rig.ident(100, 10);
    rig.board.set_angle(degrees);
    rig.tick();
  }
  rig.ask(0, 3000);
  rig.drive_for(1);
  rig.drive_for(3);
  // 100 deg/s from 20 degrees, seen at most four ticks later.
  const int16_t setpoint = protocol::get<int16_t>(rig.telemetry().data() + 9);
  CHECK(setpoint >= 2050);
  CHECK(setpoint <= 2400);
}

TEST_CASE("After STOP the telemetry shows nothing on, and arming again begins from standstill") {
  Rig rig;
  rig.set(Param::steer_slew, 1000);
  rig.arm();
  rig.ask(1000, 3000, true);
  for (int i = 0; i < 40; ++i) {
    rig.board.set_angle(i / 4);
    rig.drive_for(1);
  }
  rig.board.type(protocol::Stop::kId);
  const auto payload = rig.telemetry();
  CHECK(protocol::get<int16_t>(payload.data() + 13) == 0);
  CHECK(protocol::get<int16_t>(payload.data() + 15) == 0);
  CHECK(payload[17] == 0);
  rig.ask(0);
  rig.drive_for(1);
  rig.arm();
  rig.ask(1000, 3000);
  rig.drive_for(1);
  CHECK(rig.board.drive.pwm == 1);
  rig.drive_for(3);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) <= 1400);
}

TEST_CASE("STOP and re-arming give identification its time back") {
  Rig rig;
  rig.set(Param::ident_time_max, 100);
  for (int k = 0; k < 3; ++k) {
    rig.arm();
    rig.ident(100, 75);
    rig.tick(16);
    CHECK(rig.faults() == 0);
    rig.board.type(protocol::Stop::kId);
    rig.tick();
  }
}

TEST_CASE("Sensors over the link are refused by a board that has its own") {
  Rig rig;
  rig.board.type(protocol::HilSensors::kId, std::vector<uint8_t>(protocol::HilSensors::kSize, 3));
  CHECK(result_of(rig) == as_int(Result::UNKNOWN));
}

TEST_CASE("A board that takes them is answered by what the outputs would be") {
  Rig rig;
  rig.board.hil = true;
  rig.arm();
  rig.ask(500, -2000, true);
  rig.drive_for(40);
  rig.board.answers();
  std::vector<uint8_t> payload;
  for (uint8_t i = 1; i <= protocol::HilSensors::kSize; ++i) payload.push_back(i);
  rig.board.type(protocol::HilSensors::kId, payload);
  rig.drive_for(1);
  CHECK(rig.board.injected.pot == 0x0201);
  CHECK(rig.board.injected.hall == 0x0C0B);
  int outputs = 0;
  for (const Answer &answer : rig.board.answers()) {
    if (answer.id != protocol::HilOutputs::kId) continue;
    ++outputs;
    CHECK(protocol::get<int16_t>(answer.payload.data()) == -rig.board.steer.lpwm);
    CHECK(protocol::get<int16_t>(answer.payload.data() + 2) == rig.board.drive.pwm);
    CHECK(answer.payload[4] == 1);
  }
  CHECK(outputs == 1);
  rig.tick();
  for (const Answer &answer : rig.board.answers()) CHECK(answer.id != protocol::HilOutputs::kId);
}

TEST_CASE("The LED is on while live, blinks slowly when SAFE and fast in FAULT") {
  Rig safe;
  Rig fault;
  fault.board.set_estop(5);
  for (int i = 0; i < 600; ++i) {
    safe.tick();
    CHECK(safe.board.lamp == (i % 256 < 128));
    fault.tick();
    CHECK(fault.board.lamp == (i % 32 < 16));
  }
  Rig live;
  live.arm();
  for (int i = 0; i < 300; ++i) {
    live.drive_for(1);
    CHECK(live.board.lamp);
  }
}

TEST_CASE("Parameters act once the line has time, and ARM waits for that") {
  Rig rig;
  const auto set_limit = [&rig](int16_t value) {
    rig.board.type(protocol::ParamSet::kId,
                   {static_cast<uint8_t>(Param::steer_limit), static_cast<uint8_t>(value),
                    static_cast<uint8_t>(value >> 8)});
  };
  for (const int16_t limit : {600, 800, 1000}) set_limit(limit);
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::NOT_PLAUSIBLE));
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  CHECK(result_of(rig) == as_int(Result::OK));
  rig.ask(0, 3000);
  rig.drive_for(90);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) == 1000);
}

TEST_CASE("With two commands in its tick a parameter acts in that and the next") {
  Rig rig;
  rig.board.type(protocol::Hello::kId, {1});
  rig.set(Param::steer_limit, 1000);
  rig.arm();
}

TEST_CASE("The steering's parameters act in the first tick, what else there is in the second") {
  Rig rig;
  rig.board.type(protocol::ParamSet::kId,
                 {static_cast<uint8_t>(Param::steer_pwm_freq), 0x88, 0x13});
  rig.tick();
  CHECK(rig.board.steer_hz == 20000);
  rig.tick();
  CHECK(rig.board.steer_hz == 5000);
  rig.board.type(protocol::ParamDefaults::kId);
  rig.tick(2);
  CHECK(rig.board.steer_hz == 20000);
}

TEST_CASE("Identification switches the blade off") {
  Rig rig;
  rig.arm();
  rig.ask(0, 0, true);
  rig.drive_for(2);
  REQUIRE(rig.board.blade);
  rig.ident(100, 20);
  rig.tick();
  CHECK(!rig.board.blade);
}

TEST_CASE("After STOP identification has all of its time again, and no more") {
  for (const int ticks : {20, 21}) {
    Rig rig;
    rig.set(Param::ident_time_max, 100);
    for (int round = 0; round < 2; ++round) {
      rig.arm(false);
      for (int i = 0; i < (round == 0 ? 5 : ticks); ++i) {
        rig.ident(100, 100);
        rig.tick();
      }
      CHECK((rig.state() == State::ARMED) == true);
      rig.tick();
      CHECK(rig.faults() == (round == 1 && ticks == 21 ? protocol::IDENT_LIMIT : 0U));
      rig.board.type(protocol::Stop::kId);
      rig.tick();
    }
  }
}

TEST_CASE("After STOP the blade wants to be asked anew") {
  Rig rig;
  rig.arm();
  rig.ask(0, 0, true);
  rig.drive_for(2);
  rig.board.type(protocol::Stop::kId);
  rig.tick();
  rig.arm(false);
  rig.drive_for(200);
  CHECK(!rig.board.blade);
}

TEST_CASE("A blade that turns on after STOP is a fault, whatever the state") {
  Rig rig;
  rig.set(Param::blade_turn_min, 20);
  rig.tick(2);
  rig.arm();
  rig.ask(0, 0, true);
  rig.drive_for(2);
  rig.board.type(protocol::Stop::kId);
  for (int i = 0; i < 310; ++i) {
    ++rig.board.blade_turns;
    rig.tick();
  }
  CHECK(rig.faults() == protocol::BLADE_STUCK);
}

TEST_CASE("A driver's rating is its data sheet's; none has none") {
  CHECK(bridge_rating(BridgeStyle::kL298n) == 400);
  CHECK(bridge_rating(BridgeStyle::kBts7960) == 3000);
  CHECK(bridge_rating(BridgeStyle::kVnh5019) == 3000);
  CHECK(bridge_rating(BridgeStyle::kNotSet) == 0);
  CHECK(bridge_peak(BridgeStyle::kL298n) == 500);
  CHECK(bridge_peak(BridgeStyle::kBts7960) ==
        param_range(static_cast<uint8_t>(Param::steer_current_max)).high);
  CHECK(bridge_peak(BridgeStyle::kVnh5019) ==
        param_range(static_cast<uint8_t>(Param::drive_current_max)).high);
  CHECK(bridge_peak(BridgeStyle::kNotSet) == 0);
}

TEST_CASE("A driver that there is not drives nothing and stands nothing") {
  const auto none = static_cast<BridgeStyle>(4);
  for (const Bridging bridging : {Bridging::kDrive, Bridging::kBrake}) {
    const BridgeWires wires = bridge_wires(none, 255, 0, bridging);
    CHECK((wires.pwm == 0 && wires.lpwm == 0 && !wires.in1 && !wires.in2));
  }
  CHECK(bridge_rating(none) == 0);
  CHECK(bridge_peak(none) == 0);
  CHECK(bridge_fastest(none) == 0);
}
