"""The account of the estimator's honesty, and of the constants."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hil.studies.consistency import Watcher, overview
from hil.studies.constants import Constant, Figures, found, varied
from host.core.vehicle import Vehicle
from host.estimate.position import Position
from host.estimate.prior import PLAN_SIGMA_RAD
from host.pilot.phase import Phase
from host.route.plan import spiral


def run(nees: float, rms: float) -> dict[str, object]:
    figures = {"nees": nees, "within": 0.9, "rms": rms, "worst": 2 * rms, "samples": 9}
    return {"seed": 1, "lane": figures}


def test_an_overview_is_the_mean_of_the_fields_with_its_doubt() -> None:
    [line] = overview([run(1.0, 0.03), run(3.0, 0.04)])
    assert (line.measure, line.runs, line.nees, line.median) == ("lane", 2, 2.0, 2.0)
    assert line.nees_high - line.nees == pytest.approx(12.706, abs=0.01), "Student's t, 1 degree"
    assert line.rms == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2))
    assert line.worst == 0.08
    assert overview([run(1.0, 0.03)])[0].nees_high == math.inf, "one field says nothing of others"


TRUE = [(0.0, 0.0), (20.0, 0.0), (20.0, 15.0), (0.0, 15.0)]
WALKED_OFF_M = (1.5, -0.8)


def seen_by_the_watcher(
    nearer_m: float, sigma_m: float, turned_deg: float = 0.0
) -> dict[str, tuple[float, float]]:
    """(squared in variances, error in m or rad) of a machine on its first lane in a field that was
    walked to sigma_m a corner, as a whole WALKED_OFF_M elsewhere; so much nearer to the border
    behind its lane, and so much farther to the left, than it believes."""
    vehicle = Vehicle()
    dx, dy = WALKED_OFF_M
    walked = [(x + dx, y + dy) for x, y in TRUE] if sigma_m else TRUE
    position = Position(vehicle, walked, sigma_m)
    position.place(spiral(walked, 0, vehicle).sides[0], 8.0, 0.0, 0.0, (0.1, 0.05, 1e-4))
    x, y, yaw = position.pose
    off = (dx, dy) if sigma_m else (0.0, 0.0)
    told = SimpleNamespace(vehicle=vehicle, boundary=tuple(walked))
    run = SimpleNamespace(
        bench=SimpleNamespace(
            now=5.0, pose=(x - off[0], y - off[1] - nearer_m, yaw + math.radians(turned_deg))
        ),
        pilot=SimpleNamespace(phase=Phase.TURN, position=position),
        scenario=SimpleNamespace(told=told, world=SimpleNamespace(corners=tuple(TRUE))),
    )
    watcher = Watcher(cast(Any, run))
    assert not watcher.enough(), "the run goes on"
    return {measure: (squared, error) for measure, squared, error in watcher.samples.rows}


@pytest.mark.parametrize("sigma_m", [0.0, 0.3])
@pytest.mark.parametrize("nearer_m", [0.0, 0.1, -0.2])
def test_the_distance_from_the_border_is_judged_wherever_the_walk_has_put_the_field(
    sigma_m: float, nearer_m: float
) -> None:
    seen = seen_by_the_watcher(nearer_m, sigma_m)
    squared, error = seen["border"]
    assert error == pytest.approx(abs(nearer_m), abs=1e-9)
    # The operator has put it so far beside the edge, wherever that lies.
    assert squared == pytest.approx((nearer_m / 0.05) ** 2, rel=0.02, abs=1e-9)
    exact = {"position", "outline"}
    assert exact & set(seen) == (exact if sigma_m == 0.0 else set()), "in one field frame alone"


@pytest.mark.parametrize("turned_deg", [0.0, 2.0, -5.0])
@pytest.mark.parametrize("sigma_m", [0.0, 0.3])
def test_the_direction_is_judged_with_what_is_known_of_how_the_boundary_is_turned(
    sigma_m: float, turned_deg: float
) -> None:
    squared, error = seen_by_the_watcher(0.0, sigma_m, turned_deg)["direction"]
    assert math.degrees(error) == pytest.approx(abs(turned_deg), abs=1e-9)
    by_corners = math.sqrt(2.0) * sigma_m / math.dist(*TRUE[:2])
    by_plan = PLAN_SIGMA_RAD if sigma_m else 0.0
    sigma = math.hypot(1e-4, by_corners, by_plan)
    assert squared == pytest.approx((error / sigma) ** 2, rel=0.02, abs=1e-9)


def test_the_count_takes_numbers_in_capitals_with_the_text_below(tmp_path: Path) -> None:
    room = tmp_path / "host" / "pilot"
    room.mkdir(parents=True)
    (room / "so.py").write_text(
        'A_M = 0.3\n"""Of it."""\nB_RAD = math.radians(4)\nNAME = "no"\nx = 3\n'
        "C_S: Final = 2.0\nD, E = 1, 2\nF = call(3)\n"
    )
    counted = {one.name: one.about for one in found(tmp_path)}
    assert counted == {"A_M": "Of it.", "B_RAD": "", "C_S": "", "D": "", "E": ""}


def test_a_constant_is_varied_wherever_it_was_taken_and_put_back() -> None:
    from host.pilot import gaze  # noqa: PLC0415
    from host.pilot.behaviours import follow  # noqa: PLC0415

    was = gaze.STOP_AFTER_S
    with varied(Constant("host/pilot/gaze.py", "STOP_AFTER_S", ""), 1.5):
        assert gaze.STOP_AFTER_S == follow.STOP_AFTER_S == 1.5 * was
    assert gaze.STOP_AFTER_S == follow.STOP_AFTER_S == was
    assert "host.pilot.gaze" in sys.modules


@pytest.mark.parametrize(
    ("figures", "knife"),
    [
        (Figures("finished", 0.999, 0.03, False, 900.0), False),
        (Figures("fault", 0.999, 0.03, False, 100.0), True),
        (Figures("finished", 0.97, 0.03, False, 100.0), True),
        (Figures("finished", 0.999, 0.08, False, 100.0), True),
        (Figures("finished", 0.999, 0.03, True, 100.0), True),
    ],
)
def test_a_knifes_edge_costs_an_outcome_crop_straightness_or_harm(
    figures: Figures, knife: bool
) -> None:
    assert figures.knife(Figures("finished", 0.999, 0.03, False, 100.0)) is knife
