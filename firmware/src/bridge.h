// An H-bridge behind four pins, in either of the two common styles.
#pragma once
#include <stdint.h>

#include "board.h"

namespace daranti {

struct BridgePins {
  uint8_t enable;  // L298N: PWM of both directions; BTS7960: RPWM
  uint8_t lpwm;    // BTS7960 only
  uint8_t in1;     // L298N only
  uint8_t in2;     // L298N only
};
constexpr BridgePins kSteerBridge{pins::kSteerEnable, pins::kSteerLpwm, pins::kSteerIn1,
                                  pins::kSteerIn2};
constexpr BridgePins kDriveBridge{pins::kDriveEnable, pins::kDriveLpwm, pins::kDriveIn1,
                                  pins::kDriveIn2};

enum class BridgeStyle : uint8_t { kL298n = 0, kBts7960 = 1 };

// What a motor does at zero duty. An L298N shorts it where both inputs are high (its data sheet,
// "fast motor stop"); a BTS7960 board whose enables are wired high shorts it in any case.
enum class Idle : uint8_t { kCoast, kBrake };

// duty: -255..255, positive left or forward.
void drive_bridge(Board &board, const BridgePins &pins, BridgeStyle style, int16_t duty,
                  Idle idle = Idle::kCoast);

}  // namespace daranti
