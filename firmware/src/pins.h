// The wiring, as Arduino Uno pin numbers: the one place that knows it.
#pragma once
#include <stdint.h>

namespace daranti {

namespace pins {
// Steering bridge. L298N: ENABLE carries the PWM, IN1/IN2 the direction (left = IN1 high).
// BTS7960: RPWM turns left, LPWM right.
constexpr uint8_t kSteerEnable = 9;  // OC1A; RPWM
constexpr uint8_t kSteerLpwm = 10;   // OC1B
constexpr uint8_t kSteerIn1 = 7;
constexpr uint8_t kSteerIn2 = 8;
// Drive bridge, both rear motors. Forward = IN1 high, or RPWM.
constexpr uint8_t kDriveEnable = 3;  // OC2B; RPWM
constexpr uint8_t kDriveLpwm = 11;   // OC2A
constexpr uint8_t kDriveIn1 = 4;
constexpr uint8_t kDriveIn2 = 5;

constexpr uint8_t kBlade = 6;  // relay, high = on
constexpr uint8_t kLed = 13;
constexpr uint8_t kEstop = 2;  // pull-up; the closed loop pulls it low
constexpr uint8_t kHall = 12;  // pull-up; falling edges count
}  // namespace pins

// Analog inputs A0 to A3.
enum class Analog : uint8_t {
  kPot = 0,
  kBattery = 1,       // behind a 1:4 divider
  kSteerCurrent = 2,  // 100 mV/A
  kDriveCurrent = 3,  // 100 mV/A
};
constexpr uint8_t kAnalogs = 4;

}  // namespace daranti
