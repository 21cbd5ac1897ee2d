// The Board seam: all that the controller may ask of hardware. The Uno implements it in uno/, the
// desk in desk/. Nothing behind it blocks for longer than a few microseconds.
#pragma once
#include <stdint.h>

#include "pins.h"
#include "protocol.h"

namespace daranti {

constexpr uint16_t kTickUs = 5000;
constexpr uint16_t kTickMs = kTickUs / 1000;
constexpr uint16_t kAnalogMax = 1023 * 16;  // what analog() gives for 5 V

class Board {
 public:
  // When the current tick was due, in microseconds since boot; wraps.
  virtual uint32_t time_us() const = 0;
  // Mean of the samples since the last tick, in 1/16 ADC counts: 0..kAnalogMax for 0..5 V.
  virtual uint16_t analog(Analog channel) const = 0;
  // Level of an input pin.
  virtual bool pin(uint8_t pin) const = 0;
  // Falling edges on the hall pin since boot, modulo 65536.
  virtual uint16_t hall_pulses() const = 0;

  virtual void set_pin(uint8_t pin, bool level) = 0;
  // pin: one of the four PWM pins in pins.h; duty 0..255 of 255, with 0 and 255 free of glitches.
  virtual void set_pwm(uint8_t pin, uint8_t duty) = 0;
  // Both bridges' PWM frequency; the nearest that the timers can do without exceeding it.
  virtual void set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) = 0;

  // Takes one received byte; false when there is none.
  virtual bool receive(uint8_t *byte) = 0;
  // Queues all bytes or, where they do not fit, none (false).
  virtual bool send(const uint8_t *bytes, uint8_t count) = 0;

  virtual uint8_t load(uint16_t address) const = 0;
  // Starts writing one EEPROM byte; only while not storing(). load() is not called meanwhile.
  virtual void store(uint16_t address, uint8_t byte) = 0;
  virtual bool storing() const = 0;

  virtual void kick_watchdog() = 0;
  // MCUSR at boot: bit 0 power-on, 1 external, 2 brown-out, 3 watchdog.
  virtual uint8_t reset_cause() const = 0;
  // Version.build of the schema.
  virtual uint8_t build() const = 0;
  // Sensor readings from the plant over the link; false where the board has sensors of its own.
  virtual bool inject(const protocol::HilSensors &) { return false; }

 protected:
  ~Board() = default;  // boards are never deleted through this
};

}  // namespace daranti
