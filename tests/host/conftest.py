"""What the host's tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from host.commands.cli import daranti
from host.core.errors import run
from host.estimate.position import Position
from host.route.side import Side
from tests.helpers.console import Cli
from tests.helpers.eyes import ToldEnd
from tests.helpers.fake_firmware import FakeFirmware
from tests.helpers.terminal import Terminal


@pytest.fixture
def board() -> Iterator[FakeFirmware]:
    """A firmware's stand-in on a pseudo-terminal."""
    firmware = FakeFirmware()
    yield firmware
    firmware.unplug()


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `daranti` as its console script does: (exit code, stdout, stderr)."""

    def call(*args: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as exit_:
            run(daranti, "daranti", args)
        out, err = capsys.readouterr()
        assert isinstance(exit_.value.code, int)
        assert "Traceback" not in err
        return exit_.value.code, out, err

    return call


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    """A terminal to be asked at."""
    made = Terminal()
    yield made
    made.close()


@pytest.fixture
def told_ends(monkeypatch: pytest.MonkeyPatch) -> list[ToldEnd]:
    """Every end of a side that the position is told of, and does not take."""
    told: list[ToldEnd] = []

    def at_end(_position: Position, _side: Side, *end: float, **_: bool) -> None:
        told.append(ToldEnd(*end))

    monkeypatch.setattr(Position, "at_end", at_end)
    return told
