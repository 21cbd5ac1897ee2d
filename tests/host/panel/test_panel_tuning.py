"""Tuning from the page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest

from host.core.errors import UserError
from host.panel import tuning
from host.panel.machine import Machine


def test_the_board_is_stopped_before_the_fit_that_takes_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An armed one would fault: it waits 250 ms for a command."""
    done: list[str] = []

    @contextmanager
    def armed(*_: Any) -> Iterator[Any]:
        yield SimpleNamespace(identify=lambda: done.append("experiments"))
        done.append("stop")

    @contextmanager
    def doing(*_: Any) -> Iterator[None]:
        yield

    def fit(_: Any) -> None:
        done.append("fit")
        raise UserError("enough")

    monkeypatch.setattr(tuning, "armed", armed)
    monkeypatch.setattr(tuning, "fit", fit)
    monkeypatch.setattr(tuning.params, "read_all", lambda _: {})
    machine = SimpleNamespace(
        link=object(),
        board_ready=True,
        doing=doing,
        settings=SimpleNamespace(port="/dev/ttyACM0"),
        settle=lambda: done.append("at rest"),
    )
    with pytest.raises(UserError, match="enough"):
        tuning.tune(cast(Machine, machine), {})
    assert done == ["experiments", "stop", "at rest", "fit"]
