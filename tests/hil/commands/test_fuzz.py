"""Every command of the bench against arguments and files that are wrong: one message, an exit code
that means something, nothing internal. A folder that cannot be written is told before any work."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from hil.commands.cli import cli
from hil.firmware import targets
from host.core.errors import run
from tests.helpers.spoiled import arguments, command_of, commands, judge, spoiled

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
NOWHERE = "/proc/x/y"
"""Nothing can be written there: no command gets as far as its work."""
LENGTHY = {"vary", "compare"}
"""Options of a work that writes nothing."""
SEEDS = 2


def folders(folder: Path, source: random.Random) -> list[str]:
    """Of results that are none."""
    contents = ("", "{", "[]", "{}", "[{}]", '{"outcome": 1}', '{"faults": [{}]}', '{"faults": 3}')
    made = []
    for name in ("summary.json", "campaign.json", "rig.json", "record.mcap"):
        for text in contents:
            here = folder / f"results{len(made)}{name}"
            here.mkdir()
            (here / name).write_text(text)
            made.append(str(here))
    return source.sample(made, len(made)) * 2


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("path", list(commands(cli)), ids=" ".join)
def test_wrong_arguments_and_files_are_one_message(
    path: tuple[str, ...],
    seed: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DARANTI_DATA", str(tmp_path / "none"))
    source = random.Random(f"{path} {seed}")
    files = spoiled(tmp_path, seed) + folders(tmp_path, source)
    command = command_of(cli, path)
    for _ in range(4):
        words = [
            word.replace("\0", "") for word in arguments(command, source, files, without=LENGTHY)
        ]
        if any(each.name == "out" for each in command.params):
            words += ["--out", NOWHERE]
        with pytest.raises(SystemExit) as exit_:
            run(cli, "daranti-hil", [*path, *words])
        out, err = capsys.readouterr()
        assert isinstance(exit_.value.code, int)
        judge([*path, *words], exit_.value.code, out, err)
