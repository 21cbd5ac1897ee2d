"""Wrong arguments and files for every command of a console script."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import click

from host.core.errors import EXIT_FAULT, EXIT_UNFINISHED, EXIT_USER

MEANT = (0, EXIT_USER, EXIT_UNFINISHED, EXIT_FAULT)
SUFFIXES = (
    ".geojson", ".kml", ".shp", ".xml", ".zip", ".gpx", ".csv", ".yaml", ".json", ".mcap", ".jpg",
    ".png", ".mp4", ".nmea", ".hex", ".elf", ".sqlite", "",
)  # fmt: skip


def commands(group: click.Command, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The verbs of a console script, with those of its groups."""
    if not isinstance(group, click.Group):
        yield path
        return
    with click.Context(group) as context:
        for name in group.list_commands(context):
            found = group.get_command(context, name)
            assert found is not None
            yield from commands(found, (*path, name))


def command_of(group: click.Command, path: tuple[str, ...]) -> click.Command:
    """The command behind a verb."""
    found = group
    for name in path:
        assert isinstance(found, click.Group)
        with click.Context(found) as context:
            found = found.get_command(context, name)  # type: ignore[assignment]
    return found


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
    command: click.Command,
    source: random.Random,
    files: list[str],
    board: str = "",
    without: Collection[str] = (),
) -> list[str]:
    """What every parameter must have, and some of the others but those `without`; half of it
    wrong."""
    words: list[str] = []
    for param in command.params:
        if isinstance(param, click.Option) and (
            param.is_eager
            or param.name in without
            or (not param.required and source.random() < 0.6)
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


def judge(words: Sequence[str], code: int, out: str, err: str) -> None:
    """What every answer to wrong words has to be."""
    told = f"{words}: {code} {err}"
    assert code in MEANT, told
    assert "\x1b" not in out + err, told
    if code:
        assert err.strip(), told
