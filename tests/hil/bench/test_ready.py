"""Once it is ready, nothing is compiled while the machine drives: the firmware waits for a command
no longer than 250 ms, and a function takes seconds."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from multiprocessing import get_context
from typing import Any

import pytest

from hil.bench.harvest import Harvest
from hil.scenario.scenario import load
from host.runs.ready import make_ready

AROUND = {"size_m": [7.0, 6.0], "keep_outs": [[[3.5, 2.5], [4.0, 2.5], [4.0, 3.0], [3.5, 3.0]]]}
"""A field with a keep-out in its middle."""
DRIVES: dict[str, dict[str, Any]] = {
    "a whole field by the model": {"eyes": "model", "field": AROUND},
    "pictures from the mast": {"camera": "mast", "limits": {"time_s": 80.0}},
    "pictures from low": {"camera": "low", "limits": {"time_s": 40.0}},
    "the paper's colours": {"mode": "paper", "limits": {"time_s": 10.0}},
}


def compiled_of_the_host() -> Iterator[tuple[str, Any]]:
    for name, module in list(sys.modules.items()):
        if name.startswith("host."):
            for function in vars(module).values():
                if getattr(getattr(function, "py_func", None), "__module__", "") == name:
                    yield f"{name}.{function.py_func.__name__}", function


def compiled_in_drives() -> dict[str, list[str]]:
    """By drive, one after the other, once all is ready."""
    make_ready()
    known = {name: set(f.signatures) for name, f in compiled_of_the_host()}
    found: dict[str, list[str]] = {}
    for drive, options in DRIVES.items():
        run = Harvest(load("small", options))
        run.run()
        run.close()
        found[drive] = []
        for name, f in compiled_of_the_host():
            new = set(f.signatures) - known.get(name, set())
            found[drive] += [f"{name} {types}" for types in new]
            known.setdefault(name, set()).update(new)
    return found


@pytest.mark.slow
def test_nothing_is_compiled_while_the_machine_drives() -> None:
    with get_context("spawn").Pool(1) as fresh:
        assert fresh.apply(compiled_in_drives) == {drive: [] for drive in DRIVES}
