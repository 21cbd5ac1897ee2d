#include <doctest.h>

#include <initializer_list>
#include <vector>

#include "frame.h"

using namespace daranti;

namespace {

using Bytes = std::vector<uint8_t>;

// Frame with its closing zero.
Bytes frame_of(uint8_t id, uint8_t seq, const Bytes &payload) {
  Bytes frame(payload.size() + kFrameOverhead);
  const uint8_t count =
      encode(id, seq, payload.data(), static_cast<uint8_t>(payload.size()), frame.data());
  REQUIRE(count == frame.size());
  return frame;
}

Bytes operator+(Bytes left, const Bytes &right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

struct Link {
  Parser parser;
  std::vector<Command> taken;
  void feed(const Bytes &bytes) {
    Command command{};
    for (const uint8_t byte : bytes) {
      if (parser.feed(byte, &command)) taken.push_back(command);
    }
  }
};

const Bytes kDrive{0xE8, 0x03, 0xF4, 0x01, 0x01};

}  // namespace

TEST_CASE("CRC-16/CCITT-FALSE of the check string is 0x29B1") {
  uint16_t crc = 0xFFFF;
  for (const char c : {'1', '2', '3', '4', '5', '6', '7', '8', '9'}) {
    crc = crc16(crc, static_cast<uint8_t>(c));
  }
  CHECK(crc == 0x29B1);
}

TEST_CASE("A frame holds no zero but its last byte") {
  for (int fill = 0; fill < 256; ++fill) {
    const Bytes frame =
        frame_of(5, static_cast<uint8_t>(fill), Bytes(13, static_cast<uint8_t>(fill)));
    for (size_t i = 0; i + 1 < frame.size(); ++i) CHECK(frame[i] != 0);
    CHECK(frame.back() == 0);
  }
}

TEST_CASE("What is encoded is decoded, for every sequence number") {
  Link link;
  for (int seq = 0; seq < 256; ++seq) link.feed(frame_of(5, static_cast<uint8_t>(seq), kDrive));
  REQUIRE(link.taken.size() == 256);
  for (int seq = 0; seq < 256; ++seq) {
    CHECK(link.taken[seq].id == 5);
    CHECK(link.taken[seq].seq == seq);
    for (size_t i = 0; i < kDrive.size(); ++i) CHECK(link.taken[seq].payload[i] == kDrive[i]);
  }
  CHECK(link.parser.bad() == 0);
}

TEST_CASE("Messages without a payload and with the longest are taken") {
  Link link;
  link.feed(frame_of(protocol::Stop::kId, 7, {}));
  link.feed(frame_of(protocol::HilSensors::kId, 8, Bytes(protocol::HilSensors::kSize, 0)));
  link.feed(frame_of(protocol::HilSensors::kId, 9, Bytes(protocol::HilSensors::kSize, 0x55)));
  REQUIRE(link.taken.size() == 3);
  CHECK(link.taken[0].id == protocol::Stop::kId);
  CHECK(link.taken[1].payload[10] == 0);
  CHECK(link.taken[2].payload[10] == 0x55);
}

TEST_CASE("After garbage of any length the next whole frame is taken and counted bad once") {
  for (size_t length = 1; length < 60; ++length) {
    Link link;
    link.feed(Bytes(length, 0xA5) + frame_of(5, 1, kDrive));
    REQUIRE(link.taken.size() == 1);
    CHECK(link.taken[0].seq == 1);
    CHECK(link.parser.bad() == 1);
    link.feed(frame_of(5, 2, kDrive));
    CHECK(link.taken.size() == 2);
    CHECK(link.parser.bad() == 1);
  }
}

TEST_CASE("A frame behind another that lost its closing zero is the one that counts") {
  const Bytes stop = frame_of(protocol::Stop::kId, 9, {});
  const Bytes bare(stop.begin(), stop.end() - 1);
  Link link;
  link.feed(bare + frame_of(5, 3, kDrive));
  REQUIRE(link.taken.size() == 1);
  CHECK(link.taken[0].id == 5);
}

TEST_CASE("A run of just the longest frame's length is no overlong one") {
  Link link;
  const Bytes longest =
      frame_of(protocol::HilSensors::kId, 8, Bytes(protocol::HilSensors::kSize, 0x55));
  link.feed(longest);
  CHECK(link.taken.size() == 1);
  CHECK(link.parser.bad() == 0);
  link.feed(Bytes{7} + longest);
  CHECK(link.taken.size() == 2);
  CHECK(link.parser.bad() == 1);
}

TEST_CASE("Whatever a refused frame held, the last command taken stands") {
  Parser parser;
  Command command{};
  for (const uint8_t byte : frame_of(5, 1, kDrive)) parser.feed(byte, &command);
  Bytes wrong = frame_of(5, 2, Bytes(5, 0x77));
  wrong[3] = 0x78;
  for (const uint8_t byte : wrong) CHECK(!parser.feed(byte, &command));
  CHECK(command.seq == 1);
  CHECK(command.payload[0] == kDrive[0]);
}

TEST_CASE("A frame whose zeros point anywhere but to its end is refused, though its CRC holds") {
  // Drive's payload all zero: every code byte leads to the next zero.
  const Bytes good = frame_of(5, 1, Bytes(5, 0));
  Link link;
  link.feed(good);
  REQUIRE(link.taken.size() == 1);
  for (size_t at = 0; at + 1 < good.size(); ++at) {
    for (int value = 1; value < 256; ++value) {
      if (value == good[at]) continue;
      Bytes frame = good;
      frame[at] = static_cast<uint8_t>(value);
      link.feed(frame);
    }
  }
  CHECK(link.taken.size() == 1);
}

TEST_CASE("Zeros between frames are no bad frames") {
  Link link;
  link.feed({0, 0, 0});
  link.feed(frame_of(5, 1, kDrive));
  link.feed({0});
  CHECK(link.taken.size() == 1);
  CHECK(link.parser.bad() == 0);
}

TEST_CASE("Every single bit error is refused") {
  const Bytes good = frame_of(5, 200, kDrive);
  for (size_t bit = 0; bit < (good.size() - 1) * 8; ++bit) {
    Bytes frame = good;
    frame[bit / 8] = static_cast<uint8_t>(frame[bit / 8] ^ 1U << bit % 8);
    Link link;
    link.feed(frame);
    CHECK(link.taken.empty());
    CHECK(link.parser.bad() >= 1);
  }
}

TEST_CASE("A lost or doubled byte is refused, and the next frame taken") {
  const Bytes good = frame_of(5, 0, kDrive);
  for (size_t at = 0; at + 1 < good.size(); ++at) {
    Bytes lost = good;
    lost.erase(lost.begin() + static_cast<long>(at));
    Bytes twice = good;
    twice.insert(twice.begin() + static_cast<long>(at), good[at]);
    Link link;
    link.feed(lost);
    CHECK(link.taken.empty());
    link.feed(frame_of(5, 1, kDrive));
    REQUIRE(link.taken.size() == 1);
    link.feed(twice);
    link.feed(frame_of(5, 2, kDrive));
    CHECK(link.taken.back().seq == 2);
  }
}

TEST_CASE("Unknown ids and wrong lengths are refused") {
  Link link;
  link.feed(frame_of(200, 0, {}));
  link.feed(frame_of(0, 0, {}));
  link.feed(frame_of(5, 0, {1, 2, 3, 4}));
  link.feed(frame_of(5, 0, {1, 2, 3, 4, 5, 6}));
  link.feed(frame_of(protocol::Stop::kId, 0, {1}));
  CHECK(link.taken.empty());
  CHECK(link.parser.bad() == 5);
}

TEST_CASE("The count of bad frames saturates") {
  Link link;
  for (int i = 0; i < 65535; ++i) link.feed({1, 0});
  CHECK(link.parser.bad() == 65535);
  link.feed({1, 0});
  link.feed(Bytes{0xA5} + frame_of(5, 1, kDrive));
  CHECK(link.taken.size() == 1);
  CHECK(link.parser.bad() == 65535);
}

TEST_CASE("A short run of bytes is bad, whatever it holds") {
  for (size_t length = 1; length < 5; ++length) {
    Link link;
    link.feed(Bytes(length, 1) + Bytes{0});
    CHECK(link.taken.empty());
    CHECK(link.parser.bad() == 1);
  }
}

TEST_CASE("Numbers on the wire are little-endian") {
  uint8_t bytes[4];
  protocol::put<int32_t>(bytes, -2);
  CHECK(bytes[0] == 0xFE);
  CHECK(bytes[3] == 0xFF);
  CHECK(protocol::get<int32_t>(bytes) == -2);
  protocol::put<uint16_t>(bytes, 0x1234);
  CHECK(bytes[0] == 0x34);
  CHECK(bytes[1] == 0x12);
  CHECK(protocol::get<uint16_t>(bytes) == 0x1234);
}
