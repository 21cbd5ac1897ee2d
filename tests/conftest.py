"""Of all tests: how long an example takes says nothing about whether a fact holds.

The examples of `make test` are the same in every run, so that a change is judged by what it
changed. HYPOTHESIS_PROFILE=explore draws new ones, as `make test-long` does.

`make check` leaves out what drives a whole machine, draws many pictures or takes a browser: the
folders and files of SLOW.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("daranti", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "daranti"))

TESTS = Path(__file__).parent
SLOW = (
    "firmware",
    "hil/bench",
    "hil/firmware",
    "hil/report",
    "hil/scenario/test_random_fields.py",
    "hil/studies",
    "host/check",
    "host/commands/test_fuzz.py",
    "host/field/test_survey.py",
    "host/panel",
    "host/pilot/test_first_round.py",
    "host/pilot/test_irregular_fields.py",
    "host/pilot/test_learning.py",
    "host/pilot/test_navigation.py",
    "host/pilot/test_pilot.py",
    "host/pilot/test_pilot_doubt.py",
    "host/pilot/test_pilot_dust.py",
    "host/route/test_preview.py",
    "host/runs",
    "host/tune",
    "host/vision",
    "panel",
    "sim_plant/test_cache.py",
    "sim_plant/test_camera.py",
    "test_rooms.py",
)


def is_slow(path: Path) -> bool:
    """Whether a file of tests is left out of `make check`."""
    return path.relative_to(TESTS).as_posix().startswith(SLOW)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """What is left out is not even read: what it imports takes as long as a quarter of the rest."""
    left_out = "not slow" in config.option.markexpr and is_slow(collection_path)
    return True if left_out else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what is slow by where it lies."""
    for item in items:
        if is_slow(item.path):
            item.add_marker(pytest.mark.slow)
