"""Forces on spacecraft of several bodies: each body's weight, and the tide across the spacecraft.

A rigid spacecraft is pulled at its centre of mass, which is its hub's origin. One with panels on hinges or a sliding mass is
pulled at each of its bodies, by the acceleration at the centre of mass of the whole times the body's mass: the pull then bends
no hinge, as in free fall. With `gravity_gradient_torque`, body i is pulled besides by m_i G (r_i - r_C), and turned by
3 GM / r^5 r x (I_i r), with the gradient G = GM / r^3 (3 r r^T / r^2 - 1) of the central field. The forces add up to nothing,
and all of it to the torque of the rigid whole (Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.4).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.simulator.loop_state import LoopState
from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Array


def evaluate_at_centres(state: LoopState) -> None:
    """Move the places at which gravity is evaluated, `Slot.R_A`, from the hubs' origins to the centres of mass."""
    centres, _ = state.model.centres_of_mass(state.data)
    state.work[Slot.R_A] += (centres - state.work[Slot.R]) @ state.C_mid.T


def weigh_bodies(state: LoopState) -> None:
    """Hold the weight of every body, and the tide where it is asked for; gravity has been put into `Slot.A`."""
    model, bodies = state.model.mjmodel, state.model.layout.bodies
    forces = state.data.xfrc_applied
    forces[bodies, :3] = model.body_mass[bodies][..., None] * state.work[Slot.A][:, None]
    if state.gradient_gm > 0.0:
        _add_tide(state)


def _add_tide(state: LoopState) -> None:
    model, data, bodies = state.model.mjmodel, state.data, state.model.layout.bodies
    r_N = (state.work[Slot.R_A] @ state.C_mid)[:, None]
    arm_N = data.xipos[bodies] - data.subtree_com[state.hub][:, None]
    forces, axes = data.xfrc_applied, data.ximat[bodies].reshape(*bodies.shape, 3, 3)
    forces[bodies, :3] += model.body_mass[bodies][..., None] * tide(arm_N, r_N, state.gradient_gm)
    r_body = np.einsum("nbij,nbi->nbj", axes, np.broadcast_to(r_N, arm_N.shape))  # in the principal axes of each body
    distance = np.linalg.norm(r_N, axis=-1, keepdims=True)
    torque = 3.0 * state.gradient_gm / distance**5 * np.cross(r_body, model.body_inertia[bodies] * r_body)
    forces[bodies, 3:] = np.einsum("nbij,nbj->nbi", axes, torque)


def tide(arm: Array, r: Array, gm: float) -> Array:
    """Acceleration by a central field at `r + arm` less that at `r`, to first order, shape (..., 3) [m/s^2].

    Args:
        arm: From the one place to the other, shape (..., 3) [m].
        r: From the attracting centre, shape (..., 3) [m].
        gm: Gravitational parameter [m^3/s^2].
    """
    distance = np.linalg.norm(r, axis=-1, keepdims=True)
    along = (arm * r).sum(axis=-1, keepdims=True) / distance**2
    return gm / distance**3 * (3.0 * along * r - arm)
