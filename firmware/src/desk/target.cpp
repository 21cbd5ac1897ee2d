// The desk build: the firmware's own controller behind the Target ABI, on a board made of memory.
//
// It keeps the Uno's timing where the bench can see it: when a tick is due, when the converter
// samples, how long a byte takes on the line. What a tick computes appears at its pins at once.
#include "../target.h"

#include <string.h>

#include <deque>
#include <new>

#include "../boards/uno/pins.h"
#include "controller.h"
#include "pulse_filter.h"

namespace {

using daranti::Analog;
using daranti::Board;
using daranti::BridgeWires;
using daranti::Controller;
using daranti::kAnalogs;
using daranti::kTickUs;
using daranti::Motor;
using daranti::PulseFilter;
using daranti::Pulses;
using daranti::Troubles;
namespace pins = daranti::pins;

constexpr size_t kPins = 20;
constexpr size_t kEepromSize = 1024;
constexpr size_t kQueue = 1 << 16;    // bytes each way before they are refused
constexpr size_t kUartRing = 128;     // the Uno's send buffer
constexpr uint64_t kByteNs = 85'000;  // ten bits, as the Uno divides 16 MHz for 115200 baud

// What happens in a tick's period, in microseconds from its start, as boards/atmega has it: the
// levels sampled every 200 us, four runs of conversions, each seen here at its middle, the tick.
constexpr uint64_t kSampleUs = 200;
constexpr uint64_t kEventUs[] = {500, 1500, 2500, 3500, 4000, kTickUs};
constexpr uint8_t kEvents = 6;
constexpr uint8_t kTickEvent = 4;
constexpr uint8_t kPeriodEvent = 5;
// How many of the 16ths of a channel's mean each run gives.
constexpr uint8_t kShare[kTickEvent][kAnalogs] = {
    {0, 16, 16, 0, 0}, {0, 0, 0, 16, 16}, {8, 0, 0, 0, 0}, {8, 0, 0, 0, 0}};

constexpr uint64_t kWatchdogUs = 16'000;   // 2048 cycles of the 128 kHz watchdog oscillator
constexpr uint16_t kHighMv = 3000;         // datasheet 29.2: 0.6 of the supply
constexpr uint16_t kLowMv = 1500;          // 0.3 of it
constexpr uint64_t kEepromWriteUs = 3400;  // datasheet 8.4.3

constexpr uint8_t kWhileArmed = daranti::protocol::WHILE_ARMED;
constexpr uint8_t kOutputs[] = {pins::kSteerPwm, pins::kSteerLpwm, pins::kSteerIn1, pins::kSteerIn2,
                                pins::kDrivePwm, pins::kDriveLpwm, pins::kDriveIn1, pins::kDriveIn2,
                                pins::kBlade,    pins::kLamp};

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
    for (bool &each : level) each = true;  // pull-ups
    level[pins::kEstop] = false;
    boot(DARANTI_RESET_POWER_ON);
  }
  virtual ~daranti_target() = default;

  void boot(uint8_t reset) {
    cause = reset;
    period_us = boot_us = now_us;
    event = 0;
    hung = false;
    sample_us = now_us + kSampleUs;
    filter = PulseFilter();
    storing_until_us = 0;
    received.clear();
    sent.clear();
    line_free_ns = 0;
    memset(sum, 0, sizeof sum);
    memset(mean, 0, sizeof mean);
    memset(pwm, 0, sizeof pwm);
    new (&controller) Controller();
    controller.boot(*this);
  }

  void run_until(uint64_t time_us) {
    while (true) {
      if (hung) {
        // The watchdog's first stage, or its second where interrupts are off.
        const uint64_t bites = kicked_us + (interrupts_off ? 2 : 1) * kWatchdogUs;
        if (bites >= time_us) break;
        now_us = bites;
        boot(armed ? DARANTI_RESET_WATCHDOG | kWhileArmed : DARANTI_RESET_WATCHDOG);
        continue;
      }
      const uint64_t event_us = period_us + kEventUs[event];
      const uint64_t next_us = sample_us <= event_us ? sample_us : event_us;
      if (next_us >= time_us) break;
      now_us = next_us;
      if (sample_us <= event_us) {
        sample();
      } else {
        happen();
      }
    }
    now_us = time_us;
  }

  void sample() {
    sample_us += kSampleUs;
    filter.sample(static_cast<uint8_t>((level[pins::kHall] ? PulseFilter::kA : 0) |
                                       (level[pins::kHallB] ? PulseFilter::kB : 0) |
                                       (level[pins::kBladeTurn] ? PulseFilter::kTurn : 0)));
  }

  void happen() {
    if (event == kTickEvent) {
      memcpy(mean, sum, sizeof mean);
      memset(sum, 0, sizeof sum);
      controller.tick(*this);
    } else if (event == kPeriodEvent) {
      period_us += kTickUs;
    } else {
      for (uint8_t i = 0; i < kAnalogs; ++i) {
        sum[i] = static_cast<uint16_t>(sum[i] + convert(millivolt[i]) * kShare[event][i]);
      }
    }
    event = static_cast<uint8_t>((event + 1) % kEvents);
  }

  // Board
  uint32_t time_us() const override { return static_cast<uint32_t>(now_us - boot_us); }
  uint16_t analog(Analog channel) const override { return mean[static_cast<uint8_t>(channel)]; }
  bool estop_open() const override { return level[pins::kEstop]; }
  Pulses pulses() const override { return filter.pulses(); }
  Troubles troubles() const override { return {0, 0}; }
  void set_bridge(Motor motor, const BridgeWires &wires) override {
    const bool steer = motor == Motor::kSteer;
    pwm[steer ? pins::kSteerPwm : pins::kDrivePwm] = wires.pwm;
    pwm[steer ? pins::kSteerLpwm : pins::kDriveLpwm] = wires.lpwm;
    pwm[steer ? pins::kSteerIn1 : pins::kDriveIn1] = wires.in1 ? 255 : 0;
    pwm[steer ? pins::kSteerIn2 : pins::kDriveIn2] = wires.in2 ? 255 : 0;
  }
  void set_pwm_frequency(uint16_t, uint16_t) override {}
  void set_blade(bool on) override { pwm[pins::kBlade] = on ? 255 : 0; }
  void set_lamp(bool on) override { pwm[pins::kLamp] = on ? 255 : 0; }
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
  void remember_armed(bool on) override { armed = on; }
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
  uint64_t sample_us = 0;        // when the levels are sampled next
  PulseFilter filter;
  uint8_t eeprom[kEepromSize];
  uint8_t pwm[kPins] = {};
  bool level[kPins] = {};
  uint8_t cause = 0;
  uint8_t event = 0;  // the next one of kEventUs
  bool hung = false;
  bool interrupts_off = false;  // as it hangs
  bool armed = false;           // at its last tick
};

extern "C" {

uint32_t target_abi(void) { return DARANTI_TARGET_ABI; }

daranti_target *target_create(const char *, const char *, const uint8_t *eeprom) {
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
  if (channel >= kAnalogs) return;
  target->millivolt[channel] = millivolt;
  if (channel == pins::kEstopChannel && millivolt >= kHighMv) target->level[pins::kEstop] = true;
  if (channel == pins::kEstopChannel && millivolt <= kLowMv) target->level[pins::kEstop] = false;
}

void target_set_pin(daranti_target *target, uint8_t pin, uint8_t level) {
  if (pin < kPins) target->level[pin] = level != DARANTI_LOW;
}

int16_t target_output(const daranti_target *target, uint8_t pin) {
  for (const uint8_t output : kOutputs) {
    if (output == pin) return target->pwm[pin];
  }
  for (const uint8_t input : {pins::kHall, pins::kHallB, pins::kBladeTurn}) {
    if (input == pin) return DARANTI_PULLED_UP;
  }
  return DARANTI_FLOATING;
}

void target_set_baud(daranti_target *, uint32_t) {}

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

void target_reset(daranti_target *target, uint8_t cause) {
  const bool kept = target->armed && cause != DARANTI_RESET_POWER_ON;
  target->boot(kept ? static_cast<uint8_t>(cause | kWhileArmed) : cause);
}

void target_eeprom(const daranti_target *target, uint8_t *bytes1024) {
  memcpy(bytes1024, target->eeprom, kEepromSize);
}

int32_t target_hang(daranti_target *target, uint8_t where) {
  target->hung = true;
  target->interrupts_off = where == DARANTI_HANG_INTERRUPT;
  return 0;
}

}  // extern "C"
