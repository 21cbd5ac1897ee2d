"""Targets for the tests: the desk build always, simavr where it was built."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from hil.firmware import provision, targets
from hil.firmware.targets import Target
from tests.helpers.firmware_bench import TOLD

Maker = Callable[..., Target]


ERASED = b"\xff" * targets.EEPROM_SIZE
"""A memory that nothing was ever written to."""


def maker_of(name: str) -> Maker:
    """Makes targets of a kind, set up as the default machine's owner does where no memory is given;
    skips where that is not built."""
    needed = {
        "desk": [targets.DESK_LIBRARY],
        "avr": [targets.AVR_LIBRARY, targets.AVR_IMAGE],
    }[name]
    missing = [str(path) for path in needed if not path.exists()]
    if missing:
        pytest.skip(f"not built: {', '.join(missing)} (run `make build`)")
    make_bare = targets.desk if name == "desk" else targets.avr

    def make(eeprom: bytes | None = None) -> Target:
        return make_bare(eeprom or provision.eeprom(tuple(TOLD.items())))

    return make


@pytest.fixture(params=["desk", "avr"])
def make_target(request: pytest.FixtureRequest) -> Iterator[Maker]:
    """Makes targets of one kind, and closes them after the test."""
    made: list[Target] = []
    maker = maker_of(request.param)

    def make(eeprom: bytes | None = None) -> Target:
        made.append(maker(eeprom))
        return made[-1]

    yield make
    for target in made:
        target.close()
