"""SwarmObserve-v0 as gymnasium asks for it: its own checker, determinism, episode ends, bad arguments, memory."""

import os
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.rendering import Window

from swarm_mj.errors import ScenarioError, SwarmError
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.simulation import Simulation

from .flights import place

LEVELS = ("torque", "pointing", "role")


def make(control="role", **arguments):
    return gymnasium.make("SwarmObserve-v0", control=control, **arguments)


@pytest.fixture(scope="module")
def gl():
    available, reason = gl_available()
    if not available:
        pytest.skip(reason)


@pytest.fixture(scope="module", params=LEVELS)
def env(request):
    env = make(request.param)
    yield env
    env.close()


@pytest.fixture(scope="module")
def roles():
    env = make("role").unwrapped
    yield env
    env.close()


def episode(env, seed, steps=None):
    """Observations, rewards and infos of an episode with random actions."""
    observation, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    rows, rewards, infos, done = [observation], [], [info], False
    while not done and (steps is None or len(rewards) < steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        rows.append(observation)
        rewards.append(reward)
        infos.append(info)
        done = terminated or truncated
    return np.array(rows), np.array(rewards), infos


@pytest.mark.parametrize("control", LEVELS)
def test_gymnasiums_checker_has_no_complaint(control):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = make(control)
        check_env(env.unwrapped, skip_render_check=True)
        env.close()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("control", LEVELS)
@pytest.mark.parametrize("mode", [None, "rgb_array"])
def test_gymnasiums_checker_has_no_complaint_about_rendering(control, mode, monkeypatch):
    # The checker tries every render mode, the window too.
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = make(control, render_mode=mode)
        check_env(env.unwrapped)
        env.close()


def test_observations_of_random_episodes_lie_in_the_space_and_are_finite(env):
    rows, rewards, _ = episode(env, seed=3)
    assert len(rows) == 151
    assert np.isfinite(rows).all()
    assert np.isfinite(rewards).all()
    assert all(row in env.observation_space for row in rows)
    assert np.isfinite(env.observation_space.low).all() and np.isfinite(env.observation_space.high).all()


def test_the_same_seed_gives_the_same_episode_and_another_seed_another(env):
    first, rewards, _ = episode(env, seed=5, steps=40)
    again, rewards_again, _ = episode(env, seed=5, steps=40)
    other, _, _ = episode(env, seed=6, steps=40)
    assert np.array_equal(first, again)
    assert np.array_equal(rewards, rewards_again)
    assert not np.array_equal(first[0], other[0])


def test_episodes_are_the_same_in_a_new_process():
    code = (
        "import gymnasium, numpy as np\n"
        f"for control in {LEVELS}:\n"
        "    env = gymnasium.make('swarm_mj.envs:SwarmObserve-v0', control=control)\n"
        "    rows = [env.reset(seed=11)[0]]; env.action_space.seed(11)\n"
        "    for _ in range(30): rows.append(env.step(env.action_space.sample())[0])\n"
        "    print(np.array(rows).tobytes().hex())\n"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    for control, rows in zip(LEVELS, there, strict=True):
        env = make(control)
        assert episode(env, seed=11, steps=30)[0].tobytes().hex() == rows
        env.close()


def test_successive_resets_without_a_seed_start_differently_and_reproducibly(roles):
    starts = []
    for _ in range(2):
        starts.append([roles.reset(seed=1)[0], roles.reset()[0], roles.reset()[0]])
    assert np.array_equal(starts[0], starts[1])
    assert not np.array_equal(starts[0][0], starts[0][1])
    assert not np.array_equal(starts[0][1], starts[0][2])


def test_observations_share_no_memory_with_each_other_or_the_environment(roles):
    rows = [roles.reset(seed=0)[0]]
    for _ in range(3):
        rows.append(roles.step(roles.action_space.sample())[0])
    kept = [row.copy() for row in rows]
    batch = roles.batch
    for i, row in enumerate(rows):
        assert not np.shares_memory(row, batch.observation) and not np.shares_memory(row, batch.flights.qpos)
        assert not any(np.shares_memory(row, other) for other in rows[:i])
        row[:] = 7.0
    follow, *_ = roles.step(np.full(5, 16))
    roles.reset(seed=0)
    roles.action_space.seed(None)
    assert not (follow == 7.0).any()
    assert all(row in roles.observation_space for row in kept)


def test_the_caller_may_change_its_action_afterwards():
    ends = []
    for spoil in (False, True):
        env = make("torque")
        env.reset(seed=0)
        action = np.full(15, 0.01, np.float32)
        env.step(action)
        if spoil:
            action[:] = 1.0
        ends.append(env.step(np.zeros(15, np.float32))[0])
        env.close()
    assert np.array_equal(*ends)


def test_the_specification_survives_pickling_and_makes_the_same_environment(env):
    spec = pickle.loads(pickle.dumps(env.spec))
    twin = gymnasium.make(spec)
    assert twin.unwrapped.action_space == env.unwrapped.action_space
    assert np.array_equal(twin.reset(seed=4)[0], env.reset(seed=4)[0])
    twin.close()
    scenario = load_scenario("eros-observe", ["camera.half_angle_deg=4"])
    with_object = gymnasium.make(pickle.loads(pickle.dumps(make(scenario=scenario).spec)))
    assert with_object.unwrapped.plan.scenario == scenario


def test_a_flight_ends_by_truncation_at_the_scenarios_duration_and_asks_for_a_reset(roles):
    roles.reset(seed=0)
    for k in range(150):
        *_, terminated, truncated, info = roles.step(np.full(5, 16))
        assert (terminated, truncated) == (False, k == 149)
    assert info["time_s"] == 1500.0
    with pytest.raises(gymnasium.error.ResetNeeded):
        roles.step(np.full(5, 16))
    roles.reset()
    roles.step(np.full(5, 16))


def test_a_diverged_flight_terminates_with_the_last_finite_observation(roles):
    roles.reset(seed=0)
    before, *_ = roles.step(np.full(5, 16))
    place(roles.batch.flights, 0, 0, rate=np.nan)
    observation, reward, terminated, truncated, info = roles.step(np.full(5, 16))
    assert (terminated, truncated, info["end"]) == (True, False, "diverged")
    assert "sc1" in info["cause"]
    assert np.array_equal(observation, before)
    assert reward == -1.0
    observation, _ = roles.reset(seed=0)
    assert np.isfinite(observation).all()


def test_a_spacecraft_that_hits_the_body_ends_the_episode(roles):
    roles.reset(seed=0)
    above = roles.plan.points_A[0] @ roles.plan.environment.C_AN(0.0)
    batch = roles.batch
    place(batch.flights, 0, 0, position=above, velocity=-above / 5.0)
    batch.now.r_A[0, 0] = roles.plan.points_A[0]
    *_, terminated, truncated, info = roles.step(np.full(5, 16))
    assert (terminated, truncated, info["end"]) == (True, False, "impact")
    assert info["reward_terms"]["loss"] == -1.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"control": "joystick"}, ["control", "joystick", "torque, pointing, role"]),
        ({"scenario": "eros-obsreve"}, ["eros-obsreve", "Did you mean 'eros-observe'"]),
        ({"scenario": "/nowhere/a.yaml"}, ["/nowhere/a.yaml"]),
        ({"step_s": 0.7}, ["step_s = 0.7", "control.period_s"]),
        ({"step_s": 7.0}, ["step_s = 7.0", "duration_s = 1500"]),
        ({"step_s": -10.0}, ["step_s = -10.0"]),
        ({"step_s": float("nan")}, ["step_s = nan"]),
        ({"patches": 15}, ["patches = 15", "square"]),
        ({"patches": 10_000}, ["patches = 10000", "at most the number of cells of this target"]),
        ({"patches": 529}, ["patches = 529", "holds no cell"]),
        ({"observer": "eyes"}, ["eyes", "raycast"]),
        ({"complete": 0.0}, ["complete = 0.0"]),
        ({"reward_weights": {"fun": 1.0}}, ["fun", "seen, delivered"]),
        ({"reward_weights": {"seen": float("inf")}}, ["reward_weights['seen']", "finite"]),
        ({"earth_rate_bit_s": 0.0}, ["earth_rate_bit_s = 0.0"]),
    ],
)
def test_bad_arguments_are_clear_errors(arguments, words):
    with pytest.raises(SwarmError) as caught:
        make(**{"control": "role", **arguments})
    for word in words:
        assert word in str(caught.value)


def test_an_unknown_render_mode_and_unknown_reset_options_are_clear_errors(roles):
    with pytest.raises(ScenarioError, match="render_mode = 'ansi'"):
        type(roles)(render_mode="ansi")
    with pytest.raises(ScenarioError, match="flight_sede"):
        roles.reset(options={"flight_sede": 3})
    with pytest.raises(ScenarioError, match="flight_seed = -3"):
        roles.reset(options={"flight_seed": -3})


def test_actions_outside_the_space_are_refused_before_anything_moves(env):
    env.reset(seed=0)
    inner, space = env.unwrapped, env.action_space
    before = inner.batch.flights.qpos.copy()
    good = space.sample()
    bad = [good[:-1], good + 100, np.full(good.shape, np.nan), "left", None]
    for action in bad:
        with pytest.raises(gymnasium.error.InvalidAction, match="action space"):
            inner.step(action)
    assert np.array_equal(inner.batch.flights.qpos, before)
    inner.step(list(good))


def test_a_thousand_resets_do_not_grow_the_process(roles):
    def use(times):
        for k in range(times):
            roles.reset(seed=k)
            roles.step(roles.action_space.sample())

    use(100)
    before = _resident_mib()
    use(1000)
    assert _resident_mib() - before < 8.0


def test_a_closed_environment_may_be_closed_again_but_not_flown():
    env = make("role")
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        env.unwrapped.reset()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_rendering_shows_the_swarm_and_leaves_the_flight_alone():
    drawn, plain = make("role", render_mode="rgb_array", width=320, height=200), make("role")
    for env in (drawn, plain):
        env.reset(seed=2)
    first = drawn.render()
    assert first.shape == (200, 320, 3) and first.dtype == np.uint8
    assert first.std() > 5.0
    for k in range(58):
        a, b = drawn.step(np.full(5, 16))[0], plain.step(np.full(5, 16))[0]
        if k % 10 == 7:
            later = drawn.render()
    assert np.array_equal(a, b)
    assert not np.array_equal(first, later)
    assert not np.shares_memory(first, later)
    assert np.abs(first.astype(int) - later).max() > 50
    drawn.close()
    plain.close()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_a_window_shows_the_picture_and_gymnasiums_checker_accepts_it(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = make("role", render_mode="human", width=320, height=200)
        env.reset(seed=0)
        shown = pygame.surfarray.array3d(pygame.display.get_surface())
        assert shown.shape == (320, 200, 3) and shown.std() > 5.0
        assert env.render() is None
        check_env(env.unwrapped)
        env.close()
        assert not pygame.display.get_init()


def test_without_a_display_the_window_is_refused_with_a_way_out(monkeypatch):
    pytest.importorskip("pygame")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SwarmError, match="rgb_array"):
        Window(64, 64, 10)


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_rendering_again_and_again_keeps_one_context_and_closing_frees_it():
    def use():
        env = make("role", render_mode="rgb_array", width=64, height=64)
        for seed in range(3):
            env.reset(seed=seed)
            env.render()
        drawing = env.unwrapped._renderer._drawing
        env.reset()
        env.render()
        assert env.unwrapped._renderer._drawing is drawing
        env.close()

    for _ in range(4):
        use()
    files, memory = len(os.listdir("/proc/self/fd")), _resident_mib()
    for _ in range(8):
        use()
    assert len(os.listdir("/proc/self/fd")) <= files
    assert _resident_mib() - memory < 40.0


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_horizon_maps_and_rays_see_what_face_id_buffers_see_within_a_percent_of_the_target():
    shares = []
    for kind in ("faceid", "horizon", "raycast"):
        env = make("role", observer=kind)
        env.reset(seed=0)
        for _ in range(75):
            info = env.step(np.full(5, 16))[-1]
        shares.append(info["coverage_percent"])
        env.close()
    assert shares[1:] == pytest.approx([shares[0]] * 2, abs=1.0)
    assert shares[0] > 10.0


def test_a_simulation_is_built_once_and_flown_again(roles, monkeypatch):
    def refuse(*args, **keys):
        raise AssertionError("reset built a simulation")

    monkeypatch.setattr(Simulation, "__init__", refuse)
    roles.reset(seed=0)
    roles.step(np.full(5, 16))


@pytest.mark.slow
def test_it_works_in_spawned_worker_processes():
    vector = gymnasium.make_vec(
        "swarm_mj.envs:SwarmObserve-v0", num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"}
    )
    single = make("role")
    observations, _ = vector.reset(seed=[1, 2])
    actions = np.full((2, 5), 16)
    after, *_ = vector.step(actions)
    for k in range(2):
        assert np.array_equal(single.reset(seed=k + 1)[0], observations[k])
        assert np.array_equal(single.step(actions[k])[0], after[k])
    vector.close()
    single.close()


def _resident_mib():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
