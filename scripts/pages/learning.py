"""Write docs/results/learning.md and its picture: how stock algorithms learn SwarmObserve-v0.

    python -m scripts.pages.learning                          # all runs, then page and picture; needs the extra rl
    python -m scripts.pages.learning --steps 1000000 --jobs 4
    python -m scripts.pages.learning --only-page              # from the curves that are kept, without torch

Runs the programs of examples/learning, each with several seeds, some at a time; a call that is interrupted goes on with the
runs that are not done. Their curves are kept in scripts/pages/learning_curves.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from swarm_mj.envs.policies.leaderboard import TRAINED, VALIDATION_SEEDS, FrozenEpisodes, interval

from scripts.pages import IMAGES, RESULTS, ROOT
from scripts.pages.aggregates import Aggregate, aggregate
from swarm_mj.figures import palette, style
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.typing import Array

PAGE, NUMBERS = RESULTS / "learning.md", RESULTS / "learning.json"
PICTURE = IMAGES / "learning.png"
CURVES, RUNS = Path(__file__).parent / "learning_curves", ROOT / "runs" / "learning"
#: Programs of examples/learning, what they are, and their colours.
METHODS = {
    "sb3_ppo": ("PPO of stable-baselines3, its defaults, 4 candidates", palette.ORANGE),
    "ppo": ("PPO in one file, with masks", palette.BLUE),
    "mappo": ("MAPPO, each spacecraft an agent", palette.GREEN),
}
#: Points of a curve.
POINTS = 12
#: Scripted policies in the picture.
LINES = ("random", "sweep", "greedy", "greedy_ahead", "planner")


class Learned(NamedTuple):
    """All runs of a method.

    Attributes:
        steps: Where the curves have points, shape (p,).
        scores: Shape (runs, p).
        seconds: Of the longest run.
    """

    steps: Array
    scores: Array
    seconds: float

    @property
    def aggregates(self) -> list[Aggregate]:
        """Interquartile mean and interval at each point."""
        return [aggregate(self.scores[:, k : k + 1]) for k in range(len(self.steps))]

    def passes(self, score: float) -> float:
        """From how many steps on the interquartile mean stays above a score; infinite if it does not."""
        above = np.array([one.mean > score for one in self.aggregates])
        if not above[-1]:
            return float("inf")
        below = np.flatnonzero(~above)
        return float(self.steps[below[-1] + 1 if len(below) else 0])


def main() -> None:
    """Train, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=300_000, help="decisions of a run (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="runs of each method (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time (default: %(default)s)")
    parser.add_argument("--only-page", action="store_true", help="train nothing")
    given = parser.parse_args()
    if not given.only_page:
        train_all(given.steps, given.seeds, given.jobs)
    learned = {name: read(name) for name in METHODS if list(CURVES.glob(f"{name}-*.csv"))}
    scores = scripted()
    here = difference(scores.pop(TRAINED), scores["greedy"])
    lines = {name: float(values.mean()) for name, values in scores.items()}
    draw(learned, lines)
    write_text(NUMBERS, json.dumps(numbers(learned, lines), indent=1) + "\n")
    write_text(PAGE, page(learned, lines, here))
    print(f"wrote {PAGE}, {NUMBERS} and {PICTURE}")


def train_all(steps: int, seeds: int, jobs: int) -> None:
    """Every run that is not done, and keep their curves."""
    waiting = [(name, seed) for seed in range(1, seeds + 1) for name in METHODS if not done(name, seed, steps)]
    running: dict[tuple[str, int], subprocess.Popen[bytes]] = {}
    with progress_bars(Console()) as bars:
        shown = {run: bars.add_task(f"{run[0]} seed {run[1]}", total=steps) for run in waiting}
        try:
            while waiting or running:
                while waiting and len(running) < jobs:
                    run = waiting.pop(0)
                    running[run] = start(*run, steps)
                time.sleep(1.0)
                for run, process in list(running.items()):
                    bars.update(shown[run], completed=min(steps, reached(*run)))
                    if process.poll() is not None:
                        del running[run]
                        finish(*run, process.returncode)
        finally:
            for process in running.values():
                process.terminate()


def start(name: str, seed: int, steps: int) -> subprocess.Popen[bytes]:
    """A run in a process of its own."""
    folder = RUNS / f"{name}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    program = ROOT / "examples" / "learning" / f"{name}.py"
    words = [
        sys.executable,
        program,
        "--steps",
        steps,
        "--seed",
        seed,
        "--out",
        folder,
        "--every",
        max(steps // POINTS, 1),
    ]
    with (folder / "log.txt").open("wb") as log:
        return subprocess.Popen([str(word) for word in words], stdout=log, stderr=subprocess.STDOUT)


def finish(name: str, seed: int, status: int) -> None:
    """Keep the curve of a run that ended well."""
    folder = RUNS / f"{name}-{seed}"
    if status:
        raise SystemExit(f"{name} with seed {seed} failed; see {folder / 'log.txt'}")
    CURVES.mkdir(exist_ok=True)
    write_text(CURVES / f"{name}-{seed}.csv", (folder / "curve.csv").read_text())


def done(name: str, seed: int, steps: int) -> bool:
    """Whether a run was made, of so many steps at least, and its curve kept."""
    file = RUNS / f"{name}-{seed}" / "done.json"
    kept = (CURVES / f"{name}-{seed}.csv").exists()
    return kept and file.exists() and json.loads(file.read_text())["steps"] >= steps


def reached(name: str, seed: int) -> int:
    """Steps of the last point of a run's curve."""
    file = RUNS / f"{name}-{seed}" / "curve.csv"
    last = file.read_text().splitlines()[-1].split(",")[0] if file.exists() else ""
    return int(last) if last.isdecimal() else 0


def read(name: str) -> Learned:
    """The curves of all runs of a method, at the points that all of them have."""
    tables = []
    for file in sorted(CURVES.glob(f"{name}-*.csv")):
        with file.open(newline="") as lines:
            tables.append(
                {int(row["steps"]): (float(row["score"]), float(row["seconds"])) for row in csv.DictReader(lines)}
            )
    steps = sorted(set.intersection(*(set(table) for table in tables)))
    scores = np.array([[table[step][0] for step in steps] for table in tables])
    return Learned(np.array(steps, np.float64), scores, max(table[steps[-1]][1] for table in tables))


def scripted() -> dict[str, Array]:
    """Scores of the scripted policies, of the packaged network and of the bound in the episodes of the curves."""
    with FrozenEpisodes(VALIDATION_SEEDS) as test:
        found = {name: test.fly(test.policy(name)).score for name in (*LINES, TRAINED)}
        return found | {"bound": test.bound.score}


def draw(learned: dict[str, Learned], lines: dict[str, float]) -> None:
    """Interquartile means and their intervals over the steps."""
    figure = style.new_figure(4.2, "Learning SwarmObserve-v0: score on places that no training sees")
    ax = figure.subplots()
    for name, runs in learned.items():
        words, colour = METHODS[name]
        found, steps = runs.aggregates, runs.steps / 1e3
        ax.fill_between(
            steps, [one.low for one in found], [one.high for one in found], color=colour, alpha=0.2, linewidth=0
        )
        ax.plot(steps, [one.mean for one in found], color=colour, linewidth=2, label=words)
    colours = (palette.LIGHT_GREY, palette.GREY, palette.DARK_GREY, "black", palette.PURPLE)
    for name, colour in zip(LINES, colours, strict=True):
        ax.axhline(
            lines[name], color=colour, linewidth=1.2, linestyle=style.ARRIVAL_DASHES, label=name.replace("_", " ")
        )
    style.tidy(ax)
    style.label(ax, x="decisions [thousand]", y="score of an episode [-]")
    ax.set_xlim(0.0, max((runs.steps[-1] for runs in learned.values()), default=1.0) / 1e3)
    ax.legend(fontsize=style.SMALL_PT, loc="lower right", framealpha=0.95)
    style.save(figure, PICTURE)


def numbers(learned: dict[str, Learned], lines: dict[str, float]) -> dict[str, object]:
    """All that the picture shows."""
    curves = {
        name: {"steps": runs.steps.tolist(), "runs": len(runs.scores), "seconds": runs.seconds}
        | {"interquartile_mean": [[round(x, 4) for x in one] for one in runs.aggregates]}
        for name, runs in learned.items()
    }
    return {"scripted": {name: round(score, 4) for name, score in lines.items()}, "curves": curves}


def page(learned: dict[str, Learned], lines: dict[str, float], here: str) -> str:
    """The page; `here` is what the packaged network comes to against greedy in the episodes of the curves."""
    rows = [row(name, runs, lines["greedy"]) for name, runs in learned.items()]
    above = {name: runs.aggregates[-1] for name, runs in learned.items() if np.isfinite(runs.passes(lines["greedy"]))}
    proven = [name for name, last in above.items() if last.low > lines["greedy"] and len(learned[name].scores) > 1]
    surely, barely = ([METHODS[name][0] for name in above if (name in proven) is wanted] for wanted in (True, False))
    verdict = f"At the end all runs lie above *greedy* ({lines['greedy']:.3f}) with: {'; '.join(surely) or 'none'}."
    if barely:
        verdict += f" The mean alone does, so that nothing is proven, with: {'; '.join(barely)}."
    if absent := [words for name, (words, _) in METHODS.items() if name not in learned]:
        verdict += f" Not flown in the environment as it is now: {'; '.join(absent)}."
    others = [f"| {name.replace('_', ' ')} | - | - | {score:.3f} | - | - |" for name, score in lines.items()]
    return TEXT.format(
        table="\n".join([*rows, *others]),
        verdict=verdict,
        picture=PICTURE.name,
        episodes=len(VALIDATION_SEEDS),
        seeds=f"{VALIDATION_SEEDS[0]:,} to {VALIDATION_SEEDS[-1]:,}",
        here=here,
        elsewhere=elsewhere(),
    )


def elsewhere() -> str:
    """What the packaged network comes to on the leaderboard's episodes, against greedy, from that page's numbers."""
    scores = {one["policy"]: np.array(one["scores"]) for one in json.loads((RESULTS / "leaderboard.json").read_text())}
    return difference(scores[TRAINED], scores["greedy"])


def difference(scores: Array, others: Array) -> str:
    """Mean of paired differences, and its 95 % interval over the episodes."""
    mean, half = interval(scores - others)
    return f"{mean:+.3f} +- {half:.3f}"


def row(name: str, runs: Learned, greedy: float) -> str:
    """One line of the table."""
    last, passes = runs.aggregates[-1], runs.passes(greedy)
    cells = [METHODS[name][0], str(len(runs.scores)), f"{runs.steps[-1] / 1e3:,.0f}"]
    cells += [f"{last.mean:.3f}" + (f" ({last.low:.3f} to {last.high:.3f})" if len(runs.scores) > 1 else "")]
    cells += [f"{passes / 1e3:,.0f}" if np.isfinite(passes) else "not yet", f"{runs.seconds / 60:.0f}"]
    return f"| {' | '.join(cells)} |"


TEXT = """\
# Learning SwarmObserve-v0

Written by `python -m scripts.pages.learning` from the curves in `scripts/pages/learning_curves`, which the same command makes
where they are not there: it runs the programs of `examples/learning`, five times each unless `--seeds` says else. The numbers
of the picture are in `docs/results/learning.json`.

![Learning curves](../images/{picture})

| policy | runs | thousand decisions | score at the end | passes *greedy* after [thousand] | minutes of a run |
|---|---|---|---|---|---|
{table}

{verdict}

Brackets are the interval below over runs, all scored on the same episodes; one episode differs much from another. Over
episodes, the network with the best score here, which travels with the package as `trained`, comes to {here} against *greedy*
on these, and to {elsewhere} on the 1,000 others of the [leaderboard](leaderboard.md), which it was not chosen by. There the
*planner* shows what is left to learn.

- **Score.** Mean over {episodes} episodes of the split `test` (flight seeds {seeds}), flown with the likeliest choices.
  Training flies the split `train`, other places on the bodies. *Bound*: what no policy can pass, see
  [leaderboard](leaderboard.md).
- **Curves.** Interquartile mean of the runs, each of another seed, and its 95 % bootstrap interval, as rliable defines them
  (`scripts/pages/aggregates.py`); of two runs that is their range, and says little. Of five runs the middle three are
  averaged, of two both.
- **Decisions** are those of the swarm: every 20 s of flight all spacecraft choose.
- **PPO of stable-baselines3** is `PPO("MlpPolicy", ...)` with every setting as it comes, with `candidates=4`: each spacecraft
  chooses among its four best patches and sending. That order is part of the help it gets: always the first is a rule of its
  own. Each of up to three spacecraft is an environment of its own (`envs.SwarmObserveSharedVecEnv`), so that a decision
  is three of what stable-baselines3 counts as steps, and one policy flies all of them. It knows no masks.
- **PPO in one file** is `examples/learning/ppo.py`, among all patches, with `info["action_mask"]`: one network judges choice by
  choice by what is known of it (`choices.choice_rows`). **MAPPO** has the same network, and clips the change of the choice of
  each spacecraft by itself.
- **Minutes** are those of the longest run on a shared machine, tests not counted; they say little about another one.

    python examples/learning/ppo.py --steps 300000 --seed 1 --out runs/ppo-1
    swarm-mj score runs/ppo-1/policy.npz greedy
"""


if __name__ == "__main__":
    main()
