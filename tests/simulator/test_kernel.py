"""The equations of free gyrostats against SciPy's DOP853, conservation laws, closed forms and MuJoCo."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from swarm_mj.simulator.kernel import move, turn_gyrostats
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties

from .flying import angle

N, SPIN = 2, 2.3e-5
#: Rows of unit length; the first three are orthogonal.
AXES = np.vstack((np.eye(3), [[1 / np.sqrt(3)] * 3]))
#: Two bodies with products of inertia, wheels locked [kg m^2].
INERTIA = np.array(
    [
        turn @ np.diag(moments) @ turn.T
        for turn, moments in zip(
            Rotation.from_rotvec([[0.3, -0.2, 0.5], [-1.0, 0.4, 0.1]]).as_matrix(),
            ([0.08, 0.07, 0.02], [0.05, 0.09, 0.06]),
            strict=True,
        )
    ]
)


class Bodies:
    """Two tumbling bodies with fast wheels."""

    def __init__(self, wheels=4):
        rng = np.random.default_rng(3)
        self.axes, self.inertia = AXES[:wheels].copy(), INERTIA.copy()
        self.q = rng.normal(size=(N, 4))
        self.q /= np.linalg.norm(self.q, axis=1, keepdims=True)
        self.omega, self.speed = rng.uniform(-0.1, 0.1, (N, 3)), rng.uniform(-400.0, 400.0, (N, wheels))
        self.h = SPIN * (self.speed + self.omega @ self.axes.T)
        self.motor, self.torque_N = np.zeros((N, wheels)), np.zeros((N, 3))

    @property
    def hub(self):
        """Inertias without the wheels' spin."""
        return self.inertia - SPIN * self.axes.T @ self.axes

    def fly(self, dt, steps):
        states = self.q, self.omega, self.h, self.speed
        turn_gyrostats(*states, self.motor, self.torque_N, self.inertia, self.axes, SPIN, dt, steps)
        return self

    def momentum_N(self):
        spin = np.einsum("nij,nj->ni", self.hub, self.omega) + self.h @ self.axes
        return Rotation.from_quat(self.q, scalar_first=True).apply(spin)

    def energy(self):
        """Of hubs and wheels, shape (n,) [J]."""
        return 0.5 * np.einsum("ni,nij,nj->n", self.omega, self.hub, self.omega) + (self.h**2).sum(axis=1) / (2 * SPIN)

    def by_scipy(self, j, duration):
        """Attitude and rate of one of them by DOP853."""
        J, h0, u, tau_N = self.hub[j], self.h[j].copy(), self.motor[j], self.torque_N[j]

        def rhs(t, y):
            omega = y[4:]
            rate = Rotation.from_quat(y[:4], scalar_first=True)
            spin = J @ omega + (h0 + u * t) @ self.axes
            torque = rate.inv().apply(tau_N) - u @ self.axes - np.cross(omega, spin)
            w, v = y[0], y[1:4]
            turn = 0.5 * np.concatenate(([-v @ omega], w * omega + np.cross(v, omega)))
            return np.concatenate((turn, np.linalg.solve(J, torque)))

        start = np.concatenate((self.q[j], self.omega[j]))
        end = solve_ivp(rhs, (0.0, duration), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        return end[:4] / np.linalg.norm(end[:4]), end[4:]


@pytest.mark.parametrize("wheels", [3, 4])
def test_motion_under_motors_and_torques_agrees_with_dop853(wheels):
    bodies = Bodies(wheels)
    bodies.motor[:] = np.random.default_rng(1).uniform(-3e-3, 3e-3, (N, wheels))
    bodies.torque_N[:] = [[2e-3, -1e-3, 3e-3], [0.0, 4e-3, -1e-3]]
    expected, h0 = [bodies.by_scipy(j, 5.0) for j in range(N)], bodies.h.copy()
    bodies.fly(0.05, 100)
    for j, (q, omega) in enumerate(expected):
        assert angle(bodies.q[j], q) < 1e-8
        np.testing.assert_allclose(bodies.omega[j], omega, rtol=0, atol=1e-8)
        relative = (h0[j] + 5.0 * bodies.motor[j]) / SPIN - bodies.axes @ omega
        np.testing.assert_allclose(bodies.speed[j], relative, rtol=1e-9)


def test_attitude_converges_at_fourth_order():
    expected, _ = Bodies().by_scipy(0, 20.0)
    errors = [angle(Bodies().fly(dt, round(20.0 / dt)).q[0], expected) for dt in (0.4, 0.2, 0.1)]
    assert errors[0] / errors[1] > 12.0 and errors[1] / errors[2] > 12.0


def test_momentum_stays_in_inertial_space_whatever_the_motors_do_and_grows_by_torques_applied():
    bodies, rng = Bodies(), np.random.default_rng(1)
    before = bodies.momentum_N()
    for _ in range(20):
        bodies.motor[:] = rng.uniform(-4e-3, 4e-3, bodies.motor.shape)
        bodies.fly(0.02, 25)
    assert np.abs(bodies.momentum_N() - before).max() < 1e-8 * np.abs(before).max()
    bodies.torque_N[:] = 1e-3, -2e-3, 3e-3
    np.testing.assert_allclose(bodies.fly(0.02, 100).momentum_N() - before, 2.0 * bodies.torque_N, rtol=1e-6)


def test_free_motion_keeps_its_energy_and_motors_add_their_work():
    bodies = Bodies()
    body = bodies.energy() - (bodies.h**2).sum(axis=1) / (2 * SPIN)
    before = bodies.energy()
    assert np.abs(bodies.fly(0.02, 5000).energy() - before).max() < 1e-8 * body.min()
    bodies.motor[:] = 1e-4
    # In so short a time the speeds change evenly, and the trapezoidal rule gives the work.
    speeds, before = bodies.speed.copy(), bodies.energy()
    bodies.fly(0.01, 1)
    work = 0.01 * (bodies.motor * 0.5 * (speeds + bodies.speed)).sum(axis=1)
    np.testing.assert_allclose(bodies.energy() - before, work, rtol=1e-5)


def test_positions_follow_the_parabola_of_gravity_and_thrust():
    work, r, v = np.zeros((len(Slot), N, 3)), np.array([[1e4, 2.0, 3.0]] * N), np.array([[5.0, -6.0, 7.0]] * N)
    work[Slot.A], thrust, mass = [[1e-2, 0, 0], [0, 2e-2, 0]], np.array([[0, 0, 0.4], [0, 0, 0]]), np.array([8.0, 4.0])
    a, start, speed = work[Slot.A] + thrust / mass[:, None], r.copy(), v.copy()
    move(r, v, work, thrust, mass, 30.0)
    np.testing.assert_allclose(r, start + 30.0 * speed + 450.0 * a, rtol=1e-15)
    np.testing.assert_allclose(v, speed + 30.0 * a, rtol=1e-15)


@pytest.mark.parametrize("layout", ["orthogonal", "pyramid"])
def test_mujoco_turns_the_same_spacecraft_with_wheels_as_bodies_in_the_same_way(layout):
    """Large torques, of which every term shows."""
    vertices = 1e3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    shape = ShapeModel(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    properties = SpacecraftProperties(wheel_layout=layout)
    swarm = build_model(N, shape=shape, properties=properties, timestep=0.02)
    data, w, rng = mujoco.MjData(swarm.mjmodel), properties.n_wheels, np.random.default_rng(7)
    bodies = Bodies(3)
    bodies.axes, bodies.inertia = properties.wheel_axes_B.copy(), np.tile(properties.inertia_B, (N, 1, 1))
    bodies.speed = rng.uniform(-300.0, 300.0, (N, w))
    spin = properties.wheel_spin_inertia
    bodies.h = spin * (bodies.speed + bodies.omega @ bodies.axes.T)
    bodies.motor, bodies.torque_N = rng.uniform(-3e-3, 3e-3, (N, w)), 2e-3 * rng.normal(size=(N, 3))
    qpos = np.hstack((np.zeros((N, 3)), bodies.q, np.zeros((N, w))))
    swarm.set_state(data, qpos, np.hstack((np.zeros((N, 3)), bodies.omega, bodies.speed)))
    data.ctrl[swarm.layout.ctrl] = bodies.motor
    data.xfrc_applied[swarm.hub_body, 3:] = bodies.torque_N
    mujoco.mj_step(swarm.mjmodel, data, nstep=500)
    states = bodies.q, bodies.omega, bodies.h, bodies.speed
    turn_gyrostats(*states, bodies.motor, bodies.torque_N, bodies.inertia, bodies.axes, spin, 0.02, 500)
    qpos, qvel = swarm.state(data)
    assert np.abs(bodies.omega).min() > 1e-3
    assert angle(bodies.q, qpos[:, 3:7]).max() < 1e-8
    np.testing.assert_allclose(bodies.omega, qvel[:, 3:6], rtol=0, atol=1e-8)
    np.testing.assert_allclose(bodies.speed, qvel[:, 6:], rtol=1e-8)
