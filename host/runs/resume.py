"""Saved progress: how far a plan has been cut, so that a run that ended (a crash, an empty battery,
Ctrl-C) goes on later with the right side.

The file is small and whole at any time: written beside itself, brought to the disk, then renamed.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.strict import Strict
from host.core.vehicle import Vehicle
from host.core.whole_file import write_whole
from host.estimate.outline import Outline
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.anew import around, moved_with
from host.route.plan import Plan
from host.route.side import NO_EDGE

EVERY_M = 0.5
"""What is lost at most: so much of a side may be driven again over stubble."""
BEFORE_M = 0.2
"""A resumed side begins so far before what was cut: dead reckoning errs."""
ALIKE_M = 1e-6
"""Corners that lie so near together are the same."""
LEFT_M = 0.6
"""A shorter rest of a side is none: the next side is the one to go on with."""


class Progress(Strict):
    """How far a plan has been cut. `side` counts from 0 in the whole plan, `cut_m` from where the
    blade met that side's crop."""

    plan: str
    """`digest` of the whole plan."""
    corner: Annotated[int, Field(ge=0)]
    """Of the boundary, where the plan begins."""
    side: Annotated[int, Field(ge=0)]
    cut_m: Annotated[float, Field(ge=0)] = 0.0
    pose: tuple[float, float, float] | None = None
    """x, y (m) and heading (rad) in the field frame, where known."""
    corners: tuple[tuple[float, float], ...] = ()
    """Where the boundary's were found to lie, metres of the field frame, and"""
    sigma_m: Annotated[float, Field(ge=0)] = 0.0
    """how surely; none: where the boundary's file has them."""
    laid: tuple[tuple[float, float], ...] = ()
    """Where they were taken to lie when the plan that the machine drives by was laid out; none:
    where they were found."""
    cut: tuple[int, ...] = ()
    """Edges of the boundary along which strips were cut, in their order: with the corners they tell
    how the plan was laid out."""
    phase: Phase
    reason: str = ""
    written: str = ""
    """UTC, ISO 8601."""


def digest(plan: Plan) -> str:
    """Names a plan by its sides: the same sides in the same order, the same name."""
    sides = json.dumps([asdict(side) for side in plan.sides], sort_keys=True)
    return hashlib.sha256(sides.encode()).hexdigest()[:16]


# ---- the file ------------------------------------------------------------------------------------


def save(path: Path, progress: Progress) -> None:
    """Whole or not at all, also when the power fails in between. UserError where the folder cannot
    be written to."""
    try:
        write_whole(path, progress.model_dump_json(indent=1) + "\n")
    except OSError as error:
        raise UserError(f"cannot save the progress in {path}: {error.strerror}") from error


def load(path: Path) -> Progress:
    """UserError where the file is missing or is no saved progress."""
    check_input(path, "the saved progress")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"cannot read the saved progress {path}: {why}") from error
    try:
        return Progress.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise UserError(
            f"{path} is no saved progress: {where}: {first['msg']}; name the .progress.json that "
            "the run left beside its record"
        ) from error


# ---- going on ------------------------------------------------------------------------------------


def laid_out(progress: Progress, entered: Plan, path: Path, vehicle: Vehicle) -> Plan:
    """The whole plan as it was laid out when the run ended: `entered`, the boundary's own, or
    around its corners as that run found them. UserError where `path`'s progress belongs to another
    plan."""
    fits = len(progress.corners) in (0, len(entered.boundary))
    if progress.plan != digest(entered) or not fits:
        raise UserError(
            f"{path} belongs to another plan: the boundary, the corner, the inset or the "
            "machine's file differ from that run's"
        )
    if not progress.corners:
        return entered
    laid = progress.laid or progress.corners
    # Before a strip was cut to its end, what is known is where the plan begins.
    cut = progress.cut or entered.cut_along(1)
    as_entered = math.dist(np.ravel(laid), np.ravel(entered.boundary)) < ALIKE_M
    if as_entered and cut == entered.cut_along(len(cut)):
        whole: Plan | None = entered
    else:
        whole = around(entered, list(laid), cut, vehicle)
    if whole is None:
        raise UserError(
            f"{path}: the boundary that was found there does not fit the strips that were cut; "
            "survey what still stands and harvest it as a field of its own"
        )
    return replace(_found(whole, progress.corners), sigma_m=progress.sigma_m)


def _found(plan: Plan, corners: Sequence[tuple[float, float]]) -> Plan:
    """The same sides where a boundary whose corners were found elsewhere has them, as the pilot
    takes them until it lays them out anew."""
    outline = Outline(plan.boundary)
    outline.move(np.ravel(corners) - np.ravel(plan.boundary))
    outs = tuple(tuple(moved_with(plan.boundary, corners, ring)) for ring in plan.keep_outs)
    sides = tuple(map(outline.found, plan.sides))
    return replace(plan, sides=sides, boundary=tuple(corners), keep_outs=outs)


def resume_at(progress: Progress, plan: Plan, path: Path) -> tuple[int, float]:
    """(side, cut_m) of the whole plan, as it was laid out, to go on with. UserError where nothing
    is left."""
    if progress.side >= len(plan.sides):
        raise UserError(f"{path} belongs to another plan: this one has {len(plan.sides)} sides")
    if progress.phase is Phase.FINISHED:
        raise UserError(f"{path}: that run finished the field; there is nothing to resume")
    side, cut_m = progress.side, max(0.0, progress.cut_m - BEFORE_M)
    if plan.sides[side].length_m - progress.cut_m > LEFT_M or progress.cut_m == 0.0:
        return side, cut_m
    if side + 1 == len(plan.sides):
        raise UserError(f"{path}: the last side was cut to its end; there is nothing to resume")
    return side + 1, 0.0


def remaining(plan: Plan, side: int, cut_m: float) -> Plan:
    """What is left of a plan from cut_m along a side on; areas and geofence stay the field's."""
    this = plan.sides[side]
    x, y, heading = this.pose(cut_m)
    passed = [at for at, _ in this.bends if at < cut_m]
    places = [*this.places_m[len(passed) :]]
    if places:
        along, inside = places[0]
        places[0] = along + cut_m - (passed[-1] if passed else 0.0), inside
    rest = replace(
        this,
        x_m=x,
        y_m=y,
        heading_rad=heading,
        bends=tuple((at - cut_m, turn) for at, turn in this.bends if at >= cut_m),
        length_m=this.length_m - cut_m,
        fence_m=this.fence_m - cut_m,
        back_m=this.back_m + cut_m,
        edges=this.edges[len(passed) :],
        places_m=tuple(places),
        # Where it was left, no border of the field is met.
        begins_at=this.begins_at if cut_m == 0.0 else NO_EDGE,
    )
    before = (*plan.before, *(cut.edge for cut in plan.sides[:side]))
    sides = (rest, *plan.sides[side + 1 :])
    return replace(plan, sides=sides, done=plan.done + side, before=before)


class Keeper:
    """Keeps a progress file up to date while a pilot drives what `remaining` gave it. A thread of
    its own writes: a disk may take longer than the firmware waits for a command."""

    def __init__(
        self,
        path: Path,
        plan: Plan,
        corner: int,
        say: Callable[[str], None],
        begun: tuple[int, float] = (0, 0.0),
    ) -> None:
        """`plan` is the whole one as it was entered, `begun` what `resume_at` gave. What cannot be
        written is said once and stops nothing."""
        self.path = path
        self._plan = digest(plan)
        self._corner = corner
        self._say = say
        self._begun = begun
        self._kept: Progress | None = None
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="progress")
        self._writing: Future[None] | None = None
        self._failed = False

    def note(self, pilot: Pilot) -> None:
        """Called after every step; returns at once."""
        if self._writing is not None and not self._writing.done():
            return
        now = self._now(pilot)
        kept = self._kept
        if (
            kept is None
            or (now.side, now.phase) != (kept.side, kept.phase)
            or abs(now.cut_m - kept.cut_m) >= EVERY_M
        ):
            self._write(now)

    def close(self, pilot: Pilot) -> None:
        """Writes the last state and waits for the disk."""
        if self._kept is not None:
            self._write(self._now(pilot))
        self._writer.shutdown()

    @property
    def to_go_on(self) -> str:
        """What to do to go on, in words, once it is closed."""
        if self._failed:
            return (
                f"the end of this run could not be written, {self.path} tells an earlier place: do "
                "not go on with it, begin anew on what still stands"
            )
        return f"to go on: the same command with --resume {self.path}"

    def _now(self, pilot: Pilot) -> Progress:
        state: dict[str, Any] = {
            "pose": pilot.position.pose if pilot.position.known else None,
            "phase": pilot.phase,
            "reason": pilot.reason,
            "written": datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="seconds"),
        }
        if pilot.plan.gathered > 0 and self._kept is not None:
            # What gathers the plan's remains is no part of it.
            return self._kept.model_copy(update=state)
        side, cut_m = self._begun
        if pilot.turns > 0:
            cut_m = 0.0
        found: dict[str, Any] = {}
        position = pilot.position
        if position.outline.states:
            count = pilot.turns + (pilot.cut_m > 0.0)
            found = {
                "corners": tuple(position.outline.corners),
                "laid": pilot.plan.boundary,
                "sigma_m": min(position.corners_sigma_m, pilot.plan.sigma_m),
                "cut": pilot.plan.cut_along(count),
            }
        return Progress(
            **found,
            plan=self._plan,
            corner=self._corner,
            side=side + pilot.turns,
            cut_m=round(max(0.0, cut_m + pilot.cut_m), 3),
            **state,
        )

    def _write(self, progress: Progress) -> None:
        self._kept = progress
        self._writing = self._writer.submit(self._save, progress)

    def _save(self, progress: Progress) -> None:
        try:
            save(self.path, progress)
        except UserError as error:
            if not self._failed:
                self._failed = True
                self._say(f"{error}: should the run end, it cannot be resumed")
        else:
            self._failed = False
