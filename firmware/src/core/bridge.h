// From a duty to an H-bridge's wires, in any of the common drivers' styles.
#pragma once
#include <stdint.h>

#include "board.h"

namespace daranti {

// Values of the parameters steer_driver and drive_driver.
enum class BridgeStyle : uint8_t { kNotSet = 0, kL298n = 1, kBts7960 = 2, kVnh5019 = 3 };

// What becomes of a motor that turns faster than its duty asks. The mean voltage at the motor is
// the duty's either way. But where it drives, a VNH5019 takes no current back: in the rest of each
// period its low sides are open (data sheet, 2.4, "PWM pin usage"), and the motor runs on. Where it
// brakes it drives none: both inputs low and enabled short the motor to ground, and in the rest its
// current flows back into the battery. (Both inputs high would short it, too, but one of them torn
// off is full power then.) A BTS7960 and an L298N whose enables are wired high do both.
//
// An L298N gets its PWM at the inputs, for its enable opens all of it: the motor's current would
// then flow back against the battery in the rest of each period, and at 20 kHz no motor would turn
// below half of the duty.
enum class Bridging : uint8_t { kDrive, kBrake };

// duty: -255..255, positive left or forward. All wires are low, which every driver takes as off, at
// zero duty without brake, and always where the style is not set. gap: the bridge_gap() of the PWM.
BridgeWires bridge_wires(BridgeStyle style, int16_t duty, uint8_t gap,
                         Bridging bridging = Bridging::kDrive);

// For how many 255ths of a period a VNH5019's PWM must be low, if it is low at all, at a PWM of so
// many Hz: else it takes its own switching for a short to the battery, and lets go.
uint8_t bridge_gap(uint16_t hz);

// The largest mean current that the driver stands, 0.01 A; 0 where the style is not set.
int16_t bridge_rating(BridgeStyle style);

// The largest current that the driver stands for the 50 ms of an over-current, 0.01 A; 0 where the
// style is not set.
int16_t bridge_peak(BridgeStyle style);

// The highest PWM frequency that the driver takes, Hz; 0 where the style is not set.
int16_t bridge_fastest(BridgeStyle style);

}  // namespace daranti
