"""The phone's gyroscope: what an app's answers say of how far the machine has turned."""

from __future__ import annotations

import http.server
import json
import math
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.sensors.gyro import GAP_S, UNDERWAY_S, Turning, beside, gyro_feed, parsed

G = 9.81
T0 = 1_700_000_000.0
"""The phone's clock at the start."""
Axis = tuple[float, float, float]
UPRIGHT: Axis = (0.0, 1.0, 0.0)
"""Up in the axes of a phone that is held upright."""


def answer(
    rates: list[tuple[float, float]], up: Axis = UPRIGHT, unit: str = "rad/s", t0: float = T0
) -> bytes:
    """Of samples (time in s, rate about the vertical)."""
    return json.dumps(
        {
            "gyro": {
                "unit": unit,
                "data": [[(t0 + t) * 1e3, [rate * u for u in up]] for t, rate in rates],
            },
            "accel": {
                "unit": "m/s²",
                "data": [[(t0 + t) * 1e3, [G * u for u in up]] for t, _ in rates],
            },
        }
    ).encode()


def steps(begin: float, end: float, rate: float) -> list[tuple[float, float]]:
    """50 samples a second of one rate."""
    count = round((end - begin) * 50)
    return [(begin + k / 50, rate) for k in range(count + 1)]


@given(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: math.hypot(*v) > 0.1),
    st.floats(-1.0, 1.0),
)
def test_a_quarter_of_a_turn_is_one_however_the_phone_is_mounted(up: Axis, rate: float) -> None:
    size = math.hypot(*up)
    turning = Turning()
    x, y, z = up
    turned = turning.feed(9.0, answer(steps(0, 2, rate), (x / size, y / size, z / size)))
    assert turned is not None
    assert turned.yaw_rad == pytest.approx(2 * rate, abs=1e-6)


@pytest.mark.parametrize("portrait", [False, True])
@pytest.mark.parametrize("down_deg", [28.0, 5.0, -3.0])
def test_it_tells_how_far_the_back_camera_looks_above_the_horizon(
    down_deg: float, portrait: bool
) -> None:
    """Android's z axis points out of the screen (sensor coordinate system)."""
    down = math.radians(down_deg)
    turning = Turning()
    for at, nose_up in ((0.0, -down), (1.0, 0.1 - down)):
        upright, back = math.cos(nose_up), -math.sin(nose_up)
        up = (0.0, upright, back) if portrait else (upright, 0.0, back)
        turned = turning.feed(9.0 + at, answer(steps(at + 0.02, at + 1.0, 0.0), up))
        assert turned is not None
        assert turned.nose_up_rad == pytest.approx(nose_up, abs=1e-6)


def test_degrees_a_second_are_understood() -> None:
    data = json.loads(answer(steps(0, 1, 90.0), unit="°/s"))
    data["accel"]["unit"] = "m/s²"
    turned = Turning().feed(1.0, json.dumps(data).encode())
    assert turned is not None
    assert turned.yaw_rad == pytest.approx(math.pi / 2)


def test_what_an_answer_repeats_is_not_counted_again() -> None:
    turning = Turning()
    turning.feed(1.0, answer(steps(0, 1, 0.5)))
    assert turning.feed(1.1, answer(steps(0, 1, 0.5))) is None
    turned = turning.feed(1.5, answer(steps(0.5, 1.5, 0.5)))
    assert turned is not None
    assert turned.yaw_rad == pytest.approx(0.75)


def test_an_answer_that_comes_late_loses_nothing_and_keeps_its_time() -> None:
    turning = Turning()
    turning.feed(101.0, answer(steps(0, 1, 0.2)))
    turned = turning.feed(105.0, answer(steps(1, 3, 0.2)))
    assert turned is not None
    assert turned.yaw_rad == pytest.approx(0.6)
    assert turned.stamp == pytest.approx(103.0 - UNDERWAY_S, abs=1e-3)
    assert turned.since < 101.0


def test_across_missing_samples_it_begins_anew() -> None:
    turning = Turning()
    first = turning.feed(1.0, answer(steps(0, 1, 0.5)))
    second = turning.feed(3.0, answer(steps(1 + 2 * GAP_S, 2, 0.5)))
    assert first is not None
    assert second is not None
    assert second.since > first.stamp
    assert second.yaw_rad == pytest.approx(0.25)


def test_a_rate_that_no_gyroscope_has_ends_what_is_known() -> None:
    turning = Turning()
    first = turning.feed(1.0, answer(steps(0, 1, 0.1)))
    second = turning.feed(2.0, answer([(1.02, 1e6), *steps(1.04, 2, 0.1)]))
    assert first is not None
    assert second is not None
    assert second.since > first.since
    assert abs(second.yaw_rad) < 0.2


def test_a_phone_whose_clock_is_set_back_is_heard_on() -> None:
    turning = Turning()
    turning.feed(101.0, answer(steps(0, 1, 0.5)))
    turned = turning.feed(102.0, answer(steps(1, 2, 0.5), t0=T0 - 3600))
    assert turned is not None
    assert turned.stamp == pytest.approx(102.0 - UNDERWAY_S, abs=1e-3)
    assert turned.since > 100.0
    assert turned.yaw_rad == pytest.approx(0.5)


def test_a_page_that_is_no_list_of_sensors_is_said_to_be_none() -> None:
    with pytest.raises(ValueError, match="no list of sensors"):
        parsed(b"<html>")


def test_a_phone_whose_vertical_is_unknown_tells_nothing() -> None:
    data = json.loads(answer(steps(0, 1, 0.5)))
    for row in data["accel"]["data"]:
        row[1] = [0.0, 0.0, 0.0]
    assert Turning().feed(1.0, json.dumps(data).encode()) is None


@given(st.binary(max_size=200))
def test_no_answer_raises_anything_but_a_value_error(data: bytes) -> None:
    try:
        parsed(data)
    except ValueError:
        return
    raise AssertionError("bytes at random are no answer")


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=4),
        lambda each: st.lists(each, max_size=3) | st.dictionaries(st.text(max_size=4), each),
        max_leaves=8,
    )
)
def test_any_value_in_the_place_of_a_sample_is_refused_or_understood(value: object) -> None:
    row = {"gyro": {"data": [value]}, "accel": {"data": []}}
    try:
        gyro, _ = parsed(json.dumps(row).encode())
    except ValueError:
        return
    assert all(math.isfinite(v) for xyz in gyro.xyz for v in xyz)


def test_the_sensors_are_served_beside_the_pictures() -> None:
    assert beside("http://10.0.0.7:8080/video") == "http://10.0.0.7:8080/sensors.json"
    assert beside("http://a:b@10.0.0.7:8080/video") == "http://a:b@10.0.0.7:8080/sensors.json"
    assert beside("/dev/video0") is None
    assert beside("0") is None


@pytest.mark.parametrize("url", ["tcp://10.0.0.7:8080", "http://", "/sensors.json", "http://a:x/"])
def test_an_address_that_is_none_is_refused_with_what_to_give(url: str) -> None:
    with pytest.raises(UserError, match="give http://HOST:PORT/sensors"):
        gyro_feed(url, lambda: 0.0, print)


@pytest.mark.parametrize(
    ("status", "kind", "tries"),
    [(200, "text/html", 1), (404, "text/html", 1), (501, "text/plain", 1), (503, "text/plain", 3)],
)
def test_an_app_that_has_no_sensors_is_left_alone(status: int, kind: str, tries: int) -> None:
    """Asked twice a second, many a camera app has no connection left for its pictures."""
    asked = threading.Semaphore(0)

    class App(http.server.BaseHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            del format, args

        def do_GET(self) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.end_headers()
            asked.release()

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), App) as app:
        threading.Thread(target=app.serve_forever, daemon=True).start()
        feed = gyro_feed(f"http://127.0.0.1:{app.server_port}", time.monotonic, lambda _: None)
        feed.retry_s = 0.01
        feed.start()
        for _ in range(tries):
            assert asked.acquire(timeout=10.0)
        if tries == 1:
            assert not feed.wait(10.0)
            assert feed.stopping, "it has ended by itself"
        feed.close()
        app.shutdown()
