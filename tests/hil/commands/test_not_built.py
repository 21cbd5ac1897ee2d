"""A firmware that is not built is told before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.commands.cli import cli
from hil.firmware import targets
from host.core.errors import EXIT_USER, run

DESK = [
    "beliefs",
    "campaign",
    "commission",
    "consistency",
    "constants --vary all",
    "eyes judge",
    "faults",
    "harvest",
    "identify",
    "moments",
    "rig",
    "sweep --workers 0",
]
AVR = [
    "beliefs --firmware avr",
    "campaign --set firmware=desk,avr",
    "commission --set firmware=avr",
    "faults --firmware mega2560",
    "harvest --firmware avr",
    "identify --firmware avr",
    "rig --firmware avr",
    "sweep --firmware avr --workers 0",
    "sweep --spot-check 1 --workers 0",
]


@pytest.mark.parametrize(
    ("words", "missing"), [(w, "DESK_LIBRARY") for w in DESK] + [(w, "AVR_LIBRARY") for w in AVR]
)
def test_a_build_that_is_missing_is_one_message_before_any_work(
    words: str,
    missing: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def worked(*_: object, **__: object) -> None:
        raise AssertionError("it works already")

    monkeypatch.chdir(tmp_path)
    # What is there besides is taken for built: another of them may not be, here.
    monkeypatch.setattr(targets, "DESK_LIBRARY", tmp_path)
    monkeypatch.setattr(targets, "AVR_LIBRARY", tmp_path)
    monkeypatch.setattr(targets, missing, tmp_path / "none.so")
    monkeypatch.setattr(targets.Target, "__init__", worked)
    monkeypatch.setattr("subprocess.Popen", worked)
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", words.split())
    assert exit_.value.code == EXIT_USER
    out, err = capsys.readouterr()
    assert err == (
        f"daranti-hil: {tmp_path / 'none.so'} is missing: the firmware is not built; "
        "run `make build`\n"
    )
    assert out == ""
    assert list(tmp_path.iterdir()) == []
