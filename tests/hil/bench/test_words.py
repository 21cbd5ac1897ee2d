"""Facts about what the bench's commands say of wrong input, and whom they let in."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path

import pytest

from hil.bench.ports import Rfc2217Port, TcpPort
from hil.bench.replay import replay
from hil.commands.cli import cli
from hil.commands.harvest import written_since
from host.core.errors import EXIT_USER, UserError, run
from host.core.vehicle import Vehicle
from host.runs.record import Recorder


def told(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", words)
    assert exit_.value.code == EXIT_USER
    err = capsys.readouterr().err
    assert "internal error" not in err
    return err


def record_of(path: Path, **about: str) -> Path:
    with Recorder(path, about) as recorder:
        recorder.put("/operator", 0.0, {"paused": False})
    return path


def test_a_firmware_that_is_none_is_told_what_there_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert "desk, avr or serial:PORT" in told(capsys, "rig", "--firmware", "foo")


def test_a_folder_named_like_a_scenario_is_no_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nosuch").mkdir()
    assert "no scenario is named 'nosuch'" in told(capsys, "harvest", "--scenario", "nosuch")
    (tmp_path / "off.yaml").write_text("mode: off\n")
    err = told(capsys, "harvest", "--scenario", "off.yaml")
    assert "put a word in quotes" in err
    (tmp_path / "deep.yaml").write_text("{" * 5000)
    assert "not YAML" in told(capsys, "harvest", "--scenario", "deep.yaml")


def test_replay_names_the_field_or_the_parameter_that_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record_of(tmp_path / "a.mcap", vehicle=Vehicle().model_dump_json())
    err = told(capsys, "replay", str(path), "--vehicle", "foo=25")
    assert "foo: no such field" in err
    assert err.count("\n") == 1
    assert "no such parameter" in told(capsys, "replay", str(path), "--param", "foo=1")


@pytest.mark.parametrize(
    "about",
    [{"vehicle": "{"}, {"vehicle": json.dumps({"wheelbase_m": -1})}, {"scenario": "[]"},
     {"vehicle": "{}", "plan": "{}"}],
)  # fmt: skip
def test_a_record_that_is_not_understood_is_one_message(
    tmp_path: Path, about: dict[str, str]
) -> None:
    with pytest.raises(UserError, match="is not understood"):
        replay(record_of(tmp_path / "a.mcap", **about))


def test_only_this_machine_is_let_in_unless_told() -> None:
    port = TcpPort(0)
    try:
        assert port.name.startswith("socket://127.0.0.1:")
    finally:
        port.close()


def test_a_negotiation_that_is_none_hangs_up_and_the_next_may_come() -> None:
    port = Rfc2217Port(0)
    number = int(port.name.rpartition(":")[2])
    try:
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", number), 5) as client:
                while not port.read() and not client.getpeername():
                    pass
                client.sendall(b"\xff\xfa\x2c\x02\xff\xf0" * 3)  # SET-DATASIZE without a size
                for _ in range(1000):
                    port.read()
    finally:
        port.close()


def test_what_an_earlier_run_has_left_is_not_announced(tmp_path: Path) -> None:
    (tmp_path / "old.png").touch()
    os.utime(tmp_path / "old.png", (1000.0, 1000.0))
    (tmp_path / "new.png").touch()
    os.utime(tmp_path / "new.png", (3000.0, 3000.0))
    assert written_since(tmp_path, 2000.0) == ["new.png"]
