"""Reinforcement-learning environments of swarm_mj; importing this registers them with gymnasium.

`import swarm_mj` does so too where gymnasium is imported already, as it is when
`gymnasium.make("swarm_mj:SwarmObserve-v0")` imports the module before the colon. Only a program that imports swarm_mj first and
gymnasium later has to name `swarm_mj.envs`: gymnasium 1.x has no entry points, and nothing here waits for its import.

The classes are imported when they are first used, so that the registration costs no more than gymnasium itself.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from .downlink.env import SwarmDownlinkEnv, SwarmDownlinkVectorEnv
    from .downlink.parallel import SwarmDownlinkParallelEnv
    from .observe.parallel import SwarmObserveParallelEnv, SwarmObserveParallelVectorEnv
    from .observe.single import SwarmObserveEnv
    from .observe.vector import SwarmObserveVectorEnv
    from .pointing.env import SwarmPointingEnv, SwarmPointingVectorEnv
    from .pointing.parallel import SwarmPointingParallelEnv
    from .training.sb3 import SwarmObserveSharedVecEnv, SwarmObserveVecEnv, SwarmPointingVecEnv

#: Where each class is defined; those of agents (`*parallel*`) and `sb3` need the extra `rl`.
_HOMES = {
    "SwarmDownlinkEnv": "downlink.env",
    "SwarmDownlinkParallelEnv": "downlink.parallel",
    "SwarmDownlinkVectorEnv": "downlink.env",
    "SwarmObserveEnv": "observe.single",
    "SwarmObserveParallelEnv": "observe.parallel",
    "SwarmObserveParallelVectorEnv": "observe.parallel",
    "SwarmObserveSharedVecEnv": "training.sb3",
    "SwarmObserveVecEnv": "training.sb3",
    "SwarmObserveVectorEnv": "observe.vector",
    "SwarmPointingEnv": "pointing.env",
    "SwarmPointingParallelEnv": "pointing.parallel",
    "SwarmPointingVecEnv": "training.sb3",
    "SwarmPointingVectorEnv": "pointing.env",
}

#: Classes of the environments by name: the single one and the vector one.
_ENVIRONMENTS = {
    "SwarmObserve-v0": ("SwarmObserveEnv", "SwarmObserveVectorEnv"),
    "SwarmDownlink-v0": ("SwarmDownlinkEnv", "SwarmDownlinkVectorEnv"),
    "SwarmPointing-v0": ("SwarmPointingEnv", "SwarmPointingVectorEnv"),
}

__all__ = [
    "SwarmDownlinkEnv",
    "SwarmDownlinkParallelEnv",
    "SwarmDownlinkVectorEnv",
    "SwarmObserveEnv",
    "SwarmObserveParallelEnv",
    "SwarmObserveParallelVectorEnv",
    "SwarmObserveSharedVecEnv",
    "SwarmObserveVecEnv",
    "SwarmObserveVectorEnv",
    "SwarmPointingEnv",
    "SwarmPointingParallelEnv",
    "SwarmPointingVecEnv",
    "SwarmPointingVectorEnv",
]


def __getattr__(name: str) -> Any:
    """Import a class when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(__all__)}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


for _name, _classes in _ENVIRONMENTS.items():
    _single, _vector = (f"{__name__}.{_HOMES[_class]}:{_class}" for _class in _classes)
    if _name not in gymnasium.registry:
        gymnasium.register(id=_name, entry_point=_single, vector_entry_point=_vector)
