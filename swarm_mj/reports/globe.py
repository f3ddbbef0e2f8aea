"""The part of the page with the body to turn: what the run tells of each cell of its target, one quantity at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from matplotlib.colors import LogNorm, rgb2hex, to_rgb
from numpy.typing import NDArray

from swarm_mj.figures.cell_maps import scale_of, shown_columns, title_of
from swarm_mj.figures.palette import AMBIENT, GREY, GROUND, LIGHT_GREY
from swarm_mj.figures.view import shade, unit
from swarm_mj.records.cells import cells_table
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports.markup import Content, Html, tag
from swarm_mj.reports.scene import NO_AXIS, UNLIT
from swarm_mj.reports.sections import section
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.simplify import Simplified, simplify
from swarm_mj.typing import Array

#: Most faces of the target, each of which has a colour and words for every quantity, and of the rest of the body.
FACES, FACES_BESIDE = 5_000, 16_000
HEIGHT_PX = 560
#: Steps of a scale of colours, and of its numbers.
STEPS, TICKS = 64, 6
#: From where the body is lit, beside the viewer, and how much of their colour cells keep in shade, so that it tells the value.
LAMP, RELIEF = np.array([0.3, -0.3, 0.5]), 0.75
#: Of the viewer at first, in plotly's units; plotly's own is 1.25 along each axis.
DISTANCE = 1.25
#: A target whose middle lies nearer to the centre than this share of the largest coordinate has no side of its own, as a whole
#: body has none: it is seen from elsewhere.
LEAST_SIDE, ASIDE = 0.1, np.array([1.0, 0.8, 0.5])
HINT = (
    "Drag to turn, scroll to zoom; point at a cell to read it. Slopes are darker. Grey: no value, or beyond the target."
)


def globe_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    """A box for the body of each run, which the page's script draws."""
    boxes: list[Content] = []
    for number, label in enumerate(labels):
        head = tag("h3", label) if len(runs) > 1 else None
        boxes.append(tag("figure", head, tag("div", id=globe_id(number), role="img", aria_label=f"Map of {label}")))
    return section("map", "Map", tag("div", boxes, class_="globes"), tag("p", HINT, class_="soft"))


def globe_id(number: int) -> str:
    """The id of the box of a run."""
    return f"globe-{number}"


def globe_figure(run: RunRecord) -> go.Figure:
    """The body with its target's cells in colours, a list to choose the quantity from, and its scale."""
    coverage, cells = run.coverage, cells_table(run.coverage, run.delivery)
    target = simplify(coverage["vertices"], coverage["faces"], FACES)
    names = shown_columns(cells)
    eye = _eye(coverage)
    light = _brightness(target, eye, RELIEF)
    looks = [_look(name, cells[name], target.kept, light) for name in names]
    buttons = [
        {"label": title_of(name), "method": "restyle", "args": [look, [1, 2]]}
        for name, look in zip(names, looks, strict=True)
    ]
    first = looks[0]
    cells_trace = go.Mesh3d(
        **_mesh(target.vertices, target.faces),
        facecolor=first["facecolor"][0],
        hoverinfo="text",
        hovertext=first["hovertext"][0],
        lighting=UNLIT,
    )
    axes = dict.fromkeys(("xaxis", "yaxis", "zaxis"), NO_AXIS)
    place = dict(zip("xyz", (DISTANCE * eye).tolist(), strict=True))
    camera = {"eye": place, "projection": {"type": "perspective"}}
    menu = {"buttons": buttons, "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom", "showactive": True}
    return go.Figure(
        [_rest(coverage, eye), cells_trace, _scale(first)],
        {
            "scene": {**axes, "aspectmode": "data", "camera": camera},
            "margin": {"l": 0, "r": 0, "t": 44, "b": 0},
            "height": HEIGHT_PX,
            "showlegend": False,
            "updatemenus": [menu],
            "uirevision": "kept",
        },
    )


def _eye(coverage: Mapping[str, NDArray[Any]]) -> Array:
    """Unit vector from the body's centre to the viewer at first, above the middle of the target, shape (3,)."""
    middle = coverage["area"] @ coverage["vertices"][coverage["faces"]].mean(axis=1)
    if np.linalg.norm(middle) < LEAST_SIDE * coverage["area"].sum() * np.abs(coverage["vertices"]).max():
        middle = ASIDE
    return unit(middle)


def _rest(coverage: Mapping[str, NDArray[Any]], eye: Array) -> go.Mesh3d:
    """The ground beside the target, lit from beside the viewer."""
    rest = simplify(coverage["body_vertices"], coverage["body_faces"], FACES_BESIDE)
    colours = _hexes(np.outer(_brightness(rest, eye, AMBIENT), to_rgb(GROUND)))
    return go.Mesh3d(**_mesh(rest.vertices, rest.faces), facecolor=colours, hoverinfo="skip", lighting=UNLIT)


def _mesh(vertices: NDArray[Any], faces: NDArray[Any]) -> dict[str, Any]:
    columns = (*vertices.astype(np.float32).T, *faces.astype(np.int32).T)
    return dict(zip("xyzijk", columns, strict=True))


def _brightness(mesh: Simplified, eye: Array, ambient: float) -> Array:
    """Of each face under a lamp beside the viewer, whose unit vector is `eye`; 1 where it faces the lamp, shape (F,)."""
    shape = ShapeModel(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int32), "drawn")
    with np.errstate(invalid="ignore"):  # faces without area, which cuts may leave, have no normal
        normals = np.nan_to_num(shape.face_normals)
    return shade(np.ones((len(normals), 1)), normals, eye + LAMP, ambient)[:, 0]


def _hexes(colours: Array) -> list[str]:
    return [rgb2hex(tuple(colour)) for colour in colours.tolist()]


def _look(name: str, column: pd.Series, kept: NDArray[Any], light: Array) -> dict[str, Any]:
    """What changes of the target's mesh, of `kept` cells, and of the scale when a quantity is chosen."""
    colours, scale = scale_of(name, column)
    shown = column.to_numpy(np.float64)[kept]
    bare = np.where(np.isnan(shown)[:, None], to_rgb(LIGHT_GREY), colours(scale(shown))[:, :3])
    paint = _hexes(bare * light[:, None])
    words = [f"cell {k + 1}: {_number(column.iloc[k])}" for k in kept.tolist()]
    low, high = float(scale.vmin or 0.0), float(scale.vmax or 1.0)
    steps = np.linspace(0.0, 1.0, STEPS)
    ticks = np.geomspace(low, high, TICKS) if isinstance(scale, LogNorm) else np.linspace(low, high, TICKS)
    if column.dtype.kind in "biu":
        ticks = np.unique(np.ceil(np.linspace(low, high, 2 * TICKS)))
        ticks = ticks[(ticks >= low) & (ticks <= high)]
    places = np.log(ticks / low) / np.log(high / low) if isinstance(scale, LogNorm) else (ticks - low) / (high - low)
    bar = [[float(s), rgb2hex(colours(s))] for s in steps]
    return {
        "facecolor": [paint, None],
        "hovertext": [words, None],
        "marker.colorscale": [None, bar],
        "marker.colorbar.tickvals": [None, places.tolist()],
        "marker.colorbar.ticktext": [None, [_tick(column, value) for value in ticks]],
    }


def _scale(look: dict[str, Any]) -> go.Scatter3d:
    """Nothing but a scale of colours, from 0 to 1."""
    bar = {
        "tickvals": look["marker.colorbar.tickvals"][1],
        "ticktext": look["marker.colorbar.ticktext"][1],
        "len": 0.8,
        "thickness": 14,
        "outlinecolor": GREY,
    }
    scale = look["marker.colorscale"][1]
    marker = {
        "color": [0.0],
        "cmin": 0.0,
        "cmax": 1.0,
        "colorscale": scale,
        "showscale": True,
        "colorbar": bar,
        "size": 0.1,
    }
    return go.Scatter3d(x=[0.0], y=[0.0], z=[0.0], mode="markers", marker=marker, hoverinfo="skip")


def _number(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return "none" if np.isnan(value) else f"{value:.4g}"


def _tick(column: Any, value: float) -> str:
    return _number(bool(value)) if column.dtype == np.bool_ else f"{value:.4g}"
