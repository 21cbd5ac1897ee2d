"""The blade turns only in crop that goes on from what it is cutting.

Pictures say where crop ends before the blade; the way driven since then is counted by whichever of
hall sensor and drive duty says more, so that neither alone can hide it. Clear ground that is longer
than a patch may be a gap: the machine stands, looks once more without the blade's dust, and goes no
farther unless crop stands right at the blade; where the side may end, only if its edge is in line
with what was cut: a neighbour's lies across. Only where the plan has crop by more than any belief
errs, and pictures show its edge all the way, does it go on, its blade off, and cuts again where the
edge that it followed goes on in line; and right beside what it has cut itself, where no gap is.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Final

from host.core.messages import Command, Request, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import AT_BLADE_M, AT_BLADE_PICTURES, CLEAR_M, CONFIDENT, END_CLEAR_M
from host.vision.view import CropView

PATCH_M: Final = 0.6
"""Clear ground that the blade may cross inside a field. The narrowest gap that is harvested beside
is 1.2 m wide; of it braking takes 0.3 m."""
DUTY_SHARES: Final = (0.5, 0.85)
"""Of the speed that a drive duty gives on level stubble: what it gives up a slope of 5 degrees, and
in crop."""
UNCOUNTED_MPS: Final = 0.1
"""More than the duty gives on level stubble, without a wheel sensor, at most: down 2 degrees."""
DOUBTED: Final = 1.25
"""Times what the wheels' sensor counts: more is not laid to lost pulses, on the duty's word alone,
as long as a slope may explain it."""
IN_LINE_M: Final = 0.4
"""Beside its place, at most, an edge is the one that was followed before the clear ground."""
IN_LINE_SHARE: Final = 0.25
"""Of a look's pictures of crop at the blade, how many show its edge there, and fewer elsewhere:
what lies across has none, and of crop that is being cut dust in the shade hides it in every other
one."""
IN_LINE_SURE: Final = 0.3
"""Confidence in an edge from which a look counts it. An edge to steer by is to be right to within a
decimetre; here it may lie IN_LINE_M beside. Crop of which a mast shows few stems leaves 0.35 to
0.45 (picture field 10427), and what goes on to the picture's border 0. Larger: such crop stops the
machine; smaller: chance borders count."""
THERE_M: Final = 0.1
"""Beside its place, at most, a look counts an edge however unsure it is. In crop along whose edge a
machine drives 47 to 66 % of the unsure ones lie there (low camera standing: 20 %), and 3 to 8 % of
those of crop whose edge lies elsewhere, that has none, or that is not at the blade: 5,600 unsure
pictures of the drives that the model eyes are fitted to. Larger: chance borders count."""
STANDS_M: Final = 0.35
"""Before the blade, at most, crop with its edge in line stands right at it in a look: of crop that
a machine has just stopped in, every other picture shows the foot 0.31 m ahead."""
SHOWN_M, SHOWN_FOR_M = 0.6, 0.5
"""Beside its place, at most, an edge along which clear ground is crossed: half a blade's width and
what a lane errs; and the way for which one that was seen is there."""
ALONGSIDE_M: Final = 1.0
"""The same of crop that stands beside the machine's way, left of it: a gap is wider."""
SETTLE_S: Final = 2.0
"""After the machine was told to stand, until its blade's dust has settled;"""
LOOK_S: Final = 3.5
"""and until that look is over."""
STANDS_STILL_M: Final = 0.01
"""From picture to picture: a machine that creeps comes 0.015 m."""
HISTORY_S: Final = 2.0
"""Of the way driven, kept for pictures that come late: more than any camera's delay."""


@dataclass(slots=True)
class _Look:
    """How many of its pictures showed what."""

    clear: int = 0
    """Clear ground;"""
    crop: int = 0
    """crop at the blade;"""
    in_line: int = 0
    """the edge of that, in line with what was followed;"""
    aside: int = 0
    """and elsewhere."""


class CutGuard:
    """Fed with all telemetry and with the pictures taken along a side."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._way_m = 0.0
        self._stamp = -math.inf
        self._past: deque[tuple[float, float]] = deque()
        """(stamp, way) of late, for pictures that come late."""
        self._begun_m = 0.0
        """The way at the side's beginning."""
        self._slack_m = 0.0
        self._cutting = False
        """Whether pictures have shown this side's crop at the blade."""
        self._cut_to_m = -math.inf
        """The way as far as pictures have shown crop at the blade: what lies before that is cut,
        and no clear ground for a machine that has backed over it."""
        self._mown_to_m = -math.inf
        """The way as far as the blade has turned on this side."""
        self.blade_stamp = -math.inf
        """When it last turned."""
        self._clear_from_m: float | None = None
        self._clear_to_m = -math.inf
        """As far as pictures have shown that ground to be clear."""
        self._held_since: float | None = None
        self._at_blade = 0
        """Pictures in a row that showed crop there; of a machine that stands, how many more did
        than did not."""
        self._pictured_m = -math.inf
        """The way at the last picture."""
        self._look = _Look()
        self._crossing = False
        """Whether it goes on over clear ground, its blade off, after such a look."""
        self._edge_at_m = self._line_at_m = -math.inf
        """The way at the last picture that surely showed an edge beside the machine, and one near
        the lane."""
        self.refused = False
        """Whether the machine has stood and looked, and what lies beyond must not be cut."""

    @property
    def clear_m(self) -> float:
        """How far the blade has come over clear ground, at most."""
        return 0.0 if self._clear_from_m is None else max(0.0, self._way_m - self._clear_from_m)

    @property
    def passes(self) -> bool:
        """Whether `limit` lets all pass as it is: what the plan has here does not matter."""
        return self._held_since is None and self.clear_m < self._allowed_m

    @property
    def cuts_on(self) -> bool:
        """Whether the blade has come over no clear ground since pictures have shown crop at it: to
        `take_picture` what the plan has here does not matter."""
        return self._cutting and self._clear_from_m is None

    @property
    def over_cut_m(self) -> float:
        """How far before the blade ground begins on this side that it has not cut yet; 0 or less
        but for a machine that has backed."""
        return self._cut_to_m - self._way_m

    @property
    def over_mown_m(self) -> float:
        """The same of ground over which its blade has not turned yet, whatever stood there."""
        return self._mown_to_m - self._way_m

    @property
    def cut_m(self) -> float:
        """How far past this side's beginning pictures have shown crop at the blade."""
        return max(0.0, self._cut_to_m - self._begun_m)

    @property
    def driven_m(self) -> float:
        """How far the machine has come since the side was begun, at most."""
        return self._way_m - self._begun_m

    @property
    def unseen(self) -> bool:
        """Whether the look showed nothing at all."""
        return self.refused and self._look.clear + self._look.crop == 0

    @property
    def beside(self) -> bool:
        """Whether what was refused is crop at the blade whose edge lies elsewhere: the machine may
        have come off its own."""
        look = self._look
        return self.refused and look.aside > IN_LINE_SHARE * (look.clear + look.crop)

    def begin(self, slack_m: float = 0.0) -> None:
        """A side, on which clear ground may be longer by `slack_m`: at a last tip that is too
        narrow to be seen, or where earlier rounds have cut what lies before the boundary."""
        self._slack_m = slack_m
        self._begun_m = self._way_m
        self._cutting = False
        self._cut_to_m = self._mown_to_m = -math.inf
        self._clear_from_m = self._held_since = None
        self._at_blade = 0
        self._crossing = False
        self.refused = False

    def allow(self, slack_m: float) -> None:
        """Clear ground may be so much longer than a patch, from now on."""
        self._slack_m = slack_m

    def go_back(self) -> None:
        """The machine is to go back over clear ground that it has come over. From there on the same
        clear ground is as long as it was, and no longer."""
        self._held_since = None
        self._crossing = self.refused = False

    def go_on(self) -> None:
        """Crop right before the blade has turned out to be the side's own: what was refused was a
        patch."""
        self._held_since = self._clear_from_m = None
        self._crossing = self.refused = False

    def take_telemetry(self, telemetry: Telemetry) -> None:
        """Moves on."""
        dt = telemetry.stamp - self._stamp
        if dt <= 0:
            return
        self._stamp = telemetry.stamp
        if not math.isfinite(dt):
            return
        self._way_m += self._speed(telemetry) * dt
        if telemetry.blade:
            self.blade_stamp = telemetry.stamp
            self._mown_to_m = max(self._mown_to_m, self._way_m)
        self._past.append((telemetry.stamp, self._way_m))
        while self._past[0][0] < telemetry.stamp - HISTORY_S:
            self._past.popleft()

    def _speed(self, telemetry: Telemetry) -> float:
        """The most that it may be going, signed."""
        duty = self._vehicle.duty_speed(telemetry.drive_duty, telemetry.battery_v)
        counted = telemetry.speed_mps
        low, high = (share * abs(duty) for share in DUTY_SHARES)
        if counted is None:
            return math.copysign(abs(duty) + UNCOUNTED_MPS, duty) if duty != 0.0 else 0.0
        most = max(abs(counted), min(high, max(low, DOUBTED * abs(counted))))
        return math.copysign(most, duty if duty != 0.0 else counted)

    def take_picture(
        self,
        stamp: float,
        view: CropView,
        *,
        own: bool = False,
        swath: bool = False,
        dusty: bool = False,
    ) -> None:
        """One along the side, taken at `stamp`. `own`: the plan has crop here beyond doubt. Then
        crop after long clear ground is the field's own where its edge goes on in line; a
        neighbour's lies across. `swath`: the blade is right beside what the machine has cut; then
        it is in any case. `dusty`: crop at the blade may be its dust, and ends no clear ground
        before it was looked at."""
        if view.ahead_confidence < CONFIDENT or not view.usable:
            return
        then_m = next((way for at, way in reversed(self._past) if at <= stamp), self._way_m)
        looks = self._held_since is not None and stamp > self._held_since + SETTLE_S
        along = view.confidence >= CONFIDENT and abs(view.edge_offset_m) < SHOWN_M
        if along:
            self._line_at_m = then_m
        if along or view.edge_beside_m < ALONGSIDE_M:
            self._edge_at_m = then_m
        at_blade = view.crop_ahead_m < AT_BLADE_M
        self._count(then_m, at_blade)
        near_line = abs(view.edge_offset_m) < IN_LINE_M
        in_line = view.confidence >= CONFIDENT and near_line
        if looks:
            near, shown = view.crop_ahead_m < STANDS_M, view.confidence >= IN_LINE_SURE
            stands = at_blade or (near and in_line)
            self._look.clear += not stands
            self._look.crop += stands
            there = abs(view.edge_offset_m) < THERE_M
            self._look.in_line += stands and ((shown and near_line) or there)
            self._look.aside += near and shown and not near_line
        if at_blade:
            patch = self._clear_from_m is None or then_m - self._clear_from_m < self._allowed_m
            goes_on = swath or (own and in_line)
            surely = goes_on or self._at_blade >= AT_BLADE_PICTURES
            meets = surely if not self._cutting else self._clear_from_m is None
            due = self._short and then_m > self._clear_to_m - STANDS_M
            ends_it = meets or (surely and (due or not dusty))
            if (patch or goes_on) and ends_it and self._held_since is None:
                self._cutting, self._clear_from_m, self._crossing = True, None, False
                self._cut_to_m = max(self._cut_to_m, then_m)
        elif view.crop_ahead_m > CLEAR_M and self._cutting and self._at_blade == 0:
            if self._clear_from_m is None:
                self._clear_from_m = max(then_m, self._cut_to_m)
                self._clear_to_m = -math.inf
            self._clear_to_m = max(self._clear_to_m, then_m + view.crop_ahead_m)

    def _count(self, then_m: float, at_blade: bool) -> None:
        """How many pictures show crop at the blade. From one place they err now and then, and the
        latest of them together say what stands there."""
        stands = abs(then_m - self._pictured_m) < STANDS_STILL_M
        self._pictured_m = then_m
        fewer = max(0, self._at_blade - 1) if stands else 0
        self._at_blade = min(self._at_blade + 1, AT_BLADE_PICTURES) if at_blade else fewer

    def _shown(self, beside: bool) -> bool:
        """Whether a picture has shown an edge beside the machine of late. Where the gap lies beside
        the side, too, only one that goes on in line."""
        at_m = self._line_at_m if beside else self._edge_at_m
        return self._way_m - at_m < SHOWN_FOR_M

    @property
    def _short(self) -> bool:
        """Whether every picture of the clear ground has shown crop behind less of it than a gap's:
        what is left of the way to crop that was not there yet, or a patch."""
        from_m = self._clear_from_m
        return from_m is not None and self._clear_to_m - from_m < END_CLEAR_M

    @property
    def _allowed_m(self) -> float:
        return PATCH_M + self._slack_m

    def limit(
        self,
        now: float,
        command: Command,
        *,
        own: bool = False,
        swath: bool = False,
        ends: bool = False,
        beside: bool = False,
    ) -> Command:
        """The command as it may be carried out. Where the plan has crop beyond doubt (`own`), long
        clear ground is crossed with the blade off, after the same look, along an edge in sight;
        right beside what the machine has cut (`swath`) without one.
        Where the side may end (`ends`), clear ground as long as an end's may be the gap, and crop
        beyond it leads on only where its edge is in line. So it does where the gap lies `beside`
        the side, whatever the plan has along it: the machine may have left it sideways."""
        forward = command.request is Request.DRIVE and command.speed_mps > 0.0
        crosses = swath or (own and self._shown(beside))
        if self.passes:
            return command
        if self._held_since is None:
            if self._crossing and crosses:
                return replace(command, blade=False)
            if not forward:
                return command
            self._held_since, self._look = now, _Look()
        if not forward:
            return command
        if now - self._held_since > LOOK_S:
            look = self._look
            near = not swath and (beside or (ends and not own))
            gap = near and self.clear_m >= END_CLEAR_M and not self._short
            in_line = look.in_line > max(look.aside, IN_LINE_SHARE * look.crop)
            if look.crop > look.clear and (in_line or not gap):
                self._held_since = self._clear_from_m = None
                return command
            if crosses:
                self._held_since, self._crossing = None, True
                return replace(command, blade=False)
            self.refused = True
        return replace(command, speed_mps=0.0, blade=False)
