"""Machines built wrongly, and whether the check names what is wrong before the blade is armed.

The bench is the lockstep one; the operator answers what a person beside the machine would see, from
the world alone. Every mistake lies in the world, or in what the owner entered.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from hil.bench.bystander import sees
from hil.bench.lockstep import Bench
from hil.bench.rig import handouts
from hil.bench.slices import SLICE_US
from hil.firmware.signal_wires import Mode, Signal
from hil.firmware.wiring import ESTOP_OPEN_MV
from hil.scenario import scenario
from hil.studies.own_machine import own_machine
from host.check.lines import Line, Question, Target, Values, green
from host.check.walk import walk
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Command, Fix, Telemetry, Turned
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle, mount_of
from host.field.boundary_file import load_field
from host.link import protocol
from host.link.session import Answer, Session
from host.sensors.camera_stream import Picture
from host.sensors.gyro import Turning
from host.sensors.nmea import Receiver
from host.vision.mounted.detector import Mode as Eyes
from sim_plant.gyro import sensors_json

SLICE_S: Final = SLICE_US * 1e-6
FIELD: Final[Mapping[str, Any]] = {
    "field": {"size_m": [20.0, 20.0], "gap_m": 4.0},
    "start": {"before_m": 1.0},
}
"""A field in which a wrong corner is farther away than a phone's position errs."""
FREE_BYTES: Final = 50 * 10**9
"""Of a laptop's disk with room."""
ANSWER_S: Final = 3.0
"""How long a person takes."""


@dataclass(frozen=True)
class Mistake:
    """One way to build, enter or mount something wrongly. `finding`: what the check must say."""

    name: str
    findings: tuple[str, ...]
    world: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of the scenario."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """What the firmware holds instead."""
    taps: Mapping[Signal, tuple[Mode, float]] = field(default_factory=dict)
    """Wires that carry something else."""
    vehicle: Mapping[str, Any] = field(default_factory=dict)
    """What the vehicle file says instead."""
    picture: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]] | None = None
    delay_s: float = 0.0
    nmea: Callable[[str], str] | None = None
    gap: bool = True
    corner: int | None = None
    """So many corners farther on than where it stands."""
    shifted_m: float = 0.0
    free_bytes: int = FREE_BYTES
    slower: float = 1.0
    power: tuple[int, bool] | None = None
    estop_works: bool = True
    relay_inverted: bool = False
    relay_dead: bool = False
    protocol_version: int = protocol.VERSION


def _without_course(line: str) -> str:
    """A receiver that sends positions only."""
    return "" if "RMC" in line else line


def _silent(_line: str) -> str:
    return ""


def _dark(bgr: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return bgr // 40


def _mirrored(bgr: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.ascontiguousarray(bgr[:, ::-1])


def _upright(bgr: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return np.ascontiguousarray(np.rot90(bgr))


def _steering(**values: float) -> dict[str, Any]:
    return {"machine": {"steering": values}}


MISTAKES: Final = (
    Mistake(
        "drive motors swapped", ("drive.reversed",), taps={Signal.DRIVE_DUTY: (Mode.SCALED, -1.0)}
    ),
    Mistake(
        "drive motor not connected",
        ("hall.dead", "drive.dead", "drive.fault"),
        taps={Signal.DRIVE_DUTY: (Mode.FIXED, 0.0)},
    ),
    Mistake(
        "steering motor swapped",
        ("steering.reversed",),
        taps={Signal.STEER_DUTY: (Mode.SCALED, -1.0)},
    ),
    Mistake(
        "steering motor not connected",
        ("steering.frozen",),
        taps={Signal.STEER_DUTY: (Mode.FIXED, 0.0)},
    ),
    Mistake(
        "wrong bridge style",
        ("steering.reversed", "steering.frozen"),
        {"wiring": {"steering": "vnh5019"}},
    ),
    Mistake("bridge style never set", ("bridge.unset",), parameters={"drive_driver": 0.0}),
    Mistake("pot reversed", ("steering.reversed",), _steering(pot_counts_per_deg=-4.5)),
    Mistake(
        "pot and motor reversed",
        ("steering.mirrored",),
        _steering(pot_counts_per_deg=-4.5),
        taps={Signal.STEER_DUTY: (Mode.SCALED, -1.0)},
    ),
    Mistake(
        "pot's ends not set",
        ("pot.unset",),
        parameters={"pot_left": 512.0, "pot_centre": 512.0, "pot_right": 512.0},
    ),
    Mistake(
        "pot's ends of another pot",
        ("stops.scale", "stops.blocked"),
        _steering(pot_counts_per_deg=3.0),
    ),
    Mistake(
        "pot's centre off by 12 degrees",
        ("stops.centre", "stops.scale", "stops.blocked"),
        _steering(pot_centre_counts=566.0),
    ),
    Mistake("pot's wire open", ("faults.there",), taps={Signal.POT: (Mode.FIXED, 5000.0)}),
    Mistake("e-stop bridged", ("estop.bridged",), estop_works=False),
    Mistake(
        "e-stop's wire broken", ("faults.estop",), taps={Signal.ESTOP: (Mode.FIXED, ESTOP_OPEN_MV)}
    ),
    Mistake(
        "e-stop's wire on the chassis", ("faults.there",), taps={Signal.ESTOP: (Mode.FIXED, 0.0)}
    ),
    Mistake("hall sensor dead", ("hall.dead",), taps={Signal.HALL: (Mode.FIXED, 0.0)}),
    Mistake(
        "hall's scale half", ("hall.scale",), {"machine": {"drive": {"hall_pulses_per_m": 25.0}}}
    ),
    Mistake(
        "another machine's parameters", ("parameters.differ",), parameters={"hall_per_metre": 80.0}
    ),
    Mistake("parameters erased", ("parameters.differ",), parameters={"hall_per_metre": 0.0}),
    Mistake(
        "camera turned by 90 degrees",
        ("picture.turned", "picture.no_edge"),
        {"lens": {"roll_deg": 90.0}},
    ),
    Mistake("camera upright", ("camera.upright",), picture=_upright),
    Mistake("camera upside down", ("picture.upside_down",), {"lens": {"roll_deg": 176.0}}),
    Mistake("camera mirrored", ("picture.mirrored", "picture.no_edge"), picture=_mirrored),
    Mistake("camera 5 degrees too low", ("mount.tilted",), {"lens": {"pitch_deg": 33.0}}),
    Mistake("camera 5 degrees to the left", ("mount.tilted",), {"lens": {"yaw_deg": 5.0}}),
    Mistake("camera 5 degrees to the right", ("mount.tilted",), {"lens": {"yaw_deg": -5.0}}),
    Mistake("camera 8 degrees to the left", ("mount.tilted",), {"lens": {"yaw_deg": 8.0}}),
    Mistake("camera 0.5 s late", ("delay.other",), delay_s=0.5),
    Mistake("camera covered", ("picture.bad",), picture=_dark),
    Mistake(
        "battery low", ("battery.low",), {"machine": {"battery": {"full_v": 11.2, "empty_v": 10.4}}}
    ),
    Mistake(
        "battery weak under load",
        ("load.sags", "drive.fault"),
        {"machine": {"battery": {"r_ohm": 0.35, "full_v": 12.2, "empty_v": 11.6}}},
    ),
    Mistake("wrong firmware", ("firmware.other",), protocol_version=protocol.VERSION + 1),
    Mistake("blade relay inverted", ("blade.inverted",), relay_inverted=True),
    Mistake("blade relay dead", ("blade.dead",), relay_dead=True),
    Mistake("receiver without course", ("course.none",), nmea=_without_course),
    Mistake("receiver silent", ("receiver.none",), nmea=_silent),
    Mistake("wrong field", ("place.other_field",), shifted_m=300.0),
    Mistake("wrong corner", ("place.corner",), corner=2),
    Mistake("gap missing", ("field.no_gap",), gap=False),
    Mistake("disk full", ("disk.full",), free_bytes=10**9),
    Mistake("laptop slow", ("laptop.slow",), slower=100.0),
    Mistake("laptop's battery empty", ("power.low",), power=(12, False)),
)


class LockstepHands:
    """The check's hands on a simulated machine, its operator's eyes on the world."""

    def __init__(
        self, bench: Bench, vehicle: Vehicle, mount: str, eyes: Eyes, mistake: Mistake
    ) -> None:
        self.bench = bench
        self.vehicle = vehicle
        self.mount = mount_of(vehicle, mount)
        self.mode: Eyes = eyes
        self.session = Session()
        self.shown: list[Line] = []
        self.armed_blade = False
        """Whether the blade's output was ever on before the supply was said to be off."""
        self.blade_clicked = False
        self._mistake = mistake
        self._receiver = Receiver()
        self._turning = Turning()
        self._heard: Turned | None = None
        self._problem = ""
        self._shots: list[tuple[float, float, Any]] = []
        self._fixes: list[Fix] = []
        self._supply_off = False
        self._straight = 0.0
        self._odometer = 0.0
        fps = bench.camera.spec.fps
        self._every = max(1, round(1 / fps / SLICE_S))
        self._slices = 0
        self._turned = 0.0
        for signal, (mode, value) in self._mistake.taps.items():
            bench.faults.taps[int(signal)]["mode"] = int(mode)
            bench.faults.taps[int(signal)]["value"] = value

    # ---- time ------------------------------------------------------------------------------------

    def clock(self) -> float:
        """Simulated seconds."""
        return self.bench.now

    def pump(self, seconds: float) -> list[Telemetry]:
        """Advances the world."""
        arrived: list[Telemetry] = []
        end = self.bench.now + max(seconds, SLICE_S)
        while self.bench.now < end - 1e-9:
            arrived += self._slice()
        return arrived

    def _slice(self) -> list[Telemetry]:
        bench = self.bench
        self._slices += 1
        arrived: list[Telemetry] = []
        if self.session.version is None:
            bench.send(self.session.hello(bench.now))
        for at, data in bench.advance(bench.now + SLICE_S):
            try:
                arrived += self.session.feed(at, data)
            except UserError as error:
                self._problem = str(error)
        version = self.session.version
        if version is not None and self._mistake.protocol_version != protocol.VERSION:
            self._problem = "the firmware speaks another protocol version"
            self.session.version = None
        if bench.drives[2] and not self._mistake.relay_dead:
            self.blade_clicked = True
            self.armed_blade |= not self._supply_off
        if self._slices % self._every == 0:
            delay = bench.world.lens.delay_s + self._mistake.delay_s
            self._shots.append((bench.now, bench.now + delay, bench.shutter()))
            del self._shots[:-20]
        if self._slices % round(1 / SLICE_S) == 0:
            change = self._mistake.nmea or str
            for line in bench.fix():
                said = change(line)
                if said:
                    self._fixes += self._receiver.feed(bench.now, (said.strip() + "\r\n").encode())
        self._fixes += self._receiver.feed(bench.now, b"")
        felt = bench.felt()
        if felt:
            self._heard = self._turning.feed(bench.now, sensors_json(felt)) or self._heard
        return arrived

    # ---- devices ---------------------------------------------------------------------------------

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's latest word."""
        return self.session.telemetry

    @property
    def version(self) -> protocol.Version | None:
        """Who it says it is."""
        return self.session.version

    @property
    def board_problem(self) -> str:
        """Why it does not answer."""
        return self._problem

    def send(self, command: Command) -> None:
        """To the board."""
        self.bench.send(self.session.encode(self.bench.now, command))

    def ask_board(self, message: protocol.Message) -> Answer:
        """A request and its answer."""
        self.session.answers.clear()
        self.bench.send(self.session.request(message))
        for _ in range(100):
            self._slice()
            if self.session.answers:
                return self.session.answers[0]
        raise UserError("no answer")

    def picture(self) -> Picture | None:
        """The newest that has come by now."""
        due = [shot for shot in self._shots if shot[1] <= self.bench.now]
        if not due:
            return None
        self._shots = [shot for shot in self._shots if shot[1] > self.bench.now]
        _, arrives, shot = due[-1]
        bgr = np.asarray(self.bench.camera.develop(shot), np.uint8)
        if self._mistake.picture is not None:
            bgr = self._mistake.picture(bgr)
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        return Picture(arrives, jpeg)

    @property
    def camera_problem(self) -> str:
        """None: the world's camera works."""
        return ""

    def fix(self) -> Fix | None:
        """The newest, once."""
        return self._fixes.pop(0) if self._fixes else None

    @property
    def gnss_problem(self) -> str:
        """Why nothing comes."""
        return "silent for 3 s" if self._mistake.nmea is _silent else ""

    def turned(self) -> Turned | None:
        """The gyroscope's newest, once."""
        turned, self._heard = self._heard, None
        return turned

    @property
    def gyro_problem(self) -> str:
        """None: the world's phone has one."""
        return ""

    def free_bytes(self) -> int:
        """Of the disk."""
        return self._mistake.free_bytes

    def power(self) -> tuple[int, bool] | None:
        """Of the laptop."""
        return self._mistake.power

    def busy_s(self) -> float:
        """This thread's own time, as a slower laptop would count it."""
        return time.thread_time() * self._mistake.slower

    def show(self, lines: Sequence[Line]) -> None:
        """Kept."""
        self.shown = list(lines)

    # ---- the operator ----------------------------------------------------------------------------

    def operator(
        self, question: Question, until: Callable[[], bool] | None = None
    ) -> str | float | None:
        """What a person beside the machine sees and does, after a moment."""
        tap = self.bench.faults.taps[int(Signal.ESTOP)]
        if question.key in ("estop_press", "estop_release") and self._mistake.estop_works:
            self.pump(ANSWER_S / 2)
            tap["mode"] = int(Mode.FIXED if question.key == "estop_press" else Mode.HONEST)
            tap["value"] = ESTOP_OPEN_MV
        end = self.bench.now + ANSWER_S
        while self.bench.now < end:
            self.pump(0.1)
            if until is not None and until():
                return None
        return self._answer(question)

    def _answer(self, question: Question) -> str | float | None:
        state = self.bench.state
        angle = math.degrees(float(state["steer_angle"]))
        rolled = float(state["distance"]) - self._odometer
        plain = sees(question.key, question.values, angle, rolled)
        if plain is not None:
            return plain
        match question.key:
            case "room":
                self._odometer = float(state["distance"])
                return "yes"
            case "blade_supply":
                self._supply_off = True
                return "supply_off"
            case "blade_rest":
                return "lamp_on" if self._mistake.relay_inverted else "lamp_off"
            case "blade_seen":
                return "clicked" if self.blade_clicked else "silent"
            case key:
                return question.choices[0] if question.choices else key


@dataclass(frozen=True)
class Outcome:
    """What the check said of one machine."""

    lines: tuple[Line, ...]
    simulated_s: float
    blade_armed: bool
    off: Mapping[str, float] = field(default_factory=dict)
    """What the roll's figures are off by: pitch, yaw and roll of the camera, degrees, and `delay`,
    s; empty where it gave none."""

    @property
    def green(self) -> bool:
        """Whether the harvest could start."""
        return green(self.lines)

    @property
    def findings(self) -> tuple[str, ...]:
        """What is wrong, in order."""
        return tuple(line.finding for line in self.lines if line.verdict == "bad")


def good_machine(seed: int, out: Path) -> Outcome:
    """Walks the check of a machine that is built well, with everything as that seed draws it."""
    base = own_machine(scenario.load("default", dict(FIELD)), seed, out / "owner")
    return _inspected(base, Mistake("none", ()), out)


def inspect(mistake: Mistake | None, out: Path, over: Values | None = None) -> Outcome:
    """Builds a machine, with a mistake or without, and walks its check. Files and parameters are
    those of the machine as its owner believes it to be: without the mistake."""
    base = scenario.load("default", scenario.merge(dict(FIELD), {"seed": 1, **(over or {})}))
    return _inspected(base, mistake or Mistake("none", ()), out)


def _inspected(base: scenario.Scenario, wrong: Mistake, out: Path) -> Outcome:
    good = handouts(base, out)
    world = scenario.changed(base, dict(wrong.world)) if wrong.world else base
    held = dict(base.told.parameters) | dict(wrong.parameters)
    world = scenario.changed(world, {"belief": {"parameters": held}})
    vehicle = load_vehicle(Path(good["vehicle"])).model_copy(update=dict(wrong.vehicle))
    boundary = Path(good["boundary"])
    if wrong.shifted_m:
        text = boundary.read_text(encoding="utf-8")
        moved = out / "elsewhere.geojson"
        moved.write_text(_shifted(text, wrong.shifted_m), encoding="utf-8")
        boundary = moved
    stands = base.start_pose()[:2]
    frame = LocalFrame(base.gnss.lat_deg, base.gnss.lon_deg)
    ring = [frame.to_local(*place) for place in load_field(boundary).crop]
    nearest = min(range(len(ring)), key=lambda k: math.dist(ring[k], stands))
    corner = nearest if wrong.corner is None else (nearest + wrong.corner) % len(ring)
    target = Target(boundary, float(good["gap"]) if wrong.gap else None, corner)
    with Bench(world) as bench:
        hands = LockstepHands(bench, vehicle, good["mount"], "robust", wrong)
        lines = walk(hands, target)
        off = _off(lines, world, hands.mount)
        return Outcome(tuple(lines), bench.now, hands.armed_blade, off)


def _off(lines: Sequence[Line], scene: scenario.Scenario, believed: Mount) -> dict[str, float]:
    """What the lines of the roll say, less what is so."""
    said = {line.name: line.values for line in lines}
    found: dict[str, float] = {}
    lens = scene.world.lens
    for name in ("pitch", "yaw", "roll"):
        if name in said["mount"]:
            key = f"{name}_deg"
            found[name] = said["mount"][name] - (getattr(lens, key) - getattr(believed, key))
    if "seen" in said["delay"]:
        found["delay"] = said["delay"]["seen"] - lens.delay_s
    return found


def _shifted(geojson: str, metres: float) -> str:
    """The same field so far north."""
    found = json.loads(geojson)
    found["coordinates"] = [
        [[lon, lat + metres / 111_000] for lon, lat, *_ in ring] for ring in found["coordinates"]
    ]
    return json.dumps(found)
