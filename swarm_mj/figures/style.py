"""Common look: sizes, labels, saving; colours are in `figures/palette.py`. Sizes hold when a picture is shown at half."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib import patheffects, rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from swarm_mj.figures.palette import GREY, LIGHT_GREY
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Array

DPI = 150
#: Of what a PDF cannot hold as lines: shaded bodies and maps.
RASTER_DPI = 300
#: Of PNGs: a third of the time of Pillow's own choice, and files no larger than with transparency.
COMPRESSION = 3
WIDTH_IN = 9.0
TITLE_PT = 12
LABEL_PT = 10
TICK_PT = 9
SMALL_PT = 8

#: Lets text read on any ground.
HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]
#: Of text inside a diagram, which the search for room need not measure.
INSIDE: dict[str, Any] = {"in_layout": False}
#: How the instant of the arrival is marked.
ARRIVAL_DASHES = (0, (4, 2))


#: All figures of a process share Matplotlib's parser of formulas, which is not made for threads.
_RENDERING = threading.Lock()


def new_figure(height_in: float, title: str, *, width_in: float = WIDTH_IN) -> Figure:
    """An empty figure whose parts arrange themselves."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained", facecolor="white")
    room_pt = 72.0 * width_in / (0.68 * len(title))  # a bold letter is about 0.68 of its size wide
    figure.suptitle(plain(title), fontsize=min(TITLE_PT, room_pt), fontweight="bold")
    return figure


def plain(text: str) -> str:
    """Text in which Matplotlib finds no formula."""
    return text.replace("$", r"\$")


def tidy(ax: Axes) -> None:
    """Common look of a plain diagram; its frame is left out of the search for room, as the numbers along it need more."""
    ax.tick_params(labelsize=TICK_PT, color=GREY, length=3)
    ax.grid(True, color=LIGHT_GREY, linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(GREY)
        ax.spines[side].set_in_layout(False)


def label(ax: Axes, x: str | None = None, y: str | None = None) -> None:
    """Name the axes; every name carries its unit."""
    if x is not None:
        ax.set_xlabel(x, fontsize=LABEL_PT)
    if y is not None:
        ax.set_ylabel(y, fontsize=LABEL_PT)


def annotate(ax: Axes, text: str, place: Array, offset_pt: Sequence[float] | Array, **style: Any) -> None:
    """Write a text at an offset [pt] from a place (2,) in the axes' units; centred there unless `style` says otherwise."""
    at, offset = (float(place[0]), float(place[1])), (float(offset_pt[0]), float(offset_pt[1]))
    ax.annotate(text, at, xytext=offset, textcoords="offset points", **{"ha": "center", "va": "center", **style})


def caption(ax: Axes, text: str, *, size: float = TICK_PT, pad: float | None = None) -> None:
    """A line of text over the left end of axes above which no ticks or scales stand."""
    ax.set_title(text, fontsize=size, loc="left", pad=pad, y=1.0)  # where it is put: no search for a free height


def role(plan: Plan, j: int) -> str:
    """What spacecraft j was sent to do."""
    points = plan.scenario.design.visiting_points
    if plan.scenario.initial_states:
        return "on its way at the epoch"
    return f"visits point {points[j]}" if j < plan.n_observers else "communications"


def write(figure: Figure, path: Path, *, pdf: bool) -> None:
    """Write a PNG to `path`, and with `pdf` a PDF beside it."""
    save(figure, path)
    if pdf:
        figure.set_layout_engine("none")  # the parts stay where the first rendering put them
        save(figure, path.with_suffix(".pdf"))


def save(figure: Figure, path: Path) -> None:
    """Write a PNG or a PDF, as the path says, under a temporary name that is then changed; equal figures give equal bytes."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        with _RENDERING:
            (_save_pdf if path.suffix == ".pdf" else _save_png)(figure, partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _save_png(figure: Figure, path: Path) -> None:
    """Draw once: `savefig` draws twice where the parts arrange themselves."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba(), "raw", "RGBA", 0, 1)
    picture.convert("RGB").save(path, format="png", dpi=(DPI, DPI), compress_level=COMPRESSION)


def _save_pdf(figure: Figure, path: Path) -> None:
    nothing = {"CreationDate": None, "Creator": None, "Producer": None}  # they would make equal figures differ
    with rc_context({"pdf.fonttype": 42}):  # fonts that other programs can edit
        figure.savefig(path, format="pdf", dpi=RASTER_DPI, metadata=nothing)
