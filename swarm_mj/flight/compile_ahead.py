"""Compiles what a first flight needs last, in another process, while its own compiles what it needs first.

Numba compiles one function after another in a process, and keeps the machine code on disk, where every process finds it. So
nothing is handed back: what is compiled by then is loaded, and the rest compiled as if nobody had helped.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.dataflow.contacts import Instants
from swarm_mj.dataflow.online import run_online
from swarm_mj.dataflow.tiles import make_tiles
from swarm_mj.flight.downlink import FEWEST_SAMPLES, contacts_of, network_of, speaking
from swarm_mj.flight.observe import observer_from
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import links_closed
from swarm_mj.observation.camera import CameraMotion, look_at
from swarm_mj.observation.capture import observe
from swarm_mj.smallbody.rotation import spin_dcm
from swarm_mj.spacecraft.attitude.mrp import dcm


def kernels_compiled() -> int:
    """How often this process found no machine code on disk for a function that every plan calls."""
    stats = getattr(spin_dcm, "stats", None)  # without Numba's compiler it is a plain function
    return 0 if stats is None else sum(stats.cache_misses.values())


def compile_ahead(plan: Plan) -> None:
    """Do a little of what a flight of this plan will do after its steps, which the process that flies compiles meanwhile."""
    _judge_links(plan)
    _take_picture(plan)


def _judge_links(plan: Plan) -> None:
    """Links at an instant, and pictures sent over them."""
    shape = (FEWEST_SAMPLES, plan.n)  # np.tile, for Numba compiles apart what takes an array that is read-only
    instants = Instants(
        t=np.zeros(FEWEST_SAMPLES),
        r_BN_N=np.tile(plan.deployment.r0_N, (FEWEST_SAMPLES, 1, 1)),
        C_BN=dcm(np.zeros((*shape, 3))),
        C_AN=np.tile(plan.environment.C_AN(0.0), (FEWEST_SAMPLES, 1, 1)),
        earth_N=np.tile(plan.environment.earth.at(0.0), (FEWEST_SAMPLES, 1)),
        mode=np.full(shape, TargetKind.EARTH, np.int64),
        tracked=np.zeros(shape, np.int64),
        works=np.ones(shape, np.bool_),
    )
    flown = {name: value[:1] for name, value in vars(instants).items() if name not in ("t", "works")}
    links_closed(antennas=plan.antennas, shape=plan.shape, **flown)
    shape = (plan.n, plan.region.n_cells)
    tiles = make_tiles(plan.region.area, np.zeros(shape), np.ones(shape), np.ones(shape))
    contacts = contacts_of(plan, np.array([0.0, 1.0]), instants)
    run_online(network_of(plan.scenario, tiles, contacts, instants), speaking(instants, 1))


def _take_picture(plan: Plan) -> None:
    """From a visiting point, of the target's middle."""
    pose = look_at(plan.points_A[0], plan.region.centroid_A.mean(axis=0))
    observer = observer_from(plan.scenario, plan.region)
    at_rest, sun_N = CameraMotion(np.zeros(3), np.zeros(3)), plan.environment.sun.at(0.0)
    observe(observer, pose.r_A, pose.C_CA, plan.scenario.observation, sun_N, at_rest)
    observer.close()
