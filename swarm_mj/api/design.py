"""A scenario's swarm designed: `design` makes a `Design`, the fewest observers that see the whole target, with proof."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from rich.progress import Progress, TaskID

from swarm_mj.api.display import Plots, figure_html, png_html, rows_html
from swarm_mj.api.scenario import Scenario, load
from swarm_mj.designer.columns import sweeps_for
from swarm_mj.designer.study import Growth, Study, Tell, Verified, extensions, growth, study_design
from swarm_mj.errors import OutputError
from swarm_mj.flight.plan import check_plugins
from swarm_mj.io.atomic import MARKER, Result, atomic_folder
from swarm_mj.io.cluster import Cluster
from swarm_mj.io.interruption import held
from swarm_mj.io.machine import check_workers
from swarm_mj.io.progress import Shown, Stages, using_bars
from swarm_mj.io.records import bytes_of
from swarm_mj.io.workers import Runner
from swarm_mj.observation.coverage import percent_text
from swarm_mj.records.design_files import design_record, left_out_words, write_design, write_growth
from swarm_mj.records.summary import library_versions
from swarm_mj.scenarios import schema
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource, design_overrides, load_scenario

#: The methods of a design in words, by their keys in its record.
METHODS = {"repair": "genetic algorithm, repair", "plain": "genetic algorithm, plain"}


class Design:
    """The fewest observers that see a target, and what proves it.

    Attributes:
        record: Everything as plain numbers, as in design.json.
        study: The problem and its answers as objects; None where the design was read from its folder.
        folder: Where it is saved; None: nowhere yet.
    """

    def __init__(
        self,
        scenario: schema.Scenario,
        record: dict[str, Any],
        *,
        study: Study | None = None,
        compared: Sequence[Growth] = (),
        folder: Path | None = None,
    ) -> None:
        self._scenario, self.record, self.study, self.folder = scenario, record, study, folder
        self._compared = list(compared)

    @property
    def scenario(self) -> Scenario:
        """The scenario that was designed for."""
        return Scenario.of(self._scenario)

    @property
    def points(self) -> list[int]:
        """The visiting points of the selected design, by their numbers from 1."""
        return list(self.record["visiting_points"])

    @property
    def n_observers(self) -> int:
        """Number of observers of the selected design."""
        return int(self.record["n_observers"])

    @property
    def bound(self) -> float:
        """No design of these candidates that covers the target has fewer observers: the dual bound of the integer program."""
        return float(self.record["proof"]["lower_bound"])

    @property
    def proven(self) -> bool:
        """Whether the selected design is proven to be minimal among its candidates and for the demands of the scenario."""
        return self.record["proof"]["status"] == "optimal" and self.n_observers == self.record["proof"]["minimum"]

    @property
    def covered_percent(self) -> float:
        """Share of the target's area that the selected design sees, or maps at the class it was made for [%]."""
        return float(self.record["covered_percent"])

    @property
    def table(self) -> pd.DataFrame:
        """The answers side by side: proof and genetic algorithm with observers, covered share [%], points, time [s]."""
        proof = self.record["proof"]
        rows = {"proof": (proof["minimum"], proof["covered_percent"], proof["visiting_points"], None, proof["seconds"])}
        for name, found in self.record["genetic"].items():
            points = found["gene_map"][1:]
            rows[METHODS[name]] = (
                found["n_observers"], found["covered_percent"], points, found["designs_explored"], found["seconds"]
            )  # fmt: skip
        columns = ["observers", "covered_percent", "points", "designs_explored", "seconds"]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        return table.astype({"designs_explored": "Int64"}).rename_axis("method")

    @property
    def front(self) -> pd.DataFrame:
        """The trade-off of spacecraft, delta-v [m/s] and covered share [%].

        Raises:
            OutputError: It was not asked for; design with `pareto=True`.
        """
        front = self._studied("front").front
        if front is None:
            raise OutputError("the trade-off was not computed; design with pareto=True")
        return pd.DataFrame(
            {
                "observers": front.n_observers,
                "delta_v_m_s": front.delta_v,
                "covered_percent": 100.0 - front.uncovered_percent,
                "points": [list(map(int, points)) for points in front.points],
            }
        )

    @property
    def certainty(self) -> pd.DataFrame:
        """The fewest spacecraft for several probabilities, that of the scenario first.

        Raises:
            OutputError: No probability was asked for; design with `designer.probability`.
        """
        if not self.record.get("certainty"):
            raise OutputError("no probability was asked for; design with designer.probability")
        table = pd.DataFrame.from_records(self.record["certainty"], index="probability")
        return table.astype({"n_observers": "Int64"})

    @property
    def verified(self) -> dict[str, Any] | None:
        """What flights of the design with other seeds say of the promised probability; None where none were flown."""
        return self.record.get("verified")

    @property
    def compared(self) -> pd.DataFrame:
        """The proven minimum under demands and freedoms beyond the paper.

        Raises:
            OutputError: They were not asked for; design with `compare=True`.
        """
        if not self._compared:
            raise OutputError("nothing was compared; design with compare=True")
        rows = [(row.change, row.n_observers, row.note) for row in self._compared]
        table = pd.DataFrame(rows, columns=["change", "observers", "points_or_why_not"])
        return table.astype({"observers": "Int64"}).set_index("change")

    @property
    def plot(self) -> Plots:
        """The pictures of the design by name, e.g. `design.plot.history()`; each returns its Matplotlib axes."""
        from swarm_mj.figures.design_figures import composers

        study = self._studied("plot")
        return Plots({name: partial(compose, study) for name, compose in composers(study).items()})

    def to_scenario(self) -> Scenario:
        """The scenario with the selected points, ready for `swarm_mj.fly`; it names the design's record where that is saved."""
        overrides = design_overrides({"observers": [], **self.record})
        classes, asked = self._scenario.observation.classes, self._scenario.designed_class
        if asked is not None and asked not in classes:
            overrides["observation.classes"] = [each.model_dump() for each in (*classes, asked)]
        if self.folder is not None:
            overrides["design.reference"] = (self.folder / "design.json").resolve()
        return self.scenario.changed(overrides)

    def save(self, folder: str | Path, *, figures: bool = True, pdf: bool = False, progress: Shown = None) -> Path:
        """Write the design into a folder that appears only when all is done.

        Args:
            folder: Where; an earlier design of the same scenario is replaced, anything else is refused.
            figures: Whether to write the pictures as PNG, and with `pdf` as PDF too.
            pdf: See `figures`.
            progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

        Raises:
            OutputError: The folder cannot be written or holds something else.
        """
        self._studied("save")
        with using_bars(progress) as bars:
            say = Stages(self._scenario.name, bars).say
            with atomic_folder(Path(folder), Result("design", self._scenario.name), say) as partial_folder:
                self.write(partial_folder, figures=figures, pdf=pdf)
        self.folder = Path(folder)
        return self.folder

    def write(self, folder: Path, *, figures: bool = True, pdf: bool = False) -> None:
        """Write the files into a folder that is there, whatever it holds; see `save`."""
        study = self._studied("save")
        write_design(folder, study)
        if self._compared:
            write_growth(folder, self._compared)
        if figures:
            from swarm_mj.figures.design_figures import draw_all

            draw_all(folder, study, pdf=pdf)

    def _studied(self, what: str) -> Study:
        if self.study is None:
            raise OutputError(f"{self.folder}: a design that is read back has no {what}; its files are in that folder")
        return self.study

    def __repr__(self) -> str:
        """One line: how many observers, and what is proven."""
        proof = "proven minimal" if self.proven else f"at least {self.bound:g} are needed"
        return f"Design({self._scenario.name!r}, {self.n_observers} observers at points {self.points}, {proof})"

    def _repr_html_(self) -> str:
        """For notebooks: the answers and who covers what."""
        rows = [
            ("observers", str(self.n_observers)),
            ("visiting points", ", ".join(map(str, self.points))),
            ("proof", "minimal" if self.proven else f"at least {self.bound:g} are needed"),
            ("covered", percent_text(self.covered_percent)),
        ]
        table = rows_html(f"Design for {self._scenario.name}", self._scenario.description, rows)
        if self.study is None:
            picture = (self.folder or Path()) / "cover.png"
            return table + (png_html(bytes_of(picture)) if picture.is_file() else "")
        from swarm_mj.figures.design_figures import composers

        return table + figure_html(partial(composers(self.study)["cover"], self.study))


def design(
    scenario: ScenarioSource,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    out: str | Path | None = None,
    pareto: bool = False,
    compare: bool = False,
    verify: int | None = None,
    quality_class: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    figures: bool = True,
    pdf: bool = False,
    progress: Shown = None,
) -> Design:
    """Find the fewest observers that see the whole target, by genetic algorithm and with proof.

    Args:
        scenario: The problem, as `load` takes it; its sections `designer` and `observation` say how it is read.
        overrides: Values by dotted key that change it.
        out: Folder for the results, which appears when the design is finished and is exchanged for one with the comparison and
            the pictures when these are done; None: nothing is written, see `Design.save`.
        pareto: Whether to trade spacecraft against delta-v and area too (NSGA-II).
        compare: Whether to find the minimum under demands and freedoms beyond the paper too.
        verify: So many flights of the design with other seeds show whether its probability is promised rightly; None: none.
            They stand beside the folder, in one of its name with "-verification", and go on there where they were interrupted.
        quality_class: At which class a face must be mapped to count, see `designer.quality_class`; None: as the scenario says.
        workers: Processes for the candidates' pictures; None: one per core.
        scheduler: Address of a Dask cluster's scheduler whose workers fly and judge the candidates instead, e.g.
            tcp://host:8786; evolution and proof run here.
        figures: Whether to write the pictures into the folder as PNG, and with `pdf` as PDF too.
        pdf: See `figures`.
        progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Raises:
        MissionError: No design covers the target; the message says how much can be seen.
        KeyboardInterrupt: It was interrupted; the best design so far, if there is one, is told of and stands in a new folder,
            and a finished one stands in its folder.
        SwarmError: The scenario cannot be flown or the folder cannot be written.
    """
    asked = {} if quality_class is None else {"designer.quality_class": quality_class}
    scenario = load(scenario, {**overrides, **asked})
    check_plugins(scenario)
    check_workers(workers)
    if verify is not None and (out is None or scenario.designer.probability is None):
        raise OutputError(f"verify = {verify}: needs designer.probability, and a folder for the flights (out)")
    place, result = None if out is None else Path(out), Result("design", scenario.name)
    with using_bars(progress) as bars, _runner(workers, scheduler) as runner:
        stages = Stages(scenario.name, bars)
        with ExitStack() as stack:
            # Left last: an interruption that is kept back from now on comes when the best design so far is in its place.
            keep = stack.enter_context(ExitStack())
            folder = None if place is None else stack.enter_context(atomic_folder(place, result, stages.say))
            study = study_design(scenario, pareto=pareto, workers=runner, tell=_teller(scenario, bars))
            if study.visibility.resumed:
                stages.say(study.visibility.resumed)
            if study.interrupted:
                keep.enter_context(held())
                _check_nothing_lost(study, place, stages)
            elif words := left_out_words(study.visibility):
                stages.say(words)
            found = Design(scenario, design_record(study), study=study)
            if folder is not None:
                found.write(folder, figures=False)
        if study.interrupted:
            raise KeyboardInterrupt
        found.folder = place
        # The proven design is in its place: whatever ends the rest, however roughly, leaves it there.
        with _told_where_it_is(found, stages):
            rows = _compared(scenario, bars, runner) if compare else []
            if compare:
                found = Design(scenario, found.record, study=study, compared=rows, folder=place)
            if verify is not None:
                study = replace(study, verified=_verified(found, verify, bars, workers))
                found = Design(scenario, design_record(study), study=study, compared=rows, folder=place)
            if place is not None and (compare or figures or verify):
                with atomic_folder(place, result) as folder:
                    found.write(folder, figures=figures, pdf=pdf)
    return found


@contextmanager
def _runner(workers: int | None, scheduler: str | None) -> Iterator[int | Runner | None]:
    """Who flies and judges candidates: so many processes, or a cluster."""
    if scheduler is None:
        yield workers
        return
    kept = "what is flown and judged is kept: give the same command again"
    with closing(Cluster(scheduler, library_versions, kept)) as cluster:
        yield cluster.run_jobs


@contextmanager
def _told_where_it_is(found: Design, stages: Stages) -> Iterator[None]:
    """Tell what is there already where an interruption ends what follows the design."""
    try:
        yield
    except KeyboardInterrupt:
        points = ", ".join(map(str, found.points))
        where = "" if found.folder is None else f", in {found.folder}, without what was to follow"
        stages.say(
            f"interrupted after the design was finished: {found.n_observers} observers at points {points}{where}"
        )
        raise


def _check_nothing_lost(study: Study, folder: Path | None, stages: Stages) -> None:
    """Tell of the best design of an interrupted study, and where it is; without a place for it, end by the interruption."""
    points, proven = ", ".join(map(str, study.selected)), "" if study.exact.status == "optimal" else ", not proven"
    words = (
        f"interrupted ({study.interrupted}); best design so far{proven}: {len(study.selected)} observers at {points}"
    )
    if study.certainty and study.certainty[0].points is None:
        words += f", which allows for no losses: none for probability {study.certainty[0].asked:g} was found yet"
    if study.visibility.unjudged:
        words += f"; {study.visibility.unjudged} of {len(study.visibility.candidates)} candidates were not judged yet"
    if folder is not None and (folder / MARKER).exists():
        stages.say(f"{words}; not written: the earlier design in {folder} stays")
        raise KeyboardInterrupt
    stages.say(words if folder is None else f"{words}; in {folder}")
    if folder is None:
        raise KeyboardInterrupt


def _teller(scenario: schema.Scenario, bars: Progress | None) -> Tell | None:
    """A bar for each stage that is told of."""
    if bars is None:
        return None
    tasks: dict[str, TaskID] = {}

    def tell(stage: str, share: float) -> None:
        if stage not in tasks:
            for task in tasks.values():
                bars.update(task, completed=1.0)
            tasks[stage] = bars.add_task(f"{scenario.name}: {stage}", total=1.0)
        bars.update(tasks[stage], completed=share)

    return tell


def _verified(found: Design, runs: int, bars: Progress | None, workers: int | None) -> Verified:
    """Fly a design so often, with the losses and dispersions of its scenario, or go on with it."""
    from swarm_mj.campaigns.promise import fly_promise

    assert found.folder is not None
    flown = load_scenario(found.scenario, design_overrides({"observers": [], **found.record}))
    folder = found.folder.with_name(f"{found.folder.name}-verification")
    return fly_promise(flown, folder, runs, found.record["certainty"][0]["promised"], workers=workers, bars=bars)


def _compared(scenario: schema.Scenario, bars: Progress | None, workers: int | Runner | None) -> list[Growth]:
    bars, total = bars or Progress(disable=True), len(extensions(scenario))
    task = bars.add_task("beyond the paper", total=total)
    started: list[str] = []

    def stage(name: str) -> None:
        bars.update(task, completed=len(started), description=f"beyond the paper: {name}")
        started.append(name)

    rows = growth(scenario, workers=workers, stage=stage)
    bars.update(task, completed=total, description="beyond the paper")
    return rows


class Sweeps(NamedTuple):
    """The fewest spacecraft whose planned sweeps show the target.

    Attributes:
        points: The visiting points they fly to, by their numbers from 1.
        bound: No design of these paths, aims and slots has fewer.
        covered_percent: Share of the target's area that their plans show [%].
        scenario: With these points and the behaviour `planned_sweep`, ready for `swarm_mj.fly`.
    """

    points: tuple[int, ...]
    bound: int
    covered_percent: float
    scenario: Scenario

    @property
    def proven(self) -> bool:
        """Whether no design is smaller."""
        return self.bound == len(self.points)


def design_sweeps(scenario: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES) -> Sweeps:
    """Design the fewest spacecraft for narrow cameras: each flies one path and one sweep of pictures, by column generation.

    Plans are those of `behavior.name: planned_sweep`; `designer.tolerance_percent` may be missed, `designer.time_limit_s` ends
    the search with the design and the bound so far. What a flight sees differs as pictures miss or show more than was planned.

    Args:
        scenario: What to design for, as `load` takes it.
        overrides: Values by dotted key that change it.

    Raises:
        SwarmError: The scenario cannot be flown, asks for what is designed without sweeps alone, or no design shows enough.
    """
    scenario = load(scenario, overrides)
    points, found = sweeps_for(scenario)
    flown: dict[str, Any] = {"behavior.name": "planned_sweep", "design.visiting_points": list(points)}
    if scenario.behavior.name != "planned_sweep":
        flown["behavior.parameters"] = {}
    return Sweeps(points, found.bound, found.covered_percent, scenario.changed({**flown, "design.reference": None}))
