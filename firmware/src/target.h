// The Target ABI: what the bench may ask of a microcontroller that runs the firmware.
//
// Two shared libraries export it alike: the desk build of the firmware (firmware/src/desk) and a
// shim over libsimavr that runs the Uno's ELF (hil/firmware/simavr). Time is the target's own, in
// microseconds since target_create(), and advances only inside target_run_until(). Pins are
// Arduino Uno numbers: 0-13 digital, 14-19 = A0-A5. Not thread-safe per handle; handles are
// independent of each other (no global state), so many targets can run in one process.
#pragma once
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DARANTI_TARGET_ABI 2

typedef struct daranti_target daranti_target;

enum daranti_reset {  // bits as in the ATmega328P's MCUSR (datasheet 11.9.1)
  DARANTI_RESET_POWER_ON = 1,
  DARANTI_RESET_EXTERNAL = 2,
  DARANTI_RESET_BROWN_OUT = 4,
  DARANTI_RESET_WATCHDOG = 8
};

uint32_t target_abi(void);  // DARANTI_TARGET_ABI

// image: path of the ELF for simavr, ignored (may be NULL) by the desk build. Its machine says
// which chip: avr5 an ATmega328P, avr6 an ATmega2560. bootloader: path of an Intel hex file, or
// NULL for none: resets then lead straight to the firmware. The desk has none. eeprom: 1024 bytes,
// or NULL for an erased one (0xFF). Returns NULL on failure; target_error() then says why. Without
// a bootloader the firmware has booted but not run: time is 0. With one, time 0 is when the power
// comes on.
daranti_target *target_create(const char *image, const char *bootloader, const uint8_t *eeprom);
void target_destroy(daranti_target *);
const char *target_error(void);  // of the last failure in this thread, never NULL

// Runs until the target's clock reaches time_us. Returns 0, or a negative number when the target
// has crashed (an invalid opcode, a hang that no watchdog ended) or done what the chip does not
// allow; target_error() then says what.
int32_t target_run_until(daranti_target *, uint64_t time_us);
uint64_t target_time_us(const daranti_target *);

// Voltage at A0 + channel, 0..5000. Where the firmware reads that pin's level: 3000 and more is
// high, 1500 and less is low, between them it stays (datasheet 29.2).
void target_set_analog_mv(daranti_target *, uint8_t channel, uint16_t millivolt);
enum daranti_level { DARANTI_LOW = 0, DARANTI_HIGH = 1, DARANTI_RELEASED = 2 };
void target_set_pin(daranti_target *, uint8_t pin, uint8_t level);  // from outside: daranti_level

// What the firmware does with a pin: the duty 0..255 of 255 of one that it drives (0 or 255 for a
// plain output), DARANTI_FLOATING or DARANTI_PULLED_UP for an input.
enum { DARANTI_FLOATING = -1, DARANTI_PULLED_UP = -2 };
int16_t target_output(const daranti_target *, uint8_t pin);

// The speed of the line's other end, in baud. 117647 where it was never set: an Uno's own USB chip.
void target_set_baud(daranti_target *, uint32_t baud);
// Serial bytes into and out of the UART; each takes the time of its sender's speed, and is misread
// where the two ends differ too much. write returns how many bytes were queued (the queue holds at
// least 4096), read how many were copied.
size_t target_write(daranti_target *, const uint8_t *bytes, size_t count);
size_t target_read(daranti_target *, uint8_t *bytes, size_t capacity);

void target_reset(daranti_target *, uint8_t cause);  // enum daranti_reset; EEPROM is kept
void target_eeprom(const daranti_target *, uint8_t *bytes1024);  // copies the EEPROM out

// Puts the firmware into an endless loop: the main loop, which interrupts leave and come back to,
// or an interrupt that none other can leave. The watchdog must end either. 0, or -1 where the
// target cannot do that.
enum daranti_hang { DARANTI_HANG_MAIN = 0, DARANTI_HANG_INTERRUPT = 1 };
int32_t target_hang(daranti_target *, uint8_t where);

#ifdef __cplusplus
}
#endif
