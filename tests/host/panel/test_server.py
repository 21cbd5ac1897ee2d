"""The panel as it is served: who is let in, what is bounded, and STOP."""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from queue import Queue

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from host.link import protocol
from host.panel.body import BODY_BYTES
from host.panel.guard import CODE_S, GUESSES, WAIT_S
from host.panel.server import PAGES
from host.panel.strict_http import AN_ADDRESS, HEAD_S
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.served_panel import Served, now, served

JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def board() -> Iterator[FakeFirmware]:
    firmware = FakeFirmware()
    yield firmware
    firmware.unplug()


@pytest.fixture(scope="module")
def panel(board: FakeFirmware, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("p")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        with served(board.port, folder) as found:
            yield found


def test_every_part_of_the_page_is_served_and_light(panel: Served) -> None:
    status, page, headers = panel.ask("GET", "/")
    assert status == 200
    assert "default-src 'self'" in headers["content-security-policy"]
    names = set(re.findall(r'(?:src|href)="([^"]+)"', page.decode()))
    done: set[str] = set()
    while names - done:
        name = (names - done).pop()
        done.add(name)
        status, body, _ = panel.ask("GET", "/" + name)
        assert status == 200, name
        names |= {f"static/{one.decode()}" for one in re.findall(rb'from "\./(\w+\.js)"', body)}
    assert len(done) > 8
    folder = Path(__file__).parents[3] / "host" / "panel"
    weight = sum(
        f.stat().st_size for room in ("static", "texts") for f in (folder / room).iterdir()
    )
    assert weight < 500_000


def test_nothing_on_the_page_is_asked_of_anybody_else() -> None:
    folder = Path(__file__).parents[3] / "host" / "panel" / "static"
    for file in folder.iterdir():
        found = re.findall(r"(?:https?|wss?)://[^\s\"'`$]+", file.read_text(encoding="utf-8"))
        assert [one for one in found if "www.w3.org/2000/svg" not in one] == [], file.name


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "localhost.evil:1", ""])
def test_a_foreign_host_is_refused(panel: Served, host: str) -> None:
    status, body, _ = panel.ask("GET", "/", headers={"Host": host})
    assert status == 421
    assert b"<html" not in body


def test_a_foreign_origin_is_refused(panel: Served) -> None:
    for origin in ("http://evil.example", "null"):
        headers = JSON | {"Origin": origin}
        assert panel.ask("POST", "/stop", b"{}", headers)[0] == 421
        with pytest.raises(InvalidStatus):
            connect(f"ws://{panel.host}/live", origin=origin)  # type: ignore[arg-type]
    with pytest.raises(InvalidStatus):
        connect(f"ws://{panel.host}/live")  # a browser always names its origin


def test_what_is_not_there_is_not_served(panel: Served) -> None:
    for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/panel.json", "/texts/"):
        assert panel.ask("GET", path)[0] == 404


def test_stop_reaches_the_board_and_is_confirmed_by_it(panel: Served, board: FakeFirmware) -> None:
    page = panel.page()
    page.until(
        lambda m: m["kind"] == "now" and m["board"] is not None and m["link"]["problem"] == ""
    )
    board.telemetry = replace(RESTING, state=protocol.State.RUNNING, drive_duty=90)
    page.until(lambda m: m["kind"] == "now" and m["board"]["state"] == "RUNNING")
    board.received.clear()
    page.ask("stop", id="one")
    told = page.until(lambda m: m["kind"] == "now" and m["stop"] and m["stop"]["id"] == "one")
    assert board.wait_for(protocol.Stop)
    assert not told["stop"]["confirmed"]  # the server has heard it; the board has not said so
    late = page.until(lambda m: m["kind"] == "now" and m["stop"]["problem"] != "")
    assert not late["stop"]["confirmed"]
    board.telemetry = RESTING
    done = page.until(lambda m: m["kind"] == "now" and m["stop"]["confirmed"])
    assert done["board"]["off"]
    page.close()


def test_stop_works_without_a_websocket(panel: Served, board: FakeFirmware) -> None:
    board.received.clear()
    status, body, _ = panel.ask("POST", "/stop", b"{}", JSON | {"Origin": f"http://{panel.host}"})
    assert (status, json.loads(body)) == (200, {"reached": True})
    assert board.wait_for(protocol.Stop)


def test_a_watching_page_may_stop_and_nothing_else(panel: Served, board: FakeFirmware) -> None:
    driver, watcher = panel.page(), panel.page()
    driver.ask("take")
    driver.until(now(driver=True))
    watcher.ask("take")
    watcher.until(lambda m: m == {"kind": "refused", "what": "take"})
    watcher.ask("clear")
    watcher.until(lambda m: m == {"kind": "refused", "what": "watching"})
    board.received.clear()
    watcher.ask("stop", id="w")
    assert board.wait_for(protocol.Stop)
    assert not any(isinstance(message, protocol.Clear) for message in board.received)
    driver.close()
    watcher.until(now(driven=False))
    watcher.ask("take")
    watcher.until(now(driver=True))
    watcher.close()


def test_nothing_starts_without_a_hold_and_a_green_check(
    panel: Served, board: FakeFirmware
) -> None:
    page = panel.page()
    page.ask("take")
    page.until(now(driver=True))
    board.received.clear()
    page.ask("hold")
    page.ask("start")
    page.until(lambda m: m == {"kind": "refused", "what": "hold"})
    page.ask("hold")
    held = time.monotonic()
    page.until(lambda _: time.monotonic() - held > 2.0)
    page.ask("start")
    page.until(lambda m: m == {"kind": "refused", "what": "check"})
    assert not any(isinstance(message, protocol.Arm) for message in board.received)
    page.close()


def test_large_bodies_and_messages_are_refused(panel: Served) -> None:
    headers = JSON | {"Origin": f"http://{panel.host}"}
    assert panel.ask("POST", "/pair", b"x" * (BODY_BYTES + 1), headers)[0] == 403
    page = panel.page()
    page.socket.send("x" * 100_000)
    with pytest.raises(ConnectionClosed):
        while True:
            page.socket.recv(timeout=10)
    other = panel.page()
    for nonsense in ("{", "[]", "7", '{"do": 7}', '{"do": "start", "order": 7}'):
        other.socket.send(nonsense)
    other.until(now())
    other.close()


def test_so_many_pages_are_open_at_most(panel: Served) -> None:
    pages = [panel.page() for _ in range(PAGES)]
    with pytest.raises((InvalidStatus, ConnectionClosed)):
        panel.page().socket.recv(timeout=5)
    for page in pages:
        page.close()


def test_half_open_requests_end_and_keep_nobody_out(panel: Served) -> None:
    slow = [socket.create_connection(("127.0.0.1", panel.port)) for _ in range(AN_ADDRESS + 34)]
    for one in slow:
        one.settimeout(HEAD_S + 5)
        try:
            one.sendall(b"GET / HTTP/1.1\r\nHost: ")
        except OSError:
            continue
    ended = 0
    for one in slow:
        try:
            ended += one.recv(1) == b""
        except ConnectionError:
            ended += 1
        one.close()
    assert ended == len(slow)
    assert panel.ask("GET", "/")[0] == 200


def test_on_the_network_a_code_lets_in(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        with served("/dev/null-port", tmp_path, lan=True) as found:
            origin = JSON | {"Origin": f"http://{found.host}"}
            assert found.ask("POST", "/stop", b"{}", origin)[0] == 401
            with pytest.raises((InvalidStatus, ConnectionClosed)):
                found.page().socket.recv(timeout=5)
            old = found.panel.pairing.code
            status, _, headers = found.ask(
                "POST", "/pair", json.dumps({"code": old}).encode(), origin
            )
            cookie = headers["set-cookie"]
            assert status == 200
            assert "HttpOnly" in cookie
            assert "SameSite=strict" in cookie
            found.page(Cookie=cookie.split(";")[0]).until(now(), 60)
            assert found.ask("POST", "/pair", json.dumps({"code": old}).encode(), origin)[0] == 403


def test_the_laptop_shows_the_next_code_after_each_that_no_longer_pairs(tmp_path: Path) -> None:
    shown: Queue[tuple[str, float]] = Queue()
    ahead_s = 0.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        with served(
            "/dev/null-port",
            tmp_path,
            lan=True,
            clock=lambda: time.monotonic() + ahead_s,
            show_code=lambda code, wait_s: shown.put((code, wait_s)),
        ) as found:
            origin = JSON | {"Origin": f"http://{found.host}"}

            def pairs(code: str) -> bool:
                body = json.dumps({"code": code}).encode()
                return found.ask("POST", "/pair", body, origin)[0] == 200

            first, waits = shown.get(timeout=20)
            assert waits == 0
            assert pairs(first)
            second, _ = shown.get(timeout=20)
            assert second != first
            assert pairs(second)  # another phone
            shown.get(timeout=20)
            assert not any(pairs("WRONG") for _ in range(GUESSES))
            after_guesses, waits = shown.get(timeout=20)
            assert 0 < waits <= WAIT_S
            assert not pairs(after_guesses)
            ahead_s += WAIT_S
            assert pairs(after_guesses)
            shown.get(timeout=20)
            ahead_s += CODE_S + 1
            assert pairs(shown.get(timeout=20)[0])
