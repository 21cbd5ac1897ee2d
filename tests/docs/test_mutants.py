"""The list of deliberate breaks is of today's code."""

from __future__ import annotations

from tools import mutate_python


def test_each_break_is_of_a_text_that_stands_there_once() -> None:
    assert len(mutate_python.mutants()) >= 50
