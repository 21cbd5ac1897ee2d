// The Target ABI over libsimavr: runs a board's ELF, instruction by instruction and without a wall
// clock. What it knows of a chip comes from its datasheet and from its registers, nothing from the
// firmware's sources.
//
// Copyright (C) 2026 the Daranti authors.
// This program is free software: you can redistribute it and/or modify it under the terms of the
// GNU General Public License as published by the Free Software Foundation, either version 3 of the
// License, or (at your option) any later version. See COPYING.md beside this file.
//
// Where this departs from libsimavr 1.6's own modules, and why:
// - Received bytes: the UART's input queue restarts its delay at every read and so runs slow; here
//   each byte arrives at its exact cycle, into a two-byte hardware FIFO that overruns.
// - Sent bytes: the UART takes its pace from divisor and defaults as the divisor is written, eleven
//   bits at single speed; here it takes the next byte as the one before leaves its buffer (19.6).
// - Timers 1 and 2 do not run, except for a bootloader, which may wait for one: PWM duties are
//   worked out from their registers, which costs nothing and is never older than the last write.
// - A conversion begins with the next clock of the converter, not as it is asked for (23.4).
// - A one that is written to the converter's flag takes the waiting interrupt back.
// - The EEPROM finishes a byte over a reset, and is busy so long.
// - The reset's causes stay over further resets but power-on, and a one written to them sets none
//   (10.9.1).
// - A watchdog whose interrupt cannot run resets at its second time-out, as the datasheet has it
//   (10.9.2).
// - What a chip would not do, or what its datasheet rules out, ends the run (misused()).
// - Time zero is where the firmware starts timer 0, its 1 ms clock: "booted but not run".
#include <math.h>
#include <stdio.h>
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

constexpr uint64_t kHz = 16'000'000;
constexpr uint64_t kCyclesPerUs = kHz / 1'000'000;
constexpr uint32_t kUsbBaud = 117'647;    // an ATmega16U2 that divides 16 MHz by 8 and 17
constexpr double kLineTolerance = 0.039;  // table 19-3: 3.90 % for ten bits at double speed
constexpr size_t kQueue = 1 << 16;
constexpr size_t kEepromSize = 1024;
constexpr uint8_t kPins = 70;
constexpr uint8_t kChannels = 8;
constexpr uint16_t kHighMv = 3000, kLowMv = 1500;  // 0.6 and 0.3 of the supply (29.2)
constexpr uint64_t kBootLimit = 16'000'000;        // cycles until the firmware must run its clock
// A step runs instructions up to the next timer, but no further than this: one by one, as libsimavr
// does unasked, its looking for timers costs nearly as much as the instructions.
constexpr uint64_t kRunCycles = 16'000;
constexpr uint8_t kLost = 0xA5;  // what is in SRAM after power-on: nothing to rely on

// Data addresses, the same in both chips (ATmega328P 30, ATmega2560 33).
enum Register : uint16_t {
  kPinA = 0x20,
  kPinH = 0x100,
  kTccr0a = 0x44,
  kTccr0b = 0x45,
  kOcr0a = 0x47,
  kOcr0b = 0x48,
  kGpior0 = 0x3E,
  kEecr = 0x3F,
  kMcusr = 0x54,
  kWdtcsr = 0x60,
  kAdcsra = 0x7A,
  kAdmux = 0x7C,
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
  kUcsr0b = 0xC1,
  kUcsr0c = 0xC2,
  kUbrr0 = 0xC4,
  kUdr0 = 0xC6,
};
constexpr uint16_t kPwmRegisters[] = {kTccr1a, kTccr1b, kTccr2a, kTccr2b, kOcr2a, kOcr2b};
constexpr uint8_t kUnits = 6;  // OC0A, OC0B, OC1A, OC1B, OC2A, OC2B
constexpr size_t kPwmCount = sizeof kPwmRegisters / sizeof kPwmRegisters[0];
constexpr uint16_t kWordRegisters[] = {kIcr1, kOcr1a, kOcr1b};
constexpr uint8_t kRxc0 = 1 << 7, kFe0 = 1 << 4, kDor0 = 1 << 3, kU2x0 = 1 << 1;
constexpr uint8_t kRxen0 = 1 << 4, kTxen0 = 1 << 3;
constexpr uint8_t kWdie = 1 << 6;
constexpr uint8_t kAden = 1 << 7, kAdsc = 1 << 6, kAdif = 1 << 4;
constexpr uint8_t kEempe = 1 << 2, kEepe = 1 << 1, kEere = 1 << 0;
constexpr uint64_t kEepromCycles = 3400 * kCyclesPerUs;  // erase and write (8.6.3)
constexpr uint64_t kNextCycle = 2;
constexpr uint8_t kRjmpSelf[] = {0xFF, 0xCF};

struct PinPlace {
  char port;
  uint8_t bit;
};
PinPlace uno_pin(uint8_t pin) {
  if (pin < 8) return {'D', pin};
  if (pin < 14) return {'B', static_cast<uint8_t>(pin - 8)};
  if (pin < 20) return {'C', static_cast<uint8_t>(pin - 14)};
  return {0, 0};
}
// The Mega's schematic, revision 3.
PinPlace mega_pin(uint8_t pin) {
  static constexpr PinPlace kFirst[] = {{'E', 0}, {'E', 1}, {'E', 4}, {'E', 5}, {'G', 5}, {'E', 3},
                                        {'H', 3}, {'H', 4}, {'H', 5}, {'H', 6}, {'B', 4}, {'B', 5},
                                        {'B', 6}, {'B', 7}, {'J', 1}, {'J', 0}, {'H', 1}, {'H', 0},
                                        {'D', 3}, {'D', 2}, {'D', 1}, {'D', 0}};
  if (pin < 22) return kFirst[pin];
  if (pin < 30) return {'A', static_cast<uint8_t>(pin - 22)};
  if (pin < 38) return {'C', static_cast<uint8_t>(37 - pin)};
  if (pin == 38) return {'D', 7};
  if (pin < 42) return {'G', static_cast<uint8_t>(41 - pin)};
  if (pin < 50) return {'L', static_cast<uint8_t>(49 - pin)};
  if (pin < 54) return {'B', static_cast<uint8_t>(53 - pin)};
  if (pin < 62) return {'F', static_cast<uint8_t>(pin - 54)};
  return {'K', static_cast<uint8_t>(pin - 62)};
}

struct Chip {
  const char *name;
  PinPlace (*place)(uint8_t pin);
  uint8_t pins;
  uint8_t first_analog;  // A0's number
  uint8_t oc[6];         // pins of OC0A, OC0B, OC1A, OC1B, OC2A, OC2B
  uint8_t rx_vector, watchdog_vector, adc_vector;
  uint8_t external_interrupts;
  uint16_t sram, sram_size;
  PinPlace capture;  // ICP1
};
constexpr Chip kChips[] = {
    {"atmega328p", uno_pin, 20, 14, {6, 5, 9, 10, 11, 3}, 18, 6, 21, 2, 0x100, 2048, {'B', 0}},
    {"atmega2560", mega_pin, 70, 54, {13, 4, 11, 12, 10, 9}, 25, 12, 29, 8, 0x200, 8192, {'D', 4}},
};

// A port's PIN register; DDR and PORT follow it.
uint16_t pin_register(char port) {
  if (port < 'H') return static_cast<uint16_t>(kPinA + 3 * (port - 'A'));
  return static_cast<uint16_t>(kPinH + 3 * (port - 'H' - (port > 'I')));  // there is no port I
}

thread_local std::string last_error;

void silence(avr_t *, const int, const char *, va_list) {}
void sleep_without_waiting(avr_t *, avr_cycle_count_t) {}

// The architecture that an ELF for the AVR names in its flags: 5 for 128 KiB and less, 6 for more.
int architecture(const char *path) {
  uint8_t header[40] = {};
  FILE *file = fopen(path, "rb");
  if (file == nullptr) return -1;
  const size_t got = fread(header, 1, sizeof header, file);
  fclose(file);
  return got == sizeof header && memcmp(header, "\177ELF", 4) == 0 ? header[36] & 0x7F : -1;
}

// Puts an Intel hex file into the flash; returns the lowest address, or -1 where it is none.
int64_t load_hex(const char *path, avr_t *avr) {
  FILE *file = fopen(path, "r");
  if (file == nullptr) return -1;
  int64_t lowest = -1;
  uint32_t base = 0;
  char line[600];
  while (fgets(line, sizeof line, file) != nullptr) {
    unsigned count = 0, address = 0, type = 0;
    if (sscanf(line, ":%2x%4x%2x", &count, &address, &type) != 3) continue;
    unsigned value = 0;
    if (type == 2 && sscanf(line + 9, "%4x", &value) == 1) base = value << 4;
    if (type == 4 && sscanf(line + 9, "%4x", &value) == 1) base = value << 16;
    if (type != 0) continue;
    for (unsigned i = 0; i < count && base + address + i <= avr->flashend; ++i) {
      if (sscanf(line + 9 + 2 * i, "%2x", &value) != 1) break;
      avr->flash[base + address + i] = static_cast<uint8_t>(value);
    }
    // Optiboot's version stands apart from its code: the code comes first.
    if (lowest < 0) lowest = base + address;
  }
  fclose(file);
  return lowest;
}

// What libsimavr does when a register is written.
struct Hook {
  avr_io_write_t write = nullptr;
  void *param = nullptr;
  void operator()(avr_t *avr, avr_io_addr_t address, uint8_t value) const {
    if (write != nullptr) {
      write(avr, address, value, param);
    } else {
      avr->data[address] = value;
    }
  }
};

struct TimedByte {
  uint64_t due;  // cycle of the target's clock
  uint8_t byte;
  bool misread = false;
};

}  // namespace

struct daranti_target {
  avr_t *avr = nullptr;
  const Chip *chip = nullptr;
  bool bootloader = false;
  uint32_t hang_at = 0;
  std::string misuse;
  std::string noted;    // of it, what no register shows afterwards
  uint64_t origin = 0;  // target time of avr->cycle 0, in cycles; wraps below zero during boot
  uint64_t seen = 0;    // target time after the last instruction
  bool was_reset = false;
  uint8_t causes = 0;  // of resets, as MCUSR has them
  void (*core_reset)(avr_t *) = nullptr;
  bool fenced = false;
  uint32_t resets = 0;  // since the fence was set
  std::deque<TimedByte> to_firmware;
  std::deque<TimedByte> to_host;
  uint64_t host_free = 0;  // when the host's line is free again
  uint64_t line_free = 0;  // when the firmware's line is free again
  uint32_t host_baud = kUsbBaud;
  uint8_t temp = 0;                               // of timer 1's 16-bit registers
  uint64_t converter_on = 0;                      // cycle at which ADEN was set
  uint64_t storing_until = 0;                     // target time at which the EEPROM has its byte
  Hook eecr, adcsra, udr, mcusr, pwm[kPwmCount];  // libsimavr's own
  bool timed[kPwmCount] = {};                     // whether a bootloader has it from libsimavr
  struct Compare {
    uint16_t used = 0;
    uint16_t buffered = 0;
    uint64_t until = 0;  // cycles: when the buffer is taken
    void settle(uint64_t now) {
      if (now >= until) used = buffered;
      if (now >= until) until = UINT64_MAX;
    }
  } compare[kUnits];
  TimedByte fifo[2] = {};
  uint8_t fifo_count = 0;
  uint16_t millivolt[kChannels] = {};
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
    const PinPlace at = chip->place(pin);
    // Without an external pull, libsimavr would put the pull-up's level back at the next write to
    // the port.
    avr_ioport_external_t pull = {};
    pull.name = static_cast<unsigned char>(at.port);
    for (uint8_t other = 0; other < chip->pins; ++other) {
      const PinPlace place = chip->place(other);
      if (place.port != at.port || !driven[other]) continue;
      pull.mask = pull.mask | 1UL << place.bit;
      if (level[other]) pull.value = pull.value | 1UL << place.bit;
    }
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(at.port), &pull);
    const bool pulled_up = reg(pin_register(at.port) + 2) >> at.bit & 1;
    raise(AVR_IOCTL_IOPORT_GETIRQ(at.port), at.bit, driven[pin] ? level[pin] : pulled_up);
  }
  void drive_pin(uint8_t pin, bool high) {
    if (driven[pin] && level[pin] == high) return;
    level[pin] = high;
    driven[pin] = true;
    apply_pin(pin);
  }

  // ---- the line

  uint32_t bit_cycles() const {
    return (reg(kUcsr0a) & kU2x0 ? 8 : 16) * (uint32_t{1} + (reg16(kUbrr0) & 0x0FFF));
  }
  // Start, data, parity and stop bits.
  uint32_t frame_bits() const {
    const uint8_t c = reg(kUcsr0c);
    const uint32_t data = 5 + (c >> 1 & 3) + (reg(kUcsr0b) & 4 ? 1 : 0);
    return 1 + data + (c & 0x30 ? 1 : 0) + (c & 8 ? 2 : 1);
  }
  // Whether either end would take the other's bits for what they are: eight, no parity, at nearly
  // the same speed.
  bool understood() const {
    if ((reg(kUcsr0c) & 0xF6) != 6 || (reg(kUcsr0b) & 4)) return false;
    const double own = static_cast<double>(kHz) / bit_cycles();
    return fabs(own / host_baud - 1) <= kLineTolerance;
  }
  uint64_t host_byte_cycles() const { return (uint64_t{10} * kHz + host_baud / 2) / host_baud; }

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
    const uint8_t byte = self->fifo[0].byte;
    if (self->fifo_count != 0) {
      --self->fifo_count;
      self->fifo[0] = self->fifo[1];
    }
    avr->data[kUcsr0a] &= static_cast<uint8_t>(~(kRxc0 | kDor0 | kFe0));
    if (self->fifo_count != 0) {
      if (self->fifo[0].misread) avr->data[kUcsr0a] |= kFe0;
      self->raise_rx();
    }
    return byte;
  }
  // The buffer is empty again as its byte moves on to the shift register: at once, or when the byte
  // there has gone.
  static void on_udr_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    auto *uart = static_cast<avr_uart_t *>(self->udr.param);
    const uint64_t now = self->now();
    uart->cycles_per_byte = self->line_free > now + kNextCycle ? self->line_free - now : kNextCycle;
    self->udr(avr, address, value);
  }
  // A bootloader's timer runs; the firmware's first write stops it, and each is only kept.
  static void on_pwm(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    const bool loads = self->bootloader && avr->pc >= avr->reset_pc;
    for (size_t i = 0; i < kPwmCount; ++i) {
      if (kPwmRegisters[i] != address || !(loads || self->timed[i])) continue;
      self->pwm[i](avr, address, loads ? value : 0);
      self->timed[i] = loads;
    }
    if (loads) return;
    bool apart[kUnits];
    for (uint8_t unit = 0; unit < kUnits; ++unit) apart[unit] = !self->connected(unit);
    avr->data[address] = value;
    if (address == kOcr2a || address == kOcr2b) self->compare_written(address == kOcr2a ? 4 : 5);
    for (uint8_t unit = 2; unit < kUnits; ++unit) {
      if (apart[unit] && self->connected(unit)) self->compare_used(unit);
    }
  }
  // Timer 1's 16-bit registers take their high byte from a common one as the low byte is written
  // (15.3).
  static void on_high_byte(avr_t *, avr_io_addr_t, uint8_t value, void *param) {
    static_cast<daranti_target *>(param)->temp = value;
  }
  static void on_low_byte(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    const uint8_t mode = self->mode_of(2);
    if (address == kIcr1 && (mode < 8 || mode % 2 != 0)) {
      self->note("ICR1: takes a value only in a mode that has it for its top (15.6)");
      return;
    }
    avr->data[address] = value;
    avr->data[address + 1] = self->temp;
    if (address != kIcr1) self->compare_written(address == kOcr1a ? 2 : 3);
  }
  static void on_eecr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    const bool storing = self->now() < self->storing_until;
    if (storing && (value & (kEere | kEepe))) {
      self->note("EECR: the EEPROM is used while it still writes a byte (8.6.3)");
    }
    const bool begins = (value & kEepe) && (avr->data[kEecr] & kEempe) && !storing;
    if (begins) self->storing_until = self->now() + kEepromCycles;
    self->eecr(avr, address, value);
  }
  static avr_cycle_count_t on_stored(avr_t *avr, avr_cycle_count_t, void *) {
    avr->data[kEecr] &= static_cast<uint8_t>(~kEepe);
    return 0;
  }
  static void on_mcusr(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    avr->data[address] &= value;
    static_cast<daranti_target *>(param)->causes = avr->data[address];
  }
  static void on_adcsra(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    constexpr uint8_t kRuns = kAden | kAdsc;  // switched off, a conversion ends (23.9.2)
    if ((value & kRuns) == kRuns && (avr->data[kAdcsra] & kRuns) == kRuns) {
      self->note("ADCSRA: a conversion is asked for while another runs; it never starts (23.9.2)");
    }
    const uint8_t before = avr->data[kAdcsra];
    if (!(before & kAden)) self->converter_on = avr->cycle;
    self->adcsra(avr, address, value);
    if ((value & kRuns) == kRuns && !(before & kAdsc)) self->begin_on_its_clock(value & 7);
    // A one clears the flag, and with it the interrupt that waits (23.9.2).
    if (value & kAdif) {
      avr_clear_interrupt(avr, self->vector(self->chip->adc_vector));
      avr->data[kAdcsra] &= static_cast<uint8_t>(~kAdif);
    }
  }
  // The converter's prescaler counts from when it was switched on, and a conversion begins with the
  // next rising edge (23.4).
  void begin_on_its_clock(uint8_t prescaler) {
    const uint64_t clock = uint64_t{1} << (prescaler == 0 ? 1 : prescaler);
    const uint64_t wait = clock - (avr->cycle - converter_on) % clock;
    for (auto *slot = avr->cycle_timers.timer; slot != nullptr; slot = slot->next) {
      if (slot->param != adcsra.param) continue;
      const avr_cycle_timer_t ends = slot->timer;
      const uint64_t left = slot->when - avr->cycle;
      avr_cycle_timer_cancel(avr, ends, adcsra.param);
      avr_cycle_timer_register(avr, left + wait, ends, adcsra.param);
      return;
    }
  }
  // Puts a function of ours before libsimavr's own.
  void hook(uint16_t address, avr_io_write_t ours, Hook *theirs) {
    auto &write = avr->io[AVR_DATA_TO_IO(address)].w;
    if (write.c == ours) return;
    *theirs = {write.c, write.param};
    write.c = ours;
    write.param = this;
  }
  // In its PWM modes a timer buffers a compare register until its period ends, in the normal mode
  // a write goes past the buffer, which keeps what it had (15.7, 17.5).
  uint16_t written(uint8_t unit) const {
    return unit < 4 ? reg16(unit == 2 ? kOcr1a : kOcr1b) : reg(unit == 4 ? kOcr2a : kOcr2b);
  }
  uint64_t period(uint8_t unit) const {
    static constexpr uint16_t kOf1[] = {0, 1, 8, 64, 256, 1024, 0, 0};
    static constexpr uint16_t kOf2[] = {0, 1, 8, 32, 64, 128, 256, 1024};
    if (unit < 4) return uint64_t{2} * reg16(kIcr1) * kOf1[reg(kTccr1b) & 7];
    return uint64_t{510} * kOf2[reg(kTccr2b) & 7];
  }
  void compare_written(uint8_t unit) {
    Compare &its = compare[unit];
    its.settle(now());
    if (mode_of(unit) == 0) {
      its.used = written(unit);
    } else {
      its.buffered = written(unit);
      const uint64_t takes = period(unit);
      its.until = takes == 0 ? UINT64_MAX : now() + takes;
    }
  }
  void compare_used(uint8_t unit) {
    Compare &its = compare[unit];
    its.settle(now());
    if (its.used == written(unit) && its.buffered == its.used) return;
    note("an output is connected while its compare register holds another value (15.7, 17.5)");
  }
  void note(const char *what) {
    if (noted.empty()) noted = what;
  }
  // The watchdog's interrupt waits: if it still does at the next time-out, that resets.
  static void on_watchdog(avr_irq_t *, uint32_t pending, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    if (!pending) return;
    const uint8_t control = self->reg(kWdtcsr);
    const uint8_t prescaler = static_cast<uint8_t>((control & 7) | (control >> 2 & 8));
    const uint64_t period = (uint64_t{2048} << prescaler) * kHz / 128'000;
    avr_cycle_timer_register(self->avr, period - 16, on_second_timeout, self);
  }
  static avr_cycle_count_t on_second_timeout(avr_t *avr, avr_cycle_count_t, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    avr_int_vector_t *vector = self->vector(self->chip->watchdog_vector);
    if (vector != nullptr && avr_is_interrupt_pending(avr, vector)) {
      self->reg(kWdtcsr) &= static_cast<uint8_t>(~kWdie);
    }
    return 0;
  }
  avr_int_vector_t *vector(uint8_t number) const {
    for (uint8_t i = 0; i < avr->interrupts.vector_count; ++i) {
      if (avr->interrupts.vector[i]->vector == number) return avr->interrupts.vector[i];
    }
    return nullptr;
  }
  void raise_rx() const { avr_raise_interrupt(avr, vector(chip->rx_vector)); }
  static void on_sent(avr_irq_t *, uint32_t value, void *param) {
    auto *self = static_cast<daranti_target *>(param);
    if (!(self->reg(kUcsr0b) & kTxen0)) return;
    const uint64_t start = self->line_free > self->now() ? self->line_free : self->now();
    self->line_free = start + uint64_t{self->frame_bits()} * self->bit_cycles();
    const uint8_t byte = static_cast<uint8_t>(self->understood() ? value : value << 1 | 1);
    if (self->to_host.size() < kQueue) self->to_host.push_back({self->line_free, byte});
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
    for (size_t i = 0; i < kPwmCount; ++i) hook(kPwmRegisters[i], on_pwm, &pwm[i]);
    for (Compare &each : compare) each = Compare();
    for (const uint16_t address : kWordRegisters) {
      auto &low = avr->io[AVR_DATA_TO_IO(address)].w;
      auto &high = avr->io[AVR_DATA_TO_IO(address + 1)].w;
      low.c = on_low_byte;
      high.c = on_high_byte;
      low.param = high.param = this;
    }
    hook(kEecr, on_eecr, &eecr);
    hook(kMcusr, on_mcusr, &mcusr);
    causes |= reg(kMcusr);
    reg(kMcusr) = causes;
    hook(kAdcsra, on_adcsra, &adcsra);
    hook(kUdr0, on_udr_write, &udr);
    // The EEPROM finishes its byte, whatever resets the chip (8.6.3).
    if (storing_until > now()) {
      reg(kEecr) |= kEepe;
      avr_cycle_timer_register(avr, storing_until - now(), on_stored, this);
    }
    avr->io[AVR_DATA_TO_IO(kUdr0)].r.c = on_udr_read;
    avr->io[AVR_DATA_TO_IO(kUdr0)].r.param = this;
    // Else an edge there would capture timer 1 into ICR1, which the hardware leaves alone where
    // ICR1 is the top (15.6.3).
    avr_unconnect_irq(
        avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(chip->capture.port), chip->capture.bit),
        avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_IN_ICP));
    // Else a low level costs a poll every cycle, although these interrupts are off.
    for (uint8_t i = 0; i < chip->external_interrupts; ++i) {
      avr_extint_set_strict_lvl_trig(avr, i, 0);
    }
    for (uint8_t pin = 0; pin < chip->pins; ++pin) {
      if (!driven[pin]) continue;
      // An unchanged value would be filtered out, and the input register stay cleared.
      level[pin] = !level[pin];
      apply_pin(pin);
      level[pin] = !level[pin];
      apply_pin(pin);
    }
    for (uint8_t channel = 0; channel < kChannels; ++channel) {
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

  // Without a bootloader: from the reset vector to where the firmware starts its clock, outside the
  // target's time. With one: no further than the reset.
  bool boot(uint8_t cause, uint64_t time) {
    if (cause & DARANTI_RESET_POWER_ON) {
      memset(&reg(chip->sram), kLost, chip->sram_size);
      causes = 0;
    }
    avr_reset(avr);
    reg(kMcusr) = cause;
    to_firmware.clear();
    to_host.clear();
    host_free = line_free = time;
    restore_inputs(time);
    avr->run_cycle_limit = 1;
    while (!bootloader && reg(kTccr0b) == 0) {
      if (!step() || avr->cycle > kBootLimit) return false;
    }
    origin = time - avr->cycle;
    if (!probing) avr->run_cycle_limit = kRunCycles;
    return true;
  }

  // Up to where interrupts are as asked, then into an endless loop.
  bool hang(bool interrupts_off) {
    const auto limit = avr->run_cycle_limit;
    avr->run_cycle_limit = avr->run_cycle_count = 1;
    bool there = false;
    for (uint32_t i = 0; i < kBootLimit && !there; ++i) {
      if (!step()) return false;
      there = (avr->sreg[S_I] == 0) == interrupts_off;
    }
    avr->run_cycle_limit = limit;
    avr->pc = hang_at;
    avr->state = cpu_Running;
    return there;
  }

  // The tick under way takes so much longer; interrupts go on.
  void stall(uint64_t cycles) {
    const auto limit = avr->run_cycle_limit;
    avr->run_cycle_limit = avr->run_cycle_count = 1;
    const auto go = [this](bool (*there)(const daranti_target &)) {
      for (uint32_t i = 0; i < kBootLimit && !there(*this); ++i) step();
    };
    go([](const daranti_target &t) { return t.reg(kGpior0) != 0 && t.avr->sreg[S_I] != 0; });
    const avr_flashaddr_t back = avr->pc;
    avr->pc = hang_at;
    const uint64_t until = now() + cycles;
    while (now() < until) step();
    go([](const daranti_target &t) { return t.avr->pc == t.hang_at; });
    avr->pc = back;
    avr->run_cycle_limit = limit;
  }

  // What the chip does not do, or its datasheet rules out; empty where all is well.
  std::string misused() const {
    if (!noted.empty()) return noted;
    if (reg(kAdcsra) & kAden) {
      const uint8_t prescaler = reg(kAdcsra) & 7;
      const uint32_t adc_hz = static_cast<uint32_t>(kHz >> (prescaler == 0 ? 1 : prescaler));
      if (adc_hz > 200'000 || adc_hz < 50'000) {
        return "ADCSRA: the converter runs at " + std::to_string(adc_hz / 1000) +
               " kHz; for 10 bits 50 to 200 (23.4)";
      }
      if (reg(kAdmux) >> 6 != 1) {
        return "ADMUX: the reference is not AVCC; AREF is not connected on these boards";
      }
    }
    for (uint8_t pin = 0; pin < chip->pins; ++pin) {
      const PinPlace at = chip->place(pin);
      const bool output = reg(pin_register(at.port) + 1) >> at.bit & 1;
      if (output && driven[pin]) {
        return "pin " + std::to_string(pin) + " is an output, but is driven from outside";
      }
    }
    for (uint8_t unit = 0; unit < 6; ++unit) {
      if (!connected(unit) || share(unit) >= 0) continue;
      return "pin " + std::to_string(chip->oc[unit]) +
             ": its timer is stopped, clocked from outside, or in no PWM mode";
    }
    return "";
  }

  int32_t run_until(uint64_t until) {
    if (until <= now()) return 0;
    while (now() < until) {
      fenced = false;
      resets = 0;
      avr_cycle_timer_register(avr, until - now(), on_fence, this);
      // A reset on the way drops the fence: set it anew.
      while (!fenced && resets == 0) {
        if (!step()) {
          last_error = "the microcontroller crashed";
          return -1;
        }
      }
    }
    misuse = misused();
    if (misuse.empty()) return 0;
    last_error = misuse;
    return -2;
  }

  // ---- PWM: units are OC0A, OC0B, OC1A, OC1B, OC2A, OC2B

  uint8_t mode_of(uint8_t unit) const {
    const uint8_t timer = unit / 2;
    const uint16_t a = timer == 0 ? kTccr0a : timer == 1 ? kTccr1a : kTccr2a;
    const uint8_t high = timer == 1 ? reg(a + 1) >> 3 & 3 : reg(a + 1) >> 3 & 1;
    return static_cast<uint8_t>((reg(a) & 3) | high << 2);
  }
  uint8_t compare_mode(uint8_t unit) const {
    const uint8_t timer = unit / 2;
    const uint16_t a = timer == 0 ? kTccr0a : timer == 1 ? kTccr1a : kTccr2a;
    return reg(a) >> (unit % 2 == 0 ? 6 : 4) & 3;
  }
  bool connected(uint8_t unit) const { return compare_mode(unit) != 0; }

  // Share of the period for which the output is high, negative where there is none (15.9, 17.7).
  double share(uint8_t unit) const {
    const uint8_t timer = unit / 2, mode = mode_of(unit), compare = compare_mode(unit);
    const uint16_t b = timer == 0 ? kTccr0b : timer == 1 ? kTccr1b : kTccr2b;
    const uint8_t clock = reg(b) & 7;
    if (clock == 0 || (timer != 2 && clock > 5) || compare == 1) return -1;
    uint32_t top = 0, at = 0;
    bool fast = false;
    if (timer == 1) {
      at = reg16(unit % 2 == 0 ? kOcr1a : kOcr1b);
      static constexpr uint32_t kTops[] = {0, 0xFF, 0x1FF, 0x3FF};
      if (mode == 0 || mode == 4 || mode == 12 || mode == 13) return -1;
      fast = mode > 4 && mode != 8 && mode != 9 && mode != 10 && mode != 11;
      if (mode < 8) top = kTops[mode & 3];
      if (mode >= 8) top = reg16(mode % 2 == 0 ? kIcr1 : kOcr1a);
    } else {
      if (mode % 2 == 0) return -1;
      fast = mode & 2;
      at = reg(timer == 0 ? (unit % 2 == 0 ? kOcr0a : kOcr0b) : (unit % 2 == 0 ? kOcr2a : kOcr2b));
      top = mode < 4 ? 255 : reg(timer == 0 ? kOcr0a : kOcr2a);
    }
    if (top < 3) return -1;
    const double high = fast ? (at + 1.0) / (top + 1.0) : static_cast<double>(at) / top;
    const double clipped = high > 1 ? 1 : high;
    return compare == 2 ? clipped : 1 - clipped;
  }

  int16_t output(uint8_t pin) const {
    const PinPlace at = chip->place(pin);
    const uint16_t base = pin_register(at.port);
    const bool high = reg(base + 2) >> at.bit & 1;
    if (!(reg(base + 1) >> at.bit & 1)) return high ? DARANTI_PULLED_UP : DARANTI_FLOATING;
    for (uint8_t unit = 0; unit < 6; ++unit) {
      if (chip->oc[unit] != pin || !connected(unit)) continue;
      const double duty = share(unit);
      if (duty <= 0) return 0;
      if (duty >= 1) return 255;
      const int16_t rounded = static_cast<int16_t>(duty * 255 + 0.5);
      return rounded < 1 ? 1 : rounded > 254 ? 254 : rounded;
    }
    return high ? 255 : 0;
  }
};

void daranti_target::receive_due() {
  while (!to_firmware.empty() && to_firmware.front().due <= now()) {
    TimedByte next = to_firmware.front();
    to_firmware.pop_front();
    if (!(reg(kUcsr0b) & kRxen0)) continue;
    if (!understood()) {
      next.byte = static_cast<uint8_t>(next.byte << 1 | 1);
      next.misread = true;
    }
    if (fifo_count < 2) {
      fifo[fifo_count++] = next;
      if (fifo_count == 1 && next.misread) reg(kUcsr0a) |= kFe0;
    } else {
      reg(kUcsr0a) |= kDor0;
    }
    raise_rx();
  }
}

extern "C" {

uint32_t target_abi(void) { return DARANTI_TARGET_ABI; }

const char *target_error(void) { return last_error.c_str(); }

daranti_target *target_create(const char *image, const char *bootloader, const uint8_t *eeprom) {
  avr_global_logger_set(silence);
  elf_firmware_t firmware;
  memset(&firmware, 0, sizeof firmware);
  if (image == nullptr || elf_read_firmware(image, &firmware) != 0 || firmware.flash == nullptr) {
    last_error = std::string(image ? image : "(no image)") + ": not a readable AVR ELF file";
    return nullptr;
  }
  const int kind = architecture(image);
  if (kind != 5 && kind != 6) {
    last_error = std::string(image) + ": for neither an ATmega328P nor an ATmega2560";
    free(firmware.flash);
    return nullptr;
  }
  const Chip *chip = &kChips[kind - 5];
  auto *self = new (std::nothrow) daranti_target();
  avr_t *avr = avr_make_mcu_by_name(chip->name);
  if (self == nullptr || avr == nullptr) {
    last_error = std::string("libsimavr does not know the ") + chip->name + ", or memory ran out";
    free(firmware.flash);
    delete self;
    return nullptr;
  }
  self->chip = chip;
  avr_init(avr);
  avr->frequency = kHz;
  avr_load_firmware(avr, &firmware);
  free(firmware.flash);
  avr->sleep = sleep_without_waiting;
  avr->custom.data = self;
  self->core_reset = avr->reset;
  avr->reset = daranti_target::on_reset;
  avr->vcc = avr->avcc = avr->aref = 5000;
  self->avr = avr;
  const uint32_t size = firmware.flashsize;
  if (bootloader != nullptr) {
    const int64_t start = load_hex(bootloader, avr);
    if (start <= size) {
      last_error = std::string(bootloader) + ": no bootloader for this chip, or not readable";
      avr_terminate(avr);
      free(avr);
      delete self;
      return nullptr;
    }
    avr->reset_pc = static_cast<avr_flashaddr_t>(start);
    self->bootloader = true;
  }
  avr->codeend = avr->flashend;
  // Behind the firmware, in erased flash.
  self->hang_at = (size + 0x100) & ~0xFFU;
  memcpy(avr->flash + self->hang_at, kRjmpSelf, sizeof kRjmpSelf);

  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~static_cast<uint32_t>(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
                          daranti_target::on_sent, self);
  avr_irq_register_notify(avr_get_interrupt_irq(avr, chip->watchdog_vector) + AVR_INT_IRQ_PENDING,
                          daranti_target::on_watchdog, self);

  uint8_t image_bytes[kEepromSize];
  memset(image_bytes, 0xFF, sizeof image_bytes);
  if (eeprom != nullptr) memcpy(image_bytes, eeprom, sizeof image_bytes);
  avr_eeprom_desc_t desc = {image_bytes, 0, kEepromSize};
  avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &desc);

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
  if (channel >= kChannels || target->millivolt[channel] == millivolt) return;
  target->millivolt[channel] = millivolt;
  target->raise(AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel, millivolt);
  const uint8_t pin = static_cast<uint8_t>(target->chip->first_analog + channel);
  if (pin >= target->chip->pins) return;
  if (millivolt >= kHighMv) target->drive_pin(pin, true);
  if (millivolt <= kLowMv) target->drive_pin(pin, false);
}

void target_set_pin(daranti_target *target, uint8_t pin, uint8_t level) {
  if (pin >= target->chip->pins) return;
  if (level != DARANTI_RELEASED) {
    target->drive_pin(pin, level == DARANTI_HIGH);
  } else if (target->driven[pin]) {
    target->driven[pin] = false;
    target->apply_pin(pin);
  }
}

int16_t target_output(const daranti_target *target, uint8_t pin) {
  return pin < target->chip->pins ? target->output(pin) : int16_t{DARANTI_FLOATING};
}

void target_set_baud(daranti_target *target, uint32_t baud) {
  target->host_baud = baud == 0 ? kUsbBaud : baud;
}

size_t target_write(daranti_target *target, const uint8_t *bytes, size_t count) {
  if (target->host_free < target->now()) target->host_free = target->now();
  const bool idle = target->to_firmware.empty();
  size_t taken = 0;
  while (taken < count && target->to_firmware.size() < kQueue) {
    target->host_free += target->host_byte_cycles();
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

int32_t target_hang(daranti_target *target, uint8_t where) {
  return target->hang(where == DARANTI_HANG_INTERRUPT) ? 0 : -1;
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

// The next tick takes so much longer.
void probe_stall(daranti_target *target, uint32_t us) { target->stall(us * kCyclesPerUs); }

// The SRAM, as it is now, and a way to paint it; its address and size.
uint8_t *probe_sram(daranti_target *target) { return &target->reg(target->chip->sram); }
void probe_sram_place(const daranti_target *target, uint32_t *address, uint32_t *size) {
  *address = target->chip->sram;
  *size = target->chip->sram_size;
}

// The program counter, in bytes.
uint32_t probe_pc(const daranti_target *target) { return target->avr->pc; }

// A register, by its data address.
uint8_t probe_register(const daranti_target *target, uint16_t address) {
  return target->reg(address);
}

// Writes a register as the program would.
void probe_write(daranti_target *target, uint16_t address, uint8_t value) {
  const auto &write = target->avr->io[AVR_DATA_TO_IO(address)].w;
  Hook{write.c, write.param}(target->avr, address, value);
}

// The pins' levels that the firmware sees, by the board's numbers.
uint8_t probe_pin(const daranti_target *target, uint8_t pin) {
  const PinPlace at = target->chip->place(pin);
  return target->reg(pin_register(at.port)) >> at.bit & 1;
}

}  // extern "C"
