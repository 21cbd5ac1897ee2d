#include "bridge.h"

#include "fixed.h"

namespace daranti {

BridgeWires bridge_wires(BridgeStyle style, int16_t duty, Bridging bridging) {
  const uint8_t size = static_cast<uint8_t>(clamp(magnitude(duty), 0, 255));
  const bool forward = duty > 0;
  const bool backward = duty < 0;
  switch (style) {
    case BridgeStyle::kL298n:
    case BridgeStyle::kBts7960:
      return {forward ? size : uint8_t{0}, backward ? size : uint8_t{0}, false, false};
    case BridgeStyle::kVnh5019:
      // The current flows back over two diodes: 0.8 V each are an eighth of a battery's 12 V.
      if (bridging == Bridging::kBrake) {
        return {static_cast<uint8_t>(255 - size + size / 8), 0, false, false};
      }
      return {size, 0, forward, backward};
    case BridgeStyle::kNotSet:
      break;
  }
  return {0, 0, false, false};
}

int16_t bridge_rating(BridgeStyle style) {
  switch (style) {
    case BridgeStyle::kL298n:
      return 400;  // both channels in parallel, 2 A each (data sheet, "output current")
    case BridgeStyle::kBts7960:
    case BridgeStyle::kVnh5019:
      return 3000;  // 43 A and 30 A at most (data sheets); the modules' boards stand no more
    case BridgeStyle::kNotSet:
      break;
  }
  return 0;
}

}  // namespace daranti
