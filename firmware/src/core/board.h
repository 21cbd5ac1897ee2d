// The Board seam: all that the controller may ask of hardware, in the machine's words. Every board
// has a folder in boards/, the desk is in desk/. Nothing behind it blocks for longer than a few
// microseconds.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace daranti {

constexpr uint16_t kTickUs = 5000;
constexpr uint16_t kTickMs = kTickUs / 1000;
constexpr uint16_t kAnalogMax = 1023 * 16;  // what analog() gives for 5 V

// What is measured as a voltage.
enum class Analog : uint8_t { kPot = 0, kBattery, kSteerCurrent, kDriveCurrent, kEstop };
constexpr uint8_t kAnalogs = 5;

enum class Motor : uint8_t { kSteer = 0, kDrive = 1 };

// The four wires of an H-bridge, in either of the two common wirings.
struct BridgeWires {
  uint8_t pwm;   // PWM of a VNH5019, RPWM of a BTS7960, IN1 of an L298N: 0..255 of 255
  uint8_t lpwm;  // LPWM of a BTS7960, IN2 of an L298N
  bool in1;      // INA of a VNH5019: left, forward
  bool in2;      // INB
};

// Counters since the reset, modulo 65536. A pulse counts when its level has held for two samples,
// 200 us apart: what is shorter is noise.
struct Pulses {
  uint16_t wheel;  // of the first sensor, whichever way it turns
  uint16_t way;    // by both sensors: forward less backward
  uint16_t blade;
};

// What went wrong underneath since the reset; saturating.
struct Troubles {
  uint16_t overruns;     // ticks that began late or were lost
  uint16_t line_errors;  // bytes lost or misread
};

class Board {
 public:
  // When the current tick was due, in microseconds since boot; wraps.
  virtual uint32_t time_us() const = 0;
  // Mean of the samples since the last tick, in 1/16 ADC counts: 0..kAnalogMax for 0..5 V.
  virtual uint16_t analog(Analog channel) const = 0;
  // Whether the e-stop's loop is open now, as a digital input sees it: 3 V and more.
  virtual bool estop_open() const = 0;
  virtual Pulses pulses() const = 0;
  virtual Troubles troubles() const = 0;

  // What goes off goes off before what comes on; 0 and 255 without glitches.
  virtual void set_bridge(Motor motor, const BridgeWires &wires) = 0;
  // Both bridges' PWM frequency; the nearest that the board can do without exceeding it. Only while
  // the bridges are off.
  virtual void set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) = 0;
  virtual void set_blade(bool on) = 0;
  virtual void set_lamp(bool on) = 0;

  // Takes one received byte; false when there is none.
  virtual bool receive(uint8_t *byte) = 0;
  // Queues all bytes or, where they do not fit, none (false).
  virtual bool send(const uint8_t *bytes, uint8_t count) = 0;

  virtual uint8_t load(uint16_t address) const = 0;
  // Starts writing one EEPROM byte; only while not storing(). load() is not called meanwhile.
  virtual void store(uint16_t address, uint8_t byte) = 0;
  virtual bool storing() const = 0;

  virtual void kick_watchdog() = 0;
  // Kept over the next reset, so that its cause is known even where a bootloader hides it.
  virtual void remember_armed(bool armed) = 0;
  // protocol::ResetCause.
  virtual uint8_t reset_cause() const = 0;
  // Version.build of the schema.
  virtual uint8_t build() const = 0;
  // Sensor readings from the plant over the link; false where the board has sensors of its own.
  virtual bool inject(const protocol::HilSensors &) { return false; }

 protected:
  ~Board() = default;  // boards are never deleted through this
};

}  // namespace daranti
