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

  // EEPROM block: magic u8, protocol version u8, kParams values i16, CRC-16 of all before, from
  // address 0. An erased block (0xFF throughout) was never written and means defaults. Returns
  // false, with the defaults in use, for a block that is anything else than whole and in range.
  bool load(const Board &board);

  // Saving writes, then reads back one byte a tick: begin, then step until it is not kBusy. The
  // values must not change meanwhile. Done means that the whole block read back as written.
  enum class Saving : uint8_t { kIdle, kBusy, kDone, kFailed };
  void begin_save() { save_at_ = 0; }
  bool saving() const { return save_at_ != kNotSaving; }
  Saving step_save(Board &board);

  static constexpr uint8_t kMagic = 0xDA;
  static constexpr uint16_t kBlock = 2 + 2 * protocol::kParams + 2;  // bytes

 private:
  static constexpr uint16_t kNotSaving = UINT16_MAX;

  // The block's byte, for ascending `at`; carries the CRC along.
  uint8_t block_byte(uint16_t at, uint16_t *crc) const;

  int16_t values_[protocol::kParams];
  uint16_t save_at_ = kNotSaving;  // next byte to write, from kBlock on to read back
  uint16_t save_crc_ = 0;
  bool all_default_ = false;  // set_defaults() has nothing to do
};

}  // namespace daranti
