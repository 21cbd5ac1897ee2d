"""`daranti-hil vision`: the mounted detectors on scripted drives along crop edges.

No firmware and no pilot: the machine's pose is a weave along an edge, the blade cuts, the camera
sees, and every picture's view is compared with the field itself. One drive is one edge with its end
and is a function of (seed, number) alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.judge.metrics import FALSE_END_M, PROBE_AHEAD_M
from hil.scenario.belief import Belief
from hil.scenario.drawn_machine import drawn_lens, drawn_machine
from hil.scenario.scenario import Scenario
from hil.studies import camera_troubles
from host.core.vehicle import Mount, Vehicle
from host.estimate.crop_ahead import CONFIDENT, Ahead, EndOfField
from host.estimate.lane import Lane
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.vision.geometry import Camera as Eye
from host.vision.mounted.detector import make_detector
from host.vision.photo.detector import RobustPhoto
from host.vision.view import CropView
from sim_plant.camera import Camera
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.machine import MachineSpec
from sim_plant.sky import WeatherSpec

Mode = Literal["paper", "robust", "photo"]
"""Of the detectors that drive; "photo" is the photographs', which never drives, shown the same
pictures."""
Pose = tuple[float, float, float]

STEP_M = 0.05
"""Between pictures: 10 Hz at 0.5 m/s."""
CUT_STEPS = 2
"""Of the blade within one."""
RINGS = 4
"""Swaths already cut beside the one that is driven: up to three."""
DEPTH_M = 7.0
"""Of the field behind the edge."""
BEYOND_M = 1.6
"""How far the blade goes on after the crop's end: what is not declared by then was missed."""
LASTS_M = 0.2
"""Of crop beyond the place where the edge is measured, below which there is no true edge: a ragged
end has no right side."""
WRONG_M = 0.1
"""What `CropView.confidence` is about."""
PROBE_HEIGHT_M = 0.3
"""At which the photographs' edge is read on the face ahead: above most straw, below the ears."""
PROBE_M = np.arange(-1.0, 1.0, 0.005)
"""Places from the blade's right end to the left, among which that edge is sought."""
SURE_FROM = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Confidences from which one may call a detector sure."""
DISTANCE_SD, TURN_SD = 0.01, 0.03
"""Of the odometry's scale, as the filter gets it."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One edge; plain data, so that it travels to other processes."""

    seed: int
    number: int
    mount: str
    mode: Mode
    length_m: float
    folder: str
    dust: float | None = None
    """Instead of the random one."""
    trouble: str = camera_troubles.NONE
    """Of the camera, of `camera_troubles.TROUBLES`."""
    own_machine: bool = False
    """Whether lengths, mount and lens are drawn, as on random fields, and not those of the drawing.
    """

    @property
    def path(self) -> Path:
        """Where its result is kept."""
        air = "" if self.dust is None else f"-dust{self.dust:g}"
        ill = "" if self.trouble == camera_troubles.NONE else f"-{self.trouble.replace(' ', '_')}"
        own = "-own" if self.own_machine else ""
        name = f"{self.mode}-{self.mount}-{self.seed}{air}{ill}{own}-{self.number:05d}.json"
        return Path(self.folder) / name


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one drive showed; a row per picture while crop was being cut."""

    conditions: str
    km: float
    offset_error_m: list[float | None]
    """Seen less true; None where the view was not confident."""
    heading_error_rad: list[float | None]
    """Likewise, of the picture's own direction of the edge."""
    lane_offset_error_m: list[float]
    """Of the filter that steers."""
    lane_heading_error_rad: list[float]
    end_error_m: float | None
    """Where the end was declared, beyond the last crop cut; None where it never was."""
    false_ends: int
    confidence: list[float] = field(default_factory=list)
    """Of every picture, sure or not,"""
    said_error_m: list[float | None] = field(default_factory=list)
    """and its offset error; None where no offset was said."""


@dataclass(frozen=True, slots=True)
class Edge:
    """A prepared field: crop stands left of y = depth, from x = 0 to x = end."""

    crop: Field
    scenario: Scenario
    vehicle: Vehicle
    depth_m: float
    end_m: float
    weave: tuple[tuple[float, float, float], ...]
    """(amplitude m, wavelength m, phase) of the blade's middle about its lane."""

    def pose(self, blade_x: float) -> Pose:
        """The rear axle where the blade's line is at `blade_x`. The blade's middle weaves; the rear
        axle, whose wheels do not slip sideways, is drawn behind it like a trailer."""
        v = self.vehicle
        bar = v.blade_x_m
        blade = rear = self.depth_m + 0.5 * v.blade_width_m - v.overlap_m
        for amplitude, wavelength, phase in self.weave:
            k = math.tau / wavelength
            blade += amplitude * math.sin(k * blade_x + phase)
            # the solution of rear' = (blade - rear) / bar, for small angles
            less = amplitude / math.hypot(1.0, k * bar)
            rear += less * math.sin(k * blade_x + phase - math.atan(k * bar))
        yaw = math.asin((blade - rear) / bar)
        return blade_x - bar * math.cos(yaw), rear, yaw


def prepared(drive: Drive) -> Edge:
    """Field, weather and weave of a drive."""
    rng = np.random.default_rng((drive.seed, drive.number))
    spec = FieldSpec(
        size_m=(drive.length_m, DEPTH_M),
        drilled=bool(rng.random() < 0.3),
        crop_height_m=float(rng.uniform(0.8, 1.0)),
        lodged=float(rng.choice([0.0, 0.0, 0.05])),
        windrow_m=(0.1, 0.45),
    )
    weather = WeatherSpec(
        hour=float(rng.uniform(9, 16)),
        dust=float(rng.uniform(0, 0.6)),
        wind_mps=float(rng.uniform(0, 6)),
        cloud=float(rng.choice([0.0, 0.0, 0.0, 0.5, 1.0])),
        haze=float(rng.uniform(0.002, 0.02)),
    )
    if drive.dust is not None:
        weather = weather.model_copy(update={"dust": drive.dust})
    trouble = camera_troubles.TROUBLES[drive.trouble]
    weather = trouble.air(weather, (drive.seed, drive.number))
    seed = int(rng.integers(1 << 30))
    machine, lens = MachineSpec(), trouble.lens((drive.seed, drive.number))
    if drive.own_machine:
        machine = drawn_machine(seed)
        lens = drawn_lens(seed, drive.mount, machine) | lens
    scenario = Scenario(
        seed=seed,
        camera=drive.mount,
        machine=machine,
        lens=lens,
        field=spec,
        weather=weather,
        belief=Belief.model_validate("exact"),
    )
    v = scenario.vehicle
    crop = Field(spec, scenario.seed)
    depth = int(rng.integers(RINGS)) * (v.blade_width_m - v.overlap_m)
    end = drive.length_m - depth
    far = drive.length_m + 50.0
    if depth > 0:
        crop.clear(((-50, -50), (far, -50), (far, depth), (-50, depth)))
        crop.clear(((end, -50), (far, -50), (far, 50), (end, 50)))
    phases = rng.uniform(0, math.tau, 2)
    weave = (
        (float(rng.uniform(0.01, 0.05)), float(rng.uniform(4, 9)), float(phases[0])),
        (float(rng.uniform(0.0, 0.08)), float(rng.uniform(12, 30)), float(phases[1])),
    )
    return Edge(crop, scenario, v, depth, end, weave)


class PhotoOnMount:
    """The photographs' detector (the crop's side given, no mount), its edge read in metres where
    the drive's truth is measured. It tells nothing of what stands ahead."""

    def __init__(self, vehicle: Vehicle, mount: Mount) -> None:
        self._photo = RobustPhoto("left")
        places = np.column_stack(
            [
                np.full(len(PROBE_M), vehicle.blade_x_m + PROBE_AHEAD_M),
                PROBE_M - vehicle.inset_m,
                np.full(len(PROBE_M), PROBE_HEIGHT_M),
            ]
        )
        u, v = np.floor(Eye(mount).project(places)).T
        inside = (u >= 0) & (u < mount.width_px) & (v >= 0) & (v < mount.height_px)
        self._offsets = PROBE_M[inside]
        self._pixels = (v[inside].astype(int), u[inside].astype(int))

    def see(self, bgr: NDArray[np.uint8]) -> CropView:
        view = self._photo.see(bgr)
        if view.standing is None:
            return view
        standing = view.standing[self._pixels]
        # the place that leaves the fewest pixels of crop to its right and of cut to its left
        wrong = np.count_nonzero(~standing) + np.cumsum(np.where(standing, 1, -1))
        return CropView(view.confidence, edge_offset_m=float(self._offsets[int(wrong.argmin())]))


def declared_end(ahead: Ahead, view: CropView, motion: Motion) -> Motion | None:
    """Where the end was first seen, when this picture declares it by vision alone; None where it
    declares none."""
    if view.ahead_confidence < CONFIDENT:
        return None
    ahead.sight(view, motion)
    ahead.follow(view, EndOfField(motion.stamp, motion))
    end = ahead.end
    if end is None:
        return None
    ahead.go_on()
    return end.motion


@dataclass(frozen=True, slots=True)
class Seen:
    """One picture of a drive, and what is true of it."""

    bgr: NDArray[np.uint8]
    pose: Pose
    travelled_m: float
    cutting: bool
    offset_m: float
    """True `CropView.edge_offset_m`; NaN where there is no edge beside the blade."""
    heading_rad: float
    """True `CropView.edge_heading_rad`."""
    crop_beyond: bool
    """The field's crop still stands `FALSE_END_M` before the blade or little further: no end."""


def drive_along(edge: Edge) -> Iterator[Seen]:
    """The pictures of one edge, from before the crop to beyond its end."""
    crop, scenario = edge.crop, edge.scenario
    v, lens = edge.vehicle, scenario.world.lens
    camera = Camera(crop, lens, scenario.weather, scenario.seed, threads=1)
    speed = v.cutting_speed_mps
    start = -0.4
    before = edge.pose(start)
    for k in range(round((edge.end_m + BEYOND_M - start) / STEP_M)):
        cut = 0
        for n in range(1, CUT_STEPS + 1):
            here = edge.pose(start + (k + n / CUT_STEPS) * STEP_M)
            cut += crop.cut(before, here, ahead_m=v.blade_x_m, width_m=v.blade_width_m)
            rate = (here[2] - before[2]) / (STEP_M / CUT_STEPS / speed)
            before = here
        x, y, yaw = before
        roll, pitch = crop.bumps(x, y, yaw)
        t = k * STEP_M / speed
        # the pilot looks before it lets the blade spin
        bgr = camera.capture(t, x, y, yaw, roll, pitch, speed, rate, k > 0)
        coded = np.frombuffer(camera.encode(bgr), np.uint8)
        ahead, right = v.blade_x_m + PROBE_AHEAD_M, -0.5 * v.blade_width_m
        c, s = math.cos(yaw), math.sin(yaw)
        beside = crop.true_edge_offset(
            x + ahead * c - right * s, y + ahead * s + right * c, yaw, 0.6
        )
        last = ahead + LASTS_M
        width = 0.6 * v.blade_width_m
        lasting = crop.crop_ahead(x + last * c, y + last * s, yaw, width, 0.1)
        front = v.blade_x_m + FALSE_END_M
        beyond = crop.crop_ahead(x + front * c, y + front * s, yaw, width, 0.5)
        yield Seen(
            np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8),
            before,
            k * STEP_M,
            cut > 0,
            beside - v.overlap_m if math.isfinite(lasting) else math.nan,
            -yaw,
            math.isfinite(beyond),
        )


def run(drive: Drive) -> Outcome:
    """Drives once, or reads what an earlier run has found."""
    if drive.path.exists():
        done = json.loads(drive.path.read_text(encoding="utf-8"))
        if "confidence" in done:
            return Outcome(**done)
    cv2.setNumThreads(1)
    outcome = _driven(drive, prepared(drive))
    fresh = drive.path.with_suffix(".part")
    fresh.write_text(json.dumps(asdict(outcome)) + "\n", encoding="utf-8")
    fresh.replace(drive.path)
    return outcome


def _driven(drive: Drive, edge: Edge) -> Outcome:
    scenario, v = edge.scenario, edge.vehicle
    mount = scenario.mount
    eye = PhotoOnMount(v, mount) if drive.mode == "photo" else make_detector(drive.mode, v, mount)
    rng = np.random.default_rng((drive.seed, drive.number, 1))
    scale, gain = 1 + DISTANCE_SD * rng.normal(), 1 + TURN_SD * rng.normal()
    position, ahead = Position(v), Ahead()
    lane = Lane(position, v.blade_x_m)
    lane.place(0.0, 0.0, 0.15, math.radians(8))
    found = Outcome(_conditions(scenario, edge), 0.0, [], [], [], [], None, 0)
    declared: float | None = None
    last_cut, first_cut, false_ends = 0.0, math.nan, 0
    for seen in drive_along(edge):
        view = eye.see(seen.bgr).with_lying()
        way_m, (x, y, yaw) = seen.travelled_m, seen.pose
        speed = v.cutting_speed_mps
        motion = Motion(way_m / speed, speed, 0.0, scale * way_m, gain * yaw, x, y)
        position.predict(motion, cutting=True)
        if view.confidence >= CONFIDENT:
            lane.correct(view.edge_offset_m, view.edge_heading_rad, view.confidence, (0.0, 0.0))
        if seen.cutting:
            last_cut = way_m
            first_cut = way_m if math.isnan(first_cut) else first_cut
            if math.isfinite(seen.offset_m):
                _compare(found, view, lane, seen)
        end = declared_end(ahead, view, motion)
        if end is not None and declared is None:
            if seen.crop_beyond:
                false_ends += 1
            else:
                declared = end.distance_m / scale
    end_error_m = None if declared is None else declared - last_cut
    km = (last_cut - first_cut) / 1e3
    return replace(found, km=km, end_error_m=end_error_m, false_ends=false_ends)


def _compare(found: Outcome, view: CropView, lane: Lane, seen: Seen) -> None:
    """What view and lane say of the edge, against the truth."""
    sure, turned = view.confidence >= CONFIDENT, view.edge_heading_rad
    known = sure and math.isfinite(turned)
    off = view.edge_offset_m - seen.offset_m
    found.confidence.append(view.confidence)
    found.said_error_m.append(off if math.isfinite(off) else None)
    found.offset_error_m.append(view.edge_offset_m - seen.offset_m if sure else None)
    found.heading_error_rad.append(turned - seen.heading_rad if known else None)
    found.lane_offset_error_m.append(-lane.blade_offset_m - seen.offset_m)
    found.lane_heading_error_rad.append(-lane.heading_rad - seen.heading_rad)


def _conditions(scenario: Scenario, edge: Edge) -> str:
    w, f = scenario.weather, scenario.field
    kind = "drilled" if f.drilled else "broadcast"
    return (
        f"{w.hour:04.1f} h, dust {w.dust:.1f}, cloud {w.cloud:.1f}, wind {w.wind_mps:.0f} m/s, "
        f"{kind}, {f.crop_height_m:.2f} m, {edge.depth_m:.1f} m inside"
    )


Said = tuple[float, float | None]
"""Of one picture: confidence, and how far off; None where nothing was said that could be compared.
"""


def said_of(outcomes: Iterable[Outcome]) -> list[Said]:
    """Of every picture of some drives, off in metres."""
    return [s for o in outcomes for s in zip(o.confidence, o.said_error_m, strict=True)]


def curve(said: Sequence[Said], wrong: float = WRONG_M) -> list[dict[str, float]]:
    """How often a detector is sure, and sure and wrong by more than `wrong`, as shares of all
    pictures, by the confidence from which one calls it sure. Empty without pictures."""
    if not said:
        return []
    confidence = np.array([c for c, _ in said])
    off = np.array([math.inf if e is None else abs(e) for _, e in said])
    rows = []
    for least in SURE_FROM:
        sure = confidence >= least
        shares = {"sure": sure, "sure_and_wrong": sure & (off > wrong)}
        means = {name: round(float(which.mean()), 5) for name, which in shares.items()}
        rows.append({"confidence": least} | means)
    return rows


def summary(outcomes: Sequence[Outcome]) -> dict[str, float | int | None]:
    """The figures of one mount, keys as in summary.json; None where nothing was measured."""

    def rms(values: Sequence[float]) -> float | None:
        return float(np.sqrt(np.mean(np.square(values)))) if values else None

    def degrees(value: float | None) -> float | None:
        return None if value is None else math.degrees(value)

    offsets = [e for o in outcomes for e in o.offset_error_m]
    sure = [e for e in offsets if e is not None]
    turned = [e for o in outcomes for e in o.heading_error_rad if e is not None]
    ends = [o.end_error_m for o in outcomes if o.end_error_m is not None]
    figures = {
        "km": sum(o.km for o in outcomes),
        "pictures": len(offsets),
        "availability": len(sure) / len(offsets) if offsets else None,
        "offset_rmse_m": rms(sure),
        "offset_bias_m": float(np.mean(sure)) if sure else None,
        "confident_wrong": float(np.mean(np.abs(sure) > WRONG_M)) if sure else None,
        "heading_rmse_deg": degrees(rms(turned)),
        "lane_offset_rmse_m": rms([e for o in outcomes for e in o.lane_offset_error_m]),
        "lane_heading_rmse_deg": degrees(
            rms([e for o in outcomes for e in o.lane_heading_error_rad])
        ),
        "ends": len(outcomes),
        "end_of_field_error_median_m": float(np.median(ends)) if ends else None,
        "end_of_field_error_worst_m": float(max(ends, key=abs)) if ends else None,
        "missed_ends": sum(o.end_error_m is None for o in outcomes),
        "false_ends": sum(o.false_ends for o in outcomes),
    }
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in figures.items()}
