// The desk build: the firmware's own controller behind the Target ABI, on a board made of memory.
//
// It keeps the Uno's timing where the bench can see it: when a tick is due, when the converter
// samples, how long a byte takes on the line. What a tick computes appears at its pins at once.
#include "../target.h"

#include <string.h>

#include <deque>
#include <new>

#include "../controller.h"

namespace {

using daranti::Analog;
using daranti::Board;
using daranti::Controller;
using daranti::kAnalogs;
using daranti::kTickUs;

constexpr size_t kPins = 20;
constexpr size_t kEepromSize = 1024;
constexpr size_t kQueue = 1 << 16;    // bytes each way before they are refused
constexpr size_t kUartRing = 128;     // the Uno's send buffer
constexpr uint64_t kByteNs = 85'000;  // ten bits, as the Uno divides 16 MHz for 115200 baud

// What happens in a tick's period, in microseconds from its start, as uno/board.cpp has it: four
// runs of conversions, each seen here at its middle, then the tick.
constexpr uint64_t kEventUs[] = {500, 1500, 2500, 3500, 4000};
constexpr uint8_t kEvents = 5;
constexpr uint8_t kTickEvent = 4;
// How many of the 16ths of a channel's mean each run gives.
constexpr uint8_t kShare[kTickEvent][daranti::kAnalogs] = {
    {0, 16, 16, 0}, {0, 0, 0, 16}, {8, 0, 0, 0}, {8, 0, 0, 0}};

constexpr uint64_t kWatchdogUs = 32'000;   // 4096 cycles of the 128 kHz watchdog oscillator
constexpr uint64_t kEepromWriteUs = 3400;  // datasheet 8.4.3

struct TimedByte {
  uint64_t due_ns;  // when its stop bit is through
  uint8_t byte;
};

// What one conversion gives for a voltage at the pin.
uint16_t convert(uint16_t millivolt) {
  const uint32_t clipped = millivolt < 5000 ? millivolt : 5000;
  return static_cast<uint16_t>(clipped * 1023 / 5000);
}

}  // namespace

struct daranti_target final : Board {
  explicit daranti_target(const uint8_t *image) {
    if (image != nullptr) {
      memcpy(eeprom, image, kEepromSize);
    } else {
      memset(eeprom, 0xFF, kEepromSize);
    }
    level[daranti::pins::kEstop] = level[daranti::pins::kHall] = true;  // pull-ups
    boot(DARANTI_RESET_POWER_ON);
  }
  virtual ~daranti_target() = default;

  void boot(uint8_t reset) {
    cause = reset;
    period_us = boot_us = now_us;
    event = 0;
    hung = false;
    pulses = 0;
    storing_until_us = 0;
    received.clear();
    sent.clear();
    line_free_ns = 0;
    memset(sum, 0, sizeof sum);
    memset(mean, 0, sizeof mean);
    memset(pwm, 0, sizeof pwm);
    memset(output, 0, sizeof output);
    new (&controller) Controller();
    controller.boot(*this);
  }

  void run_until(uint64_t time_us) {
    while (hung || period_us + kEventUs[event] < time_us) {
      if (hung) {
        if (kicked_us + kWatchdogUs >= time_us) break;
        now_us = kicked_us + kWatchdogUs;
        boot(DARANTI_RESET_WATCHDOG);
        continue;
      }
      now_us = period_us + kEventUs[event];
      if (event == kTickEvent) {
        memcpy(mean, sum, sizeof mean);
        memset(sum, 0, sizeof sum);
        controller.tick(*this);
        period_us += kTickUs;
      } else {
        for (uint8_t i = 0; i < kAnalogs; ++i) {
          sum[i] = static_cast<uint16_t>(sum[i] + convert(millivolt[i]) * kShare[event][i]);
        }
      }
      event = static_cast<uint8_t>((event + 1) % kEvents);
    }
    now_us = time_us;
  }

  // Board
  uint32_t time_us() const override { return static_cast<uint32_t>(now_us - boot_us); }
  uint16_t analog(Analog channel) const override { return mean[static_cast<uint8_t>(channel)]; }
  bool pin(uint8_t pin) const override { return level[pin]; }
  uint16_t hall_pulses() const override { return pulses; }
  void set_pin(uint8_t pin, bool value) override { output[pin] = value; }
  void set_pwm(uint8_t pin, uint8_t duty) override { pwm[pin] = duty; }
  void set_pwm_frequency(uint16_t, uint16_t) override {}
  bool receive(uint8_t *byte) override {
    if (received.empty() || received.front().due_ns > now_us * 1000) return false;
    *byte = received.front().byte;
    received.pop_front();
    return true;
  }
  bool send(const uint8_t *bytes, uint8_t count) override {
    const uint64_t now_ns = now_us * 1000;
    if (line_free_ns < now_ns) line_free_ns = now_ns;
    if ((line_free_ns - now_ns) / kByteNs + count > kUartRing) return false;
    for (uint8_t i = 0; i < count; ++i) {
      line_free_ns += kByteNs;
      if (sent.size() < kQueue) sent.push_back({line_free_ns, bytes[i]});
    }
    return true;
  }
  uint8_t load(uint16_t address) const override { return eeprom[address]; }
  void store(uint16_t address, uint8_t byte) override {
    eeprom[address] = byte;
    storing_until_us = now_us + kEepromWriteUs;
  }
  bool storing() const override { return now_us < storing_until_us; }
  void kick_watchdog() override { kicked_us = now_us; }
  uint8_t reset_cause() const override { return cause; }
  uint8_t build() const override { return 1; }

  Controller controller;
  uint64_t now_us = 0;
  uint64_t boot_us = 0;
  uint64_t period_us = 0;  // when the current tick's period began
  uint64_t kicked_us = 0;
  uint64_t storing_until_us = 0;
  uint64_t host_free_ns = 0;  // when the host's line to us is free again
  uint64_t line_free_ns = 0;  // when our line to the host is free again
  std::deque<TimedByte> received;
  std::deque<TimedByte> sent;
  uint16_t millivolt[kAnalogs] = {};
  uint16_t sum[kAnalogs] = {};   // of the burst under way, 1/16 counts
  uint16_t mean[kAnalogs] = {};  // of the last whole burst
  uint16_t pulses = 0;
  uint8_t eeprom[kEepromSize];
  uint8_t pwm[kPins] = {};
  bool output[kPins] = {};
  bool level[kPins] = {};
  uint8_t cause = 0;
  uint8_t event = 0;  // the next one of kEventUs
  bool hung = false;
};

extern "C" {

uint32_t target_abi(void) { return DARANTI_TARGET_ABI; }

daranti_target *target_create(const char *, const uint8_t *eeprom) {
  return new (std::nothrow) daranti_target(eeprom);
}

void target_destroy(daranti_target *target) { delete target; }

const char *target_error(void) { return "out of memory"; }

int32_t target_run_until(daranti_target *target, uint64_t time_us) {
  target->run_until(time_us);
  return 0;
}

uint64_t target_time_us(const daranti_target *target) { return target->now_us; }

void target_set_analog_mv(daranti_target *target, uint8_t channel, uint16_t millivolt) {
  if (channel < kAnalogs) target->millivolt[channel] = millivolt;
}

void target_set_pin(daranti_target *target, uint8_t pin, uint8_t level) {
  if (pin >= kPins) return;
  const bool high = level != 0;
  if (pin == daranti::pins::kHall && target->level[pin] && !high) ++target->pulses;
  target->level[pin] = high;
}

uint8_t target_pin(const daranti_target *target, uint8_t pin) {
  return pin < kPins && (target->output[pin] || target->pwm[pin] == 255);
}

uint8_t target_pwm(const daranti_target *target, uint8_t pin) {
  if (pin >= kPins) return 0;
  return target->output[pin] ? uint8_t{255} : target->pwm[pin];
}

size_t target_write(daranti_target *target, const uint8_t *bytes, size_t count) {
  const uint64_t now_ns = target->now_us * 1000;
  if (target->host_free_ns < now_ns) target->host_free_ns = now_ns;
  size_t taken = 0;
  while (taken < count && target->received.size() < kQueue) {
    target->host_free_ns += kByteNs;
    target->received.push_back({target->host_free_ns, bytes[taken++]});
  }
  return taken;
}

size_t target_read(daranti_target *target, uint8_t *bytes, size_t capacity) {
  size_t copied = 0;
  auto &sent = target->sent;
  while (copied < capacity && !sent.empty() && sent.front().due_ns <= target->now_us * 1000) {
    bytes[copied++] = sent.front().byte;
    sent.pop_front();
  }
  return copied;
}

void target_reset(daranti_target *target, uint8_t cause) { target->boot(cause); }

void target_eeprom(const daranti_target *target, uint8_t *bytes1024) {
  memcpy(bytes1024, target->eeprom, kEepromSize);
}

int32_t target_hang(daranti_target *target) {
  target->hung = true;
  return 0;
}

}  // extern "C"
