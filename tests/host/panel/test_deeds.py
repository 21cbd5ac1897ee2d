"""What a page asks of the machine's process, against a board that only remembers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from host.link import protocol
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.served_panel import Served, now, served


@pytest.fixture
def board() -> Iterator[FakeFirmware]:
    firmware = FakeFirmware()
    yield firmware
    firmware.unplug()


@pytest.fixture
def panel(board: FakeFirmware, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("p")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        with served(board.port, folder) as found:
            yield found


def drives(board: FakeFirmware) -> list[protocol.Drive]:
    return [m for m in list(board.received) if isinstance(m, protocol.Drive) and m.speed != 0]


def test_a_finger_creeps_without_the_blade_and_stop_ends_it_for_good(
    panel: Served, board: FakeFirmware
) -> None:
    page = panel.page()
    page.ask("take")
    page.until(lambda m: m["kind"] == "now" and m["driver"] and m["link"]["problem"] == "", 60)
    page.ask("jog", speed=1, steer_deg=5)
    page.until(now(mode="jog"))
    board.telemetry = replace(RESTING, state=protocol.State.ARMED)
    held = time.monotonic()
    while time.monotonic() - held < 1.0:
        page.ask("jog", speed=1, steer_deg=5)
        page.until(now(mode="jog"))
    moved = drives(board)
    assert moved
    assert all(0 < m.speed < 0.2 and m.blade == 0 for m in moved)
    page.ask("stop", id="one")
    board.wait_for(protocol.Stop)
    board.telemetry = RESTING
    page.until(now(mode="idle"))
    board.received.clear()
    for _ in range(3):  # the finger is still down
        page.ask("jog", speed=1, steer_deg=5)
        page.until(now())
    assert not any(isinstance(m, protocol.Arm) for m in list(board.received))
    assert drives(board) == []
    page.close()
