"""A flight as catalogues of SPICE-enhanced Cosmographia: kernels, body with its mesh, spacecraft, fields of view.

Format: cosmoguide.org, "Catalog Files". `load.json` loads the others; kernels are named relative to the catalogue.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.interop.kernels_text import spacecraft_name
from swarm_mj.interop.states import FlightStates
from swarm_mj.tracks.times import text_of
from swarm_mj.typing import Array

#: Colours of the spacecraft in turn.
COLORS = ((0.9, 0.4, 0.3), (0.3, 0.7, 0.9), (0.5, 0.8, 0.3), (0.9, 0.8, 0.3), (0.7, 0.5, 0.9), (0.9, 0.6, 0.8))


def write_catalogues(states: FlightStates, kernels: Sequence[str]) -> dict[str, str]:
    """Texts of the files by name.

    Args:
        states: What was flown.
        kernels: Paths of the kernels relative to the catalogues.
    """
    catalogues: dict[str, dict[str, Any]] = {
        "spice.json": {"spiceKernels": list(kernels)},
        "spacecraft.json": {"items": [_spacecraft(states, j) for j in range(states.n)]},
        "body.json": {"items": [_body(states)]},
        "sensors.json": {"items": [_sensor(states, j) for j in range(states.n)]},
    }
    # The order that Cosmographia asks for: kernels, then what is flown with them, then what is mounted on that.
    catalogues["load.json"] = {"require": ["spice.json", "body.json", "spacecraft.json", "sensors.json"]}
    head = {"version": "1.0", "name": f"swarm_mj {states.plan.scenario.name}"}
    files = {name: json.dumps(head | content, indent=2) + "\n" for name, content in catalogues.items()}
    return files | {"body.cmod": _mesh(states)}


def _times(states: FlightStates, j: int | None = None) -> dict[str, str]:
    """First and last instant: of spacecraft j, whose kernels begin at its release, or of the flight."""
    flown = states.instants if j is None else states.instants[states.flown(j)]
    first, last = (text_of(flown[k]).replace("T", " ") for k in (0, -1))
    return {"startTime": f"{first} TDB", "endTime": f"{last} TDB"}


def _title(states: FlightStates) -> str:
    return states.body.name.capitalize()


def _body(states: FlightStates) -> dict[str, Any]:
    return {
        "class": "asteroid",
        "name": _title(states),
        "center": "Sun",
        "trajectory": {"type": "Spice", "target": str(states.body.code), "center": "SUN"},
        "bodyFrame": {"type": "Spice", "name": states.body.frame},
        "geometry": {"type": "Mesh", "source": "body.cmod"},
        **_times(states),
    }


def _spacecraft(states: FlightStates, j: int) -> dict[str, Any]:
    name, color = spacecraft_name(states, j), list(COLORS[j % len(COLORS)])
    return {
        "class": "spacecraft",
        "name": name,
        **_times(states, j),
        "center": _title(states),
        "trajectory": {"type": "Spice", "target": name, "center": str(states.body.code)},
        "bodyFrame": {"type": "Spice", "name": f"{name}_BODY"},
        "geometry": {"type": "Globe", "radii": [x / 2000.0 for x in states.plan.scenario.spacecraft.size_m]},
        "label": {"color": color, "fadeSize": 1_000_000, "showText": True},
        "trajectoryPlot": {
            "color": color,
            "lineWidth": 1,
            "duration": f"{states.times[-1] / 86_400.0:.6f} d",
            "lead": f"{states.times[-1] / 86_400.0:.6f} d",
            "fade": 0,
            "sampleCount": min(len(states.times), 1000),
        },
    }


def _sensor(states: FlightStates, j: int) -> dict[str, Any]:
    name = spacecraft_name(states, j)
    reach = float(np.linalg.norm(states.states_N[:, j, :3], axis=1).max()) / 1e3
    return {
        "class": "sensor",
        "name": f"{name}_CAMERA",
        "parent": name,
        "center": name,
        **_times(states, j),
        "geometry": {
            "type": "Spice",
            "instrName": f"{name}_CAMERA",
            "target": _title(states),
            "range": reach,
            "rangeTracking": True,
            "frustumColor": list(COLORS[j % len(COLORS)]),
            "frustumOpacity": 0.3,
            "gridOpacity": 0.5,
            "footprintOpacity": 0.8,
            "onlyVisibleDuringObs": False,
        },
    }


def _mesh(states: FlightStates) -> str:
    """The shape in km as text of Celestia's model format (CMOD), which Cosmographia reads."""
    shape = states.plan.shape
    lines = ["#celmodel__ascii", "", "material", "diffuse 0.6 0.58 0.55", "end_material", "", "mesh"]
    lines += ["vertexdesc", "position f3", "normal f3", "end_vertexdesc", "", f"vertices {len(shape.vertices)}"]
    lines += _rows(np.hstack([shape.vertices / 1e3, shape.vertex_normals]))
    lines += ["", f"trilist 0 {3 * len(shape.faces)}"]
    lines += [" ".join(map(str, face)) for face in shape.faces.tolist()]
    return "\n".join([*lines, "", "end_mesh", ""])


def _rows(values: Array) -> list[str]:
    return [" ".join(f"{x:.7g}" for x in row) for row in values.tolist()]
