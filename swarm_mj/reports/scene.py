"""The 3-D picture of the replay as a plotly figure; the page's script moves what moves."""

from __future__ import annotations

from typing import Any

import numpy as np
import plotly.graph_objects as go

from swarm_mj.figures.palette import AMBIENT, GREY, GROUND, ORANGE, SKY_BLUE
from swarm_mj.figures.units import time_axis
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports.plots import INK
from swarm_mj.reports.replay import Replay
from swarm_mj.typing import Array, Indices, Ints

#: More spacecraft than these are not named in the picture: the names would cover each other.
MAX_NAMED = 12
#: Corners of a path; a flyby bends little.
PATH_POINTS = 150
#: Paths of more spacecraft than these hide everything else.
MAX_PATHS = 60
#: An axis of which nothing is drawn. One with `visible` false still has its letter and its numbers made into meshes of glyphs,
#: which takes half a second.
NO_AXIS: dict[str, Any] = {
    "title": {"text": ""},
    "tickvals": [],
    "showticklabels": False,
    "showgrid": False,
    "zeroline": False,
    "showspikes": False,
    "showbackground": False,
}
#: Light is computed here and in the script, so plotly adds none.
UNLIT = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0, "roughness": 1.0}


def scene_figure(run: RunRecord, replay: Replay) -> go.Figure:
    """Body, target, paths, spacecraft, lines of sight and borders of pictures; every trace carries its part in `meta`."""
    cells: dict[str, Any] = {"hovertext": cell_texts(run, replay.scene["target_kept"]), "hoverinfo": "text"}
    ship, crew = {"symbol": "square", "size": 5, "color": INK}, {"size": 7, "line": {"width": 1, "color": "white"}}
    traces = [
        _mesh("body", hoverinfo="skip", colorscale=_ramp(GROUND)),
        _mesh("companion", hoverinfo="skip", colorscale=_ramp(GROUND)),
        _mesh("target", intensitymode="cell", colorscale=_two_ramps(ORANGE, SKY_BLUE), **cells),
        _lines("paths", color=GREY, width=2),
        _lines("views", color=INK, width=2),
        _lines("sight", width=3),
        _spots("speck", x=[0.0], y=[0.0], z=[0.0], marker={"size": 4, "color": GREY}, hoverinfo="skip"),
        _spots("mothership", marker=ship, hovertext=["mothership at deployment"]),
        _lines("directions", color=INK, width=3),
        _spots("spacecraft", marker=crew, hovertemplate="%{hovertext}<extra></extra>"),
    ]
    camera = {"projection": {"type": "perspective"}}
    axes = dict.fromkeys(("xaxis", "yaxis", "zaxis"), NO_AXIS)
    scene = {**axes, "aspectmode": "data", "dragmode": "orbit", "camera": camera}
    margin = dict.fromkeys("lrtb", 0)
    return go.Figure(traces, {"showlegend": False, "margin": margin, "scene": scene, "uirevision": "kept"})


def path_points(count: int) -> Indices:
    """Instants at which a path has a corner."""
    return np.unique(np.linspace(0, count - 1, min(count, PATH_POINTS)).astype(np.intp))


def cell_texts(run: RunRecord, kept: Ints) -> list[str]:
    """What a cell of the target says when it is pointed at."""
    coverage, axis = run.coverage, time_axis(float(run.times[-1]))
    by, area = coverage["first_seen_by_s"][:, kept], coverage["area"][kept]
    texts = []
    for number, cell in enumerate(kept):
        times = by[:, number]
        if np.isnan(times).all():
            seen = "never observed"
        else:
            j = int(np.nanargmin(times))
            also = int((~np.isnan(times)).sum()) - 1
            more = f" and {also} more" if also else ""
            seen = f"first observed at {times[j] / axis.seconds:.4g} {axis.unit}<br>by {run.names[j]}{more}"
        texts.append(f"cell {cell + 1}, {area[number] / 1e6:.3g} km²<br>{seen}")
    return texts


def _mesh(part: str, **style: Any) -> go.Mesh3d:
    """A mesh whose arrays the script fills in from those it has anyway."""
    return go.Mesh3d(
        meta=part, x=[], y=[], z=[], i=[], j=[], k=[], intensity=[], cmin=0, cmax=1, showscale=False, lighting=UNLIT, **style
    )  # fmt: skip


def _lines(part: str, **line: Any) -> go.Scatter3d:
    return go.Scatter3d(meta=part, x=[], y=[], z=[], mode="lines", line=line, hoverinfo="skip")


def _spots(part: str, **style: Any) -> go.Scatter3d:
    return go.Scatter3d(meta=part, **{"x": [], "y": [], "z": [], "mode": "markers", "hoverinfo": "text", **style})


def _ramp(colour: str) -> list[list[Any]]:
    """From a colour in the dark to the same in full light."""
    return [[0.0, in_the_dark(colour)], [1.0, _rgb(_array(colour))]]


def _two_ramps(below: str, above: str) -> list[list[Any]]:
    """The lower half of the scale for one colour, the upper for another; both from dark to light."""
    low, high = (_rgb(_array(colour)) for colour in (below, above))
    dark = [in_the_dark(colour, 1.5 * AMBIENT) for colour in (below, above)]
    return [[0.0, dark[0]], [0.49, low], [0.51, dark[1]], [1.0, high]]


def in_the_dark(colour: str, share: float = AMBIENT) -> str:
    """A colour of the ground where the Sun stands at the nadir: a share of its own."""
    return _rgb(share * _array(colour))


def _array(colour: str) -> Array:
    return np.array([int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])


def _rgb(colour: Array) -> str:
    return f"rgb({','.join(str(round(255 * float(c))) for c in colour)})"
