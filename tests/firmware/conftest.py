"""Targets for the tests: the desk build always, simavr where it was built."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from hil.firmware import targets
from hil.firmware.targets import Target

Maker = Callable[..., Target]


def maker_of(name: str) -> Maker:
    """`targets.desk` or `targets.avr`; skips where that is not built."""
    needed = {
        "desk": [targets.DESK_LIBRARY],
        "avr": [targets.AVR_LIBRARY, targets.AVR_IMAGE],
    }[name]
    missing = [str(path) for path in needed if not path.exists()]
    if missing:
        pytest.skip(f"not built: {', '.join(missing)} (run `make build`)")
    return targets.desk if name == "desk" else targets.avr


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
