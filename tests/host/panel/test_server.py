"""The panel as it is served: who is let in, what is bounded, and STOP."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from queue import Queue

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from host.core.vehicle import Vehicle
from host.link import protocol
from host.panel import server
from host.panel.body import BODY_BYTES
from host.panel.fields import FieldDesk
from host.panel.guard import CODE_S, GUESSES, WAIT_S, Pairing
from host.panel.machine import Settings
from host.panel.server import HOLD_S, IN_SIGHT, LATE_S, PAGES, TOLD_ONCE, Page, Panel, runs
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


def test_what_was_asked_on_the_sight_of_another_state_comes_too_late(
    panel: Served, board: FakeFirmware
) -> None:
    """A link that hangs keeps a tap, and hands it over when nobody expects it any more."""
    page = panel.page()
    page.ask("take")
    before = page.until(
        lambda m: m["kind"] == "now" and m["driver"] and m["link"]["problem"] == "", 60
    )
    late = page.until(lambda m: m["kind"] == "now" and m["t"] - before["t"] > LATE_S + 0.1)
    heard = panel.panel.seat.heard
    board.received.clear()
    for seen in (before["t"], late["t"] + 60, None, "now"):
        for what in sorted(IN_SIGHT - {"here"}):
            page.ask(what, seen=seen)
            page.until(lambda m: m == {"kind": "refused", "what": "late"})
        page.ask("here", seen=seen)
    page.until(now(mode="idle"))
    assert panel.panel.seat.heard == heard, "nor is it a sign of life"
    assert not any(isinstance(m, protocol.Arm | protocol.Clear) for m in list(board.received))
    page.ask("stop", seen=before["t"], id="late")
    assert board.wait_for(protocol.Stop), "STOP is never too late"
    page.ask("clear")
    assert board.wait_for(protocol.Clear)
    page.close()


def test_a_stop_ends_the_holding_of_the_start_button(panel: Served) -> None:
    """Of whatever page: a finger that is still down starts nothing."""
    for way in ("another page", "post"):
        page, other = panel.page(), panel.page()
        page.ask("take")
        page.until(now(driver=True))
        page.ask("hold")
        page.until(now(driver=True))
        if way == "post":
            headers = JSON | {"Origin": f"http://{panel.host}"}
            assert panel.ask("POST", "/stop?id=p", b"{}", headers)[0] == 200
            named = "p"
        else:
            other.ask("stop", id="o")
            named = "o"
        told = page.until(lambda m, name=named: m["kind"] == "now" and m["stop"]["id"] == name)
        assert told["stop"]["id"] == named
        held = time.monotonic()
        page.until(lambda _, since=held: time.monotonic() - since > HOLD_S)
        page.ask("start")
        page.until(lambda m: m == {"kind": "refused", "what": "hold"})
        page.close()
        other.close()


def test_a_stop_whose_name_is_a_book_stops_and_is_not_read_to_everybody(
    panel: Served, board: FakeFirmware
) -> None:
    page = panel.page()
    for name in ("x" * 50_000, {"a": ["b"] * 1000}, 7):
        board.received.clear()
        page.ask("stop", id=name)
        assert board.wait_for(protocol.Stop)
        told = page.until(lambda m: m["kind"] == "now" and m["stop"] and m["stop"]["confirmed"])
        assert len(json.dumps(told["stop"])) < 200
    page.close()


def test_a_form_without_a_script_stops_and_brings_the_page_again(
    panel: Served, board: FakeFirmware
) -> None:
    """The scripts may not have come: STOP is a form of its own."""
    board.received.clear()
    headers = {
        "Content-Type": "application/x-www-form-urlencoded",
        "Origin": f"http://{panel.host}",
    }
    status, _, answered = panel.ask("POST", "/stop", b"", headers)
    assert (status, answered["location"]) == (303, "/")
    assert board.wait_for(protocol.Stop)


def test_a_page_that_repeats_its_stop_learns_that_the_board_does_not_confirm(
    panel: Served, board: FakeFirmware
) -> None:
    page = panel.page()
    page.until(lambda m: m["kind"] == "now" and m["link"]["problem"] == "", 60)
    board.telemetry = replace(RESTING, state=protocol.State.RUNNING, drive_duty=90)
    page.until(lambda m: m["kind"] == "now" and m["board"]["state"] == "RUNNING")
    asked = time.monotonic()

    def late(message: dict[str, object]) -> bool:
        page.ask("stop", id="again")
        stop = message.get("stop")
        return isinstance(stop, dict) and stop["id"] == "again" and stop["problem"] != ""

    page.until(late)
    assert time.monotonic() - asked > 1.0
    board.telemetry = RESTING
    page.until(lambda m: m["kind"] == "now" and m["stop"]["confirmed"])
    page.close()


def test_a_run_that_goes_on_is_none_where_nothing_is_left(
    panel: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who asks to go on does not want to begin anew at the corner; and no wrong figure is left out
    in silence."""
    monkeypatch.setattr(type(panel.panel), "green", True)
    page = panel.page()
    page.ask("take")
    page.until(now(driver=True))
    asked: list[object] = []
    monkeypatch.setattr(panel.panel.line, "ask", lambda wish: bool(asked.append(wish)) or True)
    for wish, refused in (
        ({"resume": True}, "resume"),
        ({"heading_deg": 400}, "heading"),
        ({"heading_deg": "east"}, "heading"),
    ):
        page.ask("hold")
        held = time.monotonic()
        page.until(lambda _, since=held: time.monotonic() - since > HOLD_S)
        page.ask("start", **wish)
        page.until(lambda m, why=refused: m == {"kind": "refused", "what": why})
    assert asked == []
    page.close()


def test_while_the_machines_process_is_gone_nothing_old_is_told(
    board: FakeFirmware, tmp_path: Path
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        with served(board.port, tmp_path) as found:
            page = found.page()
            page.until(now(), 60)
            process = found.panel.line._process
            assert process is not None
            process.send_signal(signal.SIGSTOP)  # it hangs: its socket stays open
            try:
                page.until(lambda m: m["kind"] == "alone")
                other = found.page()
                first = other.until(lambda m: m["kind"] in ("now", "alone"))
                assert first["kind"] == "alone"
                other.close()
            finally:
                process.kill()
            page.until(now(), 60)  # it is started again
            page.close()


def test_why_the_machines_process_does_not_run_is_told_and_tried_on(tmp_path: Path) -> None:
    """A folder that is on no disk just now; a vehicle file that was spoiled."""
    folder = tmp_path / "stick"
    vehicle = tmp_path / "machine.yaml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        vehicle.write_text("{}")
        with served("/dev/null-port", folder, vehicle=vehicle) as found:
            vehicle.write_text("wheelbase_m: none")
            page = found.page()
            page.until(lambda m: m["kind"] == "alone" and "stick/machine.log" in m["why"])
            folder.mkdir()
            page.until(lambda m: m["kind"] == "alone" and "wheelbase_m" in m["why"], 60)
            vehicle.write_text("{}")
            page.until(now(), 60)
            page.close()


@pytest.mark.parametrize("seen", ["silence", "a new process", "a hang before it"])
def test_a_run_whose_process_died_can_be_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seen: str
) -> None:
    """As after a crash of the laptop; a process that only hangs may go on itself."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(server, "SILENT_S", 0.01)
    settings = Settings(port="/dev/none", folder=tmp_path)
    left = tmp_path / "drive-1.progress.json"

    async def crash() -> list[object]:
        desk = FieldDesk(tmp_path, Vehicle(), None, None)
        monkeypatch.setattr(desk, "unfinished", lambda: left)
        monkeypatch.setattr(desk, "goal", lambda _: None)
        panel = Panel(settings, Pairing(time.monotonic, needed=False), desk)
        told: list[object] = [{"kind": "ended", "resume": "an older one"}]
        panel.ended = {"kind": "ended", "resume": "an older one"}
        state = {"kind": "now", "t": 90.0, "mode": "drive", "gnss": {"fix": None}}
        panel.line.connected = seen != "silence"
        panel._heard(state)
        if seen == "a new process":
            panel._heard(state | {"t": 0.1, "mode": "idle"})
        watch = asyncio.create_task(panel._watch_machine())
        if seen == "a hang before it":
            while panel.now:
                await asyncio.sleep(0)
            told.append(panel.ended)
            panel.line.connected = False
        async with asyncio.timeout(20):
            while panel.ended == told[0]:
                await asyncio.sleep(0)
        watch.cancel()
        return [*told, panel.ended]

    told = asyncio.run(crash())
    assert told[:-1] == [told[0]] * (len(told) - 1), "while it hangs, nothing has ended"
    assert told[-1] == {"kind": "ended", "outcome": "stopped", "resume": str(left)}


RUN = {
    **{"outcome": "stopped", "reason": "", "faults": [], "record": "x.mcap", "turns": 1},
    **{"pictures": 9, "slow_steps": 0, "late_steps": 0, "seconds": 5.0},
}


def test_odd_files_among_the_runs_hide_no_other(tmp_path: Path) -> None:
    for name, content in (
        ("drive-20260501-071500.run.json", json.dumps(RUN)),
        ("drive-20260501-071500-2.run.json", json.dumps(RUN | {"more": 1})),
        ("drive-x.run.json", json.dumps(RUN)),
        ("drive-99999999-999999.run.json", json.dumps(RUN)),
        ("drive-20260502-071500.run.json", "[1]"),
        ("drive-20260503-071500.run.json", "{"),
        ("drive-20260504-071500.run.json", '{"outcome": "stopped"}'),
        ("drive-20260505-071500.run.json", "[" * 100_000),
    ):
        (tmp_path / name).write_text(content)
    (tmp_path / "drive-20260506-071500.run.json").mkdir()
    found = runs(tmp_path)
    assert [run["begun"] for run in found] == ["2026-05-01T07:15Z"] * 2


class Mute:
    """A page's socket to which nothing gets through."""


def letters(told: list[dict[str, object]]) -> list[dict[str, object]]:
    async def collect() -> list[dict[str, object]]:
        page = Page(Mute(), "p")  # type: ignore[arg-type]
        for message in told:
            page.tell(message)
        return page._letters

    return asyncio.run(collect())


def test_a_page_that_slept_for_an_hour_finds_the_whole_trail_and_each_newest_state() -> None:
    plan = {"kind": "plan", "anew": False}
    trail = [{"kind": "trail", "places": [[k, 0, 0]], "all": False} for k in range(9000)]
    found = letters(
        [{"kind": "trail", "places": ["old"], "all": True}, {"kind": "ended", "n": 0}, plan]
        + [{"kind": "ended", "n": 1}, *trail[:5000], plan | {"anew": True}, *trail[5000:]]
        + [{"kind": "failed", "n": n} for n in range(500)]
    )
    kinds = [one["kind"] for one in found]
    assert kinds[:3] == ["ended", "plan", "trail"]
    assert found[0]["n"] == 1
    assert found[2]["places"] == [[k, 0, 0] for k in range(9000)]
    assert found[2]["all"] is False
    assert [one["n"] for one in found[3:]] == list(range(500))[-TOLD_ONCE:]
    whole = letters([*trail, {"kind": "trail", "places": ["new"], "all": True}])
    assert whole == [{"kind": "trail", "places": ["new"], "all": True}]
    later = letters([{"kind": "trail", "places": ["new"], "all": True}, trail[0]])
    assert later == [{"kind": "trail", "places": ["new", [0, 0, 0]], "all": True}]
