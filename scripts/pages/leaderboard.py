"""Write docs/results/leaderboard.md: policies of SwarmObserve-v0 on its frozen test episodes.

    python -m scripts.pages.leaderboard
    python -m scripts.pages.leaderboard runs/learning/*/policy.*     # with policies of one's own

Flies the scripted policies, the trained one of the package, and those that are given; what `scripts.pages.hindsight` has found
is a second reference beside the bound.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from swarm_mj.envs.policies.baselines import Flown, fly
from swarm_mj.envs.policies.leaderboard import (
    PLANNER,
    TEST_SEEDS,
    TRAINED,
    FrozenEpisodes,
    Score,
    interval,
    named_policies,
    share_of,
)
from swarm_mj.envs.policies.planner import Planner

from scripts.pages import RESULTS
from scripts.pages.hindsight import NUMBERS as HINDSIGHT
from swarm_mj.coordination.allocation.problem import Allocation
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.typing import Array

PAGE, NUMBERS = RESULTS / "leaderboard.md", RESULTS / "leaderboard.json"
AGAINST = "greedy"
#: Draws without failures; time for the proof of a plan [s], and of how many episodes plans are proven.
SOUND, PROVE_S, PROVEN = {"loss": 0.0, "camera_off": 0.0, "downlink_off": 0.0}, 1.0, 96


def main() -> None:
    """Fly and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", nargs="*", type=Path, help="files besides those of the package")
    files = parser.parse_args().policy
    with FrozenEpisodes() as test, progress_bars(Console()) as bars:
        test.check(files)
        scores = []
        for name in [*named_policies(test.config), PLANNER, TRAINED, *files]:
            bar = bars.add_task(Path(name).name, total=test.decisions)
            one = test.score(name, lambda taken, bar=bar: bars.update(bar, completed=taken))
            scores.append(replace(one, policy=shown(name)))
        sound = {name: fly(test.episodes, test.policy(name), test.seeds, SOUND) for name in (AGAINST, PLANNER)}
        planner = Planner(test.episodes, prove_s=PROVE_S)
        fly(test.episodes, planner, test.seeds[:PROVEN])
    scores.sort(key=lambda one: one.share.mean)
    best = best_known(scores)
    known = {"policy": "best known", "information": "hindsight", "scores": np.round(best, 4).tolist()}
    first, *others = (one.record() for one in scores)  # seeds and bounds are the same of all
    others = [{name: part for name, part in one.items() if name not in ("seeds", "bounds")} for one in others]
    write_text(NUMBERS, json.dumps([first, *others, known], indent=None) + "\n")
    write_text(PAGE, page(scores, best, planner.first, sound))
    print(f"wrote {PAGE} and {NUMBERS}")


def best_known(scores: list[Score]) -> Array:
    """The best that any choices came to in each episode, those of `scripts.pages.hindsight` and of the policies, shape (m,)."""
    found = json.loads(HINDSIGHT.read_text())["scores"]
    searched = np.array([found[str(seed)] for seed in scores[0].seeds])
    return np.asarray(np.max([searched, *(one.flown.score for one in scores)], axis=0))


def shown(name: str | Path) -> str:
    """A scripted policy by its words, a file by its folder and name."""
    return f"{name.parent.name}/{name.name}" if isinstance(name, Path) else name.replace("_", " ")


def page(scores: list[Score], best: Array, plans: list[Allocation], sound: dict[str, Flown]) -> str:
    """The page; `best` is what is known of each episode."""
    against = next(one for one in scores if one.policy == AGAINST)
    titles = ["policy", "goes by", "share of the bound", "of the best known", "score", "seen", "delivered"]
    head = f"| {' | '.join([*titles, f'against {AGAINST}'])} |\n|{'---|' * (len(titles) + 1)}"
    rows = [row(one, best, against) for one in scores]
    bound = scores[0].bound
    share = share_of(best, bound.score)
    rows.append(
        f"| *best known* | hindsight | {share.mean:.3f} +- {share.half_width:.3f} | 1 | {best.mean():.3f} | - | - | - |"
    )
    means = " | ".join(f"{values.mean():.3f}" for values in bound)
    rows.append(f"| *bound* | hindsight | 1 | - | {means} | - |")
    return TEXT.format(
        table="\n".join([head, *rows]),
        count=len(TEST_SEEDS),
        seeds=f"{TEST_SEEDS[0]:,} to {TEST_SEEDS[-1]:,}",
        rounds=json.loads(HINDSIGHT.read_text())["rounds"],
        plans=len(plans),
        proven=sum(plan.proven for plan in plans),
        prove=PROVE_S,
        planned=float(np.mean([plan.value for plan in plans])),
        proof=float(np.mean([plan.bound for plan in plans])),
        sound_rule=float(sound[AGAINST].score.mean()),
        sound_planner=float(sound[PLANNER].score.mean()),
    )


def row(one: Score, best: Array, against: Score) -> str:
    """One line of the table; differences are of the same episodes."""
    cells = [one.policy, one.information]
    cells += [f"{s.mean:.3f} +- {s.half_width:.3f}" for s in (one.share, share_of(one.flown.score, best))]
    cells += [f"{values.mean():.3f}" for values in one.flown]
    mean, half = interval(one.flown.score - against.flown.score)
    cells.append("-" if one is against else f"{mean:+.3f} +- {half:.3f}")
    return f"| {' | '.join(cells)} |"


TEXT = """\
# Leaderboard

Written by `python -m scripts.pages.leaderboard`. Every policy flies the same {count} episodes of `SwarmObserve-v0`: split
`test`, all missions, flight seeds {seeds}, everything else as it comes. They stay as they are, and
environments refuse these seeds, so that nothing is trained on them. Scores of every episode are in
`docs/results/leaderboard.json`. +-: 95 % intervals.

{table}

- **Score**: sum of rewards for seen area and for delivered data over the yardsticks of that episode: the lit cells that
  straight paths from the release pass if nothing fails, and their data straight down from the imaging altitude. Pictures from
  below that altitude hold more, so that delivered may pass 1.
- **Goes by**: the clock alone, or chance (blind); the observation of one agent for all (full), which in these missions is what
  each spacecraft knows by itself; that and more of the state of the simulation, here each cell of the target in the place of
  patches (privileged); or what is still to fail (hindsight).
- **Bound** (`envs/policies/bound.py`): no policy passes it. Paths do not depend on where spacecraft look, so that every cell
  that some working camera passes in light, within the limits and with nothing in between counts as seen, in its best
  picture; data count up to what Earth hears in the time that is left. Slews, and that a camera sees one patch at a time, are
  left out: the best possible policy lies somewhere below 1.
- **Best known** (`scripts/pages/hindsight.py`): of each episode the best that any choices are known to come to: those of the
  policies here, and what {rounds} changes found that were tried in that episode again and again. It knows all that will fail,
  and the optimum lies between it and the bound.
- **Open loop** (`baselines.OPEN_LOOP`): the best list of choices that hill climbing found on 128 episodes of the split
  `train`, flown again and again without looking at anything but the clock.
- **Planner** (`envs/policies/planner.py`): plans pictures cell by cell to the end of the episode and anew every third decision,
  from what the flight software knows. *Greedy* takes whatever is in reach now, from far and with few data, and turns between
  target and Earth, which takes three or four decisions; the planner waits for the near picture where it can, and sends when no
  picture is due. Its constants were chosen in episodes of `train`. At the beginning of the first {plans} episodes its best
  plans were worth {planned:.3f} if everything were sent, and no plan of that kind is worth more than {proof:.3f} (mean of
  bounds by mixed-integer programs, {prove:g} s each; {proven} are proven to be the best). Without failures *greedy* comes to
  {sound_rule:.3f} and the planner to {sound_planner:.3f}.
- **Trained** (`assets/policies/swarm-observe.npz`): of the networks that `examples/learning` trained for the page
  [learning](learning.md), the one with the best score on the episodes of that page, which are others than these
  over the same missions of `test`.
- **Random** takes any choice, also those that make no sense.

## Your own

    swarm-mj score policy.npz                   # or .onnx, or .zip of stable-baselines3
    swarm-mj score greedy policy.onnx --out scores.json
    swarm-mj score policy.npz --key 1234         # hidden episodes that follow from a number, for whoever compares

`.npz` is what the programs of `examples/learning` write; `.onnx` needs the extra `onnx`, and takes `observation` (E, F) and, if
it likes, `action_mask` (E, n, C), and answers with choices or logits; `.zip` is what `PPO.save` of stable-baselines3 or
`MaskablePPO.save` of sb3-contrib writes and needs the extra `rl`. Reading a zip executes what is pickled in it. A file tells
what it was trained for, and is refused by name where environment, layout of the observation, `max_spacecraft`, `patches` or
`decision_s` differ; one that reads choice by choice flies with any `max_spacecraft` and `patches`. What a file does not tell
(a zip of stable-baselines3, an `.onnx` without metadata) is judged by its sizes; `policies.policy_files.tell_in_zip` adds it.
"""


if __name__ == "__main__":
    main()
