"""Writes the firmware onto a board with avrdude, by way of its bootloader."""

from __future__ import annotations

import re
import shutil
import stat
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from host.core.errors import UserError
from host.core.input_file import check_input

CHECKOUT = Path(__file__).parents[2]
TIMEOUT_S = 120.0
"""Writing and verifying a Mega's 256 KiB at 115200 baud takes some 50 s."""
ELF_AVR = 83
"""EM_AVR of the ELF specification."""
ELF_HEAD = 64
"""Bytes that hold an ELF file's magic number and machine."""


@dataclass(frozen=True)
class Loader:
    """How a board's bootloader is spoken to (arduino-core-avr, boards.txt)."""

    build: str
    """The PlatformIO environment whose image it takes."""
    part: str
    programmer: str
    baud: int
    elf_kind: int
    """The architecture in an ELF's flags: 5 for 128 KiB of flash and less, 6 for more."""


LOADERS: Final = {
    "uno": Loader("uno", "atmega328p", "arduino", 115200, 5),
    "uno_hil": Loader("uno_hil", "atmega328p", "arduino", 115200, 5),
    "nano": Loader("nano", "atmega328p", "arduino", 115200, 5),
    "nano_old": Loader("nano", "atmega328p", "arduino", 57600, 5),
    "mega2560": Loader("mega2560", "atmega2560", "wiring", 115200, 6),
}
"""By the board's name. A Nano sold before 2018, and many a copy, has the old bootloader."""


def find_avrdude() -> list[str]:
    """avrdude's command line: Debian's, or the one PlatformIO fetched with its configuration."""
    found = shutil.which("avrdude")
    if found is not None:
        return [found]
    for core in (CHECKOUT / ".platformio", Path.home() / ".platformio"):
        package = core / "packages" / "tool-avrdude"
        for program in (package / "bin" / "avrdude", package / "avrdude"):
            if program.is_file():
                return [str(program), "-C", str(package / "avrdude.conf")]
    raise UserError("avrdude is not installed: `sudo apt install avrdude`")


def find_image(build: str) -> Path:
    """The newest image of a PlatformIO environment. UserError where it was not built."""
    folder = CHECKOUT / ".pio" / "build" / build
    for name in ("firmware.hex", "firmware.elf"):
        if (folder / name).is_file():
            return folder / name
    raise UserError(f"the firmware is not built ({folder} is empty): `pio run -e {build}`")


def check_image(path: Path, board: str) -> None:
    """Raises UserError unless the file can be an image for the board (of LOADERS): Intel HEX, or an
    ELF file for its chip."""
    loader = LOADERS[board]
    check_input(path, "the image", once=False)
    try:
        head = path.open("rb").read(ELF_HEAD)
    except OSError as error:
        raise UserError(f"cannot read the image {path}: {error.strerror}") from error
    machine = int.from_bytes(head[18:20], "little")
    kind = int.from_bytes(head[36:40], "little") & 0x7F
    elf = head.startswith(b"\x7fELF") and machine == ELF_AVR and kind == loader.elf_kind
    hex_ = re.match(rb":[0-9A-Fa-f]{10,}\s", head) is not None
    if not (elf if path.suffix == ".elf" else hex_):
        raise UserError(
            f"{path} is no image for the board: give the firmware.hex or firmware.elf that "
            f"`pio run -e {loader.build}` builds"
        )


def check_port(port: str) -> None:
    """Raises UserError unless the port can be a board."""
    if "://" in port:
        raise UserError(f"{port} is a network port: flashing needs the board's own serial port")
    path = Path(port)
    if not path.exists():
        raise UserError(f"serial port {port} does not exist; plug the board in")
    if path.resolve().is_relative_to("/dev/pts"):
        raise UserError(f"{port} is a virtual port: there is no board behind it to flash")
    if not stat.S_ISCHR(path.stat().st_mode):
        raise UserError(f"{port} is not a serial port")


def write_image(port: str, image: Path, board: str) -> None:
    """Runs avrdude on a board of LOADERS; it verifies what it wrote. UserError with its own last
    words."""
    loader = LOADERS[board]
    kind = "i" if image.suffix == ".hex" else "e"
    command = [*find_avrdude(), "-p", loader.part, "-c", loader.programmer]
    command += ["-P", port, "-b", str(loader.baud), "-D", "-U", f"flash:w:{image}:{kind}"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise UserError(f"avrdude failed on {port}: {error}") from error
    if done.returncode != 0:
        words = [text for text in done.stderr.splitlines() if text.strip()]
        last = "; ".join(words[-3:]) or f"exit code {done.returncode}"
        other = {"nano": " A Nano's old bootloader wants `--board nano_old`."}.get(board, "")
        raise UserError(
            f"avrdude could not write {port}: {last}. Is it the board that --board names "
            f"({board}), and not in use?{other}"
        )
