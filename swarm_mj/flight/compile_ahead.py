"""Compiles what a first flight needs last, in another process, while its own compiles what it needs first.

Numba compiles one function after another in a process, and keeps the machine code on disk, where every process finds it. So
nothing is handed back: what is compiled by then is loaded, and the rest compiled as if nobody had helped.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.observe import criterion_from, observer_from
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import links_closed
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.smear import CameraMotion
from swarm_mj.smallbody.rotation import spin_dcm
from swarm_mj.spacecraft.attitude.mrp import dcm


def kernels_compiled() -> int:
    """How often this process found no machine code on disk for a function that every plan calls."""
    stats = getattr(spin_dcm, "stats", None)  # without Numba's compiler it is a plain function
    return 0 if stats is None else sum(stats.cache_misses.values())


def compile_ahead(plan: Plan) -> None:
    """Do a little of what a flight of this plan will do, the most urgent first: a step, links at an instant, a picture."""
    make_simulation(plan).step()
    _judge_links(plan)
    _take_picture(plan)


def _judge_links(plan: Plan) -> None:
    links_closed(
        antennas=antennas_from(plan.scenario),
        shape=plan.shape,
        mode=np.full((1, plan.n), TargetKind.EARTH, np.int8),
        tracked=np.zeros((1, plan.n), np.int16),
        r_BN_N=np.broadcast_to(plan.deployment.r0_N, (1, plan.n, 3)),
        C_BN=dcm(np.zeros((1, plan.n, 3))),
        C_AN=plan.environment.C_AN(0.0)[None],
        earth_N=plan.environment.earth.at(0.0)[None],
    )


def _take_picture(plan: Plan) -> None:
    """From a visiting point, of the target's middle."""
    pose = look_at(plan.points_A[0], plan.region.centroid_A.mean(axis=0))
    observer = observer_from(plan.scenario, plan.region)
    at_rest, sun_N = CameraMotion(np.zeros(3), np.zeros(3)), plan.environment.sun.at(0.0)
    observe(observer, pose.r_A, pose.C_CA, criterion_from(plan.scenario), sun_N, at_rest)
    observer.close()
