// Runs a fuzz target where libFuzzer is not installed: random bytes, mangled frames and runs
// without a zero, the same for the same seed. usage: fuzz_random [inputs] [seed] [longest]
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "frame.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int main(int argc, char **argv) {
  const long inputs = argc > 1 ? atol(argv[1]) : 10'000'000;
  std::mt19937_64 random(argc > 2 ? strtoull(argv[2], nullptr, 10) : 1);
  const size_t longest = argc > 3 ? strtoul(argv[3], nullptr, 10) : 40;
  const uint8_t payload[5] = {0xE8, 0x03, 0, 0, 1};
  for (long i = 0; i < inputs; ++i) {
    uint8_t bytes[256];
    uint64_t bits = random();
    size_t count = bits % std::min(longest, sizeof bytes);
    if (bits >> 62 == 0) {  // a valid frame with one byte changed
      count = daranti::encode(5, static_cast<uint8_t>(i), payload, sizeof payload, bytes);
      bytes[(bits >> 8) % count] = static_cast<uint8_t>(bits >> 16);
    } else {
      for (size_t k = 0; k < count; ++k) {
        if (k % 8 == 0) bits = random();
        bytes[k] = static_cast<uint8_t>(bits >> (k % 8 * 8));
      }
    }
    LLVMFuzzerTestOneInput(bytes, count);
  }
  printf("%ld random inputs: every fact held\n", inputs);
  return 0;
}
