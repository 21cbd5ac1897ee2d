"""Compiles what numba keeps compiled, once and before the tests.

    python tools/precompile.py

In a fresh clone that is a minute and a half of one core. Workers that begin together would each
compile the same, and a function that two of them need is not waited for.
"""

from __future__ import annotations

from typing import Any, Final

from hil.bench.harvest import Harvest
from hil.scenario.scenario import load
from host.runs.ready import make_ready

DRIVES: Final[tuple[dict[str, Any], ...]] = ({"eyes": "model"}, {"camera": "low"})
"""Between them they call what plant and bench compile; what the host does, it declares."""


def main() -> None:
    """A second of each drive is enough: nothing is compiled later than a step that needs it."""
    make_ready()
    for options in DRIVES:
        run = Harvest(load("small", {"limits": {"time_s": 1.0}} | options))
        run.run()
        run.close()


if __name__ == "__main__":
    main()
