"""Links as timelines: what each spacecraft tracks and when its radio link is closed; contacts, transfers and obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.dataflow.ground import stations_from
from swarm_mj.figures.delivery_view import (
    LINK_STYLES,
    AreaStyle,
    LinkHistory,
    busy_until_s,
    last_shown_s,
    link_in_swarm,
    links_to_earth,
    speakers,
    stretches,
)
from swarm_mj.figures.modes import axes_pt, has_room, mode_handles, name_mode, width_pt
from swarm_mj.figures.palette import BLACK, BLUE, DARK_GREY, GREY, MODE_STYLES, VERMILLION
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import HALO, INSIDE, SMALL_PT, TICK_PT, caption, new_figure, plain, role, tidy
from swarm_mj.figures.timescale import TimeScale, arrival_handle, delivery_scale, time_scale
from swarm_mj.figures.units import data_unit, note_of_omission, shown_spacecraft
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.links import Obstacle
from swarm_mj.records.modes import Run, intervals, runs

#: Share of the time axis that half a mode's name takes at most.
NAME_SHARE = 0.03
#: Height of a row's two bars, in rows.
MODE_HEIGHT = 0.46
LINK_HEIGHT = 0.22


def compose_links(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Timeline of modes and closed links, one row per spacecraft."""
    shown = shown_spacecraft(plan.n)
    scale = time_scale(plan, telemetry)
    title = f"Modes and radio links: {plan.scenario.name}{note_of_omission(plan.n, shown)}"
    figure = new_figure(2.0 + 0.42 * len(shown), title)
    ax = figure.subplots()
    for row, j in enumerate(shown):
        _draw_row(ax, telemetry, int(j), row, scale)
    scale.draw(ax, BLACK, zorder=2.0)
    ax.grid(False, axis="y")
    ax.set_ylim(len(shown) - 0.5, -0.5)
    ax.set_yticks(range(len(shown)), [f"{plan.names[j]}: {role(plan, int(j))}" for j in shown])
    ax.tick_params(axis="y", length=0)
    times = telemetry["time"].values
    closed_s = [
        sum(length for _, length in intervals(telemetry["link_closed"].values[:, j] == 1, times)) for j in shown
    ]
    _write_totals(ax, [f"{total / scale.axis.seconds:.1f}" for total in closed_s], f"link closed [{scale.axis.unit}]")
    closed = (telemetry["link_closed"].values[:, shown] == 1).any()
    link = [Patch(facecolor=BLUE, label="link closed")] if closed else []
    legend_below(figure, [*mode_handles(telemetry, shown), *link, arrival_handle(BLACK), *scale.border_handles()])
    return figure


def _draw_row(ax: Axes, telemetry: xr.Dataset, j: int, row: int, scale: TimeScale) -> None:
    unit = scale.axis.seconds
    for run in runs(telemetry, j):
        style, length = MODE_STYLES[run.mode], run.end - run.start
        bar = [(run.start / unit, length / unit)]
        ax.broken_barh(bar, (row - 0.36, MODE_HEIGHT), facecolor=style.colour, edgecolor="white", linewidth=1.0)
        if has_room(ax, run, scale):
            name_mode(ax, _beside(run, scale), scale, row - 0.36 + MODE_HEIGHT / 2)
    closed = intervals(telemetry["link_closed"].values[:, j] == 1, telemetry["time"].values)
    bars = [(start / unit, length / unit) for start, length in closed]
    ax.broken_barh(bars, (row - 0.36 + MODE_HEIGHT, LINK_HEIGHT), facecolor=BLUE, linewidth=0)


def _beside(run: Run, scale: TimeScale) -> Run:
    """The longer part of a stretch before or after the arrival whose mark would go through its name, else all of it."""
    mark = scale.arrival_s
    if abs(scale.share(scale.middle(run.start, run.end), mark)) > NAME_SHARE:
        return run
    before, after = Run(run.start, mark, run.mode), Run(mark, run.end, run.mode)
    return before if scale.share(run.start, mark) > scale.share(mark, run.end) else after


#: More spacecraft than these are not shown row by row.
MOST_ROWS = 12
#: Heights in rows: of a bar of contacts, of one that holds names, of a transfer that takes all of the time, and of any.
CONTACT, NAMED, TRANSFER, LEAST_TRANSFER = 0.24, 0.36, 0.4, 0.06
#: Lines between neighbouring bars, and room around a name [pt].
GAP_PT, ROOM_PT = 0.6, 4.0
ARROW = "\N{RIGHTWARDS ARROW}"


def compose_contacts(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Timeline of contacts, transfers and obstacles: a row for each spacecraft and for each way to Earth."""
    title = f"Contacts and transfers: {plan.scenario.name}"
    delivery = result.delivery
    if delivery is None:
        return not_computed(title)
    shown = shown_spacecraft(plan.n, MOST_ROWS)
    in_swarm = [row for j in shown if (row := link_in_swarm(delivery, int(j))) is not None]
    rows = [*in_swarm, *links_to_earth(delivery)]
    figure = new_figure(2.3 + 0.46 * len(rows), f"{title}{note_of_omission(plan.n, shown)}")
    ax = figure.subplots()
    scale = delivery_scale(plan, telemetry, busy_until_s(delivery), last_shown_s(delivery))
    for place, row in enumerate(rows):
        _draw_contacts(ax, place, row, delivery, scale)
    _name_stations(ax, rows, plan, delivery, scale)
    marks = mark_times(ax, plan, scale)
    tidy(ax)
    ax.grid(False, axis="y")
    scale.show(ax)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_yticks(range(len(rows)), [_link_name(row, plan, delivery) for row in rows])
    ax.tick_params(axis="y", length=0)
    scale.name(ax)
    unit = data_unit(max((row.sent_bit for row in rows), default=0))
    _write_totals(ax, [f"{row.sent_bit / unit.bits:.4g}" for row in rows], f"sent [{unit.unit}]")
    legend_below(figure, [*_contact_handles(rows, delivery, scale), *marks])
    return figure


def _write_totals(ax: Axes, totals: list[str], name: str) -> None:
    """A number at the right of each row, and above them what they are."""
    right = ax.secondary_yaxis("right")
    right.set_yticks(range(len(totals)), totals)
    right.tick_params(labelsize=TICK_PT, length=0)
    right.set_ylabel(name, fontsize=TICK_PT + 1)
    right.spines["right"].set_visible(False)


def not_computed(title: str) -> Figure:
    """The page that stands for a figure of the way to Earth where that was not computed."""
    figure = new_figure(2.2, title)
    words = "not computed: the way to Earth of this flight is not known"
    figure.text(0.5, 0.45, words, ha="center", fontsize=TICK_PT + 1, color=GREY)
    return figure


def mark_times(ax: Axes, plan: Plan, scale: TimeScale) -> list[Line2D]:
    """Mark the arrival, the end of the flight and what is drawn wider; gives the legend's entries."""
    unit, end_s = scale.axis.seconds, plan.scenario.duration_s
    flight_wider = scale.encounter_s == (0.0, end_s)
    scale.draw_arrival(ax, BLACK, zorder=2.0)
    ends = "end of the flight" + ("; wider before" if flight_wider else "")
    handles = [arrival_handle(BLACK)]
    if end_s < scale.duration_s:
        ax.axvline(end_s / unit, color=BLACK, linewidth=1.3)
        handles.append(Line2D([], [], color=BLACK, linewidth=1.3, label=ends))
    if flight_wider:
        return handles
    scale.draw_borders(ax)
    return [*handles, *scale.border_handles()]


def area_style(style: AreaStyle) -> dict[str, Any]:
    """How an area is painted, as Matplotlib takes it."""
    hatched = {"edgecolor": DARK_GREY, "linewidth": 0.0, "hatch": style.hatch}
    return {"facecolor": style.colour, **(hatched if style.hatch else {"edgecolor": "white", "linewidth": GAP_PT})}


def _link_name(row: LinkHistory, plan: Plan, delivery: Delivery) -> str:
    who = speakers(delivery)
    others = who[who != row.spacecraft]
    to = "Earth" if row.to_earth else plan.names[others[0]] if len(others) == 1 else "relays"
    return f"{plan.names[row.spacecraft]} {ARROW} {to}"


def _draw_contacts(ax: Axes, place: int, row: LinkHistory, delivery: Delivery, scale: TimeScale) -> None:
    unit, edges = scale.axis.seconds, delivery.edges_s
    top = place + 0.02
    for start, end, state in stretches(edges, row.state):
        bar, height = [(start / unit, (end - start) / unit)], NAMED if row.to_earth else CONTACT
        ax.broken_barh(bar, (top, height), **area_style(LINK_STYLES[state]))
    sent = np.where(row.used > 0.0, LEAST_TRANSFER + (TRANSFER - LEAST_TRANSFER) * row.used, 0.0)
    ax.fill_between(
        np.repeat(edges, 2)[1:-1] / unit, top - np.repeat(sent, 2), top, facecolor=VERMILLION, linewidth=0, zorder=2
    )


def _name_stations(ax: Axes, rows: list[LinkHistory], plan: Plan, delivery: Delivery, scale: TimeScale) -> None:
    """Write into contacts with Earth which station hears, as far as there is room; all in words above."""
    stations = stations_from(plan.scenario.link.ground)
    heard: set[int] = set()
    for place, row in enumerate(rows):
        if not row.to_earth:
            continue
        station = np.where(row.state == Obstacle.NONE, row.station, -1)
        for start, end, k in stretches(delivery.edges_s, station):
            end = min(end, scale.duration_s)
            if k < 0 or start >= end:
                continue
            heard.add(k)
            room = scale.share(start, end) * axes_pt(ax) - ROOM_PT
            name = stations[k].name
            words = next((w for w in (name, name.split()[0], name[0]) if width_pt(w) <= room), "")
            if words:
                middle = scale.middle(start, end) / scale.axis.seconds
                ax.text(middle, place + 0.02 + NAMED / 2, plain(words), ha="center", va="center", fontsize=SMALL_PT,
                        fontweight="bold", path_effects=HALO, **INSIDE)  # fmt: skip
    if heard:
        caption(ax, plain(f"heard by {', '.join(stations[k].name for k in sorted(heard))}"))


def _contact_handles(rows: list[LinkHistory], delivery: Delivery, scale: TimeScale) -> list[Patch]:
    """Legend entries of what there is to see."""
    visible = delivery.edges_s[:-1] < scale.duration_s
    found = np.unique(np.concatenate([row.state[visible] for row in rows])) if rows else np.empty(0, int)
    areas = [Patch(**area_style(style), label=style.words) for state, style in LINK_STYLES.items() if state in found]
    if any(row.sent_bit for row in rows):
        areas.insert(0, Patch(facecolor=VERMILLION, label="data sent; height: share used"))
    return areas
