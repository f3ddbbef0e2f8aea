"""Pictures of an episode and the window that shows them."""

import os
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.observe.rendering import Window

from swarm_mj.errors import SwarmError

from .flights import ID, resident_mib


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize(
    ("control", "mode"), [("torque", "rgb_array"), ("pointing", "rgb_array"), ("role", "rgb_array"), ("role", None)]
)
def test_gymnasiums_checker_has_no_complaint_about_rendering(control, mode, monkeypatch):
    # The checker tries every render mode, the window too.
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*out of date", category=DeprecationWarning)  # there is a v1
        env = gymnasium.make(ID, control=control, render_mode=mode)
        check_env(env.unwrapped)
        env.close()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_rendering_shows_the_swarm_and_leaves_the_flight_alone():
    drawn, plain = gymnasium.make(ID, render_mode="rgb_array", width=320, height=200), gymnasium.make(ID)
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
        warnings.filterwarnings("ignore", message=".*out of date", category=DeprecationWarning)  # there is a v1
        env = gymnasium.make(ID, render_mode="human", width=320, height=200)
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
        env = gymnasium.make(ID, render_mode="rgb_array", width=64, height=64)
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
    files, memory = len(os.listdir("/proc/self/fd")), resident_mib()
    for _ in range(5):
        use()
    assert len(os.listdir("/proc/self/fd")) <= files
    assert resident_mib() - memory < 25.0


def test_the_vector_environment_draws_its_first_flights_as_single_ones_do(gl):
    size = {"render_mode": "rgb_array", "control": "pointing"}
    vector = gymnasium.make_vec(ID, num_envs=3, threads=2, render_flights=2, **size)
    single = gymnasium.make(ID, **size).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        vector.render()
    vector.reset(seed=4)
    action = vector.action_space.sample()
    vector.step(action)
    pictures = vector.render()
    single.reset(seed=5)
    single.step(action[1])
    assert len(pictures) == 2 and np.array_equal(pictures[1], single.render())
    assert not np.array_equal(pictures[0], pictures[1])
    vector.close()
    single.close()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_episodes_of_v1_are_drawn_each_in_its_own_light():
    from swarm_mj.envs.missions.multi_agent import SwarmObserveV1ParallelEnv
    from swarm_mj.envs.missions.single import SwarmObserveV1Env
    from swarm_mj.envs.missions.vector import SwarmObserveV1VectorEnv

    made = {"missions": ["ellipsoid-train-1"], "render_mode": "rgb_array"}
    env = SwarmObserveV1Env(width=320, height=240, **made)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    pictures = []
    for elevation in (80.0, 80.0, 2.0):
        env.reset(options={"flight_seed": 3, "draw": {"sun_elevation_deg": elevation}})
        pictures.append(env.render().astype(float))
    assert pictures[0].shape == (240, 320, 3) and pictures[0].std() > 5.0
    assert np.array_equal(pictures[0], pictures[1])
    # What the Sun hardly reaches is darker, seen from wherever it is.
    assert np.abs(pictures[0] - pictures[2]).max() > 30
    env.close()
    vector = SwarmObserveV1VectorEnv(3, threads=1, render_flights=2, **made)
    agents = SwarmObserveV1ParallelEnv(**made)
    vector.reset(options={"flight_seed": [5, 6, 7]})
    agents.reset(options={"flight_seed": 6})
    shown = vector.render()
    assert len(shown) == 2 and np.array_equal(shown[1], agents.render())
    assert not np.array_equal(*shown)
    vector.close()
    agents.close()
