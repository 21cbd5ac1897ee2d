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

#define DARANTI_TARGET_ABI 1

typedef struct daranti_target daranti_target;

enum daranti_reset {  // bits as in the ATmega328P's MCUSR (datasheet 11.9.1)
  DARANTI_RESET_POWER_ON = 1,
  DARANTI_RESET_EXTERNAL = 2,
  DARANTI_RESET_BROWN_OUT = 4,
  DARANTI_RESET_WATCHDOG = 8
};

uint32_t target_abi(void);  // DARANTI_TARGET_ABI

// image: path of the ELF for simavr, ignored (may be NULL) by the desk build.
// eeprom: 1024 bytes, or NULL for an erased one (0xFF). Returns NULL on failure; target_error()
// then says why. The firmware has booted but not run: time is 0.
daranti_target *target_create(const char *image, const uint8_t *eeprom);
void target_destroy(daranti_target *);
const char *target_error(void);  // of the last failed target_create() in this thread, never NULL

// Runs until the target's clock reaches time_us. Returns 0, or a negative number when the
// target has crashed (an invalid opcode, a hang that no watchdog ended).
int32_t target_run_until(daranti_target *, uint64_t time_us);
uint64_t target_time_us(const daranti_target *);

void target_set_analog_mv(daranti_target *, uint8_t channel,
                          uint16_t millivolt);                      // 0..5000, A0 = 0
void target_set_pin(daranti_target *, uint8_t pin, uint8_t level);  // an external driver: 0 or 1
uint8_t target_pin(const daranti_target *,
                   uint8_t pin);  // level the firmware drives; input reads 0
uint8_t target_pwm(const daranti_target *,
                   uint8_t pin);  // duty 0..255 of 255; 0/255 also for a plain pin

// Serial bytes into and out of the UART; both directions take the baud rate's time per byte.
// write returns how many bytes were queued (the queue holds at least 4096), read how many were
// copied.
size_t target_write(daranti_target *, const uint8_t *bytes, size_t count);
size_t target_read(daranti_target *, uint8_t *bytes, size_t capacity);

void target_reset(daranti_target *, uint8_t cause);  // enum daranti_reset; EEPROM is kept
void target_eeprom(const daranti_target *, uint8_t *bytes1024);  // copies the EEPROM out

// Puts the firmware into an endless loop that no interrupt leaves, as a hung main loop would
// be. The watchdog must end it. 0 where the target can do that, -1 where it cannot.
int32_t target_hang(daranti_target *);

#ifdef __cplusplus
}
#endif
