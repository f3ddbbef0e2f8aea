"""What a run tells of each cell of its target in colours, and maps of all of it side by side in one picture."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure

from swarm_mj.figures.maps import Ground, MapExtent, latitude_longitude, name_map, paint_values, survey, whole_body
from swarm_mj.figures.palette import GREY, LIGHT_GREY, ORANGE, SKY_BLUE
from swarm_mj.figures.style import SMALL_PT, caption, new_figure
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.target import TargetRegion, place_of
from swarm_mj.observation.coverage import percent_text
from swarm_mj.records.cells import MAPPED, quantity
from swarm_mj.typing import Array

#: Columns that are shown, where the run has them, with colours; reversed where little is good.
PANELS = {
    "seen": "",
    "looks": "viridis",
    "observers": "viridis",
    "gsd_m": "viridis_r",
    "convergence_deg": "viridis",
    "least_emission_deg": "viridis_r",
    "light_varied_deg": "viridis",
    "height_dop": "viridis_r",
    "slope_dop": "viridis_r",
    "incidence_deg": "viridis_r",
    "first_seen_s": "cividis_r",
    "arrives_s": "cividis_r",
}
#: Panels in a row of wide and of narrow maps, places along a parallel, heights [in].
COLUMNS, NARROW_COLUMNS, PLACES = 2, 3, 540
ROW_IN, HEAD_IN = 2.5, 0.6
#: A target narrower than this in latitude and longitude is shown alone, with a margin around it [deg].
NARROW_DEG, MARGIN_DEG = 100.0, 4.0
#: Numbers of more steps than these get a scale without them.
MOST_STEPS = 12
#: Columns with a logarithmic scale where values differ much.
LOGARITHMIC = ("gsd_m", "height_dop", "slope_dop", "arrives_s", "first_seen_s")
#: Values that differ by more than this factor are coloured by their logarithm.
WIDE = 20.0


def compose_panels(plan: Plan, cells: pd.DataFrame) -> Figure:
    """A map for each of `PANELS` and each class that was mapped, of a run's cells."""
    names = shown_columns(cells)
    window = extent_of(plan.region)
    columns = COLUMNS if window.east - window.west > NARROW_DEG else NARROW_COLUMNS
    rows = -(-len(names) // columns)
    figure = new_figure(HEAD_IN + ROW_IN * rows, f"Maps of the target: {plan.scenario.name}")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    ground = survey(plan.region.mesh, window, PLACES)
    for ax, name in zip(axes, names, strict=False):
        values = np.append(plan.region.by_face(cells[name].to_numpy()), np.nan)[ground.face]  # face -1: no ground
        _panel(figure, ax, ground, values, name, cells)
        name_map(ax, window)
    for ax in axes[len(names) :]:
        ax.set_axis_off()
    return figure


def extent_of(region: TargetRegion) -> MapExtent:
    """The part of the map that shows a target: the whole body, or for small ones what lies around it."""
    centre = float(place_of(region.area @ region.centroid_A)[1])
    latitude, longitude = latitude_longitude(region.corners_A.reshape(-1, 3), centre)
    if max(np.ptp(longitude), np.ptp(latitude)) > NARROW_DEG:
        return whole_body(0.0)
    west, east = longitude.min() - MARGIN_DEG, longitude.max() + MARGIN_DEG
    south, north = max(latitude.min() - MARGIN_DEG, -90.0), min(latitude.max() + MARGIN_DEG, 90.0)
    return MapExtent(west=float(west), east=float(east), south=float(south), north=float(north))


def shown_columns(cells: pd.DataFrame) -> list[str]:
    """Columns that are shown in colours: those in which some cell has a value."""
    shown = [name for name in cells if name in PANELS or name.startswith(MAPPED)]
    return [name for name in shown if cells[name].notna().any()]


def title_of(name: str) -> str:
    """A column in words, with its unit."""
    known = quantity(name)
    return known.title if known.unit == "1" else f"{known.title} [{known.unit}]"


def scale_of(name: str, column: pd.Series) -> tuple[Colormap, Normalize]:
    """Colours of a column and the scale that chooses among them."""
    if column.dtype == np.bool_:
        return ListedColormap([ORANGE, SKY_BLUE]), Normalize(0.0, 1.0)
    colours = colormaps[PANELS.get(name, "viridis")]
    if column.dtype.kind in "iu" and np.ptp(column) < MOST_STEPS:
        return colours, BoundaryNorm(np.arange(column.min(), column.max() + 2) - 0.5, colours.N)
    return colours, _norm(column.to_numpy(np.float64), logarithmic=name in LOGARITHMIC)


def _panel(figure: Figure, ax: Axes, ground: Ground, values: Array, name: str, cells: pd.DataFrame) -> None:
    column, title = cells[name], title_of(name)
    colours, scale = scale_of(name, column)
    paint_values(ax, ground, values, colours, scale, LIGHT_GREY)
    if column.dtype == np.bool_:
        share = 100.0 * float(cells["area_m2"][column].sum() / cells["area_m2"].sum())
        caption(ax, f"{title}: {percent_text(share)} of the target", size=SMALL_PT + 1)
    else:
        caption(ax, title, size=SMALL_PT + 1)
        _bar(figure, ax, colours, scale)


def _norm(values: Array, *, logarithmic: bool) -> Normalize:
    known = values[np.isfinite(values)]
    if not len(known):
        return Normalize(0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    if logarithmic and high > WIDE * low > 0.0:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + 1.0)


def _bar(figure: Figure, ax: Axes, colours: Colormap, scale: Normalize) -> None:
    bar = figure.colorbar(ScalarMappable(scale, colours), ax=ax, aspect=25.0, pad=0.02, shrink=0.9)
    if isinstance(scale, BoundaryNorm):
        bar.set_ticks([0.5 * (a + b) for a, b in pairwise(scale.boundaries)])
        bar.ax.yaxis.set_major_formatter("{x:.0f}")
        bar.minorticks_off()
    bar.ax.tick_params(which="both", labelsize=SMALL_PT, color=GREY, length=3)
    bar.outline.set_visible(False)
