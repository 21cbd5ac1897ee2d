"""What names nothing is told before any work."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.commands.cli import cli
from host.core.errors import EXIT_USER, run


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("faults --camera roof --out /proc/x", "--camera roof: no such mount; there are low, mast"),
        ("constants --vary zzz", "--vary zzz: no constant has that in its path or name"),
    ],
)
def test_a_wrong_name_is_one_message_before_any_work(
    words: str, message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def driven(*_: object) -> None:
        raise AssertionError("it works already")

    monkeypatch.setattr("hil.commands.constants.driven", driven)
    monkeypatch.setattr("hil.commands.faults.run_matrix", driven)
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", words.split())
    assert exit_.value.code == EXIT_USER
    assert capsys.readouterr().err == f"daranti-hil: {message}\n"


def test_no_moment_at_all_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.commands.moments.moments", lambda *_, **__: [])
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", ["moments", "--every", "9000", "--out", str(tmp_path / "m.json")])
    assert exit_.value.code == EXIT_USER
    assert "no harvest lasted as long as --every 9000" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        "campaign --workers 257",
        "eyes fit --workers 257",
        "faults --workers 257",
        "identify --workers 257",
        "identify --plants 100001",
        "sweep --workers 257",
        "sweep --trials 1000001",
        "sweep --plants 100001",
        "vision --workers 257",
    ],
)
def test_a_slip_of_the_finger_starts_no_thousand_processes(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", words.split())
    assert exit_.value.code == EXIT_USER
    *_, option, count = words.split()
    assert f"Invalid value for '{option}': {count} is not in the range" in capsys.readouterr().err
