#include <doctest.h>

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
    if (boot) controller.boot(board);
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
  void arm() {
    board.type(protocol::Arm::kId, {protocol::kVersion});
    tick();
    REQUIRE(state() == State::ARMED);
  }
  void set(Param param, int16_t value) {
    board.type(protocol::ParamSet::kId, {static_cast<uint8_t>(param), static_cast<uint8_t>(value),
                                         static_cast<uint8_t>(value >> 8)});
    tick();
    REQUIRE(controller.params()[param] == value);
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
  bool off() const {
    for (const uint8_t pin : {3, 9, 10, 11}) {
      if (board.pwm[pin] != 0) return false;
    }
    for (const uint8_t pin : {4, 5, 6, 7, 8}) {
      if (board.pin_out[pin]) return false;
    }
    return true;
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
  for (uint8_t pin = 3; pin < 12; ++pin) {
    rig.board.pwm[pin] = 255;
    rig.board.pin_out[pin] = true;
  }
  rig.controller.boot(rig.board);
  CHECK(rig.off());
  CHECK(rig.board.steer_hz == 20000);
  CHECK(rig.board.drive_hz == 3922);
  CHECK(rig.state() == State::SAFE);
}

TEST_CASE("Boot reads the reset's cause and the stored parameters") {
  Rig rig(false);
  rig.board.cause = 8;
  rig.board.eeprom[0] = 0;
  rig.controller.boot(rig.board);
  rig.tick();
  CHECK(rig.faults() == (protocol::WATCHDOG | protocol::PARAMS_BAD));
  CHECK(rig.state() == State::FAULT);
}

TEST_CASE("Every tick kicks the watchdog once") {
  Rig rig;
  rig.tick(10);
  CHECK(rig.board.kicks == 10);
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
  CHECK(answers[0].payload ==
        std::vector<uint8_t>{protocol::kVersion, kFirmwareMajor, kFirmwareMinor, 1, 1});
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

TEST_CASE("Frames to the host count modulo 256; one that did not fit is not counted") {
  Rig rig;
  rig.tick(4 * 300);
  const auto answers = rig.board.answers();
  REQUIRE(answers.size() == 300);
  for (size_t i = 0; i < answers.size(); ++i) CHECK(answers[i].seq == i % 256);
  rig.board.line_full = true;
  rig.tick(8);
  rig.board.line_full = false;
  rig.tick(4);
  const auto later = rig.board.answers();
  REQUIRE(later.size() == 1);
  CHECK(later[0].seq == 300 % 256);
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
  CHECK(get<int16_t>(p + 13) == rig.board.pwm[9]);
  CHECK(get<int16_t>(p + 15) == rig.board.pwm[3]);
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
  rig.board.estop_open = true;
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
    if (which == 0) rig.board.estop_open = true;
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
  rig.arm();
  rig.tick(20);
  CHECK(rig.off());
}

TEST_CASE("Armed, the steering and the blade work; the wheels only with a speed") {
  Rig rig;
  rig.arm();
  rig.ask(0, 2000, true);
  rig.drive_for(20);
  CHECK(rig.state() == State::ARMED);
  CHECK(rig.board.pwm[9] > 0);
  CHECK(rig.board.pin_out[7]);
  CHECK(!rig.board.pin_out[8]);
  CHECK(rig.board.pwm[3] == 0);
  CHECK(rig.board.pin_out[6]);
  rig.ask(500, 0, false);
  rig.drive_for(200);
  CHECK(rig.state() == State::RUNNING);
  CHECK(rig.board.pwm[3] == 128);
  CHECK(rig.board.pin_out[4]);
  CHECK(!rig.board.pin_out[5]);
  CHECK(!rig.board.pin_out[6]);
}

TEST_CASE("The blade is off in reverse, from the asking until the machine goes forward again") {
  Rig rig;
  rig.arm();
  rig.ask(500, 0, true);
  rig.drive_for(100);
  CHECK(rig.board.pin_out[6]);
  rig.ask(-500, 0, true);
  rig.drive_for(1);
  CHECK(!rig.board.pin_out[6]);
  CHECK(rig.board.pin_out[4]);
  rig.drive_for(200);
  CHECK(rig.board.pin_out[5]);
  rig.ask(500, 0, true);
  rig.drive_for(50);
  CHECK(rig.board.pin_out[5]);
  CHECK(!rig.board.pin_out[6]);
  rig.drive_for(100);
  CHECK(rig.board.pin_out[6]);
}

TEST_CASE("The blade is off while the hall sensor shows the machine rolling backward") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.arm();
  rig.ask(-500);
  for (int i = 0; i < 200; ++i) {
    rig.board.pulses = static_cast<uint16_t>(i / 4);
    rig.drive_for(1);
  }
  rig.ask(0, 0, true);
  int off_ticks = 0;
  for (int i = 0; i < 600; ++i) {
    rig.drive_for(1);
    off_ticks += !rig.board.pin_out[6];
  }
  // The ramp down takes 100 ticks, the last pulse counts for 200.
  CHECK(off_ticks > 150);
  CHECK(rig.board.pin_out[6]);
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

TEST_CASE("Every fault puts all outputs off in the tick that finds it") {
  Rig rig;
  rig.arm();
  rig.ask(500, 2000, true);
  rig.drive_for(50);
  rig.board.estop_open = true;
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

TEST_CASE("A fault whose cause lasts is not cleared") {
  Rig rig;
  rig.board.estop_open = true;
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
  };
  for (const Case &each :
       {Case{&FakeBoard::set_steer_current, 19.9, 20.1, protocol::STEER_OVERCURRENT},
        Case{&FakeBoard::set_drive_current, 39.9, 40.1, protocol::DRIVE_OVERCURRENT},
        Case{&FakeBoard::set_battery, 10.01, 9.98, protocol::BATTERY_LOW},
        Case{&FakeBoard::set_battery, 15.48, 15.52, protocol::BATTERY_HIGH},
        Case{&FakeBoard::set_pot, 904, 905, protocol::POT_OPEN},
        Case{&FakeBoard::set_pot, 120, 119, protocol::POT_SHORT}}) {
    Rig rig;
    (rig.board.*each.set)(each.good);
    rig.tick(400);
    CHECK(rig.faults() == 0);
    (rig.board.*each.set)(each.bad);
    rig.tick(400);
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
  // 5005 / 2^14 of 0.01 A a step: 6550 are 20.00 A, 6551 are 20.01 A.
  for (const uint16_t reading : {6550, 6551}) {
    Rig rig;
    rig.board.analog_in[2] = reading;
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
  for (const double ampere : {0.0, 8.0}) {
    Rig rig;
    rig.board.set_steer_current(ampere);
    rig.arm();
    rig.ask(0, 3000);
    rig.drive_for(200);
    CHECK(rig.faults() == (ampere > 0 ? protocol::STEER_STALL : protocol::POT_FROZEN));
  }
}

TEST_CASE("A steering motor with its wires swapped latches as a runaway") {
  Rig rig;
  rig.arm();
  rig.ask(0, 1000);
  double angle = 0;
  for (int i = 0; i < 100; ++i) {
    if (rig.board.pin_out[7]) angle -= 0.3;
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

TEST_CASE("Hall pulses show as speed and distance, and close the loop") {
  Rig rig;
  rig.set(Param::hall_per_metre, 200);
  rig.arm();
  rig.ask(500);
  for (int i = 1; i <= 400; ++i) {
    rig.board.pulses = static_cast<uint16_t>(i / 20);
    rig.drive_for(1);
  }
  const auto payload = rig.telemetry();
  CHECK(protocol::get<int16_t>(payload.data() + 18) == 500);
  CHECK(protocol::get<int32_t>(payload.data() + 20) == 1000);
}

TEST_CASE("A BTS7960 gets its two PWMs and no direction pins") {
  Rig rig;
  rig.set(Param::steer_driver, 1);
  rig.set(Param::drive_driver, 1);
  rig.board.type(protocol::ParamSave::kId);
  rig.tick(400);
  FakeBoard board = rig.board;
  Rig again(false);
  again.board = board;
  again.controller.boot(again.board);
  again.arm();
  again.ask(500, 2000);
  again.drive_for(20);
  CHECK(again.board.pwm[9] > 0);
  CHECK(again.board.pwm[10] == 0);
  CHECK(again.board.pwm[3] > 0);
  CHECK(again.board.pwm[11] == 0);
  again.ask(-500, -2000);
  again.drive_for(60);
  CHECK(again.board.pwm[9] == 0);
  CHECK(again.board.pwm[10] > 0);
  CHECK(again.board.pwm[3] == 0);
  CHECK(again.board.pwm[11] > 0);
  for (const uint8_t pin : {4, 5, 7, 8}) CHECK(!again.board.pin_out[pin]);
}

TEST_CASE("A BTS7960's idle half goes off before the other goes on") {
  FakeBoard board;
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, 100);
  board.order.clear();
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, -100);
  CHECK(board.order.front() == 9);
  CHECK(board.pwm[9] == 0);
  CHECK(board.pwm[10] == 100);
  board.order.clear();
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, 100);
  CHECK(board.order.front() == 10);
  CHECK(board.pwm[10] == 0);
  CHECK(board.pwm[9] == 100);
}

TEST_CASE("An L298N gets its direction before its PWM, and a duty beyond 255 counts as 255") {
  FakeBoard board;
  board.pwm[10] = 7;
  drive_bridge(board, kSteerBridge, BridgeStyle::kL298n, 300);
  CHECK(board.pwm[9] == 255);
  CHECK(board.pwm[10] == 0);
  CHECK(board.pin_out[7]);
  CHECK(!board.pin_out[8]);
  drive_bridge(board, kSteerBridge, BridgeStyle::kL298n, -300);
  CHECK(board.pwm[9] == 255);
  CHECK(!board.pin_out[7]);
  CHECK(board.pin_out[8]);
  drive_bridge(board, kDriveBridge, BridgeStyle::kL298n, 0);
  CHECK(board.pwm[3] == 0);
  CHECK(!board.pin_out[4]);
  CHECK(!board.pin_out[5]);
}

TEST_CASE("An L298N brakes where it is told to, at no duty only") {
  FakeBoard board;
  drive_bridge(board, kDriveBridge, BridgeStyle::kL298n, 0, Idle::kBrake);
  CHECK(board.pwm[3] == 255);
  CHECK(board.pin_out[4]);
  CHECK(board.pin_out[5]);
  for (const int16_t duty : {int16_t{100}, int16_t{-100}}) {
    drive_bridge(board, kDriveBridge, BridgeStyle::kL298n, duty, Idle::kBrake);
    CHECK(board.pwm[3] == 100);
    CHECK(board.pin_out[4] == (duty > 0));
    CHECK(board.pin_out[5] == (duty < 0));
  }
}

TEST_CASE("A machine that a slope drives faster than it is told gets no duty, but is not braked") {
  Rig rig;
  rig.set(Param::hall_per_metre, 1000);
  rig.set(Param::drive_kp, 10000);
  rig.arm();
  rig.ask(300);
  for (int tick = 0; tick < 100; ++tick) {
    rig.board.pulses = static_cast<uint16_t>(rig.board.pulses + 10);  // 2 m/s
    rig.drive_for(1);
  }
  CHECK(rig.state() == State::RUNNING);
  CHECK(rig.board.pwm[3] == 0);
  CHECK(!(rig.board.pin_out[4] && rig.board.pin_out[5]));
}

TEST_CASE("Told to stand after it has driven, the machine holds its wheels until it is stopped") {
  Rig rig;
  rig.arm();
  rig.drive_for(20);
  CHECK(rig.board.pwm[3] == 0);
  rig.ask(300);
  rig.drive_for(100);
  CHECK(!rig.board.pin_out[5]);
  rig.ask(0);
  rig.drive_for(200);
  CHECK(rig.board.pwm[3] == 255);
  CHECK(rig.board.pin_out[4]);
  CHECK(rig.board.pin_out[5]);
  rig.board.type(protocol::Stop::kId, {});
  rig.tick();
  CHECK(rig.off());
  rig.arm();
  rig.drive_for(20);
  CHECK(rig.board.pwm[3] == 0);
  rig.ask(300);
  rig.drive_for(100);
  rig.ask(0);
  rig.drive_for(200);
  rig.ident(0, 100);
  rig.tick(2);
  CHECK(rig.off());
}

TEST_CASE("A BTS7960's direction pins are held low, and the smallest duty reaches its half") {
  FakeBoard board;
  board.pin_out[7] = board.pin_out[8] = true;
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, 1);
  CHECK(!board.pin_out[7]);
  CHECK(!board.pin_out[8]);
  CHECK(board.pwm[9] == 1);
  CHECK(board.pwm[10] == 0);
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, -1);
  CHECK(board.pwm[9] == 0);
  CHECK(board.pwm[10] == 1);
}

TEST_CASE("Off means no duty at any moment") {
  FakeBoard board;
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, -100);
  board.highest = 0;
  drive_bridge(board, kSteerBridge, BridgeStyle::kBts7960, 0);
  CHECK(board.highest == 0);
}

TEST_CASE("Driver style and PWM frequency wait for the next reset") {
  Rig rig;
  rig.set(Param::steer_driver, 1);
  rig.set(Param::steer_pwm_freq, 4000);
  rig.arm();
  rig.ask(0, 2000);
  rig.drive_for(10);
  CHECK(rig.board.pin_out[7]);
  CHECK(rig.board.steer_hz == 20000);
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
  rig.board.type(protocol::ParamSet::kId, {0, 2, 0});
  CHECK(result_of(rig) == as_int(Result::OUT_OF_RANGE));
}

TEST_CASE("Parameters change in SAFE and FAULT only, and act at once") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.arm();
  rig.ask(0, 3000);
  rig.drive_for(50);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) == 1000);
  rig.board.answers();
  rig.board.type(protocol::ParamSet::kId, {static_cast<uint8_t>(Param::steer_limit), 0, 8});
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.board.type(protocol::ParamSave::kId);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  rig.board.type(protocol::ParamDefaults::kId);
  CHECK(result_of(rig) == as_int(Result::WRONG_STATE));
  CHECK(rig.controller.params()[Param::steer_limit] == 1000);
  rig.board.estop_open = true;
  rig.tick();
  rig.board.answers();
  rig.board.type(protocol::ParamDefaults::kId);
  CHECK(result_of(rig) == as_int(Result::OK));
  CHECK(rig.controller.params()[Param::steer_limit] == 5000);
}

TEST_CASE("Defaults act at once") {
  Rig rig;
  rig.set(Param::steer_limit, 1000);
  rig.board.type(protocol::ParamDefaults::kId);
  rig.tick();
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
  rig.board.worn_out = 5;
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
    CHECK(rig.board.pwm[9] == 100);
    CHECK(rig.board.pin_out[8]);
    rig.tick();
  }
  CHECK(rig.board.pwm[9] == 100);
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
    CHECK(rig.board.pwm[9] == 100);
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
    CHECK(rig.board.pwm[9] == 100);
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
      driven += rig.board.pwm[9] != 0;
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
  CHECK(rig.board.pwm[9] == 1);
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
  CHECK(rig.board.pwm[3] == 1);
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
  CHECK(rig.board.injected.hall == 0x0B0A);
  int outputs = 0;
  for (const Answer &answer : rig.board.answers()) {
    if (answer.id != protocol::HilOutputs::kId) continue;
    ++outputs;
    CHECK(protocol::get<int16_t>(answer.payload.data()) == -rig.board.pwm[9]);
    CHECK(protocol::get<int16_t>(answer.payload.data() + 2) == rig.board.pwm[3]);
    CHECK(answer.payload[4] == 1);
  }
  CHECK(outputs == 1);
  rig.tick();
  for (const Answer &answer : rig.board.answers()) CHECK(answer.id != protocol::HilOutputs::kId);
}

TEST_CASE("The LED is on while live, blinks slowly when SAFE and fast in FAULT") {
  Rig safe;
  Rig fault;
  fault.board.estop_open = true;
  for (int i = 0; i < 600; ++i) {
    safe.tick();
    CHECK(safe.board.pin_out[13] == (i % 256 < 128));
    fault.tick();
    CHECK(fault.board.pin_out[13] == (i % 32 < 16));
  }
  Rig live;
  live.arm();
  for (int i = 0; i < 300; ++i) {
    live.drive_for(1);
    CHECK(live.board.pin_out[13]);
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
  CHECK(result_of(rig) == as_int(Result::OK));
  rig.ask(0, 3000);
  rig.drive_for(90);
  CHECK(protocol::get<int16_t>(rig.telemetry().data() + 9) == 1000);
}

TEST_CASE("With two commands in its tick a parameter acts at once") {
  Rig rig;
  rig.board.type(protocol::Hello::kId, {1});
  rig.set(Param::steer_limit, 1000);
  rig.arm();
}
