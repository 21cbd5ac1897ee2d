"""What is declared is compiled before it is called."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba.core import types

from host.core import compiled


@pytest.fixture(autouse=True)
def _no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "_declared", [])


def declared(*kinds: compiled.Types) -> Any:
    def first(values: Any) -> Any:
        return values[0]

    return compiled.compiled(*kinds)(first)


def test_each_declared_function_is_compiled_for_its_types_and_no_others() -> None:
    one, two = declared("(f8[::1],)", (types.uint8[:, :],)), declared("(i8[::1],)")
    assert one.signatures == two.signatures == []
    steps = list(compiled.make_ready())
    assert steps == [(0, 3, "first"), (1, 3, "first"), (2, 3, "first")]
    assert set(one.signatures) == {(types.float64[::1],), (types.uint8[:, :],)}
    assert set(two.signatures) == {(types.int64[::1],)}


def test_what_is_ready_is_called_as_it_is() -> None:
    one = declared("(f8[::1],)")
    list(compiled.make_ready())
    assert one(np.array([3.0, 4.0])) == 3.0
    assert one.signatures == [(types.float64[::1],)]


def test_what_is_ready_is_cached_for_whoever_calls_it_unprepared() -> None:
    """As the bench does, with the same code."""
    one = declared("(f8[::1],)")
    list(compiled.make_ready())
    unprepared = compiled.compiled()(one.py_func)
    assert unprepared(np.array([3.0, 4.0])) == 3.0
    assert sum(unprepared.stats.cache_hits.values()) == 1
