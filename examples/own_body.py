"""Fly past a body of your own: a peanut by trimesh, with the gravity of a point mass."""

import tempfile
from pathlib import Path

import trimesh

import swarm_mj as sm

peanut = trimesh.creation.icosphere(subdivisions=4)
waist = 1 + 0.5 * (1.5 * peanut.vertices[:, :1] ** 2 - 0.5)  # thin about x = 0
peanut.vertices *= 300.0 * waist
path = Path(tempfile.mkdtemp()) / "peanut.obj"
peanut.export(path)

gm = 6.674e-11 * 2000.0 * peanut.volume  # 2,000 kg/m^3
orbit = {"semi_major_axis_au": 1.3, "eccentricity": 0.2, "inclination_deg": 3, "node_deg": 200}
orbit |= {"argument_of_perihelion_deg": 120, "perihelion_jd": 2458000.5}
spin = {"pole_ra_deg": 0, "pole_dec_deg": 90, "w0_deg": 0, "w_rate_deg_per_day": 2400}
gravity = {"model": "point_mass", "parameters": {"gm": gm}}
body = {"name": "Peanut", "shape": str(path), "gravity": gravity, "rotation": spin, "orbit": orbit}
mission = {"name": "peanut", "body": body, "mothership": {"position_A_m": [0, 0, -6000]}}
mission |= {"design": {"visiting_points": [3, 30], "imaging_altitude_m": 2000}, "camera": {"half_angle_deg": 5}}
mission |= {"behavior": {"name": "adaptable_roles", "imaging_radius_m": 5000}, "physics": {"timestep_s": 0.5}}
print(sm.fly(sm.load(mission)))
