"""A machine of its own for a study that else knows one machine only: lengths, motors, sensors,
mount and lens as random fields draw them, measured as its owner measures them."""

from __future__ import annotations

from pathlib import Path

from hil.scenario.belief import VEHICLE_FILE
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, changed
from hil.studies.commissioning import commission, walk_of


def own_machine(base: Scenario, seed: int, owner: Path) -> Scenario:
    """The scenario with the machine of that seed's random field. Its owner's files, of
    `daranti-hil commission` on that field, lie in a folder, and are made where they are not there
    yet; the boundary of the scenario's own field is known."""
    home = random_field(seed)
    if not (owner / VEHICLE_FILE).exists():
        commission(home, owner, walk_of(home))
    return changed(
        base,
        {
            "seed": seed,
            "machine": home.machine.model_dump(),
            "camera": home.camera,
            "lens": home.lens,
            "gyro": home.gyro.model_dump(),
            "belief": {
                "folder": str(owner),
                "boundary": base.world.corners,
                "gap_m": base.field.gap_m,
                "vehicle": {"crop_height_m": base.field.crop_height_m},
            },
        },
    )
