#include "params.h"

#include "flash.h"
#include "frame.h"

namespace daranti {

using protocol::Result;

namespace {

#define DARANTI_ROW(name, initial, low, high) {initial, low, high},
const int16_t kRanges[protocol::kParams][3] DARANTI_FLASH = {DARANTI_PARAMS(DARANTI_ROW)};
#undef DARANTI_ROW

constexpr uint16_t kCrcAt = Params::kBlock - 2;

}  // namespace

ParamRange param_range(uint8_t id) {
  const int16_t *row = kRanges[id];
  return {flash_read(row), flash_read(row + 1), flash_read(row + 2)};
}

Result Params::set(uint8_t id, int16_t value) {
  if (id >= protocol::kParams) return Result::UNKNOWN;
  const ParamRange range = param_range(id);
  if (value < range.low || value > range.high) return Result::OUT_OF_RANGE;
  values_[id] = value;
  all_default_ = false;
  return Result::OK;
}

void Params::set_defaults() {
  if (all_default_) return;
  all_default_ = true;
  for (uint8_t id = 0; id < protocol::kParams; ++id) values_[id] = flash_read(kRanges[id]);
}

bool Params::load(const Board &board) {
  uint16_t crc = 0xFFFF;
  bool erased = true;
  bool whole = board.load(0) == kMagic && board.load(1) == protocol::kVersion;
  for (uint16_t at = 0; at < kBlock; ++at) {
    const uint8_t byte = board.load(at);
    erased = erased && byte == 0xFF;
    if (at < kCrcAt) crc = crc16(crc, byte);
  }
  whole = whole && board.load(kCrcAt) == static_cast<uint8_t>(crc) &&
          board.load(kCrcAt + 1) == static_cast<uint8_t>(crc >> 8);
  for (uint8_t id = 0; whole && id < protocol::kParams; ++id) {
    const uint16_t at = static_cast<uint16_t>(2 + 2 * id);
    const uint16_t raw =
        static_cast<uint16_t>(board.load(at) | static_cast<uint16_t>(board.load(at + 1)) << 8);
    whole = set(id, static_cast<int16_t>(raw)) == Result::OK;
  }
  if (!whole) set_defaults();
  return whole || erased;
}

uint8_t Params::block_byte(uint16_t at, uint16_t *crc) const {
  if (at == kCrcAt) return static_cast<uint8_t>(*crc);
  if (at == kCrcAt + 1) return static_cast<uint8_t>(*crc >> 8);
  uint8_t byte = at == 0 ? kMagic : protocol::kVersion;
  if (at >= 2) {
    const uint16_t value = static_cast<uint16_t>(values_[(at - 2) / 2]);
    byte = static_cast<uint8_t>(at % 2 == 0 ? value : value >> 8);
  }
  *crc = crc16(at == 0 ? 0xFFFF : *crc, byte);
  return byte;
}

Params::Saving Params::step_save(Board &board) {
  if (save_at_ == kNotSaving) return Saving::kIdle;
  if (board.storing()) return Saving::kBusy;
  const bool writing = save_at_ < kBlock;
  const uint16_t at = static_cast<uint16_t>(writing ? save_at_ : save_at_ - kBlock);
  const uint8_t byte = block_byte(at, &save_crc_);
  const bool wrong = !writing && board.load(at) != byte;
  if (writing) board.store(at, byte);
  ++save_at_;
  if (!wrong && save_at_ < 2 * kBlock) return Saving::kBusy;
  save_at_ = kNotSaving;
  return wrong ? Saving::kFailed : Saving::kDone;
}

}  // namespace daranti
