#include "board.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

namespace {

using daranti::kAnalogs;
using daranti::kTickMs;

// ---- what the interrupts share with the main loop -----------------------------------------------

// A byte queue between one interrupt and the main loop; each side owns one index.
template <uint8_t kSize>
class Ring {
  static_assert((kSize & (kSize - 1)) == 0, "indices wrap by masking");

 public:
  bool push(uint8_t byte) {
    const uint8_t next = (head_ + 1) & (kSize - 1);
    if (next == tail_) return false;
    bytes_[head_] = byte;
    head_ = next;
    return true;
  }
  bool pop(uint8_t *byte) {
    if (head_ == tail_) return false;
    *byte = bytes_[tail_];
    tail_ = (tail_ + 1) & (kSize - 1);
    return true;
  }
  uint8_t room() const { return static_cast<uint8_t>((tail_ - head_ - 1) & (kSize - 1)); }

 private:
  volatile uint8_t bytes_[kSize];
  volatile uint8_t head_ = 0;
  volatile uint8_t tail_ = 0;
};

Ring<128> received;  // at 115200 baud a tick brings at most 59 bytes
Ring<128> sending;
volatile uint32_t clock_ms;
volatile bool tick_due;
volatile uint16_t analog_mean[kAnalogs];  // of the last finished group, 1/16 counts
volatile uint16_t pulses;
uint8_t mcusr __attribute__((section(".noinit")));

// ---- the 1 ms clock, and the tick ---------------------------------------------------------------

// The tick's period has five milliseconds. Each of the first four begins a run of eight
// conversions of 108 us, so that a voltage that changes every millisecond is sampled whole; the pot
// comes last, for it must be freshest. The tick comes in the fifth.
constexpr uint8_t kTickAt = 4;
constexpr uint8_t kRun = 8;
struct Group {
  uint8_t channel;
  uint8_t count;  // of conversions
  uint8_t shift;  // scales their sum to 16 conversions
};
constexpr Group kGroups[] = {{1, 4, 2}, {2, 4, 2}, {3, 8, 1}, {0, 16, 0}};
constexpr uint8_t kPaused = UINT8_MAX;                     // go on with the group under way
constexpr uint8_t kStartAt[kTickAt] = {0, 2, 3, kPaused};  // group by millisecond; 0 leads on to 1

uint8_t group_now;
uint8_t group_left;
uint16_t group_sum;

void convert(uint8_t channel) {
  ADMUX = static_cast<uint8_t>(_BV(REFS0) | channel);
  ADCSRA |= _BV(ADSC);
}

void start_group(uint8_t group) {
  group_now = group;
  group_left = kGroups[group].count;
  group_sum = 0;
  convert(kGroups[group].channel);
}

}  // namespace

// Runs before main(): a watchdog that caused the reset is still running, with its shortest time.
// Optiboot up to version 4 clears MCUSR, and the reset's cause with it, before this can see it.
extern "C" void keep_reset_cause(void) __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_cause(void) {
  mcusr = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

ISR(TIMER0_COMPA_vect) {
  static uint8_t next = 1;
  const uint8_t phase = next;
  next = phase + 1 == kTickMs ? 0 : phase + 1;
  ++clock_ms;
  if (phase == kTickAt) {
    tick_due = true;
  } else if (kStartAt[phase] == kPaused) {
    ADCSRA |= _BV(ADSC);
  } else {
    start_group(kStartAt[phase]);
  }
}

ISR(ADC_vect) {
  const Group &group = kGroups[group_now];
  group_sum += ADC;
  --group_left;
  if (group_left == 0) {
    analog_mean[group.channel] = static_cast<uint16_t>(group_sum << group.shift);
    if (group_now == 0) start_group(1);
  } else if (group_left != kRun) {
    ADCSRA |= _BV(ADSC);
  }
}

ISR(USART_RX_vect) { received.push(UDR0); }

ISR(USART_UDRE_vect) {
  uint8_t byte;
  if (sending.pop(&byte)) {
    UDR0 = byte;
  } else {
    UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
  }
}

ISR(PCINT0_vect) {
  if (!(PINB & _BV(PINB4))) ++pulses;
}

namespace daranti {

namespace {

static_assert(pins::kSteerEnable == 9 && pins::kSteerLpwm == 10, "timer 1 drives PB1 and PB2");
static_assert(pins::kDriveEnable == 3 && pins::kDriveLpwm == 11, "timer 2 drives PD3 and PB3");
static_assert(pins::kHall == 12, "PCINT4 is PB4");

// Uno pins 0-7 are port D, 8-13 port B.
volatile uint8_t &port_of(uint8_t pin) { return pin < 8 ? PORTD : PORTB; }
uint8_t mask_of(uint8_t pin) { return static_cast<uint8_t>(1U << (pin < 8 ? pin : pin - 8)); }

void make_output(uint8_t pin) { (pin < 8 ? DDRD : DDRB) |= mask_of(pin); }

// Connects a compare output to its pin, or leaves the pin to its port.
void connect(volatile uint8_t &control, uint8_t bit, bool connected) {
  if (connected) {
    control |= bit;
  } else {
    control &= static_cast<uint8_t>(~bit);
  }
}

}  // namespace

void UnoBoard::begin() {
  constexpr uint8_t kOutputs[] = {
      pins::kSteerEnable, pins::kSteerLpwm, pins::kSteerIn1, pins::kSteerIn2, pins::kDriveEnable,
      pins::kDriveLpwm,   pins::kDriveIn1,  pins::kDriveIn2, pins::kBlade,    pins::kLed};
  for (const uint8_t pin : kOutputs) {
    port_of(pin) &= static_cast<uint8_t>(~mask_of(pin));
    make_output(pin);
  }
  constexpr uint8_t kPullUps[] = {pins::kEstop, pins::kHall};
  for (const uint8_t pin : kPullUps) port_of(pin) |= mask_of(pin);

  PCMSK0 = _BV(PCINT4);
  PCICR = _BV(PCIE0);

  // UART, double speed: 117647 baud, 2.1 % fast, as the Arduino core has it (table 19-12).
  UBRR0 = F_CPU / 8 / protocol::kBaud;
  UCSR0A = _BV(U2X0);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);

  // 125 kHz. The first conversion takes twice as long (23.4): have it behind us.
  ADMUX = _BV(REFS0);
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
  loop_until_bit_is_set(ADCSRA, ADIF);
  ADCSRA |= _BV(ADIF) | _BV(ADIE);
  DIDR0 = _BV(ADC0D) | _BV(ADC1D) | _BV(ADC2D) | _BV(ADC3D);

  wdt_enable(WDTO_30MS);
  set_sleep_mode(SLEEP_MODE_IDLE);
}

void UnoBoard::wait_for_tick() {
  if (TCCR0B == 0) {
    TCCR0A = _BV(WGM01);  // clear on compare: 16 MHz / 64 / 250
    OCR0A = 249;
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
    start_group(kStartAt[0]);
  }
  cli();
  while (!tick_due) {
    sleep_enable();
    sei();  // takes effect after the next instruction, so no interrupt can come between
    sleep_cpu();
    sleep_disable();
    cli();
  }
  tick_due = false;
  tick_us_ = clock_ms * 1000;
  sei();
}

uint16_t UnoBoard::analog(Analog channel) const {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { return analog_mean[static_cast<uint8_t>(channel)]; }
  __builtin_unreachable();
}

bool UnoBoard::pin(uint8_t pin) const { return ((pin < 8 ? PIND : PINB) & mask_of(pin)) != 0; }

uint16_t UnoBoard::hall_pulses() const {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { return pulses; }
  __builtin_unreachable();
}

void UnoBoard::set_pin(uint8_t pin, bool level) { connect(port_of(pin), mask_of(pin), level); }

// At 0 the pin is taken from its timer, so that off means off at once and without a glitch.
void UnoBoard::set_pwm(uint8_t pin, uint8_t duty) {
  const uint16_t steer = static_cast<uint16_t>((steer_scale_ * duty + (uint32_t{1} << 15)) >> 16);
  switch (pin) {
    case pins::kSteerEnable:
      ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { OCR1A = steer; }
      connect(TCCR1A, _BV(COM1A1), duty != 0);
      break;
    case pins::kSteerLpwm:
      ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { OCR1B = steer; }
      connect(TCCR1A, _BV(COM1B1), duty != 0);
      break;
    case pins::kDriveEnable:
      OCR2B = duty;
      connect(TCCR2A, _BV(COM2B1), duty != 0);
      break;
    case pins::kDriveLpwm:
      OCR2A = duty;
      connect(TCCR2A, _BV(COM2A1), duty != 0);
      break;
  }
}

void UnoBoard::set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) {
  // Timer 1: phase and frequency correct, top in ICR1 (15.9.5). 123 Hz and up fit 16 bits.
  const uint32_t top = (F_CPU / 2 + steer_hz - 1) / steer_hz;
  ICR1 = static_cast<uint16_t>(top > UINT16_MAX ? UINT16_MAX : top);
  steer_scale_ = ((static_cast<uint32_t>(ICR1) << 16) + 254) / 255;
  TCCR1A = 0;
  TCCR1B = _BV(WGM13) | _BV(CS10);
  // Timer 2: phase correct, top 255 (17.7.4): 16 MHz / 510 / prescaler.
  constexpr struct {
    uint16_t hz;
    uint8_t clock;
  } kRates[] = {{3922, _BV(CS21)},
                {981, _BV(CS21) | _BV(CS20)},
                {491, _BV(CS22)},
                {246, _BV(CS22) | _BV(CS20)}};
  uint8_t clock = _BV(CS22) | _BV(CS21);  // 123 Hz
  for (const auto &rate : kRates) {
    if (drive_hz >= rate.hz) {
      clock = rate.clock;
      break;
    }
  }
  TCCR2A = _BV(WGM20);
  TCCR2B = clock;
}

bool UnoBoard::receive(uint8_t *byte) { return received.pop(byte); }

bool UnoBoard::send(const uint8_t *bytes, uint8_t count) {
  if (sending.room() < count) return false;
  for (uint8_t i = 0; i < count; ++i) sending.push(bytes[i]);
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
  return true;
}

uint8_t UnoBoard::load(uint16_t address) const {
  EEAR = address;
  EECR |= _BV(EERE);
  return EEDR;
}

void UnoBoard::store(uint16_t address, uint8_t byte) {
  EEAR = address;
  EEDR = byte;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {  // 8.6.3: EEPE within four cycles of EEMPE
    EECR = _BV(EEMPE);
    EECR |= _BV(EEPE);
  }
}

bool UnoBoard::storing() const { return (EECR & _BV(EEPE)) != 0; }

void UnoBoard::kick_watchdog() { wdt_reset(); }

uint8_t UnoBoard::reset_cause() const { return mcusr; }

uint16_t HilBoard::analog(Analog channel) const {
  const uint16_t millivolts[] = {sensors_.pot, sensors_.battery, sensors_.steer_current,
                                 sensors_.drive_current};
  const uint32_t millivolt = millivolts[static_cast<uint8_t>(channel)];
  return static_cast<uint16_t>((millivolt < 5000 ? millivolt : 5000) * 1023 / 5000 * 16);
}

bool HilBoard::pin(uint8_t pin) const {
  return pin == pins::kEstop ? sensors_.estop != 0 : UnoBoard::pin(pin);
}

void HilBoard::set_pin(uint8_t pin, bool level) {
  if (pin == pins::kLed) UnoBoard::set_pin(pin, level);
}

bool HilBoard::inject(const protocol::HilSensors &sensors) {
  sensors_ = sensors;
  return true;
}

}  // namespace daranti
