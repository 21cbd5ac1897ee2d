#include "frame.h"

#include <string.h>

namespace daranti {

uint16_t crc16(uint16_t crc, uint8_t byte) {
  uint8_t x = static_cast<uint8_t>((crc >> 8) ^ byte);
  x = static_cast<uint8_t>(x ^ (x >> 4));
  return static_cast<uint16_t>((crc << 8) ^ (static_cast<uint16_t>(x) << 12) ^
                               (static_cast<uint16_t>(x) << 5) ^ x);
}

namespace {

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
  const uint8_t body = static_cast<uint8_t>(size - 1);
  const uint8_t length = static_cast<uint8_t>(body - 4);  // of the payload
  uint8_t tail[2];
  uint16_t crc = 0xFFFF;
  uint8_t next = stuffed[0];  // where the next zero stands
  for (uint8_t i = 1; i <= body; ++i) {
    uint8_t byte = stuffed[i];
    if (i == next) {
      next = static_cast<uint8_t>(i + byte);
      if (next > size) return false;
      byte = 0;
    }
    const uint8_t at = static_cast<uint8_t>(i - 1);
    if (at < body - 2) crc = crc16(crc, byte);
    if (at == 0) {
      if (protocol::command_size(byte) != length) return false;
      command->id = byte;
    } else if (at == 1) {
      command->seq = byte;
    } else if (at < body - 2) {
      command->payload[at - 2] = byte;
    } else {
      tail[at - (body - 2)] = byte;
    }
  }
  return next == size && crc == (tail[0] | static_cast<uint16_t>(tail[1]) << 8);
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
    if (count_ == kMax) {
      memmove(run_, run_ + 1, kMax - 1);
      run_[kMax - 1] = byte;
      overlong_ = true;
    } else {
      run_[count_++] = byte;
    }
    return false;
  }
  const uint8_t count = count_;
  const bool overlong = overlong_;
  count_ = 0;
  overlong_ = false;
  for (uint8_t size = count; size >= kMin; --size) {
    if (!decode(run_ + (count - size), size, command)) continue;
    if ((overlong || size != count) && bad_ != UINT16_MAX) ++bad_;
    return true;
  }
  if (count != 0 && bad_ != UINT16_MAX) ++bad_;
  return false;
}

}  // namespace daranti
