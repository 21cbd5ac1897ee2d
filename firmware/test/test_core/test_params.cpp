#include <doctest.h>

#include "fake_board.h"
#include "params.h"

using namespace daranti;
using protocol::Param;
using protocol::Result;

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
  CHECK(params.set(protocol::kParams - 1, 101) == Result::OK);
  CHECK(params[Param::ident_time_max] == 101);
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
  CHECK(params.load(board));
  CHECK(all_default(params));
}

TEST_CASE("What was saved is loaded") {
  FakeBoard board;
  Params params;
  for (uint8_t id = 0; id < protocol::kParams; ++id) params.set(id, param_range(id).low);
  CHECK(save(params, board) == Params::Saving::kDone);
  Params loaded;
  CHECK(loaded.load(board));
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
  CHECK(board.eeprom[1] == protocol::kVersion);
}

TEST_CASE("The block is magic, version, values little-endian and their CRC") {
  FakeBoard board;
  Params params;
  CHECK(save(params, board) == Params::Saving::kDone);
  CHECK(board.eeprom[0] == 0xDA);
  CHECK(board.eeprom[1] == protocol::kVersion);
  uint16_t crc = 0xFFFF;
  for (int at = 0; at < Params::kBlock - 2; ++at) crc = crc16(crc, board.eeprom[at]);
  CHECK(board.eeprom[Params::kBlock - 2] == (crc & 0xFF));
  CHECK(board.eeprom[Params::kBlock - 1] == crc >> 8);
  CHECK(board.eeprom[Params::kBlock] == 0xFF);
  for (uint8_t id = 0; id < protocol::kParams; ++id) {
    const int value = board.eeprom[2 + 2 * id] | board.eeprom[3 + 2 * id] << 8;
    CHECK(static_cast<int16_t>(value) == params.value(id));
  }
}

TEST_CASE("Any byte that does not take its value makes the save fail") {
  for (int at = 0; at < Params::kBlock; ++at) {
    FakeBoard board;
    board.worn_out = at;
    Params params;
    // A worn byte that happens to hold the right value is no failure.
    const bool harmless = [&] {
      FakeBoard fresh;
      Params same;
      save(same, fresh);
      return fresh.eeprom[at] == 0xFF;
    }();
    CHECK(save(params, board) == (harmless ? Params::Saving::kDone : Params::Saving::kFailed));
  }
}

TEST_CASE("Any corrupted byte means defaults and is reported, for every value of it") {
  FakeBoard board;
  Params stored;
  stored.set(static_cast<uint8_t>(Param::steer_kp), 123);
  save(stored, board);
  for (int at = 0; at < Params::kBlock; ++at) {
    const uint8_t right = board.eeprom[at];
    for (int wrong = 0; wrong < 256; ++wrong) {
      if (wrong == right) continue;
      board.eeprom[at] = static_cast<uint8_t>(wrong);
      Params params;
      const bool loaded = params.load(board);
      if (loaded || !all_default(params)) {
        FAIL("byte ", at, " value ", wrong);
      }
    }
    board.eeprom[at] = right;
  }
  Params params;
  CHECK(params.load(board));
  CHECK(params[Param::steer_kp] == 123);
}

TEST_CASE("A block that is whole but holds a value out of range is refused") {
  FakeBoard board;
  Params params;
  save(params, board);
  board.eeprom[2] = 9;  // steer_driver, 0 or 1
  uint16_t crc = 0xFFFF;
  for (int at = 0; at < Params::kBlock - 2; ++at) crc = crc16(crc, board.eeprom[at]);
  board.eeprom[Params::kBlock - 2] = static_cast<uint8_t>(crc);
  board.eeprom[Params::kBlock - 1] = static_cast<uint8_t>(crc >> 8);
  Params loaded;
  CHECK(!loaded.load(board));
  CHECK(all_default(loaded));
}

TEST_CASE("A block of another protocol version or kind is refused, though its CRC holds") {
  for (const int at : {0, 1}) {
    FakeBoard board;
    Params params;
    save(params, board);
    board.eeprom[at] = static_cast<uint8_t>(board.eeprom[at] + 1);
    uint16_t crc = 0xFFFF;
    for (int i = 0; i < Params::kBlock - 2; ++i) crc = crc16(crc, board.eeprom[i]);
    board.eeprom[Params::kBlock - 2] = static_cast<uint8_t>(crc);
    board.eeprom[Params::kBlock - 1] = static_cast<uint8_t>(crc >> 8);
    Params loaded;
    CHECK(!loaded.load(board));
  }
}

TEST_CASE("One byte left of an erased block is reported") {
  for (int at = 0; at < Params::kBlock; ++at) {
    FakeBoard board;
    board.eeprom[at] = 0;
    Params params;
    CHECK(!params.load(board));
    CHECK(all_default(params));
  }
}

TEST_CASE("What lies behind an erased block does not matter") {
  FakeBoard board;
  board.eeprom[Params::kBlock] = 0;
  Params params;
  CHECK(params.load(board));
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
