// The Arduino Uno's wiring, as its board's pin numbers: the one place that knows it.
#pragma once
#include <stdint.h>

namespace daranti {
namespace pins {

// Steering bridge. VNH5019: PWM, and INA/INB for the direction (left = INA high). BTS7960: RPWM
// turns left, LPWM right. L298N: the same at IN1, IN2, its enables wired high.
constexpr uint8_t kSteerPwm = 9;    // OC1A; PWM, RPWM or IN1
constexpr uint8_t kSteerLpwm = 10;  // OC1B
constexpr uint8_t kSteerIn1 = 7;
constexpr uint8_t kSteerIn2 = 8;
// Drive bridge, both rear motors. Forward = INA high, or RPWM.
constexpr uint8_t kDrivePwm = 3;    // OC2B
constexpr uint8_t kDriveLpwm = 11;  // OC2A
constexpr uint8_t kDriveIn1 = 4;
constexpr uint8_t kDriveIn2 = 5;

constexpr uint8_t kBlade = 6;  // relay's transistor, high = on
constexpr uint8_t kLamp = 13;

// Inputs with pull-up; falling edges count.
constexpr uint8_t kHall = 12;
constexpr uint8_t kHallB = 19;  // A5; a quarter of a pulse apart
constexpr uint8_t kBladeTurn = 2;

constexpr uint8_t kEstop = 18;  // A4: the loop, seen by the pin and by the converter

// Converter channels: A0 to A4.
constexpr uint8_t kPotChannel = 0;
constexpr uint8_t kBatteryChannel = 1;
constexpr uint8_t kSteerCurrentChannel = 2;
constexpr uint8_t kDriveCurrentChannel = 3;
constexpr uint8_t kEstopChannel = 4;

}  // namespace pins
}  // namespace daranti
