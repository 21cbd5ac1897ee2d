#include "current.h"

#include "board.h"
#include "fixed.h"

namespace daranti {

namespace {
constexpr int16_t kLargest = 10000;             // 100 A, the parameters' own bound
constexpr int16_t kFinest = 10;                 // mV/A: with it the products keep to 32 bits
constexpr int32_t kShare = 328;                 // of a second in a tick, 2^-16
constexpr int16_t kTop = kAnalogMax / 50 * 49;  // a sensor's output does not reach its supply
}  // namespace

void Current::configure(int16_t zero, int16_t scale) {
  zero_ = static_cast<int16_t>(int32_t{zero} * kAnalogMax / 5000);
  const int32_t fine = scale < kFinest ? kFinest : scale;
  fine_ = scale == 0 || scale >= kFinest;
  // 5000 mV are 500000 / scale of 0.01 A.
  per_step_ = scale == 0 ? 0 : divide((int32_t{500000} << 11) / kAnalogMax * 8, fine);
}

void Current::step(uint16_t reading) {
  const int32_t away = magnitude(static_cast<int32_t>(reading) - zero_);
  now_ = static_cast<int16_t>(least((away * per_step_) >> 14, kLargest));
  mean_ += (((int32_t{now_} << 8) - mean_) * kShare) >> 16;
}

bool Current::shows(int16_t most) const {
  return fine_ && ((int32_t{kTop} - zero_) * per_step_ >> 14 >= most || per_step_ == 0);
}

}  // namespace daranti
