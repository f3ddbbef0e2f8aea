"""The report's section on propulsion, of runs whose spacecraft have thrusters."""

from __future__ import annotations

from collections.abc import Sequence

from swarm_mj.results.report.markup import Html, table
from swarm_mj.results.report.sections import section, short
from swarm_mj.results.run_record import RunRecord

HEAD = ("spacecraft", "planned burns [m/s]", "Δv by thrust [m/s]", "propellant used [g]", "propellant left [g]")


def propulsion_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html | None:
    """What thrusters gave and tanks have left; None where no run has thrusters."""
    tables = [_table(run, label) for run, label in zip(runs, labels, strict=True) if has_thrusters(run)]
    return section("propulsion", "Propulsion", tables) if tables else None


def has_thrusters(run: RunRecord) -> bool:
    """Whether a run's spacecraft have thrusters."""
    return bool(run.summary.get("propellant_used_kg"))


def _table(run: RunRecord, label: str) -> Html:
    columns = [
        (run.summary.get(key, {}), factor)
        for key, factor in (
            ("planned_burns_m_s", 1.0),
            ("thrust_delta_v_m_s", 1.0),
            ("propellant_used_kg", 1e3),
            ("propellant_left_kg", 1e3),
        )
    ]
    rows = [
        (name, *(short(factor * values[name]) if name in values else "–" for values, factor in columns))
        for name in run.names
    ]
    return table(HEAD, rows, caption=f"Thrusters and tanks of {label}", class_="numeric crew")
