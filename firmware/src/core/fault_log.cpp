#include "fault_log.h"

#include "frame.h"

namespace daranti {

using protocol::LogEntry;
using protocol::State;

namespace {

constexpr uint8_t kCrcAt = FaultLog::kSize - 2;
constexpr uint8_t kTicksPerSecond = static_cast<uint8_t>(1000 / kTickMs);

uint16_t place_of(uint16_t number) {
  return static_cast<uint16_t>(FaultLog::kAddress + number % FaultLog::kEntries * FaultLog::kSize);
}

// Copies what lies at a place; whether it is an entry.
bool copy(const Board &board, uint16_t from, uint8_t *entry) {
  uint16_t crc = 0xFFFF;
  for (uint8_t at = 0; at < FaultLog::kSize; ++at) {
    entry[at] = board.load(static_cast<uint16_t>(from + at));
    if (at < kCrcAt) crc = crc16(crc, entry[at]);
  }
  return protocol::get<uint16_t>(entry + kCrcAt) == crc;
}

}  // namespace

void FaultLog::boot(const Board &board) {
  bool any = false;
  for (uint8_t place = 0; place < kEntries; ++place) {
    uint8_t entry[kSize];
    if (!copy(board, place_of(place), entry)) continue;
    const uint16_t number = protocol::get<uint16_t>(entry);
    if (number % kEntries != place) continue;
    // Newer by at most half of the numbers: they wrap.
    const uint16_t ahead = static_cast<uint16_t>(number + 1 - next_);
    if (!any || ahead <= INT16_MAX) next_ = static_cast<uint16_t>(number + 1);
    any = true;
  }
}

void FaultLog::note(uint32_t latched, State before) {
  if (wait_ != 0) --wait_;
  if (++ticks_ == kTicksPerSecond) {
    ticks_ = 0;
    if (uptime_ != UINT16_MAX) ++uptime_;
  }
  const uint32_t came = latched & ~known_;
  known_ = latched;
  if (came == 0) return;
  if (fresh_ == 0) {
    fresh_uptime_ = uptime_;
    fresh_state_ = before;
  }
  fresh_ |= came;
}

void FaultLog::stage(uint8_t cause) {
  protocol::put<uint16_t>(staged_, next_);
  protocol::put<uint32_t>(staged_ + 2, fresh_);
  protocol::put<uint16_t>(staged_ + 6, fresh_uptime_);
  staged_[8] = cause;
  staged_[9] = static_cast<uint8_t>(fresh_state_);
  uint16_t crc = 0xFFFF;
  for (uint8_t at = 0; at < kCrcAt; ++at) crc = crc16(crc, staged_[at]);
  protocol::put<uint16_t>(staged_ + kCrcAt, crc);
  staged_at_ = 0;
  fresh_ = 0;
  wait_ = kWait;
}

bool FaultLog::step(Board &board) {
  if (board.storing()) return false;
  if (clearing()) {
    if (clear_at_ == kEntries) {
      clear_at_ = kNotClearing;
      return true;
    }
    const uint16_t from = place_of(clear_at_++);
    uint8_t entry[kSize];
    if (copy(board, from, entry)) {
      board.store(static_cast<uint16_t>(from + kSize - 1), static_cast<uint8_t>(~entry[kSize - 1]));
    }
    return false;
  }
  if (staged_at_ != kSize) {
    const uint16_t at = static_cast<uint16_t>(place_of(next_) + staged_at_);
    if (board.load(at) != staged_[staged_at_]) board.store(at, staged_[staged_at_]);
    if (++staged_at_ == kSize) ++next_;
  } else if (fresh_ != 0 && wait_ == 0) {
    stage(board.reset_cause());
  }
  return false;
}

LogEntry FaultLog::read(const Board &board, uint8_t index) const {
  const uint16_t number = static_cast<uint16_t>(next_ - 1 - index);
  uint8_t entry[kSize];
  if (!copy(board, place_of(number), entry) || protocol::get<uint16_t>(entry) != number) {
    return LogEntry{index, number, 0, 0, 0, 0};
  }
  return LogEntry{
      index,    number,  protocol::get<uint32_t>(entry + 2), protocol::get<uint16_t>(entry + 6),
      entry[8], entry[9]};
}

}  // namespace daranti
