// The Target ABI over libsimavr: runs the Uno's ELF, instruction by instruction and without a wall
// clock.
//
// Copyright (C) 2026 the Daranti authors.
// This program is free software: you can redistribute it and/or modify it under the terms of the
// GNU General Public License as published by the Free Software Foundation, either version 3 of the
// License, or (at your option) any later version. See COPYING.md beside this file.
//
// Where this departs from libsimavr 1.6's own modules, and why:
// - Received bytes: the UART's input queue restarts its delay at every read and so runs slow; here
//   each byte arrives at its exact cycle, into a two-byte hardware FIFO that overruns.
// - Timers 1 and 2 do not run: PWM duties are read from their compare registers, which costs
//   nothing and is never older than the firmware's last write.
// - Time zero is where the firmware starts timer 0, its 1 ms clock: "booted but not run".
#include <stdlib.h>
#include <string.h>

#include <deque>
#include <new>
#include <string>

extern "C" {
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
}

#include "../../../firmware/src/target.h"

namespace {

constexpr uint64_t kCyclesPerUs = 16;
constexpr uint64_t kByteCycles = 10 * 8 * 17;  // ten bits; UBRR 16 at double speed
constexpr size_t kQueue = 1 << 16;
constexpr size_t kEepromSize = 1024;
constexpr uint8_t kPins = 14;
constexpr uint8_t kRxVector = 18;
constexpr uint64_t kBootLimit = 16'000'000;  // cycles until the firmware must run its clock
// A step runs instructions up to the next timer, but no further than this: one by one, as libsimavr
// does unasked, its looking for timers costs nearly as much as the instructions.
constexpr uint64_t kRunCycles = 16'000;

// Data addresses of the ATmega328P (datasheet 30).
enum Register : uint16_t {
  kPinB = 0x23,
  kDdrB = 0x24,
  kPortB = 0x25,
  kDdrD = 0x2A,
  kPortD = 0x2B,
  kTccr0b = 0x45,
  kGpior0 = 0x3E,
  kMcusr = 0x54,
  kTccr1a = 0x80,
  kTccr1b = 0x81,
  kIcr1 = 0x86,
  kOcr1a = 0x88,
  kOcr1b = 0x8A,
  kTccr2a = 0xB0,
  kTccr2b = 0xB1,
  kOcr2a = 0xB3,
  kOcr2b = 0xB4,
  kUcsr0a = 0xC0,
  kUdr0 = 0xC6,
};
constexpr uint16_t kPwmRegisters[] = {kTccr1a, kTccr1b,    kIcr1,   kIcr1 + 1, kOcr1a, kOcr1a + 1,
                                      kOcr1b,  kOcr1b + 1, kTccr2a, kTccr2b,   kOcr2a, kOcr2b};
constexpr uint8_t kRxc0 = 1 << 7;
constexpr uint8_t kDor0 = 1 << 3;
constexpr uint16_t kHangAt = 0x7FFC;  // in erased flash
constexpr uint8_t kRjmpSelf[] = {0xFF, 0xCF};

thread_local std::string last_error;

void silence(avr_t *, const int, const char *, va_list) {}
void sleep_without_waiting(avr_t *, avr_cycle_count_t) {}
void store_only(avr_t *avr, avr_io_addr_t address, uint8_t value, void *) {
  avr->data[address] = value;
}

struct TimedByte {
  uint64_t due;  // cycle of the target's clock
  uint8_t byte;
};

}  // namespace

struct daranti_target {
  avr_t *avr = nullptr;
  uint64_t origin = 0;  // target time of avr->cycle 0, in cycles; wraps below zero during boot
  uint64_t seen = 0;    // target time after the last instruction
  bool was_reset = false;
  void (*core_reset)(avr_t *) = nullptr;
  bool fenced = false;
  uint32_t resets = 0;  // since the fence was set
  std::deque<TimedByte> to_firmware;
  std::deque<TimedByte> to_host;
  uint64_t host_free = 0;  // when the host's line is free again
  uint64_t line_free = 0;  // when the firmware's line is free again
  uint8_t fifo[2] = {};
  uint8_t fifo_count = 0;
  uint16_t millivolt[8] = {};
  bool level[kPins] = {};
  bool driven[kPins] = {};  // from outside

  // For tools/avr_budget.py.
  bool probing = false;
  uint64_t tick_from = 0, tick_worst = 0, masked_from = 0, masked_worst = 0;
  bool in_tick = false, masked = false;

  uint64_t now() const { return avr->cycle + origin; }
  uint8_t &reg(uint16_t address) const { return avr->data[address]; }
  uint16_t reg16(uint16_t address) const {
    return static_cast<uint16_t>(reg(address) | reg(address + 1) << 8);
  }

  void raise(uint32_t ioctl, int index, uint32_t value) const {
    avr_raise_irq(avr_io_getirq(avr, ioctl, index), value);
  }
  void apply_pin(uint8_t pin) const {
    const char port = pin < 8 ? 'D' : 'B';
    const uint8_t bit = pin < 8 ? pin : static_cast<uint8_t>(pin - 8);
    // Without an external pull, libsimavr would put the pull-up's level back at the next write to
    // the port.
    avr_ioport_external_t pull = {};
    pull.name = static_cast<unsigned char>(port);
    for (uint8_t i = 0; i < 8; ++i) {
      const uint8_t other = static_cast<uint8_t>(pin < 8 ? i : i + 8);
      if (other >= kPins || !driven[other]) continue;
      pull.mask = pull.mask | 1UL << i;
      if (level[other]) pull.value = pull.value | 1UL << i;
    }
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(port), &pull);
    raise(AVR_IOCTL_IOPORT_GETIRQ(port), bit, level[pin]);
  }

  void arm_receiver() {
    if (to_firmware.empty()) return;
    const uint64_t due = to_firmware.front().due;
    avr_cycle_timer_register(avr, due > now() ? due - now() : 1, on_byte, this);
  }
  void receive_due();
  static avr_cycle_count_t on_byte(avr_t *, avr_cycle_count_t, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    self->receive_due();
    self->arm_receiver();
    return 0;
  }
  static avr_cycle_count_t on_fence(avr_t *, avr_cycle_count_t, void *param) {
    static_cast<daranti_target *>(param)->fenced = true;
    return 0;
  }
  static uint8_t on_udr_read(avr_t *avr, avr_io_addr_t, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    const uint8_t byte = self->fifo[0];
    if (self->fifo_count != 0) {
      --self->fifo_count;
      self->fifo[0] = self->fifo[1];
    }
    avr->data[kUcsr0a] &= static_cast<uint8_t>(~(kRxc0 | kDor0));
    if (self->fifo_count != 0) self->raise_rx();
    return byte;
  }
  void raise_rx() const {
    for (uint8_t i = 0; i < avr->interrupts.vector_count; ++i) {
      avr_int_vector_t *vector = avr->interrupts.vector[i];
      if (vector->vector == kRxVector) avr_raise_interrupt(avr, vector);
    }
  }
  static void on_sent(avr_irq_t *, uint32_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    const uint64_t start = self->line_free > self->now() ? self->line_free : self->now();
    self->line_free = start + kByteCycles;
    if (self->to_host.size() < kQueue) {
      self->to_host.push_back({self->line_free, static_cast<uint8_t>(value)});
    }
  }

  static void on_reset(avr_t *avr) {
    auto *self = static_cast<daranti_target *>(avr->custom.data);
    self->was_reset = true;
    if (self->core_reset != nullptr) self->core_reset(avr);
  }

  // After any reset: libsimavr has dropped its timers and the input registers' contents.
  void restore_inputs(uint64_t at) {
    origin = at - avr->cycle;
    was_reset = false;
    ++resets;
    fifo_count = 0;
    for (const uint16_t address : kPwmRegisters) {
      avr->io[AVR_DATA_TO_IO(address)].w.c = store_only;
    }
    avr->io[AVR_DATA_TO_IO(kUdr0)].r.c = on_udr_read;
    avr->io[AVR_DATA_TO_IO(kUdr0)].r.param = this;
    // Else an edge on D8 would capture timer 1 into ICR1, which the hardware leaves alone where
    // ICR1 is the top (15.6.3).
    avr_unconnect_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 0),
                      avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_IN_ICP));
    // Else a low level on D2 or D3 costs a poll every cycle, although INT0 and INT1 are off.
    for (const uint8_t interrupt : {0, 1}) avr_extint_set_strict_lvl_trig(avr, interrupt, 0);
    for (uint8_t pin = 0; pin < kPins; ++pin) {
      if (!driven[pin]) continue;
      // An unchanged value would be filtered out, and the input register stay cleared.
      level[pin] = !level[pin];
      apply_pin(pin);
      level[pin] = !level[pin];
      apply_pin(pin);
    }
    for (uint8_t channel = 0; channel < 8; ++channel) {
      raise(AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel, millivolt[channel]);
    }
    arm_receiver();
  }

  bool step() {
    const int state = avr_run(avr);
    if (was_reset) restore_inputs(seen);
    seen = now();
    if (probing) probe();
    return state != cpu_Done && state != cpu_Crashed;
  }

  void probe() {
    const bool marked = reg(kGpior0) != 0;
    if (marked && !in_tick) tick_from = avr->cycle;
    if (!marked && in_tick && avr->cycle - tick_from > tick_worst) {
      tick_worst = avr->cycle - tick_from;
    }
    in_tick = marked;
    const bool off = avr->sreg[S_I] == 0;
    if (off && !masked) masked_from = avr->cycle;
    if (!off && masked && avr->cycle - masked_from > masked_worst) {
      masked_worst = avr->cycle - masked_from;
    }
    masked = off;
  }

  // From the reset vector to where the firmware starts its clock, outside the target's time.
  bool boot(uint8_t cause, uint64_t time) {
    avr_reset(avr);
    reg(kMcusr) = cause;
    to_firmware.clear();
    to_host.clear();
    host_free = line_free = time;
    restore_inputs(time);
    avr->run_cycle_limit = 1;
    while (reg(kTccr0b) == 0) {
      if (!step() || avr->cycle > kBootLimit) return false;
    }
    origin = time - avr->cycle;
    if (!probing) avr->run_cycle_limit = kRunCycles;
    return true;
  }

  int32_t run_until(uint64_t until) {
    if (until <= now()) return 0;
    while (now() < until) {
      fenced = false;
      resets = 0;
      avr_cycle_timer_register(avr, until - now(), on_fence, this);
      // A reset on the way drops the fence: set it anew.
      while (!fenced && resets == 0) {
        if (!step()) return -1;
      }
    }
    return 0;
  }

  uint8_t port_level(uint8_t pin) const {
    const uint8_t mask = static_cast<uint8_t>(1 << (pin < 8 ? pin : pin - 8));
    const bool output = reg(pin < 8 ? kDdrD : kDdrB) & mask;
    return output && (reg(pin < 8 ? kPortD : kPortB) & mask);
  }

  // Duty of a compare output that is connected (COMnx1), else the port's level.
  uint8_t duty(uint8_t pin) const {
    uint32_t compare = 0, top = 255;
    bool connected = false;
    switch (pin) {
      case 9:
      case 10:
        connected = reg(kTccr1a) & (pin == 9 ? 0x80 : 0x20);
        compare = reg16(pin == 9 ? kOcr1a : kOcr1b);
        top = reg16(kIcr1);
        break;
      case 3:
      case 11:
        connected = reg(kTccr2a) & (pin == 11 ? 0x80 : 0x20);
        compare = reg(pin == 11 ? kOcr2a : kOcr2b);
        break;
      default:
        break;
    }
    if (!connected) return port_level(pin) ? 255 : 0;
    return static_cast<uint8_t>(compare >= top ? 255 : (compare * 255 + top / 2) / top);
  }
};

void daranti_target::receive_due() {
  while (!to_firmware.empty() && to_firmware.front().due <= now()) {
    if (fifo_count < 2) {
      fifo[fifo_count++] = to_firmware.front().byte;
    } else {
      reg(kUcsr0a) |= kDor0;
    }
    to_firmware.pop_front();
    raise_rx();
  }
}

extern "C" {

uint32_t target_abi(void) { return DARANTI_TARGET_ABI; }

const char *target_error(void) { return last_error.c_str(); }

daranti_target *target_create(const char *image, const uint8_t *eeprom) {
  avr_global_logger_set(silence);
  elf_firmware_t firmware;
  memset(&firmware, 0, sizeof firmware);
  if (image == nullptr || elf_read_firmware(image, &firmware) != 0 || firmware.flash == nullptr) {
    last_error = std::string(image ? image : "(no image)") + ": not a readable AVR ELF file";
    return nullptr;
  }
  auto *self = new (std::nothrow) daranti_target();
  avr_t *avr = avr_make_mcu_by_name("atmega328p");
  if (self == nullptr || avr == nullptr) {
    last_error = "libsimavr does not know the atmega328p, or memory ran out";
    free(firmware.flash);
    delete self;
    return nullptr;
  }
  avr_init(avr);
  avr->frequency = 16'000'000;
  avr_load_firmware(avr, &firmware);
  free(firmware.flash);
  avr->sleep = sleep_without_waiting;
  avr->custom.data = self;
  self->core_reset = avr->reset;
  avr->reset = daranti_target::on_reset;
  avr->vcc = avr->avcc = avr->aref = 5000;
  memcpy(avr->flash + kHangAt, kRjmpSelf, sizeof kRjmpSelf);
  self->avr = avr;

  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~static_cast<uint32_t>(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
                          daranti_target::on_sent, self);

  uint8_t image_bytes[kEepromSize];
  memset(image_bytes, 0xFF, sizeof image_bytes);
  if (eeprom != nullptr) memcpy(image_bytes, eeprom, sizeof image_bytes);
  avr_eeprom_desc_t desc = {image_bytes, 0, kEepromSize};
  avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &desc);

  for (const uint8_t pin : {2, 12}) self->level[pin] = self->driven[pin] = true;  // pull-ups
  if (!self->boot(DARANTI_RESET_POWER_ON, 0)) {
    last_error = std::string(image) + ": crashed or never started its clock while booting";
    target_destroy(self);
    return nullptr;
  }
  return self;
}

void target_destroy(daranti_target *target) {
  if (target == nullptr) return;
  avr_terminate(target->avr);
  free(target->avr);
  delete target;
}

int32_t target_run_until(daranti_target *target, uint64_t time_us) {
  return target->run_until(time_us * kCyclesPerUs);
}

uint64_t target_time_us(const daranti_target *target) { return target->now() / kCyclesPerUs; }

void target_set_analog_mv(daranti_target *target, uint8_t channel, uint16_t millivolt) {
  // Told every millisecond, changed seldom: libsimavr looks its modules up by name each time.
  if (channel >= 8 || target->millivolt[channel] == millivolt) return;
  target->millivolt[channel] = millivolt;
  target->raise(AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel, millivolt);
}

void target_set_pin(daranti_target *target, uint8_t pin, uint8_t level) {
  if (pin >= kPins || (target->driven[pin] && target->level[pin] == (level != 0))) return;
  target->level[pin] = level != 0;
  target->driven[pin] = true;
  target->apply_pin(pin);
}

uint8_t target_pin(const daranti_target *target, uint8_t pin) {
  return pin < kPins && target->duty(pin) == 255;
}

uint8_t target_pwm(const daranti_target *target, uint8_t pin) {
  return pin < kPins ? target->duty(pin) : uint8_t{0};
}

size_t target_write(daranti_target *target, const uint8_t *bytes, size_t count) {
  if (target->host_free < target->now()) target->host_free = target->now();
  const bool idle = target->to_firmware.empty();
  size_t taken = 0;
  while (taken < count && target->to_firmware.size() < kQueue) {
    target->host_free += kByteCycles;
    target->to_firmware.push_back({target->host_free, bytes[taken++]});
  }
  if (idle) target->arm_receiver();
  return taken;
}

size_t target_read(daranti_target *target, uint8_t *bytes, size_t capacity) {
  size_t copied = 0;
  auto &queue = target->to_host;
  while (copied < capacity && !queue.empty() && queue.front().due <= target->now()) {
    bytes[copied++] = queue.front().byte;
    queue.pop_front();
  }
  return copied;
}

void target_reset(daranti_target *target, uint8_t cause) { target->boot(cause, target->now()); }

void target_eeprom(const daranti_target *target, uint8_t *bytes1024) {
  avr_eeprom_desc_t desc = {bytes1024, 0, kEepromSize};
  avr_ioctl(target->avr, AVR_IOCTL_EEPROM_GET, &desc);
}

int32_t target_hang(daranti_target *target) {
  target->avr->pc = kHangAt;
  target->avr->state = cpu_Running;
  return 0;
}

// ---- beyond the ABI: measurements for tools/avr_budget.py ---------------------------------------

// Begins, or begins anew: what was found so far is forgotten.
void probe_start(daranti_target *target) {
  target->probing = true;
  target->avr->run_cycle_limit = target->avr->run_cycle_count = 1;
  target->tick_worst = target->masked_worst = 0;
}

// Since then, cycles of the longest tick, and of the longest time with interrupts off.
void probe_read(const daranti_target *target, uint64_t *tick, uint64_t *masked) {
  *tick = target->tick_worst;
  *masked = target->masked_worst;
}

// The 2048 bytes of SRAM, as they are now, and a way to paint them.
uint8_t *probe_sram(daranti_target *target) { return target->avr->data + 0x100; }

}  // extern "C"
