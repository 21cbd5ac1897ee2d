// What the boards with an ATmega at 16 MHz share. Section numbers are the ATmega328P's datasheet's
// (Microchip DS40002061B); the ATmega2560 has the same registers.
#pragma once
#include "board.h"

namespace daranti {

class AtmegaBoard : public Board {
 public:
  // Pins, timers, converter, UART and watchdog, whatever state they are in: a hung main loop is
  // started again without a reset.
  void begin();
  // Sleeps until the next tick is due. The first call starts the clock at zero.
  void wait_for_tick();

  uint32_t time_us() const override { return tick_us_; }
  uint16_t analog(Analog channel) const override;
  bool estop_open() const override;
  Pulses pulses() const override;
  Troubles troubles() const override;
  void set_bridge(Motor motor, const BridgeWires &wires) override;
  void set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) override;
  void set_blade(bool on) override;
  void set_lamp(bool on) override;
  bool receive(uint8_t *byte) override;
  bool send(const uint8_t *bytes, uint8_t count) override;
  uint8_t load(uint16_t address) const override;
  void store(uint16_t address, uint8_t byte) override;
  bool storing() const override;
  void kick_watchdog() override;
  void remember_armed(bool armed) override;
  uint8_t reset_cause() const override;
  uint8_t build() const override;

 private:
  uint32_t tick_us_ = 0;
  uint32_t steer_scale_ = 0;  // timer 1's compare value for a duty of 1, 2^-16
};

// For a bench without a digital-to-analog converter: what the sensors read comes over the link,
// and no output but the lamp ever leaves this board.
class HilBoard final : public AtmegaBoard {
 public:
  uint16_t analog(Analog channel) const override;
  bool estop_open() const override { return sensors_.estop >= 3000; }
  Pulses pulses() const override {
    return {sensors_.hall, sensors_.hall_way, sensors_.blade_turns};
  }
  void set_bridge(Motor, const BridgeWires &) override {}
  void set_blade(bool) override {}
  bool inject(const protocol::HilSensors &sensors) override;
  uint8_t build() const override { return 2; }

 private:
  // Nothing plausible until the plant speaks.
  protocol::HilSensors sensors_{0, 0, 2500, 2500, 5000, 0, 0, 0};
};

}  // namespace daranti
