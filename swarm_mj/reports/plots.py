"""The linked plots: pointing error, wheel speed, coverage and links over one axis of time, as a plotly figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from swarm_mj.figures.palette import BLUE, GREY, MODE_STYLES, SPACECRAFT, VERMILLION, spacecraft_colours
from swarm_mj.figures.units import TimeAxis, note_of_omission, time_axis
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports.replay import Replay
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.spacecraft.properties import RPM
from swarm_mj.typing import Array, Mask

#: Exponent of ten below which pointing errors [deg] are rounding; zero has no place on a logarithmic axis.
FLOOR = -8
#: More spacecraft than these are not drawn one by one.
MAX_CURVES = len(SPACECRAFT)
#: The page replaces this colour by one that stands out from its background.
INK = "#010203"
COLOURS_OF_RUNS = (BLUE, VERMILLION)
NAMES = (
    "pointing error [deg]",
    "fastest wheel [rpm]",
    "observed share of the target P<sub>TO</sub> [%]",
    "+z and links (colours below)",
)
NAMES_OF_TWO = (
    "largest pointing error of the swarm [deg]", "fastest wheel of the swarm [rpm]", NAMES[2], "closed links",
)  # fmt: skip
#: Heights of the upper three plots, of the lowest at least, and of its rows, and the room between plots [px].
HEIGHTS_PX, LOWEST_PX, ROW_PX, GAP_PX = (170, 125, 165), 150, 22, 52
MARGINS_PX = {"l": 46, "r": 10, "t": 64, "b": 108}
#: How far below the last plot its legend begins, and its axis title below the numbers [px].
LEGEND_BELOW_PX, TITLE_BELOW_PX = 40, 4
#: Size of letters at powers of ten, which plotly draws larger than other numbers by a quarter [px].
POWER_PX = 9.6
#: How far below its mode a closed link is drawn [px].
LINK_BELOW_PX = 9


def plot_run(run: RunRecord, replay: Replay) -> go.Figure:
    """All plots of one run."""
    figure, axis = _frame(run, _names(run, replay), len(replay.rows)), time_axis(float(run.times[-1]))
    times = replay.times / axis.seconds
    if len(replay.shown) <= MAX_CURVES:
        colours = spacecraft_colours(len(replay.shown))
        for position, j in enumerate(replay.shown):
            _spacecraft_curves(figure, run.names[j], colours[position], times, replay, position, j < run.n_observers)
    else:
        _swarm_curves(figure, times, replay)
    _coverage_curves(figure, run, times, replay)
    _wheel_limit(figure, run)
    _timeline(figure, run, replay, axis)
    _limit_axes(figure, [replay])
    return figure


def plot_two(runs: Sequence[RunRecord], replays: Sequence[Replay], labels: Sequence[str]) -> go.Figure:
    """The plots of two runs over each other: of each the worst of its swarm, its coverage and its closed links."""
    longest = max(runs, key=lambda run: run.times[-1])
    figure, axis = _frame(longest, NAMES_OF_TWO, 0), time_axis(float(longest.times[-1]))
    for run, replay, label, colour, dash in zip(runs, replays, labels, COLOURS_OF_RUNS, ("solid", "dash"), strict=True):
        times = replay.times / axis.seconds
        curves = (
            np.maximum(np.fmax.reduce(replay.pointing_peak_deg, axis=1), 10.0**FLOOR),
            replay.wheel_peak_rpm.max(axis=1),
            replay.percent,
            run.telemetry["link_closed"].values[replay.samples].sum(axis=1),
        )
        for row, values in enumerate(curves, start=1):
            style = {"color": colour, "dash": dash, "width": 2, "shape": "hv" if row > 2 else "linear"}
            _curve(figure, row, times, values, label, style, legend=row == 1)
    for run in runs:
        _wheel_limit(figure, run)
    figure.update_yaxes(rangemode="tozero", row=4, col=1)
    _limit_axes(figure, replays)
    return figure


def _frame(run: RunRecord, names: Sequence[str], timeline_rows: int) -> go.Figure:
    """Four empty plots under each other, each with its name above it, so that narrow pages lose no room at the side."""
    axis = time_axis(float(run.times[-1]))
    heights = [*HEIGHTS_PX, max(LOWEST_PX, ROW_PX * timeline_rows)]
    inside = sum(heights) + 3 * GAP_PX
    figure = make_subplots(rows=4, cols=1, shared_xaxes=True, vertical_spacing=GAP_PX / inside, row_heights=heights)
    for row, name in enumerate(names, start=1):
        _headline(figure, row, name)
    title = {"text": f"time since deployment [{axis.unit}]", "standoff": TITLE_BELOW_PX}
    figure.update_xaxes(title=title, row=4, col=1)
    figure.update_xaxes(hoverformat=".3~f", range=[0.0, float(run.times[-1]) / axis.seconds])
    figure.update_yaxes(type="log", exponentformat="power", dtick=2, tickfont={"size": POWER_PX}, row=1, col=1)
    figure.update_yaxes(range=[-4.0, 106.0], row=3, col=1)
    figure.update_layout(
        hovermode="x",
        dragmode="zoom",
        margin=MARGINS_PX,
        legend={"orientation": "h", "x": 0.0, "y": 1.03, "yanchor": "bottom"},
        # Hung below the title: standing on the page's bottom it would push the title up where it has several lines.
        legend2={"orientation": "h", "x": 0.0, "y": -LEGEND_BELOW_PX / inside, "yanchor": "top"},
        height=inside + MARGINS_PX["t"] + MARGINS_PX["b"],
        uirevision="kept",
        shapes=[marker(last_arrival_s(run.scenario) / axis.seconds, GREY, "dash")],
    )
    return figure


def _names(run: RunRecord, replay: Replay) -> tuple[str, ...]:
    peaks = "" if len(replay.samples) == len(run.times) else ", largest between points"
    last = f"{NAMES[3]}{note_of_omission(run.n, replay.rows)}"
    return f"{NAMES[0]}{peaks}", f"{NAMES[1]}{peaks}", NAMES[2], last


def _headline(figure: go.Figure, row: int, text: str) -> None:
    """Quantity and unit over the upper left corner of a plot."""
    place = {"xref": "paper", "x": 0.0, "xanchor": "left", "yref": f"y{row if row > 1 else ''} domain", "y": 1.0}
    figure.add_annotation(text=text, showarrow=False, yanchor="bottom", **place)


def marker(x: float, colour: str, dash: str) -> dict[str, Any]:
    """A vertical line through all plots."""
    line = {"color": colour, "width": 1.5, "dash": dash}
    return {"type": "line", "x0": x, "x1": x, "xref": "x", "y0": 0.0, "y1": 1.0, "yref": "paper", "line": line}


def _curve(
    figure: go.Figure, row: int, x: Array, y: Any, name: str, line: dict[str, Any], *, legend: bool = False
) -> None:
    x, y = np.asarray(x, np.float32), np.asarray(y, np.float32)
    curve = go.Scatter(x=x, y=y, name=name, mode="lines", line=line, legendgroup=name, showlegend=legend)
    curve.hovertemplate = "%{y:.2e}" if row == 1 else "%{y:.4g}"
    figure.add_trace(curve, row=row, col=1)


def _spacecraft_curves(
    figure: go.Figure, name: str, colour: str, times: Array, replay: Replay, position: int, observes: bool
) -> None:
    line = {"color": colour, "width": 1.5}
    _curve(figure, 1, times, np.maximum(replay.pointing_peak_deg[:, position], 10.0**FLOOR), name, line, legend=True)
    _curve(figure, 2, times, replay.wheel_peak_rpm[:, position], name, line)
    if observes:
        _curve(figure, 3, times, replay.percent_by[:, position], name, {**line, "shape": "hv"})


def _swarm_curves(figure: go.Figure, times: Array, replay: Replay) -> None:
    """Largest and median of a swarm that is too large for single curves."""
    for word, reduce, dash in (("largest", np.fmax.reduce, "solid"), ("median", _median, "dot")):
        line = {"color": BLUE, "width": 1.8, "dash": dash}
        error = np.maximum(reduce(replay.pointing_peak_deg, axis=1), 10.0**FLOOR)
        _curve(figure, 1, times, error, f"{word} of the swarm", line, legend=True)
        _curve(figure, 2, times, reduce(replay.wheel_peak_rpm, axis=1), f"{word} of the swarm", line)


def _median(values: Array, axis: int) -> Array:
    """The median of what is not NaN; NaN where all is."""
    return np.asarray(np.ma.median(np.ma.masked_invalid(values), axis=axis).filled(np.nan))


def _coverage_curves(figure: go.Figure, run: RunRecord, times: Array, replay: Replay) -> None:
    _curve(figure, 3, times, replay.percent, "whole swarm", {"color": INK, "width": 3, "shape": "hv"}, legend=True)
    if run.scenario.observation.criterion == "arrival":
        line = {"color": INK, "width": 1.5, "dash": "dot", "shape": "hv"}
        _curve(figure, 3, times, replay.percent_passage, "whole swarm, whole passage", line, legend=True)


def _wheel_limit(figure: go.Figure, run: RunRecord) -> None:
    limit = float(run.telemetry.attrs["wheel_max_speed_rad_s"]) / RPM
    line = {"color": VERMILLION, "width": 1.2, "dash": "longdash"}
    figure.add_shape(type="line", x0=0, x1=1, xref="x2 domain", y0=limit, y1=limit, yref="y2", line=line)


def _timeline(figure: go.Figure, run: RunRecord, replay: Replay, axis: TimeAxis) -> None:
    """One row per spacecraft: what it tracks, and below when its link is closed."""
    rows, modes = len(replay.rows), replay.mode[:, replay.rows]
    times = replay.times / axis.seconds
    for mode in np.unique(modes):
        style = MODE_STYLES[mode]
        flags = modes == mode
        _bars(figure, times, flags, 0.0, style.words, style.line_colour, 9)
    below = LINK_BELOW_PX * rows / max(LOWEST_PX, ROW_PX * rows)
    _bars(figure, times, replay.link[:, replay.rows] == 1, below, "link closed", INK, 4)
    # Bars have no point at most times.
    feeler: dict[str, Any] = {"mode": "lines", "opacity": 0.0, "showlegend": False, "hoverinfo": "none"}
    figure.add_trace(go.Scatter(x=times, y=np.full(len(times), (rows - 1) / 2), **feeler), row=4, col=1)
    name_rows(figure, [run.names[j] for j in replay.shown[replay.rows]], row=4, col=1)


def name_rows(figure: go.Figure, names: Sequence[str], **place: int) -> None:
    """Let the vertical axis name rows, the first on top."""
    ticks, span = {"tickvals": list(range(len(names))), "ticktext": names}, [len(names) - 0.4, -0.6]
    figure.update_yaxes(**ticks, range=span, showgrid=False, fixedrange=True, **place)


def _bars(figure: go.Figure, times: Array, flags: Mask, offset: float, name: str, colour: str, width: int) -> None:
    """Thick lines where a flag (K, rows) holds; each sample stands until the next."""
    until, x, y = np.append(times, times[-1]), [], []
    for row in range(flags.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate(([False], flags[:, row], [False])).astype(np.int8)))
        for start, end in edges.reshape(-1, 2):
            x += [float(until[start]), float(until[end]), None]
            y += [row + offset, row + offset, None]
    figure.add_trace(
        go.Scatter(x=x, y=y, mode="lines", name=name, line={"color": colour, "width": width}, hoverinfo="skip",
                   legend="legend2", legendgroup=f"row {name}", showlegend=bool(x)),
        row=4, col=1,
    )  # fmt: skip


def _limit_axes(figure: go.Figure, replays: Sequence[Replay]) -> None:
    """Round limits of the logarithmic axis, and a wheel axis that shows the limit or, far below it, the curves."""
    errors = [np.maximum(replay.pointing_peak_deg, 10.0**FLOOR) for replay in replays]
    low, high = min(np.nanmin(e) for e in errors), max(np.nanmax(e) for e in errors)
    figure.update_yaxes(range=[np.floor(np.log10(low)) - 0.3, np.ceil(np.log10(high)) + 0.3], row=1, col=1)
    figure.update_yaxes(rangemode="tozero", row=2, col=1)
