"""What becomes of data when spacecraft can hold little: every bit is aboard, on Earth or counted as lost."""

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig

from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_link import Data

from .flights import HOLD, ID

STORAGE = 20_000
#: A camera so wide that a swarm which tumbles pictures the target, too.
WIDE = ["camera.half_angle_deg=20", "observation.max_gsd_m=null"]


def test_a_pixel_has_as_many_bits_as_those_of_a_run():
    assert EnvConfig().bits_per_pixel == Data().sent_bits_per_pixel == 1.0


@pytest.mark.parametrize("control", ["role", "pointing", "torque"])
def test_every_bit_seen_is_aboard_or_on_earth_or_lost_in_any_episode(control):
    arguments = {"control": control, "step_s": 10.0, "swarm_rate_bit_s": None, "earth_rate_bit_s": None}
    arguments |= {"bits_per_pixel": 1e3, "complete": 100.0}
    little, plenty = (load_scenario("eros-observe", [*WIDE, *more]) for more in ([f"data.storage_bit={STORAGE}"], []))
    flights = [gymnasium.make_vec(ID, num_envs=4, threads=2, scenario=s, **arguments) for s in (little, plenty)]
    alone = gymnasium.make(ID, scenario=little, **arguments).unwrapped
    for env in flights:
        env.reset(seed=3)
    alone.reset(seed=3)
    flights[0].action_space.seed(5)
    seen_before = np.zeros(4)
    for _ in range(149):
        actions = flights[0].action_space.sample()
        (*_, terminated, _, infos), (*_, roomy) = (env.step(actions) for env in flights)
        stored, seen = infos["stored_bit"], infos["seen_bit"]
        assert stored.sum(axis=1) + infos["delivered_bit"] + infos["lost_bit"] == pytest.approx(seen, rel=1e-9)
        assert (stored >= 0.0).all() and (stored <= STORAGE * (1.0 + 1e-12)).all()
        assert (seen >= seen_before).all() and np.array_equal(seen, roomy["seen_bit"])
        assert roomy["stored_bit"].sum(axis=1) + roomy["delivered_bit"] == pytest.approx(seen, rel=1e-9)
        own, seen_before = alone.step(actions[0])[-1], seen
        assert all(np.array_equal(own[k], infos[k][0]) for k in ("stored_bit", "seen_bit", "lost_bit", "delivered_bit"))
        if terminated.any():
            break
    assert not roomy["lost_bit"].any() and (infos["lost_bit"] > 0.0).any()
    for env in (*flights, alone):
        env.close()


def test_a_full_spacecraft_loses_what_its_pictures_bring_and_the_cells_count_as_seen():
    scenario = load_scenario("eros-observe", ["data.storage_bit=5000"])
    env = gymnasium.make(ID, scenario=scenario).unwrapped
    env.reset(seed=1)
    for k in range(70):
        *_, info = env.step(np.array([5 + k // 35, HOLD, HOLD, HOLD, HOLD]))
    assert info["seen_bit"] > 10_000.0 and info["coverage_percent"] > 0.1
    assert info["stored_bit"] == [5000.0, 0.0, 0.0, 0.0, 0.0]
    assert info["lost_bit"] == pytest.approx(info["seen_bit"] - 5000.0, rel=1e-12)
    env.close()
