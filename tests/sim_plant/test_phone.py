"""The phone serves what it is given, late by its delay, and falls silent in a drop-out."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import time
from collections.abc import Iterator
from urllib.parse import urlparse

import pytest

from host.sensors.gyro import gyro_feed
from sim_plant.gyro import Gyro, GyroSpec
from sim_plant.phone import BOUNDARY, Phone, PhoneSpec, _Line

JPEG = b"\xff\xd8 not really a picture \xff\xd9"


@pytest.fixture
def phone() -> Iterator[Phone]:
    with Phone(PhoneSpec(http_port=0, nmea_port=0, delay_s=0.0)) as p:
        yield p


def _get(url: str, path: str) -> http.client.HTTPResponse:
    parsed = urlparse(url)
    connection = http.client.HTTPConnection(str(parsed.hostname), parsed.port, timeout=5)
    connection.request("GET", path)
    return connection.getresponse()


def test_a_single_picture_is_the_latest(phone: Phone) -> None:
    phone.show(b"old")
    phone.show(JPEG)
    response = _get(phone.camera_url, "/shot.jpg")
    assert (response.status, response.getheader("Content-Type")) == (200, "image/jpeg")
    assert response.read() == JPEG


def test_the_stream_is_multipart_jpeg(phone: Phone) -> None:
    phone.show(JPEG)
    response = _get(phone.camera_url, "/video")
    kind = str(response.getheader("Content-Type"))
    assert kind == f"multipart/x-mixed-replace;boundary={BOUNDARY}"
    head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(JPEG)}\r\n\r\n"
    assert response.read(len(head) + len(JPEG) + 2) == head.encode() + JPEG + b"\r\n"
    phone.show(JPEG[::-1])
    assert response.read(len(head) + len(JPEG) + 2).endswith(JPEG[::-1] + b"\r\n")


def test_a_phone_without_a_gyroscope_serves_no_sensors(phone: Phone) -> None:
    assert _get(phone.camera_url, "/sensors.json").status == 404


def test_the_latest_samples_are_served_again_and_again(phone: Phone) -> None:
    gyro = Gyro(GyroSpec(), 1, 0.0)
    phone.feel(gyro.sample(k / 50, 0.1, 0, 0, 0.5) for k in range(10 * 50))
    for _ in range(2):
        response = _get(phone.camera_url, "/sensors.json")
        assert response.getheader("Content-Type") == "application/json"
        data = json.loads(response.read())["gyro"]["data"]
        assert data[-1][0] - data[0][0] == 20 * (len(data) - 1)
        assert len(data) == 250


def test_the_host_reads_from_it_what_the_machine_has_turned(phone: Phone) -> None:
    gyro = Gyro(GyroSpec(offset_dps=0, scale_error=0), 1, 0.25)
    url = phone.camera_url.replace("/video", "/sensors.json")
    feed = gyro_feed(url, time.monotonic, lambda _: None)
    phone.feel([gyro.sample(0.0, 0.5, 0, 0, 0.5)])
    feed.start()
    try:
        assert feed.wait(10)
        feed.take()
        phone.feel(gyro.sample(k / 50, 0.5, 0, 0, 0.5) for k in range(1, 101))
        assert feed.wait(10)
        turned = feed.take()
    finally:
        feed.close()
    assert turned is not None
    assert turned.yaw_rad == pytest.approx(1.0, abs=0.02)


def test_an_app_without_sensors_is_named_and_not_asked_again(phone: Phone) -> None:
    said: list[str] = []
    url = phone.camera_url.replace("/video", "/sensors.json")
    feed = gyro_feed(url, time.monotonic, said.append)
    feed.start()
    assert not feed.wait(10)
    assert feed.stopping
    assert said == ["gyroscope lost: the app gives no sensors: no /sensors.json"]


def test_an_unknown_page_is_not_found(phone: Phone) -> None:
    assert _get(phone.camera_url, "/").status == 404


def _nmea(phone: Phone) -> socket.socket:
    parsed = urlparse(phone.gnss_url)
    return socket.create_connection((str(parsed.hostname), int(parsed.port or 0)), timeout=5)


def test_sentences_arrive_whole_and_in_order(phone: Phone) -> None:
    with _nmea(phone) as client:
        client.settimeout(0.05)
        data = b""
        while not data:  # sentences said before the client is being served are not for it
            phone.say(["$HELLO*00"])
            with contextlib.suppress(TimeoutError):
                data = client.recv(1000)
        client.settimeout(5)
        for k in range(50):
            phone.say([f"$A{k:03d}*00", f"$B{k:03d}*00"])
        while b"$B049" not in data:
            data += client.recv(1000)
    got = [s for s in data.decode().split("\r\n") if s and s != "$HELLO*00"]
    assert got == [f"${letter}{k:03d}*00" for k in range(50) for letter in "AB"]


def test_a_drop_out_ends_streams_and_refuses_new_ones(phone: Phone) -> None:
    phone.show(JPEG)
    stream = _get(phone.camera_url, "/video")
    stream.read(10)
    with _nmea(phone) as client:
        phone.connect(False)
        assert client.recv(100) == b""
        stream.read()
        with pytest.raises(http.client.RemoteDisconnected):
            _get(phone.camera_url, "/shot.jpg")
        phone.connect(True)
        assert _get(phone.camera_url, "/shot.jpg").read() == JPEG


def test_a_taken_port_raises_and_frees_the_other(phone: Phone) -> None:
    taken = int(urlparse(phone.gnss_url).port or 0)
    with pytest.raises(OSError, match="in use"):
        Phone(PhoneSpec(http_port=0, nmea_port=taken))


def test_nothing_is_due_before_the_delay() -> None:
    now = [0.0]
    line = _Line(0.5, keep=10, clock=lambda: now[0])
    line.put(b"a")
    now[0] = 0.3
    line.put(b"b")
    assert line.since(0, 0.0) == []
    now[0] = 0.5
    assert line.since(0, 0.0) == [(0, b"a")]
    now[0] = 0.8
    assert line.since(1, 0.0) == [(1, b"b")]


def test_drop_outs_take_their_share_of_the_time() -> None:
    now = [0.0]
    spec = PhoneSpec(http_port=0, nmea_port=0, dropouts_per_minute=6, dropout_s=2.0, seed=3)
    phone = Phone(spec, clock=lambda: now[0])
    served = []
    with phone:
        for _ in range(60_000):
            now[0] += 0.1
            served.append(phone.online)
    # A drop-out of 2 s on average every 10 s of service: 2/12 of the time.
    assert 1 - sum(served) / len(served) == pytest.approx(2 / 12, abs=0.02)
