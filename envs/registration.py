"""Which environments gymnasium can make by name.

`import swarm_mj.envs` registers them, and so does `import swarm_mj` where gymnasium is imported already, as it is when
`gymnasium.make("swarm_mj:SwarmObserve-v0")` imports the module before the colon. Only a program that imports swarm_mj first and
gymnasium later has to name `swarm_mj.envs`: gymnasium 1.x has no entry points, and nothing here waits for its import.
"""

from __future__ import annotations

import gymnasium

#: Environments by name, and where their classes are: the single one and the vector one.
ENVIRONMENTS = {
    "SwarmObserve-v0": (
        "swarm_mj.envs.observe.single:SwarmObserveEnv",
        "swarm_mj.envs.observe.vector:SwarmObserveVectorEnv",
    ),
    "SwarmDownlink-v0": (
        "swarm_mj.envs.downlink.env:SwarmDownlinkEnv",
        "swarm_mj.envs.downlink.env:SwarmDownlinkVectorEnv",
    ),
    "SwarmPointing-v0": (
        "swarm_mj.envs.pointing.env:SwarmPointingEnv",
        "swarm_mj.envs.pointing.env:SwarmPointingVectorEnv",
    ),
}


def register_environments() -> None:
    """Tell gymnasium the environments that it does not know yet."""
    for name, (entry_point, vector_entry_point) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=entry_point, vector_entry_point=vector_entry_point)
