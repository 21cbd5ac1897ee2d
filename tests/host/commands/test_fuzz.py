"""Every command against arguments and files that are wrong: one message, an exit code that means
something, nothing internal."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from host.commands.cli import daranti
from host.core.errors import EXIT_FAULT, EXIT_SOFTWARE, EXIT_UNFINISHED, EXIT_USER
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import FakeFirmware

MEANT = (0, EXIT_USER, EXIT_UNFINISHED, EXIT_FAULT)
ENDLESS = {"panel", "monitor"}
"""They run until Ctrl-C."""
SUFFIXES = (
    ".geojson", ".kml", ".shp", ".xml", ".zip", ".gpx", ".csv", ".yaml", ".json", ".mcap", ".jpg",
    ".png", ".mp4", ".nmea", ".hex", ".elf", ".sqlite", "",
)  # fmt: skip
SEEDS = 3


def commands(group: click.Command, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if not isinstance(group, click.Group):
        yield path
        return
    with click.Context(group) as context:
        for name in group.list_commands(context):
            found = group.get_command(context, name)
            assert found is not None
            yield from commands(found, (*path, name))


def command_of(path: tuple[str, ...]) -> click.Command:
    found: click.Command = daranti
    for name in path:
        assert isinstance(found, click.Group)
        with click.Context(found) as context:
            found = found.get_command(context, name)  # type: ignore[assignment]
    return found


ALL = [path for path in commands(daranti) if path[0] not in ENDLESS]


def spoiled(folder: Path, seed: int) -> list[str]:
    """Files of every suffix that hold nothing sound, and places that are no files."""
    source = random.Random(seed)
    contents = (
        b"",
        source.randbytes(400),
        b"{" * 5000,
        b"\x89PNG\r\n\x1a\n" + source.randbytes(90),
        b"\xff\xd8\xff\xe0" + source.randbytes(90),
        b"\x89MCAP0\r\n" + source.randbytes(200),
        b"PK\x03\x04" + source.randbytes(200),
        b"<kml><Placemark><Polygon/></Placemark></kml>",
        b"$GPGGA,1,,,,,,,,\r\n" * 9,
        b"steer_kp: [1]\n\x1b[2J",
        b"file,standing_side\n\x07,left\n",
        b"1e999,-1e999\nnan,nan\n0,0\n",
    )
    made = [str(folder), "/proc/self/mem", "/dev/null", str(folder / "not" / "there.csv"), ""]
    for number, suffix in enumerate(SUFFIXES):
        path = folder / f"\x1b[31mbad{number}{suffix}"
        path.write_bytes(source.choice(contents))
        made.append(str(path))
    return made


def arguments(
    command: click.Command, source: random.Random, files: list[str], board: str
) -> list[str]:
    """What every parameter must have, and some of the others; half of it wrong."""
    words: list[str] = []
    for param in command.params:
        if isinstance(param, click.Option) and (
            param.is_eager or (not param.required and source.random() < 0.6)
        ):
            continue
        if isinstance(param, click.Option) and param.is_flag:
            words.append(param.opts[0])
            continue
        value = _value(param, source, files)
        if param.name == "port" and "page" not in {p.name for p in command.params}:
            value = board
        words += [param.opts[-1], value] if isinstance(param, click.Option) else [value]
    return words


def _value(param: click.Parameter, source: random.Random, files: list[str]) -> str:
    wrong = source.random() < 0.1
    if isinstance(param.type, click.Choice) and not wrong:
        return source.choice(list(param.type.choices))
    if isinstance(param.type, click.IntRange | click.FloatRange) and not wrong:
        return str(source.choice([param.type.min, param.type.max, 1]) or 1)
    if param.name in ("out", "picture") and source.random() < 0.5:
        return source.choice(["/proc/x/y.csv", "/dev/full", "/proc/x.geojson"])
    if wrong:
        return source.choice(["nan", "-1", "1e999", "\x1b]0;x\x07", "[/nope]", "é" * 300])
    return source.choice(files)


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_wrong_arguments_and_files_are_one_message(
    path: tuple[str, ...],
    seed: int,
    cli: Cli,
    board: FakeFirmware,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DARANTI_DATA", str(tmp_path / "none"))  # nothing is learnt or scored here
    monkeypatch.setattr("host.runs.sources.FIRST_PICTURE_S", 0.1)
    monkeypatch.setattr("host.runs.errand.FIRST_FIX_S", 0.1)
    source = random.Random(f"{path} {seed}")
    files = spoiled(tmp_path, seed)
    for _ in range(4):
        words = [
            w.replace("\0", "") for w in arguments(command_of(path), source, files, board.port)
        ]
        code, out, err = cli(*path, *words)
        told = f"{path} {words}: {code} {err}"
        assert code in MEANT, told
        assert code != EXIT_SOFTWARE, told
        assert "\x1b" not in out + err, told
        if code:
            assert err.strip(), told
