"""Facts about a boundary that was wrong: the first round finds it, the machine stands while the
rest is laid out, and a run that died goes on around what was found."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.position import Position
from host.pilot.behaviours.lay_out import STRIPS, LayOut
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.anew import Anew, displaced
from host.route.plan import Plan, spiral
from host.runs.resume import (
    BEFORE_M,
    Keeper,
    Progress,
    digest,
    laid_out,
    load,
    remaining,
    resume_at,
)
from tests.helpers.simple_world import SimpleWorld, drive, harvest
from tests.host.runs.test_resume import AtOnce

VEHICLE = Vehicle()
TRUE = [(0.0, 0.0), (7.0, 0.0), (7.0, 7.0), (0.0, 7.0)]
SAID = [(0.0, 0.0), (7.4, 0.0), (7.0, 6.6), (0.0, 7.0)]
SIGMA_M = 0.5
PATH = Path("run.progress.json")
START = spiral(TRUE, 0, VEHICLE, "three_point", 2.0).sides[0]


def world() -> SimpleWorld:
    found = SimpleWorld(VEHICLE, width=7.0, height=7.0)
    found.stand_at(START)
    return found


def entered() -> Plan:
    return spiral(SAID, 0, VEHICLE, "three_point", 2.0, sigma_m=SIGMA_M)


def test_the_worst_corner_is_that_against_the_others() -> None:
    turned = [(-y + 3.0, x - 2.0) for x, y in TRUE]
    assert displaced(TRUE, turned)[1] < 1e-9
    turned[2] = (turned[2][0] + 1.0, turned[2][1])
    corner, off_m = displaced(TRUE, turned)
    assert corner == 2
    assert 0.4 < off_m < 1.0


def test_strips_are_laid_out_a_few_at_a_time_and_make_the_same_plan() -> None:
    plan = entered()
    slowly, at_once = (Anew(plan, TRUE, plan.cut_along(4), VEHICLE) for _ in range(2))
    steps = 0
    while not slowly.over:
        slowly.lay(STRIPS)
        steps += 1
    at_once.lay(10_000)
    assert steps > 3
    assert slowly.plan(plan, 3) == at_once.plan(plan, 3)


def test_of_a_large_field_no_more_is_laid_out_than_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("host.route.anew.ENOUGH_STRIPS", 1)
    plan = entered()
    anew = Anew(plan, TRUE, plan.cut_along(1), VEHICLE)
    while not anew.enough(plan, 0):
        anew.lay(1)
    assert not anew.over
    found = anew.plan(plan, 0)
    assert found is not None
    whole = spiral(TRUE, 0, VEHICLE, "three_point", 2.0, sigma_m=SIGMA_M)
    assert found.sides[:3] == whole.sides[:3]
    assert found.sides[3:] == plan.sides[3:]


@pytest.mark.parametrize("corner", range(4))
@pytest.mark.parametrize("cut_m", [0.0, 3.0])
def test_a_run_that_ended_on_its_first_side_goes_on_there(corner: int, cut_m: float) -> None:
    """Whichever corner it began at: no strip says so yet."""
    plan = spiral(SAID, corner, VEHICLE, "three_point", 2.0, sigma_m=SIGMA_M)
    kept = Progress(
        plan=digest(plan),
        corner=corner,
        side=0,
        cut_m=cut_m,
        corners=tuple(TRUE),
        sigma_m=SIGMA_M,
        phase=Phase.FAULT,
    )
    whole = laid_out(kept, plan, PATH, VEHICLE)
    assert (whole.sides[0].x_m, whole.sides[0].y_m) == pytest.approx(TRUE[corner])
    side, begin_m = resume_at(kept, whole, PATH)
    x, y, _ = whole.sides[side].pose(begin_m)
    assert math.dist((x, y), TRUE[corner]) == pytest.approx(max(0.0, cut_m - BEFORE_M))


@pytest.mark.parametrize("laid", [SAID, [(0.0, 0.0), (7.2, 0.0), (7.0, 6.8), (0.0, 7.0)]])
def test_a_run_goes_on_by_the_plan_that_it_drove_by(
    laid: list[tuple[float, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where no plan can be laid out around the corners as they were found later."""
    plan = entered()
    drove_by = spiral(laid, 0, VEHICLE, "three_point", 2.0, sigma_m=SIGMA_M)
    kept = Progress(
        plan=digest(plan),
        corner=0,
        side=5,
        cut_m=2.0,
        corners=tuple(TRUE),
        laid=tuple(laid),
        sigma_m=SIGMA_M,
        cut=drove_by.cut_along(6),
        phase=Phase.FOLLOW,
    )

    def only_then(_: Plan, corners: list[tuple[float, float]], *__: object) -> Plan | None:
        return drove_by if corners == laid else None

    monkeypatch.setattr("host.runs.resume.around", only_then)
    whole = laid_out(kept, plan, PATH, VEHICLE)
    assert whole.boundary == tuple(TRUE)
    found = Position(VEHICLE, drove_by.boundary, SIGMA_M).outline
    found.move(np.ravel(TRUE) - np.ravel(laid))
    assert whole.sides == tuple(map(found.found, drove_by.sides))


@pytest.fixture
def a_quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("host.runs.resume.ThreadPoolExecutor", AtOnce)


@pytest.mark.usefixtures("a_quick_disk")
def test_a_run_that_found_its_boundary_dies_and_goes_on_around_it(tmp_path: Path) -> None:
    path, plan, before = tmp_path / "run.progress.json", entered(), world()
    pilot, keeper = Pilot(VEHICLE, before, plan), Keeper(path, plan, 0, print)

    def killed() -> bool:
        assert not pilot.done, pilot.reason
        keeper.note(pilot)
        return (pilot.turns, pilot.cut_m) >= (5, 1.5)

    drive(before, pilot, 1500.0, until=killed)
    assert any("laying out" in t.reason for t in pilot.transitions)
    assert pilot.believed_wrong.startswith("the boundary was wrong by up to 0.")
    saved = load(path)
    assert displaced(TRUE, saved.corners)[1] < 0.6 * displaced(TRUE, SAID)[1]

    whole = laid_out(saved, plan, path, VEHICLE)
    rest = remaining(whole, *resume_at(saved, whole, path))
    after = SimpleWorld(VEHICLE, width=7.0, height=7.0)
    after.crop, after.neighbour = before.crop, before.neighbour
    after.stand_at(rest.sides[0])
    again = Pilot(VEHICLE, after, rest)
    harvest(after, again)
    assert again.phase is Phase.FINISHED, again.reason
    assert after.coverage > 0.97
    assert after.neighbour_cut == 0


def test_a_boundary_that_is_known_is_never_laid_out_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LayOut, "step", lambda *_: pytest.fail("laid out"))
    field = world()
    pilot = Pilot(VEHICLE, field, spiral(TRUE, 0, VEHICLE, "three_point", 2.0))
    harvest(field, pilot)
    assert pilot.phase is Phase.FINISHED
    assert pilot.believed_wrong == ""
