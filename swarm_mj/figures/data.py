"""The way to Earth: where the data are over time, aboard and on Earth, and the map as it arrives."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.figures.cells import draw_cells, flat_cells
from swarm_mj.figures.delivery_view import (
    LEAST_PERCENT,
    REASON_STYLES,
    busy_until_s,
    cells_by_reason,
    is_proven,
    last_shown_s,
    on_earth,
    percent_over_time,
)
from swarm_mj.figures.illumination import PALETTE
from swarm_mj.figures.links import area_style, mark_times, not_computed
from swarm_mj.figures.palette import BLACK, GREY, LIGHT_GREY, SKY_BLUE, VERMILLION, Dashes, spacecraft_styles
from swarm_mj.figures.panels import legend_below, spacecraft_handles
from swarm_mj.figures.style import SMALL_PT, TICK_PT, caption, label, new_figure, tidy
from swarm_mj.figures.timescale import TimeScale, delivery_scale
from swarm_mj.figures.units import DataUnit, TimeAxis, data_unit, instant, note_of_omission, shown_spacecraft, time_axis
from swarm_mj.figures.view import triangles
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.coverage import percent_text, rounded_up_digits
from swarm_mj.typing import Array, Indices, Mask

#: Instants at which the area is drawn.
INSTANTS = 2000
BEST_DASHES: Dashes = (0.0, (2.5, 2.0))
LOST_DASHES: Dashes = (0.0, (7.0, 1.5, 1.5, 1.5, 1.5, 1.5))
BOUND_DASHES: Dashes = (0.0, (6.0, 3.0))


def compose_data(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """Bits aboard each spacecraft and on Earth, and the share of the target that is seen and that has arrived."""
    title = f"Data on their way to Earth: {plan.scenario.name}"
    delivery = result.delivery
    if delivery is None:
        return not_computed(title)
    shown = shown_spacecraft(plan.n)
    figure = new_figure(7.4, f"{title}{note_of_omission(plan.n, shown)}")
    bits, area = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    scale = delivery_scale(plan, telemetry, busy_until_s(delivery), last_shown_s(delivery))
    handles = [*_draw_bits(bits, plan, delivery, shown, scale), *_draw_area(area, plan, result, delivery, scale)]
    scale.show(area)
    for ax in (bits, area):
        marks = mark_times(ax, plan, scale)
        tidy(ax)
    scale.name(area)
    legend_below(figure, [*handles, *marks])
    return figure


def _draw_bits(ax: Axes, plan: Plan, delivery: Delivery, shown: Indices, scale: TimeScale) -> list[Line2D]:
    """Aboard, on Earth by what the swarm does and by the proven best, and lost; gives the legend's entries."""
    received = max(delivery.delivered_bit, float(np.nansum(delivery.best_earth_bit)))
    lost = delivery.lost_bit.sum(axis=1)
    most = max(int(delivery.aboard_bit.max(initial=0)), received, float(lost.max()), 1.0)
    unit = data_unit(most)
    handles = [
        *_draw_aboard(ax, plan, delivery, shown, scale, unit),
        *_draw_received(ax, delivery, scale, unit),
    ]
    if lost.any():
        x, y = delivery.edges_s / scale.axis.seconds, lost / unit.bits
        handles += ax.plot(x, y, color=VERMILLION, linewidth=1.8, linestyle=LOST_DASHES, label="lost so far")
    ax.set_ylim(-0.03 * most / unit.bits, 1.06 * most / unit.bits)
    label(ax, y=f"data [{unit.unit}]")
    left = int(delivery.aboard_bit[-1].sum()), int(lost[-1])
    parts = zip(
        ("seen", "delivered", "aboard", "lost"), (delivery.seen_bit, delivery.delivered_bit, *left), strict=True
    )
    words = [f"{bits / unit.bits:.4g} {unit.unit} {what}" for what, bits in parts if bits or what != "lost"]
    caption(ax, f"at the end of the plan: {', '.join(words)}")
    return handles


def _draw_aboard(
    ax: Axes, plan: Plan, delivery: Delivery, shown: Indices, scale: TimeScale, unit: DataUnit
) -> list[Line2D]:
    """Lines of each spacecraft; with one legend entry for all where they cannot be told apart."""
    for j, style in zip(shown, spacecraft_styles(len(shown)), strict=True):
        ax.plot(delivery.edges_s / scale.axis.seconds, delivery.aboard_bit[:, j] / unit.bits, linewidth=1.4, **style)
    return spacecraft_handles(plan, shown, 1.4, together="aboard each spacecraft", before="aboard ")


def _draw_received(ax: Axes, delivery: Delivery, scale: TimeScale, unit: DataUnit) -> list[Line2D]:
    """What Earth has received, by the swarm alone and, where it is known, in the schedule that is proven best."""
    own: dict[str, Any] = {"color": BLACK, "linewidth": 3.0, "label": "on Earth"}
    best: dict[str, Any] = {"color": GREY, "linewidth": 1.8, "linestyle": BEST_DASHES, "zorder": 2.5}
    lines: list[Line2D] = []
    for sent, style in (
        (delivery.earth_bit.astype(np.float64), own),
        (delivery.best_earth_bit, {**best, "label": "on Earth, best by area"}),
    )[: 1 + is_proven(delivery)]:
        when, received = on_earth(delivery, sent)
        when, received = np.append(when, max(scale.duration_s, when[-1])), np.append(received, received[-1])
        lines += ax.plot(when / scale.axis.seconds, received / unit.bits, **style)
    return lines


def _draw_area(ax: Axes, plan: Plan, result: ObservationResult, delivery: Delivery, scale: TimeScale) -> list[Line2D]:
    """Seen, delivered, and the most that any schedule delivers; gives the legend's entries."""
    area, seconds = plan.region.total_weighted_area, scale.axis.seconds
    times = _instants(delivery, scale)
    seen, arrived = result.coverage.percent_over_time(times), percent_over_time(delivery, area, times)
    handles = ax.step(times / seconds, seen, where="post", color=SKY_BLUE, linewidth=4.0, label="seen")
    handles += ax.step(times / seconds, arrived, where="post", color=BLACK, linewidth=2.0, label="delivered")
    if is_proven(delivery):
        style: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.3, "linestyle": BOUND_DASHES}
        bound = 100.0 / area * float(delivery.best_bound_area)
        handles.append(ax.axhline(bound, label="no schedule delivers more", **style))
    ax.set_ylim(-3.0, 107.0)
    label(ax, y="share of the target [%]")
    caption(ax, _outcome(result, delivery, area, scale.axis))
    return handles


def _instants(delivery: Delivery, scale: TimeScale) -> Array:
    """Times for a history of steps [s]: even on the page, and every arrival."""
    even = scale.from_page(np.linspace(0.0, 1.0, INSTANTS))
    return np.union1d(even, delivery.tile_arrives_s[delivery.arrived])


def _outcome(result: ObservationResult, delivery: Delivery, area: float, axis: TimeAxis, *, best: bool = True) -> str:
    """Seen and delivered in words, and when the map is complete, with `best` also when it could be."""
    percent = 100.0 / area * delivery.delivered_area
    words = f"{percent_text(result.coverage.percent)} seen, {percent_text(percent)} delivered"
    if delivery.complete and len(delivery.tile_area):
        words += f"; the last of it at t = {instant(delivery.full_s, axis)}"
        if best and not np.isnan(delivery.best_full_s):
            words += f", at the earliest at {instant(float(delivery.best_full_s), axis)}"
    return words


#: Arrivals whose last comes so many times later than the first are coloured by the logarithm of their time.
WIDE = 20.0
#: Arrivals that lie closer together than this part of the unit are one.
TOGETHER = 0.01
WIDTH_IN = 8.2


def compose_delivered_map(plan: Plan, telemetry: xr.Dataset, result: ObservationResult) -> Figure:
    """The target's cells in the colours of when they arrive on Earth."""
    title = f"The map as it arrives on Earth: {plan.scenario.name}"
    delivery = result.delivery
    if delivery is None:
        return not_computed(title)
    figure = new_figure(7.0, title, width_in=WIDTH_IN)
    ax = figure.subplots()
    handles = [*_draw_arrivals(figure, ax, plan, delivery), *_draw_missing(ax, plan, delivery)]
    unseen = _percent(plan, delivery.tile_of_cell < 0)
    if unseen >= LEAST_PERCENT:
        handles.append(Patch(facecolor=LIGHT_GREY, label=f"not seen: {rounded_up_digits(unseen)} %"))
    caption(ax, _outcome(result, delivery, plan.region.total_weighted_area, time_axis(delivery.full_s), best=False))
    if handles:
        legend_below(figure, handles)
    return figure


def _draw_arrivals(figure: Figure, ax: Axes, plan: Plan, delivery: Delivery) -> list[Patch]:
    """Cells that arrive, with a scale of times, all others in grey; gives a legend's entry where all arrive together."""
    times = delivery.arrives_s
    there = ~np.isnan(times)
    colours = np.tile(to_rgb(LIGHT_GREY), (len(times), 1))
    if not there.any():
        draw_cells(ax, plan.region, colours, ambient=1.0)
        return []
    axis = time_axis(float(times[there].max()))
    norm = _norm(times[there] / axis.seconds)
    colours[there] = colormaps[PALETTE](norm(times[there] / axis.seconds))[:, :3]
    draw_cells(ax, plan.region, colours, ambient=1.0)
    if np.ptp(times[there]) < TOGETHER * axis.seconds:
        return [Patch(facecolor=colours[there][0], label=f"on Earth at t = {instant(float(times[there].max()), axis)}")]
    bar = figure.colorbar(ScalarMappable(norm, PALETTE), ax=ax, aspect=30.0, pad=0.02)
    bar.ax.tick_params(which="both", labelsize=SMALL_PT, color=GREY, length=3)
    bar.set_label(f"on Earth, time since deployment [{axis.unit}]", fontsize=TICK_PT)
    bar.outline.set_visible(False)
    return []


def _norm(times: Array) -> Normalize:
    first, last = float(times.min()), float(times.max())
    return LogNorm(first, last) if last > WIDE * first > 0.0 else Normalize(first, max(last, first + TOGETHER))


def _draw_missing(ax: Axes, plan: Plan, delivery: Delivery) -> list[Patch]:
    """Hatch the cells that were seen and do not arrive by their reason; gives the legend's entries."""
    handles = []
    corners = flat_cells(plan.region)
    for reason, cells in cells_by_reason(delivery).items():
        style = area_style(REASON_STYLES[reason])
        ax.add_collection(triangles(corners[cells], zorder=1.1, **style))
        handles.append(
            Patch(**style, label=f"seen, not delivered ({reason}): {rounded_up_digits(_percent(plan, cells))} %")
        )
    return handles


def _percent(plan: Plan, cells: Mask) -> float:
    return 100.0 * float(plan.region.weighted_area[cells].sum()) / plan.region.total_weighted_area
