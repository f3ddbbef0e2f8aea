"""Pictures of a design: the paper's Figures 7 and 8, who covers what, and the trade-off."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from swarm_mj.designer.class_problem import ClassProblem
from swarm_mj.designer.study import Study, describe
from swarm_mj.figures.cells import draw_cells, flat_points
from swarm_mj.figures.palette import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY_BLUE, VERMILLION
from swarm_mj.figures.style import HALO, TICK_PT, annotate, caption, label, new_figure, plain, tidy, write
from swarm_mj.scenarios.itinerary import target_name
from swarm_mj.typing import Ints

#: Colour of a cell by how many of the chosen spacecraft see it; the last stands for all larger numbers.
TIMES_SEEN = (ORANGE, SKY_BLUE, BLUE, "#00466E")
#: More genes than these have no room in one row.
MAX_GENES = 12
#: Legend entries that have room above each other.
MAX_ENTRIES = 16
OPERATOR_COLOURS = {"repair": BLUE, "plain": VERMILLION}


def compose_history(study: Study) -> Figure:
    """Figure 7: best and mean fitness by generation, for both sets of operators, with the proven minimum."""
    figure = new_figure(4.2, f"Evolution of the design: {plain(study.scenario.name)}")
    ax = figure.add_subplot()
    for name, result in study.genetic.items():
        generation = np.arange(len(result.history.best))
        colour = OPERATOR_COLOURS[name]
        words = {"repair": "with repair and pruning", "plain": "plain crossover and mutation"}[name]
        ax.step(generation, result.history.best, where="post", color=colour, linewidth=2, label=f"best, {words}")
        ax.plot(generation, result.history.mean, color=colour, linewidth=1, linestyle=":", label=f"mean, {words}")
    n_max = study.problem.max_observers
    ax.axhline(study.exact.n_observers, color=BLACK, linewidth=0.9, linestyle="--", label="proven minimum")
    ax.axhspan(n_max + 1, n_max + 2, color=GREY, alpha=0.15, linewidth=0, label="target not covered")
    ax.set_ylim(0, n_max + 2)
    ax.margins(x=0.0)
    ax.yaxis.set_major_locator(MaxNLocator(integer=True))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    tidy(ax)
    label(ax, "generation [-]", "fitness: number of observers [-]")
    figure.legend(loc="outside lower center", ncols=3, fontsize=TICK_PT, frameon=False)
    return figure


def compose_gene_map(study: Study) -> Figure:
    """Figures 5 and 8: the gene map of a design, and the selected design in it."""
    seen = study.visibility
    points = [describe(seen.candidates[p - 1], seen) for p in study.selected]
    # What was chosen besides the point stands below it.
    shown = [fill(words, 12) for words in points[:MAX_GENES]]
    more = "" if len(shown) == len(points) else f" (first {len(shown)} of {len(points)} points)"
    title = f"Selected design: {plain(study.scenario.name)}{more}"
    figure = new_figure(2.3, title, width_in=max(9.0, 1.15 * (len(shown) + 2)))
    ax = figure.add_subplot()
    ax.set_axis_off()
    numbers = range(1, len(shown) + 1)
    rows = [
        ["observing\nspacecraft"] + [f"spacecraft {k}\nvisits point" for k in numbers],
        ["$N_{Obs}$"] + [f"$p_{{{k}}}$" for k in numbers],
        [f"1 to {study.problem.max_observers}"]
        + [f"1 to {max(candidate.point for candidate in seen.candidates)}"] * len(shown),
        [str(len(points)), *shown],
    ]
    heads = ["description", "symbol", "domain", "selected"]
    table = ax.table(cellText=rows, rowLabels=heads, cellLoc="center", rowLoc="center", bbox=Bbox.unit())
    table.auto_set_font_size(False)
    table.set_fontsize(TICK_PT)
    for (row, column), cell in table.get_celld().items():
        cell.set_edgecolor(GREY)
        if row == 0 or column < 0:
            cell.set_facecolor("#EEF3F8")
        elif row == len(rows) - 1:
            cell.get_text().set_fontweight("bold")
    return figure


def compose_cover(study: Study) -> Figure:
    """Each target as seen from the body's centre: how many of the chosen spacecraft see each cell, or what they map."""
    whole = study.visibility.region
    regions = whole.targets
    title, state, words = _covered(study)
    figure = new_figure(5.6, title, width_in=max(6.5, 5.0 * len(regions)))
    for k, region in enumerate(regions):
        ax = figure.add_subplot(1, len(regions), k + 1)
        draw_cells(ax, region, np.array([to_rgb(TIMES_SEEN[n]) for n in state[whole.cells_of(k)]]))
        _draw_points(ax, study, k)
        if len(regions) > 1:
            caption(ax, f"target {target_name(k)}")
    handles: list[Patch | Line2D] = [Patch(color=TIMES_SEEN[n], label=words[n]) for n in np.unique(state)]
    spot: dict[str, Any] = {"marker": "o", "linestyle": "", "color": VERMILLION, "markeredgecolor": "white"}
    handles.append(Line2D([], [], label="visited point", **spot))
    handles.append(Line2D([], [], label="point tried", marker="o", linestyle="", color=BLACK, markersize=1.8))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 4), fontsize=TICK_PT, frameon=False
    )
    return figure


def _covered(study: Study) -> tuple[str, Ints, tuple[str, ...]]:
    """Title, state of each cell as a place in `TIMES_SEEN`, and the states in words."""
    name, times = plain(study.scenario.name), study.visibility.sees[study.selected - 1].sum(axis=0)
    if isinstance(study.problem, ClassProblem):
        state = (times > 0) + study.problem.mapped_by(study.selected).astype(np.int64)
        title = f"What is mapped at class {study.problem.name}: {name}"
        return title, state, ("not seen", "seen, not mapped", "mapped")
    words = ("not seen", "seen by 1", "seen by 2", "seen by 3 or more")
    return f"Who covers what: {name}", np.minimum(times, len(TIMES_SEEN) - 1), words


def _draw_points(ax: Axes, study: Study, target: int) -> None:
    seen, region = study.visibility, study.visibility.region.targets[target]
    flat = flat_points(region, 0, region.vertices[region.visiting_vertex])
    asked = [*seen.candidates, *(one for one, _ in (*seen.left_out, *seen.thinned))]
    tried = sorted({one.point - 1 for one in asked if one.target == target})
    ax.plot(*flat[tried].T, "o", color=BLACK, markersize=1.8)
    chosen = [study.visibility.candidates[p - 1] for p in study.selected]
    for number in sorted({c.point for c in chosen if c.target == target}):
        ax.plot(*flat[number - 1], "o", color=VERMILLION, markersize=8, markeredgecolor="white")
        annotate(ax, str(number), flat[number - 1], (0.0, 8.0), va="baseline", fontweight="bold", path_effects=HALO)


def compose_pareto(study: Study) -> Figure:
    """The trade-off: observed area against delta-v, one colour per number of observers."""
    front = study.front
    assert front is not None
    figure = new_figure(4.6, f"Trade-off of the design: {plain(study.scenario.name)}")
    ax = figure.add_subplot()
    numbers = np.unique(front.n_observers)
    cycle = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY_BLUE, BLACK, GREY)
    markers = "osD^vP*X<>"
    for k, n in enumerate(numbers):
        same, marker, colour = front.n_observers == n, markers[k % len(markers)], cycle[k % len(cycle)]
        x, y = front.delta_v[same], 100.0 - front.uncovered_percent[same]
        ax.plot(x, y, marker, color=colour, markersize=4.5, label=str(n))
    tolerance = study.problem.tolerance_percent
    ax.axhline(100.0 - tolerance, color=BLACK, linestyle="--", linewidth=0.9)
    ax.annotate("covered within the tolerance", (0.99, 100.0 - tolerance), xycoords=("axes fraction", "data"), ha="right",
                va="bottom", fontsize=TICK_PT, xytext=(0, 2), textcoords="offset points")  # fmt: skip
    ax.set_ylim(min(0.0, float((100.0 - front.uncovered_percent).min())), 106.0)
    tidy(ax)
    label(ax, "deployment delta-v of all observers [m/s]", "observed share of the target [%]")
    look: dict[str, Any] = {"fontsize": TICK_PT, "title_fontsize": TICK_PT, "frameon": False}
    columns = 1 + (len(numbers) - 1) // MAX_ENTRIES
    figure.legend(title="observers", loc="outside right center", ncols=columns, **look)
    return figure


def compose_certainty(study: Study) -> Figure:
    """What certainty costs: the fewest spacecraft for several probabilities, and what a campaign says of the design."""
    figure = new_figure(4.2, f"Cost of certainty: {plain(study.scenario.name)}")
    ax = figure.add_subplot()
    levels = sorted(study.certainty, key=lambda level: level.asked)
    found = [level for level in levels if level.points is not None]
    numbers = np.array([len(level.points) for level in found if level.points is not None])
    asked = np.array([level.asked for level in found])
    promised = np.array([[level.promised, level.low, level.high] for level in found]).reshape(-1, 3)
    ax.plot(numbers, asked, "_", color=BLACK, markersize=14, markeredgewidth=1.6, label="asked for")
    around = np.maximum([promised[:, 0] - promised[:, 1], promised[:, 2] - promised[:, 0]], 0.0)
    kept = "promised, with the error of its sample" if study.scenario.designer.realisations else "promised"
    ax.errorbar(numbers, promised[:, 0], yerr=around, fmt="o", color=BLUE, markersize=5, capsize=3, label=kept)
    for level in levels:
        n = level.bound if level.points is None else len(level.points)
        words = f"{level.asked:g}: {'none found' if level.points is None else n}"
        words += "" if level.proven else f", at least {level.bound}"
        annotate(ax, words, np.array([n, level.asked]), (10.0, -9.0), ha="left")
    if study.verified is not None:
        flown = study.verified
        share, x = flown.covered / flown.flights, len(study.selected) - 0.12
        ends = [[max(share - flown.low, 0.0)], [max(flown.high - share, 0.0)]]
        ax.errorbar([x], [share], yerr=ends, fmt="s", color=VERMILLION, markersize=5, capsize=3,
                    label=f"of {flown.flights:,} flights with other seeds")  # fmt: skip
    if study.nominal is not None:
        ax.axvline(study.nominal.n_observers, color=GREY, linestyle="--", linewidth=0.9, label="without losses")
    ax.set_xlim(min([*numbers, *(level.bound for level in levels)], default=1) - 0.5, max([*numbers, 1]) + 1.0)
    ax.set_ylim(min(0.45, *asked - 0.05, 1.0), 1.02)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    tidy(ax)
    label(ax, "number of observers [-]", "probability of mapping enough [-]")
    figure.legend(loc="outside lower center", ncols=2, fontsize=TICK_PT, frameon=False)
    return figure


COMPOSERS: dict[str, Callable[[Study], Figure]] = {
    "history": compose_history,
    "gene_map": compose_gene_map,
    "cover": compose_cover,
    "pareto": compose_pareto,
    "certainty": compose_certainty,
}


def composers(study: Study) -> dict[str, Callable[[Study], Figure]]:
    """What composes the pictures that a design has the numbers for, by file stem."""
    there = {"pareto": study.front is not None, "history": bool(study.genetic), "certainty": bool(study.certainty)}
    return {name: compose for name, compose in COMPOSERS.items() if there.get(name, True)}


def draw_all(folder: Path, study: Study, *, pdf: bool = False) -> None:
    """Write every picture of a design that it has the numbers for, and with `pdf` as PDF too."""
    for name, compose in composers(study).items():
        write(compose(study), folder / f"{name}.png", pdf=pdf)
