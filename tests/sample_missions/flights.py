"""Seven very different missions, each a scenario beside this file: for whatever has to hold beyond the paper's own flight.

`mission(name, folder)` gives a scenario; meshes that a scenario names are made where it is put. `fly` flies one and looks at
the pictures, in seconds.
"""

import shutil
from pathlib import Path

import numpy as np
import trimesh

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import add_coverage, observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.smallbody.geodesic import geodesic_icosahedron

#: The packaged flight, and the files beside this one.
MISSIONS = ("eros-quick", "pebble", "fast_flyby", "dumbbell", "lone", "large", "binary")


def ellipsoid(a_m, b_m, c_m, frequency=8):
    directions, faces = geodesic_icosahedron(frequency)
    return trimesh.Trimesh(directions * (a_m, b_m, c_m), faces, process=False)


def dumbbell():
    """Balls of 400 and 300 m, 900 m apart, and a neck of 100 m: one closed surface about its centre of mass."""
    # One ball, pulled over the outline of the union seen from a point on the axis between them: closed by construction.
    directions, faces = geodesic_icosahedron(10)
    inside = []
    for centre, radius in ((400.0, 400.0), (-500.0, 300.0)):
        along = directions[:, 0] * centre
        root = along**2 - centre**2 + radius**2
        inside.append(np.where(root >= 0.0, along + np.sqrt(np.maximum(root, 0.0)), 0.0))
    across = np.hypot(directions[:, 1], directions[:, 2])
    neck = 100.0 / np.maximum(across, 0.25)
    mesh = trimesh.Trimesh(directions * np.max([*inside, neck], axis=0)[:, None], faces, process=False)
    mesh.apply_translation(-mesh.center_mass)
    return mesh


#: What the scenarios call their meshes, and how they are made.
MESHES = {
    "pebble.obj": lambda: ellipsoid(160.0, 150.0, 130.0),
    "hurry.obj": lambda: ellipsoid(30e3, 22e3, 18e3),
    "large.obj": lambda: ellipsoid(205e3, 200e3, 190e3, 30),
    "dumbbell.obj": dumbbell,
    "ring.obj": lambda: trimesh.creation.torus(1100.0, 400.0, major_sections=48, minor_sections=24),
}


#: The fast flyby released six hours before it instead of two days: an eighth of the flight, and of the time it takes.
SIX_HOURS = (
    "duration_s=22800",
    "design.time_of_flight_s=21600",
    "mothership.position_A_m=[-1.075e8, 8.75e7, -6.0e7]",
)


def mission(name, folder, overrides=()):
    """The scenario of a mission, with some keys overridden; files go into a folder."""
    if name not in MISSIONS:
        raise ValueError(f"mission {name}: must be one of {', '.join(MISSIONS)}")
    own = Path(__file__).parent / f"{name}.yaml"
    if not own.exists():
        return load_scenario(name, parse_overrides(overrides))
    text = own.read_text()
    for mesh, make in MESHES.items():
        if f"shape: {mesh}" in text:
            make().export(Path(folder) / mesh)
    return load_scenario(str(shutil.copy(own, folder)), parse_overrides(overrides))


def fly(name, folder, overrides=()):
    """A mission flown and observed: plan, telemetry, result."""
    plan = make_plan(mission(name, folder, overrides))
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    add_coverage(telemetry, result)
    return plan, telemetry, result
