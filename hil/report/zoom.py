"""Plots over time that can be zoomed in a page, without a server or a request to anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from bokeh.embed import components
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource, DataRange1d, HoverTool, Range1d
from bokeh.plotting import figure
from bokeh.resources import Resources
from numpy.typing import NDArray

from hil.judge.plots import PHASES, SURE, Series

MOST_POINTS = 40_000
"""Of one line; a longer record is thinned."""
TOOLS = "xwheel_zoom,xpan,xbox_zoom,reset"
COLOURS = {"tab:blue": "#1f77b4", "tab:orange": "#ff7f0e", "tab:green": "#2ca02c",
           "tab:brown": "#8c564b", "tab:purple": "#9467bd", "tab:cyan": "#17becf",
           "tab:red": "#d62728"}  # fmt: skip

Line = tuple[str, NDArray[np.float64], NDArray[np.float64], str]
"""(name, times in s, values, colour)."""


def _html(colour: str) -> str:
    """Matplotlib's name of a colour as HTML has it."""
    if colour in COLOURS:
        return COLOURS[colour]
    grey = round(255 * float(colour))
    return f"#{grey:02x}{grey:02x}{grey:02x}"


def _panel(title: str, lines: Sequence[Line], x_range: DataRange1d, height: int = 190) -> figure:
    panel = figure(
        height=height, sizing_mode="stretch_width", x_range=x_range, tools=TOOLS,
        active_scroll="xwheel_zoom", active_drag="xpan", y_axis_label=title,
        output_backend="canvas",
    )  # fmt: skip
    for name, t, values, colour in lines:
        step = max(1, -(-len(t) // MOST_POINTS))
        source = ColumnDataSource({"t": t[::step], "v": values[::step].astype(np.float32)})
        panel.line("t", "v", source=source, color=_html(colour), legend_label=name, line_width=1.3)
    panel.add_tools(HoverTool(tooltips=[("s", "@t{0.00}"), ("", "@v{0.000}")], mode="vline"))
    panel.legend.click_policy = "hide"
    panel.legend.location = "top_right"
    panel.legend.orientation = "horizontal"
    return panel


def _states(data: Series, x_range: DataRange1d) -> figure:
    end = float(data.telemetry[-1, 0])
    since = [stamp for stamp, _, _ in data.phases]
    until = [*since[1:], end][: len(since)]
    source = ColumnDataSource(
        {
            "since": since,
            "until": until,
            "phase": [phase for _, phase, _ in data.phases],
            "why": [why for _, _, why in data.phases],
            "colour": [_html(PHASES.get(phase, "0.9")) for _, phase, _ in data.phases],
        }
    )
    panel = figure(
        height=90, sizing_mode="stretch_width", x_range=x_range, tools=TOOLS,
        y_range=Range1d(start=0, end=1), active_scroll="xwheel_zoom", active_drag="xpan",
        x_axis_label="time (s)", y_axis_label="state",
    )  # fmt: skip
    panel.quad(left="since", right="until", bottom=0, top=1, color="colour", source=source)
    panel.add_tools(HoverTool(tooltips="@phase: @why"))
    panel.yaxis.major_tick_line_color = None
    panel.yaxis.major_label_text_font_size = "0pt"
    return panel


def over_time(data: Series) -> str:
    """The HTML of a record's plots over time, linked; `resources` belongs into the page once."""
    x_range = DataRange1d(start=0.0, end=float(data.telemetry[-1, 0]))
    t, told, view = data.telemetry[:, 0], data.telemetry, data.view
    sure = view[:, 2] >= SURE
    offset = 100 * view[:, 1]
    speeds: list[Line] = [
        ("asked", data.command[:, 0], data.command[:, 1], "tab:orange"),
        ("blade asked (0 or 0.1)", data.command[:, 0], 0.1 * data.command[:, 2], "tab:red"),
    ]
    if len(data.truth):
        speeds.insert(1, ("true", data.truth[:, 0], data.truth[:, 3], "tab:blue"))
    panels = [
        _panel("steering (°, left +)", [("angle", t, told[:, 2], "tab:blue"),
                                        ("setpoint", t, told[:, 1], "tab:orange")], x_range),
        _panel("duty (of 255)", [("steering", t, told[:, 3], "tab:green"),
                                 ("drive", t, told[:, 4], "tab:brown")], x_range),
        _panel("edge (cm, left +)",
               [("sure", view[:, 0], np.where(sure, offset, np.nan), "tab:blue"),
                ("not sure", view[:, 0], np.where(sure, np.nan, offset), "0.6")], x_range),
        _panel("speed (m/s)", speeds, x_range),
        _panel("battery (V)", [("battery", t, told[:, 5], "tab:brown")], x_range, 120),
        _states(data, x_range),
    ]  # fmt: skip
    for stamp, _, begins in data.faults:
        dash = "solid" if begins else "dotted"
        for panel in panels:
            panel.vspan(x=[stamp], line_color="#d62728", line_dash=dash)
    grid = gridplot(
        [[panel] for panel in panels], sizing_mode="stretch_width", toolbar_options={"logo": None}
    )
    script, place = components(grid)
    return f"{place}\n{script}"


def resources(plots: Iterable[str]) -> str:
    """The scripts that a page with such plots needs inside; none without."""
    return str(Resources(mode="inline", components=["bokeh"]).render()) if any(plots) else ""
