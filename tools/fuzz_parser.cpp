// The frame parser's fuzz target: whatever came before, the next whole valid frame is taken, what
// is handed out is a message of the schema, and no run counts as bad more than once.
#include <cstdio>
#include <cstdlib>

#include "frame.h"

namespace {

void demand(bool fact, const char *what) {
  if (fact) return;
  fprintf(stderr, "%s\n", what);
  abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
  daranti::Parser parser;
  daranti::Command command{};
  size_t zeros = 0;
  for (size_t i = 0; i < size; ++i) {
    zeros += data[i] == 0;
    if (!parser.feed(data[i], &command)) continue;
    demand(data[i] == 0, "a frame ended without its zero");
    demand(daranti::protocol::command_size(command.id) >= 0, "an id that does not exist was taken");
  }
  demand(parser.bad() <= zeros, "a run counted as bad twice");
  const uint8_t payload[5] = {0xE8, 0x03, 0, 0, 1};
  uint8_t frame[sizeof payload + daranti::kFrameOverhead];
  const uint8_t seq = static_cast<uint8_t>(size);
  const uint8_t count =
      daranti::encode(daranti::protocol::Drive::kId, seq, payload, sizeof payload, frame);
  bool taken = false;
  for (uint8_t i = 0; i < count; ++i) taken = parser.feed(frame[i], &command);
  demand(taken && command.id == daranti::protocol::Drive::kId && command.seq == seq,
         "the next whole valid frame was not taken");
  return 0;
}
