"""Reinforcement-learning environments of swarm_mj; importing this registers them with gymnasium.

The classes are imported when they are first used, so that the registration costs no more than gymnasium itself.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .registration import register_environments

if TYPE_CHECKING:
    from .downlink.parallel import SwarmDownlinkParallelEnv
    from .downlink.single import SwarmDownlinkEnv
    from .downlink.vector import SwarmDownlinkVectorEnv
    from .gpu.vector import SwarmObserveGpuVectorEnv
    from .missions.multi_agent import SwarmObserveV1ParallelEnv
    from .missions.multi_agent_vector import SwarmObserveV1ParallelVectorEnv
    from .missions.single import SwarmObserveV1Env
    from .missions.vector import SwarmObserveV1VectorEnv
    from .observe.camera_observation import CameraObservation
    from .observe.multi_agent import SwarmObserveParallelEnv
    from .observe.multi_agent_vector import SwarmObserveParallelVectorEnv
    from .observe.single import SwarmObserveEnv
    from .observe.swarm_map import SwarmMapEnv, SwarmMapVectorEnv
    from .observe.vector import SwarmObserveVectorEnv
    from .pointing.parallel import SwarmPointingParallelEnv
    from .pointing.single import SwarmPointingEnv
    from .pointing.vector import SwarmPointingVectorEnv
    from .training.sb3 import SwarmObserveV1SharedVecEnv, SwarmObserveV1VecEnv, SwarmObserveVecEnv, SwarmPointingVecEnv

#: Where each class is defined; those of agents (`*parallel`, `*multi_agent*`) and `sb3` need the extra `rl`, `gpu.vector`
#: the extra `gpu`.
_HOMES = {
    "CameraObservation": "observe.camera_observation",
    "SwarmDownlinkEnv": "downlink.single",
    "SwarmDownlinkParallelEnv": "downlink.parallel",
    "SwarmDownlinkVectorEnv": "downlink.vector",
    "SwarmMapEnv": "observe.swarm_map",
    "SwarmMapVectorEnv": "observe.swarm_map",
    "SwarmObserveEnv": "observe.single",
    "SwarmObserveGpuVectorEnv": "gpu.vector",
    "SwarmObserveParallelEnv": "observe.multi_agent",
    "SwarmObserveParallelVectorEnv": "observe.multi_agent_vector",
    "SwarmObserveV1Env": "missions.single",
    "SwarmObserveV1ParallelEnv": "missions.multi_agent",
    "SwarmObserveV1ParallelVectorEnv": "missions.multi_agent_vector",
    "SwarmObserveV1SharedVecEnv": "training.sb3",
    "SwarmObserveV1VecEnv": "training.sb3",
    "SwarmObserveV1VectorEnv": "missions.vector",
    "SwarmObserveVecEnv": "training.sb3",
    "SwarmObserveVectorEnv": "observe.vector",
    "SwarmPointingEnv": "pointing.single",
    "SwarmPointingParallelEnv": "pointing.parallel",
    "SwarmPointingVecEnv": "training.sb3",
    "SwarmPointingVectorEnv": "pointing.vector",
}

__all__ = [
    "CameraObservation",
    "SwarmDownlinkEnv",
    "SwarmDownlinkParallelEnv",
    "SwarmDownlinkVectorEnv",
    "SwarmMapEnv",
    "SwarmMapVectorEnv",
    "SwarmObserveEnv",
    "SwarmObserveGpuVectorEnv",
    "SwarmObserveParallelEnv",
    "SwarmObserveParallelVectorEnv",
    "SwarmObserveV1Env",
    "SwarmObserveV1ParallelEnv",
    "SwarmObserveV1ParallelVectorEnv",
    "SwarmObserveV1SharedVecEnv",
    "SwarmObserveV1VecEnv",
    "SwarmObserveV1VectorEnv",
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


register_environments()
