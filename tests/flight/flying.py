"""A plan that was flown and recorded, flown again in the environment and in a live view."""

import gymnasium
import numpy as np
import swarm_mj.envs  # noqa: F401

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering.live import LiveFlight


def fly_environment(plan, telemetry, observer):
    """Fly the scenario's own behaviour in the environment, decision by decision, as the telemetry has it.

    Returns:
        First time at which each cell was seen, NaN for never [s], and the seen share [%].
    """
    # Radios that hear nobody, so that the episode lasts as long as the flight: it ends when all is seen and delivered.
    scenario = plan.scenario.model_copy(update={"link": plan.scenario.link.model_copy(update={"max_range_m": 1e-3})})
    env = gymnasium.make(
        "swarm_mj:SwarmObserve-v0", scenario=scenario, observer=observer, step_s=scenario.control.period_s
    ).unwrapped
    env.reset(options={"flight_seed": scenario.seed})
    over, k, actions = False, 0, choices(env, telemetry)
    while not over:
        *_, terminated, truncated, info = env.step(actions[k])
        over, k = terminated or truncated, k + 1
    first_seen_s, state = env.first_seen_s.copy(), env.state
    env.close()
    assert k == telemetry.sizes["time"] - 1
    # The same flight, to the last bit.
    assert np.array_equal(state.r_BN_N, telemetry["r_BN_N"].values[-1])
    assert np.array_equal(state.omega_BN_B, telemetry["omega_BN_B"].values[-1])
    return first_seen_s, info["coverage_percent"]


def choices(env, telemetry):
    """What the behaviour decided, as choices of the level `role`, shape (time, n)."""
    mode, tracked = telemetry["mode"].values, telemetry["tracked_spacecraft"].values.astype(int)
    centre = env.task.patches.count
    spacecraft = centre + 1
    earth = spacecraft + env.plan.n
    assert set(np.unique(mode)) <= {TargetKind.ASTEROID, TargetKind.SPACECRAFT, TargetKind.EARTH}
    return np.select(
        [mode == TargetKind.ASTEROID, mode == TargetKind.SPACECRAFT], [centre, spacecraft + tracked], earth
    )


def fly_live(plan):
    """A live view at its end."""
    live = LiveFlight(plan)
    while not live.over:
        live.step()
    live.close()
    return live
