"""What flies around the body in a picture of the operation, in the body-fixed frame, and from where to look at it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.figures.view import KM, View, first_hits, unit, views_of, visible_share
from swarm_mj.flight.fly import asteroid_attitudes
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.mission.target import TargetRegion
from swarm_mj.records.modes import LOST, modes_shown
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Mask

#: Length of a +z axis that points at nothing near, as a share of the picture.
FREE_AXIS = 0.4


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What flies around the body, in A, or in A as it stands at the arrival, which is at rest.

    Attributes:
        times: Shape (t,) [s].
        turn: Attitude of A relative to the frame of the scene, shape (t, 3, 3).
        r_A: Positions, shape (t, n, 3) [m].
        z_A: Directions of +z, shape (t, n, 3).
        relays: Whether each spacecraft is, or at some time becomes, the communications spacecraft, shape (n,).
        mode: What each tracks, or that it is lost, as `modes_shown` tells, shape (t, n).
    """

    times: Array
    turn: Array
    r_A: Array
    z_A: Array
    relays: Mask
    mode: NDArray[np.int8]


def scene_from(plan: Plan, telemetry: xr.Dataset, *, at_rest: bool = False) -> Scene:
    """Turn telemetry into A, or into the inertial frame that A is at the arrival, in which body and target stand as then."""
    C_AN = asteroid_attitudes(telemetry)
    turn = np.broadcast_to(np.eye(3), C_AN.shape)
    if at_rest:
        at_arrival = plan.environment.C_AN(last_arrival_s(plan.scenario))
        turn, C_AN = C_AN @ at_arrival.T, np.broadcast_to(at_arrival, C_AN.shape)
    z_N = dcm(telemetry["sigma_BN"].values)[..., 2, :]
    mode = modes_shown(telemetry)
    ever_earth = (mode == TargetKind.EARTH).any(axis=0)
    return Scene(
        times=telemetry["time"].values,
        turn=turn,
        r_A=np.einsum("kij,knj->kni", C_AN, telemetry["r_BN_N"].values),
        z_A=np.einsum("kij,knj->kni", C_AN, z_N),
        relays=ever_earth | (np.arange(plan.n) >= plan.n_observers),
        mode=mode,
    )


def axis_tips(telemetry: xr.Dataset, scene: Scene, body: ShapeModel, k: int, free: float) -> Array:
    """Where to end the line along each +z: at the ground, as far as the spacecraft tracked, or after `free` [m].

    Those of lost spacecraft end where they begin.

    Returns:
        Shape (n, 3) [m].
    """
    r, z, mode, tracked = scene.r_A[k], scene.z_A[k], scene.mode[k], telemetry["tracked_spacecraft"].values[k]
    onto_A = scene.turn[k].T
    length = np.where(mode >= LOST, 0.0, free)
    down, other = looks_at_body(mode), mode == TargetKind.SPACECRAFT
    length[down] = first_hits(r[down] @ onto_A, z[down] @ onto_A, np.linalg.norm(r[down], axis=1), body)
    length[other] = np.linalg.norm(r[other] - r[tracked[other]], axis=1)
    return r + length[:, None] * z


def best_view(region: TargetRegion, scene: Scene, instants: Sequence[int]) -> View:
    """A view in which the target, the flight path and the axes of the communications spacecraft can all be made out."""
    path = scene.r_A.mean(axis=1)
    lengthwise = [path[-1] - path[0], *scene.z_A[-1, scene.relays]]

    def merit(view: View) -> float:
        turned = [float(np.linalg.norm(view.axes[:2] @ unit(line))) for line in lengthwise]
        clear = min(_clearance(view, scene, k) for k in instants)
        in_front = np.mean([view.before(scene.r_A[k], region.mesh).mean() for k in instants])
        return visible_share(view, region) + min(0.6, *turned) + 2.0 * min(0.05, clear) - 0.3 * float(in_front)

    return max(views_of(region), key=merit)


def _clearance(view: View, scene: Scene, k: int) -> float:
    """Least distance of a spacecraft from a relay's +z axis in the picture, as a share of its height."""
    flat = view.project(scene.r_A[k])
    height = float(np.ptp(view.project(scene.r_A[: k + 1].reshape(-1, 3)), axis=0).max()) or 1.0
    shares = [1.0]
    for j in np.flatnonzero(scene.relays):
        axis = view.project(scene.z_A[k, j]) * KM
        others = np.delete(flat, j, axis=0) - flat[j]
        ahead = others @ axis > 0.0
        across = np.abs(others @ np.array([-axis[1], axis[0]])) / max(float(np.linalg.norm(axis)), 1e-9)
        shares.extend(across[ahead] / height)
    return min(shares)
