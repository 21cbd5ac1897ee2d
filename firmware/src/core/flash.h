// Tables that stay in the AVR's flash instead of being copied to its RAM; plain memory elsewhere.
#pragma once
#include <stdint.h>
#ifdef __AVR__
#include <avr/pgmspace.h>
#define DARANTI_FLASH PROGMEM
#else
#define DARANTI_FLASH
#endif

namespace daranti {

inline int16_t flash_read(const int16_t *at) {
#ifdef __AVR__
  return static_cast<int16_t>(pgm_read_word(at));
#else
  return *at;
#endif
}

}  // namespace daranti
