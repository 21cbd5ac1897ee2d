#include "bridge.h"

#include "fixed.h"

namespace daranti {

void drive_bridge(Board &board, const BridgePins &pins, BridgeStyle style, int16_t duty,
                  Idle idle) {
  const uint8_t size = static_cast<uint8_t>(clamp(magnitude(duty), 0, 255));
  const uint8_t forward = duty > 0 ? size : uint8_t{0};
  const uint8_t backward = duty < 0 ? size : uint8_t{0};
  if (style == BridgeStyle::kL298n) {
    const bool brake = size == 0 && idle == Idle::kBrake;
    board.set_pwm(pins.lpwm, 0);
    board.set_pin(pins.in1, forward != 0 || brake);
    board.set_pin(pins.in2, backward != 0 || brake);
    board.set_pwm(pins.enable, brake ? uint8_t{255} : size);
  } else {
    board.set_pin(pins.in1, false);
    board.set_pin(pins.in2, false);
    // The idle half goes off first: both on at once would brake, and on some boards short.
    if (forward == 0) board.set_pwm(pins.enable, 0);
    board.set_pwm(pins.lpwm, backward);
    board.set_pwm(pins.enable, forward);
  }
}

}  // namespace daranti
