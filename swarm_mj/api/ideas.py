"""From a requirement to a swarm, and what was studied before."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pandas as pd

from swarm_mj.api.design import Design
from swarm_mj.api.flight import fly
from swarm_mj.campaigns.promise import fly_promise
from swarm_mj.errors import OutputError
from swarm_mj.ideas.knowledge import Kept, KnowledgeBase, differences, nearest, nearest_kept, rerun, scenario_text
from swarm_mj.ideas.knowledge import study as carry
from swarm_mj.ideas.report import study_html
from swarm_mj.ideas.requirement import Requirement, load_requirement
from swarm_mj.ideas.sensitivity import Index
from swarm_mj.io.atomic import write_text
from swarm_mj.io.cache import hash_of
from swarm_mj.io.machine import check_workers
from swarm_mj.io.progress import using_bars
from swarm_mj.io.records import writing
from swarm_mj.records.design_files import design_record
from swarm_mj.scenarios.keys import default_text, section_of

if TYPE_CHECKING:
    from rich.progress import Progress

    from swarm_mj.designer.study import Verified
    from swarm_mj.ideas.chain import Campaign, Said, Study
    from swarm_mj.io.progress import Shown
    from swarm_mj.scenarios import schema

#: Where studies are kept unless said otherwise.
BASE = Path("results") / "ideas.sqlite"
#: Files in the folders of flights, designs and campaigns to which a report points.
EVIDENCE = ("summary.json", "design.json", "report.html")


@dataclass(frozen=True, eq=False)
class Studied:
    """A requirement and what it came to.

    Attributes:
        kept: The study as the knowledge base has it.
        nearest: That of the nearest requirement that a swarm meets, where `nearest` asks for it; None: none, or not looked for.
    """

    kept: Kept
    nearest: Studied | None = None

    @property
    def record(self) -> dict[str, Any]:
        """All results, as plain data."""
        return self.kept.record

    @property
    def closed(self) -> bool:
        """Whether a swarm was found and flew what was asked."""
        return bool(self.record["closed"])

    @property
    def parts(self) -> pd.DataFrame:
        """The spacecraft's budgets: number, mass [kg], volume [U], power [W] and source of each part, without margins."""
        sized = self.record["spacecraft"]
        return pd.DataFrame([] if sized is None else sized["parts"])

    @property
    def checks(self) -> pd.DataFrame:
        """Requirement by requirement: what was asked, what was reached, by what evidence."""
        return pd.DataFrame(self.record["checks"])

    @property
    def tried(self) -> pd.DataFrame:
        """Kinds of spacecraft and what became of each."""
        return pd.DataFrame(self.record["tried"])

    @property
    def drivers(self) -> pd.DataFrame:
        """What each value of the requirement alone does to the lower bound of the swarm's mass [kg], the strongest first."""
        return pd.DataFrame(self.record["drivers"])

    @property
    def sobol(self) -> pd.DataFrame:
        """Sobol' indices of what drives, with 95 % intervals; empty where `sobol` of the requirement asks for none."""
        return pd.DataFrame(self.record["sobol"], columns=list(Index._fields))

    @property
    def alternatives(self) -> pd.DataFrame:
        """Spacecraft that no other one beats in resolution, masses, power and time."""
        return pd.DataFrame(self.record["alternatives"])

    def report(self, path: str | Path) -> Path:
        """Write the report, one HTML page that fetches nothing.

        Raises:
            OutputError: It cannot be written.
        """
        with writing(path, "choose another place"):
            place = Path(path).parent
            there = {
                c["shown"]: f"{c['shown']}/{name}"
                for c in self.record["checks"]
                for name in EVIDENCE
                if c["shown"] and (place / c["shown"] / name).is_file()
            }
            write_text(Path(path), study_html(self.kept.name, self._told(), self.record, self.sentences, there))
        return Path(path)

    def _told(self) -> dict[str, Any]:
        kept = self.kept
        return {"id": kept.id, "version": kept.version, "requirement": kept.requirement.model_dump(mode="json")}

    @property
    def sentences(self) -> list[str]:
        """What it came to, one sentence each."""
        record, name = self.record, self.kept.name
        if record["spacecraft"] is None:
            words = [f"{name}: cannot be met: {record['forbids']}"]
            if self.nearest is not None:
                words += [f"{name}: the nearest that can: {said}" for said in self.nearest.sentences]
            elif self.kept.requirement.nearest:
                words.append(f"{name}: no swarm was found for coarser resolutions either")
            return words
        sized = record["spacecraft"]
        met = "meet it, as flown" if self.closed else "do not meet it, as flown"
        idle = record["spacecraft_count"] - record["observers"]
        more = f" and {idle} like them that only communicate{'s' if idle == 1 else ''}" if idle else ""
        losses = "" if self.kept.requirement.probability else "losses, dispersions, "
        words = [
            f"{name}: {record['observers']} of {sized['kind']}{more}, {sized['mass_kg']:.3g} kg each, {met}; "
            f"{self._how_light(idle)} among {len(record['tried'])} kinds of spacecraft. Not covered: {losses}launch, cruise, "
            "cost, radiation, and heat but for a bound; component numbers are those of classes"
        ]
        words += [f"{name}: took {record['taken']} from the study {self.kept.took}"] if record["taken"] else []
        words += [
            f"{name}: {c['requirement']}: {c['reached']:.4g} {c['unit']}, asked were {c['asked']:.4g}"
            for c in record["checks"]
            if not c["met"]
        ]
        if self.kept.requirement.sobol and not record["sobol"]:
            words.append(f"{name}: no Sobol' indices: nothing varies within a factor of 1.2 of what is asked")
        if record["sobol_unbuilt"]:
            share = 100.0 * record["sobol_unbuilt"]
            words.append(
                f"{name}: of {share:.3g} % of the sample for Sobol' indices nothing can be built: there are none of its mass"
            )
        return words

    def _how_light(self, idle: int) -> str:
        """Whether a lighter swarm is ruled out: by the proofs of kinds that were designed, the bounds of the others."""
        weight = self.record["swarm_kg"]
        designed = [one for one in self.record["tried"] if one["proven"] is not None]
        beyond = [one["kind"] for one in designed if (one["proven"] + idle) * one["mass_kg"] < weight - 1e-9]
        if beyond:
            return f"the lightest found, lighter ones of {', '.join(beyond)} are not ruled out,"
        return "the lightest swarm"

    def save(self, folder: str | Path) -> Path:
        """Write `study.json`, `report.html` and, where there is a swarm, `scenario.yaml` that flies it, into a folder.

        Raises:
            OutputError: It cannot be written.
        """
        place = _made(Path(folder))
        write_text(place / "study.json", json.dumps({**self._told(), **self.record}, indent=1) + "\n")
        self.report(place / "report.html")
        if self.record["scenario"] is not None:
            write_text(place / "scenario.yaml", scenario_text(self.kept))
        return place


def study(
    requirement: str | Path | dict[str, Any],
    *,
    base: str | Path = BASE,
    out: str | Path | None = None,
    workers: int | None = None,
    progress: Shown = None,
) -> Studied:
    """Carry a requirement through the chain: spacecraft, swarm, flight, campaign; and keep what comes out.

    Args:
        requirement: A YAML file, or its values; see `swarm_mj.ideas.requirement.Requirement`.
        base: File of the knowledge base; what a study that is like this one found saves designs here.
        out: Folder for the report, with the flight, the design and the campaign that show it; None: the results are in the
            knowledge base alone.
        workers: Processes for designs, campaigns and Sobol' indices; None: one per core.
        progress: Whether to say what is done, or the bars to use; None: on a terminal.

    Raises:
        ScenarioError: The requirement or its scenario is not allowed.
        OutputError: The results cannot be kept.
        KeyboardInterrupt: It was interrupted; pictures of candidates and flights of campaigns are kept, and the same command
            goes on with them; dispersed flights of a design for a probability begin anew.
    """
    check_workers(workers)
    asked, place = load_requirement(requirement), KnowledgeBase(base)
    folder = None if out is None else _made(Path(out))
    with using_bars(progress) as bars, _campaigns(folder, workers, bars) as campaign:
        say = _teller(asked.name, bars)
        found, kept = carry(asked, place, campaign=campaign, workers=workers, say=say)
        near = None
        if asked.nearest and not found.closed:
            near = nearest(kept, place, campaign=campaign, workers=workers, say=say)
        studied = Studied(kept, None if near is None else Studied(near[1]))
        if folder is not None:
            _save(studied, found, folder, bars)
            if near is not None and studied.nearest is not None:
                _save(studied.nearest, near[0], folder / "nearest", bars)
    return studied


def _save(studied: Studied, found: Study, folder: Path, bars: Progress | None) -> None:
    """Write the evidence that a report points to, as `swarm-mj fly` and `swarm-mj design` do, and the report."""
    if found.design is not None:
        record = design_record(found.design)
        Design(found.design.scenario, record, study=found.design).save(folder / "design", progress=bars)
    if found.scenario is not None:
        fly(found.scenario, out=folder / "flight", progress=bars)
    studied.save(folder)


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error}") from None
    return folder


@contextmanager
def _campaigns(folder: Path | None, workers: int | None, bars: Progress | None) -> Iterator[Campaign]:
    """Flies campaigns into a folder, or nowhere that lasts."""
    with TemporaryDirectory() if folder is None else nullcontext(folder) as place:

        def campaign(scenario: schema.Scenario, asked: Requirement) -> tuple[Verified, str]:
            assert asked.probability is not None
            # Another swarm's flights stand elsewhere.
            name = f"campaign-{hash_of(scenario.model_dump_json())[:8]}"
            counted = None if asked.quality == "seen" else asked.quality
            found = fly_promise(
                scenario,
                Path(place) / name,
                asked.flights,
                asked.probability,
                quality_class=counted,
                workers=workers,
                bars=bars,
            )
            return found, name

        yield campaign


def _teller(name: str, bars: Progress | None) -> Said | None:
    """Shows what is done beside a bar."""
    if bars is None:
        return None
    task = bars.add_task(name, total=None)
    return lambda words: bars.update(task, description=f"{name}: {words}")


def requirement_keys() -> pd.DataFrame:
    """The keys of a requirement: what each is, with its unit, and its default."""
    rows = []
    for name, field in Requirement.model_fields.items():
        section = section_of(field.annotation)
        inside = (
            {name: field} if section is None else {f"{name}.{key}": each for key, each in section.model_fields.items()}
        )
        rows += [
            {
                "key": key,
                "default": default_text(each),
                "what": each.description,
            }
            for key, each in inside.items()
        ]
    return pd.DataFrame(rows)


def studies(base: str | Path = BASE) -> pd.DataFrame:
    """The studies of a knowledge base, the oldest first; `closed`: whether a swarm met the requirement."""
    rows = [
        {
            "id": one.id,
            "name": one.name,
            "made": one.made,
            "version": one.version,
            "scenario": one.requirement.scenario,
            "resolution_m": one.requirement.resolution_m,
            "quality": one.requirement.quality,
            "share_percent": one.requirement.share_percent,
            "closed": one.record["closed"],
            "observers": one.record["observers"],
            "swarm_kg": one.record["swarm_kg"],
            "began_with": one.took,
            "wall_s": one.wall_s,
        }
        for one in KnowledgeBase(base, make=False).kept()
    ]
    asked = ["scenario", "resolution_m", "quality", "share_percent"]
    found = ["closed", "observers", "swarm_kg", "began_with", "wall_s"]
    return pd.DataFrame(rows, columns=["id", "name", "made", "version", *asked, *found])


def open_study(name: str, base: str | Path = BASE) -> Studied:
    """A study by its id, the beginning of it, or its name.

    Raises:
        OutputError: There is none.
    """
    place = KnowledgeBase(base, make=False)
    kept = place.find(name)
    near = nearest_kept(kept, place)
    return Studied(kept, None if near is None else Studied(near))


def compare_studies(one: str, other: str, base: str | Path = BASE) -> pd.DataFrame:
    """Where two studies differ, in what was asked and what came out.

    Raises:
        OutputError: There is none of such a name.
    """
    place = KnowledgeBase(base, make=False)
    first, second = place.find(one), place.find(other)
    return pd.DataFrame(differences(_whole(first), _whole(second)), columns=["key", first.id, second.id])


def _whole(kept: Kept) -> dict[str, Any]:
    """What was asked and what came out."""
    return {"requirement": kept.requirement.model_dump(mode="json"), **kept.record}


def rerun_study(
    name: str, base: str | Path = BASE, *, workers: int | None = None, progress: Shown = None
) -> pd.DataFrame:
    """Run a kept study anew, with what it took from another one; where the results differ from those that are kept.

    Raises:
        OutputError: There is none of such a name.
    """
    check_workers(workers)
    with using_bars(progress) as bars, _campaigns(None, workers, bars) as campaign:
        say = _teller(name, bars)
        kept, found = rerun(KnowledgeBase(base, make=False), name, campaign=campaign, workers=workers, say=say)
    return pd.DataFrame(found, columns=["key", f"kept ({kept.version})", "now"])
