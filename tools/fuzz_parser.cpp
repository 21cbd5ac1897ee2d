// Deterministic fuzzing of the frame parser: random garbage, mangled frames and
// runs without a zero, under the sanitizers. After every input a whole valid
// frame must be taken. usage: fuzz_parser [inputs] [seed]
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include "frame.h"

int main(int argc, char **argv) {
  const long inputs = argc > 1 ? atol(argv[1]) : 10'000'000;
  std::mt19937_64 random(argc > 2 ? strtoull(argv[2], nullptr, 10) : 1);
  daranti::Parser parser;
  daranti::Command command{};
  const uint8_t payload[5] = {0xE8, 0x03, 0, 0, 1};
  long taken = 0;
  for (long i = 0; i < inputs; ++i) {
    uint8_t bytes[64];
    uint64_t bits = random();
    size_t count = bits % 40;
    if (bits >> 62 == 0) { // a valid frame with one byte changed
      count = daranti::encode(5, static_cast<uint8_t>(i), payload,
                              sizeof payload, bytes);
      bytes[(bits >> 8) % count] = static_cast<uint8_t>(bits >> 16);
    } else {
      for (size_t k = 0; k < count; ++k) {
        if (k % 8 == 0)
          bits = random();
        bytes[k] = static_cast<uint8_t>(bits >> (k % 8 * 8));
      }
    }
    for (size_t k = 0; k < count; ++k)
      taken += parser.feed(bytes[k], &command);
    const uint8_t seq = static_cast<uint8_t>(i);
    count = daranti::encode(5, seq, payload, sizeof payload, bytes);
    bool found = false;
    for (size_t k = 0; k < count; ++k)
      found = parser.feed(bytes[k], &command) || found;
    if (!found || command.seq != seq || command.id != 5) {
      printf("input %ld: the next valid frame was not taken\n", i);
      return 1;
    }
  }
  printf("%ld inputs, %ld of them held a valid frame, every next frame taken\n",
         inputs, taken);
  return 0;
}
