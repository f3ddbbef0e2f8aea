"""What faults do to the arrays of a flight, against the motion of what lies on a turning body."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.mujoco import principal_axes


@pytest.fixture
def resting():
    """A flight in which the first spacecraft is said to have hit the body where it is, and the place in A."""
    plan = make_plan(load_scenario("eros-quick", {"faults": [{"kind": "camera_off", "spacecraft": "sc2", "at_s": 0}]}))
    simulation = make_simulation(plan)
    simulation.run(10.0, 5.0)
    place_A = np.array([7e3, 3e3, -4e3])
    simulation.injection.impact(0, place_A)
    return simulation, place_A


def test_what_rests_on_the_body_moves_with_its_surface(resting):
    simulation, place_A = resting
    record = simulation.run(60.0, 5.0)
    environment, times = simulation.environment, record.time[record.time > 10.0]
    r, v = (record.samples[name][record.time > 10.0, 0] for name in ("r_BN_N", "v_BN_N"))
    h = 1.0
    for t, r_N, v_N in zip(times, r, v, strict=True):
        before, now, after = (environment.C_AN(t + dt).T @ place_A for dt in (-h, 0.0, h))
        np.testing.assert_allclose(r_N, now, atol=1e-6)
        np.testing.assert_allclose(v_N, (after - before) / (2 * h), atol=1e-5)
    assert np.linalg.norm(v, axis=1).min() > 1.0


def test_principal_axes_take_the_tensor_apart_and_keep_the_order_of_a_diagonal_one():
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    inertia = turn @ np.diag([1.0, 2.0, 2.5]) @ turn.T
    moments, quaternion = principal_axes(inertia)
    axes = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, inertia, atol=1e-12)
    assert principal_axes(np.diag([3.0, 1.0, 2.0]))[0].tolist() == [3.0, 1.0, 2.0]
