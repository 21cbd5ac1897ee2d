"""Facts about the live view: a viewer gets the record's messages while the run goes on."""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
from pathlib import Path

import pytest

from hil.bench.harvest import Harvest
from hil.bench.live_view import LiveView
from hil.firmware import targets
from host.core.errors import UserError
from host.runs import record
from tests.helpers.oracle import Oracle, quick


class Viewer:
    """As much of a WebSocket client (RFC 6455) as a look needs."""

    def __init__(self, port: int) -> None:
        self.wire = socket.create_connection(("127.0.0.1", port), timeout=60)
        key = base64.b64encode(os.urandom(16)).decode()
        self.wire.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self.stream = self.wire.makefile("rb")
        assert b"101" in self.stream.readline()
        while self.stream.readline().strip():
            pass

    def receive(self) -> tuple[int, bytes]:
        """(opcode, payload) of the next frame."""
        first, length = self.stream.read(2)
        if length == 126:
            (length,) = struct.unpack(">H", self.stream.read(2))
        elif length == 127:
            (length,) = struct.unpack(">Q", self.stream.read(8))
        return first & 15, self.stream.read(length)

    def send(self, message: object) -> None:
        """A text frame, masked with zeros."""
        data = json.dumps(message).encode()
        size = bytes([0x80 | len(data)]) if len(data) < 126 else struct.pack(">BH", 0xFE, len(data))
        self.wire.sendall(b"\x81" + size + bytes(4) + data)

    def texts(self, wanted: str) -> dict[str, object]:
        """The next text message of a kind."""
        while True:
            opcode, payload = self.receive()
            if opcode == 1 and (message := json.loads(payload))["op"] == wanted:
                return dict(message)

    def close(self) -> None:
        self.stream.close()
        self.wire.close()


def test_a_viewer_gets_what_the_record_gets(tmp_path: Path) -> None:
    view = LiveView(0)
    viewer = Viewer(view.port)
    try:
        assert viewer.texts("serverInfo")["name"] == "daranti"
        with record.Recorder(tmp_path / "run.mcap", None, view.put) as recorder:
            recorder.put("/pilot", 1.5, {"phase": "follow", "reason": "the edge is in view"})
            (channel,) = viewer.texts("advertise")["channels"]  # type: ignore[misc]
            assert channel["topic"] == "/pilot"
            assert channel["schemaName"] == "daranti.Pilot"
            viewer.send(
                {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}
            )
            for k in range(10_000):  # until the server has heard of the subscription
                recorder.put("/pilot", 2.0 + k / 10, {"phase": "turn", "reason": str(k)})
                viewer.wire.settimeout(0.01)
                try:
                    opcode, payload = viewer.receive()
                except TimeoutError:
                    viewer.stream = viewer.wire.makefile("rb")
                    continue
                if opcode == 2:
                    break
        kind, subscription, nanoseconds = struct.unpack("<BIQ", payload[:13])
        assert (kind, subscription) == (1, 7)
        assert nanoseconds >= 2_000_000_000
        assert json.loads(payload[13:])["phase"] == "turn"
    finally:
        viewer.close()
        view.close()


def test_a_taken_port_is_one_message() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f"live view on port {port}"):
            LiveView(port)


@pytest.mark.skipif(not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built")
def test_a_view_changes_nothing_of_the_record(tmp_path: Path) -> None:
    records = []
    for name, live in (("with", 0), ("without", None)):
        path = tmp_path / f"{name}.mcap"
        scenario = quick(limits={"time_s": 1.0}, record={"live_port": live})
        run = Harvest(scenario, path, detector=Oracle)
        assert (run.live is None) == (live is None)
        run.run()
        run.close()
        records.append(list(record.read(path)))
    assert records[0] == records[1]


LAYOUT = Path(__file__).parents[3] / "docs" / "use" / "foxglove.json"


def test_what_the_layout_shows_is_in_a_record() -> None:
    """Every topic and every field that a panel names has its schema; every panel has its place."""
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    panels = layout["configById"]
    named = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    for panel in panels.values():
        named += [panel[key] for key in ("topicPath", "followTopic") if key in panel]
        named += [panel["imageMode"]["imageTopic"]] if "imageMode" in panel else []
    assert len(named) > 10
    for name in named:
        topic, _, field = name.partition(".")
        assert topic in record.SCHEMAS, name
        assert not field or field in record.SCHEMAS[topic][1]["properties"], name

    def placed(part: object) -> list[str]:
        if isinstance(part, dict):
            return placed(part["first"]) + placed(part["second"])
        return [str(part)]

    assert sorted(placed(layout["layout"])) == sorted(panels)
