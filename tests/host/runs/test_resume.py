"""Facts about saved progress: whole at any time, and the right side goes on."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.messages import Command, Request
from host.core.vehicle import Vehicle
from host.estimate.position import Position
from host.pilot.phase import Phase
from host.pilot.pilot import PAUSED, Pilot
from host.route.plan import Plan, spiral
from host.route.side import NO_EDGE
from host.runs import resume
from host.runs.resume import (
    BEFORE_M,
    EVERY_M,
    LEFT_M,
    Keeper,
    Progress,
    digest,
    laid_out,
    load,
    remaining,
    resume_at,
    save,
)
from tests.helpers.simple_world import SimpleWorld, drive, harvest

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
PLAN = spiral(SQUARE, 1, VEHICLE, "three_point", 2.0)
PATH = Path("run.progress.json")


def at(side: int, cut_m: float, phase: Phase = Phase.FAULT) -> Progress:
    return Progress(plan=digest(PLAN), corner=1, side=side, cut_m=cut_m, phase=phase)


# ---- the file ------------------------------------------------------------------------------------


def test_what_was_saved_reads_back(tmp_path: Path) -> None:
    path = tmp_path / PATH
    for kept in (at(0, 0.0), replace_pose(at(3, 4.125, Phase.TURN))):
        save(path, kept)
        assert load(path) == kept
    assert [file.name for file in tmp_path.iterdir()] == [PATH.name], "nothing is left beside it"


def replace_pose(kept: Progress) -> Progress:
    return kept.model_copy(update={"pose": (1.5, -2.25, math.pi)})


def test_a_write_that_fails_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / PATH
    save(path, at(1, 2.0))

    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(UserError, match=r"cannot save the progress in .*: No space left"):
        save(path, at(2, 0.0))
    assert load(path) == at(1, 2.0)
    assert [file.name for file in tmp_path.iterdir()] == [PATH.name]


def test_it_is_on_the_disk_before_it_has_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    rename = Path.replace
    monkeypatch.setattr("os.fsync", lambda _handle: done.append("fsync"))

    def renamed(self: Path, target: Path) -> Path:
        done.append("rename")
        return rename(self, target)

    monkeypatch.setattr(Path, "replace", renamed)
    save(tmp_path / PATH, at(1, 2.0))
    assert done == ["fsync", "rename", "fsync"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no saved progress: the file: Invalid JSON"),
        ("{}", "is no saved progress: plan: Field required"),
        (at(1, 2.0).model_dump_json().replace("2.0", "-2.0"), "cut_m: Input should be greater"),
        (at(1, 2.0).model_dump_json().replace('"side"', '"edge"'), "side: Field required"),
    ],
)
def test_a_file_that_is_none_is_one_message(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / PATH
    path.write_text(text)
    with pytest.raises(UserError, match=message) as error:
        load(path)
    assert "\n" not in str(error.value)


# ---- where to go on ------------------------------------------------------------------------------


@given(st.integers(0, len(PLAN.sides) - 2), st.floats(0.01, 12))
def test_one_goes_on_a_little_before_where_it_ended_or_with_the_next_side(
    side: int, cut_m: float
) -> None:
    found, begin_m = resume_at(at(side, cut_m), PLAN, PATH)
    if PLAN.sides[side].length_m - cut_m > LEFT_M:
        assert (found, begin_m) == (side, max(0.0, cut_m - BEFORE_M))
    else:
        assert (found, begin_m) == (side + 1, 0.0)


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (at(3, 1.0, Phase.FINISHED), "finished the field"),
        (at(len(PLAN.sides) - 1, 9.9), "the last side was cut to its end"),
        (at(len(PLAN.sides), 0.0), "belongs to another plan"),
        (at(3, 1.0).model_copy(update={"plan": digest(Plan())}), "belongs to another plan"),
        (at(3, 1.0).model_copy(update={"corners": ((0.0, 0.0),)}), "belongs to another plan"),
        (
            at(3, 1.0).model_copy(update={"corners": tuple(SQUARE), "cut": (7,)}),
            "does not fit the strips",
        ),
    ],
)
def test_what_cannot_be_resumed_is_said(kept: Progress, message: str) -> None:
    with pytest.raises(UserError, match=message):
        resume_at(kept, laid_out(kept, PLAN, PATH, VEHICLE), PATH)


def test_a_plan_is_named_by_its_sides() -> None:
    assert digest(PLAN) == digest(replace(PLAN, gap_m=None, turn="arc"))
    other = replace(PLAN.sides[0], length_m=PLAN.sides[0].length_m + 0.01)
    assert digest(PLAN) != digest(replace(PLAN, sides=(other, *PLAN.sides[1:])))


@given(st.integers(0, len(PLAN.sides) - 1), st.floats(0, 1))
def test_what_remains_ends_where_the_plan_does(side: int, share: float) -> None:
    whole = PLAN.sides[side]
    rest = remaining(PLAN, side, share * whole.length_m)
    first = rest.sides[0]
    assert len(rest.sides) == len(PLAN.sides) - side
    for length in ("length_m", "fence_m"):
        c, s = math.cos(whole.heading_rad), math.sin(whole.heading_rad)
        ends = [
            (k.x_m + getattr(k, length) * c, k.y_m + getattr(k, length) * s) for k in (whole, first)
        ]
        assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    before = [(k.x_m - k.back_m * c, k.y_m - k.back_m * s) for k in (whole, first)]
    assert before[0] == pytest.approx(before[1], abs=1e-9)
    assert (rest.boundary, rest.gap_m) == (PLAN.boundary, PLAN.gap_m)


@pytest.mark.parametrize("cut_m", [2.0, 5.0, 9.0])
def test_what_is_left_of_a_bent_side_runs_where_it_ran(cut_m: float) -> None:
    bent = replace(PLAN.sides[0], length_m=15.0, bends=((4.0, 0.3), (7.0, -0.5)))
    (rest, *_) = remaining(replace(PLAN, sides=(bent,)), 0, cut_m).sides
    for along in (0.1, 1.0, 3.0, 6.0):
        assert rest.pose(along) == pytest.approx(bent.pose(cut_m + along), abs=1e-9)


@pytest.mark.parametrize(
    ("cut_m", "edge", "along_m"), [(2.0, 0, 3.0), (5.0, 1, 1.5), (9.0, 2, 2.25)]
)
def test_what_is_left_of_a_side_begins_at_no_border_and_along_its_own_edge(
    cut_m: float, edge: int, along_m: float
) -> None:
    bends = ((4.0, 0.3), (7.0, -0.5))
    places = ((1.0, 0.9), (0.5, 0.9), (0.25, 0.9))
    whole = replace(
        PLAN.sides[0], length_m=15.0, bends=bends, edges=(0, 1, 2), places_m=places, begins_at=3
    )
    plan = replace(PLAN, sides=(whole,))
    (rest, *_) = remaining(plan, 0, cut_m).sides
    assert (rest.edge, rest.places_m[0]) == (edge, pytest.approx((along_m, 0.9)))
    assert len(rest.edges) == len(rest.places_m) == len(rest.bends) + 1
    assert rest.begins_at == NO_EDGE
    assert remaining(plan, 0, 0.0).sides[0] == whole


# ---- a run that dies, and one that goes on -------------------------------------------------------


class AtOnce(Executor):
    """Does what it is given before it goes on."""

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@pytest.fixture
def a_quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here seconds pass faster than a disk writes."""
    monkeypatch.setattr("host.runs.resume.ThreadPoolExecutor", AtOnce)


def die_after(world: SimpleWorld, pilot: Pilot, keeper: Keeper, turns: int, cut_m: float) -> None:
    """Drives until so much is done, keeping progress; then the power is gone."""

    def noted() -> bool:
        assert not pilot.done
        keeper.note(pilot)
        return (pilot.turns, pilot.cut_m) >= (turns, cut_m)

    drive(world, pilot, 1500.0, until=noted, fixes=False)


@pytest.mark.usefixtures("a_quick_disk")
@pytest.mark.parametrize("cut_m", [0.0, 4.3])
def test_after_a_crash_the_field_is_finished(tmp_path: Path, cut_m: float) -> None:
    plan = spiral([(0, 0), (6, 0), (6, 6), (0, 6)], 1, VEHICLE, "three_point", 2.0)
    world = SimpleWorld(VEHICLE, width=6.0, height=6.0)
    world.stand_at(plan.sides[0])
    path = tmp_path / PATH
    die_after(world, Pilot(VEHICLE, world, plan), Keeper(path, plan, 1, print), 2, cut_m)
    kept = load(path)
    assert kept.side == 2
    assert cut_m - EVERY_M - 0.1 <= kept.cut_m <= cut_m + 0.1

    begun = resume_at(kept, plan, path)
    rest = remaining(plan, *begun)
    after = SimpleWorld(VEHICLE, width=6.0, height=6.0)
    after.crop, after.neighbour = world.crop, world.neighbour
    after.stand_at(rest.sides[0])
    pilot = Pilot(VEHICLE, after, rest)
    keeper = Keeper(path, plan, kept.corner, print, begun)
    keeper.note(pilot)
    harvest(after, pilot)
    keeper.close(pilot)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert after.coverage > 0.985
    assert after.neighbour_cut == 0
    first = next(t.reason for t in pilot.transitions if t.phase is Phase.TURN)
    assert f"end of side {begun[0] + 1} of {len(plan.sides)}" in first, "it goes on counting"
    done = load(path)
    assert (done.phase, done.side) == (Phase.FINISHED, len(plan.sides) - 1)


def resumed(
    true_m: float, planned_m: float, cut_m: float, gap_m: float = 4.0
) -> tuple[SimpleWorld, Pilot]:
    """A field as high as true_m, planned_m by its unsure boundary, whose first side was cut to its
    end, by the progress up to cut_m."""
    corners = [(0.0, 0.0), (8.0, 0.0), (8.0, planned_m), (0.0, planned_m)]
    plan = spiral(corners, 1, VEHICLE, "three_point", gap_m, sigma_m=1.0)
    world = SimpleWorld(VEHICLE, width=8.0, height=true_m, gap=gap_m)
    world.stand_at(plan.sides[0])
    drive(world, Pilot(VEHICLE, world, plan), 60.0, until=lambda: world.y > true_m - 1.4)
    rest = remaining(
        plan, *resume_at(at(0, cut_m).model_copy(update={"plan": digest(plan)}), plan, PATH)
    )
    after = SimpleWorld(VEHICLE, width=8.0, height=true_m, gap=gap_m)
    after.crop, after.neighbour = world.crop, world.neighbour
    after.stand_at(rest.sides[0])
    return after, Pilot(VEHICLE, after, rest)


@pytest.mark.parametrize(("cut_m", "gap_m"), [(5.0, 4.0), (5.3, 4.0), (5.0, 2.0)])
def test_a_side_that_was_cut_to_its_end_before_ends_there(cut_m: float, gap_m: float) -> None:
    """The boundary had it longer, and STOP came just there: nothing stands before the blade. In the
    narrow gap no turn of three legs is sure to have room."""
    world, pilot = resumed(5.2, 6.2, cut_m, gap_m)
    drive(world, pilot, 20.0, until=lambda: pilot.turns == 1)
    assert pilot.turns == 1, pilot.reason
    before = world.coverage
    harvest(world, pilot)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert world.coverage > max(before, 0.98)
    assert world.neighbour_cut == 0


def test_where_no_side_can_end_nothing_ahead_is_a_wrong_place() -> None:
    world, pilot = resumed(5.2, 12.0, 5.0)
    drive(world, pilot, 20.0)
    assert pilot.phase is Phase.ALIGN
    assert "nothing stands before the blade" in pilot.reason
    assert world.distance == 0.0


def test_a_disk_that_hangs_does_not_hold_up_the_pilot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = threading.Event()
    written: list[Progress] = []

    def slow(_path: Path, kept: Progress) -> None:
        assert go_on.wait(10.0)
        written.append(kept)

    monkeypatch.setattr(resume, "save", slow)
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    keeper = Keeper(tmp_path / PATH, PLAN, 1, print)
    for _ in range(100):
        keeper.note(pilot)
    go_on.set()
    keeper.close(pilot)
    assert len(written) == 2, "the first and, at the end, the last"


def test_a_full_disk_is_said_once_and_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, _kept: Progress) -> None:
        raise UserError(f"cannot save the progress in {path}: No space left on device")

    monkeypatch.setattr(resume, "save", full)
    said: list[str] = []
    pilot = Pilot(VEHICLE, SimpleWorld(VEHICLE), PLAN)
    keeper = Keeper(tmp_path / PATH, PLAN, 1, said.append)
    keeper.note(pilot)
    keeper.close(pilot)
    assert len(said) == 1
    assert "No space left on device: should the run end, it cannot be resumed" in said[0]
    assert "tells an earlier place: do not go on with it" in keeper.to_go_on


def test_a_disk_that_was_full_for_a_while_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, _kept: Progress) -> None:
        raise UserError(f"cannot save the progress in {path}: No space left on device")

    said: list[str] = []
    pilot = Pilot(VEHICLE, SimpleWorld(VEHICLE), PLAN)
    keeper = Keeper(tmp_path / PATH, PLAN, 1, said.append)
    with monkeypatch.context() as disk:
        disk.setattr(resume, "save", full)
        keeper.note(pilot)
        while not said:
            time.sleep(0.01)
    keeper.close(pilot)
    assert keeper.to_go_on == f"to go on: the same command with --resume {tmp_path / PATH}"
    assert load(tmp_path / PATH).side == 0


@dataclass
class Stub:
    """What a keeper reads of a pilot."""

    turns: int = 0
    cut_m: float = 0.0
    phase: Phase = Phase.FOLLOW
    reason: str = ""
    plan: Plan = PLAN
    position: Position = field(default_factory=lambda: Position(VEHICLE))


def kept_of(path: Path, pilot: Stub, begun: tuple[int, float] = (0, 0.0)) -> Progress:
    keeper = Keeper(path, PLAN, 1, print, begun)
    keeper.note(cast(Pilot, pilot))
    keeper.close(cast(Pilot, pilot))
    return load(path)


def test_what_was_cut_before_counts_on_the_side_that_was_resumed_only(tmp_path: Path) -> None:
    first = kept_of(tmp_path / PATH, Stub(0, 0.5), (2, 3.0))
    assert (first.side, first.cut_m) == (2, 3.5)
    later = kept_of(tmp_path / PATH, Stub(1, 0.5), (2, 3.0))
    assert (later.side, later.cut_m) == (3, 0.5)


@pytest.mark.usefixtures("a_quick_disk")
@pytest.mark.parametrize(("given_up", "resumes_at"), [(False, None), (True, 2)])
def test_what_gathers_a_plans_remains_is_no_progress_of_it(
    tmp_path: Path, given_up: bool, resumes_at: int | None
) -> None:
    last = 2 if given_up else len(PLAN.sides) - 1
    cut_m = 1.5 if given_up else PLAN.sides[last].length_m
    keeper = Keeper(tmp_path / PATH, PLAN, 1, print)
    keeper.note(cast(Pilot, Stub(last, cut_m)))
    for gathered in (1, 2, 3):
        plan = replace(PLAN, sides=(*PLAN.sides[: last + 1], *PLAN.sides[:gathered]))
        on = Stub(last + gathered, 3.0, Phase.TURN, plan=replace(plan, gathered=gathered))
        keeper.note(cast(Pilot, on))
    keeper.close(cast(Pilot, on))
    kept = load(tmp_path / PATH)
    assert (kept.side, kept.cut_m, kept.phase) == (last, pytest.approx(cut_m), Phase.TURN)
    if resumes_at is None:
        with pytest.raises(UserError, match="the last side was cut to its end"):
            resume_at(kept, PLAN, tmp_path / PATH)
    else:
        assert resume_at(kept, PLAN, tmp_path / PATH)[0] == resumes_at


@pytest.mark.usefixtures("a_quick_disk")
def test_a_change_of_phase_is_kept_at_once(tmp_path: Path) -> None:
    keeper = Keeper(tmp_path / PATH, PLAN, 1, print)
    for phase in (Phase.FOLLOW, Phase.HESITATE):
        keeper.note(cast(Pilot, Stub(phase=phase)))
        assert load(tmp_path / PATH).phase is phase


def test_a_run_that_never_took_a_step_leaves_what_was_there(tmp_path: Path) -> None:
    save(tmp_path / PATH, at(4, 1.0))
    Keeper(tmp_path / PATH, PLAN, 1, print).close(cast(Pilot, Stub()))
    assert load(tmp_path / PATH) == at(4, 1.0)


# ---- the operator's pause ------------------------------------------------------------------------


@pytest.mark.parametrize("turns", [0, 1])
def test_a_pause_of_any_length_changes_nothing_but_the_time(turns: int) -> None:
    """Paused while cutting, and in the middle of a turn."""
    world = SimpleWorld(VEHICLE, width=5.0, height=5.0)
    square = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0)]
    pilot = Pilot(VEHICLE, world, spiral(square, 1, VEHICLE))
    drive(world, pilot, 8.0 if turns == 0 else 200.0, until=lambda: 0 < turns <= pilot.turns)
    drive(world, pilot, 3.0)
    phase = pilot.phase
    commands: list[Command] = []
    pilot.paused = True
    drive(world, pilot, 150.0, commands)
    standing = {(c.request, c.speed_mps, c.blade, c.reason) for c in commands}
    assert standing == {(Request.DRIVE, 0.0, False, PAUSED)}
    assert abs(world.speed) < 0.01
    assert pilot.phase is phase
    pilot.paused = False
    harvest(world, pilot, 2000.0)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert world.coverage > 0.99
