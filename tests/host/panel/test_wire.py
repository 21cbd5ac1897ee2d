"""The line between panel and machine: whole frames, and nobody ever waits."""

from __future__ import annotations

import json
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.panel.wire import LONGEST, Frames, Peer, WireError, frame, packed


@given(st.lists(st.tuples(st.sampled_from("JP"), st.binary(max_size=80))), st.integers(1, 40))
def test_frames_come_whole_however_they_were_cut(sent: list[tuple[str, bytes]], chunk: int) -> None:
    data = b"".join(frame(kind, payload) for kind, payload in sent)
    frames = Frames()
    found = []
    for start in range(0, len(data), chunk):
        found += frames.feed(data[start : start + chunk])
    assert found == sent


def test_a_frame_without_end_is_refused() -> None:
    with pytest.raises(WireError):
        Frames().feed((LONGEST + 1).to_bytes(4, "little") + b"J")


def test_a_peer_that_does_not_read_delays_nobody() -> None:
    near, far = socket.socketpair()
    peer = Peer(near)
    big = frame("P", bytes(300_000))
    offered = [peer.offer(big) for _ in range(50)]
    assert offered[0]
    assert not offered[-1]
    peer.post({"kept": 1})
    far.setblocking(False)
    frames, found = Frames(), []
    for _ in range(10_000):
        try:
            found += frames.feed(far.recv(65536))
        except BlockingIOError:
            peer.post({"again": 1})
        if any(kind == "J" for kind, _ in found):
            break
    kinds = [kind for kind, _ in found]
    assert json.loads(found[kinds.index("J")][1]) == {"kept": 1}
    assert all(len(payload) == 300_000 for kind, payload in found if kind == "P")


def test_a_peer_that_is_gone_is_said() -> None:
    near, far = socket.socketpair()
    peer = Peer(near)
    far.close()
    with pytest.raises(WireError):
        peer.read()


def test_what_is_no_object_is_dropped() -> None:
    near, far = socket.socketpair()
    peer = Peer(near)
    far.sendall(frame("J", b"[1]") + frame("P", b"x") + packed({"do": "stop"}))
    assert peer.read() == [{"do": "stop"}]
    far.sendall(frame("J", b"no json"))
    with pytest.raises(WireError):
        peer.read()
