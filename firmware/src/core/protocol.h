// Generated from firmware/protocol.toml by tools/protogen.py. Do not edit.
// clang-format off
#pragma once
#include <stddef.h>
#include <stdint.h>

namespace daranti {
namespace protocol {

constexpr uint8_t kVersion = 3;
constexpr uint32_t kBaud = 115200;

// What the supervisor allows.
enum class State : uint8_t {
  SAFE = 0,
  ARMED = 1,
  RUNNING = 2,
  FAULT = 3,
};

// Why a request was or was not taken.
enum class Result : uint8_t {
  OK = 0,
  WRONG_VERSION = 1,
  WRONG_STATE = 2,
  NOT_PLAUSIBLE = 3,
  OUT_OF_RANGE = 4,
  UNKNOWN = 5,
  STORE_FAILED = 6,
  NOT_SET_UP = 7,
  STALE = 8,
};

// Latched reasons; each bit has its text on the host.
enum Fault : uint32_t {
  LINK_LOST = 1UL << 0,  // no valid command for 250 ms
  ESTOP_OPEN = 1UL << 1,  // emergency-stop loop open
  POT_OPEN = 1UL << 2,  // steering potentiometer reads above its range (wire open)
  POT_SHORT = 1UL << 3,  // steering potentiometer reads below its range (short to ground)
  POT_JUMP = 1UL << 4,  // steering angle jumped faster than the steering can move
  POT_FROZEN = 1UL << 5,  // steering driven but the potentiometer does not move
  STEER_STALL = 1UL << 6,  // steering motor stalled
  STEER_RUNAWAY = 1UL << 7,  // steering moves away from its setpoint
  STEER_OVERCURRENT = 1UL << 8,  // steering bridge over-current
  DRIVE_OVERCURRENT = 1UL << 9,  // drive bridge over-current
  BATTERY_LOW = 1UL << 10,  // battery below its limit
  BATTERY_HIGH = 1UL << 11,  // battery above its limit
  BROWN_OUT = 1UL << 12,  // the controller's supply collapsed (brown-out reset)
  WATCHDOG = 1UL << 13,  // the controller hung and its watchdog reset it
  PARAMS_BAD = 1UL << 14,  // stored parameters corrupt or out of range; defaults stand in for them
  HALL_LOST = 1UL << 15,  // wheels driven but the hall sensor is silent
  IDENT_LIMIT = 1UL << 16,  // identification stopped at its angle or time limit
  ESTOP_SHORT = 1UL << 17,  // emergency-stop loop shorted: the button would not be seen
  HALL_NOISE = 1UL << 18,  // the hall sensor counts faster than the machine can drive
  WHEEL_RUNAWAY = 1UL << 19,  // the wheels turn faster than asked
  WRONG_WAY = 1UL << 20,  // the wheels turn against the direction asked
  BLADE_LOST = 1UL << 21,  // blade switched on but its sensor shows no turning
  BLADE_STUCK = 1UL << 22,  // the blade turns although it is switched off
  RESET_UNKNOWN = 1UL << 23,  // the controller was reset while it was armed, and its bootloader hides why
  PARAMS_COPY = 1UL << 24,  // one of the two stored copies of the parameters is damaged; the other is in use
};

// Why the controller started.
enum ResetCause : uint32_t {
  BY_POWER_ON = 1UL << 0,  // power-on
  BY_RESET_PIN = 1UL << 1,  // reset button, or the port was opened
  BY_BROWN_OUT = 1UL << 2,  // brown-out
  BY_WATCHDOG = 1UL << 3,  // watchdog
  BY_UNKNOWN = 1UL << 4,  // hidden by the bootloader
  WHILE_ARMED = 1UL << 5,  // while it was armed
};

// Little-endian, whatever the compiler's machine is.
template <typename T>
inline T get(const uint8_t *from) {
  uint32_t bits = 0;
  for (size_t i = sizeof(T); i-- > 0;) bits = (bits << 8) | from[i];
  return static_cast<T>(bits);
}
template <typename T>
inline void put(uint8_t *to, T value) {
  uint32_t bits = static_cast<uint32_t>(value);
  for (size_t i = 0; i < sizeof(T); ++i, bits >>= 8) to[i] = static_cast<uint8_t>(bits);
}

// To the firmware: Asks who is there; answered by Version.
struct Hello {
  static constexpr uint8_t kId = 1;
  static constexpr uint8_t kSize = 1;
  uint8_t protocol_version;
  static Hello read(const uint8_t *payload) {
    Hello m;
    m.protocol_version = get<uint8_t>(payload);
    return m;
  }
};

// To the firmware: SAFE to ARMED, when the version matches and every precondition holds; answered by Ack.
struct Arm {
  static constexpr uint8_t kId = 2;
  static constexpr uint8_t kSize = 1;
  uint8_t protocol_version;
  static Arm read(const uint8_t *payload) {
    Arm m;
    m.protocol_version = get<uint8_t>(payload);
    return m;
  }
};

// To the firmware: All outputs off in the same tick, state SAFE. Wins over anything else.
struct Stop {
  static constexpr uint8_t kId = 3;
  static constexpr uint8_t kSize = 0;
};

// To the firmware: Clears latched faults whose cause is gone; FAULT to SAFE.
struct Clear {
  static constexpr uint8_t kId = 4;
  static constexpr uint8_t kSize = 0;
};

// To the firmware: The command. Only a fresh one, whose sequence number has advanced by 1 to 127 since the last command or ARM, is taken and feeds the link watchdog.
struct Drive {
  static constexpr uint8_t kId = 5;
  static constexpr uint8_t kSize = 5;
  int16_t steer;  // 0.01 deg; steering angle, positive to the left
  int16_t speed;  // 0.001 m/s; negative reverses
  uint8_t blade;  // 0 off, 1 on
  static Drive read(const uint8_t *payload) {
    Drive m;
    m.steer = get<int16_t>(payload);
    m.speed = get<int16_t>(payload + 2);
    m.blade = get<uint8_t>(payload + 4);
    return m;
  }
};

// To the host: Answer to Hello.
struct Version {
  static constexpr uint8_t kId = 65;
  static constexpr uint8_t kSize = 10;
  uint8_t protocol_version;
  uint8_t firmware_major;
  uint8_t firmware_minor;
  uint8_t build;  // 0 uno, 1 desk, 2 uno_hil, 3 nano, 4 mega2560
  uint8_t reset_cause;  // bits ResetCause
  uint32_t commit;  // first eight hexadecimal digits of the commit it was built from; 0 where that is not known
  uint8_t modified;  // 1 where the sources differed from that commit
  void write(uint8_t *payload) const {
    put<uint8_t>(payload, protocol_version);
    put<uint8_t>(payload + 1, firmware_major);
    put<uint8_t>(payload + 2, firmware_minor);
    put<uint8_t>(payload + 3, build);
    put<uint8_t>(payload + 4, reset_cause);
    put<uint32_t>(payload + 5, commit);
    put<uint8_t>(payload + 9, modified);
  }
};

// To the host: Answer to a request that can be refused.
struct Ack {
  static constexpr uint8_t kId = 66;
  static constexpr uint8_t kSize = 3;
  uint8_t request_id;
  uint8_t request_seq;
  uint8_t result;  // enum Result
  void write(uint8_t *payload) const {
    put<uint8_t>(payload, request_id);
    put<uint8_t>(payload + 1, request_seq);
    put<uint8_t>(payload + 2, result);
  }
};

// To the host: 50 Hz.
struct Telemetry {
  static constexpr uint8_t kId = 67;
  static constexpr uint8_t kSize = 29;
  uint32_t time;  // 0.000001 s; firmware clock, wraps
  uint8_t state;  // enum State
  uint32_t faults;  // bits Fault
  int16_t setpoint;  // 0.01 deg
  int16_t angle;  // 0.01 deg
  int16_t steer_duty;  // -255..255, positive to the left
  int16_t drive_duty;  // -255..255, positive forward
  uint8_t blade;
  int16_t speed;  // 0.001 m/s; -32768 = none; measured; none where no hall sensor is configured
  int32_t distance;  // 0.001 m; signed odometer since reset; 0 where no sensor is configured
  uint16_t battery;  // 0.001 V
  uint8_t last_seq;  // sequence number of the last command taken
  uint16_t frames_bad;  // frames dropped since reset (CRC, COBS, length, id), saturating
  void write(uint8_t *payload) const {
    put<uint32_t>(payload, time);
    put<uint8_t>(payload + 4, state);
    put<uint32_t>(payload + 5, faults);
    put<int16_t>(payload + 9, setpoint);
    put<int16_t>(payload + 11, angle);
    put<int16_t>(payload + 13, steer_duty);
    put<int16_t>(payload + 15, drive_duty);
    put<uint8_t>(payload + 17, blade);
    put<int16_t>(payload + 18, speed);
    put<int32_t>(payload + 20, distance);
    put<uint16_t>(payload + 24, battery);
    put<uint8_t>(payload + 26, last_seq);
    put<uint16_t>(payload + 27, frames_bad);
  }
};

// To the host: 6 Hz: what the sensors read, and how well the controller and its line fare.
struct Readings {
  static constexpr uint8_t kId = 70;
  static constexpr uint8_t kSize = 24;
  int16_t steer_current;  // 0.01 A
  int16_t drive_current;  // 0.01 A
  uint16_t pot;  // 0.0625 counts; of 1023 for 5 V, as the following
  uint16_t battery;  // 0.0625 counts
  uint16_t steer_sense;  // 0.0625 counts
  uint16_t drive_sense;  // 0.0625 counts
  uint16_t estop;  // 0.0625 counts; the loop: 102 to 307 closed
  uint16_t hall;  // pulses since reset, modulo 65536
  uint16_t blade_turns;  // pulses of the blade's sensor since reset, modulo 65536
  uint16_t overruns;  // ticks that began late or were lost since reset, saturating
  uint16_t line_errors;  // bytes lost or misread on the line since reset, saturating
  uint16_t stale;  // commands refused as repeated or old since reset, saturating
  void write(uint8_t *payload) const {
    put<int16_t>(payload, steer_current);
    put<int16_t>(payload + 2, drive_current);
    put<uint16_t>(payload + 4, pot);
    put<uint16_t>(payload + 6, battery);
    put<uint16_t>(payload + 8, steer_sense);
    put<uint16_t>(payload + 10, drive_sense);
    put<uint16_t>(payload + 12, estop);
    put<uint16_t>(payload + 14, hall);
    put<uint16_t>(payload + 16, blade_turns);
    put<uint16_t>(payload + 18, overruns);
    put<uint16_t>(payload + 20, line_errors);
    put<uint16_t>(payload + 22, stale);
  }
};

// To the firmware: Answered by ParamValue, or by Ack UNKNOWN.
struct ParamGet {
  static constexpr uint8_t kId = 6;
  static constexpr uint8_t kSize = 1;
  uint8_t param;  // id of a parameter
  static ParamGet read(const uint8_t *payload) {
    ParamGet m;
    m.param = get<uint8_t>(payload);
    return m;
  }
};

// To the firmware: Changes a parameter in RAM, in SAFE or FAULT only; answered by Ack.
struct ParamSet {
  static constexpr uint8_t kId = 7;
  static constexpr uint8_t kSize = 3;
  uint8_t param;  // id of a parameter
  int16_t value;  // raw; the scale is the parameter's
  static ParamSet read(const uint8_t *payload) {
    ParamSet m;
    m.param = get<uint8_t>(payload);
    m.value = get<int16_t>(payload + 1);
    return m;
  }
};

// To the firmware: Stores all parameters in EEPROM and reads them back, in SAFE or FAULT only; answered by Ack when done.
struct ParamSave {
  static constexpr uint8_t kId = 8;
  static constexpr uint8_t kSize = 0;
};

// To the firmware: Sets all parameters to their defaults in RAM, in SAFE or FAULT only; answered by Ack. One a tick is taken, as of Hello.
struct ParamDefaults {
  static constexpr uint8_t kId = 9;
  static constexpr uint8_t kSize = 0;
};

// To the firmware: Raw PWM on the steering motor while ARMED, within the ident_* limits; feeds the link watchdog when fresh, as Drive does. Answered by Ack.
struct Ident {
  static constexpr uint8_t kId = 10;
  static constexpr uint8_t kSize = 4;
  int16_t duty;  // -255..255, positive to the left
  uint16_t duration;  // 0.001 s; the motor is released after this time
  static Ident read(const uint8_t *payload) {
    Ident m;
    m.duty = get<int16_t>(payload);
    m.duration = get<uint16_t>(payload + 2);
    return m;
  }
};

// To the firmware: uno_hil only: what the plant's sensors read; answered by HilOutputs. Other builds answer Ack UNKNOWN.
struct HilSensors {
  static constexpr uint8_t kId = 11;
  static constexpr uint8_t kSize = 16;
  uint16_t pot;  // 0.001 V
  uint16_t battery;  // 0.001 V; at the pin, behind the divider
  uint16_t steer_current;  // 0.001 V; at the sense pin
  uint16_t drive_current;  // 0.001 V; at the sense pin
  uint16_t estop;  // 0.001 V; of the loop, at the pin
  uint16_t hall;  // pulses since start, modulo 65536
  uint16_t hall_way;  // by both hall sensors, pulses forward less pulses backward since start, modulo 65536
  uint16_t blade_turns;  // pulses of the blade's sensor since start, modulo 65536
  static HilSensors read(const uint8_t *payload) {
    HilSensors m;
    m.pot = get<uint16_t>(payload);
    m.battery = get<uint16_t>(payload + 2);
    m.steer_current = get<uint16_t>(payload + 4);
    m.drive_current = get<uint16_t>(payload + 6);
    m.estop = get<uint16_t>(payload + 8);
    m.hall = get<uint16_t>(payload + 10);
    m.hall_way = get<uint16_t>(payload + 12);
    m.blade_turns = get<uint16_t>(payload + 14);
    return m;
  }
};

// To the firmware: Asks for an entry of the fault log; answered by LogEntry, or by Ack UNKNOWN. One a tick is answered, the last that came.
struct LogGet {
  static constexpr uint8_t kId = 12;
  static constexpr uint8_t kSize = 1;
  uint8_t index;  // 0 the newest, 15 the oldest that may be there
  static LogGet read(const uint8_t *payload) {
    LogGet m;
    m.index = get<uint8_t>(payload);
    return m;
  }
};

// To the firmware: Makes the fault log empty, in SAFE or FAULT only; answered by Ack when done.
struct LogClear {
  static constexpr uint8_t kId = 13;
  static constexpr uint8_t kSize = 0;
};

// To the host: Answer to LogGet: faults that latched, as the EEPROM keeps them.
struct LogEntry {
  static constexpr uint8_t kId = 71;
  static constexpr uint8_t kSize = 11;
  uint8_t index;  // as asked for
  uint16_t number;  // counts the entries, modulo 65536
  uint32_t faults;  // bits Fault; those that came together; 0: there is no such entry
  uint16_t uptime;  // 1 s; from that start to the first of them, saturating
  uint8_t reset_cause;  // bits ResetCause; of that start
  uint8_t state;  // enum State; before the first of them
  void write(uint8_t *payload) const {
    put<uint8_t>(payload, index);
    put<uint16_t>(payload + 1, number);
    put<uint32_t>(payload + 3, faults);
    put<uint16_t>(payload + 7, uptime);
    put<uint8_t>(payload + 9, reset_cause);
    put<uint8_t>(payload + 10, state);
  }
};

// To the host: Answer to ParamGet.
struct ParamValue {
  static constexpr uint8_t kId = 68;
  static constexpr uint8_t kSize = 3;
  uint8_t param;  // id of a parameter
  int16_t value;  // raw; the scale is the parameter's
  void write(uint8_t *payload) const {
    put<uint8_t>(payload, param);
    put<int16_t>(payload + 1, value);
  }
};

// To the host: uno_hil only: what the outputs would be; they are held off on the board itself.
struct HilOutputs {
  static constexpr uint8_t kId = 69;
  static constexpr uint8_t kSize = 5;
  int16_t steer_duty;  // -255..255, positive to the left
  int16_t drive_duty;  // -255..255, positive forward
  uint8_t blade;
  void write(uint8_t *payload) const {
    put<int16_t>(payload, steer_duty);
    put<int16_t>(payload + 2, drive_duty);
    put<uint8_t>(payload + 4, blade);
  }
};

// Payload length of a message to the firmware; -1 for an unknown id.
inline int8_t command_size(uint8_t id) {
  switch (id) {
    case Hello::kId:
      return Hello::kSize;
    case Arm::kId:
      return Arm::kSize;
    case Stop::kId:
      return Stop::kSize;
    case Clear::kId:
      return Clear::kSize;
    case Drive::kId:
      return Drive::kSize;
    case ParamGet::kId:
      return ParamGet::kSize;
    case ParamSet::kId:
      return ParamSet::kSize;
    case ParamSave::kId:
      return ParamSave::kSize;
    case ParamDefaults::kId:
      return ParamDefaults::kSize;
    case Ident::kId:
      return Ident::kSize;
    case HilSensors::kId:
      return HilSensors::kSize;
    case LogGet::kId:
      return LogGet::kSize;
    case LogClear::kId:
      return LogClear::kSize;
    default:
      return -1;
  }
}

constexpr uint8_t kMinCommandSize = 0;
constexpr uint8_t kMaxCommandSize = 16;
constexpr uint8_t kMaxAnswerSize = 29;

// Parameters, in the order of their ids.
enum class Param : uint8_t {
  steer_driver,  // steering bridge: 0 not set (ARM is refused), 1 L298N (PWM at IN1, IN2; its enables wired high), 2 BTS7960 (RPWM, LPWM), 3 VNH5019 or VNH2SP30 (INA, INB, PWM)
  drive_driver,  // drive bridge: 0 not set (ARM is refused), 1 L298N (PWM at IN1, IN2; its enables wired high), 2 BTS7960 (RPWM, LPWM), 3 VNH5019 or VNH2SP30 (INA, INB, PWM)
  steer_pwm_freq,  // 1 Hz; timer 1 gives any frequency
  drive_pwm_freq,  // 1 Hz; timer 2 gives 123, 245, 490, 980, 3922 Hz: the highest that is not above
  pot_left,  // 0.1 counts; potentiometer at the left calibration angle
  pot_centre,  // 0.1 counts; potentiometer at straight ahead
  pot_right,  // 0.1 counts; potentiometer at the right calibration angle
  angle_left,  // 0.01 deg; steering angle where pot_left was taken
  angle_right,  // 0.01 deg; steering angle where pot_right was taken
  pot_low,  // 1 counts; below it the potentiometer counts as shorted
  pot_high,  // 1 counts; above it the potentiometer counts as open
  steer_rate_max,  // 1 deg/s; a measured angle that changes faster is a jump
  steer_limit,  // 0.01 deg; largest steering setpoint to either side
  steer_slew,  // 0.1 deg/s; fastest change of the steering setpoint
  steer_kp,  // 0.01 duty/deg; proportional gain
  steer_ki,  // 0.01 duty/(deg s); integral gain
  steer_kd,  // 0.001 duty s/deg; derivative gain, on the measurement
  steer_d_filter,  // 1 ms; time constant of the derivative's low-pass
  steer_min_duty,  // 1 duty; duty at which the steering motor just moves; added to small commands
  steer_deadband,  // 0.01 deg; error within which a resting motor stays released; it releases again within two thirds of it
  steer_duty_max,  // 1 duty
  steer_duty_slew,  // 1 duty/s; fastest growth of the steering duty; it falls at once
  speed_max,  // 0.001 m/s; largest speed, forward and in reverse
  speed_full,  // 0.001 m/s; speed at full duty and nominal battery
  drive_accel,  // 0.001 m/s2; soft start: fastest change of the speed setpoint
  drive_min_duty,  // 1 duty; duty at which the drive motors just move
  drive_kp,  // 0.1 duty s/m; speed loop, with a hall sensor only
  drive_ki,  // 0.1 duty/m; speed loop, with a hall sensor only
  hall_per_metre,  // 0.1 pulses/m; 0: no hall sensor fitted
  battery_low,  // 0.001 V
  battery_high,  // 0.001 V
  battery_nominal,  // 0.001 V; the drive duty is scaled by nominal over measured, which counts as battery_low at least; 0 switches this off
  steer_current_max,  // 0.01 A; peak, for 50 ms; what the sensor can show is the limit (ACS712-20A: 24 A)
  drive_current_max,  // 0.01 A; peak, for 50 ms; what the sensor can show is the limit (ACS758-050B: 60 A)
  stall_current,  // 0.01 A; a driven, motionless steering above it is stalled, below it its potentiometer is frozen
  stall_time,  // 1 ms; driven at full duty without movement for about this long is a stall or a frozen potentiometer: 100 ms for the motor to come to speed, and the rest, at least 50 ms, in which it must show that it turns; at less duty the rest is longer, in proportion to what is above steer_min_duty. The default is for the slowest motor, 20 deg/s; tuning writes what the identified one needs
  ident_duty_max,  // 1 duty
  ident_angle_max,  // 0.01 deg
  ident_time_max,  // 1 ms; longest duration that Ident may ask for
  steer_current_zero,  // 1 mV; steering current sensor's output at no current (ACS712 and ACS758: 2500; a BTS7960's IS pins: 0)
  steer_current_scale,  // 1 mV/A; steering current sensor (ACS712-20A 100, ACS712-05B 185, a BTS7960's IS over 1 kOhm about 118); 0: none fitted
  drive_current_zero,  // 1 mV; drive current sensor's output at no current
  drive_current_scale,  // 1 mV/A; drive current sensor (ACS758-050B 40, ACS712-30A 66); 0: none fitted
  steer_current_cont,  // 0.01 A; mean over a second: the driver's rating (an L298N's two channels in parallel 4, a BTS7960 or VNH5019 module up to 30 with cooling)
  drive_current_cont,  // 0.01 A; mean over a second: the driver's rating (a BTS7960 module about 10, a VNH5019 carrier 12, up to 30 with cooling)
  battery_scale,  // 0.001 V; battery voltage that the divider makes 5 V of
  speed_excess,  // 0.001 m/s; wheels that turn faster than asked by more than this, for 0.4 s, run away; what is asked falls with drive_lag here; with a hall sensor only
  blade_rest,  // 1 ms; the blade stays off for at least this long
  blade_turn_min,  // 1 pulses/s; what the blade's sensor gives at least while the blade turns; 0: no sensor fitted
  blade_spin_time,  // 1 ms; longest time that the blade takes to start, and to stop
  hall_phases,  // hall sensors on the wheel; 2, a quarter of a pulse apart, tell the direction
  drive_lag,  // 0.001 s; lag with which the speed follows the duty; what a moving machine lacks because of it does not count for the speed loop's integral. 0: none
};
constexpr uint8_t kParams = 52;

// X(name, default, min, max), raw
#define DARANTI_PARAMS(X) \
  X(steer_driver, 0, 0, 3) \
  X(drive_driver, 0, 0, 3) \
  X(steer_pwm_freq, 20000, 123, 25000) \
  X(drive_pwm_freq, 3922, 123, 25000) \
  X(pot_left, 7370, 0, 10230) \
  X(pot_centre, 5120, 0, 10230) \
  X(pot_right, 2870, 0, 10230) \
  X(angle_left, 5000, 1000, 8000) \
  X(angle_right, -5000, -8000, -1000) \
  X(pot_low, 120, 10, 500) \
  X(pot_high, 904, 524, 1013) \
  X(steer_rate_max, 400, 50, 2000) \
  X(steer_limit, 5000, 500, 5000) \
  X(steer_slew, 1200, 50, 3000) \
  X(steer_kp, 7500, 0, 10000) \
  X(steer_ki, 5500, 0, 10000) \
  X(steer_kd, 3000, 0, 20000) \
  X(steer_d_filter, 35, 0, 200) \
  X(steer_min_duty, 53, 0, 150) \
  X(steer_deadband, 45, 0, 500) \
  X(steer_duty_max, 255, 30, 255) \
  X(steer_duty_slew, 15000, 200, 25500) \
  X(speed_max, 1000, 100, 3000) \
  X(speed_full, 1000, 100, 10000) \
  X(drive_accel, 1000, 100, 5000) \
  X(drive_min_duty, 0, 0, 150) \
  X(drive_kp, 800, 0, 10000) \
  X(drive_ki, 2000, 0, 20000) \
  X(hall_per_metre, 0, 0, 4000) \
  X(battery_low, 10000, 5000, 30000) \
  X(battery_high, 15500, 6000, 30000) \
  X(battery_nominal, 12000, 0, 30000) \
  X(steer_current_max, 2000, 50, 10000) \
  X(drive_current_max, 4000, 50, 10000) \
  X(stall_current, 300, 10, 10000) \
  X(stall_time, 250, 100, 3000) \
  X(ident_duty_max, 200, 10, 255) \
  X(ident_angle_max, 3500, 500, 4500) \
  X(ident_time_max, 3000, 100, 10000) \
  X(steer_current_zero, 2500, 0, 4000) \
  X(steer_current_scale, 100, 0, 1000) \
  X(drive_current_zero, 2500, 0, 4000) \
  X(drive_current_scale, 40, 0, 1000) \
  X(steer_current_cont, 400, 50, 3000) \
  X(drive_current_cont, 1000, 50, 3000) \
  X(battery_scale, 20000, 6000, 32000) \
  X(speed_excess, 350, 100, 3000) \
  X(blade_rest, 500, 200, 10000) \
  X(blade_turn_min, 0, 0, 1000) \
  X(blade_spin_time, 1500, 200, 10000) \
  X(hall_phases, 1, 1, 2) \
  X(drive_lag, 250, 0, 2000)

}  // namespace protocol
}  // namespace daranti
