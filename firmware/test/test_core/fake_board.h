// A board made of memory: tests set what the controller reads and look at what it drives.
#pragma once
#include <string.h>

#include <deque>
#include <vector>

#include "board.h"
#include "frame.h"

namespace daranti {

// A host's end of the link, decoded by hand: the frame's format is checked here, not trusted.
struct Answer {
  uint8_t id;
  uint8_t seq;
  std::vector<uint8_t> payload;
};

class FakeBoard final : public Board {
 public:
  FakeBoard() {
    memset(eeprom, 0xFF, sizeof eeprom);
    set_pot(512);
    analog_in[1] = 9821;  // 12.00 V
    set_steer_current(0);
    set_drive_current(0);
    set_estop(0.88);
  }

  void set_pot(double counts) { analog_in[0] = static_cast<uint16_t>(counts * 16 + 0.5); }
  void set_angle(double degrees) { set_pot(512 + 4.5 * degrees); }
  void set_battery(double volt) { analog_in[1] = static_cast<uint16_t>(volt / 20 * kAnalogMax); }
  void set_steer_current(double ampere) {
    analog_in[2] = static_cast<uint16_t>((2.5 + 0.1 * ampere) / 5 * kAnalogMax);
  }
  void set_drive_current(double ampere) {
    analog_in[3] = static_cast<uint16_t>((2.5 + 0.04 * ampere) / 5 * kAnalogMax);
  }
  void set_estop(double volt) {
    analog_in[4] = static_cast<uint16_t>(volt / 5 * kAnalogMax);
    loop_open = volt >= 3;
  }
  void type(uint8_t id, const std::vector<uint8_t> &payload = {}) {
    uint8_t frame[64];
    const uint8_t count =
        encode(id, next_seq++, payload.data(), static_cast<uint8_t>(payload.size()), frame);
    input.insert(input.end(), frame, frame + count);
  }
  // The answers since the last call, the slow Readings only where all are asked for.
  std::vector<Answer> answers(bool all = false) {
    std::vector<Answer> out;
    std::vector<uint8_t> run;
    for (const uint8_t byte : output) {
      if (byte != 0) {
        run.push_back(byte);
        continue;
      }
      std::vector<uint8_t> body;
      for (size_t at = 0; at < run.size();) {
        const size_t end = at + run[at];
        for (++at; at < end; ++at) body.push_back(run.at(at));
        if (at < run.size()) body.push_back(0);
      }
      if (all || body.at(0) != protocol::Readings::kId) {
        out.push_back({body.at(0), body.at(1), {body.begin() + 2, body.end() - 2}});
      }
      run.clear();
    }
    output.clear();
    return out;
  }

  uint32_t time_us() const override { return clock_us; }
  uint16_t analog(Analog channel) const override {
    return analog_in[static_cast<uint8_t>(channel)];
  }
  bool estop_open() const override { return loop_open; }
  Pulses pulses() const override { return {wheel, way, blade_turns}; }
  Troubles troubles() const override { return trouble; }
  void set_bridge(Motor motor, const BridgeWires &wires) override {
    (motor == Motor::kSteer ? steer : drive) = wires;
  }
  void set_blade(bool on) override { blade = on; }
  void set_lamp(bool on) override { lamp = on; }
  void set_pwm_frequency(uint16_t steering, uint16_t driving) override {
    steer_hz = steering;
    drive_hz = driving;
  }
  bool receive(uint8_t *byte) override {
    if (input.empty()) return false;
    *byte = input.front();
    input.pop_front();
    return true;
  }
  bool send(const uint8_t *bytes, uint8_t count) override {
    if (line_full) return false;
    output.insert(output.end(), bytes, bytes + count);
    return true;
  }
  uint8_t load(uint16_t address) const override { return eeprom[address]; }
  void store(uint16_t address, uint8_t byte) override {
    if (address != worn_out) eeprom[address] = byte;
    ++stores;
    busy = 1;
  }
  bool storing() const override { return busy > 0 && busy-- > 0; }
  void kick_watchdog() override { ++kicks; }
  void remember_armed(bool on) override { armed = on; }
  uint8_t reset_cause() const override { return cause; }
  uint8_t build() const override { return 1; }
  bool inject(const protocol::HilSensors &sensors) override {
    injected = sensors;
    return hil;
  }

  uint32_t clock_us = 0;
  uint16_t analog_in[kAnalogs] = {};
  bool loop_open = false;
  uint16_t wheel = 0, way = 0, blade_turns = 0;
  Troubles trouble{0, 0};
  BridgeWires steer{0, 0, false, false};
  BridgeWires drive{0, 0, false, false};
  bool blade = false;
  bool lamp = false;
  bool armed = false;
  uint16_t steer_hz = 0;
  uint16_t drive_hz = 0;
  std::deque<uint8_t> input;
  std::vector<uint8_t> output;
  bool line_full = false;
  uint8_t eeprom[1024];
  int stores = 0;
  int worn_out = -1;  // address that no longer takes a value
  mutable int busy = 0;
  int kicks = 0;
  uint8_t cause = 1;
  bool hil = false;
  protocol::HilSensors injected{};
  uint8_t next_seq = 0;
};

}  // namespace daranti
