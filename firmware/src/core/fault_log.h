// The fault log: what latched, in a ring in EEPROM that outlives a reset.
//
// An entry is written when faults latch, a byte a tick, at most one in two seconds: a fault that
// comes again and again wears 16 places of 100,000 writings each, which lasts over a month.
#pragma once
#include <stdint.h>

#include "board.h"
#include "protocol.h"

namespace daranti {

class FaultLog {
 public:
  static constexpr uint8_t kEntries = 16;
  // number u16, faults u32, uptime u16, reset cause u8, state u8, CRC-16 of all before; an entry
  // lies in the place number % kEntries. What does not fit its CRC is no entry.
  static constexpr uint8_t kSize = 12;
  static constexpr uint16_t kAddress = 1024 - kEntries * kSize;

  // Once after reset: goes on behind the newest entry.
  void boot(const Board &board);
  // Once a tick. latched: all faults that are; before: the state before the newest of them.
  void note(uint32_t latched, protocol::State before);
  // Once a tick, while nothing else is being stored: writes a byte, or nothing. True when a clear
  // is done.
  bool step(Board &board);

  // Makes all entries invalid, one a tick.
  void begin_clear() { clear_at_ = 0; }
  bool clearing() const { return clear_at_ != kNotClearing; }

  // The entry `index` places before the newest; no faults where there is none. Only while nothing
  // is being stored.
  protocol::LogEntry read(const Board &board, uint8_t index) const;

 private:
  static constexpr uint8_t kNotClearing = UINT8_MAX;
  static constexpr uint16_t kFirstWait = 200;  // ticks: a board that resets all the time is silent
  static constexpr uint16_t kWait = 400;       // ticks between entries

  void stage(uint8_t cause);

  uint8_t staged_[kSize] = {};
  uint8_t staged_at_ = kSize;  // next byte to write; kSize: none
  uint8_t clear_at_ = kNotClearing;
  uint16_t next_ = 0;  // number
  uint16_t wait_ = kFirstWait;
  uint8_t ticks_ = 0;    // of the second under way
  uint16_t uptime_ = 0;  // s, saturating
  uint32_t known_ = 0;   // faults that were latched at the last tick
  uint32_t fresh_ = 0;   // faults that are not written yet
  uint16_t fresh_uptime_ = 0;
  protocol::State fresh_state_ = protocol::State::SAFE;
};

}  // namespace daranti
