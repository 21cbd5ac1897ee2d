#include <doctest.h>

#include "controller.h"
#include "fake_board.h"
#include "fault_log.h"

using namespace daranti;
using protocol::LogEntry;
using protocol::Result;
using protocol::State;

namespace {

constexpr uint16_t kEnd = FaultLog::kAddress + FaultLog::kEntries * FaultLog::kSize;

struct Log {
  FakeBoard board;
  FaultLog log;
  uint32_t latched = 0;

  Log() { log.boot(board); }
  // Ticks; returns how many of them stored a byte.
  int tick(int count = 1, State before = State::SAFE) {
    const int begun = board.stores;
    for (int i = 0; i < count; ++i) {
      log.note(latched, before);
      log.step(board);
    }
    return board.stores - begun;
  }
  // One entry of a fault that then is cleared, and the pause after it.
  void entry(uint32_t faults) {
    latched = faults;
    tick(430);
    latched = 0;
    tick();
  }
  LogEntry read(uint8_t index) { return log.read(board, index); }
  // The log of a controller that starts on this memory.
  Log again() const {
    Log next;
    memcpy(next.board.eeprom, board.eeprom, sizeof board.eeprom);
    next.log = FaultLog();
    next.log.boot(next.board);
    return next;
  }
};

}  // namespace

TEST_CASE("An erased memory holds no entry") {
  Log rig;
  for (uint8_t k = 0; k < FaultLog::kEntries; ++k) CHECK(rig.read(k).faults == 0);
}

TEST_CASE("What latches is there after a reset: when, why it had started, in what state") {
  Log rig;
  rig.board.cause = protocol::BY_BROWN_OUT | protocol::WHILE_ARMED;
  rig.tick(7 * 200 - 1);
  rig.latched = protocol::POT_OPEN;
  rig.tick(1, State::RUNNING);
  rig.tick(30, State::FAULT);
  for (Log *each : {&rig, new Log(rig.again())}) {
    const LogEntry entry = each->read(0);
    CHECK(entry.index == 0);
    CHECK(entry.number == 0);
    CHECK(entry.faults == protocol::POT_OPEN);
    CHECK(entry.uptime == 7);
    CHECK(entry.reset_cause == (protocol::BY_BROWN_OUT | protocol::WHILE_ARMED));
    CHECK(entry.state == static_cast<uint8_t>(State::RUNNING));
    CHECK(each->read(1).faults == 0);
    if (each != &rig) delete each;
  }
}

TEST_CASE("The uptime counts whole seconds and stands still at its end") {
  Log rig;
  rig.tick(398);
  rig.latched = 1;
  rig.tick(30);
  CHECK(rig.read(0).uptime == 1);
  rig.latched = 0;
  rig.tick(200 * 65534 - 428);
  rig.latched = 2;
  rig.tick(30);
  CHECK(rig.read(0).uptime == 65534);
  rig.latched = 0;
  rig.tick(2000);
  rig.latched = 4;
  rig.tick(30);
  CHECK(rig.read(0).uptime == UINT16_MAX);
}

TEST_CASE("For a second after the start nothing is written, then what came in it is, together") {
  Log rig;
  rig.latched = protocol::WATCHDOG;
  rig.tick(1, State::FAULT);
  rig.latched |= protocol::ESTOP_OPEN;
  CHECK(rig.tick(198) == 0);
  CHECK(rig.tick() == 0);
  CHECK(rig.tick() == 1);
  rig.tick(30);
  CHECK(rig.read(0).faults == (protocol::WATCHDOG | protocol::ESTOP_OPEN));
  CHECK(rig.read(0).uptime == 0);
  CHECK(rig.read(0).state == static_cast<uint8_t>(State::FAULT));
  CHECK(rig.read(1).faults == 0);
}

TEST_CASE("A fault that stays latched is one entry") {
  Log rig;
  rig.latched = 1;
  rig.tick(5000);
  CHECK(rig.read(0).faults == 1);
  CHECK(rig.read(1).faults == 0);
}

TEST_CASE("Two seconds lie between entries; what latches meanwhile is one, of its first moment") {
  Log rig;
  rig.tick(300);
  rig.latched = 1;
  rig.tick();  // staged in this tick
  for (int k = 0; k < 20; ++k) {
    rig.latched = k % 2 == 0 ? 0 : 1 | 2 << (k % 4);
    rig.tick(19, k % 2 == 0 ? State::RUNNING : State::ARMED);
  }
  rig.latched = 0;
  rig.tick(19);
  CHECK(rig.read(0).number == 0);
  CHECK(rig.tick() == 0);
  CHECK(rig.tick() == 1);
  rig.tick(30);
  CHECK(rig.read(0).number == 1);
  CHECK(rig.read(0).faults == (1 | 4 | 16));
  CHECK(rig.read(0).uptime == 1);
  CHECK(rig.read(0).state == static_cast<uint8_t>(State::ARMED));
  CHECK(rig.read(1).faults == 1);
  CHECK(rig.read(2).faults == 0);
}

TEST_CASE("An entry takes a byte a tick, and only bytes that differ") {
  Log rig;
  rig.tick(300);
  rig.latched = 0xFFFFFFFF;
  for (int k = 0; k < 20; ++k) CHECK(rig.tick() <= 1);
  // Four of the fault word and one of the erased number's are as they were.
  CHECK(rig.board.stores <= FaultLog::kSize - 4);
  CHECK(rig.read(0).faults == 0xFFFFFFFF);
}

TEST_CASE("The ring holds the newest sixteen, and goes on behind them after a reset") {
  Log rig;
  for (uint32_t k = 1; k <= 21; ++k) rig.entry(k);
  for (int round = 0; round < 2; ++round) {
    for (uint8_t k = 0; k < FaultLog::kEntries; ++k) {
      CHECK(rig.read(k).index == k);
      CHECK(rig.read(k).number == 20 - k);
      CHECK(rig.read(k).faults == 21u - k);
    }
    rig = rig.again();
  }
  rig.entry(99);
  CHECK(rig.read(0).number == 21);
  CHECK(rig.read(0).faults == 99);
  CHECK(rig.read(15).faults == 7);
}

TEST_CASE("The numbers wrap, in the memory and over a reset") {
  for (const uint16_t newest : {0xFFFE, 0xFFFF, 0, 3, 0x7FFE, 0x8000}) {
    Log rig;
    uint16_t number = static_cast<uint16_t>(newest - 5);
    for (int k = 0; k < 6; ++k, ++number) {
      uint8_t entry[FaultLog::kSize] = {};
      protocol::put<uint16_t>(entry, number);
      protocol::put<uint32_t>(entry + 2, uint32_t{1} << k);
      uint16_t crc = 0xFFFF;
      for (int at = 0; at < 10; ++at) crc = crc16(crc, entry[at]);
      protocol::put<uint16_t>(entry + 10, crc);
      memcpy(rig.board.eeprom + FaultLog::kAddress + number % 16 * FaultLog::kSize, entry,
             sizeof entry);
    }
    rig = rig.again();
    CHECK(rig.read(0).number == newest);
    CHECK(rig.read(0).faults == 32);
    CHECK(rig.read(5).faults == 1);
    rig.entry(77);
    CHECK(rig.read(0).number == static_cast<uint16_t>(newest + 1));
    CHECK(rig.read(0).faults == 77);
    CHECK(rig.read(1).faults == 32);
  }
}

TEST_CASE("A torn or damaged entry is none; those around it stay") {
  Log rig;
  for (uint32_t k = 1; k <= 3; ++k) rig.entry(k);
  for (uint16_t at = 0; at < FaultLog::kSize; ++at) {
    Log other = rig.again();
    other.board.eeprom[FaultLog::kAddress + FaultLog::kSize + at] ^= 0x10;
    other = other.again();
    CHECK(other.read(0).faults == 3);
    CHECK(other.read(1).faults == 0);
    CHECK(other.read(1).number == 1);
    CHECK(other.read(2).faults == 1);
  }
  // Without power while an entry is written the one before is the newest, and its place is used.
  rig.latched = 9;
  rig.tick(5);
  Log after = rig.again();
  CHECK(after.read(0).faults == 3);
  after.entry(8);
  CHECK(after.read(0).number == 3);
  CHECK(after.read(0).faults == 8);
}

TEST_CASE("An entry in another's place is none") {
  Log rig;
  rig.entry(5);
  memcpy(rig.board.eeprom + FaultLog::kAddress + 4 * FaultLog::kSize,
         rig.board.eeprom + FaultLog::kAddress, FaultLog::kSize);
  memset(rig.board.eeprom + FaultLog::kAddress, 0xFF, FaultLog::kSize);
  rig = rig.again();
  for (uint8_t k = 0; k < FaultLog::kEntries; ++k) CHECK(rig.read(k).faults == 0);
  rig.entry(6);
  CHECK(rig.read(0).number == 0);
  CHECK(rig.read(0).faults == 6);
}

TEST_CASE(
    "Clearing makes every entry invalid for good, by one byte each, and says when it is done") {
  Log rig;
  for (uint32_t k = 1; k <= 18; ++k) rig.entry(k);
  const int begun = rig.board.stores;
  rig.log.begin_clear();
  CHECK(rig.log.clearing());
  int ticks = 0;
  while (!rig.log.step(rig.board)) CHECK(++ticks < 50);
  CHECK(!rig.log.clearing());
  CHECK(rig.board.stores - begun == FaultLog::kEntries);
  for (uint8_t k = 0; k < FaultLog::kEntries; ++k) CHECK(rig.read(k).faults == 0);
  Log after = rig.again();
  for (uint8_t k = 0; k < FaultLog::kEntries; ++k) CHECK(after.read(k).faults == 0);
  rig.entry(40);
  CHECK(rig.read(0).number == 18);
  CHECK(rig.read(0).faults == 40);
  rig.log.begin_clear();
  ticks = 0;
  while (!rig.log.step(rig.board)) CHECK(++ticks < 50);
  CHECK(rig.board.stores - begun > FaultLog::kEntries);
  CHECK(rig.read(0).faults == 0);
}

TEST_CASE("An entry whose checksum's bytes are each other's complement is cleared as well") {
  bool found = false;
  for (uint32_t faults = 1; faults < 1000 && !found; ++faults) {
    Log rig;
    rig.entry(faults);
    const uint8_t *crc = rig.board.eeprom + FaultLog::kAddress + FaultLog::kSize - 2;
    if (static_cast<uint8_t>(crc[0] ^ crc[1]) != 0xFF) continue;
    found = true;
    rig.log.begin_clear();
    rig.tick(50);
    CHECK(rig.read(0).faults == 0);
  }
  CHECK(found);
}

TEST_CASE("What latches while the log is cleared, or was being written, comes behind") {
  Log rig;
  rig.entry(1);
  rig.tick(300);
  rig.latched = 2;
  rig.tick(5);
  rig.log.begin_clear();
  rig.tick(3);
  rig.latched = 6;
  rig.tick(500);
  CHECK(rig.read(1).faults == 2);
  CHECK(rig.read(0).faults == 4);
  CHECK(rig.read(2).faults == 0);
}

TEST_CASE("Nothing is written while a byte is being stored, nor outside the log's place") {
  Log rig;
  rig.tick(300);
  uint8_t before[1024];
  memcpy(before, rig.board.eeprom, sizeof before);
  rig.latched = 1;
  rig.board.busy = 40;
  CHECK(rig.tick(40) == 0);
  for (uint32_t k = 1; k <= 20; ++k) rig.entry(k);
  for (uint16_t at = 0; at < FaultLog::kAddress; ++at) CHECK(rig.board.eeprom[at] == before[at]);
  CHECK(kEnd == sizeof before);
}

// ---- over the link ------------------------------------------------------------------------------

namespace {

struct Machine {
  FakeBoard board;
  Controller controller;

  Machine() { controller.boot(board); }
  void tick(int count = 1) {
    for (int i = 0; i < count; ++i) {
      controller.tick(board);
      board.clock_us += kTickUs;
    }
  }
  // The payloads of these answers since the last look.
  std::vector<std::vector<uint8_t>> answers(uint8_t id) {
    std::vector<std::vector<uint8_t>> out;
    for (const Answer &answer : board.answers()) {
      if (answer.id == id) out.push_back(answer.payload);
    }
    return out;
  }
  std::vector<uint8_t> get(uint8_t index) {
    board.type(protocol::LogGet::kId, {index});
    tick();
    const auto found = answers(protocol::LogEntry::kId);
    REQUIRE(found.size() == 1);
    return found[0];
  }
  // The result of the newest Ack since the last look; -1: none.
  int result() {
    const auto found = answers(protocol::Ack::kId);
    return found.empty() ? -1 : found.back().at(2);
  }
};

int as_int(Result result) { return static_cast<int>(result); }

}  // namespace

TEST_CASE(
    "A fault of the machine is in its log, with the state before, and is read over the link") {
  Machine rig;
  rig.board.cause = protocol::BY_RESET_PIN;
  rig.tick(450);
  rig.board.set_estop(5);
  rig.tick(40);
  CHECK(rig.get(0) == std::vector<uint8_t>{0, 0, 0, protocol::ESTOP_OPEN, 0, 0, 0, 2, 0,
                                           protocol::BY_RESET_PIN,
                                           static_cast<uint8_t>(State::SAFE)});
  CHECK(rig.get(15) == std::vector<uint8_t>{15, 0xF1, 0xFF, 0, 0, 0, 0, 0, 0, 0, 0});
  rig.board.type(protocol::LogGet::kId, {16});
  rig.tick();
  CHECK(rig.result() == as_int(Result::UNKNOWN));
}

TEST_CASE("A reset's cause is a fault in the log: in FAULT, at the start") {
  Machine rig;
  rig.board.cause = protocol::BY_WATCHDOG;
  rig.controller = Controller();
  rig.controller.boot(rig.board);
  rig.tick(240);
  const std::vector<uint8_t> entry = rig.get(0);
  CHECK(protocol::get<uint32_t>(entry.data() + 3) == protocol::WATCHDOG);
  CHECK(entry.at(10) == static_cast<uint8_t>(State::FAULT));
  CHECK(entry.at(7) == 0);
}

TEST_CASE("After a reset the machine's log goes on behind what it holds") {
  Machine rig;
  rig.tick(450);
  rig.board.set_estop(5);
  rig.tick(40);
  rig.board.set_estop(0.88);
  rig.controller = Controller();
  rig.controller.boot(rig.board);
  CHECK(protocol::get<uint32_t>(rig.get(0).data() + 3) == protocol::ESTOP_OPEN);
  rig.board.set_estop(5);
  rig.tick(450);
  CHECK(protocol::get<uint16_t>(rig.get(0).data() + 1) == 1);
  CHECK(protocol::get<uint16_t>(rig.get(1).data() + 1) == 0);
}

TEST_CASE("One entry is answered in a tick, the last that was asked for, and not while storing") {
  Machine rig;
  for (uint8_t k = 0; k < 5; ++k) rig.board.type(protocol::LogGet::kId, {k});
  rig.tick();
  auto found = rig.answers(protocol::LogEntry::kId);
  REQUIRE(found.size() == 1);
  CHECK(found[0].at(0) == 4);
  rig.tick();
  CHECK(rig.answers(protocol::LogEntry::kId).empty());
  rig.board.type(protocol::LogGet::kId, {3});
  rig.board.busy = 2;
  rig.tick();
  CHECK(rig.answers(protocol::LogEntry::kId).empty());
  rig.tick(2);
  found = rig.answers(protocol::LogEntry::kId);
  REQUIRE(found.size() == 1);
  CHECK(found[0].at(0) == 3);
}

TEST_CASE("Clearing is answered when done, and refused while armed, saving or clearing") {
  Machine rig;
  rig.tick(300);
  rig.board.set_estop(5);
  rig.tick(20);
  rig.board.answers();
  rig.board.next_seq = 9;
  rig.board.type(protocol::LogClear::kId);
  rig.tick();
  CHECK(rig.result() == -1);
  for (const uint8_t id :
       {protocol::LogClear::kId, protocol::ParamSave::kId, protocol::ParamDefaults::kId}) {
    rig.board.type(id);
    rig.tick();
    CHECK(rig.result() == as_int(Result::WRONG_STATE));
  }
  int ticks = 0;
  std::vector<std::vector<uint8_t>> acks;
  while (acks.empty() && ++ticks < 100) {
    rig.tick();
    acks = rig.answers(protocol::Ack::kId);
  }
  REQUIRE(acks.size() == 1);
  CHECK(acks[0] == std::vector<uint8_t>{protocol::LogClear::kId, 9, 0});
  CHECK(protocol::get<uint32_t>(rig.get(0).data() + 3) == 0);
  rig.board.type(protocol::ParamSave::kId);
  rig.board.type(protocol::LogClear::kId);
  rig.tick();
  CHECK(rig.result() == as_int(Result::WRONG_STATE));
}

TEST_CASE("While parameters are saved the log waits, and both are kept") {
  Machine rig;
  rig.tick(300);
  rig.board.set_estop(5);
  rig.tick(3);
  rig.board.type(protocol::ParamSave::kId);
  rig.tick(600);
  CHECK(rig.result() == as_int(Result::OK));
  CHECK(protocol::get<uint32_t>(rig.get(0).data() + 3) == protocol::ESTOP_OPEN);
  Params params;
  CHECK(params.load(rig.board) == Params::Loaded::kWhole);
}

TEST_CASE("Clearing is refused while armed") {
  Machine rig;
  for (const auto &set : {std::pair<uint8_t, uint8_t>{0, 2}, {1, 3}}) {
    rig.board.type(protocol::ParamSet::kId, {set.first, set.second, 0});
  }
  rig.board.type(protocol::ParamSet::kId,
                 {static_cast<uint8_t>(protocol::Param::drive_current_cont), 0xC4, 0x09});
  rig.tick(4);
  rig.board.type(protocol::Arm::kId, {protocol::kVersion});
  rig.tick();
  REQUIRE(rig.controller.supervisor().state() == State::ARMED);
  rig.board.answers();
  rig.board.type(protocol::LogClear::kId);
  rig.tick();
  CHECK(rig.result() == as_int(Result::WRONG_STATE));
}
