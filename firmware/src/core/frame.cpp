#include "frame.h"

#include <string.h>

namespace daranti {

// In bytes, which is what the AVR shifts well.
uint16_t crc16(uint16_t crc, uint8_t byte) {
  uint8_t x = static_cast<uint8_t>((crc >> 8) ^ byte);
  x = static_cast<uint8_t>(x ^ (x >> 4));
  const uint8_t by_12 = static_cast<uint8_t>(x << 4);
  const uint8_t by_5_high = static_cast<uint8_t>(x >> 3);
  const uint8_t by_5_low = static_cast<uint8_t>(x << 5);
  const uint8_t high = static_cast<uint8_t>(crc ^ by_12 ^ by_5_high);
  return static_cast<uint16_t>(high << 8 | (x ^ by_5_low));
}

namespace {

constexpr uint8_t kBodyOverhead = 4;  // id, seq, two of CRC

// Appends bytes to a frame under construction, stuffing zeros as they come.
class Stuffer {
 public:
  explicit Stuffer(uint8_t *frame) : frame_(frame) {}
  void put(uint8_t byte) {
    if (byte == 0) {
      close();
    } else {
      frame_[at_++] = byte;
    }
  }
  void close() {
    frame_[code_] = static_cast<uint8_t>(at_ - code_);
    code_ = at_++;
  }
  uint8_t finish() {
    close();
    frame_[code_] = 0;
    return at_;
  }

 private:
  uint8_t *frame_;
  uint8_t code_ = 0;  // where the open block's length goes
  uint8_t at_ = 1;
};

// Decodes `size` stuffed bytes, none of them zero, as one command.
bool decode(const uint8_t *stuffed, uint8_t size, Command *command) {
  uint8_t left = stuffed[0];  // bytes to the next zero
  if (left == 1 || protocol::command_size(stuffed[1]) + kFrameOverhead - 1 != size) return false;
  uint8_t body[protocol::kMaxCommandSize + kBodyOverhead];
  const uint8_t count = static_cast<uint8_t>(size - 1);
  for (uint8_t i = 0; i < count; ++i) {
    const uint8_t byte = stuffed[i + 1];
    --left;
    body[i] = left == 0 ? uint8_t{0} : byte;
    if (left == 0) left = byte;
  }
  if (left != 1) return false;
  const uint8_t covered = static_cast<uint8_t>(count - 2);
  uint16_t crc = 0xFFFF;
  for (uint8_t i = 0; i < covered; ++i) crc = crc16(crc, body[i]);
  if (crc != (body[covered] | static_cast<uint16_t>(body[covered + 1]) << 8)) return false;
  command->id = body[0];
  command->seq = body[1];
  memcpy(command->payload, body + 2, static_cast<size_t>(covered - 2));
  return true;
}

}  // namespace

uint8_t encode(uint8_t id, uint8_t seq, const uint8_t *payload, uint8_t size, uint8_t *frame) {
  Stuffer out(frame);
  uint16_t crc = crc16(crc16(0xFFFF, id), seq);
  out.put(id);
  out.put(seq);
  for (uint8_t i = 0; i < size; ++i) {
    crc = crc16(crc, payload[i]);
    out.put(payload[i]);
  }
  out.put(static_cast<uint8_t>(crc));
  out.put(static_cast<uint8_t>(crc >> 8));
  return out.finish();
}

bool Parser::feed(uint8_t byte, Command *command) {
  if (byte != 0) {
    if (count_ == sizeof run_) {
      memcpy(run_, run_ + kMax, kMax);
      count_ = kMax;
    }
    run_[count_++] = byte;
    return false;
  }
  const uint8_t count = count_;
  count_ = 0;
  for (uint8_t size = count < kMax ? count : kMax; size >= kMin; --size) {
    if (!decode(run_ + (count - size), size, command)) continue;
    if (size != count && bad_ != UINT16_MAX) ++bad_;
    return true;
  }
  if (count != 0 && bad_ != UINT16_MAX) ++bad_;
  return false;
}

}  // namespace daranti
