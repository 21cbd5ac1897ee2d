#include <doctest.h>

#include "fake_board.h"
#include "params.h"

using namespace daranti;
using protocol::Param;
using protocol::Result;
using Loaded = Params::Loaded;

namespace {

bool all_default(const Params &params) {
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    if (params.value(id) != param_range(id).initial) return false;
  }
  return true;
}

Params::Saving save(Params &params, FakeBoard &board) {
  params.begin_save();
  Params::Saving state = Params::Saving::kBusy;
  int steps = 0;
  while (state == Params::Saving::kBusy && ++steps < 1000) {
    if (!params.saving()) break;
    state = params.step_save(board);
  }
  CHECK(!params.saving());
  return state;
}

}  // namespace

TEST_CASE("Every default lies within its range") {
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    const ParamRange range = param_range(id);
    CHECK(range.low <= range.initial);
    CHECK(range.initial <= range.high);
  }
  CHECK(all_default(Params()));
}

TEST_CASE("Ids are the schema's order") {
  Params params;
  CHECK(params.set(0, 1) == Result::OK);
  CHECK(params[Param::steer_driver] == 1);
  CHECK(params.set(protocol::kParams - 1, 2) == Result::OK);
  CHECK(params[Param::drive_lag] == 2);
}

TEST_CASE("A value is taken at both ends of its range and refused beyond") {
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    Params params;
    const ParamRange range = param_range(id);
    CHECK(params.set(id, range.low) == Result::OK);
    CHECK(params.set(id, range.high) == Result::OK);
    CHECK(params.value(id) == range.high);
    if (range.low > INT16_MIN) {
      CHECK(params.set(id, static_cast<int16_t>(range.low - 1)) == Result::OUT_OF_RANGE);
    }
    if (range.high < INT16_MAX) {
      CHECK(params.set(id, static_cast<int16_t>(range.high + 1)) == Result::OUT_OF_RANGE);
    }
    CHECK(params.value(id) == range.high);
  }
}

TEST_CASE("An id that does not exist is unknown") {
  Params params;
  CHECK(params.set(protocol::kParams, 0) == Result::UNKNOWN);
  CHECK(params.set(255, 0) == Result::UNKNOWN);
  CHECK(all_default(params));
}

TEST_CASE("An erased EEPROM means defaults, without complaint") {
  FakeBoard board;
  Params params;
  params.set(0, 1);
  CHECK(params.load(board) == Loaded::kWhole);
  CHECK(all_default(params));
}

TEST_CASE("What was saved is loaded") {
  FakeBoard board;
  Params params;
  for (uint8_t id = 0; id < protocol::kParams; ++id) params.set(id, param_range(id).low);
  CHECK(save(params, board) == Params::Saving::kDone);
  Params loaded;
  CHECK(loaded.load(board) == Loaded::kWhole);
  for (uint8_t id = 0; id < protocol::kParams; ++id) CHECK(loaded.value(id) == param_range(id).low);
  CHECK(params.step_save(board) == Params::Saving::kIdle);
}

TEST_CASE("A save waits for the EEPROM and writes one byte a step") {
  FakeBoard board;
  Params params;
  params.begin_save();
  CHECK(params.step_save(board) == Params::Saving::kBusy);
  CHECK(board.eeprom[0] == Params::kMagic);
  CHECK(board.eeprom[1] == 0xFF);
  board.busy = 3;
  for (int i = 0; i < 3; ++i) CHECK(params.step_save(board) == Params::Saving::kBusy);
  CHECK(board.eeprom[1] == 0xFF);
  CHECK(params.step_save(board) == Params::Saving::kBusy);
  CHECK(board.eeprom[1] == protocol::kParams);
}

TEST_CASE("A save writes only what differs, and looks at four bytes a step") {
  FakeBoard board;
  Params params;
  save(params, board);
  board.stores = 0;
  CHECK(save(params, board) == Params::Saving::kDone);
  CHECK(board.stores == 0);
  params.begin_save();
  int steps = 1;
  while (params.step_save(board) == Params::Saving::kBusy) ++steps;
  CHECK(steps == Params::kBlock);  // four passes
  params.set(static_cast<uint8_t>(Param::steer_kp), 123);
  CHECK(save(params, board) == Params::Saving::kDone);
  CHECK(board.stores <= 8);  // its low byte or both, and the CRC, twice
  CHECK(board.stores >= 4);
}

TEST_CASE("Either copy is magic, count, values little-endian and their CRC") {
  FakeBoard board;
  Params params;
  CHECK(save(params, board) == Params::Saving::kDone);
  for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
    const uint8_t *copy = board.eeprom + from;
    CHECK(copy[0] == 0xDB);
    CHECK(copy[1] == protocol::kParams);
    uint16_t crc = 0xFFFF;
    for (int at = 0; at < Params::kBlock - 2; ++at) crc = crc16(crc, copy[at]);
    CHECK(copy[Params::kBlock - 2] == (crc & 0xFF));
    CHECK(copy[Params::kBlock - 1] == crc >> 8);
    CHECK(copy[Params::kBlock] == 0xFF);
    for (uint8_t id = 0; id < protocol::kParams; ++id) {
      const int value = copy[2 + 2 * id] | copy[3 + 2 * id] << 8;
      CHECK(static_cast<int16_t>(value) == params.value(id));
    }
  }
}

TEST_CASE("Any byte that does not take its value makes the save fail") {
  FakeBoard right;
  Params params;
  save(params, right);
  for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
    for (int at = from; at < from + Params::kBlock; ++at) {
      FakeBoard board;
      board.worn_out = at;
      // A worn byte that happens to hold the right value is no failure.
      const bool harmless = right.eeprom[at] == 0xFF;
      CHECK(save(params, board) == (harmless ? Params::Saving::kDone : Params::Saving::kFailed));
    }
  }
}

TEST_CASE("Any corrupted byte of a copy means the other, for every value of it") {
  FakeBoard board;
  Params stored;
  stored.set(static_cast<uint8_t>(Param::steer_kp), 123);
  save(stored, board);
  for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
    for (int at = from; at < from + Params::kBlock; ++at) {
      const uint8_t right = board.eeprom[at];
      for (int wrong = 0; wrong < 256; ++wrong) {
        if (wrong == right) continue;
        board.eeprom[at] = static_cast<uint8_t>(wrong);
        Params params;
        const Loaded loaded = params.load(board);
        if (loaded != Loaded::kOneCopy || params[Param::steer_kp] != 123) {
          FAIL("byte ", at, " value ", wrong);
        }
      }
      board.eeprom[at] = right;
    }
  }
}

TEST_CASE("With both copies damaged, or one and the other erased, defaults stand in") {
  for (const bool erased : {false, true}) {
    FakeBoard board;
    Params stored;
    stored.set(static_cast<uint8_t>(Param::steer_kp), 123);
    save(stored, board);
    board.eeprom[20] ^= 1;
    if (erased) {
      memset(board.eeprom + Params::kSecond, 0xFF, Params::kBlock);
    } else {
      board.eeprom[Params::kSecond + 20] ^= 1;
    }
    Params params;
    CHECK(params.load(board) == Loaded::kDamaged);
    CHECK(all_default(params));
  }
}

TEST_CASE("A whole copy and an erased one: the first is in use, and it is said") {
  for (const uint16_t erased : {uint16_t{0}, Params::kSecond}) {
    FakeBoard board;
    Params stored;
    stored.set(static_cast<uint8_t>(Param::steer_kp), 123);
    save(stored, board);
    memset(board.eeprom + erased, 0xFF, Params::kBlock);
    Params params;
    CHECK(params.load(board) == Loaded::kOneCopy);
    CHECK(params[Param::steer_kp] == 123);
  }
}

TEST_CASE("Of two whole copies that differ the first is in use, and it is said") {
  FakeBoard board, other;
  Params params;
  params.set(static_cast<uint8_t>(Param::steer_kp), 123);
  save(params, board);
  params.set(static_cast<uint8_t>(Param::steer_kp), 124);
  save(params, other);
  memcpy(board.eeprom, other.eeprom, Params::kBlock);
  Params loaded;
  CHECK(loaded.load(board) == Loaded::kOneCopy);
  CHECK(loaded[Param::steer_kp] == 124);
}

TEST_CASE("A copy with fewer or more values keeps those that this version knows") {
  for (const int count : {0, 5, protocol::kParams - 1, protocol::kParams + 1, 158, 159}) {
    FakeBoard board;
    for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
      uint8_t *copy = board.eeprom + from;
      copy[0] = Params::kMagic;
      copy[1] = static_cast<uint8_t>(count);
      for (int id = 0; id < count; ++id) {
        const int16_t value =
            id < protocol::kParams ? param_range(static_cast<uint8_t>(id)).high : int16_t{7};
        copy[2 + 2 * id] = static_cast<uint8_t>(value);
        copy[3 + 2 * id] = static_cast<uint8_t>(value >> 8);
      }
      uint16_t crc = 0xFFFF;
      for (int at = 0; at < 2 + 2 * count; ++at) crc = crc16(crc, copy[at]);
      copy[2 + 2 * count] = static_cast<uint8_t>(crc);
      copy[3 + 2 * count] = static_cast<uint8_t>(crc >> 8);
    }
    Params params;
    CHECK(params.load(board) == (count > 158 ? Loaded::kDamaged : Loaded::kWhole));
    for (uint8_t id = 0; id < protocol::kParams; ++id) {
      const ParamRange range = param_range(id);
      CHECK(params.value(id) == (id < count && count <= 158 ? range.high : range.initial));
    }
  }
}

TEST_CASE("A value out of its range costs that value only, and is reported") {
  FakeBoard board;
  Params params;
  params.set(static_cast<uint8_t>(Param::steer_kp), 123);
  save(params, board);
  for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
    uint8_t *copy = board.eeprom + from;
    copy[2] = 9;  // steer_driver, 0 to 3
    uint16_t crc = 0xFFFF;
    for (int at = 0; at < Params::kBlock - 2; ++at) crc = crc16(crc, copy[at]);
    copy[Params::kBlock - 2] = static_cast<uint8_t>(crc);
    copy[Params::kBlock - 1] = static_cast<uint8_t>(crc >> 8);
  }
  Params loaded;
  CHECK(loaded.load(board) == Loaded::kDamaged);
  CHECK(loaded[Param::steer_driver] == 0);
  CHECK(loaded[Param::steer_kp] == 123);
}

TEST_CASE("One byte left of an erased memory is reported, what lies behind does not matter") {
  for (const uint16_t from : {uint16_t{0}, Params::kSecond}) {
    for (int at = from; at < from + Params::kBlock; ++at) {
      FakeBoard board;
      board.eeprom[at] = 0;
      Params params;
      CHECK(params.load(board) == Loaded::kDamaged);
      CHECK(all_default(params));
    }
    FakeBoard board;
    board.eeprom[from + Params::kBlock] = 0;
    Params params;
    CHECK(params.load(board) == Loaded::kWhole);
  }
}

TEST_CASE("Defaults come back after any change, as often as one is made") {
  Params params;
  for (int i = 0; i < 3; ++i) {
    CHECK(params.set(static_cast<uint8_t>(Param::steer_kp), 123) == Result::OK);
    params.set_defaults();
    CHECK(all_default(params));
    params.set_defaults();
    CHECK(all_default(params));
  }
}

TEST_CASE("A copy of fewer values leaves the others at their defaults, whatever they were") {
  FakeBoard board;
  const uint8_t copy[] = {Params::kMagic, 1, 2, 0};
  uint16_t crc = 0xFFFF;
  for (uint8_t at = 0; at < sizeof copy; ++at) {
    board.eeprom[at] = copy[at];
    crc = crc16(crc, copy[at]);
  }
  board.eeprom[sizeof copy] = static_cast<uint8_t>(crc);
  board.eeprom[sizeof copy + 1] = static_cast<uint8_t>(crc >> 8);
  Params params;
  params.set(static_cast<uint8_t>(Param::steer_kp), 123);
  CHECK(params.load(board) == Loaded::kOneCopy);
  CHECK(params[Param::steer_driver] == 2);
  CHECK(params[Param::steer_kp] == param_range(static_cast<uint8_t>(Param::steer_kp)).initial);
}

TEST_CASE("Two copies of one checksum that hold more and fewer values differ") {
  const auto write = [](FakeBoard &board, uint16_t from, std::vector<uint8_t> copy) {
    uint16_t crc = 0xFFFF;
    for (const uint8_t byte : copy) crc = crc16(crc, byte);
    copy.push_back(static_cast<uint8_t>(crc));
    copy.push_back(static_cast<uint8_t>(crc >> 8));
    for (const uint8_t byte : copy) board.eeprom[from++] = byte;
    return crc;
  };
  FakeBoard board;
  const uint16_t crc = write(board, 0, {Params::kMagic, 2, 1, 0, 3, 0});
  bool found = false;
  for (int k = 0; k < 16 * 25000 && !found; ++k) {
    const int hz = 123 + k / 16;  // of the third value's range
    found = crc == write(board, Params::kSecond,
                         {Params::kMagic, 3, static_cast<uint8_t>(k & 3), 0,
                          static_cast<uint8_t>(k >> 2 & 3), 0, static_cast<uint8_t>(hz),
                          static_cast<uint8_t>(hz >> 8)});
  }
  REQUIRE(found);
  Params params;
  CHECK(params.load(board) == Loaded::kOneCopy);
}
