"""The firmware goes onto every board by the bootloader that Debian ships for it: `daranti flash`'s
avrdude on one side of a pseudo-terminal, the bootloader in simavr on the other."""

from __future__ import annotations

import os
import pty
import random
import select
import termios
import threading
import tty
from pathlib import Path

import pytest

from hil.firmware import targets
from hil.firmware.targets import Board, ResetCause, Target, image_of
from host.core.errors import UserError
from host.link import flash, protocol
from tests.firmware.test_boards import CHIPS, FITTED, OPTIBOOT, why_started
from tests.helpers.firmware_bench import Bench

QUIET_MS = 2
"""After an answer's last byte nothing more comes."""
SILENT_MS = 400
"""So long a bootloader may take to answer: its lamp flashes first."""
WAIT_S = 60.0
"""Only a hang takes this long."""
SPEEDS = {termios.B57600: 57_600, termios.B115200: 115_200}
LOADERS = {"uno": "uno", "nano": "nano_old", "mega2560": "mega2560"}
BUILDS = {"uno": 0, "nano": 3, "mega2560": 4}
"""What Version says (firmware/protocol.toml)."""


def write(target: Target, image: Path, board: str) -> None:
    """`daranti flash` without its look at the port. To open it resets the board, which is done
    here as the first byte comes; simulated time stands while nothing is on its way."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    failed: list[UserError] = []

    def run() -> None:
        try:
            flash.write_image(os.ttyname(slave), image, board)
        except UserError as error:
            failed.append(error)
        os.write(done_in, b".")

    done, done_in = os.pipe()
    thread = threading.Thread(target=run)
    thread.start()
    opened = False
    quiet_ms = limit_ms = QUIET_MS
    try:
        while True:
            idle = quiet_ms >= limit_ms
            ready, _, _ = select.select([master, done], [], [], WAIT_S if idle else 0)
            if done in ready:
                break
            assert ready or not idle, "avrdude hangs"
            data = os.read(master, 4096) if master in ready else b""
            if data and not opened:
                opened = True
                target.set_baud(SPEEDS[termios.tcgetattr(slave)[4]])
                target.reset(ResetCause.EXTERNAL)
            target.write(data)
            target.run_until(target.time_us + 1000)
            said = target.read()
            os.write(master, said)
            if data or said:
                quiet_ms, limit_ms = 0, QUIET_MS if said else SILENT_MS
            else:
                quiet_ms += 1
    finally:
        thread.join()
        for end in (master, slave, done, done_in):
            os.close(end)
    if failed:
        raise failed[0]


def intel_hex(data: bytes) -> str:
    """From address 0."""
    lines = []
    for at in range(0, len(data), 16):
        row = bytes((len(data[at : at + 16]), at >> 8, at & 0xFF, 0)) + data[at : at + 16]
        lines.append(f":{row.hex().upper()}{-sum(row) & 0xFF:02X}")
    return "\n".join([*lines, ":00000001FF", ""])


def on(board: Board, bootloader: Path) -> Target:
    for needed in (targets.AVR_LIBRARY, image_of(board), bootloader):
        if not needed.exists():
            pytest.skip(f"not there: {needed}")
    try:
        flash.find_avrdude()
    except UserError as error:
        pytest.skip(str(error))
    return targets.avr(FITTED, board, bootloader)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "bootloader", "name"),
    [*((board, loader, LOADERS[board]) for board, loader in CHIPS), ("nano", OPTIBOOT, "nano")],
)
def test_the_firmware_goes_onto_a_board_by_its_own_bootloader(
    board: Board, bootloader: Path, name: str, tmp_path: Path
) -> None:
    rubbish = tmp_path / "rubbish.hex"
    rubbish.write_text(intel_hex(random.Random(1).randbytes(512)))
    with on(board, bootloader) as target:
        write(target, rubbish, name)
        bench = Bench(target, board=board, cut_frames=10_000)
        bench.now_us = target.time_us
        image = image_of(board).with_suffix(".hex")
        write(target, image, name)
        target.set_baud(0)
        target.read()
        target.reset(ResetCause.EXTERNAL)
        bench = Bench(target, board=board, cut_frames=9)
        bench.now_us = -(-target.time_us // 1000) * 1000
        bench.run(2600)
        why_started(bench)
        version = [a for a in bench.answers if isinstance(a, protocol.Version)][-1]
        assert version.build == BUILDS[board]
