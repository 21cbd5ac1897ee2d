"""Facts about what reaches the terminal: text is only text, and a table's figures are whole."""

from __future__ import annotations

import io

import pytest
from rich.table import Table

from host.core.terminal import PlainConsole

HEADS = ("field", "lateral_rms_m", "end_of_field_error_worst_m", "neighbour_cut_m2", "outside_m")
FIGURES = ("12345.678901", "-98765.432109", "0.0000123456789", "31415.9265358979")


def shown(table: Table, *, terminal: bool, width: int = 80) -> str:
    out = io.StringIO()
    console = PlainConsole(
        file=out, width=width, force_terminal=terminal, color_system=None, legacy_windows=False
    )
    console.print_table(table)
    return out.getvalue()


def wide() -> Table:
    table = Table(*HEADS, title="[/nope] of a \x1b[2Jfield")
    table.add_row("[bold]north[/nope]", *FIGURES)
    table.add_row("south", *reversed(FIGURES))
    return table


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("width", [20, 80, 200])
def test_no_figure_of_a_table_is_cut_whatever_the_width(terminal: bool, width: int) -> None:
    text = shown(wide(), terminal=terminal, width=width)
    for word in (*HEADS, *FIGURES, "[bold]north[/nope]", r"[/nope] of a \x1b[2Jfield"):
        assert word in text, word
    assert "…" not in text
    assert "\x1b[2J" not in text


def test_into_a_file_every_row_is_one_line() -> None:
    table = Table("name", "meaning", box=None)
    table.add_row("steer_kp", "word " * 60)
    assert len(shown(table, terminal=False).splitlines()) == 2


def test_what_fits_stays_a_table() -> None:
    table = Table("a", "b", box=None)
    table.add_row("1", "2")
    assert shown(table, terminal=True).splitlines()[1].split() == ["1", "2"]
