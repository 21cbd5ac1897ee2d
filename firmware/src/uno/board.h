// The Board of an Arduino Uno (ATmega328P at 16 MHz). Section numbers are the datasheet's
// (Microchip DS40002061B).
#pragma once
#include "../board.h"

namespace daranti {

class UnoBoard : public Board {
 public:
  // Pins, timers, converter, UART and watchdog; then the 1 ms clock starts at zero.
  void begin();
  // Sleeps until the next tick is due.
  void wait_for_tick();

  uint32_t time_us() const override { return tick_us_; }
  uint16_t analog(Analog channel) const override;
  bool pin(uint8_t pin) const override;
  uint16_t hall_pulses() const override;
  void set_pin(uint8_t pin, bool level) override;
  void set_pwm(uint8_t pin, uint8_t duty) override;
  void set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) override;
  bool receive(uint8_t *byte) override;
  bool send(const uint8_t *bytes, uint8_t count) override;
  uint8_t load(uint16_t address) const override;
  void store(uint16_t address, uint8_t byte) override;
  bool storing() const override;
  void kick_watchdog() override;
  uint8_t reset_cause() const override;
  uint8_t build() const override { return 0; }

 private:
  uint32_t tick_us_ = 0;
  uint32_t steer_scale_ = 0;  // timer 1's compare value for a duty of 1, 2^-16
};

// For a bench without a digital-to-analog converter: what the sensors read comes over the link,
// and no output but the LED ever leaves this board.
class HilBoard final : public UnoBoard {
 public:
  uint16_t analog(Analog channel) const override;
  bool pin(uint8_t pin) const override;
  uint16_t hall_pulses() const override { return sensors_.hall; }
  void set_pin(uint8_t pin, bool level) override;
  void set_pwm(uint8_t, uint8_t) override {}
  bool inject(const protocol::HilSensors &sensors) override;
  uint8_t build() const override { return 2; }

 private:
  protocol::HilSensors sensors_{0, 0, 0, 0, 1, 0};  // nothing plausible until the plant speaks
};

}  // namespace daranti
