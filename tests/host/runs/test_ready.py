"""What is loaded before a drive costs no time in it."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest

from host.core.errors import EXIT_USER, UserError
from host.panel import __main__ as machine_process
from host.panel.machine import Settings
from host.pilot.pilot import Pilot
from host.runs.ready import make_ready
from tests.helpers.console import Cli


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


@pytest.mark.parametrize(
    ("module", "arguments"),
    [
        ("host.runs.session", ["drive", "--yes", "--camera", "http://127.0.0.1:1/video"]),
        ("host.commands.check", ["check"]),
        ("host.commands.panel", ["panel", "--web-port", "0"]),
    ],
)
def test_what_drives_is_made_ready_before_any_port_is_opened(
    module: str,
    arguments: list[str],
    cli: Cli,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(f"{module}.make_ready_visibly", enough)
    code, _, err = cli(*arguments, "--port", str(tmp_path / "no board"))
    assert (code, err) == (EXIT_USER, "daranti: made ready\n")


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
