"""MAPPO: every spacecraft is an agent with an advantage ratio of its own, and a critic sees the whole swarm while they learn.

    pip install 'swarm_mj[rl]'
    python examples/learning/mappo.py --steps 300000 --seed 1 --out runs/mappo-1
    swarm-mj score runs/mappo-1/policy.npz

Yu and others 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games": PPO for each agent with shared
weights, and advantages from a central critic. An agent reads what `SwarmObserveParallelEnv` shows it. Networks and update are
those of `ppo.py`, but that the change of each agent's choice is clipped by itself.
"""

from __future__ import annotations

from common import options
from ppo import Agent, Settings, train


class Team(Agent):
    """The choices of each spacecraft are actions of its own."""

    joint = False


if __name__ == "__main__":
    train(options(__doc__, "mappo"), Settings(), Team)
