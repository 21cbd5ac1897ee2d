"""Everything that the pilot knows of its own motion and place, fed by telemetry and fixes.

Dead reckoning, the lane beside the crop's edge, the position in the field, the way driven one round
earlier, and whether the receiver agrees with all that.
"""

from __future__ import annotations

import math

from host.core.messages import Fix, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.course_check import DirectionCheck
from host.estimate.cut_guard import CutGuard
from host.estimate.kalman import Innovation
from host.estimate.lane import Lane
from host.estimate.last_round import Trails
from host.estimate.measurements.rest import rest
from host.estimate.measurements.speed import speed
from host.estimate.moved_place import MovedPlace
from host.estimate.odometry import Motion, Odometry
from host.estimate.picture_motion import PictureMotion
from host.estimate.position import Position
from host.estimate.speed_watch import SpeedWatch
from host.estimate.steady_speed import SteadySpeed
from host.estimate.swaths import Swaths
from host.estimate.wheel_sensor import WheelSensor
from host.route.plan import Plan

DOPPLER_GAP_S = 2.0
"""A fix's speed speaks of the time since the one before, but of no more than this."""


class Estimator:
    """`position` is the filter, `lane` what of it steers."""

    def __init__(self, vehicle: Vehicle, plan: Plan) -> None:
        self.odometry = Odometry(vehicle)
        self.wheel = WheelSensor(vehicle)
        self.position = Position(vehicle, plan.boundary, plan.sigma_m, plan.recorded)
        self.lane = Lane(self.position, vehicle.blade_x_m)
        self.trails = Trails(vehicle)
        self.swaths = Swaths()
        self.direction = DirectionCheck()
        self.cut = CutGuard(vehicle)
        self.speed = SpeedWatch(vehicle)
        self.steady = SteadySpeed()
        self.pictures = PictureMotion(vehicle)
        self.moved = MovedPlace()
        self.backwards = False
        """Whether the latest fix shows the machine moving against its heading."""
        self.askew_rad = 0.0
        """How far the receiver's courses lie left of the heading, by the latest fix; 0: no more
        than they err."""
        self._fix_stamp = float("-inf")

    @property
    def motion(self) -> Motion:
        """Dead reckoning since the start."""
        return self.odometry.now

    def take_innovations(self) -> list[Innovation]:
        """What the filter made of their measurements since the last call, in no order."""
        out = list(self.position.innovations)
        self.position.innovations.clear()
        return out

    def take_turned(self, turned: Turned) -> None:
        """The phone's gyroscope, before the telemetry of the same step."""
        self.odometry.take_turned(turned)
        for stand in self.odometry.gyroscope.take_rests():
            self.position.take(rest(self.position.x, *stand))
            self._learn()

    def at_the_middle(self, telemetry: Telemetry) -> Telemetry:
        """New telemetry, as all else here wants it: speed and way are the rear axle's middle's."""
        curvature_1pm = self.odometry.curvature_1pm(telemetry.angle_rad)
        return self.wheel.at_the_middle(telemetry, curvature_1pm)

    def take_telemetry(self, telemetry: Telemetry) -> None:
        """Moves on."""
        motion = self.odometry.update(telemetry)
        self.position.predict(motion, cutting=telemetry.blade)
        place = self.position.pose if self.position.known else None
        self.moved.take(place, motion, self.position.placed)
        self._learn()
        self.direction.move(motion)
        self.cut.take_telemetry(telemetry)
        self.speed.take_telemetry(telemetry)
        self.steady.take(telemetry)

    def take_fix(self, fix: Fix, telemetry: Telemetry, *, underway: bool) -> None:
        """The receiver's speed, and `underway` along a side or a turn its course."""
        if underway and self.position.known:
            expected = self.position.course_rad
            self.backwards = self.direction.contradicted(fix, self.motion, expected)
            self.askew_rad = self.direction.askew_rad
            may_be = self.direction.may_have_turned
            if may_be and self.position.may_be_turned(self.askew_rad):
                self.direction.forget()
                self.askew_rad = 0.0
            if self.direction.off_rad is not None:
                self.position.course(self.direction.off_rad, self.motion.speed_mps)
        self.speed.take_fix(fix, telemetry)
        if underway and self.position.known:
            self._take_speed(fix, telemetry)
        self.odometry.learn(fix, telemetry, min(DOPPLER_GAP_S, fix.stamp - self._fix_stamp))
        self._fix_stamp = fix.stamp

    def _take_speed(self, fix: Fix, telemetry: Telemetry) -> None:
        """Against the wheels' own, where both speak of one speed straight on."""
        wheels_mps = self.steady.mps
        if wheels_mps is None or fix.speed_mps is None or fix.course_rad is None:
            return
        position = self.position
        # A speed is never negative, and so errs to one side; what it is ahead does not.
        ahead_mps = fix.speed_mps * math.cos(fix.course_rad - position.course_rad)
        position.take(speed(position.x, wheels_mps, ahead_mps, cutting=telemetry.blade))

    def learn_curve(self) -> None:
        """And what of the curvature that the pot does not show."""
        self.odometry.turn_trim(self.position.take_curve())

    def _learn(self) -> None:
        """What the filter has found of the gyroscope is taken off from here on."""
        gyroscope = self.odometry.gyroscope
        off, gyroscope.offset_sigma, too_much = self.position.take_gyro()
        gyroscope.offset += off
        gyroscope.rescale(1.0 - too_much)
