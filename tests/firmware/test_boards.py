"""What the boards do with their chips, in simavr: registers against the datasheets, the line's
speed, bootloaders that Debian ships, floating pins, noise.

Every expected number is the datasheets' (ATmega328P DS40002061B, ATmega2560 DS40002211A) or the
wiring's, none is the firmware's.
"""

from __future__ import annotations

import ctypes
import itertools
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hil.firmware import provision, targets
from hil.firmware.targets import (
    BOARDS,
    FLOATING,
    PULLED_UP,
    Board,
    Hang,
    ResetCause,
    Target,
    TargetError,
    image_of,
)
from hil.firmware.wiring import PINS
from host.link import protocol
from host.link.protocol import Fault, State
from host.link.protocol import ResetCause as Started
from host.link.session import Session
from tests.helpers.firmware_bench import TOLD, Bench

ROOT = Path(__file__).resolve().parent.parent.parent
LOADERS = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders")
OPTIBOOT = LOADERS / "optiboot" / "optiboot_atmega328.hex"
OLD_NANO = LOADERS / "atmega" / "ATmegaBOOT_168_atmega328.hex"
MEGA = LOADERS / "stk500v2" / "stk500boot_v2_mega2560.hex"
CHIPS: tuple[tuple[Board, Path], ...] = (("uno", OPTIBOOT), ("nano", OLD_NANO), ("mega2560", MEGA))
FITTED = provision.eeprom(tuple(TOLD.items()))
USB_BAUD, CH340_BAUD = 117_647, 115_200
"""An Uno's or Mega's own USB chip divides 16 MHz by 136; a Nano's CH340 hits the rate."""

Maker = Callable[..., Target]


@pytest.fixture
def make() -> Iterator[Maker]:
    """Makes boards in simavr, and closes them after the test."""
    made: list[Target] = []

    def one(board: Board = "uno", bootloader: Path | None = None, eeprom: bytes = FITTED) -> Target:
        for needed in (targets.AVR_LIBRARY, image_of(board), bootloader):
            if needed is not None and not needed.exists():
                pytest.skip(f"not there: {needed}")
        made.append(targets.avr(eeprom, board, bootloader))
        return made[-1]

    yield one
    for target in made:
        target.close()


def register(target: Target, address: int) -> int:
    """A byte of the chip's data space."""
    library = ctypes.CDLL(str(targets.AVR_LIBRARY))
    library.probe_register.argtypes = [ctypes.c_void_p, ctypes.c_uint16]
    library.probe_register.restype = ctypes.c_uint8
    return int(library.probe_register(target.handle, address))


def word(target: Target, address: int) -> int:
    """A 16-bit register."""
    return register(target, address) | register(target, address + 1) << 8


def running(make: Maker, board: Board = "uno", bootloader: Path | None = None) -> Bench:
    """ARMED and RUNNING; under a bootloader that has let go of the chip."""
    bench = Bench(make(board, bootloader), board=board, cut_frames=9)
    bench.run(0 if bootloader is None else 2600)
    bench.arm()
    bench.ask(speed=0.5)
    bench.run(100)
    bench.ask(steer_deg=10.0, speed=0.5, blade=1)
    bench.run(300)
    assert bench.last.state == State.RUNNING
    assert bench.blade
    return bench


def why_started(bench: Bench) -> Started:
    """What Version says."""
    bench.send(protocol.Hello(protocol.VERSION))
    bench.run(30)
    return [a for a in bench.answers if isinstance(a, protocol.Version)][-1].reset_cause


@pytest.mark.parametrize(
    ("board", "bootloader"), [*((board, None) for board in BOARDS), *CHIPS], ids=str
)
def test_after_boot_the_registers_are_what_the_datasheet_asks(
    make: Maker, board: Board, bootloader: Path | None
) -> None:
    """Whatever a bootloader has left in them."""
    target = make(board, bootloader)
    target.run_until(50_000 if bootloader is None else 2_700_000)
    assert word(target, 0xC4) == 16  # UBRR0: table 19-12, 115.2 k at 16 MHz, U2X, 2.1 %
    assert register(target, 0xC0) & 0x03 == 0x02  # UCSR0A: U2X0, of one processor
    assert register(target, 0xC2) == 0x06  # UCSR0C: asynchronous, 8 bits, no parity, 1 stop
    assert register(target, 0xC1) & 0xDC == 0x98  # UCSR0B: RXCIE0, RXEN0, TXEN0; 8 bits
    assert register(target, 0x7A) & 0xAF == 0x8F  # ADCSRA: ADEN, ADIE, divided by 128: 125 kHz
    assert register(target, 0x7C) & 0xE0 == 0x40  # ADMUX: AVCC, right adjusted
    assert register(target, 0x7B) & 0x4F == 0  # ADCSRB: channels 0 to 7, no comparator's
    assert register(target, 0x7E) & 0x1F == 0x0F  # DIDR0: the e-stop's pin stays readable
    assert register(target, 0x44) == 0x02  # TCCR0A: clear on compare
    assert register(target, 0x45) == 0x03  # TCCR0B: divided by 64
    assert register(target, 0x47) == 49  # OCR0A: 5 kHz
    assert register(target, 0x6E) == 0x02  # TIMSK0
    assert register(target, 0x80) & 0x03 == 0  # TCCR1A, TCCR1B: mode 8, not divided
    assert register(target, 0x81) & 0x1F == 0x11
    assert word(target, 0x86) == 400  # ICR1: 16 MHz / 2 / 400 = 20 kHz
    assert register(target, 0xB0) & 0x03 == 1  # TCCR2A, TCCR2B: phase correct, divided by 8
    assert register(target, 0xB1) & 0x0F == 0x02
    assert register(target, 0xB6) & 0x60 == 0  # ASSR: timer 2 runs from the chip's clock
    assert register(target, 0x60) == 0x48  # WDTCSR: WDIE, WDE, 16 ms
    assert register(target, 0x54) == 0  # MCUSR
    assert register(target, 0x53) & 0x0E == 0  # SMCR: idle
    assert register(target, 0x55) & 0x12 == 0  # MCUCR: pull-ups work, vectors are the program's
    assert register(target, 0x61) == 0  # CLKPR: the crystal's 16 MHz, undivided
    # Nothing else interrupts: TIMSK1, TIMSK2, PCICR, EIMSK; nothing is without its clock: PRR.
    assert {register(target, at) for at in (0x6F, 0x70, 0x68, 0x3D, 0x64)} == {0}
    if board == "mega2560":  # TIMSK3 to 5, PRR1; XMCRA: the ports A and C are the outputs' own
        assert {register(target, at) for at in (0x71, 0x72, 0x73, 0x65, 0x74)} == {0}


@pytest.mark.parametrize("board", ["uno", "mega2560"])
@pytest.mark.parametrize("way", [1, -1])
def test_a_vnh5019_is_never_off_for_less_than_6_us(make: Maker, board: Board, way: int) -> None:
    """VNH2SP30-E (DocID10832 Rev 10), table 9, note 1: "To avoid false short to battery detection
    during PWM operation, the PWM signal must be low for a time longer than 6 us". The timer counts
    up and down at 16 MHz (ATmega328P, 15.9.5): the output is low for twice the way to its top."""
    bench = Bench(make(board), board=board, vnh5019_steers=True)
    bench.run(10)
    for name, value in (("steer_driver", 3), ("ident_duty_max", 255), ("stall_time", 3000)):
        bench.set_param(name, value)
    bench.arm()
    seen = set()
    for duty in (200, 224, 225, 230, 238, 239, 240, 245, 250, 254, 255):
        bench.send(protocol.Ident(way * duty, 0.05))
        bench.run(10)
        assert bench.last.state == State.ARMED
        low_us = 2 * (word(bench.target, 0x86) - word(bench.target, 0x88)) / 16
        assert register(bench.target, 0x80) >> 6 == 2  # TCCR1A: OC1A set while counting down
        assert low_us == 0 or low_us > 6, duty
        assert low_us == pytest.approx(50 * (1 - duty / 255), abs=4)
        seen.add(low_us)
    assert 0 in seen and len(seen) > 2


@pytest.mark.parametrize("asked_hz", (123, 244, 245, 490, 979, 980, 3921, 3922, 25_000))
@pytest.mark.parametrize("board", ("uno", "mega2560"))
def test_the_drive_s_pwm_is_the_fastest_that_its_timer_has_up_to_what_is_asked(
    make: Maker, board: Board, asked_hz: int
) -> None:
    """17.7.4 and table 17-9, to the nearest hertz, as owners write it. Duties do not show it."""
    bench = Bench(make(board), board=board)
    bench.run(10)
    bench.set_param("drive_pwm_freq", asked_hz)
    bench.run(20)
    divided = {1: 1, 2: 8, 3: 32, 4: 64, 5: 128, 6: 256, 7: 1024}
    hz = {clock: round(16e6 / 510 / by) for clock, by in divided.items()}
    runs_at = hz[register(bench.target, 0xB1) & 0x07]  # TCCR2B
    assert register(bench.target, 0xB0) & 0x03 == 1  # TCCR2A: phase correct, top 255
    assert register(bench.target, 0xB1) & 0x08 == 0
    assert runs_at == max(each for each in hz.values() if each <= asked_hz)


@pytest.mark.parametrize("asked_hz", (123, 4000, 7001, 20_000, 25_000))
def test_the_steering_s_pwm_is_the_fastest_that_is_not_above_what_is_asked(
    make: Maker, asked_hz: int
) -> None:
    """15.9.5: 16 MHz / 2 / ICR1. A VNH5019 stands 20 kHz, a BTS7960 25 kHz."""
    bench = Bench(make())
    bench.run(10)
    bench.set_param("steer_pwm_freq", asked_hz)
    bench.run(20)
    top = word(bench.target, 0x86)
    assert register(bench.target, 0x81) & 0x1F == 0x11  # TCCR1B: mode 8, not divided
    assert 8e6 / top <= asked_hz < 8e6 / (top - 1)


@pytest.mark.parametrize("way", [1, -1])
def test_the_direction_changes_while_the_pwm_is_off(make: Maker, way: int) -> None:
    """A VNH5019's, from one tick to the next, seen in every microsecond."""
    bench = Bench(make(), vnh5019_steers=True)
    bench.run(10)
    bench.set_param("steer_driver", 3)
    bench.arm()
    bench.send(protocol.Ident(way * 150, 0.1))
    bench.run(10)
    assert bench.steer_duty == way * 150
    bench.send(protocol.Ident(-way * 150, 0.1))
    seen = []
    for _ in range(6000):
        bench.now_us += 1
        bench.target.run_until(bench.now_us)
        pins = bench.pins.steer_in1, bench.pins.steer_in2
        state = (bench.target.pwm(bench.pins.steer_pwm) > 0, *map(bench.target.pin, pins))
        if not seen or state != seen[-1]:
            seen.append(state)
    assert not any(in1 and in2 for _, in1, in2 in seen)
    driven = [(in1, in2) for on, in1, in2 in seen if on]
    assert driven == [(way > 0, way < 0), (way < 0, way > 0)]
    assert len([on for on, _, _ in seen if not on]) >= 1


@pytest.mark.parametrize("hz", (123, 20_000))
@pytest.mark.parametrize("driver", (2, 3))
@pytest.mark.parametrize("board", ("uno", "mega2560"))
def test_a_wire_that_its_timer_gets_has_its_own_duty_from_the_first(
    make: Maker, board: Board, driver: int, hz: int
) -> None:
    """Else a change of direction, or of a brake to a drive, begins with a period of what was driven
    before: 8 ms at the slowest. The shim ends a run in which a timer's output is connected while
    its compare register holds anything else."""
    bts7960 = driver == 2
    bench = Bench(make(board), vnh5019_steers=not bts7960, bts7960=bts7960, board=board)
    bench.run(10)
    for name in ("steer_driver", "drive_driver"):
        bench.set_param(name, driver)
    for name in ("steer_pwm_freq", "drive_pwm_freq"):
        bench.set_param(name, hz)
    bench.arm()
    ways = set()
    for steer_deg, speed in ((20.0, 0.3), (-20.0, -0.3), (20.0, 0.0), (0.0, 0.2)):
        bench.ask(steer_deg=steer_deg, speed=speed)
        for _ in range(700):
            bench.run(1)
            ways |= {("steer", bench.steer_duty > 0), ("drive", bench.drive_duty > 0)}
    assert len(ways) == 4
    assert bench.last.faults == 0


@pytest.mark.parametrize("board", ("uno", "mega2560"))
def test_a_wire_that_is_idle_is_not_its_timer_s(make: Maker, board: Board) -> None:
    """A compare register is taken at the timer's top or bottom only (15.9.5, 17.7.4): a wire that
    was left to it would go on for up to a period, 8 ms, while the other is on already."""
    bench = Bench(make(board), bts7960=True, board=board)
    bench.run(10)
    bench.set_param("drive_driver", 2)
    bench.arm()
    own = set()
    for steer_deg, speed in ((20.0, 0.3), (-20.0, -0.3), (20.0, 0.3)):
        bench.ask(steer_deg=steer_deg, speed=speed)
        for _ in range(1000):
            bench.run(1)
            for control, duty in ((0x80, bench.steer_duty), (0xB0, bench.drive_duty)):
                # TCCR1A, TCCR2A: COMnA1 and COMnB1. OC1A is RPWM, OC2A is LPWM.
                a, b = (
                    register(bench.target, control) & 0x80,
                    register(bench.target, control) & 0x20,
                )
                right, left = (a, b) if control == 0x80 else (b, a)
                assert (bool(right), bool(left)) == (duty > 0, duty < 0)
                own.add((control, duty > 0, duty < 0))
    assert len(own) == 6


@pytest.mark.parametrize("board", BOARDS)
def test_the_pins_are_the_wiring_s(make: Maker, board: Board) -> None:
    target, pins = make(board), PINS[board]
    target.run_until(50_000)
    for pin in range(70 if board == "mega2560" else 20):
        found = target.output(pin)
        if pin in pins.outputs:
            assert found == 0, pin
        elif pin in (pins.hall, pins.hall_b, pins.blade_turn):
            assert found == PULLED_UP, pin
        elif pin != pins.lamp and pin > 1:
            assert found == FLOATING, pin


@pytest.mark.parametrize("board", ("uno", "mega2560"))
def test_the_pin_header_is_the_wiring_s(board: Board) -> None:
    text = (ROOT / "firmware" / "src" / "boards" / board / "pins.h").read_text()
    found = {
        re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower(): int(number)
        for name, number in re.findall(r"constexpr uint8_t k(\w+) = (\d+);", text)
        if not name.endswith("Channel")
    }
    assert found == {name: getattr(PINS[board], name) for name in found}
    assert len(found) == 14


@pytest.mark.parametrize("board", BOARDS)
def test_every_board_steers_drives_and_cuts_at_its_own_pins(make: Maker, board: Board) -> None:
    bench = running(make, board)
    bench.run(600)
    assert bench.actuator.angle_deg == pytest.approx(10.0, abs=0.7)
    assert bench.drive_duty == 128
    bench.ask(steer_deg=-10.0, speed=-0.3)
    bench.run(1500)
    assert bench.actuator.angle_deg == pytest.approx(-10.0, abs=0.7)
    assert bench.drive_duty < 0
    bench.target.write(protocol.encode(protocol.Stop(), 0))
    bench.run(10)
    assert bench.off()


@pytest.mark.parametrize("baud", (USB_BAUD, CH340_BAUD))
def test_the_line_is_understood_by_either_usb_chip(make: Maker, baud: int) -> None:
    bench = Bench(make())
    bench.target.set_baud(baud)
    bench.run(10)
    assert why_started(bench) == Started.BY_POWER_ON
    bench.run(200)
    assert bench.last.frames_bad == 0
    assert bench.readings[-1].line_errors == 0


def test_a_line_five_percent_off_is_not_understood_and_is_counted(make: Maker) -> None:
    """The USB chip against 111111 baud, which a divisor of 17 would give, and the like."""
    bench = Bench(make(), cut_frames=10_000)
    bench.target.set_baud(111_111)
    for _ in range(5):
        bench.send(protocol.Hello(protocol.VERSION))
        bench.run(20)
    assert not bench.answers
    assert not bench.telemetry
    bench.target.set_baud(USB_BAUD)
    bench.parser = protocol.Parser()
    bench.run(400)
    assert bench.readings[-1].line_errors > 10


def test_what_a_chip_does_not_do_ends_the_run(make: Maker) -> None:
    target = make()
    target.run_until(10_000)
    target.set_pin(PINS["uno"].blade, True)
    with pytest.raises(TargetError, match="pin 6 is an output"):
        target.run_until(20_000)


def test_a_tick_that_takes_longer_than_its_period_is_counted(make: Maker) -> None:
    bench = Bench(make())
    bench.run(100)
    library = ctypes.CDLL(str(targets.AVR_LIBRARY))
    library.probe_stall.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
    for late, stall_us in enumerate((3000, 6000), start=0):
        library.probe_stall(bench.target.handle, stall_us)
        bench.now_us += 20_000
        bench.target.run_until(bench.now_us)
        bench.run(300)
        assert bench.readings[-1].overruns == late
    assert bench.last.faults == 0


def set_clock(target: Target, board: Board, milliseconds: int) -> None:
    """As if the firmware had run for so long already."""
    image = image_of(board)
    names = subprocess.run(["avr-nm", str(image)], capture_output=True, text=True, check=True)
    (address,) = re.findall(r"^0080(\w{4}) [bB] \w*8clock_msE", names.stdout, re.MULTILINE)
    library = ctypes.CDLL(str(targets.AVR_LIBRARY))
    library.probe_sram.restype = ctypes.POINTER(ctypes.c_uint8)
    library.probe_sram.argtypes = [ctypes.c_void_p]
    sram = library.probe_sram(target.handle)
    first = int(address, 16) - (0x200 if board == "mega2560" else 0x100)
    for k, byte in enumerate(milliseconds.to_bytes(4, "little")):
        sram[first + k] = byte


@pytest.mark.parametrize("board", ("uno", "mega2560"))
@pytest.mark.parametrize("wraps_ms", (2**32 // 1000, 2**32), ids=("71 minutes", "49.7 days"))
def test_it_drives_on_as_its_clocks_wrap_and_still_sees_a_lost_link(
    make: Maker, board: Board, wraps_ms: int
) -> None:
    bench = running(make, board)
    set_clock(bench.target, board, wraps_ms - 1000)
    bench.run(30)
    heard, host = len(bench.telemetry), Session()
    for _ in range(100):
        bench.run(20)
        host.feed(bench.now_us / 1e6, protocol.encode(bench.last, 0))
        assert bench.last.state == State.RUNNING
        assert bench.blade
    times = [t.time for t in bench.telemetry[heard:]]
    assert {round((b - a) * 1e6) % 2**32 for a, b in itertools.pairwise(times)} == {20_000}
    assert min(times) < 1.0
    assert max(times) > 4290.0
    assert host.resets == 0
    bench.drive_period_ms = 0
    bench.run(250)
    assert bench.off()
    assert bench.last.faults == Fault.LINK_LOST


def test_a_reset_while_the_eeprom_writes_waits_for_it(make: Maker) -> None:
    """The byte is written whatever resets the chip; nothing can be read meanwhile."""
    bench = Bench(make(eeprom=b"\xff" * 1024), cut_frames=9)
    bench.run(10)
    bench.send(protocol.ParamSave())
    bench.run(30)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.run(100)
    assert bench.last.state in (State.SAFE, State.FAULT)


@pytest.mark.parametrize(("board", "bootloader"), CHIPS)
def test_behind_its_bootloader_a_board_starts_and_works(
    make: Maker, board: Board, bootloader: Path
) -> None:
    bench = running(make, board, bootloader)
    assert bench.last.faults == 0


@pytest.mark.parametrize(("board", "bootloader"), CHIPS)
def test_while_a_bootloader_waits_nothing_drives_the_outputs(
    make: Maker, board: Board, bootloader: Path
) -> None:
    """So each wants a pull-down: hil/firmware/wiring.py takes a loose wire for high."""
    bench = running(make, board, bootloader)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.drive_period_ms = 0
    loose = 0
    for _ in range(300):
        bench.run(1)
        assert bench.off()
        loose += all(bench.target.output(pin) == FLOATING for pin in bench.pins.outputs)
    assert loose > 200


@pytest.mark.parametrize(("board", "bootloader"), CHIPS)
def test_a_hung_main_loop_comes_back_with_its_fault_behind_every_bootloader(
    make: Maker, board: Board, bootloader: Path
) -> None:
    bench = running(make, board, bootloader)
    bench.drive_period_ms = 0
    bench.target.hang(Hang.MAIN)
    bench.run(17)
    assert bench.off()
    bench.run(60)
    assert bench.last.state == State.FAULT
    assert bench.last.faults == Fault.WATCHDOG
    assert Started.WHILE_ARMED in why_started(bench)


@pytest.mark.parametrize(("board", "bootloader"), (CHIPS[0], CHIPS[2]))
@pytest.mark.parametrize("how", ("hung interrupt", "brown-out"))
def test_what_a_bootloader_hides_is_a_fault_where_the_machine_was_armed(
    make: Maker, board: Board, bootloader: Path, how: str
) -> None:
    bench = running(make, board, bootloader)
    bench.drive_period_ms = 0
    if how == "brown-out":
        bench.target.reset(ResetCause.BROWN_OUT)
    else:
        bench.target.hang(Hang.INTERRUPT)
    bench.run(34)
    assert bench.off()
    bench.run(2600)
    assert bench.last.state == State.FAULT
    assert bench.last.faults == Fault.RESET_UNKNOWN
    assert why_started(bench) == Started.BY_UNKNOWN | Started.WHILE_ARMED


LEAVE_BY_WATCHDOG = (0xE188, 0x9380, 0x0060, 0xE088, 0x9380, 0x0060, 0xCFFF)
"""ldi r24, WDCE | WDE; sts WDTCSR, r24; ldi r24, WDE; sts WDTCSR, r24; rjmp .-2"""
CLEARING = (0xB624, 0x2411, 0xBE14, 0xFE21, 0x940C, 0x0000, *LEAVE_BY_WATCHDOG)
"""in r2, MCUSR; clr r1; out MCUSR, r1; sbrs r2, EXTRF; jmp 0"""
KEEPING = (
    *(0xB624, 0x2411, 0xFE21, 0x940C, 0x0000, 0xFE23, 0xC004, 0xEF87, 0xBF84, 0x940C, 0x0000),
    *LEAVE_BY_WATCHDOG,
)
"""in r2, MCUSR; clr r1; sbrs r2, EXTRF; jmp 0; sbrs r2, WDRF; rjmp .+8; ldi r24, 0xF7;
out MCUSR, r24; jmp 0"""


def optiboot(folder: Path, version: int) -> Path:
    """A bootloader that does with a reset's cause what Optiboot's source does (main() of 5.0, 6.2
    and 8), and nothing else. It takes MCUSR into r2. Up to version 6 it clears MCUSR.
    After the reset pin it waits, here 16 ms, and leaves by the watchdog, and so comes to itself
    again: up to version 6 with that cause alone, from 7 on with both, of which it clears its own.
    Its version ends the flash."""
    code = CLEARING if version < 7 else KEEPING
    lines = []
    for address, words in ((0x7E00, code), (0x7FFE, (version << 8,))):
        data = b"".join(word.to_bytes(2, "little") for word in words)
        record = bytes((len(data), address >> 8, address & 0xFF, 0)) + data
        lines.append(f":{record.hex().upper()}{-sum(record) & 0xFF:02X}\n")
    path = folder / "optiboot.hex"
    path.write_text("".join(lines) + ":00000001FF\n")
    return path


@pytest.mark.parametrize("board", ("uno", "nano"))
@pytest.mark.parametrize(
    ("version", "how", "fault", "told"),
    [
        (5, "brown-out", Fault.BROWN_OUT, Started.BY_BROWN_OUT),
        (8, "hung interrupt", Fault.WATCHDOG, Started.BY_WATCHDOG),
        (8, "reset pin", Fault(0), Started.BY_RESET_PIN),
        (6, "reset pin", Fault.RESET_UNKNOWN, Started.BY_UNKNOWN),  # r2 has its own watchdog's
        (6, "hung interrupt", Fault.RESET_UNKNOWN, Started.BY_UNKNOWN),
        (4, "brown-out", Fault.RESET_UNKNOWN, Started.BY_UNKNOWN),  # r2 is anything there
    ],
)
def test_what_a_newer_optiboot_hands_over_is_taken(
    make: Maker, tmp_path: Path, board: Board, version: int, how: str, fault: Fault, told: Started
) -> None:
    bench = running(make, board, optiboot(tmp_path, version))
    bench.drive_period_ms = 0
    if how == "hung interrupt":
        bench.target.hang(Hang.INTERRUPT)
    else:
        bench.target.reset(ResetCause.BROWN_OUT if how == "brown-out" else ResetCause.EXTERNAL)
    bench.run(100)
    assert bench.off()
    assert bench.last.faults == fault
    assert why_started(bench) == told | Started.WHILE_ARMED


@pytest.mark.parametrize("version", (5, 6, 8))
def test_a_port_that_is_opened_is_no_watchdog_s_reset(
    make: Maker, tmp_path: Path, version: int
) -> None:
    bench = Bench(make("uno", optiboot(tmp_path, version)), cut_frames=1)
    bench.run(20)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.run(100)
    assert bench.last.faults == Fault(0)
    assert bench.last.state == State.SAFE


def test_the_builder_s_bootloaders_are_those_that_the_arduino_ide_burns() -> None:
    """By its own list of boards; an Optiboot's version is the last word of the flash."""
    boards = (LOADERS.parent / "boards.txt").read_text(encoding="utf-8")
    page = (ROOT / "docs" / "build" / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (Uno|Nano, \"\w+\"|Mega 2560) \| ([^|]+) \|", page, re.MULTILINE))
    for row, entry in (
        ("Uno", "uno"),
        ('Nano, "new"', "nano.menu.cpu.atmega328"),
        ('Nano, "old"', "nano.menu.cpu.atmega328old"),
    ):
        (file,) = re.findall(rf"^{re.escape(entry)}\.bootloader\.file=(.+)$", boards, re.MULTILINE)
        (fuse,) = re.findall(
            rf"^{re.escape(entry)}\.bootloader\.extended_fuses=(.+)$", boards, re.MULTILINE
        )
        assert f"({fuse.strip()}" in page or f"fuse {fuse.strip()}" in page
        loader = (LOADERS / file.strip()).read_text(encoding="ascii")
        version = re.search(r"^:027FFE00(\w\w)(\w\w)", loader, re.MULTILINE)
        if version is None:
            assert rows[row] == "ATmegaBOOT"
        else:
            minor, major = (int(byte, 16) for byte in version.groups())
            assert rows[row] == f"Optiboot {major}.{minor}"


def test_an_old_nano_s_hung_interrupt_never_comes_back_but_drives_nothing(make: Maker) -> None:
    """Its bootloader leaves the watchdog running: a limit, told in docs/understand/firmware.md."""
    bench = running(make, "nano", OLD_NANO)
    bench.drive_period_ms = 0
    bench.target.hang(Hang.INTERRUPT)
    bench.run(34)
    heard = len(bench.telemetry)
    for _ in range(2000):
        assert bench.off()
        bench.run(1)
    assert len(bench.telemetry) <= heard + 1


@pytest.mark.parametrize(
    ("board", "bootloader", "lives"),
    [("uno", OPTIBOOT, False), ("nano", OPTIBOOT, False), ("mega2560", MEGA, True)],
)
@pytest.mark.parametrize("rest", (b"\x64\x00", b"\x64\xf4\x01\x01\x9c\x37\x00"), ids=bytes.hex)
def test_a_reset_within_a_frame_may_cost_the_firmware_but_moves_nothing(
    make: Maker, board: Board, bootloader: Path, lives: bool, rest: bytes
) -> None:
    """A reset that is not the host's, while it sends: where the rest of the frame begins with a
    "d" (STK_PROG_PAGE), the bootloader takes what follows for a page to write. A limit, told in
    docs/build/README.md; Optiboot looks at what follows before it writes from version 6 on."""
    bench = running(make, board, bootloader)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.target.write(rest)
    bench.drive_period_ms = 50
    for _ in range(5000):
        bench.run(1)
        assert bench.off()
    bench.drive_period_ms = 0
    bench.target.reset(ResetCause.POWER_ON)
    heard = len(bench.telemetry)
    bench.run(3000)
    assert bench.off()
    assert (len(bench.telemetry) > heard) is lives


def test_a_reset_while_safe_is_no_fault_behind_a_bootloader(make: Maker) -> None:
    bench = Bench(make("uno", OPTIBOOT), cut_frames=9)
    bench.run(2600)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.run(2600)
    assert bench.last.faults == 0
    assert why_started(bench) == Started.BY_UNKNOWN


@pytest.mark.parametrize("board", ("uno", "mega2560"))
def test_noise_on_the_hall_inputs_is_a_fault_and_costs_no_tick(make: Maker, board: Board) -> None:
    bench = Bench(make(board), board=board)
    bench.run(10)
    bench.set_param("hall_per_metre", 20)
    bench.arm()
    bench.ask(speed=0.0)
    pins, now = bench.pins, bench.now_us
    for k in range(1, 20_001):
        bench.target.run_until(now + 7 * k)
        bench.target.set_pin(pins.hall, k * 2_654_435_761 >> 16 & 1 == 0)
        bench.target.set_pin(pins.hall_b, k * 2_246_822_519 >> 16 & 1 == 0)
        if k % 2857 == 0:
            bench.send(bench.command)
    bench.now_us = now + 140_000
    bench.run(300)
    assert bench.last.faults in (Fault.HALL_NOISE, Fault.HALL_NOISE | Fault.WHEEL_RUNAWAY)
    assert bench.readings[-1].overruns == 0


def test_a_build_for_no_board_says_so() -> None:
    source = ROOT / "firmware" / "src" / "boards" / "atmega" / "atmega.cpp"
    for flags, what in (
        (["-mmcu=atmega328p"], "no board is named"),
        (["-mmcu=atmega32u4", "-DDARANTI_BOARD_UNO"], "for the ATmega328P"),
    ):
        command = ["avr-g++", "-std=gnu++14", "-DF_CPU=16000000L", *flags]
        command += [f"-I{source.parent.parent.parent / 'core'}", "-fsyntax-only", str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode != 0
        assert what in done.stderr
