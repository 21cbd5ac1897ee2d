"""The lockstep bench: firmware, machine, field and sensors under one clock.

The bench alone advances time; the loop over slices is hil/bench/slices.py, the one over
milliseconds hil/firmware/coupling.py.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable
from functools import cached_property
from typing import Any

from hil.bench.injector import Injector
from hil.bench.slices import MOST_SLICES, SLICE_US, Slices
from hil.firmware import provision, wiring
from hil.firmware.real_board import Board, Controller
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from sim_plant import machine
from sim_plant.camera import Camera, CameraSpec, Shot
from sim_plant.field import Field
from sim_plant.gnss import Gnss
from sim_plant.gyro import Gyro, Sample


class Bench(contextlib.AbstractContextManager["Bench"]):
    """One machine on one field with its firmware; time in seconds from 0."""

    def __init__(
        self, scenario: Scenario, *, camera_threads: int = 1, board: Board | None = None
    ) -> None:
        """`board`: a real one, instead of the firmware that the scenario names."""
        self.scenario = scenario
        self.world = world = scenario.world
        self._told = scenario.told
        spec = world.machine
        seed = world.seed
        self.field = Field(world.field, seed)
        self._camera_threads = camera_threads
        self.gnss = Gnss(world.gnss, seed)
        self.gyro = Gyro(world.gyro, seed, math.radians(world.lens.pitch_deg))
        self._samples: deque[Sample] = deque()
        self.cut_cells = 0
        """Crop cells cut during the last `advance`."""
        self._spec = spec
        self._state = machine.initial(spec, *scenario.start_pose())
        # Views: to ask a record for a field takes as long as all that is done with it.
        self._place = tuple(self._state[name] for name in ("x", "y", "yaw"))
        self._speed = self._state["v"]
        steer_hz, drive_hz = provision.pwm_hz(self._told.parameters)
        self._params = machine.parameters(spec, seed, steer_pwm_hz=steer_hz, drive_pwm_hz=drive_hz)
        self._given = machine.inputs()
        self._done = 0
        """Slices."""
        self._sent = bytearray()
        self.on_slice: Callable[[bytes], None] | None = None
        """Called after every slice with what the firmware sent, before the cable had its way: for
        whoever watches more closely than the host steps."""
        self.faults = Injector(scenario.faults, seed)
        self.target: Controller = board or provision.target(
            scenario.firmware, self._told.parameters
        )
        self._slices = Slices(
            self.field,
            self.gyro,
            (self._state, self._params, self._given),
            (spec.blade_x_m, spec.blade_width_m),
            self.target,
            self.faults.taps,
            wiring.layout(world.wiring, provision.BOARD[scenario.firmware]),
        )

    @cached_property
    def camera(self) -> Camera:
        """Made when it is first asked for: a run that takes no pictures needs none."""
        return self.new_camera(self.world.lens)

    def new_camera(self, lens: CameraSpec) -> Camera:
        """Another one on this machine."""
        world, spec = self.world, self._spec
        return Camera(
            self.field,
            lens,
            world.weather,
            world.seed,
            threads=self._camera_threads,
            blade_x_m=spec.blade_x_m,
            blade_width_m=spec.blade_width_m,
        )

    @property
    def now(self) -> float:
        """Seconds since the start: whole nanoseconds, as a record keeps them."""
        return self._done * SLICE_US / 1e6

    @property
    def state(self) -> Any:
        """The machine's true state: a record of sim_plant.machine.STATE."""
        return self._state[0]

    @property
    def params(self) -> Any:
        """What the machine is made of: a record of sim_plant.machine.PARAMS."""
        return self._params[0]

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, truly."""
        x, y, yaw = self._place
        return x.item(), y.item(), yaw.item()

    @property
    def drives(self) -> tuple[float, float, bool]:
        """What the motors get at last: (steering duty, drive duty, blade), duties -1..1."""
        given = self._given[0]
        return float(given["steer_duty"]), float(given["drive_duty"]), bool(given["blade_on"])

    def send(self, data: bytes) -> None:
        """Puts bytes on the serial line to the firmware."""
        self._sent += data

    def advance(self, until_s: float) -> list[tuple[float, bytes]]:
        """Runs to `until_s`; returns what the firmware sent, with the time of arrival."""
        received: list[tuple[float, bytes]] = []
        target, faults, slices = self.target, self.faults, self._slices
        self.cut_cells = 0
        last = round(until_s * 1e6) // SLICE_US
        while self._done < last:
            watched = bool(faults.faults) or self.on_slice is not None
            count = 1 if watched else min(last - self._done, MOST_SLICES)
            sent = bytes(self._sent)
            self._sent.clear()
            if faults.faults:
                faults.step(self.now, self.pose, self._speed.item(), target, self._given)
                sent = faults.to_firmware(self.now, sent)
            if sent:
                target.write(sent)
            status, said = slices.run(self._done, count)
            for data in said:
                self._done += 1
                heard = faults.to_host(self.now, data) if faults.faults else data
                if heard:
                    received.append((self.now, heard))
            self.cut_cells += slices.cells
            self._samples += slices.samples
            if status != 0:
                raise UserError(
                    f"the {self.scenario.firmware} firmware crashed at {self.now:.2f} s "
                    f"(status {status}); the record up to then is kept"
                )
            if self.on_slice is not None:
                self.on_slice(said[0])
        return received

    def shutter(self) -> Shot:
        """Freezes what the camera sees now; `camera.develop` makes the picture, in any thread."""
        s = self.state
        x, y, yaw = self.pose
        roll, pitch = self.field.bumps(x, y, yaw)
        return self.camera.shutter(
            self.now,
            x,
            y,
            yaw,
            roll,
            pitch,
            float(s["v"]),
            float(s["yaw_rate"]),
            bool(s["blade_spinning"]),
        )

    def felt(self) -> list[Sample]:
        """What the phone's app has of its gyroscope since the last call."""
        due: list[Sample] = []
        last = self.gyro.clock_s(self.now - self.gyro.spec.delay_s)
        while self._samples and self._samples[0].clock_s <= last + 1e-6:
            due.append(self._samples.popleft())
        return self.faults.gyro(self.now, due)

    def fix(self) -> list[str]:
        """NMEA sentences that the phone sends now, at its epoch."""
        s = self.state
        x, y, yaw = self.pose
        course = yaw + float(s["slip_rear"])
        v = float(s["v"])
        gnss, c, s_ = self.world.gnss, math.cos(yaw), math.sin(yaw)
        ahead, left = gnss.antenna_x_m, gnss.antenna_y_m
        ax, ay = x + ahead * c - left * s_, y + ahead * s_ + left * c
        rate = float(s["yaw_rate"])
        vx = v * math.cos(course) - rate * (ay - y)
        vy = v * math.sin(course) + rate * (ax - x)
        antenna = self.faults.antenna(self.now, ax, ay, vx, vy)
        shaded = self.field.under_trees(x, y)
        return self.faults.nmea(self.now, self.gnss.epoch(self.now, *antenna, under_trees=shaded))

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the target."""
        self.target.close()
