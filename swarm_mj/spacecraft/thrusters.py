"""Cold-gas thrusters: where nozzles stand, and how a wished force is shared among them.

Every nozzle is a site of the hub whose name begins with `thruster_`. Gas leaves along the site's +z axis, the direction in
which the nozzle points, and pushes the spacecraft the other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
from scipy.optimize import nnls

from swarm_mj.errors import MissionError
from swarm_mj.spacecraft.elements import name_of, title_of
from swarm_mj.typing import Array

#: How the names of nozzles begin.
NOZZLE = "thruster_"
#: Cant of the nozzles of `four_z` [rad]: their gas clears whatever stands beside the module, and 3 % of the thrust is lost.
CANT = np.radians(15.0)
#: Weight of a torque, over the longest lever arm, beside a force: forces come first, for wheels hold the attitude.
TORQUE_WEIGHT = 1e-4
#: Weight of the nozzles' thrusts: of shares that push alike the least are chosen, which are the evenest.
THRUST_WEIGHT = 1e-6
#: Up to so many nozzles every choice of open ones is tried, for all spacecraft at once; SciPy solves for more, one by one.
MOST_TRIED = 8
#: A direction is reached where the force comes so close to the wish, relative to it.
REACHED = 1e-3


@dataclass(frozen=True)
class Nozzles:
    """Places and directions of the m nozzles of a spacecraft."""

    position_B: Array  #: relative to the hub's origin, shape (m, 3) [m]
    exhaust_B: Array  #: unit vectors along which gas leaves, shape (m, 3)


def packaged_nozzles(layout: str, size: Sequence[float]) -> Nozzles:
    """Nozzles of the packaged spacecraft.

    Args:
        layout: six: in the middle of every face; four_z: at the corners of the -z face, canted outwards.
        size: Edges of the box [m].
    """
    if layout == "six":
        exhaust = np.vstack((np.eye(3), -np.eye(3)))
        return Nozzles(0.5 * np.asarray(size) * exhaust, exhaust)
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    exhaust = np.column_stack((np.sin(CANT) / np.sqrt(2.0) * corners, np.full(4, -np.cos(CANT))))
    place = np.column_stack((0.8 * corners, np.full(4, -1.0)))
    return Nozzles(0.5 * np.asarray(size) * place, exhaust)


def add_nozzles(hub: mujoco.MjsBody, nozzles: Nozzles) -> None:
    """Put a site on the hub for every nozzle."""
    for number, (position, exhaust) in enumerate(zip(nozzles.position_B, nozzles.exhaust_B, strict=True), 1):
        turn = np.empty(4)
        mujoco.mju_quatZ2Vec(turn, exhaust)
        hub.add_site(name=f"{NOZZLE}{number}", pos=position.tolist(), quat=turn.tolist(), group=3, size=[0.005] * 3)


def read_nozzles(model: mujoco.MjModel, hub: int, prefix: str = "") -> Nozzles:
    """The nozzles of a spacecraft of a compiled model.

    Args:
        model: Compiled.
        hub: Number of the hub's body.
        prefix: Of the spacecraft's names.

    Raises:
        MissionError: There are none, or one stands on another body than the hub.
    """
    sites = [i for i in range(model.nsite) if name_of(model, "site", i).startswith(prefix + NOZZLE)]
    if not sites:
        raise MissionError(
            f"spacecraft.thrusters: {title_of(model, 'body', hub)} has no nozzles; give it sites whose names begin with "
            f"{NOZZLE}, gas leaving along their +z axis"
        )
    for site in sites:
        if model.site_bodyid[site] != hub:
            body = title_of(model, "body", int(model.site_bodyid[site]))
            raise MissionError(
                f"spacecraft.thrusters: {title_of(model, 'site', site)} stands on {body}: nozzles must be sites of the hub, "
                f"{title_of(model, 'body', hub)}"
            )
    matrices = np.empty((len(sites), 9))
    for matrix, site in zip(matrices, sites, strict=True):
        mujoco.mju_quat2Mat(matrix, model.site_quat[site])
    return Nozzles(model.site_pos[sites].copy(), matrices.reshape(-1, 3, 3)[:, :, 2].copy())


class ThrusterAllocation:
    """Shares wished forces among nozzles that can only push: non-negative least squares.

    For a wish w it finds thrusts f >= 0 that minimise |F f - w|^2 + (a |T f| / d)^2 + (b |f|)^2. The columns of F and T are the
    forces and torques of the nozzles, d is the longest lever arm, a and b are small. At the minimum some nozzles are open and
    the others shut; the open ones solve a linear system (Lawson and Hanson, Solving Least Squares Problems, chapter 23). All
    choices are inverted once, and of those without negative thrusts the one that costs least is taken.

    Args:
        nozzles: Where they stand.
        centre_B: What the torques are taken about, relative to the hub's origin, shape (3,) [m].

    Attributes:
        force_B: Of each nozzle at 1 N, shape (m, 3).
        torque_B: The same [m].
        reaches_all: Whether a force can be had in every direction, whatever the attitude.
        axis_B: Direction of all nozzles together, shape (3,); zeros where they cancel.
        strength: The greatest force that can be had in every direction, or else along `axis_B`, for nozzles of 1 N.
    """

    def __init__(self, nozzles: Nozzles, centre_B: Array) -> None:
        arm = nozzles.position_B - centre_B
        self.force_B = -nozzles.exhaust_B
        self.torque_B = np.cross(arm, self.force_B)
        self._m = len(arm)
        longest = max(float(np.linalg.norm(arm, axis=1).max()), 1e-6)
        self._rows = np.vstack(
            (self.force_B.T, TORQUE_WEIGHT / longest * self.torque_B.T, THRUST_WEIGHT * np.eye(self._m))
        )
        self._solvers = self._invert() if self._m <= MOST_TRIED else None
        self._describe()

    def _invert(self) -> Array:
        """Thrusts by wish for every choice of open nozzles, shape (choices, m, 3)."""
        solvers = np.zeros((2**self._m, self._m, 3))
        for solver, choice in zip(solvers, product((False, True), repeat=self._m), strict=True):
            is_open = np.array(choice)
            if is_open.any():
                # Of thrusts that push alike this is the evenest, and nothing is taken off the force for it.
                solver[is_open] = np.linalg.pinv(self._rows[:6, is_open])[:, :3]
        return solvers

    def _describe(self) -> None:
        total = self.force_B.sum(axis=0)
        size = float(np.linalg.norm(total))
        self.axis_B = total / size if size > 1e-6 else np.zeros(3)
        directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        thrusts = self.thrusts(directions)
        missing = np.linalg.norm(thrusts @ self.force_B - directions, axis=1)
        self.reaches_all = bool(missing.max() < REACHED)
        most = thrusts.max() if self.reaches_all else self.thrusts(self.axis_B[None]).max()
        self.strength = 1.0 / float(most) if most > 0.0 else 0.0

    def thrusts(self, wish_B: Array) -> Array:
        """Thrusts of the nozzles, none negative, shape (k, m) [N].

        Args:
            wish_B: Forces of k spacecraft, shape (k, 3) [N].
        """
        if self._solvers is None:
            targets = np.hstack((wish_B, np.zeros((len(wish_B), len(self._rows) - 3))))
            return np.array([nnls(self._rows, target)[0] for target in targets]).reshape(-1, self._m)
        tried = np.einsum("cmi,ki->kcm", self._solvers, wish_B)
        size = np.linalg.norm(wish_B, axis=1)
        allowed = (tried >= -1e-12 * size[:, None, None]).all(axis=2)
        left = np.einsum("kcm,rm->kcr", tried, self._rows)
        left[..., :3] -= wish_B[:, None]
        cost = np.where(allowed, (left * left).sum(axis=2), np.inf)
        return np.maximum(tried[np.arange(len(wish_B)), np.argmin(cost, axis=1)], 0.0)
