"""Write docs/results/swarm_classes.md, what each swarm class buys: python -m scripts.pages.swarm_classes.

Flies the classes through the same 200 dispersed encounters of `eros-observe` with losses, on all cores, and works out what the
spacecraft that are left after a loss could show at most. An interrupted call goes on where it was. `--runs N` flies fewer.
"""

from __future__ import annotations

import argparse
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

import swarm_mj as sm
from scripts.pages import IMAGES, RESULTS
from swarm_mj.api.campaign import ComparedClasses, compare_classes
from swarm_mj.campaigns.classes import Recovery, compose_by_lost, compose_chance, table_by_lost, table_of_classes
from swarm_mj.campaigns.store import read_results
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.replanning import problem_of
from swarm_mj.figures.style import save
from swarm_mj.flight.downlink import frame_pixels
from swarm_mj.flight.encounter_table import encounter_of
from swarm_mj.flight.observe import camera_from
from swarm_mj.flight.plan import as_planned, make_plan
from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.rendering.cameras import OVERVIEW
from swarm_mj.rendering.film import picture_times
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.rendering.video import film
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_swarm import Swarm

PAGE = RESULTS / "swarm_classes.md"
SCENARIO = "eros-observe"
FILM = "swarm_classes.mp4"
#: Parts along one side of the target over which cameras are led to tell pointing from coordination.
SWEPT = 3
#: What is shown in the film, and how fast.
FILMED = {
    "duration_s": 840,
    "faults": [{"kind": "spacecraft_lost", "spacecraft": "sc5", "at_s": 420}],
    "observation.observer": "horizon",
}
FILM_SPEED, FILM_FPS, HALF = 60.0, 25.0, (480, 420)
PICTURES = ("swarm_classes_chance.png", "swarm_classes_lost.png")

HEAD = """# Swarm classes: what coordination buys

Written by `python -m scripts.pages.swarm_classes`, which runs what `swarm-mj compare-classes {scenario}` does: {runs} dispersed
encounters of `{scenario}`, each flown by every [class](../theory/coordination.md) with the same seed and the same losses. In
each encounter every spacecraft is lost with one chance between 0 and 40 %, at a random time before it arrives at its visiting
point. All fly with `physics.stepper: kernel`, the same motion in less time. These are {flights} flights.

{assumed}

{table}
Brackets: 95 % intervals. *Delivered*: on Earth within two days after the flight, by what the swarm can run alone
([data by class](../theory/coordination.md#data-by-class)). In classes 0 and 1 everybody sends its own pictures, those of a
lost one are lost. In classes 2 and 4 a relay that is lost is replaced, in class 4 during the flight as well; in class 3 it is
not, and what the others hold stays aboard. *Delta-v*: of the whole swarm; propellant is used by class 1 alone. It holds the
planned formation about the mean of those heard of ([law](../theory/formation.md)), and images and sends as class 0 does.
*Placed*: the visiting points ({places}) were planned together with the pictures, so that as much as possible can be shown by
two spacecraft; class 0 flies to them as well, so that the effect of the places and that of coordination can be told apart.

### Why class 2 is below class 0

Not for want of coordination. Class 2 flies the roles of the scenario's behaviour, whose cameras look at the body's centre:
from {altitude:.0f} km a picture is {wide:.1f} km wide, on a target {across:.1f} km across. Classes 0, 1, 3 and 4 choose where
each picture looks from the [table of the encounter](../theory/coordination.md#the-table-of-the-encounter). One encounter
without errors and losses:

| flown | observed [%] | too coarse [%] | other causes [%] |
|---|---|---|---|
{pointing}

### What each step buys

{steps}

{conclusions}

![Observed and delivered area over the chance of loss](../images/{chance})

## By number of lost spacecraft

Delivered area, mean [%]:

{by_lost}
![Delivered area by number of lost spacecraft](../images/{lost})

## One loss

Delivered area, mean [% of the target]:

| | encounters | class 3 loses | class 4 brings home of it | share | class 4 loses against itself |
|---|---|---|---|---|---|
{recovered}

What a class loses is the difference to its own flights without losses; what class 4 brings home is what it delivers more than
class 3 in the same encounters with one loss. It is also better where nothing is lost, since it knows in flight what its
pictures missed: that is part of what it brings home. Where the lost one is the relay, class 3 loses what the others hold, too.

### Why not more: the bound

The best that those who are left can do if everybody knows at once, before the first picture, who is lost: the optimum of the
table's problem without the lost one, with its bound, and all that the others could show if turning took no time.

| places | lost | in view of the others [%] | best plan found [%] | bound [%] |
|---|---|---|---|---|
{bounds}

The table counts what the cone inside the field of view shows when a turn is over; pictures taken while turning show more, so
that flights may see a little more than its plans.

{words}

## One encounter, two classes

The same encounter as designed, with spacecraft 5 lost after 420 s: on the left class 2, whose roles are those of the behaviour
and whose cameras look at the body's centre; on the right class 4, which images the target part by part and covers what
was lost.

<video controls loop muted src="../images/{film}" style="width: 100%"></video>
"""


class LossBound(NamedTuple):
    """The table's problem without one observer, lost before its first picture.

    Attributes:
        spacecraft: Who is lost; empty: nobody.
        in_view: Area that the others could show with all pictures of the table, turns left out [%].
        best: Area of the best plan found for them [%].
        bound: No plan has more [%].
    """

    spacecraft: str
    in_view: float
    best: float
    bound: float


def loss_bounds(scenario: Scenario, time_limit_s: float = 6.0) -> list[LossBound]:
    """For nobody and for each observer lost: what those that are left can still show, by an omniscient plan.

    Args:
        scenario: Faults and dispersions are left out.
        time_limit_s: For each plan and its proof [s].

    Raises:
        SwarmError: The scenario cannot be planned.
    """
    plan = make_plan(as_planned(scenario))
    encounter = encounter_of(plan)
    problem, percent = problem_of(encounter), 100.0 / float(encounter.area.sum())
    found = []
    for lost in range(-1, plan.n_observers):
        left = np.arange(problem.n_agents) != lost
        rest = replace(problem, available=np.tile(left[:, None], (1, problem.n_slots)))
        best = optimum(rest, time_limit_s)
        name = plan.names[lost] if lost >= 0 else ""
        found.append(LossBound(name, percent * rest.coverable, percent * best.value, percent * best.bound))
    return found


def main() -> None:
    """Fly, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200, help="encounters (default: 200)")
    parser.add_argument("--workers", type=int, help="processes (default: one per core)")
    parser.add_argument(
        "--out", type=Path, default=Path("results") / f"{SCENARIO}-classes", help="folder of the flights"
    )
    arguments = parser.parse_args()
    console = Console()
    with progress_bars(console, False) as bars:
        compared = compare_classes(
            SCENARIO,
            runs=arguments.runs,
            out=arguments.out,
            workers=arguments.workers,
            resume=arguments.out.exists(),
            progress=bars or False,
        )
    bounds = {"as designed": loss_bounds(load_scenario(SCENARIO))}
    placed = load_scenario(SCENARIO, {"design.visiting_points": compared.places})
    bounds["placed"] = loss_bounds(placed)
    write_film()
    write_page(compared, bounds, arguments.out, arguments.runs)
    print(f"{PAGE} written")


def write_page(compared: ComparedClasses, bounds: dict[str, list[LossBound]], folder: Path, runs: int) -> None:
    """Write page and figures."""
    results = read_results(folder)
    save(compose_chance(results), IMAGES / PICTURES[0])
    save(compose_by_lost(compared.classes), IMAGES / PICTURES[1])
    text = HEAD.format(
        scenario=SCENARIO,
        runs=runs,
        flights=len(compared.table),
        table=table_of_classes(compared.classes),
        places=", ".join(map(str, compared.places)),
        assumed=textwrap.fill(_assumed(load_scenario(SCENARIO)), 124),
        **_footprint(),
        pointing="\n".join(pointing()),
        chance=PICTURES[0],
        lost=PICTURES[1],
        by_lost=table_by_lost(compared.classes),
        recovered="\n".join(_row(name, one) for name, one in compared.recovered.items()),
        bounds="\n".join(_bound(name, one) for name, found in bounds.items() for one in found),
        words="\n".join(textwrap.fill(part, 124) for part in _words(compared, bounds).splitlines()),
        steps=_steps(compared),
        conclusions=textwrap.fill(_conclusions(compared), 124),
        film=FILM,
    )
    write_text(PAGE, "\n".join(line.rstrip() for line in text.splitlines()) + "\n")


def write_film() -> None:
    """Fly one encounter with classes 2 and 4, and film both side by side; needs OpenGL."""
    width, height = HALF
    halves = []
    for level in (2, 4):
        flight = sm.fly(SCENARIO, {**FILMED, "swarm": {"class": level}})
        replay = Replay(flight.plan, flight.telemetry, flight.coverage.first_seen_s, flight.delivered)
        drawing = Drawing(
            replay.plan, replay.path_N, camera=OVERVIEW, width=width, height=height, note=f"class {level}"
        )
        with drawing:  # one OpenGL context at a time
            times = picture_times(replay, FILM_FPS, FILM_SPEED)
            halves.append([drawing.draw(replay.at(float(t))).copy() for t in times])
    with film(IMAGES / FILM, width=2 * width, height=height, fps=FILM_FPS, sample=()) as reel:
        for left, right in zip(*halves, strict=True):
            reel.add(np.hstack([left, right]))


def _assumed(scenario: Scenario) -> str:
    """What counts, what is sent, and what is perfect."""
    seen, data, swarm = scenario.observation, scenario.data, Swarm.model_validate({"class": 4})
    light = (
        f"sunlit (incidence at most {seen.max_incidence_deg:g} deg)"
        if seen.light == "sunlit"
        else "in view, lit or not"
    )
    sent = {"frame": "Whole frames are", "window": "Windows of frames are", "cells": "Pixels of new cells alone are"}
    return (
        f"A face counts as observed where it is {light}, at most {seen.max_emission_deg:g} deg off its normal, where the "
        f"median face would take up {seen.min_pixels:g} pixels and, as `{SCENARIO}` asks, the ground sampling distance is at "
        f"most {seen.max_gsd_m:g} m. {sent[data.product]} sent, "
        f"{frame_pixels(scenario) * data.sent_bits_per_pixel / 1e6:.2g} Mbit each. Attitude sensors are those of "
        f"`spacecraft.sensors: {scenario.spacecraft.sensors.name}`. Of the messages {100 * swarm.message_loss:g} % are lost."
    )


def _footprint() -> dict[str, float]:
    """Altitude, width of a picture and of the target's region [km]."""
    plan = make_plan(load_scenario(SCENARIO))
    altitude, tan = plan.scenario.design.imaging_altitude_m, camera_from(plan.scenario).tan_half_angle
    corners = plan.region.corners_A.reshape(-1, 3)
    return {
        "altitude": altitude / 1e3,
        "wide": 2e-3 * altitude * tan,
        "across": 1e-3 * float(np.ptp(corners, axis=0).max()),
    }


def pointing() -> list[str]:
    """One encounter flown by the same roles with two ways to look, and by class 0, without errors and losses."""
    radius = float(np.linalg.norm(make_plan(load_scenario(SCENARIO)).region.centroid_A, axis=1).mean())
    sweep = {"surface_radius_m": radius, "rows": SWEPT, "dwell_s": 20, "election": "medoid"}
    rows = []
    for words, level, behavior in (
        ("class 2, cameras at the body's centre", 2, {}),
        (f"class 2, the same roles, cameras led over {SWEPT} x {SWEPT} parts (`target_sweep`)", 2, sweep),
        ("class 0", 0, {}),
    ):
        chosen = {"behavior.name": "target_sweep", "behavior.parameters": behavior} if behavior else {}
        summary = sm.fly(SCENARIO, {"swarm": {"class": level}, "observation.observer": "horizon", **chosen}).summary
        lost = {part["cause"]: part["percent"] for part in summary["not_observed"]}
        coarse = lost.pop("too coarse", 0.0)
        rows.append(f"| {words} | {summary['coverage_percent']:.1f} | {coarse:.1f} | {sum(lost.values()):.1f} |")
    return rows


#: Steps of coordination: from which class to which, and what that is.
STEPS = (
    ("0", "1", "holding the formation"),
    ("0", "3", "one plan instead of one each"),
    ("0", "4", "planning anew in flight instead of one each"),
    ("3", "4", "planning anew in flight instead of before"),
    ("0", "0 placed", "places planned, everybody alone"),
    ("0 placed", "3 placed", "one plan at these places"),
    ("0 placed", "4 placed", "planning anew in flight at these places"),
)


def _gains(compared: ComparedClasses, before: str, after: str) -> tuple[float, float, float]:
    """Mean difference in delivered area over the same encounters [% of the target]: all, those without and with losses."""
    table = compared.table[compared.table["status"] == "ok"]
    delivered, lost = (
        table.pivot(index="run", columns="scenario", values=key) for key in ("delivered_percent", "lost")
    )
    gain = (delivered[f"class {after}"] - delivered[f"class {before}"]).dropna()
    whole = (lost == 0).all(axis=1)[gain.index]
    return float(gain.mean()), float(gain[whole].mean()), float(gain[~whole].mean())


def _steps(compared: ComparedClasses) -> str:
    """A table of the differences in delivered area, encounter by encounter, without and with losses."""
    lines = [
        "Delivered area, mean difference over the same encounters [% of the target]:",
        "",
        "| from class | to class | what is added | all encounters | without losses | with losses |",
        "|---|---|---|---|---|---|",
    ]
    for before, after, what in STEPS:
        cells = " | ".join(f"{gain:+.1f}" if gain == gain else "-" for gain in _gains(compared, before, after))
        lines.append(f"| {before} | {after} | {what} | {cells} |")
    return "\n".join(lines)


def _conclusions(compared: ComparedClasses) -> str:
    """What the steps come to, in words that hold whatever the numbers."""
    hours = {one.name: one.map_h for one in compared.classes}
    planned, replanned, places, held = (_gains(compared, "0", after) for after in ("3", "4", "0 placed", "1"))
    there = _gains(compared, "0 placed", "4 placed")
    return (
        f"Planned places change what class 0 delivers by {places[0]:+.1f} %, replanning in flight by {replanned[0]:+.1f} % at "
        f"the designed places and {there[0]:+.1f} % at the planned ones, holding the formation by {held[0]:+.1f} %. A plan "
        f"made before the encounter stands {planned[1]:+.1f} % against everybody alone while nothing is lost, and "
        f"{planned[2]:+.1f} % with losses: it has a single relay, which nobody replaces. All that was observed is on Earth "
        f"after {hours['4']:.1f} h in class 4, whose spacecraft know who holds what, and after {hours['0']:.1f} h in class 0, "
        "where each sends what others have sent as well."
    )


def _row(name: str, one: Recovery) -> str:
    share = f"{100.0 * one.share:.0f} %" if one.flights else "-"
    return f"| {name} | {one.flights} | {one.lost.value:.1f} | {one.kept.value:.1f} | {share} | {one.other_lost.value:.1f} |"


def _bound(name: str, one: LossBound) -> str:
    return f"| {name} | {one.spacecraft or 'nobody'} | {one.in_view:.1f} | {one.best:.1f} | {one.bound:.1f} |"


def _words(compared: ComparedClasses, bounds: dict[str, list[LossBound]]) -> str:
    worst = min(bounds["as designed"], key=lambda one: one.bound)
    least = min(one.best for one in bounds["placed"])
    designed, placed = compared.recovered["as designed"], compared.recovered["placed"]
    return (
        f"As designed, {worst.spacecraft} alone comes near enough to most of the target: without it no plan shows more than "
        f"{worst.bound:.1f} %, whoever makes it and however soon, and class 4 brings home {100.0 * designed.share:.0f} % of "
        "what class 3 loses with one loss; part of it because it is better anyway, for against itself it loses "
        f"{designed.other_lost.value:.1f} %.\n"
        f"With the places planned as well, a plan shows {least:.1f} % or more without any one of them: class 4 brings home "
        f"{100.0 * placed.share:.0f} % of what class 3 loses there, and loses {placed.other_lost.value:.1f} % against itself."
    )


if __name__ == "__main__":
    main()
