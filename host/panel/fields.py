"""The field on the page: walked, mended, planned. Files lie in the panel's folder as GeoJSON; the
gap and the corner to begin at lie beside them in `panel.json`.

Nothing here is quick: the panel calls it in a thread.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import shapely

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.vehicle import Vehicle
from host.field.areas import MAX_GAP_M, areas_of
from host.field.boundary_file import Boundary, boundary_of, load_field, save_field
from host.field.corners import was_recorded
from host.field.survey import Survey, survey_track
from host.field.walk import Track, find_loops, track_of
from host.panel import snapshot
from host.panel.snapshot import Json, number
from host.route.field_plan import BegunElsewhereError, plan_of
from host.route.plan import Plan
from host.route.preview import preview
from host.route.side import NO_EDGE
from host.runs.errand import compass_deg, errand_of
from host.runs.preflight import where_of
from host.runs.resume import load

SHOWN: Final = 600
"""Points of a walk on the page."""
MOST_CORNERS: Final = 200
"""Of a keep-out that is drawn by hand."""
FARTHEST_M: Final = 200.0
"""Way of a corner that is moved: what is farther is a slip, or no finger."""
LEAST_CORNERS: Final = 3
"""Of a field."""
CLOSE_M: Final = 6.0
"""How far a walk's end may lie from its beginning: a phone's drift during a lap."""


def _understood(track: Track, recorded: bool | None = None) -> Survey:
    """The field with straight sides, or (`recorded`) the edge as it was walked; where nobody has
    said which, as it was walked if straight sides hardly fit. UserError where the walk closes no
    loop, or has not the sides that were asked for."""
    if recorded is None:
        with contextlib.suppress(UserError):
            found = survey_track(track, close_m=CLOSE_M)
            if not found.seems_to_bend:
                return found
    return survey_track(track, irregular=recorded is not False, close_m=CLOSE_M)


@dataclass
class Walk:
    """A walk around the field with the phone in the hand."""

    fixes: list[Fix] = field(default_factory=list)
    on: bool = True
    name: str = ""
    """Of the field that was made of it."""
    said: list[str] = field(default_factory=list)
    """What of it was left aside."""

    @property
    def shown(self) -> list[Fix]:
        """Its positions, as many as are drawn."""
        good = [fix for fix in self.fixes if fix.quality > 0]
        return good[:: max(1, len(good) // SHOWN)]

    def understood(self, recorded: bool | None = None) -> Survey:
        """UserError where it is no field."""
        track = track_of(self.fixes)
        if track is None:
            raise UserError("not one position came: wait for the receiver, then walk again")
        return _understood(track, recorded)

    def about(self) -> Json:
        """What the page shows meanwhile."""
        out: Json = {"on": self.on, "said": self.said, "fixes": len(self.fixes)}
        if not self.on:
            return out
        track = track_of(self.fixes)
        if track is None:
            return out | {"length_m": 0.0, "back_m": 0.0, "laps": 0, "track": []}
        xy = track.xy
        loops = find_loops(track, CLOSE_M) if len(xy) > 8 else None
        every = max(1, len(xy) // SHOWN)
        return out | {
            "length_m": number(track.length_m, 1),
            "back_m": number(math.dist(xy[0], xy[-1]), 1),
            "laps": 0 if loops is None else len(loops.laps),
            "track": [[number(x, 2), number(y, 2)] for x, y in xy[::every].tolist()],
        }


def _moved(corner: tuple[float, float], at: tuple[float, float]) -> tuple[float, float]:
    """Where a corner lies once it is moved. UserError where it cannot."""
    if not all(map(math.isfinite, at)):
        raise UserError("there is no such corner")
    if math.dist(corner, at) > FARTHEST_M:
        raise UserError(f"a corner moves by {FARTHEST_M:g} m at most")
    return at


class FieldDesk:
    """The field that is chosen, and what was understood of it."""

    def __init__(
        self,
        folder: Path,
        vehicle: Vehicle,
        given: Path | None,
        gap_m: float | None,
        inset_m: float = 0.0,
        chosen: str = "",
    ) -> None:
        """`given`: a boundary file from elsewhere, copied into the folder once: what the page has
        changed of the copy since, such as a keep-out, stays until another is given. `chosen`: which
        of its fields. `inset_m`: how far inside a boundary the crop begins."""
        self._folder = folder
        self._vehicle = vehicle
        self.name: str | None = None
        self.boundary: Boundary | None = None
        self.gap_m: float | None = None
        self.inset_m = inset_m
        self.corner = 0
        self.plan: Plan | None = None
        self.walk: Walk | None = None
        self.problem = ""
        """Why the last wish was not done,"""
        self.unplanned = ""
        """why the field has no plan,"""
        self.asked: int | None = None
        """and the corner that was chosen, where the machine cannot begin there."""
        self._summary: Json | None = None
        self._given: dict[str, str] = {}
        """Which boundary each copy was made of, by its digest."""
        self._remember()
        if given is not None:
            self._copy(given, chosen)
        if gap_m is not None:
            self.gap_m = gap_m
        self._begin(given)

    def _begin(self, given: Path | None) -> None:
        """With the field that was given, or else chosen last."""
        try:
            if self.name is not None:
                self.open(self.name)
        except UserError as error:
            if given is not None:
                raise
            # A spoiled file ends no day: the page chooses another field, or is walked with.
            self.name, self.problem = None, str(error)
        if given is not None and self.unplanned:
            raise UserError(self.unplanned)

    def _copy(self, given: Path, chosen: str) -> None:
        boundary = load_field(given, chosen)
        self.name = f"{given.stem}.geojson"
        digest = hashlib.sha256(repr(boundary).encode()).hexdigest()
        if self._given.get(self.name) != digest or self.name not in self.files():
            save_field(self._folder / self.name, boundary)
            self._given[self.name] = digest

    # ---- what was chosen last --------------------------------------------------------------------

    def _remember(self) -> None:
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            kept = json.loads((self._folder / "panel.json").read_text(encoding="utf-8"))
            gap, corner = kept["gap_m"], kept["corner"]
            if (gap is None or 0 <= gap <= MAX_GAP_M) and corner >= 0:
                self.gap_m, self.corner = gap, int(corner)
            if kept["name"] in self.files():
                self.name = kept["name"]
            self._given = {str(name): str(digest) for name, digest in kept["given"].items()}

    def _keep(self) -> None:
        chosen = {"name": self.name, "gap_m": self.gap_m, "corner": self.corner}
        kept = {**chosen, "given": self._given}
        with contextlib.suppress(OSError):
            (self._folder / "panel.json").write_text(json.dumps(kept), encoding="utf-8")

    def files(self) -> list[str]:
        """Names of the fields in the folder."""
        return sorted(path.name for path in self._folder.glob("*.geojson"))

    @property
    def path(self) -> Path | None:
        """The chosen field's file."""
        return None if self.name is None else self._folder / self.name

    # ---- what a page asks ------------------------------------------------------------------------

    def do(self, wish: Json) -> None:
        """One wish; what went wrong stands in `problem`."""
        self.problem = ""
        try:
            self._do(wish)
        except UserError as error:
            self.problem = str(error)
        except (ValueError, TypeError, KeyError, IndexError, OverflowError):
            self.problem = "that is no such change"

    def _do(self, wish: Json) -> None:
        match wish.get("do"):
            case "open":
                self.open(str(wish["name"]))
            case "gap":
                gap = float(wish["gap_m"])
                if not 0 <= gap <= MAX_GAP_M:
                    raise UserError(f"a gap is 0 to {MAX_GAP_M:g} m wide")
                self.gap_m = gap
                self._plan()
            case "corner":
                self._begin_at(int(wish["corner"]))
            case "move_corner":
                self._move(int(wish["index"]), float(wish["x"]), float(wish["y"]))
            case "add_corner":
                at = (float(wish["x"]), float(wish["y"])) if "x" in wish else None
                self._add(int(wish["index"]), at)
            case "drop_corner":
                self._drop(int(wish["index"]))
            case "keep_out":
                self._keep_out([(float(x), float(y)) for x, y in wish["ring"][:MOST_CORNERS]])
            case "keep_out_drop":
                self._change(shapely.Polygon(self._polygon().exterior))
            case "walk_begin":
                self.walk = Walk()
            case "walk_end":
                self._walked()
            case "walk_drop":
                self.walk = None
            case "form":
                self._form(bool(wish["recorded"]))
            case _:
                pass

    def open(self, name: str) -> None:
        """Another field. UserError where there is none of that name."""
        if name not in self.files():
            raise UserError(f"there is no field {name}")
        # Where it cannot be read, the field that was chosen before stays: name and corners are one.
        try:
            self.boundary = load_field(self._folder / name)
        except UserError as error:
            raise UserError(f"the field {name} cannot be read: {error}") from error
        self.name = name
        self._plan()

    def _begin_at(self, corner: int) -> None:
        self._corners(corner)
        self.corner = corner
        self._plan()

    def _polygon(self) -> shapely.Polygon:
        if self.boundary is None:
            raise UserError("there is no field yet")
        return self.boundary.polygon(self.boundary.frame)

    def _corners(self, index: int) -> tuple[shapely.Polygon, list[tuple[float, float]]]:
        """The field and its corners. UserError where it has none of that number."""
        polygon = self._polygon()
        corners = [(x, y) for x, y, *_ in polygon.exterior.coords[:-1]]
        if not 0 <= index < len(corners):
            raise UserError("there is no such corner")
        return polygon, corners

    def _change(self, polygon: shapely.Polygon, corner: int | None = None) -> None:
        """`corner`: the number that the corner to begin at has from now on, where it changes."""
        if self.boundary is None or self.name is None:
            raise UserError("there is no field yet")
        if not polygon.is_valid:
            raise UserError("the field's sides would cross")
        was = self.boundary
        changed = boundary_of(polygon, was.frame, was.name, was.sigma_m, was.recorded)
        changed = replace(changed, left_out=was.left_out)
        if corner is not None:
            self.corner = corner
        self._save(self.name, changed)

    def _save(self, name: str, boundary: Boundary) -> None:
        """Into the folder, and back: a run drives what the file says, to its last digit, and its
        progress belongs to that plan alone."""
        save_field(self._folder / name, boundary)
        self.open(name)

    def _move(self, index: int, x: float, y: float) -> None:
        polygon, corners = self._corners(index)
        corners[index] = _moved(corners[index], (x, y))
        self._change(shapely.Polygon(corners, polygon.interiors))

    def _add(self, index: int, at: tuple[float, float] | None) -> None:
        """A corner in the middle of the side that leads on from a corner, moved to a place where
        one is given."""
        polygon, corners = self._corners(index)
        (x0, y0), (x1, y1) = corners[index], corners[(index + 1) % len(corners)]
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        corners.insert(index + 1, middle if at is None else _moved(middle, at))
        begun = self.corner + (self.corner > index)
        self._change(shapely.Polygon(corners, polygon.interiors), begun)

    def _drop(self, index: int) -> None:
        """One corner less; where the machine began at it, it begins at the next."""
        polygon, corners = self._corners(index)
        if len(corners) <= LEAST_CORNERS:
            raise UserError("a field has three corners at least")
        del corners[index]
        begun = (self.corner - (self.corner > index)) % len(corners)
        self._change(shapely.Polygon(corners, polygon.interiors), begun)

    def _keep_out(self, ring: list[tuple[float, float]]) -> None:
        polygon = self._polygon()
        outer = shapely.Polygon(polygon.exterior)
        hole = shapely.Polygon(ring)
        if not hole.is_valid or hole.area < 0.05 or not outer.contains(hole):
            raise UserError("a keep-out lies inside the field and its sides do not cross")
        holes = shapely.union_all([*map(shapely.Polygon, polygon.interiors), hole])
        self._change(
            shapely.Polygon(outer.exterior, [p.exterior for p in shapely.get_parts(holes)])
        )

    def _walked(self) -> None:
        walk = self.walk
        if walk is None or not walk.on:
            return
        found = walk.understood()
        now = datetime.datetime.now(tz=datetime.UTC)
        name = f"field-{now:%Y%m%d-%H%M%S}"
        walk.on, walk.name, walk.said = False, f"{name}.geojson", found.warnings
        self.corner = 0
        self._save(walk.name, found.boundary(name))

    @property
    def walked(self) -> Walk | None:
        """The walk that the chosen field was made of, for as long as the panel remembers it."""
        walk = self.walk
        return walk if walk is not None and not walk.on and walk.name == self.name else None

    def _form(self, recorded: bool) -> None:
        """The same walk, with straight sides or as it was walked; keep-outs stay, and about where
        the machine begins."""
        walk, was = self.walked, self.boundary
        if walk is None or was is None:
            raise UserError("this field was not walked just now: walk around it again")
        found = walk.understood(recorded)
        frame, outer = found.track.frame, shapely.Polygon(found.polygon.exterior)
        holes = was.polygon(frame).interiors
        if not all(outer.contains(shapely.Polygon(hole)) for hole in holes):
            raise UserError("a keep-out lies inside the field and its sides do not cross")
        begun = frame.to_local(*was.crop[self.corner])
        polygon = shapely.Polygon(outer.exterior, holes)
        again = boundary_of(polygon, frame, was.name, found.sigma_m, recorded)
        corners = [frame.to_local(*corner) for corner in again.crop]
        self.corner = min(range(len(corners)), key=lambda k: math.dist(corners[k], begun))
        walk.said = found.warnings
        self._save(walk.name, again)

    def _plan(self) -> None:
        self.unplanned, self.asked, self.plan, self._summary = "", None, None, None
        boundary = self.boundary
        if boundary is None:
            return
        self.corner = self.corner if self.corner < len(boundary.crop) else 0
        try:
            frame, plan = self._begun(boundary)
        except UserError as error:
            self.unplanned = str(error)
            return
        finally:
            self._keep()
        areas = areas_of(boundary.polygon(frame), self.gap_m, inset_m=self.inset_m)
        shown = preview(plan, areas, self._vehicle)
        self.plan = plan
        self._summary = {
            "sides": len(plan.sides),
            "turns": len(shown.turns),
            "seconds": number(shown.time_s, 0),
            "length_m": number(shown.cutting_m, 0),
            "leftover_m2": number(shown.leftover.area, 1),
            "warnings": [*shown.warnings, *boundary.doubts],
        }

    def _begun(self, boundary: Boundary) -> tuple[LocalFrame, Plan]:
        """The plan from the chosen corner on; from where the machine can begin, if it cannot
        there."""
        turn, gap_m, inset_m = "three_point", self.gap_m, self.inset_m
        try:
            return plan_of(boundary, self.corner, self._vehicle, turn, gap_m, inset_m)
        except BegunElsewhereError as elsewhere:
            self.asked, self.corner = self.corner, elsewhere.corner
        return plan_of(boundary, self.corner, self._vehicle, turn, gap_m, inset_m)

    def goal(self, resume: Path) -> Json | None:
        """Where the machine has to stand for the run that left `resume` to go on; None where that
        is not known."""
        if self.boundary is None:
            return None
        with contextlib.suppress(UserError):
            errand = errand_of(
                self.boundary,
                self.corner,
                self._vehicle,
                "three_point",
                self.gap_m,
                load(resume),
                resume,
                self.inset_m,
            )
            place = where_of(errand)
            if place is not None:
                x, y, heading = place
                return {
                    "kind": "goal",
                    "place": [number(x, 2), number(y, 2), number(heading, 4)],
                    "compass_deg": round(compass_deg(heading)) % 360,
                    "side": errand.begun[0] + 1,
                    "along_m": number(errand.begun[1], 1),
                    "cut": snapshot.of_cut(errand.whole, errand.begun),
                }
        return None

    def unfinished(self) -> Path | None:
        """What the last run left of this field, whatever ended it: a crash, an empty battery."""
        kept = self._folder.glob("drive-*.progress.json")
        last = max(kept, key=lambda path: path.stat().st_mtime, default=None)
        return last if last is not None and self.goal(last) is not None else None

    def about(self, here: Fix | None) -> Json:
        """The message to the pages."""
        boundary = self.boundary
        out: dict[str, Any] = {
            "kind": "field",
            "name": self.name,
            "files": self.files(),
            "gap_m": self.gap_m,
            "corner": self.corner,
            "problem": self.problem or self.unplanned,
            "asked": self.asked,
            "inside": self.plan is not None and self.plan.begins_inside != NO_EDGE,
            "walk": None if self.walk is None else self.walk.about(),
            "summary": self._summary,
            "plan": None if self.plan is None else snapshot.of_plan(self.plan),
            "here": None,
            "walked": None,
        }
        if boundary is None:
            return out
        frame = boundary.frame
        polygon = boundary.polygon(frame)
        if here is not None and here.quality > 0:
            x, y = frame.to_local(here.lat_deg, here.lon_deg)
            if polygon.distance(shapely.Point(x, y)) < 200:
                out["here"] = [number(x, 2), number(y, 2)]
        if self.walked is not None:
            places = [frame.to_local(fix.lat_deg, fix.lon_deg) for fix in self.walked.shown]
            out["walked"] = [[number(x, 2), number(y, 2)] for x, y in places]
        return out | {
            "recorded": was_recorded(boundary.crop, boundary.recorded),
            "boundary": [[number(x), number(y)] for x, y in polygon.exterior.coords[:-1]],
            "keep_outs": [
                [[number(x), number(y)] for x, y in h.coords[:-1]] for h in polygon.interiors
            ],
            "area_m2": number(polygon.area, 1),
        }
