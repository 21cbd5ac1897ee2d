"""The simulator's shim against the datasheets: registers are written by hand, as no firmware of
ours does, and the pins, the line and the memory must do what the chip would.

Numbers in brackets are chapters of the ATmega328P's datasheet (DS40002061B).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest

from hil.firmware import provision, targets
from hil.firmware.targets import (
    FLOATING,
    PULLED_UP,
    Board,
    Hang,
    ResetCause,
    Target,
    TargetError,
    image_of,
)
from host.link import protocol
from tests.firmware.test_boards import OPTIBOOT

FITTED = provision.eeprom(tuple(provision.FITTED.items()))
TICK_US: Final = 5000
SAMPLE_US: Final = 200
EECR, EEDR, EEARL, EEARH = 0x3F, 0x40, 0x41, 0x42
EERE, EEPE, EEMPE = 1, 2, 4
TCCR1A, TCCR1B, ICR1L, ICR1H, OCR1AL, OCR1AH = 0x80, 0x81, 0x86, 0x87, 0x88, 0x89
TCCR2A, TCCR2B, OCR2A, OCR2B = 0xB0, 0xB1, 0xB3, 0xB4
DDRB, DDRD, PORTD = 0x24, 0x2A, 0x2B
ADCSRA, ADMUX = 0x7A, 0x7C
MCUSR, WDTCSR = 0x54, 0x60
UCSR0A, UCSR0B, UCSR0C, UBRR0L = 0xC0, 0xC1, 0xC2, 0xC4

Maker = Callable[..., "Chip"]


class Chip:
    """A board in simavr between two ticks, its registers at hand."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.now_us = 0
        for channel, millivolt in enumerate((2502, 3000, 2500, 2500, 880)):
            target.set_analog_mv(channel, millivolt)
        library = ctypes.CDLL(str(targets.AVR_LIBRARY))
        self._write = library.probe_write
        self._write.argtypes = [ctypes.c_void_p, ctypes.c_uint16, ctypes.c_uint8]
        self._read = library.probe_register
        self._read.argtypes = [ctypes.c_void_p, ctypes.c_uint16]
        self._read.restype = ctypes.c_uint8
        self._pin = library.probe_pin
        self._pin.argtypes = [ctypes.c_void_p, ctypes.c_uint8]
        self._pin.restype = ctypes.c_uint8
        # The pot's conversions have begun: until the next period no other register is written.
        self.run(20 * TICK_US + 2500)

    def run(self, us: int) -> None:
        """Runs on."""
        self.now_us += us
        self.target.run_until(self.now_us)

    def write(self, *registers: tuple[int, int]) -> None:
        """Writes (address, value) pairs in turn, as instructions would."""
        for address, value in registers:
            self._write(self.target.handle, address, value)

    def read(self, address: int) -> int:
        """A register."""
        return int(self._read(self.target.handle, address))

    def level(self, pin: int) -> bool:
        """What the firmware sees at a pin."""
        return bool(self._pin(self.target.handle, pin))

    def refuses(self, what: str) -> None:
        """The run ends with these words. A processor that sleeps goes on to its next sample."""
        with pytest.raises(TargetError, match=what):
            self.run(SAMPLE_US)


@pytest.fixture
def make() -> Iterator[Maker]:
    """Makes chips, and closes them after the test."""
    made: list[Chip] = []

    def one(board: Board = "uno", bootloader: Path | None = None) -> Chip:
        for needed in (targets.AVR_LIBRARY, image_of(board), bootloader):
            if needed is not None and not needed.exists():
                pytest.skip(f"not there: {needed}")
        made.append(Chip(targets.avr(FITTED, board, bootloader)))
        return made[-1]

    yield one
    for each in made:
        each.target.close()


# ---- pins and timers -----------------------------------------------------------------------------


def test_a_pin_drives_floats_or_is_pulled_up_as_its_port_says(make: Maker) -> None:
    chip = make()
    for direction, port, expected in (
        (0x20, 0x00, 0),
        (0x20, 0x20, 255),
        (0x00, 0x20, PULLED_UP),
        (0x00, 0x00, FLOATING),
    ):
        chip.write((DDRD, direction), (PORTD, port))
        assert chip.target.output(5) == expected


@pytest.mark.parametrize(
    ("control", "clock", "a", "b", "expected"),
    [
        (0x21, 0x02, 0, 64, 64),  # phase correct, top 255 (17.7.4)
        (0x31, 0x02, 0, 64, 191),  # the same inverted
        (0x23, 0x02, 0, 63, 64),  # fast: a count more (17.7.3)
        (0x33, 0x02, 0, 63, 191),
        (0x21, 0x0A, 128, 32, 64),  # phase correct up to OCR2A
        (0x23, 0x0A, 127, 31, 64),  # fast up to OCR2A
        (0x21, 0x07, 0, 64, 64),  # any prescaler
        (0x21, 0x02, 0, 0, 0),
        (0x21, 0x02, 0, 255, 255),
        (0x21, 0x02, 0, 1, 1),
        (0x21, 0x02, 0, 254, 254),
        (0x01, 0x02, 0, 64, 0),  # not connected: the port's level
    ],
)
def test_timer_2_gives_the_duty_of_its_mode(
    make: Maker, control: int, clock: int, a: int, b: int, expected: int
) -> None:
    chip = make()
    chip.write((TCCR2A, control), (TCCR2B, clock), (OCR2A, a), (OCR2B, b))
    assert chip.target.output(3) == expected


@pytest.mark.parametrize(
    ("control", "mode", "top", "at", "expected"),
    [
        (0x80, 0x11, 400, 100, 64),  # phase and frequency correct, top ICR1 (15.9.5)
        (0xC0, 0x11, 400, 100, 191),
        (0x82, 0x11, 400, 100, 64),  # phase correct, top ICR1
        (0x82, 0x19, 399, 99, 64),  # fast, top ICR1
        (0x81, 0x01, 400, 64, 64),  # phase correct, 8 bits, whatever ICR1 is
        (0x82, 0x01, 400, 128, 64),  # 9 bits
        (0x83, 0x01, 400, 256, 64),  # 10 bits
        (0x81, 0x09, 400, 63, 64),  # fast, 8 bits
        (0x80, 0x11, 0x1000, 0x0800, 128),  # both bytes count
    ],
)
def test_timer_1_gives_the_duty_of_its_mode(
    make: Maker, control: int, mode: int, top: int, at: int, expected: int
) -> None:
    chip = make()
    chip.write((TCCR1A, 0x00), (TCCR1B, 0x11), (ICR1H, top >> 8), (ICR1L, top & 0xFF))
    chip.write((TCCR1A, control), (TCCR1B, mode), (OCR1AH, at >> 8), (OCR1AL, at & 0xFF))
    assert chip.target.output(9) == expected


@pytest.mark.parametrize(
    ("control", "clock"),
    [
        (0x21, 0x00),  # stopped
        (0x11, 0x02),  # toggles
        (0x22, 0x02),  # clears on compare, no PWM
        (0x20, 0x02),
    ],
)
def test_an_output_of_a_timer_that_gives_no_duty_ends_the_run(
    make: Maker, control: int, clock: int
) -> None:
    chip = make()
    chip.write((TCCR2A, control), (TCCR2B, clock))
    chip.refuses("pin 3: its timer is stopped")


STALE = "an output is connected while its compare register holds another value"


@pytest.mark.parametrize(
    ("stop", "value", "again"),
    [
        ([], [(OCR2A, 0), (OCR2B, 200)], []),  # waits in the buffer
        # past the buffer, which still holds what is taken at the period's end
        ([(TCCR2A, 0)], [(OCR2B, 200)], [(TCCR2A, 0x01)]),
    ],
)
def test_an_output_connected_before_its_compare_register_is_taken_ends_the_run(
    make: Maker,
    stop: list[tuple[int, int]],
    value: list[tuple[int, int]],
    again: list[tuple[int, int]],
) -> None:
    chip = make()
    chip.write((TCCR2A, 0x01), (TCCR2B, 0x02), (OCR2B, 10))
    chip.run(SAMPLE_US)
    chip.run(SAMPLE_US)
    chip.write(*stop, *value, *again, (TCCR2A, 0x21))
    chip.refuses(STALE)


def test_a_compare_register_is_in_force_a_period_later_or_written_past_its_buffer(
    make: Maker,
) -> None:
    chip = make()
    chip.write((TCCR2A, 0x01), (TCCR2B, 0x02), (OCR2B, 10))
    chip.run(2 * SAMPLE_US)  # 510 * 8 cycles are 255 us
    chip.write((TCCR2A, 0x21))
    chip.run(SAMPLE_US)
    chip.write((TCCR2A, 0x00), (OCR2B, 200), (TCCR2A, 0x01), (OCR2B, 200), (TCCR2A, 0x21))
    chip.run(SAMPLE_US)
    chip.write((TCCR1A, 0), (TCCR1B, 0x11), (OCR1AH, 1), (OCR1AL, 0), (TCCR1A, 0x80))
    chip.refuses(STALE)


def test_a_timer_1_clocked_from_outside_ends_the_run(make: Maker) -> None:
    chip = make()
    chip.write((TCCR1A, 0x80), (TCCR1B, 0x16))
    chip.refuses("pin 9: its timer is stopped, clocked from outside")


@pytest.mark.parametrize("control", (0x00, 0x01, 0x03))
def test_the_top_is_not_taken_in_a_mode_that_has_another(make: Maker, control: int) -> None:
    chip = make()
    chip.write((TCCR1A, control), (TCCR1B, 0x01), (ICR1H, 1), (ICR1L, 0))
    chip.refuses("ICR1: takes a value only in a mode")


def test_an_output_that_is_driven_from_outside_ends_the_run(make: Maker) -> None:
    chip = make()
    chip.target.set_pin(12, True)
    chip.run(10)
    assert chip.level(12)
    chip.write((DDRB, 0x10 | 0x2E))
    chip.refuses("pin 12 is an output, but is driven from outside")


def test_the_e_stop_s_pin_is_high_from_3_volt_and_low_up_to_1_5(make: Maker) -> None:
    """0.6 and 0.3 of the supply (29.2); between them it stays as it was."""
    chip = make()
    for millivolt, high in ((2999, False), (3000, True), (1501, True), (1500, False)):
        chip.target.set_analog_mv(4, millivolt)
        chip.run(10)
        assert chip.level(18) is high, millivolt


# ---- converter -----------------------------------------------------------------------------------


@pytest.mark.parametrize("reference", (0x00, 0x80, 0xC0))
def test_a_reference_other_than_the_supply_ends_the_run(make: Maker, reference: int) -> None:
    chip = make()
    chip.write((ADMUX, reference))
    chip.refuses("ADMUX: the reference is not AVCC")


@pytest.mark.parametrize(("prescaler", "khz"), [(6, 250), (4, 1000), (0, 8000)])
def test_a_converter_that_runs_too_fast_ends_the_run(make: Maker, prescaler: int, khz: int) -> None:
    chip = make()
    chip.write((ADCSRA, 0x88 | prescaler))
    chip.refuses(f"ADCSRA: the converter runs at {khz} kHz")


def test_a_conversion_begins_with_the_next_clock_of_the_converter(make: Maker) -> None:
    """23.4: 13 of its clocks of 8 us, and what is left of the one in which it is asked for."""
    chip = make()
    chip.target.hang()  # a processor that sleeps goes on to its next sample
    chip.run(1800)  # in the tick's millisecond none runs
    took, ends = [], set()
    for pause_us in (1, 3, 2, 5, 8):
        chip.run(pause_us)
        begun_us = chip.now_us
        chip.write((ADCSRA, 0xC7))
        while chip.read(ADCSRA) & 0x40:
            chip.run(1)
        took.append(chip.now_us - begun_us)
        ends.add(chip.now_us % 8)
    assert len(ends) == 1
    assert min(took) >= 104
    assert max(took) <= 113
    assert len(set(took)) > 2


def test_a_conversion_asked_for_while_another_runs_ends_the_run(make: Maker) -> None:
    chip = make()
    chip.run(1800)  # in the tick's millisecond none runs
    chip.write((ADCSRA, 0xC7))
    chip.run(SAMPLE_US)  # it takes 104 us
    chip.write((ADCSRA, 0xC7), (ADCSRA, 0xC7))
    chip.refuses("ADCSRA: a conversion is asked for while another runs")


# ---- the line ------------------------------------------------------------------------------------


def byte_times(chip: Chip, settings: tuple[tuple[int, int], ...], count: int = 8) -> list[int]:
    """When the bytes of a frame come, in us, some bytes after the settings were written. The main
    loop hangs, so that the processor does not sleep; the frame is sent all the same."""
    chip.target.read()
    while not chip.target.read():
        chip.run(SAMPLE_US)
    chip.target.hang()
    chip.write(*settings)
    times: list[int] = []
    while len(times) < count + 4:
        chip.run(1)
        times += [chip.target.time_us] * len(chip.target.read())
    return times[4:]


@pytest.mark.parametrize(
    ("settings", "us"),
    [
        ((), 85.0),  # 10 bits of 8 x 17 cycles
        (((UCSR0C, 0x0E),), 93.5),  # two stop bits
        (((UCSR0C, 0x26),), 93.5),  # parity
        (((UCSR0C, 0x04),), 76.5),  # seven bits
        (((UBRR0L, 33),), 170.0),
        (((UCSR0A, 0x00),), 170.0),  # single speed
    ],
)
def test_a_byte_takes_as_long_as_divisor_and_frame_say(
    make: Maker, settings: tuple[tuple[int, int], ...], us: float
) -> None:
    chip = make()
    times = byte_times(chip, settings)
    assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(us, abs=0.3)


@pytest.mark.parametrize(
    ("setting", "understood"),
    [
        ((UCSR0C, 0x06), True),
        ((UCSR0C, 0x0E), True),  # another stop bit is idle line
        ((UCSR0C, 0x26), False),
        ((UCSR0C, 0x04), False),
        ((UCSR0B, 0x9C), False),  # nine bits
        ((UBRR0L, 17), False),  # 111111 baud against 117647
        ((UBRR0L, 15), False),
    ],
)
def test_what_the_firmware_sends_is_understood_in_one_format_only(
    make: Maker, setting: tuple[int, int], understood: bool
) -> None:
    chip = make()
    chip.run(2 * TICK_US)
    chip.target.read()
    chip.write(setting)
    chip.run(8 * TICK_US)
    frames = protocol.Parser().feed(chip.target.read())
    assert bool(frames) is understood


def test_what_the_host_sends_takes_its_time(make: Maker) -> None:
    chip = make()
    chip.target.read()
    begun, parser = chip.now_us, protocol.Parser()
    chip.target.write(bytes(2300) + protocol.encode(protocol.Hello(protocol.VERSION), 0))
    while not any(isinstance(m, protocol.Version) for _, m in parser.feed(chip.target.read())):
        chip.run(100)
    asked_us = 2307 * 85.0
    answered_us = chip.now_us - begun - 19 * 85
    assert asked_us <= answered_us <= asked_us + TICK_US + 30 * 85


def test_two_received_bytes_wait_to_be_read_and_of_four_one_is_lost(make: Maker) -> None:
    """19.7.3: DOR0."""
    chip = make()
    chip.target.hang(Hang.INTERRUPT)
    for count, lost in ((2, False), (2, True)):
        chip.target.write(b"\x01" * count)
        chip.run(85 * count + 100)
        assert bool(chip.read(UCSR0A) & 0x08) is lost


# ---- memory and resets ---------------------------------------------------------------------------


def store(chip: Chip, address: int, byte: int) -> None:
    """As 8.6.3 has it."""
    chip.write((EEARH, address >> 8), (EEARL, address & 0xFF), (EEDR, byte))
    chip.write((EECR, EEMPE), (EECR, EEMPE | EEPE))


def test_a_byte_is_stored_in_its_place(make: Maker) -> None:
    chip = make()
    store(chip, 0x2A5, 0x5A)
    chip.run(4000)
    before, after = bytearray(FITTED), chip.target.eeprom()
    before[0x2A5] = 0x5A
    assert after == bytes(before)


@pytest.mark.parametrize("used", (EERE, EEMPE | EEPE))
@pytest.mark.parametrize(("after_us", "free"), [(3000, False), (3600, True)])
def test_while_a_byte_is_written_the_eeprom_must_not_be_used(
    make: Maker, used: int, after_us: int, free: bool
) -> None:
    """3.4 ms (8.6.3)."""
    chip = make()
    store(chip, 0x2A5, 0x5A)
    chip.run(after_us)
    chip.write((EECR, EEMPE), (EECR, used))
    if free:
        chip.run(SAMPLE_US)
    else:
        chip.refuses("EECR: the EEPROM is used while it still writes")


@pytest.mark.parametrize(
    ("cause", "told"),
    [
        (ResetCause.POWER_ON, protocol.ResetCause.BY_POWER_ON),
        (ResetCause.EXTERNAL, protocol.ResetCause.BY_RESET_PIN),
        (ResetCause.BROWN_OUT, protocol.ResetCause.BY_BROWN_OUT),
        (ResetCause.WATCHDOG, protocol.ResetCause.BY_WATCHDOG),
    ],
)
def test_the_chip_keeps_why_it_was_reset(
    make: Maker, cause: ResetCause, told: protocol.ResetCause
) -> None:
    chip = make()
    chip.target.reset(cause)
    chip.target.write(protocol.encode(protocol.Hello(protocol.VERSION), 0))
    chip.target.read()
    chip.run(4 * TICK_US)
    found = [m for _, m in protocol.Parser().feed(chip.target.read())]
    [version] = [m for m in found if isinstance(m, protocol.Version)]
    assert version.reset_cause == told


@pytest.mark.parametrize(
    ("cause", "kept"), [(ResetCause.POWER_ON, False), (ResetCause.BROWN_OUT, True)]
)
def test_power_on_empties_the_memory_and_other_resets_do_not(
    make: Maker, cause: ResetCause, kept: bool
) -> None:
    chip = make()
    chip.target.write(protocol.encode(protocol.Arm(protocol.VERSION), 0))
    chip.run(2 * TICK_US)
    chip.target.reset(cause)
    chip.target.write(protocol.encode(protocol.Hello(protocol.VERSION), 1))
    chip.target.read()
    chip.run(4 * TICK_US)
    found = [m for _, m in protocol.Parser().feed(chip.target.read())]
    [version] = [m for m in found if isinstance(m, protocol.Version)]
    assert (protocol.ResetCause.WHILE_ARMED in version.reset_cause) is kept


def test_the_causes_of_resets_stay_until_power_on_or_until_a_zero_is_written(make: Maker) -> None:
    """10.9.1. The firmware clears them at each start: here they are set as it runs."""
    chip = make()
    assert chip.read(MCUSR) == 0
    chip.write((MCUSR, 0xFF))
    assert chip.read(MCUSR) == 0
    behind = make("uno", OPTIBOOT)  # whose code has not run yet after each of these
    for cause, kept in (
        (ResetCause.BROWN_OUT, 0x04),
        (ResetCause.EXTERNAL, 0x06),
        (ResetCause.WATCHDOG, 0x0E),
        (ResetCause.POWER_ON, 0x01),
    ):
        behind.target.reset(cause)
        assert behind.read(MCUSR) == kept
    behind.write((MCUSR, 0xFE))
    assert behind.read(MCUSR) == 0


def test_the_watchdog_stays_on_while_its_own_cause_stands(make: Maker) -> None:
    """10.9.2: WDE is overridden by WDRF."""
    chip = make("uno", OPTIBOOT)
    chip.target.reset(ResetCause.WATCHDOG)
    off = ((WDTCSR, 0x18), (WDTCSR, 0x00))
    chip.write(*off)
    assert chip.read(WDTCSR) & 0x08
    chip.write((MCUSR, 0x00), *off)
    assert not chip.read(WDTCSR) & 0x08


def test_inputs_stay_as_they_are_over_a_reset(make: Maker) -> None:
    chip = make()
    chip.target.set_pin(12, True)
    chip.target.set_pin(2, False)
    chip.run(SAMPLE_US)
    chip.target.reset(ResetCause.EXTERNAL)
    chip.run(SAMPLE_US)
    assert chip.level(12)
    assert not chip.level(2)
