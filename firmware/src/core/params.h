// The parameters of firmware/protocol.toml: always within their ranges, kept in EEPROM.
#pragma once
#include <stdint.h>

#include "board.h"
#include "protocol.h"

namespace daranti {

// The range of a parameter, raw.
struct ParamRange {
  int16_t initial;
  int16_t low;
  int16_t high;
};
ParamRange param_range(uint8_t id);  // id < protocol::kParams

class Params {
 public:
  Params() { set_defaults(); }

  int16_t operator[](protocol::Param param) const { return values_[static_cast<uint8_t>(param)]; }
  int16_t value(uint8_t id) const { return values_[id]; }
  // UNKNOWN for an id that does not exist, OUT_OF_RANGE for a value outside the range.
  protocol::Result set(uint8_t id, int16_t value);
  void set_defaults();

  // The EEPROM holds two copies, from the addresses 0 and kSecond: magic u8, count u8 of values,
  // the values i16 in the order of their ids, CRC-16 of all before. A copy may hold fewer or more
  // values than this version knows: ids are never reused, so those that both know are taken. An
  // erased block (0xFF throughout) was never written.
  enum class Loaded : uint8_t {
    kWhole,    // both copies alike, or both erased: defaults
    kOneCopy,  // one is damaged, erased or older: the first good one is in use
    kDamaged,  // neither is good, or a value is out of its range: defaults stand in
  };
  Loaded load(const Board &board);

  // Saving writes what differs and reads it back, one copy after the other, a few bytes a tick:
  // begin, then step until it is not kBusy. The values must not change meanwhile. Done means that
  // both copies read back as written.
  enum class Saving : uint8_t { kIdle, kBusy, kDone, kFailed };
  void begin_save();
  bool saving() const { return pass_ != kNotSaving; }
  Saving step_save(Board &board);

  static constexpr uint8_t kMagic = 0xDB;
  static constexpr uint16_t kBlock = 2 + 2 * protocol::kParams + 2;  // bytes
  static constexpr uint16_t kSecond = 512;
  static_assert(kBlock <= kSecond, "the copies do not overlap");

 private:
  static constexpr uint8_t kNotSaving = 4;  // passes: write, read back, of either copy

  // The block's byte, for ascending `at`; carries the CRC along.
  uint8_t block_byte(uint16_t at, uint16_t *crc) const;
  bool take(const Board &board, uint16_t from, uint8_t count);

  int16_t values_[protocol::kParams];
  uint16_t save_at_ = 0;  // next byte of the pass
  uint16_t save_crc_ = 0;
  uint8_t pass_ = kNotSaving;
  bool all_default_ = false;  // set_defaults() has nothing to do
};

}  // namespace daranti
