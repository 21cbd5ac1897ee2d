#include "params.h"

#include "fault_log.h"
#include "fixed.h"
#include "flash.h"
#include "frame.h"

namespace daranti {

using protocol::Result;

namespace {

#define DARANTI_ROW(name, initial, low, high) {initial, low, high},
const int16_t kRanges[protocol::kParams][3] DARANTI_FLASH = {DARANTI_PARAMS(DARANTI_ROW)};
#undef DARANTI_ROW

constexpr uint16_t kCrcAt = Params::kBlock - 2;
constexpr uint8_t kAtOnce = 4;  // bytes looked at in a tick
// Values in a copy of any version: the fault log lies behind the second copy.
constexpr uint8_t kMost = (FaultLog::kAddress - Params::kSecond - 4) / 2;
static_assert(Params::kSecond + Params::kBlock <= FaultLog::kAddress, "the log lies behind");

// What stands at one of the two places.
struct Copy {
  bool good;
  bool erased;
  uint8_t count;
  uint16_t crc;
};

Copy examine(const Board &board, uint16_t from) {
  Copy copy{false, true, board.load(static_cast<uint16_t>(from + 1)), 0xFFFF};
  for (uint16_t at = 0; at < Params::kBlock; ++at) {
    copy.erased = copy.erased && board.load(static_cast<uint16_t>(from + at)) == 0xFF;
  }
  if (board.load(from) != Params::kMagic || copy.count > kMost) return copy;
  const uint16_t end = static_cast<uint16_t>(from + 2 + 2 * copy.count);
  for (uint16_t at = from; at < end; ++at) copy.crc = crc16(copy.crc, board.load(at));
  copy.good = board.load(end) == static_cast<uint8_t>(copy.crc) &&
              board.load(static_cast<uint16_t>(end + 1)) == static_cast<uint8_t>(copy.crc >> 8);
  return copy;
}

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

bool Params::take(const Board &board, uint16_t from, uint8_t count) {
  set_defaults();
  bool whole = true;
  for (uint8_t id = 0; id < protocol::kParams && id < count; ++id) {
    const uint16_t at = static_cast<uint16_t>(from + 2 + 2 * id);
    const uint16_t raw = static_cast<uint16_t>(
        board.load(at) | static_cast<uint16_t>(board.load(static_cast<uint16_t>(at + 1))) << 8);
    if (set(id, static_cast<int16_t>(raw)) != Result::OK) whole = false;
  }
  return whole;
}

Params::Loaded Params::load(const Board &board) {
  const Copy first = examine(board, 0);
  const Copy second = examine(board, kSecond);
  if (!first.good && !second.good) {
    set_defaults();
    return first.erased && second.erased ? Loaded::kWhole : Loaded::kDamaged;
  }
  const bool whole = first.good ? take(board, 0, first.count) : take(board, kSecond, second.count);
  if (!whole) return Loaded::kDamaged;
  const bool alike =
      first.good && second.good && first.count == second.count && first.crc == second.crc;
  return alike ? Loaded::kWhole : Loaded::kOneCopy;
}

uint8_t Params::block_byte(uint16_t at, uint16_t *crc) const {
  if (at == kCrcAt) return static_cast<uint8_t>(*crc);
  if (at == kCrcAt + 1) return static_cast<uint8_t>(*crc >> 8);
  uint8_t byte = at == 0 ? kMagic : protocol::kParams;
  if (at >= 2) {
    const uint16_t word = static_cast<uint16_t>(values_[(at - 2) / 2]);
    byte = static_cast<uint8_t>(at % 2 == 0 ? word : word >> 8);
  }
  *crc = crc16(at == 0 ? 0xFFFF : *crc, byte);
  return byte;
}

void Params::begin_save() {
  pass_ = 0;
  save_at_ = 0;
}

Params::Saving Params::step_save(Board &board) {
  if (pass_ == kNotSaving) return Saving::kIdle;
  if (board.storing()) return Saving::kBusy;
  for (uint8_t i = 0; i < kAtOnce; ++i) {
    const bool writing = pass_ % 2 == 0;
    const uint16_t at = static_cast<uint16_t>(pass_ < 2 ? save_at_ : kSecond + save_at_);
    const uint8_t byte = block_byte(save_at_, &save_crc_);
    const bool differs = board.load(at) != byte;
    if (++save_at_ == kBlock) {
      save_at_ = 0;
      ++pass_;
    }
    if (differs && !writing) {
      pass_ = kNotSaving;
      return Saving::kFailed;
    }
    if (pass_ == kNotSaving) return Saving::kDone;
    if (differs) {
      board.store(at, byte);
      break;
    }
  }
  return Saving::kBusy;
}

}  // namespace daranti
