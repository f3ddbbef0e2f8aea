"""How good a policy of SwarmObserve-v0 is: frozen test episodes, and scores as a share of a bound that no policy passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from scipy.stats import t as student

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.resources import asset_path
from swarm_mj.typing import Array

from ..arguments import MAX_SEED, checked_episodes, checked_whole
from ..observe.config import EnvConfig
from ..observe.episodes import HELD_OUT_SEED, Episodes
from ..observe.layout import Observed
from ..observe.single import NAME
from .baselines import Flown, Policy, fly, open_loop, random_choices, scripted_policies
from .bound import Progress, bounds
from .planner import Planner
from .policy_files import PACKAGED, open_policy, policy_file

#: Flight seeds of the leaderboard: 1,000 episodes over all missions of the split `test`. They stay as they are for good.
TEST_SEEDS = tuple(range(HELD_OUT_SEED, HELD_OUT_SEED + 1_000))
#: Of the same split, for learning curves and for choosing among policies; environments fly them, too.
VALIDATION_SEEDS = tuple(range(30_000, 30_096))
#: What a policy is tested with.
TEST = {"split": "test", "missions": "all"}
#: The name of the planner.
PLANNER = "planner"
#: What a policy goes by: the clock alone; what one agent for all is shown; what has reached each spacecraft; the state of the
#: simulation beyond that; or what is still to come.
INFORMATION = ("blind", "full", "graph", "privileged", "hindsight")
#: Of those that are named; all others are shown the observation and no more.
INFORMATION_OF = {"random": "blind", "open_loop": "blind", "sweep": "blind", PLANNER: "privileged"}
#: Name of the trained policy that travels with the package.
TRAINED = "trained"
#: Episodes at once.
WIDTH = 32


class Interval(NamedTuple):
    """A mean and the half width of its 95 % confidence interval."""

    mean: float
    half_width: float


def interval(values: Array) -> Interval:
    """Of independent values, by Student's t; shape (m,), m at least 2."""
    m = len(values)
    spread = float(np.std(values, ddof=1)) / m**0.5
    return Interval(float(np.mean(values)), float(student.ppf(0.975, m - 1)) * spread)


@dataclass(frozen=True)
class Score:
    """Of a policy on some episodes.

    Attributes:
        policy: Its name or file.
        information: What it goes by, see `INFORMATION`.
        seeds: Flight seeds of the episodes.
        flown: What the policy came to.
        bound: What no policy can pass.
    """

    headings: ClassVar[tuple[str, ...]] = ("goes by", "share of bound", "score", "seen", "delivered")
    environment: ClassVar[str] = NAME
    policy: str
    information: str
    seeds: tuple[int, ...]
    flown: Flown
    bound: Flown

    @property
    def cells(self) -> list[str]:
        """Under `headings`."""
        means = [float(values.mean()) for values in self.flown]
        return [
            self.information,
            f"{self.share.mean:.3f} +- {self.share.half_width:.3f}",
            *(f"{mean:.3f}" for mean in means),
        ]

    @property
    def share(self) -> Interval:
        """Score over bound, all episodes together, with the half-width of its 95 % interval."""
        return share_of(self.flown.score, self.bound.score)

    def record(self) -> dict[str, Any]:
        """As JSON has it; scores by episode, rounded."""
        mean = {name: float(np.mean(values)) for name, values in self.flown._asdict().items()}
        return {
            "environment": NAME,
            "package": __version__,
            "policy": self.policy,
            "information": self.information,
            "episodes": len(self.seeds),
            "share": self.share.mean,
            "share_half_width": self.share.half_width,
            **mean,
            "bound": float(self.bound.score.mean()),
            "seeds": list(self.seeds),
            "scores": np.round(self.flown.score, 4).tolist(),
            "bounds": np.round(self.bound.score, 4).tolist(),
        }


def share_of(score: Array, bound: Array) -> Interval:
    """Ratio of two means over the same episodes, by the delta method; shape (m,), m at least 2."""
    share = float(score.mean() / bound.mean())
    return Interval(share, interval((score - share * bound) / bound.mean()).half_width)


def hidden_seeds(key: int) -> tuple[int, ...]:
    """Flight seeds that a key hides, as many as the leaderboard has.

    Raises:
        ScenarioError: The key is no whole number of at least 0.
    """
    rng = np.random.default_rng(checked_whole("key", key, 0, np.inf, "a whole number of at least 0"))
    drawn = rng.integers(TEST_SEEDS[-1] + 1, MAX_SEED, len(TEST_SEEDS))
    return tuple(int(seed) for seed in drawn)


def named_policies(config: EnvConfig) -> dict[str, Policy]:
    """Scripted policies by the names of a command line, for an environment of these arguments."""
    return {"random": random_choices(), "open_loop": open_loop(), **scripted_policies(config)}


def policy_of(name_or_file: str | Path, config: EnvConfig) -> Policy:
    """A scripted policy or the trained one by name, or that of a file.

    Raises:
        ScenarioError: It is neither, or the file's policy cannot fly there.
    """
    named = named_policies(config)
    if str(name_or_file) in named:
        return named[str(name_or_file)]
    if str(name_or_file) == TRAINED:
        return open_policy(str(asset_path(PACKAGED)), config)
    return open_policy(policy_file("policy", name_or_file, (*named, PLANNER, TRAINED)), config)


class FrozenEpisodes:
    """Test episodes that no training looks at, ready to be flown by one policy after another; a context manager.

    Args:
        seeds: Flight seeds.
        arguments: Of the environment, where they are not those of the leaderboard.
    """

    def __init__(self, seeds: Sequence[int] = TEST_SEEDS, **arguments: Any) -> None:
        self.seeds = tuple(int(seed) for seed in seeds)
        if len(self.seeds) < 2:
            raise ScenarioError(f"{len(self.seeds)} episodes: must be at least 2 for an interval")
        self.config = EnvConfig(**TEST | arguments)
        self.episodes = Episodes(self.config, min(WIDTH, len(self.seeds)), usable_cores(), tests=True)
        self._bound: Flown | None = None

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the observers."""
        self.close()

    @classmethod
    def of(cls, episodes: int | None = None, key: int | None = None) -> FrozenEpisodes:
        """The first so many episodes, at least 2, of the leaderboard, or of those that a key hides; None: all.

        Whoever keeps the key tests what nobody can have chosen by.
        """
        seeds = TEST_SEEDS if key is None else hidden_seeds(key)
        return cls(seeds[: checked_episodes(episodes, len(seeds))])

    def close(self) -> None:
        """Release the observers."""
        self.episodes.close()

    @property
    def decisions(self) -> int:
        """That all episodes take, of as many at once as fly together."""
        groups = -(-len(self.seeds) // self.episodes.count)
        return groups * self.config.decisions

    @property
    def preparations(self) -> int:
        """Episodes whose bound is not known yet."""
        return len(self.seeds) if self._bound is None else 0

    def prepare(self, progress: Progress | None = None) -> None:
        """Make the missions and work out the bound; `progress` is called with the episodes done."""
        if self._bound is None:
            self._bound = bounds(self.episodes, self.seeds, progress)

    @property
    def bound(self) -> Flown:
        """What no policy can pass; worked out once."""
        self.prepare()
        assert self._bound is not None
        return self._bound

    def policy(self, name_or_file: str | Path) -> Policy:
        """A scripted policy by name, or that of a file.

        Raises:
            ScenarioError: It is neither, or the file's policy cannot fly there; the message names why.
        """
        return Planner(self.episodes) if str(name_or_file) == PLANNER else policy_of(name_or_file, self.config)

    def check(self, names_or_files: Sequence[str | Path]) -> None:
        """Refuse those that cannot fly there, see `policy`."""
        for name_or_file in names_or_files:
            self.policy(name_or_file)

    def fly(self, policy: Policy, progress: Progress | None = None) -> Flown:
        """What a policy comes to; `progress` is called with the decisions taken."""
        taken = 0

        def watched(observed: Observed) -> Any:
            nonlocal taken
            taken += 1
            if progress is not None:
                progress(taken)
            return policy(observed)

        return fly(self.episodes, watched, self.seeds)

    def score(self, name_or_file: str | Path, progress: Progress | None = None) -> Score:
        """Of a scripted policy by name, or of that of a file; raises what `policy` does."""
        flown, name = self.fly(self.policy(name_or_file), progress), str(name_or_file)
        return Score(name, INFORMATION_OF.get(name, "full"), self.seeds, flown, self.bound)
