"""Facts about faults: what is refused, where and when they strike, what the machine does."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from hil.bench.injector import Injector, Line, spoiled
from hil.bench.lockstep import Bench
from hil.commands.faults import faults
from hil.commands.rig import rig
from hil.firmware import signal_wires, targets
from hil.firmware.provision import target
from hil.firmware.signal_wires import Mode, Signal, tap
from hil.judge.fault_verdict import Situation, Verdict
from hil.scenario.faults import PAIRS, At, Component, Expect, Failure, Fault, Pair, Place
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario
from hil.studies.fault_matrix import (
    Case,
    Group,
    all_faults,
    base_scenario,
    branched,
    in_a_copy,
    scenario_of,
    watched,
    with_fault,
)
from hil.studies.identification import defaults
from hil.studies.matrix_runs import digest, kept
from host.core.errors import UserError
from host.core.vehicle import MAST
from host.link.session import Session
from host.pilot.phase import Doing
from host.vision.view import Detector
from host.vision.watched import WatchedDetector
from sim_plant import machine
from sim_plant.gyro import Sample
from tests.helpers.oracle import Oracle, quick

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
NOW = At(time_s=0.0)


# ---- the vocabulary ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("component", "failure"), list(itertools.product(get_args(Component), get_args(Failure)))
)
def test_a_pair_is_supported_or_refused_with_what_is(component: str, failure: str) -> None:
    values = {"component": component, "failure": failure, "at": {"time_s": 1.0}}
    if (component, failure) in PAIRS:
        assert Fault.model_validate(values).name.startswith(f"{component} {failure}")
        return
    with pytest.raises(ValidationError) as refused:
        Fault.model_validate(values)
    known = [f for c, f in PAIRS if c == component]
    assert known
    assert f"{component} can be: {', '.join(known)}" in str(refused.value)


def test_every_component_can_fail() -> None:
    assert {c for c, _ in PAIRS} == set(get_args(Component))


@pytest.mark.parametrize(
    "at",
    [
        {},
        {"time_s": 1.0, "state": "follow"},
        {"state": "asleep"},
        {"time_s": -1.0},
        {"place": {"x_m": 1.0}},
    ],
)
def test_a_fault_strikes_at_exactly_one_thing(at: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        At.model_validate(at)


@pytest.mark.parametrize(
    "values",
    [
        {"component": "camera", "failure": "wrong", "how": "upside down"},
        {"component": "pot", "failure": "stuck", "value": 3.0},
        {"component": "pot", "failure": "delayed", "value": 5.0},
        {"component": "gnss", "failure": "slow", "value": 0.0},
        {"component": "pot", "failure": "off", "for_s": 0.0},
    ],
)
def test_what_a_fault_does_not_know_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Fault.model_validate(values | {"at": {"time_s": 0.0}})


# ---- wires ---------------------------------------------------------------------------------------


def through(mode: Mode, truth: list[float], value: float = 0.0, low: float = 0.0) -> list[float]:
    """What arrives of a signal, a millisecond apart, that was honest for its first sample."""
    wires = signal_wires.honest()
    out = []
    for k, sample in enumerate(truth):
        if k == 1:
            wires[Signal.POT]["mode"], wires[Signal.POT]["value"] = mode, value
            wires[Signal.POT]["low"] = low
        out.append(tap(wires, int(Signal.POT), sample, 1000 * (k + 1)))
    return out


RAMP = [float(k) for k in range(2000)]


def test_an_honest_wire_changes_nothing() -> None:
    assert through(Mode.HONEST, RAMP) == RAMP


def test_a_held_wire_stays_at_the_last_honest_value() -> None:
    assert through(Mode.HELD, [7.0, 8.0, 9.0]) == [7.0, 7.0, 7.0]


def test_a_late_wire_carries_the_same_later() -> None:
    out = through(Mode.LATE, RAMP, 0.5)
    assert out[1:501] == [0.0] * 500
    assert out[501:] == RAMP[1:1500]


def test_a_lagging_wire_reaches_63_percent_after_its_time_constant() -> None:
    out = through(Mode.LAGGING, [0.0, *[100.0] * 300], 0.2)
    assert out[200] == pytest.approx(63.2, abs=0.5)


def test_a_noisy_wire_shows_its_whole_range() -> None:
    out = np.array(through(Mode.NOISY, [0.0] * 2000, 5000.0))[1:]
    assert out.min() >= 0.0
    assert out.max() <= 5000.0
    assert np.ptp(out) > 4900
    assert len(set(out.tolist())) > 1900


def test_a_flickering_wire_is_there_half_of_the_time() -> None:
    out = np.array(through(Mode.FLICKERING, [1.0] * 20000))
    assert 0.4 < out.mean() < 0.6
    runs = np.diff(np.flatnonzero(np.diff(out)))[1:]
    assert runs.min() >= signal_wires.FLICKER_US // 1000


@pytest.mark.parametrize(("mode", "expected"), [(Mode.SHIFTED, 13.0), (Mode.SCALED, 30.0)])
def test_shift_and_scale(mode: Mode, expected: float) -> None:
    assert through(mode, [10.0, 10.0], 3.0)[1] == expected


def test_a_fault_shows_from_when_it_makes_a_difference() -> None:
    wires = signal_wires.honest()
    wires[Signal.POT]["mode"], wires[Signal.POT]["held"] = Mode.HELD, 2500.0
    for k in range(100):
        tap(wires, int(Signal.POT), 2500.0 + k, 1000 * k)
    assert wires[Signal.POT]["shown_us"] == 46_000  # 45 mV, two degrees


# ---- the serial line -----------------------------------------------------------------------------


def line() -> Line:
    return Line(np.random.default_rng(1))


def serial(failure: str, **more: float) -> list[Fault]:
    return [Fault(component="serial", failure=failure, at=NOW, **more)]  # type: ignore[arg-type]


@given(st.lists(st.binary(max_size=40), max_size=30))
def test_a_sound_line_passes_every_byte(chunks: list[bytes]) -> None:
    cable = line()
    assert [cable.carry(0.01 * k, c, []) for k, c in enumerate(chunks)] == chunks


@given(st.lists(st.binary(max_size=40), max_size=30), st.floats(0.011, 0.5))
def test_a_delayed_line_passes_every_byte_in_order_and_later(
    chunks: list[bytes], delay: float
) -> None:
    cable, faults = line(), serial("delayed", value=delay)
    got = b""
    for k, chunk in enumerate([*chunks, *[b""] * 60]):
        got += cable.carry(0.01 * k, chunk, faults)
        sent_by_then = b"".join(chunks[: max(0, int(k - delay / 0.01 + 1.001))])
        assert len(got) <= len(sent_by_then)
    assert got == b"".join(chunks)


@given(st.integers(200, 5000))
def test_a_slow_line_keeps_its_rate_and_loses_nothing(rate: int) -> None:
    cable, faults = line(), serial("slow", value=float(rate))
    data = bytes(range(256)) * 4
    got = cable.carry(0.0, data, faults)
    for k in range(1, 101):
        got += cable.carry(0.01 * k, b"", faults)
        assert len(got) <= rate * 0.01 * k + 0.01 * rate + 2
    assert got == data[: len(got)]
    assert len(got) >= min(len(data), int(0.95 * rate))


def test_an_unplugged_line_passes_nothing() -> None:
    assert line().carry(0.0, b"abc", serial("off")) == b""


def test_flips_change_single_bits_of_some_bytes() -> None:
    data = bytes(10_000)
    out = line().carry(0.0, data, serial("garbage", value=0.02))
    wrong = [byte for byte in out if byte]
    assert len(out) == len(data)
    assert 100 < len(wrong) < 300
    assert all(byte.bit_count() == 1 for byte in wrong)


# ---- the phone -----------------------------------------------------------------------------------


def jpeg() -> bytes:
    picture = np.full((48, 64, 3), (40, 90, 160), np.uint8)
    return cv2.imencode(".jpg", picture)[1].tobytes()


def injector(*faults: Fault) -> Injector:
    """With faults that have begun."""
    made = Injector(faults, 1)
    with target("desk") as board:
        made.step(0.0, (0.0, 0.0, 0.0), 0.0, board, machine.inputs())
    return made


@pytest.mark.parametrize(("how", "low", "high"), [("black", 0, 2), ("overexposed", 220, 255)])
def test_a_spoiled_picture_is_what_it_is_called(how: str, low: int, high: int) -> None:
    out = cv2.imdecode(np.frombuffer(spoiled(jpeg(), how), np.uint8), cv2.IMREAD_COLOR)
    assert out is not None
    assert low <= float(out.mean()) <= high


@needs_firmware
def test_a_frozen_camera_repeats_its_picture_with_new_times() -> None:
    now = injector(Fault(component="camera", failure="stuck", at=At(time_s=1.0)))
    first = now.camera(0.5, (0.4, b"first"))
    assert first == (0.4, b"first")
    with target("desk") as board:
        now.step(1.0, (0.0, 0.0, 0.0), 0.0, board, machine.inputs())
    assert now.camera(1.1, (1.0, b"second")) == (1.0, b"first")


@needs_firmware
def test_a_late_picture_is_believed_to_be_fresh() -> None:
    now = injector(Fault(component="camera", failure="delayed", at=NOW, value=0.2))
    assert now.camera(1.0, (0.9, b"x")) is None
    got = now.camera(1.2, None)
    assert got is not None
    assert got == (pytest.approx(1.1), b"x")


@needs_firmware
def test_a_phone_that_is_gone_gives_neither_pictures_nor_positions() -> None:
    now = injector(Fault(component="phone", failure="off", at=NOW))
    assert now.camera(1.0, (0.9, b"x")) is None
    assert now.nmea(1.0, ["$GPGGA"]) == []
    assert now.gyro(1.0, felt(0.1)) == []


def felt(*rates: float) -> list[Sample]:
    """What a gyroscope shows about one axis, a sample each."""
    return [Sample(9.0 + k, (rate, 0.0, 0.0), (9.81, 0.0, 0.0)) for k, rate in enumerate(rates)]


@needs_firmware
def test_each_failure_of_the_gyroscope_is_what_it_is_called() -> None:
    def failing(failure: Failure) -> Injector:
        return injector(Fault(component="gyro", failure=failure, at=NOW))

    assert failing("off").gyro(1.0, felt(0.1)) == []
    stuck = failing("stuck")
    assert [one.rate_radps[0] for one in stuck.gyro(1.0, felt(0.1, 0.2))] == [0.1, 0.2]
    (wrong,) = failing("wrong").gyro(1.0, felt(0.1))
    assert wrong.rate_radps[0] == pytest.approx(0.1 + math.radians(5.0))
    garbage = failing("garbage").gyro(1.0, felt(*[0.1] * 1000))
    assert sum(one.rate_radps[0] != 0.1 for one in garbage) == pytest.approx(200, abs=40)
    late = failing("delayed")
    assert late.gyro(1.0, felt(0.1)) == []
    assert late.gyro(1.5, []) == felt(0.1)
    slow = failing("slow")
    assert slow.gyro(1.0, felt(0.1)) == felt(0.1)
    assert slow.gyro(1.5, felt(0.2)) == []
    assert slow.gyro(2.0, felt(0.3)) == [*felt(0.2), *felt(0.3)]


@needs_firmware
def test_a_gyroscope_that_hangs_repeats_what_it_showed_last() -> None:
    hangs = Injector((Fault(component="gyro", failure="stuck", at=At(time_s=0.5)),), 1)
    assert hangs.gyro(0.1, felt(0.3)) == felt(0.3)
    with target("desk") as board:
        hangs.step(1.0, (0.0, 0.0, 0.0), 0.0, board, machine.inputs())
    assert [one.rate_radps[0] for one in hangs.gyro(1.0, felt(0.1, -0.2))] == [0.3, 0.3]


# ---- when ----------------------------------------------------------------------------------------


@needs_firmware
@pytest.mark.parametrize(
    ("at", "begins"),
    [
        (At(time_s=0.5), 0.5),
        (At(time_s=0.5, after_s=0.3), 0.8),
        (At(state="follow", after_s=0.2), 0.7),
        (At(time_s=0.5, moving="forward"), 0.9),
        (At(time_s=0.1, moving="forward", after_s=0.2), 1.1),
        (At(doing=Doing.FOLLOW, after_s=0.2), 0.8),
        (At(place=Place(x_m=0.6, y_m=0.0, radius_m=0.105)), 0.5),
    ],
)
def test_a_fault_begins_and_ends_when_it_is_told(at: At, begins: float) -> None:
    fault = Fault(component="estop", failure="off", at=at, for_s=0.4)
    now = Injector((fault,), 1)
    with target("desk") as board:
        for k in range(200):
            now.phase = "follow" if k >= 50 else "align"
            now.doing = Doing.FOLLOW if k >= 60 else Doing.LOOK_AT_EDGE
            moves = k >= 90 or 20 <= k < 30
            now.step(k / 100, (k / 100, 0.0, 0.0), 0.3 if moves else 0.0, board, machine.inputs())
    assert [(e.stamp, e.begins) for e in now.events] == [
        (pytest.approx(begins), True),
        (pytest.approx(begins + 0.4), False),
    ]


@needs_firmware
def test_the_hang_and_the_reset_reach_the_firmware() -> None:
    for failure, boots in (("stuck", 1), ("off", 1), ("intermittent", 4)):
        fault = Fault(component="firmware", failure=failure, at=At(time_s=1.0))  # type: ignore[arg-type]
        with Bench(quick(faults=(fault,))) as bench:
            session = Session()
            for stamp, data in bench.advance(3.0):
                session.feed(stamp, data)
        assert session.resets >= boots, failure


# ---- what the machine does about it --------------------------------------------------------------


SMALL = {"width_px": 64, "height_px": 48}


def watched_oracle(bench: Bench) -> Detector:
    """A detector that sees the truth, as long as the pictures are believed."""
    return WatchedDetector(Oracle(bench), MAST.model_copy(update=SMALL))


def tried(
    component: str,
    failure: str,
    situation: Situation = "follow",
    how: str = "",
    *,
    sensors: bool = False,
) -> Verdict:
    """The verdict with small pictures and that detector. `sensors`: with a second hall sensor and
    the blade's."""
    base = base_scenario(situation, "desk", "robust", "mast", sensors=sensors)
    base = base.model_copy(update={"lens": quick().lens})
    chosen = with_fault(base, situation, (component, failure, how))
    return watched(chosen, situation, None, watched_oracle)


@needs_firmware
@pytest.mark.parametrize(
    ("component", "failure", "by"),
    [
        ("pot", "off", "POT_OPEN"),
        ("estop", "off", "ESTOP_OPEN"),
        ("estop", "stuck", "ESTOP_SHORT"),
        ("serial", "off", "LINK_LOST"),
        ("host", "off", "LINK_LOST"),
        ("host", "stuck", "LINK_LOST"),
        ("firmware", "stuck", "WATCHDOG"),
        ("battery", "off", "BROWN_OUT"),
    ],
)
def test_the_firmware_stops_the_machine_in_time_and_says_why(
    component: str, failure: str, by: str
) -> None:
    verdict = tried(component, failure)
    assert by in verdict.detected_by, verdict
    assert verdict.ok, verdict
    assert verdict.stop_latency_ms is not None
    assert verdict.stop_latency_ms <= 250


@needs_firmware
@pytest.mark.parametrize("situation", ["follow", "turn"])
@pytest.mark.parametrize(
    ("failure", "how"), [("off", ""), ("stuck", ""), ("garbage", ""), ("wrong", "black")]
)
def test_without_pictures_to_believe_the_pilot_stops_the_machine(
    failure: str, how: str, situation: Situation
) -> None:
    verdict = tried("camera", failure, situation, how)
    assert verdict.detected_by.startswith("pilot"), verdict
    assert verdict.ok, verdict


@needs_firmware
@pytest.mark.parametrize("situation", ["follow", "turn"])
def test_wheels_that_count_nonsense_are_found_by_the_pilot(situation: Situation) -> None:
    verdict = tried("hall", "garbage", situation)
    found = "counts faster", "HALL_NOISE", "WHEEL_RUNAWAY"
    assert any(each in verdict.detected_by for each in found), verdict
    assert verdict.ok, verdict


@needs_firmware
def test_standing_by_chance_is_not_a_stop() -> None:
    """A turn stands wherever it changes direction, also one that is driven the wrong way."""
    verdict = tried("drive_motor", "wrong", "turn")
    assert verdict.detected_by == "nobody", verdict
    assert verdict.stop_latency_ms is None, verdict
    assert not verdict.ok, verdict


@needs_firmware
def test_a_machine_that_drives_the_wrong_way_is_stopped() -> None:
    verdict = tried("drive_motor", "wrong")
    # Backing over what it has cut it sees clear ground and stands, before the positions can tell.
    assert verdict.stop_latency_ms is not None
    assert verdict.stop_latency_ms < 3000, verdict


@needs_firmware
@pytest.mark.parametrize(
    ("component", "failure", "by"),
    [
        ("blade_relay", "off", "firmware BLADE_LOST"),
        ("blade_relay", "stuck", "firmware BLADE_STUCK"),
        ("drive_motor", "wrong", "firmware WRONG_WAY"),
    ],
)
def test_with_the_optional_sensors_the_firmware_finds_it(
    component: str, failure: str, by: str
) -> None:
    situation: Situation = "turn" if failure == "stuck" else "follow"
    assert not tried(component, failure, situation).ok
    verdict = tried(component, failure, situation, sensors=True)
    assert verdict.detected_by == by, verdict
    assert verdict.ok, verdict
    assert not verdict.limit


@needs_firmware
@pytest.mark.parametrize("situation", ["follow", "turn"])
def test_with_two_wheel_sensors_noise_on_the_first_is_named_though_it_comes_nowhere(
    situation: Situation,
) -> None:
    verdict = tried("hall", "garbage", situation, sensors=True)
    assert verdict.detected_by == "firmware HALL_NOISE", verdict
    assert verdict.ok, verdict


@needs_firmware
def test_what_nothing_on_board_can_notice_is_a_known_limit_and_no_pass() -> None:
    verdict = tried("blade_relay", "off")
    assert (verdict.ok, verdict.limit) == (False, True), verdict
    assert verdict.verdict.startswith("LIMIT")
    assert "no sensor on the blade" in verdict.verdict


def test_every_limit_says_why() -> None:
    limits = [pair.limit for pair in PAIRS.values() if pair.limit]
    assert limits
    assert all(limit.startswith("not detectable") for limit in limits)


@needs_firmware
@pytest.mark.parametrize("component", ["gnss", "phone"])
def test_a_fault_that_need_not_stop_the_machine_does_no_harm(component: str) -> None:
    assert tried(component, "intermittent").ok


@needs_firmware
def test_a_fault_that_should_stop_the_machine_and_does_not_is_unsafe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(PAIRS, ("gnss", "off"), Pair("for this test", Expect.STOP))
    verdict = tried("gnss", "off")
    assert not verdict.ok
    assert verdict.verdict == "UNSAFE: nobody notices, it goes on"
    assert verdict.stop_latency_ms is None
    assert verdict.moved_m > 1.0


@needs_firmware
def test_a_stop_beyond_its_bound_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PAIRS, ("serial", "off"), Pair("for this test", Expect.STOP, 0.1))
    verdict = tried("serial", "off")
    assert not verdict.ok
    assert verdict.verdict.startswith("LATE")


def test_the_matrix_holds_every_pair_and_every_how() -> None:
    names = all_faults()
    assert {(c, f) for c, f, _ in names} == set(PAIRS)
    assert ("camera", "wrong", "covered") in names
    assert len(names) == len(set(names))


def test_the_matrix_goes_on_where_it_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[Case] = []

    def verdict(case: Case) -> Verdict:
        words = " ".join(part for part in case.name if part)
        return Verdict(words, case.situation, "stop", "250 ms", "x", 1.0, 1.0, 0.0, True, "ok")

    def run(group: Group) -> list[Verdict]:
        ran.extend(group)
        return [verdict(case) for case in group]

    monkeypatch.setattr("hil.studies.matrix_runs.run_group", run)
    words = ["--only", "estop", "--workers", "1", "--out", str(tmp_path)]
    assert CliRunner().invoke(faults, words).exit_code == 0
    assert len(ran) == 6
    log = tmp_path / "verdicts.jsonl"
    lines = log.read_text().strip().splitlines(keepends=True)
    log.write_text("".join(lines[:2]) + lines[2][:40])  # killed while it wrote the third
    ran.clear()
    assert CliRunner().invoke(faults, words).exit_code == 0
    assert len(ran) == 4
    assert json.loads((tmp_path / "summary.json").read_text())["cases"] == 6
    assert (tmp_path / "faults.md").read_text().count("| estop ") == 6
    ran.clear()
    assert CliRunner().invoke(faults, words).exit_code == 0
    assert ran == []


def test_verdicts_of_other_programs_are_not_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = Case(("estop", "off", ""), "follow", "desk", "robust", "mast", None)
    verdict = Verdict("estop off", "follow", "stop", "", "x", 1.0, 1.0, 0.0, True, "ok")
    log = tmp_path / "verdicts.jsonl"
    log.write_text(json.dumps({"digest": digest(case), "verdict": asdict(verdict)}) + "\n")
    assert kept(log, [case]) == {case: verdict}
    monkeypatch.setattr("hil.studies.matrix_runs.programs", lambda _: b"changed")
    assert kept(log, [case]) == {}


def test_a_machine_of_its_own_fails_with_what_its_owner_has_measured(tmp_path: Path) -> None:
    name = ("pot", "off", "")
    own = Case(name, "follow", "desk", "robust", "mast", None, False, 301, str(tmp_path))
    scenario, home = scenario_of(own), random_field(301)
    assert scenario.world.machine == home.machine
    assert scenario.world.lens == home.world.lens
    told = scenario.told
    assert told.boundary == scenario.world.corners
    assert told.parameters["steer_kp"] != defaults()["steer_kp"]
    true = home.machine.drive.hall_pulses_per_m
    assert told.parameters["hall_per_metre"] == pytest.approx(true, rel=0.02)
    assert digest(own) != digest(replace(own, machine=None))


def test_hall_faults_have_a_hall_sensor_to_strike() -> None:
    base = base_scenario("follow", "desk", "robust", "mast")
    assert base.told.parameters["hall_per_metre"] > 0
    assert base.world.machine.drive.hall_pulses_per_m > 0


@needs_firmware
@pytest.mark.parametrize("situation", ["follow", "turn"])
def test_a_fault_in_a_copy_of_the_process_is_the_same_as_in_a_run_of_its_own(
    situation: Situation,
) -> None:
    base = base_scenario(situation, "desk", "robust", "mast")
    base = base.model_copy(update={"lens": quick().lens})
    names = [("serial", "off", ""), ("camera", "off", ""), ("pot", "garbage", "")]
    chosen = [with_fault(base, situation, name) for name in names]
    verdicts = branched(chosen, situation, watched_oracle)
    assert [v.fault for v in verdicts] == ["serial off", "camera off", "pot garbage"]
    assert verdicts[-1] == watched(chosen[-1], situation, None, watched_oracle)


def test_a_copy_of_the_process_gives_its_result_and_changes_nothing_here() -> None:
    held = [1]

    def add() -> list[int]:
        held.append(2)
        return held

    assert in_a_copy(add) == [1, 2]
    assert held == [1]


def test_a_copy_that_crashes_is_no_result(capfd: pytest.CaptureFixture[str]) -> None:
    def crash() -> None:
        raise ZeroDivisionError("here")

    with pytest.raises(RuntimeError, match="crashed"):
        in_a_copy(crash)
    assert "ZeroDivisionError: here" in capfd.readouterr().err


def test_only_a_fault_that_has_not_begun_gives_way_to_another_that_begins_alike() -> None:
    at = At(time_s=1.0)
    now = Injector((Fault(component="pot", failure="off", at=at),), 1)
    now.replace((Fault(component="pot", failure="stuck", at=at),))
    assert now.faults[0].failure == "stuck"
    with pytest.raises(ValueError, match="begin alike"):
        now.replace((Fault(component="pot", failure="off", at=At(time_s=2.0)),))


@needs_firmware
def test_the_same_seed_gives_the_same_faulty_run() -> None:
    def run(seed: int) -> bytes:
        faults = (
            Fault(component="serial", failure="garbage", at=NOW, value=0.05),
            Fault(component="battery", failure="garbage", at=NOW),
        )
        with Bench(
            Scenario.model_validate(quick().model_dump() | {"seed": seed, "faults": faults})
        ) as b:
            return b"".join(data for _, data in b.advance(2.0))

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_the_rig_refuses_faults_that_wait_for_a_state_it_does_not_see() -> None:
    done = CliRunner().invoke(rig, ["--scenario", "phone-lost"])
    assert isinstance(done.exception, UserError)
    assert "does not see the pilot's state" in str(done.exception)


@needs_firmware
@pytest.mark.parametrize("away_m", [0.5, 3.0, 8.0])
def test_only_a_tree_over_the_machine_takes_its_fix_away(away_m: float) -> None:
    x, y, _ = quick().start_pose()
    field = quick().field.model_dump() | {"trees": ({"x_m": x + away_m, "y_m": y},)}
    with Bench(quick(field=field, gnss={"canopy_loss": 1.0})) as bench:
        gga = next(sentence for sentence in bench.fix() if "GGA" in sentence)
    assert (gga.split(",")[6] == "0") is (away_m < 1.8)
