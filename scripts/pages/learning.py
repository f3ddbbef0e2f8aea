"""Write docs/results/learning.md and its picture, the trained policy against every scripted one.

Run as `python -m scripts.pages.learning`. The flights are flown anew; the learning curves are those that
`examples/train_sb3.py` wrote, kept in scripts/pages/learning_curves.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from swarm_mj.envs.observe.task import Task, make_task
from swarm_mj.envs.policies.baselines import POLICIES
from swarm_mj.envs.policies.evaluation import Returns, fly_seeds, interval
from swarm_mj.envs.policies.flyby_scores import TEST_SEEDS as SEEDS
from swarm_mj.envs.policies.flyby_scores import TRAINED
from swarm_mj.envs.policies.policy import load_policy
from swarm_mj.envs.policies.policy_behavior import PACKAGED

from scripts.pages import IMAGES, RESULTS
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.io.resources import asset_path
from swarm_mj.results import look
from swarm_mj.results.figures import style

PAGE = RESULTS / "learning.md"
PICTURE = IMAGES / "learning_curve.png"
CURVES = Path(__file__).parent / "learning_curves"

#: The trained policy's actions in one flight of training's seeds, flown again without looking.
REPLAYED = "replayed list of actions"
RECORDED = 1
#: Which curve is that of the packaged policy.
SHIPPED = "shipped"
#: Arguments of the environment by which data move as the scenario's link budget has it.
BY_BUDGET: dict[str, Any] = {"swarm_rate_bit_s": None, "earth_rate_bit_s": None}

VectorPolicy = Callable[[NDArray[np.float32]], NDArray[np.int64]]
Curve = dict[str, NDArray[np.float64]]


def main() -> None:
    """Fly, draw and write."""
    flown, by_budget = fly_all(), fly_all(**BY_BUDGET)
    curves = {file.stem: read_curve(file) for file in sorted(CURVES.glob("*.csv"))}
    draw(curves[SHIPPED], flown)
    write_text(PAGE, page(flown, by_budget, curves))
    print(f"wrote {PAGE} and {PICTURE}")


def fly_all(**arguments: Any) -> dict[str, Returns]:
    """All policies from the same seeds, in the environment of these arguments."""
    task = make_task(**arguments)
    policies: dict[str, VectorPolicy] = {}
    for name, policy in POLICIES.items():

        def act(rows: NDArray[np.float32], policy: Any = policy) -> NDArray[np.int64]:
            return np.array([policy(task, row) for row in rows])

        policies[name] = act
    policies[TRAINED] = load_policy(asset_path(PACKAGED)).for_task(task).act
    policies[REPLAYED] = replay(policies[TRAINED], task, **arguments)
    flown = {}
    with progress_bars(Console()) as bars:
        for name, act_many in policies.items():
            bar = bars.add_task(name, total=len(SEEDS))
            flown[name] = fly_seeds(act_many, SEEDS, lambda n, bar=bar: bars.update(bar, completed=n), **arguments)
    task.close()
    return flown


def replay(policy: VectorPolicy, task: Task, **arguments: Any) -> VectorPolicy:
    """The actions of a policy in one flight, as a list that looks at nothing but the clock."""
    steps = task.last_tick // task.ticks
    actions = np.zeros((steps + 1, task.plan.n), np.int64)

    def clock(rows: NDArray[np.float32]) -> NDArray[np.int64]:
        return np.rint((1.0 - rows[:, -3]) * steps).astype(np.int64)

    def record(rows: NDArray[np.float32]) -> NDArray[np.int64]:
        chosen = policy(rows)
        actions[clock(rows)] = chosen
        return chosen

    fly_seeds(record, [RECORDED], **arguments)
    return lambda rows: actions[clock(rows)]


def best_scripted(flown: dict[str, Returns]) -> str:
    """The scripted policy with the highest mean return."""
    return max(POLICIES, key=lambda name: flown[name].total.mean())


def read_curve(file: Path) -> Curve:
    """Columns by name."""
    with file.open(newline="") as lines:
        rows = list(csv.DictReader(lines))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def passing(curve: Curve) -> tuple[int, float, float]:
    """When PPO first passes on the validation seeds what was imitated: steps, minutes; and minutes that imitation took."""
    valid = np.flatnonzero(np.isfinite(curve["validation_return"]))
    better = valid[curve["validation_return"][valid] > curve["validation_return"][0]][0]
    minutes = curve["seconds"] / 60.0
    return int(curve["steps"][better]), float(minutes[better]), float(minutes[0])


def draw(curve: Curve, flown: dict[str, Returns]) -> None:
    """The learning curve of the packaged policy, with the scripted ones as lines."""
    figure = style.new_figure(4.2, "Learning SwarmObserve-v0: return of an episode")
    ax = figure.subplots()
    steps = curve["steps"] / 1e3
    ax.plot(steps, curve["sampled_return"], color=look.SKY_BLUE, linewidth=1.2, label="training flights, drawn actions")
    valid = np.isfinite(curve["validation_return"])
    ax.plot(
        steps[valid],
        curve["validation_return"][valid],
        color=look.BLUE,
        linewidth=2,
        marker="o",
        markersize=4,
        label="validation flights, likeliest actions",
    )
    for name, colour in zip(("greedy ahead", "greedy", "sweep"), (look.GREEN, look.ORANGE, look.GREY), strict=True):
        mean = float(flown[name].total.mean())
        ax.axhline(mean, color=colour, linewidth=1.2, linestyle=style.VISIT_DASHES, label=f"{name}, scripted")
    style.tidy(ax)
    style.label(ax, x="steps of the environment [thousand]", y="return of an episode [-]")
    ax.set_xlim(0.0, steps.max())
    ax.legend(fontsize=style.SMALL_PT, loc="lower right", framealpha=0.95)
    style.save(figure, PICTURE)


def page(flown: dict[str, Returns], by_budget: dict[str, Returns], curves: dict[str, Curve]) -> str:
    """The page."""
    best = best_scripted(flown)
    task = make_task(**BY_BUDGET)
    rows = [row(name, returns, flown[best], task.nominal_bit) for name, returns in flown.items()]
    budget_rows = [row(name, returns, by_budget[best], task.nominal_bit) for name, returns in by_budget.items()]
    earth_bit_s = task.radio_constants.earth_bit / task.step_s
    task.close()
    mean, half = interval(flown[TRAINED].total - flown[best].total)
    slower, half_slower = interval(by_budget[TRAINED].total - by_budget[best_scripted(by_budget)].total)
    issued, half_issued = interval(flown[TRAINED].total - flown["greedy"].total)
    replayed, half_replayed = interval(flown[TRAINED].total - flown[REPLAYED].total)
    tried = "\n".join(tried_row(name, curve) for name, curve in curves.items())
    policy = load_policy(asset_path(PACKAGED))
    passed, passed_min, imitated_min = passing(curves[SHIPPED])
    return TEXT.format(
        passed=f"{passed:,}",
        passed_min=f"{passed_min:.1f}",
        imitated_min=f"{imitated_min:.1f}",
        imitated=f"{curves[SHIPPED]['validation_return'][0]:.3f}",
        seeds=f"{SEEDS[0]:,} to {SEEDS[-1]:,}",
        table="\n".join(rows),
        verdict=verdict(mean, half),
        budget_table="\n".join(budget_rows),
        earth_rate=f"{earth_bit_s.mean() / 1e3:.0f}",
        budget_verdict=verdict(slower, half_slower),
        budget_best=best_scripted(by_budget),
        budget_difference=f"{slower:+.3f} +- {half_slower:.3f}",
        best=best,
        difference=f"{mean:+.3f} +- {half:.3f}",
        greedy=f"{issued:+.3f} +- {half_issued:.3f}",
        replayed=f"{replayed:+.3f} +- {half_replayed:.3f}",
        recorded=RECORDED,
        tried=tried,
        steps=f"{policy.about['steps']:,}",
        minutes=f"{curves[SHIPPED]['seconds'].max() / 60.0:.0f}",
        curve=PICTURE.name,
        size=round(Path(str(asset_path(PACKAGED))).stat().st_size / 1000),
    )


def verdict(mean: float, half: float) -> str:
    """What the mean difference and its interval say."""
    return "beats" if mean > half else "is beaten by" if mean < -half else "does not beat"


def row(name: str, returns: Returns, best: Returns, nominal_bit: float) -> str:
    """One line of the table."""
    cells = [name, shown(returns.total, 3), shown(returns.coverage_percent, 1)]
    cells.append(shown(returns.delivered_bit / nominal_bit, 3))
    same = returns is best
    cells.append("-" if same else shown(returns.total - best.total, 3, signed=True))
    return f"| {' | '.join(cells)} |"


def shown(values: NDArray[np.float64], digits: int, *, signed: bool = False) -> str:
    """Mean and half width of its interval."""
    mean, half = interval(values)
    return f"{mean:{'+' if signed else ''}.{digits}f} +- {half:.{digits}f}"


def tried_row(name: str, curve: Curve) -> str:
    """One line of the table of runs."""
    best = int(np.nanargmax(curve["validation_return"]))
    cells = [name, RUNS[name], f"{curve['steps'][-1] / 1e3:,.0f}", f"{curve['seconds'][-1] / 60:.0f}"]
    cells += [f"{curve['validation_return'][0]:.3f}", f"{curve['validation_return'][best]:.3f}"]
    return f"| {' | '.join(cells)} |"


#: What was different in each run whose curve is kept.
RUNS = {
    "cautious": "rate 3e-4, 5 passes over batches of 800, entropy 3e-3, whole flights; broken off",
    SHIPPED: "rate 1e-3, 6 passes over batches of 400, entropy 6e-3, flights of 750 s",
}

TEXT = """\
# Learning

This page is generated by `python -m scripts.pages.learning`. The policy `assets/policies/eros-observe.npz` was trained on the
scenario `eros-observe` at the control level `role` with `python examples/train_sb3.py --minutes 20` on two shared cores:
the best of its validations came after {steps} steps, at {minutes} minutes, and was kept. It is an array file of {size} kB,
read without pickle and flown without torch:

    swarm-mj run eros-observe --policy trained
    swarm-mj run eros-observe --policy runs/sb3/policy.npz
    swarm-mj run eros-observe --policy greedy

The behaviour decides as the policy does in the environment: with the same seed both see the same cells at the same times,
as long as no sensor noise or delay is flown (behaviours are given true attitudes, agents what the spacecraft knows). It
flies the same swarm, too: the dedicated communications spacecraft of a scenario such as `eros-config1` flies along, takes no
pictures and is told by the policy where to look, like the others.

## Does it beat the scripted policies?

Each policy flew the same 100 flights, seeds {seeds}, which no training had seen. Means with 95 % confidence intervals of the
mean; the last column is the mean of the paired differences to the best scripted policy.

| policy | return | seen [%] | delivered / nominal | against {best} |
|---|---|---|---|---|
{table}

The trained policy {verdict} the best scripted one, *{best}*, by {difference} (against *greedy*: {greedy}). *Greedy ahead* is
the rule that training begins with: worth counts area and data, and who has nothing in reach turns to what it will reach.
None of these policies ever sends to another spacecraft: all speak to Earth themselves, one after another, so that the antenna
of the crosslink makes no difference to these numbers.

**What this does not show.** Only the initial attitudes and rates differ from flight to flight, and they have settled
before the first picture. Seeds that training had not seen therefore prove no generalisation: *replayed list of
actions* repeats what the trained policy did in the flight of seed {recorded}, step by step, without looking at
anything but the clock, and the trained policy differs from that list by {replayed} in the mean of
the paired differences. So the task measures how good a plan for one flyby is; it does not measure feedback. The numbers
say nothing about other scenarios either, for which a policy has to be trained anew: flown on another target its features
are worked out from that target's patches, but its network has never seen them.

**At the rates of the link budget.** The table is at the environment's constant rates, 8 kbit/s to Earth, with which the policy
was trained. With `swarm_rate_bit_s=None, earth_rate_bit_s=None` data move as the scenario's radios and stations allow: Earth is
far from this target, and hears {earth_rate} kbit/s. The same policies, not trained anew, then come to

| policy | return | seen [%] | delivered / nominal | against {best} |
|---|---|---|---|---|
{budget_table}

The trained policy {budget_verdict} the best scripted one there, *{budget_best}*, by {budget_difference}.

## How it learns

![Learning curve](../images/{curve})

- **Network.** One small network for all spacecraft. It gives every patch a score from the features of that patch (what is
  unseen, what a picture would bring, range and angle, who else looks there) and of the spacecraft, and scores the other
  choices from the spacecraft alone. `envs/policies/policy.py` has the equations and the features.
- **Imitation.** Three rounds of DAgger: the network flies, *greedy ahead* says what it would have done. On two shared cores
  that took {imitated_min} minutes and brought the return from about 0 to {imitated}; PPO passed it after {passed} steps, at
  {passed_min} minutes. With `--minutes 2`, the default, nearly all of the gain that the script prints there is therefore of
  imitation, not of PPO; its last line says how many steps and updates PPO had, and the return before and after them.
- **PPO** of stable-baselines3 goes on from there, with a critic that averages over the spacecraft, discount 0.99, learning rate
  and entropy bonus falling linearly.
- **Reward.** Data count when Earth has them, hundreds of seconds after the picture. Potential-based shaping with the data
  aboard moves that reward to the picture and changes no optimal policy.
- **Short flights.** After 750 s no picture of this target counts any more. Flights are broken off there, the data aboard taken
  as delivered; in the last tenth of the time they go on to their end. The thin curve counts in the same way.

## What was tried

Return on the 16 validation seeds, after imitation and at its best.

| run | settings | thousand steps | minutes | after imitation | best |
|---|---|---|---|---|---|
{tried}

The cautious run changed the policy too little per update for its time. The shipped one first loses what it had imitated,
because its critic knows nothing yet and the entropy bonus spreads the actions, and then passes it.

Greedy rules that weigh the angle to turn were tried too and lost: they stay on the leftovers of a patch. One spacecraft passes
near enough to see nearly all of the target, for about five minutes, and the others see a part; what pays is the order in
which that one goes through its patches.
"""


if __name__ == "__main__":
    main()
