"""A flight as a glTF scene (a binary .glb file): body and spacecraft as at the arrival, paths, fields of view.

The scene is in N turned so that N's z axis is glTF's y axis, up; lengths are metres in single precision. Spacecraft are
drawn as boxes many times their size: their nodes' extras say how many times.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm_mj.flight.observe import flown_cameras
from swarm_mj.interop.states import FlightStates
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Pixels

#: Colours of the spacecraft in turn.
COLORS = ((0.9, 0.4, 0.3), (0.3, 0.7, 0.9), (0.5, 0.8, 0.3), (0.9, 0.8, 0.3), (0.7, 0.5, 0.9), (0.9, 0.6, 0.8))
#: The long edge of a spacecraft in the picture, in radii of the body.
SPACECRAFT_SIZE = 0.05
#: More points of a path are left out.
MAX_POINTS = 2_000
#: From N (z up) to glTF (y up).
UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def write_scene(states: FlightStates) -> bytes:
    """The scene as bytes of a .glb file."""
    import trimesh

    scene = trimesh.Scene(metadata={"comments": list(states.comments)})
    scene.graph.update(frame_from="world", frame_to="N", matrix=UP)
    k = states.arrival
    shape = states.plan.shape
    body = trimesh.Trimesh(shape.vertices, shape.faces, face_colors=(150, 145, 138, 255), process=False)
    C_AN = states.plan.environment.C_AN(float(states.times[k]))
    _add(scene, body, states.body.name, _pose(C_AN, np.zeros(3)))
    size = np.array(states.plan.scenario.spacecraft.size_m)
    scale = SPACECRAFT_SIZE * shape.max_radius / size.max()
    C_BN = dcm(states.telemetry["sigma_BN"].values[k])
    C_CN = flown_cameras(states.plan.scenario, states.telemetry)[0][k]
    for j, name in enumerate(states.plan.names):
        color = np.array([*(round(255 * x) for x in COLORS[j % len(COLORS)]), 255], np.uint8)
        pose = _pose(C_BN[j], states.states_N[k, j, :3])
        box = trimesh.creation.box(extents=size * scale)
        box.visual.face_colors = color
        _add(scene, box, name, pose, {"drawn_times_larger": float(scale)})
        _add(scene, _line(_path(states.states_N[states.flown(j), j, :3]), color), f"{name}_path", np.eye(4))
        seen_from = _pose(C_CN[j], states.states_N[k, j, :3])
        _add(scene, _line(_field_of_view(states, j), color), f"{name}_field_of_view", seen_from)
    out: bytes = scene.export(file_type="glb")
    return out


def _add(scene: Any, geometry: Any, name: str, pose: Array, extras: dict[str, Any] | None = None) -> None:
    scene.add_geometry(
        geometry, node_name=name, geom_name=name, parent_node_name="N", transform=pose, metadata=extras or {}
    )


def _pose(C_BN: Array, r_N: Array) -> Array:
    """Matrix of a node at `r_N` whose axes are the rows of `C_BN`."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = C_BN.T, r_N
    return out


def _path(r_N: Array) -> Array:
    every = max(1, -(-len(r_N) // MAX_POINTS))
    return np.concatenate([r_N[:-1:every], r_N[-1:]])


def _field_of_view(states: FlightStates, j: int) -> Array:
    """One line along the edges of the field of view, in the camera's frame, as far as the body's centre."""
    reach = float(np.linalg.norm(states.states_N[states.arrival, j, :3]))
    round_ = states.camera.shape == "cone"
    outline = states.camera.outline(8 if round_ else 1)
    rim = reach * np.column_stack([outline, np.ones(len(outline))])
    tip = np.zeros((1, 3))
    if round_:
        return np.concatenate([tip, rim, rim[:1], tip])
    a, b, c, d = rim[:, None]
    return np.concatenate([tip, a, b, tip, c, b, c, d, tip, d, a])


def _line(points: Array, color: Pixels) -> Any:
    import trimesh

    path = trimesh.load_path(points)
    path.colors = np.tile(color, (len(path.entities), 1))
    return path
