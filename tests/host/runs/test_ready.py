"""What is loaded before a drive costs no time in it."""

from __future__ import annotations

import gc
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from host.core.errors import EXIT_USER, UserError
from host.panel import __main__ as machine_process
from host.panel.machine import Settings
from host.pilot.pilot import Pilot
from host.runs.ready import make_ready
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import FakeFirmware


@pytest.fixture(autouse=True)
def _thawed() -> Iterator[None]:
    """Other tests drive, too."""
    gc.unfreeze()
    yield
    gc.unfreeze()


def test_pythons_collector_looks_no_more_through_what_is_loaded() -> None:
    assert any(each is Pilot for each in gc.get_objects())
    make_ready()
    later = [[]]
    left = gc.get_objects()
    assert not any(each is Pilot for each in left)
    assert any(each is later for each in left)


def enough() -> None:
    raise UserError("made ready")


DRIVERS = [
    ("host.runs.session", ["drive", "--yes", "--camera", "http://127.0.0.1:1/video"]),
    ("host.commands.check", ["check"]),
    ("host.commands.panel", ["panel", "--web-port", "0"]),
]


Begun = Callable[[str, list[str]], tuple[int, str]]


@pytest.fixture
def begun(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Begun:
    """Exit code and messages of a command that ends where it would make ready."""
    monkeypatch.chdir(tmp_path)

    def run(module: str, words: list[str]) -> tuple[int, str]:
        monkeypatch.setattr(f"{module}.make_ready_visibly", enough)
        code, _, err = cli(*words)
        return code, err

    return run


@pytest.mark.parametrize(("module", "words"), DRIVERS)
def test_what_drives_is_made_ready_before_any_port_is_opened(
    module: str, words: list[str], begun: Begun, board: FakeFirmware
) -> None:
    assert begun(module, [*words, "--port", board.port]) == (EXIT_USER, "daranti: made ready\n")
    assert board.received == []


NOWHERE = "/nowhere/field.geojson"


@pytest.mark.parametrize(("module", "words"), DRIVERS)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (["--port", "socket://x"], "cannot connect to socket://x"),
        (["--boundary", NOWHERE], f"cannot read the boundary {NOWHERE}"),
        (["--mount", "roof"], "no camera mount 'roof'"),
        (["--vehicle", "/nowhere/machine.yaml"], "cannot read the vehicle file"),
        (["--gnss", "tcp://phone"], "GNSS address tcp://phone"),
        (["--camera", "ftp://phone"], "camera address ftp://phone"),
        (["--gyro", "http://"], "gyroscope address http://"),
    ],
    ids=lambda each: each[0] if isinstance(each, list) else "",
)
def test_what_costs_nothing_to_look_at_is_looked_at_first(
    module: str,
    words: list[str],
    wrong: list[str],
    message: str,
    begun: Begun,
    board: FakeFirmware,
) -> None:
    """Nobody waits half a minute to read that a name was mistyped."""
    code, err = begun(module, [*words, "--port", board.port, *wrong])
    assert code == EXIT_USER
    assert message in err
    assert "made ready" not in err


@pytest.mark.parametrize(("module", "words"), DRIVERS)
def test_a_port_that_is_not_there_is_told_first(
    module: str, words: list[str], begun: Begun
) -> None:
    """The panel waits for it."""
    code, err = begun(module, [*words, "--port", "/dev/no-such-port"])
    assert code == EXIT_USER
    first, *rest = err.splitlines()
    assert "serial port /dev/no-such-port does not exist; ports there now" in first
    waits = words[0] == "panel"
    assert first.startswith("warning: " if waits else "daranti: ")
    assert rest == (["daranti: made ready"] if waits else [])


def test_a_taken_port_of_the_page_is_told_first(begun: Begun, board: FakeFirmware) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = str(taken.getsockname()[1])
        words = ["panel", "--port", board.port, "--web-port", number]
        code, err = begun("host.commands.panel", words)
    assert code == EXIT_USER
    assert f"port {number}: Address already in use" in err
    assert "name another with --web-port" in err


def test_the_machines_process_is_ready_before_a_panel_reaches_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the panel has compiled in its own process is but in the cache."""
    settings, place = tmp_path / "machine.json", tmp_path / "machine.sock"
    settings.write_text(Settings(port="none").model_dump_json())
    monkeypatch.setattr(machine_process, "make_ready", enough)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    with pytest.raises(UserError, match="made ready"):
        machine_process.main(str(settings), str(place))
    assert not place.exists()
