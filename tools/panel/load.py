"""What open pages and hostile use cost the loop that drives: steps above 50 ms.

    python -m tools.panel.load --seconds 60 --out out/load

A run is begun on the page and paused while it follows: the loop goes on with every picture, and the
machine stands. Then, a while each: one page, six pages, fifty sockets, guessed codes, oversized
bodies, slow requests, foreign hosts and origins. Prints a table and writes OUT/summary.json.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from host.core.number_range import NumberRange, argument
from tools.panel.stack import (
    ROOT,
    Json,
    Panel,
    Person,
    Rig,
    Screen,
    a_browser,
    a_phone,
    small_field,
)

SOCKETS: Final = 50
PAGES: Final = 5
Attack = Callable[[str, int, threading.Event, Counter[str]], None]


def _request(host: str, port: int, method: str, path: str, **more: object) -> str:
    """The status of one request, or how it ended."""
    connection = http.client.HTTPConnection(host, port, timeout=8)
    try:
        connection.request(method, path, **more)  # type: ignore[arg-type]
        return str(connection.getresponse().status)
    except (OSError, http.client.HTTPException):
        return "closed"
    finally:
        connection.close()


def sockets(host: str, port: int, ended: threading.Event, seen: Counter[str]) -> None:
    """Fifty WebSockets that would like to be pages."""
    with contextlib.ExitStack() as stack:
        for _ in range(SOCKETS):
            url, origin = f"ws://{host}:{port}/live", f"http://{host}:{port}"
            try:
                stack.enter_context(connect(url, origin=origin, open_timeout=5))  # type: ignore[arg-type]
                seen["opened"] += 1
            except (OSError, WebSocketException, TimeoutError):
                seen["refused"] += 1
        ended.wait()


def codes(host: str, port: int, ended: threading.Event, seen: Counter[str]) -> None:
    """Guesses pairing codes as fast as it may."""
    headers = {"Content-Type": "application/json", "Origin": f"http://{host}:{port}"}
    while not ended.is_set():
        body = json.dumps({"code": "AAAAAA"})
        seen[_request(host, port, "POST", "/pair", body=body, headers=headers)] += 1


def oversized(host: str, port: int, ended: threading.Event, seen: Counter[str]) -> None:
    """Bodies of a megabyte."""
    headers = {"Content-Type": "application/json", "Origin": f"http://{host}:{port}"}
    while not ended.is_set():
        seen[_request(host, port, "POST", "/pair", body=b"x" * 10**6, headers=headers)] += 1


def slow(host: str, port: int, ended: threading.Event, seen: Counter[str]) -> None:
    """A hundred requests whose heads never end."""
    held: list[socket.socket] = []
    while not ended.wait(0.05):
        with contextlib.suppress(OSError):
            one = socket.create_connection((host, port), timeout=2)
            one.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")
            held.append(one)
            seen["begun"] += 1
        for old in held[:-100]:
            old.close()
        del held[:-100]
    for one in held:
        one.close()


def strangers(host: str, port: int, ended: threading.Event, seen: Counter[str]) -> None:
    """Other hosts and origins."""
    while not ended.is_set():
        seen[_request(host, port, "GET", "/", headers={"Host": "panel.example"})] += 1
        foreign = {"Content-Type": "application/json", "Origin": "http://panel.example"}
        seen[_request(host, port, "POST", "/stop", body="{}", headers=foreign)] += 1


ATTACKS: Final[dict[str, Attack]] = {
    "fifty sockets": sockets,
    "guessed codes": codes,
    "oversized bodies": oversized,
    "slow requests": slow,
    "foreign hosts and origins": strangers,
}


def memory_mb(pid: int) -> float:
    """Of one process."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return round(int(line.split()[1]) / 1024, 1)
    return 0.0


def weight() -> Json:
    """Of the page with its scripts and both languages, in kB."""
    folder = ROOT / "host" / "panel"
    files = [*(folder / "static").iterdir(), *(folder / "texts").glob("*.json")]
    return {"files": len(files), "kb": round(sum(one.stat().st_size for one in files) / 1000, 1)}


class Loop:
    """The loop that drives, watched from a page."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def watch(self, seconds: float) -> Json:
        """How its steps were for a while."""
        before = self._screen.last()["steps"]
        self._screen.page.wait_for_timeout(seconds * 1000)
        now = self._screen.last()
        if now["mode"] != "drive":
            raise SystemExit(f"the run has ended: {self._screen.last('ended')}")
        after = now["steps"]
        return {
            "steps": after["count"] - before["count"],
            "above_50_ms": after["slow"] - before["slow"],
            "late": after["late"] - before["late"],
            "longest_so_far_ms": after["longest_ms"],
        }


@contextlib.contextmanager
def attacked(attack: Attack, url: str) -> Iterator[Counter[str]]:
    """While somebody does this."""
    where = urlsplit(url)
    assert where.hostname is not None
    assert where.port is not None
    ended, seen = threading.Event(), Counter[str]()
    thread = threading.Thread(target=attack, args=(where.hostname, where.port, ended, seen))
    thread.start()
    try:
        yield seen
    finally:
        ended.set()
        thread.join(30)


def measure(seconds: float, out: Path) -> Json:
    """All of it."""
    out.mkdir(parents=True, exist_ok=True)
    rig = Rig(str(small_field(out / "load.yaml", (8.0, 7.0), belief="exact")), out)
    folder = out / f"panel-{time.strftime('%H%M%S')}"
    folder.mkdir()
    given = ("--boundary", rig.about["boundary"], "--gap", rig.about["gap"], "--lan")
    panel = Panel(rig, folder, *given)
    try:
        with a_browser() as browser:
            return {"page": weight()} | _watched(rig, panel, browser, seconds)
    finally:
        panel.close()
        rig.close()


def _watched(rig: Rig, panel: Panel, browser: object, seconds: float) -> Json:
    context = a_phone(browser)  # type: ignore[arg-type]
    requests: list[str] = []
    context.on("request", lambda request: requests.append(request.url))
    screen = Screen(context, panel)
    screen.page.locator("#page-pair").wait_for(state="visible")
    screen.pair()
    screen.until(lambda: screen.last().get("link", {}).get("problem") == "", 60)
    screen.tab("field")
    screen.page.select_option("#field-corner", rig.about["corner"])
    found = Person(rig, screen).through_the_check()
    if not found["green"]:
        raise SystemExit("the check is not green")
    screen.drive_from_here()
    screen.page.wait_for_timeout(500)
    screen.hold("#start")
    if not screen.until(lambda: screen.last().get("mode") == "drive", 60):
        raise SystemExit(f"not started: {screen.last('failed')}")
    screen.until(lambda: (screen.last().get("pilot") or {}).get("phase") == "follow", 60)
    screen.page.click("#pause")
    screen.until(lambda: screen.last().get("paused"), 10)
    loop = Loop(screen)
    table: Json = {
        "requests_of_a_page": len(requests),
        "requests_elsewhere": sum(panel.url.rstrip("/") not in url for url in requests),
    }
    pids = {"server": panel.pid, "machine": panel.machine_pid()}
    begun, first = time.monotonic(), {name: memory_mb(pid) for name, pid in pids.items()}
    heap = "() => performance.memory.usedJSHeapSize / 1e6"
    first["page"] = round(screen.page.evaluate(heap), 1)
    table["one page"] = loop.watch(seconds)
    print("one page", table["one page"], flush=True)
    watchers = [Screen(context, panel) for _ in range(PAGES)]
    for one in watchers:
        one.tab("harvest")
    screen.page.bring_to_front()
    table[f"{PAGES + 1} pages"] = loop.watch(seconds)
    print("pages", table[f"{PAGES + 1} pages"], flush=True)
    for one in watchers:
        one.page.close()
    for name, attack in ATTACKS.items():
        with attacked(attack, panel.url) as seen:
            time.sleep(1)
            table[name] = loop.watch(seconds) | {"answers": dict(seen)}
        print(name, table[name], flush=True)
    minutes = (time.monotonic() - begun) / 60
    last = {name: memory_mb(pid) for name, pid in pids.items()}
    last["page"] = round(screen.page.evaluate(heap), 1)
    table["memory"] = {
        "minutes": round(minutes, 1),
        "first_mb": first,
        "last_mb": last,
        "hour_extrapolated_mb": {
            name: round(first[name] + (last[name] - first[name]) * 60 / minutes, 1)
            for name in first
        },
    }
    return table


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seconds", type=argument(NumberRange(0, min_open=True)), default=60.0, help="of each part"
    )
    parser.add_argument("--out", type=Path, default=Path("out/load"))
    given = parser.parse_args()
    summary = measure(given.seconds, given.out)
    (given.out / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    for name, figures in summary.items():
        print(f"{name:<28}{figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
