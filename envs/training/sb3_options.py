"""What to train and for how long, by keyword or from the command line; needs neither torch nor stable-baselines3."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarm_mj.errors import SwarmError

#: Largest seed that stable-baselines3 can give to NumPy.
MAX_SEED = 2**32 - 1


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """What to train and for how long.

    Attributes:
        out: Folder of `checkpoint.zip` (to resume), `policy.npz` (the best policy on the validation seeds so far), `curve.csv`
            (the learning curve), `state.json` (where training stands) and `log` for TensorBoard.
        minutes: Of training, comparison not included.
        seed: Of network, actions and flights.
        num_envs: Flights at once.
        imitate: Rounds of imitation before PPO.
        scenario: Of spacecraft with three wheels each.
        resume: Whether to go on from the checkpoint in the folder.
    """

    out: Path = Path("runs/sb3")
    minutes: float = 2.0
    seed: int = 0
    num_envs: int = 32
    imitate: int = 3
    scenario: str = "eros-observe"
    resume: bool = False

    @property
    def checkpoint(self) -> Path:
        """What a training that goes on begins with."""
        return self.out / "checkpoint.zip"


def command_line(
    train: Callable[[TrainingOptions], None], description: str | None = None, argv: Sequence[str] | None = None
) -> int:
    """Parse the command line and train.

    Args:
        train: What to do with the options.
        description: For `--help`.
        argv: The words of the command line; None for those of this process.

    Returns:
        0: done; 2: bad input, or a scenario for which no policy can be trained; 130: interrupted.
    """
    options = parsed(description, argv)
    try:
        train(options)
    except (SwarmError, OSError) as error:
        print(f"train_sb3: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        kept = options.checkpoint.exists()
        print(
            f"interrupted; {'what was kept last stays: --resume goes on from there' if kept else 'nothing was kept yet'}"
        )
        return 130
    return 0


def parsed(description: str | None, argv: Sequence[str] | None) -> TrainingOptions:
    """The options of a command line; ends the process with status 2 where there is something wrong with them."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    add, default, shown = parser.add_argument, TrainingOptions(), "(default: %(default)s)"
    add("--minutes", type=_minutes, default=default.minutes, help=f"of training, comparison not included {shown}")
    add("--out", type=Path, default=default.out, metavar="DIR", help=f"folder of the results {shown}")
    add("--seed", type=_whole(0, MAX_SEED), default=default.seed, help=f"of network, actions and flights {shown}")
    add("--num-envs", type=_whole(1), default=default.num_envs, help=f"flights at once {shown}")
    add("--imitate", type=_whole(0), default=default.imitate, metavar="ROUNDS", help=f"of imitation {shown}")
    add("--scenario", default=default.scenario, help=f"of spacecraft with three wheels each {shown}")
    add("--resume", action="store_true", help="go on from the checkpoint in the folder")
    return TrainingOptions(**vars(parser.parse_args(argv)))


def _minutes(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: must be a positive number")
    return value


def _whole(least: int, most: int | None = None) -> Callable[[str], int]:
    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < least or (most is not None and int(text) > most):
            limits = f"at least {least}" + ("" if most is None else f" and at most {most}")
            raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number of {limits}")
        return int(text)

    return whole
