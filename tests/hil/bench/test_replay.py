"""Facts about replays: the same comes out again, and what does not is named."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from hil.bench.harvest import Harvest
from hil.bench.replay import replay
from hil.commands.replay import command
from hil.firmware import targets
from hil.scenario.faults import At, Fault
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.runs import record
from host.runs.record import Recorder
from tests.helpers.oracle import Oracle, quick

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


REFERENCES = sorted((Path(__file__).parents[1] / "references").glob("*.mcap"))
"""Small records that today's pilot and firmware must still reproduce. Where a change is meant to
show, make them anew: `daranti-hil harvest --scenario reference --out out/reference`, and copy
out/reference/record.mcap to tests/hil/references/reference.mcap."""


def recorded(path: Path, scenario: Scenario) -> Harvest:
    run = Harvest(scenario, path, detector=Oracle)
    run.run()
    run.close()
    return run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of ten seconds along the edge."""
    path = tmp_path_factory.mktemp("replay") / "record.mcap"
    recorded(path, quick())
    return path


def test_a_harvest_gives_the_same_commands_and_messages_again(run: Path) -> None:
    outcome = replay(run)
    assert outcome.commands == 200
    assert outcome.messages > 450
    assert outcome.pilot == []
    assert outcome.firmware == []
    assert outcome.notes == [
        "not every picture was kept: vision is not replayed, its views are",
    ]


@pytest.mark.parametrize("path", REFERENCES, ids=lambda path: path.stem)
def test_a_reference_is_reproduced(path: Path) -> None:
    outcome = replay(path)
    assert outcome.commands > 0
    assert not outcome.pilot, outcome.pilot[0]
    assert not outcome.firmware, outcome.firmware[0]


def test_with_one_gain_of_the_firmware_changed_the_first_difference_is_named(run: Path) -> None:
    outcome = replay(run, parameters={"steer_kp": 25.0})
    assert outcome.pilot == []
    assert outcome.firmware[0].name == "Telemetry.steer_duty"
    assert outcome.firmware[0].stamp < 3.0


def test_with_another_wheelbase_the_first_different_command_is_named(run: Path) -> None:
    outcome = replay(run, vehicle={"wheelbase_m": 1.1})
    assert outcome.firmware == []
    assert outcome.pilot[0].name == "command.steer_rad"


def test_the_command_line_says_which(run: Path) -> None:
    good = CliRunner().invoke(command, [str(run)])
    assert good.exit_code == 0, good.output
    assert "all the same: 200 commands" in good.output
    bad = CliRunner().invoke(command, [str(run), "--param", "steer_kp=25"])
    assert "firmware: at " in bad.output
    assert "Telemetry.steer_duty: recorded " in bad.output
    assert isinstance(bad.exception, UserError)


@pytest.mark.parametrize(
    ("component", "failure", "more"),
    [
        ("serial", "garbage", {"value": 0.02}),
        ("serial", "delayed", {}),
        ("battery", "intermittent", {}),
        ("camera", "intermittent", {}),
        ("gnss", "garbage", {}),
        ("host", "off", {"for_s": 1.0}),
        ("host", "slow", {}),
        ("firmware", "stuck", {}),
        ("pot", "garbage", {}),
    ],
)
def test_a_faulty_run_replays_as_well(
    tmp_path: Path, component: str, failure: str, more: dict[str, float]
) -> None:
    fault = Fault(component=component, failure=failure, at=At(state="follow", after_s=2.0), **more)  # type: ignore[arg-type]
    path = tmp_path / "record.mcap"
    recorded(path, quick(faults=(fault,)))
    assert any(topic == "/fault" for topic, _, _ in record.read(path))
    outcome = replay(path)
    assert outcome.commands > 50
    assert outcome.pilot == []
    assert outcome.firmware == []


def test_where_every_picture_was_kept_vision_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / "record.mcap"
    scenario = quick(lens={}, limits={"time_s": 3.0}, record={"pictures_every": 1})
    run = Harvest(scenario, path)
    run.run()
    run.close()
    outcome = replay(path)
    assert outcome.views > 20
    assert outcome.notes == []
    assert outcome.pilot == []


def test_a_record_without_vehicle_is_one_message(tmp_path: Path) -> None:
    path = tmp_path / "record.mcap"
    Recorder(path).close()
    with pytest.raises(UserError, match="does not say which vehicle"):
        replay(path)


def test_a_setting_that_makes_no_sense_is_one_message(run: Path) -> None:
    with pytest.raises(UserError, match="no parameter 'nonsense'"):
        replay(run, parameters={"nonsense": 1.0})
    with pytest.raises(UserError, match="wheelbase_m"):
        replay(run, vehicle={"wheelbase_m": -1.0})
