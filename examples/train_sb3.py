"""Train a policy for SwarmObserve-v0 with PPO, and compare it with the untrained one.

    pip install 'swarm_mj[rl]'
    python examples/train_sb3.py --minutes 2
    python examples/train_sb3.py --minutes 30 --out runs/long
    python examples/train_sb3.py --minutes 30 --out runs/long --resume

With `--minutes 2` on two cores nearly all of the difference that is printed at the end comes from imitation: PPO needs about
70,000 steps, there five minutes or more, to pass what was imitated. Fly the result: swarm-mj run --policy DIR/policy.npz
"""

import sys

from swarm_mj.envs.training.sb3_options import TrainingOptions, command_line
from swarm_mj.envs.training.sb3_training import Training


def train(options: TrainingOptions) -> None:
    """Train until the time is up, then compare."""
    with Training(options) as training:
        training.imitate()  # the greedy rule says what the network should have done
        training.learn()  # PPO, validated now and then; the best policy stays in policy.npz
        print(training.compare())


if __name__ == "__main__":
    sys.exit(command_line(train, __doc__))
