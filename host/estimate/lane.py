"""The lane: a straight line that the rear axle's middle should follow, beside the crop's edge, and
with it where the edge wanders. What of the filter (`host.estimate.position`) steers.

A missed picture, a turn and a mount that cannot see the heading (the paper's low camera) are all
the same case: prediction with fewer corrections.
"""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Array
from host.estimate.measurements import edge
from host.estimate.position import Position
from host.estimate.states import CRAB, SIGHT, WANDER


class Lane:
    """The vehicle's place against the present lane of `position`. `blade_x_m` is where vision
    measures the edge."""

    def __init__(self, position: Position, blade_x_m: float) -> None:
        self._position = position
        self._blade_x = blade_x_m
        self.contradicted = False
        """Whether the last measurement was refused."""
        self.aim_m = 0.0
        """How far left of the lane the machine is to be driven until its edge is found,"""
        self.clear_m = 0.0
        """and besides, to keep clear of what stands beside it."""
        self.holds = False
        """Whether an edge that contradicts it is not believed however long it stays."""
        self._until_seen = False
        self._round_rad = 0.0
        """By how much the lane has bent to the left where its piece begins."""

    @property
    def rounding_rad(self) -> float:
        """How much of the last bend the machine has still to turn through, where its blade goes on
        along the lane: the rear axle is drawn after it on a tractrix."""
        past_m = max(0.0, self._position.on_lane().blade_m)
        left = math.tan(self._round_rad / 2) * math.exp(-past_m / self._blade_x)
        return 2.0 * math.atan(left)

    def bends(self, left_rad: float) -> None:
        """The blade comes to where the lane bends by so much to the left. Before the position's
        lane is that beyond."""
        self._round_rad = self.rounding_rad + left_rad

    @property
    def heading_rad(self) -> float:
        """Where the machine goes, driving forward, against the lane's direction: a machine that
        drifts aside heads elsewhere."""
        return self._turned_rad + self._position.x.item(CRAB)

    @property
    def offset_m(self) -> float:
        """Rear axle left of where it should be for the blade to be on the lane, at `heading_rad`:
        without drift it is left of the lane by that."""
        return self.blade_offset_m - self._blade_x * math.sin(self.heading_rad)

    @property
    def backwards(self) -> tuple[float, float]:
        """The same two, m and rad, driving backward: the rear axle leads, and drifts the same
        way."""
        offset = self.blade_offset_m - self._blade_x * math.sin(self._turned_rad)
        return offset, self._turned_rad - float(self._position.x[CRAB])

    @property
    def blade_offset_m(self) -> float:
        """The blade's middle left of the lane, positive: minus the edge offset that vision sees.
        An edge that is seen from beside it is not followed where it seems to wander."""
        position = self._position
        place = position.on_lane()
        wander = 0.0 if position.beside else place.x.item(WANDER)
        return place.off_lane_m(self._blade_x, wander)

    def left_end(self, half_m: float) -> tuple[float, float]:
        """How far the blade's left end, half_m from its middle, is past the beginning of the lane's
        side, and how far left of where it is on the lane, m."""
        place, turned = self._position.on_lane(), self._turned_rad
        off_m = place.off_lane_m(self._blade_x)
        return (
            place.blade_m - half_m * math.sin(turned),
            off_m - half_m * (1.0 - math.cos(turned)),
        )

    @property
    def off_m(self) -> float:
        """The same, left of where the machine is to be driven."""
        return self.blade_offset_m - self.aim_m - self.clear_m

    @property
    def driven_off_m(self) -> float:
        """Rear axle left of where it is to be driven, at `heading_rad`."""
        return self.offset_m - self.aim_m - self.clear_m

    @property
    def offset_sigma_m(self) -> float:
        """Standard deviation of the offset at the blade's line: the filter's, and what pictures
        one after the other err alike, which no number of them takes away."""
        return math.hypot(self._position.sigma(self._of_blade()), edge.LASTING_SIGMA_M)

    @property
    def true_offset_sigma_m(self) -> float:
        """The same against the crop's true edge: with what every picture of the machine errs."""
        alike = np.zeros(len(self._position.x))
        alike[SIGHT] = 1.0
        return math.hypot(self.offset_sigma_m, self._position.sigma(alike))

    @property
    def _turned_rad(self) -> float:
        place = self._position.on_lane()
        return math.remainder(place.turned_rad - place.lane_rad(place.blade_m), math.tau)

    def _of_blade(self) -> Array:
        """(states,) the derivative of `blade_offset_m`."""
        place = self._position.on_lane()
        h = place.ahead(self._blade_x, place.blade_m)
        h[WANDER] = 0.0 if self._position.beside else -1.0
        return h

    def place(
        self, offset_m: float, heading_rad: float, offset_sd: float, heading_sd: float
    ) -> None:
        """Starts over, beside a lane of no plan, from a pose that is known by other means."""
        self.contradicted, self.aim_m, self._round_rad = False, 0.0, 0.0
        self._position.open(offset_m, heading_rad, offset_sd, heading_sd)

    def begin(self, aim_m: float = 0.0, *, until_seen: bool = False) -> None:
        """Another lane is the position's from now on. `until_seen`: once a picture has shown its
        edge, the machine is driven along it."""
        self.contradicted, self.aim_m, self._until_seen = False, aim_m, until_seen
        self._round_rad = 0.0

    def lies_right(self, edge_offset_most_m: float, since: tuple[float, float]) -> bool:
        """Crop was seen to go on beside the blade: the edge lies no further left than this, m. A
        lane that has it there moves aside, and does not turn: how the edge runs is seen once the
        machine is beside it. Returns whether it did. `since` as in `correct`."""
        place = self._position.on_lane()
        seen = edge.edge(place, edge_offset_most_m, math.nan, 1.0, since, 0.0)
        if seen.innovation[0] <= 0.0:
            return False
        self._position.lies_right(seen)
        return True

    def correct(
        self,
        edge_offset_m: float,
        edge_heading_rad: float,
        confidence: float,
        since: tuple[float, float],
        *,
        ahead_m: float = 0.0,
        learn: bool = True,
        cutting: bool = True,
        stays: bool = True,
    ) -> bool:
        """Takes vision's measurement of the edge (NaN heading: not seen), made ahead_m before the
        blade's line.

        `since` is (distance travelled, yaw turned) from the shutter to now. With `learn` the
        curvature that the pot does not show is estimated too; not after a turn, whose errors it
        would take upon itself. `cutting`: the blade's dust is in the air. Returns False where the
        measurement contradicts the prediction beyond the gate; it is then not used, but makes the
        lane doubtful where such an edge `stays`: the machine drives along it, or looks at it.
        """
        place = self._position.on_lane()
        seen = edge.edge(place, edge_offset_m, edge_heading_rad, confidence, since, ahead_m)
        self.contradicted = not self._position.see_edge(
            seen, learn=learn, cutting=cutting, doubts=stays and not self.holds
        )
        if self._until_seen and not self.contradicted:
            self.aim_m = 0.0
        return not self.contradicted
