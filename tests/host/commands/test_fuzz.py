"""Every command against arguments and files that are wrong: one message, an exit code that means
something, nothing internal."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from host.commands.cli import daranti
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import FakeFirmware
from tests.helpers.spoiled import arguments, command_of, commands, judge, spoiled

ENDLESS = {"panel", "monitor"}
"""They run until Ctrl-C."""
SEEDS = 3
ALL = [path for path in commands(daranti) if path[0] not in ENDLESS]


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
    monkeypatch.setattr("host.runs.first_picture.FIRST_PICTURE_S", 0.1)
    monkeypatch.setattr("host.runs.errand.FIRST_FIX_S", 0.1)
    monkeypatch.setattr("host.check.receiver.FIX_S", 0.1)
    monkeypatch.setattr("host.check.camera.PICTURE_S", 0.1)
    monkeypatch.setattr("host.check.gyroscope.PATIENCE_S", 0.1)
    source = random.Random(f"{path} {seed}")
    files = spoiled(tmp_path, seed)
    for _ in range(4):
        words = [
            w.replace("\0", "")
            for w in arguments(command_of(daranti, path), source, files, board.port)
        ]
        judge([*path, *words], *cli(*path, *words))
