"""Pictures of an episode and the window that shows them."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.observe.rendering import PygameWindow

from swarm_mj.errors import SwarmError

ID = "swarm_mj.envs:SwarmObserve-v0"


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_a_window_shows_the_picture_and_gymnasiums_checker_accepts_it(monkeypatch):
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(ID, render_mode="human", width=320, height=200, missions=["ellipsoid-train-1"])
        env.reset(seed=0)
        shown = pygame.surfarray.array3d(pygame.display.get_surface())
        assert shown.shape == (320, 200, 3) and shown.std() > 5.0
        assert env.render() is None
        check_env(env.unwrapped)
        env.close()
        assert not pygame.display.get_init()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_rendering_shows_the_swarm_and_leaves_the_flight_alone():
    made = {"scenario": "eros-observe", "observation": "flat"}
    drawn, plain = (
        gymnasium.make(ID, render_mode="rgb_array", width=320, height=200, **made),
        gymnasium.make(ID, **made),
    )
    for env in (drawn, plain):
        env.reset(seed=2)
    first = drawn.render()
    assert first.shape == (200, 320, 3) and first.dtype == np.uint8
    assert first.std() > 5.0
    for _ in range(29):
        a, b = drawn.step(np.full(5, 5))[0], plain.step(np.full(5, 5))[0]
    later = drawn.render()
    assert np.array_equal(a, b)
    assert not np.shares_memory(first, later)
    assert np.abs(first.astype(int) - later).max() > 50
    drawn.close()
    plain.close()


def test_without_a_display_the_window_is_refused_with_a_way_out(monkeypatch):
    pytest.importorskip("pygame")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SwarmError, match="rgb_array"):
        PygameWindow(64, 64, 10, "SwarmObserve-v0")


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_episodes_are_drawn_each_in_its_own_light():
    from swarm_mj.envs.observe.parallel import SwarmObserveParallelEnv
    from swarm_mj.envs.observe.single import SwarmObserveEnv
    from swarm_mj.envs.observe.vector import SwarmObserveVectorEnv

    made = {"missions": ["ellipsoid-train-1"], "render_mode": "rgb_array"}
    env = SwarmObserveEnv(width=320, height=240, **made)
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
    vector = SwarmObserveVectorEnv(3, threads=1, render_flights=2, **made)
    agents = SwarmObserveParallelEnv(**made)
    vector.reset(options={"flight_seed": [5, 6, 7]})
    agents.reset(options={"flight_seed": 6})
    shown = vector.render()
    assert len(shown) == 2 and np.array_equal(shown[1], agents.render())
    assert not np.array_equal(*shown)
    vector.close()
    agents.close()
