#include "atmega.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "pulse_filter.h"
#include "selected.h"

// The ATmega2560 has four UARTs and numbers them.
#if defined(USART0_RX_vect)
#define DARANTI_RX_vect USART0_RX_vect
#define DARANTI_UDRE_vect USART0_UDRE_vect
#else
#define DARANTI_RX_vect USART_RX_vect
#define DARANTI_UDRE_vect USART_UDRE_vect
#endif

namespace daranti {
namespace {

static_assert(pins::kSteerPwm == kOc1a && pins::kSteerLpwm == kOc1b, "timer 1 steers");
static_assert(pins::kDrivePwm == kOc2b && pins::kDriveLpwm == kOc2a, "timer 2 drives");

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
  // All or, where they do not fit, none.
  bool push(const uint8_t *bytes, uint8_t count) {
    uint8_t at = head_;
    if (static_cast<uint8_t>((tail_ - at - 1) & (kSize - 1)) < count) return false;
    for (; count != 0; --count) {
      bytes_[at] = *bytes++;
      at = (at + 1) & (kSize - 1);
    }
    head_ = at;
    return true;
  }
  bool pop(uint8_t *byte) {
    if (head_ == tail_) return false;
    *byte = bytes_[tail_];
    tail_ = (tail_ + 1) & (kSize - 1);
    return true;
  }

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
PulseFilter filter;                       // the interrupt's; read with interrupts off
volatile uint16_t overruns, line_errors;

void count(volatile uint16_t &trouble) {
  const uint16_t now = trouble;
  if (now != UINT16_MAX) trouble = now + 1;
}

// ---- what outlives a reset ----------------------------------------------------------------------

constexpr uint8_t kWasArmed = 1;
constexpr uint8_t kHung = 2;
constexpr uint16_t kKept = 0xDA4A;
struct Kept {
  uint16_t magic;
  uint8_t flags;
  uint8_t inverse;  // of the flags
};
volatile Kept kept __attribute__((section(".noinit")));
uint8_t cause __attribute__((section(".noinit")));  // of this start

void keep(uint8_t flags) {
  kept.magic = kKept;
  kept.flags = flags;
  kept.inverse = static_cast<uint8_t>(~flags);
}

#if defined(__AVR_ATmega328P__)
// From version 5 on Optiboot leaves in r2 what MCUSR was; its version stands in flash's last byte.
// From 7 on it leaves MCUSR, too. Before, it ends by the watchdog after a reset by the pin, as when
// the port is opened, and r2 then has that alone: the watchdog's bit says nothing there.
bool bootloader_tells() {
  const uint8_t version = pgm_read_byte(FLASHEND);
  return version >= 5 && version < 0x80;
}
#else
bool bootloader_tells() { return false; }
#endif

uint8_t cause_of(uint8_t mcusr, uint8_t r2) {
  const bool valid = kept.magic == kKept && static_cast<uint8_t>(kept.flags ^ kept.inverse) == 0xFF;
  const uint8_t flags = valid ? kept.flags : uint8_t{0};
  const uint8_t armed = (flags & kWasArmed) ? uint8_t{protocol::WHILE_ARMED} : uint8_t{0};
  if (flags & kHung) return protocol::BY_WATCHDOG | armed;
  if (mcusr == 0 && bootloader_tells()) mcusr = static_cast<uint8_t>(r2 & ~_BV(WDRF));
  uint8_t found = 0;
  if (mcusr & _BV(PORF)) found |= protocol::BY_POWER_ON;
  if (mcusr & _BV(EXTRF)) found |= protocol::BY_RESET_PIN;
  // A supply that rises slowly shows as a brown-out, too; the memory's contents tell them apart.
  if ((mcusr & _BV(BORF)) && (valid || !(mcusr & _BV(PORF)))) found |= protocol::BY_BROWN_OUT;
  if (mcusr & _BV(WDRF)) found |= protocol::BY_WATCHDOG;
  return (found != 0 ? found : uint8_t{protocol::BY_UNKNOWN}) | armed;
}

// ---- outputs ------------------------------------------------------------------------------------

__attribute__((always_inline)) inline void write(uint8_t pin, bool level) {
  const Port port = port_of(pin);
  if (level) {
    port.out |= mask_of(pin);
  } else {
    port.out &= static_cast<uint8_t>(~mask_of(pin));
  }
}
__attribute__((always_inline)) inline bool read(uint8_t pin) {
  return (port_of(pin).in & mask_of(pin)) != 0;
}

// Connects a compare output to its pin, or leaves the pin to its port, which is low.
__attribute__((always_inline)) inline void connect(volatile uint8_t &control, uint8_t bit,
                                                   bool connected) {
  if (connected) {
    control |= bit;
  } else {
    control &= static_cast<uint8_t>(~bit);
  }
}

// Low.
__attribute__((always_inline)) inline void make_output(uint8_t pin) {
  write(pin, false);
  port_of(pin).direction |= mask_of(pin);
}

void all_off() {
  TCCR1A = 0;
  TCCR2A = 0;
  make_output(pins::kSteerPwm);
  make_output(pins::kSteerLpwm);
  make_output(pins::kDrivePwm);
  make_output(pins::kDriveLpwm);
  make_output(pins::kBlade);
  make_output(pins::kSteerIn1);
  make_output(pins::kSteerIn2);
  make_output(pins::kDriveIn1);
  make_output(pins::kDriveIn2);
}

// ---- the clock: samples every 200 us, conversions every millisecond, the tick -------------------

// The tick's period has five milliseconds. Each of the first four begins a run of eight
// conversions, so that a voltage that changes every millisecond is sampled whole; the pot comes
// last, for it must be freshest. The tick comes in the fifth. A conversion takes 112 us: 13 of the
// converter's clocks, and the rest of the one within which the interrupt asks for it (23.4).
constexpr uint8_t kTickAt = 4;
constexpr uint8_t kRun = 8;
constexpr uint8_t kSamplesPerMs = 5;
struct Group {
  uint8_t channel;
  uint8_t count;  // of conversions
  uint8_t shift;  // scales their sum to 16 conversions
  Analog means;
  bool leads_on;  // to the next group, in the same run
};
constexpr Group kGroups[] = {{pins::kBatteryChannel, 4, 2, Analog::kBattery, true},
                             {pins::kSteerCurrentChannel, 4, 2, Analog::kSteerCurrent, false},
                             {pins::kDriveCurrentChannel, 4, 2, Analog::kDriveCurrent, true},
                             {pins::kEstopChannel, 4, 2, Analog::kEstop, false},
                             {pins::kPotChannel, 16, 0, Analog::kPot, false}};
constexpr uint8_t kPaused = UINT8_MAX;                     // go on with the group under way
constexpr uint8_t kStartAt[kTickAt] = {0, 2, 4, kPaused};  // group by millisecond

uint8_t group_now;
uint8_t group_left;
uint16_t group_sum;

void start_group(uint8_t group) {
  group_now = group;
  group_left = kGroups[group].count;
  group_sum = 0;
  ADMUX = static_cast<uint8_t>(_BV(REFS0) | kGroups[group].channel);
  ADCSRA |= _BV(ADSC);
}

__attribute__((always_inline)) inline void sample() {
  uint8_t levels = 0;
  if (read(pins::kHall)) levels |= PulseFilter::kA;
  if (read(pins::kHallB)) levels |= PulseFilter::kB;
  if (read(pins::kBladeTurn)) levels |= PulseFilter::kTurn;
  filter.sample(levels);
}

}  // namespace
}  // namespace daranti

// Run before main(), in this order: r2 is still the bootloader's.
extern "C" {
static volatile uint8_t daranti_r2 __attribute__((section(".noinit"), used));
void daranti_keep_r2(void) __attribute__((naked, used, section(".init0")));
void daranti_keep_r2(void) { asm volatile("sts %0, r2" ::"i"(&daranti_r2)); }
void daranti_keep_cause(void) __attribute__((naked, used, section(".init3")));
void daranti_keep_cause(void) {
  // A watchdog that caused the reset still runs, with its shortest time.
  daranti::cause = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

// The main loop hangs: all off at once, and the program anew. A reset would do the same, but on an
// old Nano it would never come back: the bootloader there leaves the watchdog running.
void daranti_hung(void) __attribute__((noreturn, used));
void daranti_hung(void) {
  SP = RAMEND;
  daranti::all_off();
  wdt_disable();
  daranti::keep(static_cast<uint8_t>(daranti::kept.flags | daranti::kHung));
  asm volatile("jmp 0");
  __builtin_unreachable();
}
}

// Two stages of 16 ms each: this, and the hardware's reset where interrupts are off.
ISR(WDT_vect, ISR_NAKED) { asm volatile("clr __zero_reg__\n\tjmp daranti_hung"); }

ISR(TIMER0_COMPA_vect) {
  using namespace daranti;
  static uint8_t samples = 0;
  static uint8_t next = 1;
  sample();
  if (++samples != kSamplesPerMs) return;
  samples = 0;
  const uint8_t phase = next;
  next = phase + 1 == kTickMs ? 0 : phase + 1;
  ++clock_ms;
  if (phase == kTickAt) {
    if (tick_due) count(overruns);
    tick_due = true;
  } else if (kStartAt[phase] == kPaused) {
    ADCSRA |= _BV(ADSC);
  } else {
    start_group(kStartAt[phase]);
  }
}

ISR(ADC_vect) {
  using namespace daranti;
  const Group &group = kGroups[group_now];
  group_sum += ADC;
  --group_left;
  if (group_left == 0) {
    analog_mean[static_cast<uint8_t>(group.means)] =
        static_cast<uint16_t>(group_sum << group.shift);
    if (group.leads_on) start_group(static_cast<uint8_t>(group_now + 1));
  } else if (group_left != kRun) {
    ADCSRA |= _BV(ADSC);
  }
}

ISR(DARANTI_RX_vect) {
  using namespace daranti;
  const uint8_t status = UCSR0A;  // before UDR0, which changes it
  const uint8_t byte = UDR0;
  if (status & (_BV(FE0) | _BV(DOR0))) count(line_errors);
  if (!(status & _BV(FE0)) && !received.push(byte)) count(line_errors);
}

ISR(DARANTI_UDRE_vect) {
  using namespace daranti;
  uint8_t byte;
  if (sending.pop(&byte)) {
    UDR0 = byte;
  } else {
    UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
  }
}

namespace daranti {

void AtmegaBoard::begin() {
  cause = cause_of(cause, daranti_r2);
  keep(0);
  all_off();
  make_output(pins::kLamp);
  write(pins::kHall, true);  // pull-ups
  write(pins::kHallB, true);
  write(pins::kBladeTurn, true);

  // Timer 0 clears on compare: 16 MHz / 64 / 50 = 5 kHz. It starts with the first tick.
  TCCR0B = 0;
  TCCR0A = _BV(WGM01);
  OCR0A = 49;
  TCNT0 = 0;
  TIFR0 = _BV(OCF0A);
  TIMSK0 = _BV(OCIE0A);

  // UART, double speed, rounded to nearest: 16, which is 117647 baud, 2.1 % fast (table 19-12). The
  // USB chip of an Uno or Mega is as fast, since it divides the same 16 MHz.
  UBRR0 = (F_CPU / 4 / protocol::kBaud + 1) / 2 - 1;
  UCSR0A = _BV(U2X0);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);

  // 125 kHz. The first conversion takes twice as long (23.4): have it behind us.
  ADMUX = _BV(REFS0);
  ADCSRB = 0;
  ADCSRA = _BV(ADIF);  // off, and no conversion pending from before a hang
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
  loop_until_bit_is_clear(ADCSRA, ADSC);
  ADCSRA |= _BV(ADIF) | _BV(ADIE);
  DIDR0 = _BV(ADC0D) | _BV(ADC1D) | _BV(ADC2D) | _BV(ADC3D);  // the e-stop's pin is read

  // A byte that was being written goes on over a reset, and nothing can be read meanwhile (8.6.3).
  loop_until_bit_is_clear(EECR, EEPE);

  wdt_reset();
  ATOMIC_BLOCK(ATOMIC_FORCEON) {  // 10.9.2: the change within four cycles
    WDTCSR = _BV(WDCE) | _BV(WDE);
    WDTCSR = _BV(WDIE) | _BV(WDE);
  }
  set_sleep_mode(SLEEP_MODE_IDLE);
}

void AtmegaBoard::wait_for_tick() {
  if (TCCR0B == 0) {
    TCCR0B = _BV(CS01) | _BV(CS00);
    start_group(kStartAt[0]);
  }
  cli();
  if (tick_due) count(overruns);
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

uint16_t AtmegaBoard::analog(Analog channel) const {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { return analog_mean[static_cast<uint8_t>(channel)]; }
  __builtin_unreachable();
}

bool AtmegaBoard::estop_open() const { return read(pins::kEstop); }

Pulses AtmegaBoard::pulses() const {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { return filter.pulses(); }
  __builtin_unreachable();
}

Troubles AtmegaBoard::troubles() const {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { return {overruns, line_errors}; }
  __builtin_unreachable();
}

namespace {

constexpr uint8_t kSteerMode = _BV(WGM13) | _BV(CS10);  // of timer 1: top in ICR1, not divided
constexpr uint8_t kDriveMode = _BV(WGM20);              // of timer 2: phase correct, top 255

// The two inputs of a bridge: what goes low goes first.
__attribute__((always_inline)) inline void set_inputs(uint8_t in1, uint8_t in2,
                                                      const BridgeWires &wires) {
  if (!wires.in1) write(in1, false);
  if (!wires.in2) write(in2, false);
  if (wires.in1) write(in1, true);
  if (wires.in2) write(in2, true);
}

}  // namespace

// At 0 a pin is taken from its timer, so that off means off at once and without a glitch. A pin
// that its timer gets is to have its own duty from the first: in its PWM modes a timer goes on with
// the old compare value to the period's end, up to 8 ms, so the new one is written in the normal
// mode, past the buffer, and then into it (15.7, 17.5). The timer is free then, for a bridge has
// one PWM at a time.
void AtmegaBoard::set_bridge(Motor motor, const BridgeWires &wires) {
  if (motor == Motor::kSteer) {
    const bool turns = read(pins::kSteerIn1) != wires.in1 || read(pins::kSteerIn2) != wires.in2;
    if (turns || wires.pwm == 0) connect(TCCR1A, _BV(COM1A1), false);
    if (wires.lpwm == 0) connect(TCCR1A, _BV(COM1B1), false);
    set_inputs(pins::kSteerIn1, pins::kSteerIn2, wires);
    const uint32_t half = uint32_t{1} << 15;
    const uint16_t a = static_cast<uint16_t>((steer_scale_ * wires.pwm + half) >> 16);
    const uint16_t b = static_cast<uint16_t>((steer_scale_ * wires.lpwm + half) >> 16);
    if (TCCR1A == 0 && (wires.pwm | wires.lpwm) != 0) {
      TCCR1B = 0;
      OCR1A = a;
      OCR1B = b;
      TCNT1 = 0;
      TCCR1B = kSteerMode;
    }
    OCR1A = a;
    OCR1B = b;
    if (wires.pwm != 0) connect(TCCR1A, _BV(COM1A1), true);
    if (wires.lpwm != 0) connect(TCCR1A, _BV(COM1B1), true);
  } else {
    const bool turns = read(pins::kDriveIn1) != wires.in1 || read(pins::kDriveIn2) != wires.in2;
    if (turns || wires.pwm == 0) connect(TCCR2A, _BV(COM2B1), false);
    if (wires.lpwm == 0) connect(TCCR2A, _BV(COM2A1), false);
    set_inputs(pins::kDriveIn1, pins::kDriveIn2, wires);
    if (TCCR2A == kDriveMode && (wires.pwm | wires.lpwm) != 0) {
      TCCR2A = 0;
      OCR2B = wires.pwm;
      OCR2A = wires.lpwm;
      TCNT2 = 0;
      TCCR2A = kDriveMode;
    }
    OCR2B = wires.pwm;
    OCR2A = wires.lpwm;
    if (wires.pwm != 0) connect(TCCR2A, _BV(COM2B1), true);
    if (wires.lpwm != 0) connect(TCCR2A, _BV(COM2A1), true);
  }
}

void AtmegaBoard::set_pwm_frequency(uint16_t steer_hz, uint16_t drive_hz) {
  // Timer 1: phase and frequency correct, top in ICR1 (15.9.5), which takes a value only where the
  // mode has it for its top (15.6). 123 Hz and up fit 16 bits.
  const uint32_t top = (F_CPU / 2 + steer_hz - 1) / steer_hz;
  TCCR1A = 0;
  TCCR1B = _BV(WGM13);  // stopped, so that it cannot be beyond its new top
  ICR1 = static_cast<uint16_t>(top > UINT16_MAX ? UINT16_MAX : top);
  TCNT1 = 0;
  steer_scale_ = ((static_cast<uint32_t>(ICR1) << 16) + 254) / 255;
  TCCR1B = kSteerMode;
  // Timer 2: phase correct, top 255 (17.7.4): 16 MHz / 510 / prescaler, to the nearest hertz.
  constexpr struct {
    uint16_t hz;
    uint8_t clock;
  } kRates[] = {{3922, _BV(CS21)},
                {980, _BV(CS21) | _BV(CS20)},
                {490, _BV(CS22)},
                {245, _BV(CS22) | _BV(CS20)}};
  uint8_t clock = _BV(CS22) | _BV(CS21);  // 123 Hz
  for (const auto &rate : kRates) {
    if (drive_hz >= rate.hz) {
      clock = rate.clock;
      break;
    }
  }
  TCCR2A = kDriveMode;
  TCCR2B = clock;
}

void AtmegaBoard::set_blade(bool on) { write(pins::kBlade, on); }

void AtmegaBoard::set_lamp(bool on) { write(pins::kLamp, on); }

bool AtmegaBoard::receive(uint8_t *byte) { return received.pop(byte); }

bool AtmegaBoard::send(const uint8_t *bytes, uint8_t count) {
  if (!sending.push(bytes, count)) return false;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { UCSR0B |= _BV(UDRIE0); }
  return true;
}

uint8_t AtmegaBoard::load(uint16_t address) const {
  EEAR = address;
  EECR |= _BV(EERE);
  return EEDR;
}

void AtmegaBoard::store(uint16_t address, uint8_t byte) {
  EEAR = address;
  EEDR = byte;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {  // 8.6.3: EEPE within four cycles of EEMPE
    EECR = _BV(EEMPE);
    EECR |= _BV(EEPE);
  }
}

bool AtmegaBoard::storing() const { return (EECR & _BV(EEPE)) != 0; }

void AtmegaBoard::kick_watchdog() { wdt_reset(); }

void AtmegaBoard::remember_armed(bool armed) { keep(armed ? kWasArmed : uint8_t{0}); }

uint8_t AtmegaBoard::reset_cause() const { return cause; }

uint16_t HilBoard::analog(Analog channel) const {
  const uint16_t millivolts[] = {sensors_.pot, sensors_.battery, sensors_.steer_current,
                                 sensors_.drive_current, sensors_.estop};
  const uint32_t millivolt = millivolts[static_cast<uint8_t>(channel)];
  return static_cast<uint16_t>((millivolt < 5000 ? millivolt : 5000) * 1023 / 5000 * 16);
}

bool HilBoard::inject(const protocol::HilSensors &sensors) {
  sensors_ = sensors;
  return true;
}

}  // namespace daranti
