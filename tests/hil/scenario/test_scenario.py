"""Facts about scenarios: what is wrong with one is said with its file, line and field."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from hil.bench.lockstep import Bench
from hil.commands.cli import cli
from hil.firmware import targets
from hil.firmware.provision import pwm_hz
from hil.scenario.scenario import assigned, changed, load, merge, named
from host.core.errors import EXIT_USER, UserError, run
from sim_plant.machine import DRIVE_PWM_HZ, STEER_PWM_HZ
from tests.helpers.oracle import quick

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
)


@pytest.mark.parametrize("name", named())
def test_every_named_scenario_is_sound(name: str) -> None:
    scenario = load(name)
    assert scenario.name == name
    assert scenario.plan().sides
    assert len(scenario.start_pose()) == 3
    fitted = scenario.world.machine.drive.hall_pulses_per_m
    assert scenario.told.parameters.get("hall_per_metre", 0.0) == pytest.approx(fitted, rel=0.011)


@pytest.mark.parametrize(
    ("parameters", "runs_at"),
    [
        ({}, (STEER_PWM_HZ, DRIVE_PWM_HZ)),
        ({"steer_pwm_freq": 4000, "drive_pwm_freq": 3000}, (4000, 980)),
        ({"drive_pwm_freq": 123}, (STEER_PWM_HZ, 123)),
        ({"drive_pwm_freq": 25000}, (STEER_PWM_HZ, 3922)),
    ],
)
def test_the_bridges_run_at_what_the_firmware_is_told(
    parameters: dict[str, float], runs_at: tuple[float, float]
) -> None:
    assert pwm_hz(parameters) == runs_at


@needs_firmware
def test_the_plant_s_bridges_follow_the_firmware_s_parameters() -> None:
    def lost(hz: float) -> float:
        with Bench(
            quick(belief={"errors": "exact", "parameters": {"steer_pwm_freq": hz}})
        ) as bench:
            return float(bench.params["st_dead"])

    assert lost(25_000) == pytest.approx(5 * lost(5_000))


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("seed: 1\nsped: 2\n", 2, "sped: no such field"),
        ("seed: -1\n", 1, "seed"),
        ("field:\n  size_m: [4, -4]\n", 2, "field.size_m"),
        ("weather:\n  hour: 11\n  wind: 3\n", 3, "weather.wind: no such field"),
        ("camera: nose\n", 1, "camera"),
        ("field:\n  gap_m: .inf\n", 2, "field.gap_m"),
        ("start: {lateral_error_m: .nan}\n", 1, "start.lateral_error_m"),
        ("belief:\n  parameters:\n    steer_kq: 3\n", 2, "no parameter 'steer_kq'"),
        ("belief: {parameters: {steer_kp: 1e6}}\n", 1, "steer_kp must be"),
        ("belief: {vehicle: {wheelbase: 1}}\n", 1, "wheelbase: no such field"),
        ("belief: {boundry: [[0, 0]]}\n", 1, "boundry"),
        ("belief: near enough\n", 1, "belief"),
        (
            "faults:\n  - {component: pot, failure: off, at: {time_s: 1}}\n"
            "  - {component: estop, failure: slow, at: {time_s: 1}}\n",
            3,
            "estop can be: off, stuck, intermittent",
        ),
        ("faults:\n  - {component: pot, failure: off, at: {}}\n", 2, "exactly one of"),
        ("faults:\n  - component: pot\n    failure: off\n    at: {time_s: 1, state: turn}\n", 4,
         "exactly one of"),
    ],
)  # fmt: skip
def test_an_error_names_file_line_and_field(
    tmp_path: Path, text: str, line: int, field: str
) -> None:
    path = tmp_path / "odd.yaml"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        load(str(path))
    message = str(error.value)
    assert "odd.yaml" in message
    if "camera" not in text:
        assert f"line {line}:" in message
    assert field in message
    assert "\n" not in message


def test_what_the_command_line_got_wrong_is_not_blamed_on_the_file(tmp_path: Path) -> None:
    path = tmp_path / "odd.yaml"
    path.write_text("weather: {hour: 9}\n")
    for setting, field in (
        ("weather.hour=99", "weather.hour"),
        ("weather=4", "weather"),
        ("nonsense=3", "nonsense"),
        ("camera=roof", "no camera mount"),
        ("lens.fov=3", "lens.fov"),
        ("belief.gap_m=x", "belief.gap_m"),
    ):
        for base in (path, "default"):
            with pytest.raises(UserError) as error:
                load(str(base), assigned(setting))
            assert str(error.value).startswith(f"the command line: {field}")
            assert ".yaml" not in str(error.value)
        with pytest.raises(UserError, match=f"^the command line: {field}"):
            changed(load(str(path)), assigned(setting))
    path.write_text("weather: {hour: 99}\n")
    with pytest.raises(UserError) as error:
        load(str(path), merge(assigned("seed=x"), assigned("weather.dust=0")))
    said = str(error.value).split("; ")
    assert any(text.startswith("the command line: seed:") for text in said)
    assert any(text.startswith(f"{path}, line 1: weather.hour:") for text in said)


@pytest.mark.parametrize(
    "text", ["a: [", "- 1\n", "\t", "off\n", "0\n", "a: 2026-13-45\n", "[" * 9999]
)
def test_what_is_no_mapping_is_one_message(tmp_path: Path, text: str) -> None:
    path = tmp_path / "odd.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=r"odd\.yaml"):
        load(str(path))


def test_a_walk_that_nobody_makes_is_refused_by_its_number() -> None:
    for setting, field in (
        ("belief={boundary: {cep_m: 1.0e9}}", "cep_m"),
        ("belief={boundary: {laps: 1000}}", "laps"),
    ):
        with pytest.raises(UserError, match=rf"the command line: belief.*{field}"):
            load("default", assigned(setting))


@pytest.mark.parametrize(
    ("option", "value"), [("--cep", "1e9"), ("--cep", "inf"), ("--cep", "nan"), ("--laps", "0")]
)
def test_commission_refuses_such_a_walk(
    option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", ["commission", option, value, "--out", "/proc/x"])
    assert exit_.value.code == EXIT_USER
    err = capsys.readouterr().err
    assert "None" not in err
    assert option in err


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UserError, match="default"):
        load("nowhere")


def test_settings_reach_nested_fields() -> None:
    scenario = load("default", merge(assigned("weather.hour=9.5"), assigned("seed=7")))
    assert (scenario.weather.hour, scenario.seed) == (9.5, 7)
    with pytest.raises(UserError, match="say FIELD=VALUE"):
        assigned("weather.hour")
    for value in ("2026-13-45", "[" * 9999):
        with pytest.raises(UserError, match="is not YAML"):
            assigned(f"weather.hour={value}")
    with pytest.raises(UserError, match=r"weather\.hour"):
        changed(scenario, assigned("weather.hour=late"))


def test_a_machine_that_fits_nowhere_stands_where_it_was_asked_to() -> None:
    narrow = load("default", {"field": {"gap_m": 0.5}, "start": {"before_m": 0.3}})
    wide = load("default", {"field": {"gap_m": 5.0}, "start": {"before_m": 0.3}})
    usual = load("default", {"start": {"before_m": 0.3}})
    assert narrow.start_pose() == wide.start_pose()
    x, y, _ = usual.start_pose()
    assert math.dist((x, y), wide.start_pose()[:2]) == pytest.approx(0.25, abs=0.011)


def test_where_the_edge_goes_on_the_operator_puts_the_blade_where_the_walk_began() -> None:
    """In standing crop, along the edge; at a corner before the crop."""
    turns = [math.tau * k / 40 for k in range(40)]
    round_ = [[15.0 * math.cos(t), 15.0 * math.sin(t)] for t in turns]
    world = {"start": {"corner": 0, "overlap_m": 0.1}, "field": {"polygon": round_}}
    scenario = load("default", {**world, "belief": {"errors": {}}})
    x, y, yaw = scenario.start_pose()
    machine = scenario.machine
    right = machine.blade_width_m / 2
    c, s = math.cos(yaw), math.sin(yaw)
    tip = x + machine.blade_x_m * c + right * s, y + machine.blade_x_m * s - right * c
    assert tip == pytest.approx((15.0 + 0.1 * s, -0.1 * c), abs=0.02)
    assert yaw == pytest.approx(math.atan2(round_[1][1], round_[1][0] - 15.0))


def test_an_operator_puts_the_machine_along_the_edge_not_along_its_first_point() -> None:
    """The same edge, drawn as one side and point by point with a bulge of a decimetre; beside it
    one that ends at a corner after two metres."""
    rest = [[20.0, 12.0], [0.0, 12.0]]
    drawn = [[0.0, 0.0], [20.0, 0.0], *rest]
    bulging = [[0.0, 0.0], [0.5, 0.1], [1.0, 0.0], [3.5, 0.0], [20.0, 0.0], *rest]
    short = [[0.0, 0.0], [2.0, 0.0], [2.0, 12.0], [0.0, 12.0]]
    told = {"start": {"corner": 0}, "belief": {"errors": {}}}
    along = [
        load("default", {**told, "field": {"polygon": ring}}).start_pose()[2]
        for ring in (drawn, bulging, short)
    ]
    assert along == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
