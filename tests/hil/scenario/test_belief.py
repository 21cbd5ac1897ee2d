"""Facts about world and belief: what the host is told differs, and changes nothing of what is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import shapely
import shapely.affinity

from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.bench.rig import handouts
from hil.firmware import targets
from hil.judge.metrics import OVERLAP_M, Truth
from hil.scenario.belief import Errors, ccw, corner_like
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, assigned, changed, load, merge
from hil.studies.actuators import truth
from hil.studies.outlines import outline, outline_field
from host.commands.calibrate_drive import RESERVE
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Command, Request, State
from host.core.vehicle import Vehicle
from host.core.vehicle_file import save_vehicle
from host.field.boundary_file import UNKNOWN_SIGMA_M, Boundary, save_field
from host.link.session import Session
from host.pilot.pilot import Pilot
from host.runs import record
from host.vision.view import Detector
from sim_plant.drive_response import drive_response
from sim_plant.field import Field
from sim_plant.machine import SteeringSpec
from sim_plant.network import Stream
from tests.helpers.oracle import Oracle, quick

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
)
IDLE = Pilot(Vehicle(), cast(Detector, None))
LONGER = [[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]]
WRONG: dict[str, dict[str, Any]] = {
    "vehicle": {"vehicle": {"wheelbase_m": 1.1, "blade_width_m": 1.2, "overlap_m": 0.2}},
    "hall": {"vehicle": {"hall_pulses_per_m": 25.0}},
    "mount": {"vehicle": {"mounts": {"mast": {"pitch_deg": 20.0}}}},
    "delay": {"vehicle": {"camera_delay_s": 0.4}},
    "crop": {"vehicle": {"crop_height_m": 1.4}},
    "boundary": {"boundary": LONGER},
    "gap": {"gap_m": 0.7},
    "corner": {"corner": 3},
    "keep-outs": {"keep_outs": [[[3.9, 3.9], [4.1, 3.9], [4.1, 4.1]]]},
    "parameters": {"parameters": {"pot_centre": 530.0}},
}


ROOMY = {"size_m": (8.0, 8.0), "neighbour_depth_m": 2.0}

RING = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0), (0.0, 0.0))


def believing(belief: dict[str, Any]) -> Scenario:
    return quick(field=ROOMY, belief={"errors": "exact", **belief})


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_belief_reaches_the_host_and_only_the_host(what: str) -> None:
    knows, errs = believing({}), believing(WRONG[what])
    assert errs.world == knows.world
    assert errs.told != knows.told
    if what != "keep-outs":  # the operator puts it where the plan begins
        assert errs.start_pose() == knows.start_pose()


def test_each_error_reaches_what_it_is_of() -> None:
    reached = {
        "tape_m": ("vehicle", 0.1),
        "mount_m": ("vehicle", 0.5),
        "mount_deg": ("vehicle", 5.0),
        "hall": ("vehicle", 0.3),
        "drive": ("vehicle", 0.3),
        "dead_duty": ("vehicle", 0.06),
        "drive_lag": ("vehicle", 0.5),
        "delay_s": ("vehicle", 0.1),
        "crop_m": ("vehicle", 0.2),
        "gap_m": ("gap_m", 1.0),
        "pot_deg": ("parameters", 5.0),
        "walk_cep_m": ("boundary", [2.0, 2.5]),
        "keep_out_m": ("keep_outs", 0.5),
    }
    others = {"lens", "calibrated_deg", "uncalibrated_deg", "walk_laps"}
    assert set(Errors.model_fields) == reached.keys() | others
    hole = [[3.9, 3.9], [4.1, 3.9], [4.1, 4.1]]
    knows = quick(field=ROOMY | {"keep_outs": [hole]})
    for name, (part, bound) in reached.items():
        errs = changed(knows, {"belief": {"errors": {name: bound}}})
        assert errs.world == knows.world
        changes = {
            key
            for key in ("vehicle", "boundary", "keep_outs", "gap_m", "parameters")
            if getattr(errs.told, key) != getattr(knows.told, key)
        }
        along = {"walk_cep_m": {"keep_outs"}}.get(name, set())
        if name in ("hall", "drive", "dead_duty", "drive_lag"):
            along = {"parameters"}
        assert changes == {part} | along, name


def test_exact_is_the_truth() -> None:
    for scenario in (random_field(3), load("default"), load("worn-machine")):
        exact = changed(scenario, {"belief": "exact"})
        told, world = exact.told, exact.world
        vehicle, machine = told.vehicle, world.machine
        assert told.boundary == world.corners
        assert told.keep_outs == world.field.keep_outs
        assert (told.gap_m, told.corner) == (world.field.gap_m, world.start.corner)
        assert vehicle.blade_x_m == pytest.approx(machine.blade_x_m)
        assert vehicle.half_width_m == machine.half_width_m
        assert vehicle.hall_left_m == machine.drive.hall_left_m
        assert vehicle.crop_height_m == world.field.crop_height_m
        assert told.mount.focal == pytest.approx(world.lens.focal_px)
        assert told.mount.distortion[:2] == (world.lens.k1, world.lens.k2)
        assert told.mount.pitch_deg == world.lens.pitch_deg
        assert told.parameters["hall_per_metre"] == machine.drive.hall_pulses_per_m
        assert vehicle.overlap_m == OVERLAP_M
        drive = drive_response(machine, vehicle.nominal_battery_v)
        assert vehicle.full_duty_speed_mps == told.parameters["speed_full"] == drive.full_mps
        assert vehicle.dead_duty == drive.dead
        assert vehicle.drive_lag_s == told.parameters["drive_lag"] == drive.lag_s


def test_what_is_drawn_lies_within_what_tape_and_level_leave_and_is_the_same_again() -> None:
    bounds, differ = Errors(), set()
    for seed in range(30):
        belief = {} if seed < 6 else {"boundary": RING[:-1]}  # a walk takes longer than all else
        scenario = load("default", {"seed": seed, "belief": belief})
        told, world = scenario.told, scenario.world
        assert scenario.told == told
        v, m = told.vehicle, world.machine
        assert abs(v.wheelbase_m - m.wheelbase_m) <= bounds.tape_m
        assert 0.0 < abs(v.hall_left_m - m.drive.hall_left_m) <= bounds.tape_m
        assert abs(told.mount.pitch_deg - world.lens.pitch_deg) <= bounds.mount_deg
        assert abs(told.mount.z_m - world.lens.z_m) <= bounds.mount_m
        assert abs(told.gap_m - world.field.gap_m) <= bounds.gap_m
        assert abs(v.crop_height_m - world.field.crop_height_m) <= bounds.crop_m
        differ.add(v.wheelbase_m)
        assert len(told.boundary) == 4
        size = shapely.Polygon(told.boundary).area
        assert belief or 0.5 < size / world.field.boundary.area < 1.5
    assert len(differ) == 30


@pytest.mark.parametrize("left_m", [0.35, -0.35])
def test_a_wheel_at_the_machines_side_is_measured_inside_of_it(left_m: float) -> None:
    """Where tape and tape differ; outside of it no wheel runs, and no vehicle file has one."""
    machine = {"half_width_m": 0.35, "drive": {"hall_left_m": left_m}}
    for seed in range(10):
        scenario = load(
            "default", {"seed": seed, "machine": machine, "belief": {"boundary": LONGER}}
        )
        vehicle = scenario.told.vehicle
        assert left_m - 0.01 <= vehicle.hall_left_m <= left_m + 0.01
        assert abs(vehicle.hall_left_m) <= vehicle.half_width_m


def test_random_fields_draw_both_halves() -> None:
    drawn = [random_field(seed).world for seed in range(40)]
    delays = [world.lens.delay_s for world in drawn]
    assert 0.05 <= min(delays) < 0.1
    assert 0.2 < max(delays) <= 0.25
    assert max(world.gnss.smoothing_s for world in drawn) > 1.0
    assert max(world.gnss.lag_s for world in drawn) > 0.5
    fulls = [drive_response(world.machine, 12.0).full_mps for world in drawn]
    assert min(fulls) < 0.85
    assert max(fulls) > 1.15
    assert min(fulls) > RESERVE * Vehicle().cutting_speed_mps, "what no check would warn of"
    slews = [truth(world.machine).slew_degps for world in drawn]
    assert min(slews) < 30
    assert max(slews) > 55


def test_more_laps_with_a_better_phone_tell_more_of_the_boundary() -> None:
    def off(laps: int, cep_m: float) -> float:
        away = []
        for seed in range(5):
            walk = {"laps": laps, "cep_m": cep_m}
            scenario = load("default", {"seed": seed, "belief": {"boundary": walk}})
            said, is_ = np.array(scenario.told.boundary), np.array(scenario.world.corners)
            first = corner_like(scenario.world.corners, 0, scenario.told.boundary)
            said = np.roll(said, -first, axis=0)
            shift = said.mean(axis=0) - is_.mean(axis=0)
            away.append(float(np.hypot(*(said - shift - is_).T).mean()))
        return float(np.median(away))

    # the walker strays by 0.1 m, and speeds are rounded
    assert off(1, 0.0) < 0.15
    assert off(3, 0.5) < 0.5 * off(1, 2.5)
    assert off(1, 2.5) > 0.15


def test_how_surely_the_corners_are_known_comes_from_where_the_corners_come_from(
    tmp_path: Path,
) -> None:
    def sigma(belief: dict[str, Any]) -> float:
        told = quick(field=ROOMY, belief=belief).told
        assert told.plan("three_point").sigma_m == told.boundary_sigma_m
        return told.boundary_sigma_m

    places = tuple(LocalFrame(31.5, 74.3).to_wgs84(x, y) for x, y in LONGER)
    save_field(tmp_path / "said.geojson", Boundary(places, sigma_m=0.4))
    save_field(tmp_path / "silent.geojson", Boundary(places))
    assert sigma({"errors": "exact"}) == 0.0
    assert sigma({"errors": "exact", "boundary": LONGER}) == 0.0
    assert sigma({"boundary": LONGER}) == UNKNOWN_SIGMA_M
    assert sigma({"boundary": LONGER, "boundary_sigma_m": 0.7}) == 0.7
    assert sigma({"boundary": str(tmp_path / "said.geojson")}) == 0.4
    assert sigma({"boundary": str(tmp_path / "silent.geojson")}) == UNKNOWN_SIGMA_M
    poor, good = (sigma({"boundary": {"laps": n, "cep_m": c}}) for n, c in ((1, 2.5), (3, 0.5)))
    assert 0.05 < good < poor < 0.7


@needs_firmware
def test_the_same_commands_move_the_same_machine_whatever_is_believed() -> None:
    ways = []
    belief = {k: v for part in WRONG.values() for k, v in part.items() if k != "parameters"}
    belief["keep_outs"], belief["boundary"] = [], LONGER
    vehicle = {"wheelbase_m": 1.1, "blade_width_m": 1.2, "camera_delay_s": 0.3}
    for scenario in (believing({}), believing(belief | {"vehicle": vehicle})):
        with Bench(scenario) as bench:
            session, truth = Session(), Truth(bench.world, bench.field)
            for tick in range(1, 100):
                for stamp, data in bench.advance(tick / 20):
                    session.feed(stamp, data)
                told = session.telemetry
                armed = told is not None and told.state is not State.SAFE
                go = Command(Request.DRIVE, 0.02, 0.5, tick > 10)
                bench.send(session.encode(tick / 20, go if armed else Command(Request.ARM)))
                truth.step(tick / 20, bench.pose, bench.cut_cells, IDLE)
            ways.append((truth.path, truth.summary()))
    assert ways[0] == ways[1]
    assert ways[0][1]["coverage"] > 0.01  # type: ignore[operator]


def test_the_judge_is_given_the_world_alone() -> None:
    scenario = believing(WRONG["vehicle"])
    truth = Truth(scenario.world, Field(scenario.field))
    assert not any(isinstance(part, Vehicle | Scenario) for part in vars(truth).values())


@needs_firmware
@pytest.mark.parametrize(("is_s", "said_s"), [(0.2, 0.1), (0.1, 0.25)])
def test_a_picture_is_as_old_as_the_host_believes(
    tmp_path: Path, is_s: float, said_s: float
) -> None:
    scenario = changed(
        quick(limits={"time_s": 1.0}, record={"pictures_every": 1}),
        {
            "lens": {"delay_s": is_s, "jitter_s": 0.0, "stall_share": 0.0},
            "belief": {"vehicle": {"camera_delay_s": said_s}},
        },
    )
    run = Harvest(scenario, tmp_path / "r.mcap", detector=Oracle)
    run.run()
    run.close()
    stamps = [stamp for topic, stamp, _ in record.read(tmp_path / "r.mcap") if topic == "/camera"]
    shutters = [0.1 * k for k in range(1, len(stamps) + 1)]
    assert stamps == pytest.approx([max(0.0, t + is_s - said_s) for t in shutters], abs=1e-6)
    assert len(stamps) >= 7


@needs_firmware
def test_what_the_network_adds_to_a_picture_the_host_takes_for_its_age(tmp_path: Path) -> None:
    """And of those that come together it sees the newest."""
    lens = {"delay_s": 0.15, "jitter_s": 0.05, "stall_share": 0.3}
    scenario = changed(
        quick(limits={"time_s": 3.0}, record={"pictures_every": 1}),
        {"lens": lens, "belief": {"vehicle": {"camera_delay_s": 0.1}}},
    )
    run = Harvest(scenario, tmp_path / "r.mcap", detector=Oracle)
    run.run()
    run.close()
    stamps = [stamp for topic, stamp, _ in record.read(tmp_path / "r.mcap") if topic == "/camera"]
    stream = Stream(scenario.world.lens, scenario.world.seed)
    came = [stream.arrives_s(0.1 * k) for k in range(1, 31)]
    seen = {math.ceil(at * 20 - 1e-6): at - 0.1 for at in came if at <= 3.0}
    assert stamps == pytest.approx(list(seen.values()), abs=1e-6)
    assert len(stamps) < sum(at <= 3.0 for at in came), "some came together"


def test_a_setting_changes_one_part_of_the_belief() -> None:
    chosen = load("default", merge(assigned("belief=exact"), assigned("belief.gap_m=1.5")))
    assert chosen.told.gap_m == 1.5
    assert chosen.told.boundary == chosen.world.corners
    chosen = load("reference", assigned("belief.errors.mount_deg=3"))
    assert chosen.told.mount.pitch_deg != chosen.world.lens.pitch_deg
    assert chosen.told.vehicle.wheelbase_m == chosen.world.machine.wheelbase_m


def test_the_rig_hands_out_the_belief(tmp_path: Path) -> None:
    chosen = believing(WRONG["boundary"] | {"gap_m": 1.5})
    given = handouts(chosen, tmp_path)
    assert given["gap"] == "1.5"
    again = changed(chosen, {"belief": {"boundary": given["boundary"]}})
    assert np.allclose(again.told.boundary, LONGER, atol=1e-3)


def test_files_are_read_as_the_host_reads_them(tmp_path: Path) -> None:
    save_vehicle(tmp_path / "v.yaml", Vehicle(wheelbase_m=1.25))
    chosen = believing({"vehicle": str(tmp_path / "v.yaml")})
    assert chosen.vehicle.wheelbase_m == 1.25
    assert chosen.world.machine.wheelbase_m == 1.0
    with pytest.raises(UserError, match=r"nowhere\.yaml"):
        assert believing({"vehicle": "nowhere.yaml"}).vehicle


def test_who_was_told_another_corner_stands_where_the_world_has_the_start() -> None:
    chosen = believing({"corner": 2})
    assert chosen.told.corner == 2
    assert chosen.plan().sides[0].heading_rad == pytest.approx(math.pi)
    assert chosen.start_pose() == believing({}).start_pose()


@pytest.mark.parametrize("given", [RING, RING[::-1]], ids=["ccw", "clockwise"])
def test_a_ring_is_told_counter_clockwise_whichever_way_it_was_walked(
    given: tuple[tuple[float, float], ...],
) -> None:
    assert ccw(given) == [*RING]


@pytest.mark.parametrize(("slew_degps", "low_ms", "high_ms"), [(20.0, 270, 290), (45.0, 175, 185)])
def test_the_firmware_is_told_how_long_this_steering_may_be_silent(
    slew_degps: float, low_ms: float, high_ms: float
) -> None:
    steering = SteeringSpec.from_response(slew_degps=slew_degps)
    scenario = Scenario.model_validate({"machine": {"steering": steering.model_dump()}})
    assert low_ms < scenario.told.parameters["stall_time"] < high_ms


def test_the_host_knows_whether_its_boundary_was_recorded_from_whoever_made_it(
    tmp_path: Path,
) -> None:
    def recorded(belief: dict[str, Any], **world: Any) -> tuple[bool | None, bool]:
        told = load("default", {**world, "belief": belief}).told
        return told.boundary_recorded, told.plan("three_point").recorded

    places = tuple(LocalFrame(31.5, 74.3).to_wgs84(x, y) for x, y in LONGER)
    for said in (True, False, None):
        save_field(tmp_path / "field.geojson", Boundary(places, sigma_m=0.4, recorded=said))
        assert recorded({"boundary": str(tmp_path / "field.geojson")}) == (said, bool(said))
    assert recorded({"boundary": LONGER}) == (None, False), "drawn, by its few corners"
    assert recorded({"boundary": {"laps": 1, "cep_m": 1.0}}) == (False, False)
    turns = [math.tau * k / 40 for k in range(40)]
    oval = [[20.0 * math.cos(t), 12.0 * math.sin(t)] for t in turns]
    assert recorded({}, field={"polygon": oval}) == (True, True)
    assert recorded({"boundary": oval}) == (None, True), "by its many points"


def test_who_recorded_the_edge_begins_where_the_walk_began() -> None:
    """No corner of such an edge is to be told from the next: the told one nearest to the true one
    may be another."""
    turns = [math.tau * k / 40 for k in range(40)]
    round_ = [[18.0 * math.cos(t), 18.0 * math.sin(t)] for t in turns]
    for seed in range(6):
        world = {"seed": seed, "start": {"corner": 0}, "field": {"polygon": round_}}
        told = load("default", {**world, "belief": {}}).told
        assert told.boundary_recorded
        assert told.corner == 0


def test_a_field_that_bends_is_walked_as_its_edge_runs() -> None:
    """More corners than straight sides are looked for: an owner would survey it --irregular."""
    turns = [math.tau * k / 40 for k in range(40)]
    oval = [[20.0 * math.cos(t), 12.0 * math.sin(t)] for t in turns]
    told = load("default", {"field": {"polygon": oval}}).told
    believed, true = shapely.Polygon(told.boundary), shapely.Polygon(oval)
    assert 12 < len(told.boundary) < 80
    assert believed.area == pytest.approx(true.area, rel=0.1)
    middle = shapely.affinity.translate(
        believed,
        true.centroid.x - believed.centroid.x,
        true.centroid.y - believed.centroid.y,
    )
    assert middle.exterior.hausdorff_distance(true.exterior) < 1.5


def test_a_field_whose_walks_have_no_straight_sides_is_walked_so_too() -> None:
    """Few corners that hardly turn: no walk shows them, and the message advises --irregular."""
    ring = [list(point) for point in outline(77).ring]
    told = load("default", {"seed": 77, "field": {"polygon": ring}}).told
    assert told.boundary_sigma_m > 0.0
    believed, true = shapely.Polygon(told.boundary), shapely.Polygon(ring)
    assert believed.area == pytest.approx(true.area, rel=0.1)


def test_whoever_is_told_of_fewer_corners_puts_the_machine_at_the_field_s_own_corner() -> None:
    """A side of the belief is ten edges of the field: what is like its middle is no corner."""
    true = tuple((float(x), float(y)) for x, y in outline_field(49).world.corners)
    believed = tuple(shapely.Polygon(true).simplify(0.3).exterior.coords[:-1])
    assert len(believed) < len(true) / 1.5
    for corner, place in enumerate(believed):
        found = corner_like(believed, corner, true)
        assert math.dist(true[found], place) < 1.5
