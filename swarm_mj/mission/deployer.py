"""What the mothership's deployer can do, held against a plan."""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.mission.trajectories import Deployment
from swarm_mj.scenarios.schema_mothership import Deployer
from swarm_mj.typing import Array

#: Excess over a limit that is rounding.
ROUNDING = 1e-9
_PATHS = "change the visiting points, times or design.observers of it, or mothership.velocity"


def check_deployer(deployer: Deployer, deployment: Deployment, candidates: int | None = None) -> None:
    """See that the deployer can release the swarm as planned.

    Args:
        deployer: Its limits.
        deployment: The plan.
        candidates: Only so many are looked at, each for itself, as the candidates of a design; None: all are released.

    Raises:
        PathError: It cannot; the message names the spacecraft, the value, the limit and the remedy.
    """
    speed = deployment.delta_v[:candidates]
    if deployer.max_speed_m_s is not None:
        _require(
            speed, deployer.max_speed_m_s, "max_speed_m_s", "is released at {:.4g} m/s", "beyond the deployer's speed"
        )
    if deployer.cone_axis_N is not None:
        angle = _angles_deg(deployer, deployment)[:candidates]
        limit = deployer.cone_half_angle_deg
        _require(
            angle, limit, "cone_half_angle_deg", "is released {:.4g} deg off cone_axis_N", "outside the deployer's cone"
        )
    if candidates is None and deployer.spacing_s is not None:
        _check_spacing(deployer.spacing_s, deployment.release_s)


def _require(values: Array, limit: float, key: str, words: str, reason: str) -> None:
    beyond = np.flatnonzero(values > limit * (1.0 + ROUNDING))
    if len(beyond):
        worst = int(beyond[np.argmax(values[beyond])])
        raise PathError(
            f"sc{worst + 1} {words.format(values[worst])}: mothership.deployer.{key} = {limit:g} is the most; {_PATHS}",
            reason,
            beyond.tolist(),
        )


def _angles_deg(deployer: Deployer, deployment: Deployment) -> Array:
    """Angles between the pushes and the cone's axis [deg], shape (n,); 0 where there is no push."""
    push = deployment.v0_N - deployment.release_mothership_v_N
    axis = deployment.release_mothership_v_N
    if deployer.cone_axis_N != "velocity":
        axis = np.broadcast_to(np.array(deployer.cone_axis_N, float), push.shape)
    elif not np.linalg.norm(axis, axis=1).all():
        raise ScenarioError(
            "mothership.deployer.cone_axis_N = 'velocity': the mothership is at rest; give three components in N"
        )
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(push, axis), axis=1), np.einsum("ni,ni->n", push, axis)))


def _check_spacing(least: float, release_s: Array) -> None:
    order = np.argsort(release_s, kind="stable")
    gaps = np.diff(release_s[order])
    close = np.flatnonzero(gaps < least * (1.0 - ROUNDING))
    if len(close):
        first, second = (int(j) + 1 for j in order[close[0] : close[0] + 2])
        raise PathError(
            f"sc{second} is released {gaps[close[0]]:g} s after sc{first}: mothership.deployer.spacing_s = {least:g} is the "
            "least; change release_s in design.observers (the communications spacecraft has design.release_s)",
            "too soon after another release",
            [int(j) for j in order[close + 1]],
        )
