"""Write docs/results/reproduction.md, the fewest observers under every reading of the criterion: python -m scripts.pages.reproduction.

Every number in the page comes from the exact solver; pictures are cached, so that a second run takes seconds.
"""

from __future__ import annotations

import re
from operator import attrgetter
from statistics import median
from typing import Any, NamedTuple, get_args

import numpy as np
from rich.console import Console

from scripts.pages import RESULTS
from swarm_mj.designer.candidates.visibility import visibility
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.genetic import GeneticSettings, Operators, evolve
from swarm_mj.designer.study import cover_problem, growth
from swarm_mj.errors import MissionError
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.flight.targets import target_from
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

PAGE = RESULTS / "reproduction.md"

#: A pixel of the instrument that resolves 10 cm from 14 km, straight down [rad].
PAPER_IFOV = 0.1 / 14_000.0

#: How long the genetic algorithm may run: the paper's 67 generations of 100 designs, and this program's own rule.
BUDGETS: dict[str, dict[str, int]] = {
    "the paper's 67 generations of 100": {"population": 100, "max_generations": 67, "patience": 67},
    "until 50 generations gain nothing": {"population": 100, "max_generations": 200, "patience": 50},
}
SEEDS = range(10)


class Reading(NamedTuple):
    """One way to read the criterion."""

    criterion: str = "passage"
    half_angle_deg: float = 21.5
    field: str = "cone in square"
    part: str = "half"
    emission_deg: float | None = None
    gsd_cm: float | None = None
    occlusion: bool = True
    edges: str = "corner"
    projection: str = "radial"
    cell_size_m: float | str | None = None

    @property
    def overrides(self) -> dict[str, Any]:
        """The scenario values that make this reading."""
        return {
            "camera.half_angle_deg": self.half_angle_deg,
            "camera.shape": "cone" if self.field == "cone" else "square",
            "camera.detector_ifov_rad": PAPER_IFOV,
            "observation.observer": "raster",
            "observation.criterion": self.criterion,
            "observation.any_pixel": self.part == "any pixel",
            "observation.min_fraction": 1.0 if self.part == "whole" else 0.5,
            "observation.max_emission_deg": self.emission_deg or 90.0,
            "observation.min_pixels": 0.0,
            "observation.light": "ignored",
            "observation.max_gsd_m": None if self.gsd_cm is None else self.gsd_cm / 100.0,
            "observation.occlusion": self.occlusion,
            "designer.any_roll": self.field == "cone in square",
            "target.edges": self.edges,
            "target.cell_size_m": self.cell_size_m,
            "design.projection": self.projection,
        }

    @property
    def other(self) -> str:
        """What is read otherwise than in most rows."""
        cells = f"{self.cell_size_m:g} m" if isinstance(self.cell_size_m, float) else self.cell_size_m
        told = {
            "no occlusion": not self.occlusion,
            "edges: side": self.edges == "side",
            "projection: normal": self.projection == "normal",
            f"cells: {cells}": self.cell_size_m is not None,
        }
        return ", ".join(words for words, holds in told.items() if holds) or "-"


def readings() -> list[tuple[str, list[Reading]]]:
    """All readings, in groups."""
    angles = (21.5, 10.75, 8.0, 6.0, 5.0, 4.5, 4.25, 4.1, 4.0, 3.5, 3.0)
    emissions = (60.0, 45.0, 40.0, 35.0, 34.0, 32.0, 31.5, 31.0, 30.0)
    resolutions = (15.0, 13.0, 12.5, 11.5, 11.25, 11.2, 11.1, 11.0, 10.0)
    whole = (21.5, 8.0, 7.5, 7.0, 6.0, 5.25, 5.0, 4.75, 4.65, 4.5, 4.1)
    scopes = ("passage", "arrival")
    return [
        ("Whole passage, by half-angle", [Reading("passage", a) for a in (*angles, 2.0, 1.75, 1.65, 1.6, 1.5)]),
        ("Instant of the arrival, by half-angle", [Reading("arrival", a) for a in angles]),
        ("Limit on the emission angle", [Reading(s, emission_deg=e) for s in scopes for e in emissions]),
        ("Limit on the ground sampling distance", [Reading(s, gsd_cm=g) for s in scopes for g in resolutions]),
        (
            "Both limits at the arrival",
            [
                Reading("arrival", emission_deg=e, gsd_cm=g)
                for e, g in ((34.0, 11.25), (34.0, 11.5), (32.0, 11.5), (32.0, 12.5))
            ],
        ),
        (
            "Part of a face that must be seen: any pixel or half",
            [Reading("arrival", a, part=p) for a in (7.5, 7.0, 6.0, 5.0, 4.1) for p in ("any pixel", "half")],
        ),
        (
            "Part of a face that must be seen: the whole",
            [Reading("passage", part="whole"), *(Reading("arrival", a, part="whole") for a in whole)],
        ),
        (
            "Field of view, at the arrival",
            [Reading("arrival", a, field=f) for a in (5.0, 4.5, 4.25, 4.1, 4.0) for f in ("square", "cone")],
        ),
        (
            "Without occlusion, as the paper culls and clips",
            [Reading(s, a, occlusion=False) for s in scopes for a in (21.5, 4.1)],
        ),
        (
            "Edges of the target, and projection of its points",
            [
                Reading(s, a, **told)  # type: ignore[arg-type]
                for told in ({"edges": "side"}, {"projection": "normal"})
                for s, a in (("passage", 21.5), ("arrival", 21.5), ("arrival", 4.1))
            ],
        ),
        (
            "Cells instead of faces, at the arrival",
            [Reading("arrival", 4.1, cell_size_m=size) for size in (600.0, "auto", 300.0, 150.0)],
        ),
    ]


def minimum(scenario: Scenario) -> str:
    """The proven minimum in words."""
    seen = visibility(scenario)
    try:
        result = solve_exact(cover_problem(scenario, seen), scenario.designer.time_limit_s)
    except MissionError as error:
        most = re.search(r"([\d.]+) % of it", str(error))
        return (
            f"none: all points together see {most[1]} %"
            if most
            else f"none: more than {scenario.designer.max_observers}"
        )
    return str(result.n_observers) if result.status == "optimal" else f"at most {result.n_observers}"


def target_numbers(scenario: Scenario) -> dict[str, Any]:
    """Faces, visiting points and size of the target [km], and its points with the half-angle measured to the sides."""
    shape = load_body_shape(scenario.body)
    region, side = (
        target_from(load_scenario(scenario, {"target.edges": edges}), shape) for edges in ("corner", "side")
    )
    width, height = np.ptp(region.corners_A.reshape(-1, 3) @ region.axes_A[:2].T, axis=0) / 1e3
    return {
        "faces": region.n_faces,
        "points": region.n_visiting,
        "side_points": side.n_visiting,
        "width": width,
        "height": height,
    }


def row(reading: Reading, answer: str) -> str:
    """One line of the table; five stands out."""
    cells = [
        reading.criterion,
        f"{reading.half_angle_deg:g}",
        reading.field,
        reading.part,
        "-" if reading.emission_deg is None else f"{reading.emission_deg:g}",
        "-" if reading.gsd_cm is None else f"{reading.gsd_cm:g}",
        reading.other,
        f"**{answer}**" if answer == "5" else answer,
    ]
    return f"| {' | '.join(cells)} |"


def evolution(scenario: Scenario) -> list[str]:
    """What the genetic algorithm finds beside the proof."""
    seen = visibility(scenario)
    problem = cover_problem(scenario, seen)
    name, alone = scenario.name, int((100.0 * (seen.sees @ seen.area) / seen.area.sum() >= 99.9).sum())
    proof = f"{solve_exact(problem).n_observers}, proven; {alone} of {problem.n_points} points would do alone"
    lines = [f"| `{name}` | exact solver | - | {proof} | - |"]
    for operators in get_args(Operators):
        for budget, limits in BUDGETS.items():
            runs = [evolve(problem, GeneticSettings(operators=operators, seed=seed, **limits)) for seed in SEEDS]
            found, explored = ([f(run) for run in runs] for f in (attrgetter("n_observers"), attrgetter("explored")))
            count = f"{min(found)} to {max(found)}, median {median(found):g}" if len(set(found)) > 1 else f"{found[0]}"
            several = f"{min(explored):,} to {max(explored):,}" if len(set(explored)) > 1 else f"{explored[0]:,}"
            lines.append(f"| `{name}` | genetic, {operators} | {budget} | {count} | {several} |")
    return lines


def main() -> None:
    """Compute and write the page."""
    literal, packaged = load_scenario("eros-literal"), load_scenario("eros-config1")
    groups = readings()
    lines, fives = [], []
    with progress_bars(Console()) as bars:
        task = bars.add_task("readings", total=sum(len(group) for _, group in groups) + 2)
        for title, group in groups:
            lines += [f"\n### {title}\n", HEADER]
            for reading in group:
                answer = minimum(load_scenario(literal, reading.overrides))
                lines.append(row(reading, answer))
                if answer == "5":
                    fives.append(row(reading, answer))
                bars.advance(task)
        grown = growth(packaged)
        bars.advance(task)
        compared = [*evolution(literal), *evolution(packaged)]
        bars.advance(task)
    write_text(PAGE, TEXT.format(
        table="\n".join(lines),
        fives="\n".join([HEADER, *dict.fromkeys(fives)]),
        **target_numbers(literal),
        growth="\n".join(f"| {g.change} | {g.n_observers or 'none'} | {g.note} |" for g in grown),
        evolution="\n".join(compared),
    ))  # fmt: skip
    print(f"wrote {PAGE}")


HEADER = (
    "| criterion | half-angle [deg] | field of view | part of face | emission up to [deg] | GSD up to [cm] | other "
    "| fewest observers |\n|---|---|---|---|---|---|---|---|"
)

TEXT = """\
# Reproduction of AAS 19-144

This page is generated by `make reproduction`; every minimum is proven (HiGHS) for the candidates at hand.

## The question

The paper reports that five observing spacecraft are needed. With its parameters taken literally - pointing at the body's
centre, 21.5 deg half-angle, everything counts that is seen while inside the imaging region - one is enough: from 14 km the
camera's footprint, 11 km wide, holds the whole target, {width:.1f} by {height:.1f} km. The paper does not write down its culling and
clipping, at which instant a face counts, nor which part of a face must be seen. The tables give the fewest observers under
each reading that was tried; other readings may give other numbers.

Unless a row says otherwise, the target is F_T of {faces} faces on the 8,000-face mesh of this project, pointing is at the
body's centre, flights and epoch are those of `eros-literal`, pictures are drawn by compiled code (`observer: raster`), and
|100 - P_TO| <= 0.1 %. *Cone in square* counts what a square camera sees under any rotation about its line of sight; *square*
takes the rotation of a start along the inertial axes. *Any pixel* and *half* are judged on pixels, *whole* by geometry: all
three corners in the field of view and 16 points of the face hidden by nothing. The ground sampling distance (GSD) is that of an
instrument that resolves 10 cm from 14 km straight down, with range and obliquity.

**Vertices.** The paper's target has 49 vertices. Read with 20 deg to the corner edges of the pyramid, it has {points} here and 48 on
the 7,790 plates of the NEAR model (PDS, `eros007790.tab`); with 20 deg to its sides (`target.edges: side`) {side_points} here and 92 on
the plates. That is why the corner edges are the default. The paper's mesh is not known, so its 49 are not met exactly, and
its selected points 7, 25, 31, 34 and 38 name other places here.

## Readings that give five

{fives}

With the paper's 21.5 deg no reading in the tables gives five. Whole faces, side edges and points along the normal give one.
Over the passage one suffices down to the tightest limit on the emission angle that was tried, 30 deg, and to a GSD of 11 cm;
at the arrival tighter limits raise the minimum to two or three before faces are left that no point sees. With a GSD of
10 cm, obliquity included, the target cannot be covered: all points together see 96.11 % of it over the passage and 32.55 %
at the arrival, and 99.9 % is asked for.

In the tables five comes with a camera several times narrower: at the arrival 4 to 4.25 deg where half a face suffices (a
footprint 2.0 to 2.1 km wide; as *square* four at 4.25 deg) and 4.75 to 5 deg where the whole face is asked for (2.3 to 2.45
km); over the passage 1.65 deg (0.8 km). None of these is stated by the paper. `eros-config1` and `eros-config2` take the
arrival, after which the paper names its points, half a face, and 4.1 deg: a choice made here because it gives five, not the
paper's camera. Five is a property of that choice and of this mesh: cut into cells of 300 m, of 150 m or of a sixth of the
footprint (`auto`) instead of faces, the target needs six where 0.1 % may be left out, as in these tables; where nothing may,
cells of 150 m need seven ([convergence](convergence.md)). Coarser meshes need six. `eros-literal` keeps the literal reading.

Why the paper's 21.5 deg camera needed five cannot be told from its text. A genetic algorithm that stops above the minimum does
not explain it for the literal reading, see below.

## All readings
{table}

## The genetic algorithm beside the proof

The paper used MATLAB's solver for 67 generations and 6,801 designs, which fits populations of 100, and describes no operators.
Here *plain* is simulated binary crossover and polynomial mutation on the gene map; *repair* also completes and prunes designs.
Each row is ten runs with different seeds; designs that were already there are not explored again.

| scenario | method | budget | observers | designs explored |
|---|---|---|---|---|
{evolution}

For the literal reading there is nothing to search: every point suffices alone, and every run finds that. For `eros-config1`, at
the paper's own budget, the plain algorithm ends above the proven minimum every time; MATLAB's may fare otherwise.

## Beyond the paper

How the proven minimum of `eros-config1` changes with demands and freedoms. Points of a second target carry the letter B.

| change | fewest observers | points visited |
|---|---|---|
{growth}
"""

if __name__ == "__main__":
    main()
