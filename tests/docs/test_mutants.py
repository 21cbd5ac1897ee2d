"""The lists of deliberate breaks are of today's code."""

from __future__ import annotations

from pathlib import Path

from tools import mutate_board, mutate_python

ROOT = Path(__file__).parents[2]


def test_each_break_is_of_a_text_that_stands_there_once() -> None:
    assert len(mutate_python.mutants()) >= 50


def test_each_break_of_a_board_is_of_a_text_that_stands_there_once() -> None:
    for mutant in mutate_board.listed():
        assert mutant.changed((ROOT / mutant.file).read_text(encoding="utf-8"))


def test_each_of_the_first_firmware_s_twelve_mistakes_can_be_brought_back() -> None:
    assert {mutant.item for mutant in mutate_board.listed()} - {0} == set(range(1, 13))
