"""Seeds PlatformIO's core folder (.platformio) from PyPI's SCons and Debian's AVR packages.

PlatformIO fetches platforms, toolchains and SCons from a registry of its own. Where that cannot be
reached (CI, many farms), this writes small packages of the same names that point at what PyPI and
Debian installed. It leaves alone whatever PlatformIO itself put there. Idempotent; a second call
takes milliseconds. `--clean` removes the seeds again.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CORE = ROOT / ".platformio"
LIBRARIES = ROOT / ".pio" / "libdeps" / "native"
SEED_MARK = ".seeded"
"""Its presence says that a package is ours, not PlatformIO's own download."""

DOCTEST = Path("/usr/include/doctest/doctest.h")
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")

NATIVE_PLATFORM = """\
from platformio.public import PlatformBase


class NativePlatform(PlatformBase):
    def is_embedded(self):
        return False

    def get_boards(self, id_=None):
        return {}
"""
NATIVE_BUILDER = """\
from SCons.Script import Default, DefaultEnvironment

env = DefaultEnvironment()
Default([env.Alias("buildprog", env.BuildProgram())])
"""
AVR_PLATFORM = """\
from platformio.public import PlatformBase


class AtmelavrPlatform(PlatformBase):
    pass
"""
AVR_BUILDER = """\
from SCons.Script import AlwaysBuild, Builder, Default, DefaultEnvironment

env = DefaultEnvironment()
board = env.BoardConfig()
mcu = "-mmcu=" + board.get("build.mcu")
env.Replace(
    AR="avr-gcc-ar", AS="avr-as", CC="avr-gcc", CXX="avr-g++", OBJCOPY="avr-objcopy",
    RANLIB="avr-gcc-ranlib", SIZETOOL="avr-size", ARFLAGS=["rcs"],
    PROGNAME="firmware", PROGSUFFIX=".elf",
    SIZEPROGREGEXP=r"^(?:\\.text|\\.data|\\.bootloader)\\s+(\\d+).*",
    SIZEDATAREGEXP=r"^(?:\\.data|\\.bss|\\.noinit)\\s+(\\d+).*",
    SIZECHECKCMD="$SIZETOOL -A -d $SOURCES",
    UPLOADER="avrdude",
    UPLOADERFLAGS=["-p", "$BOARD_MCU", "-c", "$UPLOAD_PROTOCOL", "-b", "$UPLOAD_SPEED", "-D",
                   "-P", '"$UPLOAD_PORT"'],
    UPLOADCMD="$UPLOADER $UPLOADERFLAGS -U flash:w:$SOURCES:i",
)
to_hex = Builder(
    action=env.VerboseAction("$OBJCOPY -O ihex -R .eeprom $SOURCES $TARGET", "Building $TARGET"),
    suffix=".hex",
)
env.Append(
    CCFLAGS=["-Os", "-ffunction-sections", "-fdata-sections", "-flto", mcu],
    CFLAGS=["-std=gnu11"],
    CXXFLAGS=["-fno-exceptions", "-fno-threadsafe-statics"],
    ASFLAGS=["-x", "assembler-with-cpp", mcu],
    LINKFLAGS=["-Os", mcu, "-Wl,--gc-sections", "-flto", "-fuse-linker-plugin"],
    LIBS=["m"],
    CPPDEFINES=[("F_CPU", "$BOARD_F_CPU")],
    BUILDERS={"ElfToHex": to_hex},
)
elf = env.BuildProgram()
image = env.ElfToHex("$BUILD_DIR/${PROGNAME}", elf)
upload = env.Alias("upload", image, [
    env.VerboseAction(env.AutodetectUploadPort, "Looking for upload port..."),
    env.VerboseAction("$UPLOADCMD", "Uploading $SOURCE"),
])
AlwaysBuild(upload)
Default([env.Alias("buildprog", [elf, image]), env.Alias("checkprogsize", elf)])
"""
ARDUINO_FRAMEWORK = """\
import os

from SCons.Script import DefaultEnvironment

env = DefaultEnvironment()
board = env.BoardConfig()
root = "{arduino}"
core = os.path.join(root, "cores", board.get("build.core"))
variant = os.path.join(root, "variants", board.get("build.variant"))
env.Append(
    # WString.cpp of Debian's core asks for DECIMAL_DIG, which avr-gcc 5 spells otherwise.
    CPPDEFINES=[("ARDUINO", 10808), "ARDUINO_ARCH_AVR", ("DECIMAL_DIG", "__DECIMAL_DIG__")],
    CPPPATH=[core, variant],
    LIBSOURCE_DIRS=[os.path.join(root, "libraries")],
)
quiet = env.Clone()
quiet.Append(CCFLAGS=["-w"])
env.Prepend(LIBS=[quiet.BuildLibrary(os.path.join("$BUILD_DIR", "FrameworkArduino"), core)])
"""


def board(name: str, mcu: str, variant: str, flash: int, ram: int, protocol: str) -> str:
    """A board's manifest, as PlatformIO has it."""
    return json.dumps(
        {
            "build": {"core": "arduino", "f_cpu": "16000000L", "mcu": mcu, "variant": variant},
            "frameworks": ["arduino"],
            "name": name,
            "upload": {
                "maximum_ram_size": ram,
                "maximum_size": flash,
                "protocol": protocol,
                "require_upload_port": True,
                "speed": 57600 if name.endswith("(old bootloader)") else 115200,
            },
            "url": "https://www.arduino.cc",
            "vendor": "Arduino",
        }
    )


BOARDS = {
    "uno": board("Arduino Uno", "atmega328p", "standard", 32256, 2048, "arduino"),
    "nanoatmega328new": board(
        "Arduino Nano", "atmega328p", "eightanaloginputs", 30720, 2048, "arduino"
    ),
    "nanoatmega328": board(
        "Arduino Nano (old bootloader)", "atmega328p", "eightanaloginputs", 30720, 2048, "arduino"
    ),
    "megaatmega2560": board("Arduino Mega 2560", "atmega2560", "mega", 253952, 8192, "wiring"),
}
TOOLCHAIN = "toolchain-atmelavr"
FRAMEWORK = "framework-arduino-avr"
AVR_MANIFEST = {
    "title": "AVR",
    "description": "Debian's AVR toolchain",
    "frameworks": {"arduino": {"package": FRAMEWORK, "script": "builder/frameworks/arduino.py"}},
    "packages": {
        TOOLCHAIN: {"type": "toolchain", "owner": "platformio", "version": ">=1.50400.0"},
        FRAMEWORK: {
            "type": "framework",
            "owner": "platformio",
            "optional": True,
            "version": "*",
        },
    },
}


class MissingError(Exception):
    """Something that Debian or PyPI should have installed is not there."""


def seed(folder: Path, kind: str, name: str, version: str, files: dict[str, str]) -> None:
    """Writes one package, unless PlatformIO installed its own under this name."""
    mark = folder / SEED_MARK
    if folder.exists() and not mark.exists():
        return
    owner = "doctest" if kind == "library" else "platformio"
    origin = {"owner": owner, "id": None, "name": name, "requirements": None, "uri": None}
    about = {"type": kind, "name": name, "version": version, "spec": origin}
    for path, text in {**files, ".piopm": json.dumps(about), SEED_MARK: ""}.items():
        target = folder / path
        if target.exists() and target.read_text() == text:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)


def scons_version() -> str:
    """A version of tool-scons that the installed PlatformIO accepts."""
    from platformio.dependencies import get_core_dependencies  # noqa: PLC0415

    wanted: str = get_core_dependencies()["tool-scons"]
    return wanted.lstrip("~^>=").split(",")[0]


def seed_all() -> None:
    """Raises MissingError where a file that a seed points at is absent."""
    spec = importlib.util.find_spec("SCons")
    if spec is None or spec.origin is None:
        raise MissingError("SCons is not installed: pip install scons")
    for path, package in ((DOCTEST, "doctest-dev"), (ARDUINO, "arduino-core-avr")):
        if not path.exists():
            raise MissingError(f"{path} is missing: apt-get install {package}")
    if shutil.which("avr-gcc") is None:
        raise MissingError("avr-gcc is missing: apt-get install gcc-avr avr-libc")

    def manifest(name: str, version: str, **more: object) -> str:
        return json.dumps({"name": name, "version": version, "system": "*", **more})

    packages, platforms = CORE / "packages", CORE / "platforms"
    version = scons_version()
    site = Path(spec.origin).parent.parent
    scons_py = (
        f"import sys\n\nsys.path.insert(0, {str(site)!r})\n"
        "import SCons.Script\n\nSCons.Script.main()\n"
    )
    files = {"package.json": manifest("tool-scons", version), "scons.py": scons_py}
    seed(packages / "tool-scons", "tool", "tool-scons", version, files)
    for name, number in ((TOOLCHAIN, "1.50400.0"), (FRAMEWORK, "5.2.0")):
        seed(packages / name, "tool", name, number, {"package.json": manifest(name, number)})
    about = {"title": "Native", "description": "the host's compiler", "packages": {}}
    files = {
        "platform.json": manifest("native", "1.2.1", **about),
        "platform.py": NATIVE_PLATFORM,
        "builder/main.py": NATIVE_BUILDER,
    }
    seed(platforms / "native", "platform", "native", "1.2.1", files)
    files = {
        "platform.json": manifest("atmelavr", "5.1.0", **AVR_MANIFEST),
        "platform.py": AVR_PLATFORM,
        "builder/main.py": AVR_BUILDER,
        "builder/frameworks/arduino.py": ARDUINO_FRAMEWORK.format(arduino=ARDUINO),
        **{f"boards/{name}.json": text for name, text in BOARDS.items()},
    }
    seed(platforms / "atmelavr", "platform", "atmelavr", "5.1.0", files)
    files = {
        "library.json": json.dumps({"name": "doctest", "version": "2.4.9"}),
        "doctest.h": DOCTEST.read_text(),
    }
    seed(LIBRARIES / "doctest", "library", "doctest", "2.4.9", files)


def clean() -> None:
    """Removes what seed_all() wrote and nothing else."""
    for top in (CORE, LIBRARIES):
        for mark in list(top.rglob(SEED_MARK)):
            shutil.rmtree(mark.parent)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clean", action="store_true", help="remove the seeds")
    if parser.parse_args().clean:
        clean()
        return 0
    try:
        seed_all()
    except MissingError as error:
        print(f"seed_platformio: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
