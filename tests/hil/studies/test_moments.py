"""Facts about one fault at many moments of a harvest."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from hil.commands.moments import command
from hil.firmware import targets
from hil.scenario import scenario
from hil.studies.moments import moments

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
EYES = {"eyes": "model", "seed": 3}
DRIVEN_BY_A_VNH5019 = {
    "wiring": {"drive": "vnh5019"},
    "belief": {"parameters": {"drive_driver": 3.0}},
}


def test_a_broken_wire_stops_the_machine_within_its_bound_at_every_moment_and_where_it_was() -> (
    None
):
    found = moments(
        scenario.load("default", EYES), ("pot", "off"), count=8, every_s=8.0, watch_s=3.0
    )
    assert len(found) == 8
    assert {m.phase for m in found} == {"follow", "turn"}
    for moment in found:
        assert moment.by == "firmware POT_OPEN"
        assert moment.stop_ms is not None and moment.stop_ms < 20
        assert moment.turned_deg < 2
        assert moment.aside_m < 0.02
        assert not moment.harm


def test_what_is_ridden_through_leaves_the_machine_on_its_path_or_stops_it() -> None:
    """And the harvest goes on behind each copy as if nothing had been."""
    chosen = scenario.load("default", EYES | {"seed": 1} | DRIVEN_BY_A_VNH5019)
    found = moments(chosen, ("battery", "stuck"), count=4, every_s=8.0, watch_s=3.0)
    assert [m.by for m in found] == ["nobody"] * 4
    assert max(m.aside_m for m in found) < 1e-3
    assert [m.at_s for m in found] == [
        m.at_s for m in moments(chosen, ("pot", "off"), count=4, every_s=8.0, watch_s=3.0)
    ]


def test_a_machine_that_only_becomes_faster_is_not_aside_of_its_path() -> None:
    """The firmware takes wheels that lose pulses for slow ones. The last copy gets 0.1 m farther
    than the harvest itself does in that time."""
    chosen = scenario.load("default", EYES)
    [moment] = moments(chosen, ("hall", "intermittent"), count=1, every_s=12.0, watch_s=2.0)
    assert moment.way_m > 1.0
    assert moment.aside_m < 1e-3


def test_a_fault_that_does_not_exist_is_refused() -> None:
    answer = CliRunner().invoke(command, ["--fault", "pot.asleep"])
    assert answer.exit_code != 0
    assert "no such fault" in str(answer.exception)
