"""Facts about the bench: what machine, field and receiver tell each other."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np
import pytest

from hil.bench.lockstep import Bench
from hil.firmware import targets
from host.core.errors import UserError
from host.core.messages import Command, Request, State
from host.link.session import Session
from host.pilot.context import CREEPING_MPS
from host.sensors.nmea import KNOT_MPS
from tests.helpers.oracle import quick

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
NO_HALL = {"drive": {"hall_pulses_per_m": 0.0}}
"""The speed is not controlled: what loads the wheels slows them."""


def driven(
    bench: Bench,
    seconds: float,
    *,
    blade: bool = True,
    steer_deg: float = 0.0,
    stand_s: float = math.inf,
) -> list[float]:
    """Arms and drives at cutting speed, to stand from `stand_s` on; the true speed at every host
    step."""
    session, speeds = Session(), []
    for tick in range(1, round(20 * seconds) + 1):
        now = tick / 20
        for stamp, data in bench.advance(now):
            session.feed(stamp, data)
        told = session.telemetry
        armed = told is not None and told.state is not State.SAFE
        speed = 0.5 if now < stand_s else 0.0
        cuts = blade and now > 0.5  # the firmware wants to be asked anew after ARM
        motion = Command(Request.DRIVE, math.radians(steer_deg), speed, cuts)
        bench.send(session.encode(now, motion if armed else Command(Request.ARM)))
        speeds.append(float(bench.state["v"]))
    return speeds


def made(**more: Any) -> Bench:
    return Bench(quick(**more))


def test_what_stands_in_the_blades_way_is_cut_while_it_turns_and_only_then() -> None:
    for blade in (False, True):
        with made() as bench:
            driven(bench, 5.0, blade=blade)
            assert (bench.field.coverage() > 0.1) is blade
            assert bench.field.neighbour_cut_m2() == 0.0


def test_how_many_slices_are_run_at_once_changes_nothing() -> None:
    """Whoever watches each slice sees the same run as the host, which sees several at once."""
    runs = []
    for watched in (False, True):
        said: list[bytes] = []
        with made() as bench:
            watch = bench.field.watch()
            if watched:
                bench.on_slice = said.append
            driven(bench, 4.0, steer_deg=20.0)
            watch.take()
            bench.advance(4.6)
            changed = watch.take()
            assert changed is not None
            felt = bench.felt()
            seen = (*changed[:2], changed[2].tobytes())
            runs.append((bench.pose, bench.field.coverage(), felt, seen))
            assert len(said) == 460 * watched
    assert runs[0] == runs[1]
    assert len(runs[0][2]) > 100


def test_cutting_loads_the_wheels() -> None:
    speeds = []
    for stands in (True, False):
        with made(machine=NO_HALL) as bench:
            if not stands:
                bench.field.clear(((-1.0, -1.0), (5.0, -1.0), (5.0, 4.0), (-1.0, 4.0)))
            speeds.append(sum(driven(bench, 4.0)[-20:]) / 20)
    assert speeds[0] < 0.97 * speeds[1]


def test_the_ground_before_the_camera_slopes_with_the_ground_below_it() -> None:
    """On a plane, whatever its slope, a picture shows the same."""
    pictures = []
    for slope in (0.0, 5.0):
        field = {"size_m": (4.0, 3.0), "side_slope_deg": slope, "long_slope_deg": slope}
        with made(field=field) as bench:
            pictures.append(bench.camera.develop(bench.shutter()))
    assert np.array_equal(*pictures)


def test_uphill_it_is_slower() -> None:
    """The plan's first side runs north."""
    speeds = []
    for slope in (4.0, -4.0):
        field = {"size_m": (4.0, 3.0), "side_slope_deg": slope, "bump_sd_deg": 0.0}
        with made(machine=NO_HALL, field=field) as bench:
            assert bench.pose[2] == pytest.approx(math.pi / 2)
            speeds.append(sum(driven(bench, 3.0, blade=False)[-20:]) / 20)
    assert speeds[0] < 0.95 * speeds[1]


def test_on_a_slope_a_machine_that_is_told_to_stand_creeps_at_most() -> None:
    """Its motors, let go, would run away at 1.1 m/s."""
    field = {"size_m": (4.0, 3.0), "side_slope_deg": -4.0, "bump_sd_deg": 0.0}
    with made(field=field) as bench:
        speeds = driven(bench, 6.0, blade=False, stand_s=3.0)
    assert speeds[50] > 0.3
    assert max(map(abs, speeds[-20:])) < CREEPING_MPS


@pytest.mark.parametrize("trees", [(), ({"x_m": 4.5, "y_m": -1.0, "crown_radius_m": 3.0},)])
def test_the_receiver_is_told_whether_it_stands_under_a_tree(
    monkeypatch: pytest.MonkeyPatch, trees: tuple[dict[str, float], ...]
) -> None:
    told: list[bool] = []

    def epoch(_t: float, *_antenna: float, under_trees: bool) -> list[str]:
        told.append(under_trees)
        return []

    with made(field={"size_m": (4.0, 3.0), "trees": trees}) as bench:
        monkeypatch.setattr(bench.gnss, "epoch", epoch)
        bench.fix()
    assert told == [bool(trees)]


def test_the_receiver_is_told_where_the_machine_truly_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which, on a side slope, is not where it points."""
    field = {"size_m": (4.0, 3.0), "long_slope_deg": 8.0, "bump_sd_deg": 0.0}
    with made(field=field) as bench:
        told: list[tuple[float, ...]] = []

        def epoch(_t: float, *antenna: float, under_trees: bool) -> list[str]:
            del under_trees
            told.append(antenna)
            return []

        monkeypatch.setattr(bench.gnss, "epoch", epoch)
        driven(bench, 3.0, blade=False)
        before = bench.pose
        bench.fix()
        bench.advance(3.1)
        after = bench.pose
    x, y, vx, vy = told[0]
    went = math.atan2(after[1] - before[1], after[0] - before[0])
    assert (x, y) == pytest.approx(before[:2])
    assert abs(math.remainder(went - before[2], math.tau)) > math.radians(0.2)
    assert math.atan2(vy, vx) == pytest.approx(went, abs=math.radians(0.1))
    assert math.hypot(vx, vy) > KNOT_MPS / 2


def test_a_firmware_that_crashes_is_one_message_with_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with targets.desk() as target:
        whole = target.pointers

    @ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_uint64)
    def crashes(handle: int, time_us: int) -> int:
        return 7 if time_us > 250_000 else int(run_until(handle, time_us))

    run_until = whole.run_until
    monkeypatch.setattr(whole, "run_until", crashes)
    crashed = r"desk firmware crashed at 0\.25 s \(status 7\)"
    with made() as bench, pytest.raises(UserError, match=crashed):
        bench.advance(1.0)


@pytest.mark.parametrize("yaw", [0.0, 0.5 * math.pi])
@pytest.mark.parametrize(("left_m", "speed_mps"), [(-1.0, 1.0), (0.0, 0.5), (1.0, 0.0)])
def test_in_a_bend_an_antenna_beside_the_axle_has_a_speed_of_its_own(
    left_m: float, speed_mps: float, yaw: float
) -> None:
    gnss = {"antenna_y_m": left_m, "speed_noise_mps": 0.0}
    with made(gnss=gnss) as bench:
        bench.state["v"], bench.state["yaw_rate"], bench.state["yaw"] = 0.5, 0.5, yaw
        (told,) = (line for line in bench.fix() if line.startswith("$GPRMC"))
        assert float(told.split(",")[7]) * KNOT_MPS == pytest.approx(speed_mps, abs=0.03)
