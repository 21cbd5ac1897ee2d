// Which of the ATmega328P's ports the Uno's and the Nano's pin numbers are.
#pragma once
#include <avr/io.h>
#include <stdint.h>

#if !defined(__AVR_ATmega328P__)
#error "boards/uno and boards/nano are for the ATmega328P"
#endif

namespace daranti {

struct Port {
  volatile uint8_t &in, &direction, &out;
};

// 0-7 are port D, 8-13 port B, 14-19 (A0 to A5) port C.
// Inlined, so that a pin known to the compiler becomes a single instruction.
__attribute__((always_inline)) inline Port port_of(uint8_t pin) {
  if (pin < 8) return {PIND, DDRD, PORTD};
  if (pin < 14) return {PINB, DDRB, PORTB};
  return {PINC, DDRC, PORTC};
}
__attribute__((always_inline)) inline uint8_t mask_of(uint8_t pin) {
  return static_cast<uint8_t>(1U << (pin < 8 ? pin : pin < 14 ? pin - 8 : pin - 14));
}
constexpr uint8_t kOc1a = 9, kOc1b = 10, kOc2a = 11, kOc2b = 3;

}  // namespace daranti
