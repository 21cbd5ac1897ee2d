#include <doctest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "frame.h"

using namespace daranti;

namespace {

std::vector<uint8_t> bytes_of(const std::string &hex) {
  std::vector<uint8_t> out;
  for (size_t i = 0; i + 1 < hex.size(); i += 2) {
    out.push_back(static_cast<uint8_t>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  }
  return out;
}

std::string golden_path() {
  const std::string here = __FILE__;
  return here.substr(0, here.rfind('/')) + "/../golden_frames.txt";
}

}  // namespace

TEST_CASE(
    "The golden frames are what encode() writes and, to the firmware, what the parser takes") {
  std::ifstream file(golden_path());
  REQUIRE(file.good());
  int frames = 0, taken = 0;
  std::string line;
  Parser parser;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::string name, seq, payload, frame;
    words >> name >> seq >> payload >> frame;
    ++frames;
    const std::vector<uint8_t> body = payload == "-" ? std::vector<uint8_t>{} : bytes_of(payload);
    const std::vector<uint8_t> expected = bytes_of(frame);
    // The id stands in the first byte after the first COBS code.
    std::vector<uint8_t> written(body.size() + kFrameOverhead);
    const uint8_t count = encode(expected[1], static_cast<uint8_t>(std::stoi(seq, nullptr, 16)),
                                 body.data(), static_cast<uint8_t>(body.size()), written.data());
    CHECK(count == expected.size());
    CHECK(written == expected);
    if (protocol::command_size(expected[1]) < 0) continue;
    Command command{};
    for (const uint8_t byte : expected) {
      if (!parser.feed(byte, &command)) continue;
      ++taken;
      CHECK(command.id == expected[1]);
      CHECK(std::vector<uint8_t>(command.payload, command.payload + body.size()) == body);
    }
  }
  CHECK(frames == 32);
  CHECK(taken == 21);
  CHECK(parser.bad() == 0);
}
