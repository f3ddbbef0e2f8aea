"""Imported by the fork server of the processes that draw: loads what the first figures would load.

These are fonts, formulas, contours and the tracer of rays, beside the modules themselves. Nothing here opens a GL context or
starts a thread, so that the process that did this can be forked.
"""

from __future__ import annotations

import gc
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.lines import Line2D

import swarm_mj.figures.run_figures
import swarm_mj.flight.compile_ahead  # noqa: F401
from swarm_mj.figures.numbering import name_beside
from swarm_mj.figures.palette import BLACK
from swarm_mj.figures.panels import legend_below
from swarm_mj.figures.style import caption, new_figure, write
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.smallbody.shape import ShapeModel


def _draw_one_of_each() -> None:
    figure = new_figure(2.0, "title")
    left, right = figure.subplots(1, 2)
    left.set_yscale("log")
    left.set_ylim(1e-3, 1.0)
    caption(left, "$P_{TO}$")
    right.contour(np.eye(3), levels=[0.5])
    name_beside(right, np.zeros(2), "1", (1.0, 1.0), BLACK)
    legend_below(figure, [Line2D([], [], label="$x$")])
    with TemporaryDirectory() as folder:
        write(figure, Path(folder) / "figure.png", pdf=False)
    tracer_of(ShapeModel(np.eye(4, 3), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]), "any"))


_draw_one_of_each()
gc.collect()
gc.freeze()  # what is there stays, and forks need not look at it
