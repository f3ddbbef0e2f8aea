"""The numbers of an observation: their places with three and with four wheels, and what they tell."""

import gymnasium
import numpy as np
import pytest

from swarm_mj.scenarios.loading import load_scenario

from .flights import CENTRE, ID

LAYOUTS = pytest.mark.parametrize(("layout", "w"), [("orthogonal", 3), ("pyramid", 4)])


def make(layout, **arguments):
    scenario = load_scenario("eros-observe", [f"spacecraft.wheel_layout={layout}"])
    return gymnasium.make(ID, scenario=scenario, **arguments).unwrapped


@LAYOUTS
def test_the_block_of_a_spacecraft_is_laid_out_as_the_docstring_says(layout, w):
    env = make(layout, control="torque")
    assert env.action_space.shape == (w * 5,)
    assert env.observation_space.shape == ((26 + w) * 5 + 16 + 3,)
    env.reset(seed=0)
    observation, *_ = env.step(np.random.default_rng(0).uniform(-0.2, 0.2, 5 * w).astype(np.float32))
    block, parts = observation[: 5 * (26 + w)].reshape(5, 26 + w), env.observation_layout.split(observation)
    assert block[:, 18 : 18 + w] == pytest.approx(env.state.wheel_speed / (6000.0 * np.pi / 30.0), rel=1e-6)
    places = {"imaging": slice(18 + w, 19 + w), "link": slice(19 + w, 20 + w), "stored": slice(20 + w, 21 + w)}
    for name, place in {**places, "role": slice(21 + w, 26 + w)}.items():
        assert np.array_equal(block[:, place], parts[name])
    assert (parts["role"].sum(axis=1) == 1.0).all()
    env.close()


def test_the_observation_tells_time_positions_and_patches(roles):
    roles.reset(seed=0)
    for _ in range(60):
        observation, *_ = roles.step(np.full(5, CENTRE))
    parts = roles.observation_layout.split(observation)
    assert parts["time_left"] == pytest.approx(1.0 - 600.0 / 1500.0)
    # At 600 s every observer is at its visiting point, which the plan gives in A.
    assert np.allclose(parts["position"] * 35_000.0, roles.plan.points_A, atol=0.1 + 0.002)
    assert np.allclose(np.linalg.norm(parts["boresight"], axis=1), 1.0, atol=1e-6)
    assert np.allclose((parts["boresight"] * parts["x_axis"]).sum(1), 0.0, atol=1e-6)
    # The body's centre is looked at: boresights run against positions.
    unit = parts["position"] / np.linalg.norm(parts["position"], axis=1, keepdims=True)
    assert ((parts["boresight"] * unit).sum(1) < -0.99999).all()
    seen, area = roles.batch.totals.seen[0], roles.plan.region.area
    assert parts["patches"] @ roles.patches.area / area.sum() == pytest.approx(parts["seen"], abs=1e-6)
    assert parts["seen"] == pytest.approx(area[seen].sum() / area.sum(), abs=1e-6)


def test_velocities_are_the_rate_of_the_positions_in_the_turning_frame():
    env = gymnasium.make(ID, step_s=0.5).unwrapped
    env.reset(seed=0)
    rows = [env.observation_layout.split(env.step(np.full(5, CENTRE))[0]) for _ in range(3)]
    state_r = [row["position"].astype(float) * 35_000.0 for row in rows]
    speed = rows[1]["velocity"].astype(float) * 50.0
    # Single precision keeps 30 km to 2 mm, over 1 s.
    assert np.allclose((state_r[2] - state_r[0]) / 1.0, speed, atol=0.01)
    env.close()


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_a_camera_that_is_off_is_observed(kind, begin):
    """From 200 s to 300 s the camera of spacecraft 2 is off: its flag falls, everybody else's stays, and it comes back."""
    fault = "faults=[{kind: camera_off, spacecraft: sc2, at_s: 200, duration_s: 100}]"
    flights = begin(kind, scenario=load_scenario("eros-observe", [fault]))
    layout, imaging = flights.task.observation_layout, {}
    for _ in range(35):
        rows = flights.step(np.full(5, CENTRE))[0]
        imaging[flights.t] = [layout.split(row)["imaging"].ravel().tolist() for row in rows]
    for t in (190.0, 310.0):
        assert all(row == [1.0] * 5 for row in imaging[t])
    assert all(row == [1.0, 0.0, 1.0, 1.0, 1.0] for row in imaging[250.0])


def test_torques_held_for_the_default_step_can_hold_an_attitude(begin):
    """Feedback of attitude error and rate by whoever learns: motor torques K sigma + P omega settle in 2 min."""
    flights = begin("single", control="torque")
    assert flights.task.step_s == flights.plan.scenario.control.period_s
    limit, action = flights.plan.properties.max_wheel_torque, np.zeros(15)
    inertia = np.diag(flights.plan.properties.inertia_B)
    for _ in range(240):
        parts = flights.parts(flights.step(np.clip(action, -1.0, 1.0))[0])
        sigma, omega = parts["sigma_BR"][0].astype(float), parts["rate"][0] * 0.1
        action = (inertia * (0.1 * sigma + 0.3 * omega) / limit).ravel()
    assert np.abs(sigma).max() < 0.01
    assert np.abs(omega).max() < 0.01
