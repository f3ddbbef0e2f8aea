"""How often a swarm that flies with other seeds sees enough, against what was promised of it."""

from __future__ import annotations

from pathlib import Path

from rich.progress import Progress

from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.runner import run_campaign
from swarm_mj.campaigns.statistics import probability
from swarm_mj.designer.study import Verified
from swarm_mj.scenarios.schema import Scenario


def fly_promise(
    scenario: Scenario,
    folder: Path,
    runs: int,
    promised: float,
    *,
    quality_class: str | None = None,
    workers: int | None = None,
    bars: Progress | None = None,
) -> Verified:
    """Fly a scenario so often, with its losses and dispersions, or go on with it in its folder.

    Args:
        scenario: What is flown; `designer.tolerance_percent` says how much of the target may be missed.
        folder: For the flights.
        runs: Number of flights.
        promised: Probability with which enough is seen.
        quality_class: At which of `observation.classes` a face counts; None: by the scenario's criterion.
        workers: Processes; None: one per core.
        bars: Where to show how far it is.

    Returns:
        How many flights saw enough, with Wilson's 95 % interval of their share; those that failed did not.
    """
    record = ["coverage_percent"] if quality_class is None else [f"classes.{quality_class}"]
    campaign = {"name": f"{scenario.name}-verification", "runs": runs, "record": record}
    resolved = load_campaign({**campaign, "scenarios": [{"scenario": scenario.model_dump(mode="json")}]})
    results = run_campaign(resolved, folder, workers=workers, resume=folder.exists(), bars=bars, figures=False).results
    if quality_class is None:
        met = sum(map(bool, results["covered"].to_pylist()))
    else:
        least = 100.0 - scenario.designer.tolerance_percent
        met = sum(seen is not None and seen >= least for seen in results[record[0].replace(".", "_")].to_pylist())
    share = probability(met, runs)
    return Verified(runs, results["status"].to_pylist().count("failed"), met, share.low, share.high, promised)
