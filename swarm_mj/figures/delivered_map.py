"""The map as it arrives: when each cell of the target is on Earth, and why some never are."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.figures.cells import draw_cells, flat_cells
from swarm_mj.figures.contacts import area_style, not_computed
from swarm_mj.figures.delivery_view import LEAST_PERCENT, REASON_STYLES, cells_by_reason
from swarm_mj.figures.illumination import PALETTE
from swarm_mj.figures.palette import GREY, LIGHT_GREY
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import SMALL_PT, TICK_PT, caption, label, new_figure, tidy
from swarm_mj.figures.units import instant, time_axis
from swarm_mj.figures.view import triangles
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.coverage import percent_text
from swarm_mj.typing import Array, Mask

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
        handles.append(Patch(facecolor=LIGHT_GREY, label=f"not seen: {unseen:.2f} %"))
    tidy(ax)
    ax.grid(False)
    label(ax, "angle east of the target's centre [deg]", "angle north of the target's centre [deg]")
    caption(ax, _words(plan, result, delivery))
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
        handles.append(Patch(**style, label=f"seen, not delivered ({reason}): {_percent(plan, cells):.2f} %"))
    return handles


def _percent(plan: Plan, cells: Mask) -> float:
    return 100.0 * float(plan.region.area[cells].sum()) / plan.region.total_area


def _words(plan: Plan, result: ObservationResult, delivery: Delivery) -> str:
    percent = 100.0 / plan.region.total_area * delivery.delivered_area
    words = f"{percent_text(result.coverage.percent)} seen, {percent_text(percent)} delivered"
    if delivery.complete and len(delivery.tile_area):
        words += f"; the last of it at t = {instant(delivery.full_s, time_axis(delivery.full_s))}"
    return words
