"""Environment steps on a GPU, whole episodes with coverage, 64 to 65,536 flights; and how far they are from the processor's.

Where there is no GPU nothing is measured, and a line says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console

from swarm_mj.verification.performance.measure import Row, row

#: Numbers of flights; a quick run takes every other one of the first.
FLIGHTS = (64, 256, 1_024, 4_096, 16_384, 65_536)
#: With the most flights [steps/s].
TARGET = ">= 1000000"
#: Flights that are compared with the processor's, and how far they may be from them.
COMPARED, CLOSE = 8, "<= 1e-6"


def rows(quick: bool) -> Iterator[Row]:
    """All of it, or nothing where there is no GPU."""
    from swarm_mj.envs.gpu.device import SIMULATED, device_name, why_no_device

    if why := "CUDA is only simulated" if SIMULATED else why_no_device():
        Console().print(f"gpu: nothing was measured: {why}", highlight=False, soft_wrap=True)
        return
    note = f"on {device_name()}"
    yield row("gpu", "largest difference from the processor over an episode", distances(), "1", CLOSE, note)
    for count in FLIGHTS[0:3:2] if quick else FLIGHTS:
        target = TARGET if count == FLIGHTS[-1] else ""
        yield row("gpu", f"{count:,} flights, role", rates(count, 1 if quick else 3), "steps/s", target, note)


def distances() -> Any:
    """Largest difference of an observation or reward of each flight from the processor's over an episode, shape (flights,)."""
    from swarm_mj.envs import SwarmObserveGpuVectorEnv, SwarmObserveVectorEnv
    from swarm_mj.envs.gpu.device import on_host
    from swarm_mj.envs.gpu.vector import OVERRIDES

    device: Any = SwarmObserveGpuVectorEnv(COMPARED)
    host: Any = SwarmObserveVectorEnv(COMPARED, overrides=OVERRIDES)
    worst = np.abs(on_host(device.reset(seed=1)[0]) - host.reset(seed=1)[0]).max(axis=1)
    device.action_space.seed(1)
    for _ in range(device.task.last_tick // device.task.ticks):
        actions = device.action_space.sample()
        observation, reward, _, _, infos = device.step(actions)
        over = on_host(infos["_final_obs"])
        found = np.where(over[:, None], on_host(infos["final_obs"]), on_host(observation))
        expected, wanted, *_ = host.step(actions)
        worst = np.maximum(worst, np.abs(found - expected).max(axis=1))
        worst = np.maximum(worst, np.abs(on_host(reward) - wanted))
        if over.any():
            break
    device.close()
    host.close()
    return worst


def rates(count: int, episodes: int) -> Any:
    """Steps per second of so many flights, actions already on the device, shape (episodes,); compiling is not counted."""
    from swarm_mj.envs import SwarmObserveGpuVectorEnv
    from swarm_mj.envs.gpu.device import on_host, placed

    env: Any = SwarmObserveGpuVectorEnv(count, starts=min(count, 256), check_actions=False)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [placed(env.action_space.sample(), env.memory) for _ in range(16)]
    steps, found = env.task.last_tick // env.task.ticks, []
    on_host(env.step(actions[0])[1])
    for _ in range(episodes):
        begin = perf_counter()
        for k in range(steps):
            reward = env.step(actions[k % len(actions)])[1]
        on_host(reward)  # waits for all that was launched
        found.append(count * steps / (perf_counter() - begin))
    env.close()
    return np.array(found)
