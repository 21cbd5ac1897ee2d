"""What is loaded before a drive costs no time in it."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from host.pilot.pilot import Pilot
from host.runs.ready import make_ready


@pytest.fixture(autouse=True)
def _thawed() -> Iterator[None]:
    """Other tests drive, too."""
    gc.unfreeze()
    yield
    gc.unfreeze()


def test_pythons_collector_looks_no_more_through_what_is_loaded() -> None:
    assert any(each is Pilot for each in gc.get_objects())
    make_ready()
    later = [[]]
    left = gc.get_objects()
    assert not any(each is Pilot for each in left)
    assert any(each is later for each in left)
