#include "bridge.h"

#include "fixed.h"

namespace daranti {

namespace {

// 6 us (VNH2SP30-E, DocID10832 Rev 10, table 9, "PWM minimum off time"), in 255ths of a second.
constexpr uint32_t kGap = 153;
constexpr uint32_t kGapUnit = 100000;

uint8_t spaced(uint8_t share, uint8_t gap) {
  const uint8_t low = static_cast<uint8_t>(255 - share);
  if (low >= gap) return share;
  return static_cast<uint8_t>(2 * low < gap ? 255 : 255 - gap);
}

}  // namespace

uint8_t bridge_gap(uint16_t hz) {
  return static_cast<uint8_t>((hz * kGap + kGapUnit - 1) / kGapUnit);
}

BridgeWires bridge_wires(BridgeStyle style, int16_t duty, uint8_t gap, Bridging bridging) {
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
        return {spaced(static_cast<uint8_t>(255 - size + size / 8), gap), 0, false, false};
      }
      return {spaced(size, gap), 0, forward, backward};
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

int16_t bridge_peak(BridgeStyle style) {
  switch (style) {
    case BridgeStyle::kL298n:
      return 500;  // 2.5 A a channel for 8 of 10 ms (data sheet, "absolute maximum ratings")
    case BridgeStyle::kBts7960:
    case BridgeStyle::kVnh5019:
      return 10000;  // limit themselves; the parameters' own bound
    case BridgeStyle::kNotSet:
      break;
  }
  return 0;
}

int16_t bridge_fastest(BridgeStyle style) {
  switch (style) {
    case BridgeStyle::kL298n:
    case BridgeStyle::kBts7960:
      return 25000;  // "commutation frequency", typical; "PWM capability" (data sheets)
    case BridgeStyle::kVnh5019:
      return 20000;  // "PWM frequency", maximum
    case BridgeStyle::kNotSet:
      break;
  }
  return 0;
}

}  // namespace daranti
