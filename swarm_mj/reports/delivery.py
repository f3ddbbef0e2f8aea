"""The part of the page on the way to Earth: what arrives when, what does not and why, with plots of the contacts and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import sample_colorscale
from plotly.subplots import make_subplots

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.figures.cells import in_one_piece
from swarm_mj.figures.delivery_view import (
    LEAST_PERCENT,
    LINK_STYLES,
    REASON_STYLES,
    AreaStyle,
    LinkHistory,
    busy_until_s,
    cells_by_reason,
    is_proven,
    link_in_swarm,
    links_to_earth,
    on_earth,
    percent_over_time,
    speakers,
    stretches,
)
from swarm_mj.figures.maps import latitude_longitude
from swarm_mj.figures.palette import GREY, LIGHT_GREY, SKY_BLUE, SPACECRAFT, VERMILLION, spacecraft_colours
from swarm_mj.figures.units import TimeAxis, data_unit, instant, note_of_omission, shown_spacecraft, time_axis
from swarm_mj.mission.links import Obstacle
from swarm_mj.mission.target import angles, local_axes, place_of
from swarm_mj.observation.coverage import CoverageMap, percent_text, rounded_up_digits
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports.markup import Content, Html, table, tag
from swarm_mj.reports.plots import INK, marker, name_rows
from swarm_mj.reports.sections import section
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.typing import Array, Mask

HINT = (
    "Dashed line: the arrival; full line: the end of the flight. The plots begin with the first picture and end when data no "
    "longer move, or with the plan where none do; a double-click shows all that was planned."
)
#: Plots of a run, and what they are called.
PLOTS = {"contacts": "Contacts and transfers", "data": "Data on their way", "map": "The map as it arrives"}
#: Colours of the map, and instants of a curve.
CLASSES, INSTANTS = 8, 600
#: Heights of bars, in rows, and of a row and of what is around the rows [px].
CONTACT, TRANSFER, LEAST_TRANSFER = 0.28, 0.45, 0.08
ROW_PX, AROUND_PX, DATA_PX, MAP_PX = 34, 150, 600, 560
#: Opacity of bars that say no more than that nobody wanted to send: on a dark page a pale colour would stand out.
FAINT = 0.2
#: Matplotlib's hatches as plotly writes them.
HATCHES = {"": "", "/": "/", "\\": "\\", "x": "x", ".": ".", "o": "+", "-": "-"}
MARGINS_PX = {"l": 76, "r": 12, "t": 28, "b": 40}
#: How far below a plot its legend stands, so that the axis' numbers and title have room [px].
LEGEND_PX = 46
#: Dashes of single spacecraft, which differ by more than their colour, in the order of `SPACECRAFT`.
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
#: What is shown before the first picture, as a share of the time shown.
BEFORE = 0.03


def delivery_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html | None:
    """What of each run reaches Earth; nothing where none of them knows."""
    if all(run.delivery is None for run in runs):
        return None
    parts: list[Content] = []
    for number, (run, label) in enumerate(zip(runs, labels, strict=True)):
        parts.append(tag("h3", label) if len(runs) > 1 else None)
        if run.delivery is None:
            parts.append(tag("p", "The way to Earth of this run was not computed."))
            continue
        some = note_of_omission(run.n, shown_spacecraft(run.n))
        boxes = []
        for name in _shown(run.delivery):
            words = PLOTS[name]
            head = tag("h3", words, some if name == "contacts" else None)
            box = tag("div", id=box_id(number, name), role="img", aria_label=words)
            boxes.append(tag("figure", head, box, class_=name))
        parts += [tag("p", outcome(run, run.delivery)), _undelivered_table(run)]
        parts += [tag("div", boxes, class_="ways"), tag("p", HINT, class_="soft")]
    return section("delivery", "Delivery to Earth", parts)


def box_id(number: int, name: str) -> str:
    """The id of the box that a plot of a run stands in."""
    return f"way-{number}-{name}"


def outcome(run: RunRecord, delivery: Delivery) -> str:
    """Seen and delivered in words, when the last of it arrives, and what no schedule betters."""
    summary = run.summary
    seen, there = (percent_text(summary[key]) for key in ("coverage_percent", "delivered_percent"))
    words = f"{seen} of the target is seen, {there} reaches Earth. "
    if delivery.complete and len(delivery.tile_area):
        words += f"All that was seen is there at t = {_time(delivery.full_s)}"
        if not np.isnan(delivery.best_full_s):
            words += f"; no schedule of the same slots has it there before t = {_time(float(delivery.best_full_s))}"
        words += ". "
    if summary.get("delivered_percent_bound") is not None:
        words += f"No schedule delivers more than {rounded_up_digits(summary['delivered_percent_bound'])} %. "
    unit, left, lost = data_unit(delivery.seen_bit), delivery.aboard_bit[-1].sum(), delivery.lost_bit[-1].sum()
    amounts = {
        "seen": delivery.seen_bit,
        "delivered": delivery.delivered_bit,
        "left aboard": int(left),
        "lost": int(lost),
    }
    parts = ", ".join(f"{bits / unit.bits:.4g} {unit.unit} {what}" for what, bits in amounts.items())
    told = f"Data: {parts}; a picture may stay aboard where another one shows the same."
    words += told if delivery.seen_bit else "Nothing was on its way."
    return words.replace(" %", "\N{NO-BREAK SPACE}%")


def _time(t: float) -> str:
    return instant(t, time_axis(t))


def _undelivered_table(run: RunRecord) -> Html | None:
    parts = run.summary.get("not_delivered", ())
    rows = [(p["reason"], rounded_up_digits(p["percent"]), ", ".join(p["spacecraft"]), p["remedy"]) for p in parts]
    head = ("reason", "of the target [%]", "seen by", "remedy")
    return table(head, rows, caption="Seen and not delivered") if rows else None


def delivery_figures(run: RunRecord) -> dict[str, go.Figure]:
    """The plots of a run by name; none where its way to Earth was not computed."""
    if run.delivery is None:
        return {}
    makers = {"contacts": contacts_figure, "data": data_figure, "map": map_figure}
    return {name: makers[name](run, run.delivery) for name in _shown(run.delivery)}


def _shown(delivery: Delivery) -> list[str]:
    """Names of the plots; where nothing was seen no data are on their way."""
    return [name for name in PLOTS if name != "data" or delivery.seen_bit]


def contacts_figure(run: RunRecord, delivery: Delivery) -> go.Figure:
    """A row for each spacecraft and each way to Earth: contacts, transfers, and what is in the way."""
    in_swarm = [row for j in shown_spacecraft(run.n) if (row := link_in_swarm(delivery, int(j))) is not None]
    rows = [*in_swarm, *links_to_earth(delivery)]
    axis, names = time_axis(_until_s(run, delivery)), [_name(row, run, delivery) for row in rows]
    found = np.unique(np.concatenate([row.state for row in rows])) if rows else np.empty(0, int)
    figure = go.Figure([_bars(delivery, rows, names, state, axis) for state in LINK_STYLES if state in found])
    figure.add_trace(_transfers(delivery, rows, names, axis))
    name_rows(figure, names)
    _finish(figure, run, delivery, axis, ROW_PX * len(rows) + AROUND_PX)
    figure.update_layout(barmode="overlay", hovermode="closest")
    return figure


def _name(row: LinkHistory, run: RunRecord, delivery: Delivery) -> str:
    others = [run.names[j] for j in speakers(delivery) if j != row.spacecraft]
    to = "Earth" if row.to_earth else others[0] if len(others) == 1 else "relays"
    return f"{run.names[row.spacecraft]} → {to}"


def _bars(delivery: Delivery, rows: Sequence[LinkHistory], names: Sequence[str], state: int, axis: TimeAxis) -> go.Bar:
    found = [
        (place, start / axis.seconds, end / axis.seconds)
        for place, row in enumerate(rows)
        for start, end, there in stretches(delivery.edges_s, row.state)
        if there == state
    ]
    style = LINK_STYLES[state]
    return go.Bar(
        orientation="h",
        y=[place for place, _, _ in found],
        base=[start for _, start, _ in found],
        x=[end - start for _, start, end in found],
        offset=0.0,
        width=CONTACT,
        marker=_painted(style) if state != Obstacle.ROLE else {"color": GREY, "opacity": FAINT},
        name=style.words,
        hovertext=[f"{names[p]}: {style.words}<br>{a:.4g} to {b:.4g} {axis.unit}" for p, a, b in found],
        hoverinfo="text",
    )


def _transfers(delivery: Delivery, rows: Sequence[LinkHistory], names: Sequence[str], axis: TimeAxis) -> go.Bar:
    found = [(place, t, float(row.used[t])) for place, row in enumerate(rows) for t in np.flatnonzero(row.used > 0.0)]
    edges = delivery.edges_s / axis.seconds
    height = [LEAST_TRANSFER + (TRANSFER - LEAST_TRANSFER) * share for _, _, share in found]
    return go.Bar(
        orientation="h",
        y=[place for place, _, _ in found],
        base=[float(edges[t]) for _, t, _ in found],
        x=[float(edges[t + 1] - edges[t]) for _, t, _ in found],
        offset=[-part for part in height],
        width=height,
        marker={"color": VERMILLION, "line": {"width": 0}},
        name="data sent; height: share used",
        hovertext=[f"{names[p]}: {100.0 * share:.3g} % of the link used" for p, _, share in found],
        hoverinfo="text",
    )


def _painted(style: AreaStyle) -> dict[str, Any]:
    return {"color": style.colour, "line": {"width": 0}, "pattern": {**_pattern(style), "size": 6, "solidity": 0.3}}


def _pattern(style: AreaStyle) -> dict[str, Any]:
    return {"shape": HATCHES[style.hatch[:1]], "fgcolor": GREY, "bgcolor": style.colour}


def data_figure(run: RunRecord, delivery: Delivery) -> go.Figure:
    """Data aboard and on Earth over time, and the share of the target that is seen and has arrived."""
    axis = time_axis(_until_s(run, delivery))
    unit = data_unit(max(int(delivery.aboard_bit.max(initial=0)), delivery.delivered_bit))
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.1)
    edges, end = delivery.edges_s / axis.seconds, float(delivery.edges_s[-1])
    if run.n <= len(SPACECRAFT):
        for j, colour in enumerate(spacecraft_colours(run.n)):
            _curve(figure, 1, edges, delivery.aboard_bit[:, j] / unit.bits, f"aboard {run.names[j]}", colour, DASHES[j])
    else:
        _curve(figure, 1, edges, delivery.aboard_bit.max(axis=1) / unit.bits, "aboard the fullest", SPACECRAFT[0])
    own, best = ("on Earth", INK, "solid"), ("on Earth, best by area", GREY, "dot")
    ways = ((own, delivery.earth_bit.astype(np.float64)), (best, delivery.best_earth_bit))
    for (name, colour, dash), sent in ways[: 1 + is_proven(delivery)]:
        times, received = on_earth(delivery, sent)
        x, y = np.append(times, max(end, times[-1])) / axis.seconds, np.append(received, received[-1]) / unit.bits
        _curve(figure, 1, x, y, name, colour, dash)
    if (lost := delivery.lost_bit.sum(axis=1)).any():
        _curve(figure, 1, edges, lost / unit.bits, "lost so far", VERMILLION, "dashdot")
    _area_curves(figure, run, delivery, axis)
    figure.update_yaxes(title=f"data [{unit.unit}]", row=1, col=1)
    figure.update_yaxes(title="share of the target [%]", range=[-4.0, 106.0], row=2, col=1)
    _finish(figure, run, delivery, axis, DATA_PX)
    return figure


def _area_curves(figure: go.Figure, run: RunRecord, delivery: Delivery, axis: TimeAxis) -> None:
    area, by = run.weighted_area, run.coverage["first_seen_by_s"]
    even = np.linspace(0.0, float(delivery.edges_s[-1]), INSTANTS)
    times = np.unique(np.concatenate((even, delivery.tile_arrives_s[delivery.arrived], by[~np.isnan(by)])))
    coverage = CoverageMap(area, len(by))
    coverage.first_seen_by_s = by
    x, total = times / axis.seconds, float(area.sum())
    _curve(figure, 2, x, coverage.percent_over_time(times), "seen", SKY_BLUE, shape="hv")
    _curve(figure, 2, x, percent_over_time(delivery, total, times), "delivered", INK, shape="hv")
    if is_proven(delivery):
        bound = np.full(2, 100.0 / total * float(delivery.best_bound_area))
        _curve(figure, 2, x[[0, -1]], bound, "no schedule delivers more", VERMILLION, "dash")


def _curve(
    figure: go.Figure, row: int, x: Array, y: Array, name: str, colour: str, dash: str = "solid", shape: str = "linear"
) -> None:
    line = {"color": colour, "dash": dash, "width": 2, "shape": shape}
    x, y = np.asarray(x, np.float32), np.asarray(y, np.float32)
    figure.add_trace(go.Scatter(x=x, y=y, name=name, mode="lines", line=line, hovertemplate="%{y:.4g}"), row=row, col=1)


def map_figure(run: RunRecord, delivery: Delivery) -> go.Figure:
    """The target's cells by when they arrive, hatched by the reason where they never do."""
    several = _on_globe(run)
    corners = _flat_corners(run)
    times, area = delivery.arrives_s, run.weighted_area
    figure = go.Figure()
    there = ~np.isnan(times)
    for cells, words, colour in _classes(times, there):
        _cells(figure, corners[cells], words, AreaStyle(words, colour, ""))
    for reason, cells in cells_by_reason(delivery).items():
        words = f"not delivered ({reason}): {rounded_up_digits(_percent(area, cells))} %"
        _cells(figure, corners[cells], words, REASON_STYLES[reason])
    unseen = delivery.tile_of_cell < 0
    if _percent(area, unseen) >= LEAST_PERCENT:
        words = f"not seen: {rounded_up_digits(_percent(area, unseen))} %"
        _cells(figure, corners[unseen], words, AreaStyle("", LIGHT_GREY, ""))
    east = {"text": "east longitude [deg]" if several else "angle east of the target's centre [deg]", "standoff": 4}
    bare, north = {"showgrid": False, "zeroline": False}, "latitude [deg]" if several else "north [deg]"
    figure.update_xaxes(title=east, **bare)
    figure.update_yaxes(title=north, scaleanchor="x", scaleratio=1.0, constrain="domain", **bare)
    figure.update_layout(height=MAP_PX, margin=MARGINS_PX, hovermode="closest", legend=_legend(MAP_PX), showlegend=True)
    return figure


def _flat_corners(run: RunRecord) -> Array:
    """Corners of the cells in the plane, shape (n, 3, 2) [deg]: about the target's axis; of several on the globe."""
    target, corners_A = run.scenario.target, run.coverage["vertices"][run.coverage["faces"]]
    if not _on_globe(run):
        return angles(corners_A, local_axes(target.latitude_deg, target.longitude_deg))
    centroid_A = corners_A.mean(axis=1)
    middle = float(place_of(run.coverage["area"] @ centroid_A)[1])
    centre = target.longitude_deg if target.region == "pyramid" else middle
    flat, around = (np.stack(latitude_longitude(places, centre)[::-1], axis=-1) for places in (corners_A, centroid_A))
    return in_one_piece(flat, around)


def _on_globe(run: RunRecord) -> bool:
    """Whether the target is drawn by longitude and latitude: several, or one that is no pyramid."""
    return bool(run.scenario.designer.extra_targets) or run.scenario.target.region != "pyramid"


def _classes(times: Array, there: Mask) -> list[tuple[Mask, str, str]]:
    """Cells that arrive in about as many equal parts of time as there are colours: which, words, colour."""
    if not there.any():
        return []
    first, last = float(times[there].min()), float(times[there].max())
    axis, bounds = time_axis(last), np.linspace(first, last, CLASSES + 1)
    if last == first:
        return [(there, f"on Earth at {instant(last, axis)}", sample_colorscale("Cividis_r", [0.0])[0])]
    number = np.where(there, np.clip(np.searchsorted(bounds, times, side="left") - 1, 0, CLASSES - 1), -1)
    colours = sample_colorscale("Cividis_r", np.linspace(0.0, 1.0, CLASSES))
    return [
        (number == k, f"until {bounds[k + 1] / axis.seconds:.4g} {axis.unit}", colours[k])
        for k in range(CLASSES)
        if (number == k).any()
    ]


def _cells(figure: go.Figure, corners: Array, name: str, style: AreaStyle) -> None:
    """Triangles (n, 3, 2) of one style, as one area with gaps."""
    closed = np.full((len(corners), 5, 2), np.nan)
    closed[:, :3], closed[:, 3] = corners, corners[:, 0]
    x, y = np.asarray(closed.reshape(-1, 2).T, np.float32)
    pattern = {**_pattern(style), "size": 8, "solidity": 0.25} if style.hatch else None
    area: dict[str, Any] = {"fill": "toself", "fillcolor": style.colour, "fillpattern": pattern}
    line = {"color": "white", "width": 0.5}
    figure.add_trace(go.Scatter(x=x, y=y, mode="lines", line=line, name=name, hoverinfo="name", **area))


def _percent(area: Array, cells: Mask) -> float:
    return 100.0 * float(area[cells].sum() / area.sum())


def _finish(figure: go.Figure, run: RunRecord, delivery: Delivery, axis: TimeAxis, height: float) -> None:
    """Time axis from the first picture until data no longer move, marks of arrival and end, legend."""
    last = _until_s(run, delivery)
    first = min(float(delivery.edges_s[0]), last_arrival_s(run.scenario))
    first = max(first - BEFORE * (last - first), 0.0)
    marks = ((last_arrival_s(run.scenario), "dash"), (run.scenario.duration_s, "solid"))
    shapes = [marker(t / axis.seconds, GREY, dash) for t, dash in marks]
    figure.update_xaxes(range=[first / axis.seconds, last / axis.seconds], hoverformat=".4g")
    title = {"text": f"time since deployment [{axis.unit}]", "standoff": 4}
    figure.update_layout({"xaxis2" if "xaxis2" in figure.layout else "xaxis": {"title": title}})
    layout = {"height": height, "margin": MARGINS_PX, "legend": _legend(height), "shapes": shapes}
    figure.update_layout(hovermode="x", dragmode="zoom", **layout)


def _until_s(run: RunRecord, delivery: Delivery) -> float:
    """Until when the plots show at first [s]: while data move, or all that was planned where none do."""
    return max(busy_until_s(delivery) or float(delivery.edges_s[-1]), run.scenario.duration_s)


def _legend(height_px: float) -> dict[str, Any]:
    """Below the plot; plotly makes room for it."""
    inside = height_px - MARGINS_PX["t"] - MARGINS_PX["b"] - LEGEND_PX
    return {"orientation": "h", "x": 0.0, "y": -LEGEND_PX / inside, "yanchor": "top"}
