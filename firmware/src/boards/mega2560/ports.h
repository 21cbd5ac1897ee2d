// Which of the ATmega2560's ports the Mega's pin numbers are, as far as its wiring uses them.
#pragma once
#include <avr/io.h>
#include <stdint.h>

#if !defined(__AVR_ATmega2560__)
#error "boards/mega2560 is for the ATmega2560"
#endif

namespace daranti {

struct Port {
  volatile uint8_t &in, &direction, &out;
};

// 9 is PH6, 10-13 PB4-PB7, 22-29 PA0-PA7, 30-37 PC7-PC0, 54-61 (A0 to A7) PF0-PF7.
// Inlined, so that a pin known to the compiler becomes a single instruction.
__attribute__((always_inline)) inline Port port_of(uint8_t pin) {
  if (pin == 9) return {PINH, DDRH, PORTH};
  if (pin < 22) return {PINB, DDRB, PORTB};
  if (pin < 30) return {PINA, DDRA, PORTA};
  if (pin < 54) return {PINC, DDRC, PORTC};
  return {PINF, DDRF, PORTF};
}
__attribute__((always_inline)) inline uint8_t mask_of(uint8_t pin) {
  return static_cast<uint8_t>(1U << (pin == 9   ? 6
                                     : pin < 22 ? pin - 6
                                     : pin < 30 ? pin - 22
                                     : pin < 54 ? 37 - pin
                                                : pin - 54));
}
constexpr uint8_t kOc1a = 11, kOc1b = 12, kOc2a = 10, kOc2b = 9;

}  // namespace daranti
