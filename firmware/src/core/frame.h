// Frames of the serial link: COBS(id, seq, payload, CRC-16/CCITT-FALSE little-endian) 0x00.
#pragma once
#include <stdint.h>

#include "protocol.h"

namespace daranti {

constexpr uint8_t kFrameOverhead = 6;  // id, seq, two of CRC, one of COBS, the closing zero

// CRC-16/CCITT-FALSE (polynomial 0x1021, not reflected), one byte further; starts at 0xFFFF.
uint16_t crc16(uint16_t crc, uint8_t byte);

// Writes the frame; `frame` holds at least size + kFrameOverhead bytes, size at most 250.
// Returns the frame's length with its closing zero.
uint8_t encode(uint8_t id, uint8_t seq, const uint8_t *payload, uint8_t size, uint8_t *frame);

// A message to the firmware whose frame, length, id and CRC hold.
struct Command {
  uint8_t id;
  uint8_t seq;
  uint8_t payload[protocol::kMaxCommandSize];
};

// Takes bytes one at a time. After any garbage the next whole valid frame is taken: at each zero
// the longest suffix of the bytes since the last zero that is a valid frame counts.
class Parser {
 public:
  // True where this byte completes a valid frame, which then stands in `command`.
  bool feed(uint8_t byte, Command *command);

  // Runs of bytes between zeros that held something else than exactly one valid frame; saturates.
  uint16_t bad() const { return bad_; }

 private:
  static constexpr uint8_t kMax = protocol::kMaxCommandSize + kFrameOverhead - 1;
  static constexpr uint8_t kMin = protocol::kMinCommandSize + kFrameOverhead - 1;

  uint8_t run_[2 * kMax];  // the bytes since the last zero: at least the last kMax of them
  uint8_t count_ = 0;      // of them; above kMax once more than kMax have come
  uint16_t bad_ = 0;
};

}  // namespace daranti
