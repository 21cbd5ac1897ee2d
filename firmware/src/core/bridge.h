// From a duty to an H-bridge's wires, in any of the common drivers' styles.
#pragma once
#include <stdint.h>

#include "board.h"

namespace daranti {

// Values of the parameters steer_driver and drive_driver.
enum class BridgeStyle : uint8_t { kNotSet = 0, kL298n = 1, kBts7960 = 2, kVnh5019 = 3 };

// What a motor does at zero duty. An L298N or VNH5019 shorts it to ground where both inputs are low
// and it is enabled (both high would short it, too, but one of them torn off is full power then); a
// BTS7960 board whose enables are wired high shorts it in any case.
enum class Idle : uint8_t { kCoast, kBrake };

// duty: -255..255, positive left or forward. All wires are low, which every driver takes as off, at
// zero duty without brake, and always where the style is not set.
BridgeWires bridge_wires(BridgeStyle style, int16_t duty, Idle idle = Idle::kCoast);

// The largest mean current that the driver stands, 0.01 A; 0 where the style is not set.
int16_t bridge_rating(BridgeStyle style);

}  // namespace daranti
