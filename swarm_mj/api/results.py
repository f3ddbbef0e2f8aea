"""Results read back, and reports of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarm_mj.api.design import Design
from swarm_mj.api.flight import Flight
from swarm_mj.errors import OutputError
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.atomic import result_in
from swarm_mj.records.design_files import read_design_folder
from swarm_mj.records.run_record import observation_of, read_run


def open(folder: str | Path) -> Flight:
    """The flight in a result folder.

    Args:
        folder: Of `Flight.save` or `swarm-mj fly`.

    Raises:
        OutputError: There is no finished flight, or it was written by a version whose target differs.
    """
    folder = Path(folder)
    _require(folder, "run", "design", "open_design")
    record = read_run(folder)
    plan = make_plan(record.scenario)
    result = observation_of(record, plan)
    return Flight(plan, record.telemetry, result, record.summary, design=record.design, folder=folder)


def open_design(folder: str | Path) -> Design:
    """The design in a result folder.

    Args:
        folder: Of `Design.save` or `swarm-mj design`.

    Raises:
        OutputError: There is no finished design.
    """
    folder = Path(folder)
    _require(folder, "design", "run", "open")
    scenario, record, compared = read_design_folder(folder)
    return Design(scenario, record, compared=compared, folder=folder)


def _require(folder: Path, kind: str, other: str, verb: str) -> None:
    found = result_in(folder)
    if found is not None and found.kind == other:
        raise OutputError(f"{folder}: holds a {other}, not a {kind}; read it by swarm_mj.{verb}")


def report(runs: Sequence[Flight | str | Path], path: str | Path | None = None) -> Path:
    """Write the report of a run, or of two side by side: one HTML file that opens in any browser without a network.

    Args:
        runs: One or two flights, or their folders.
        path: Where; None: report.html in the folder of the run, or comparison.html in that of the first of two.

    Raises:
        OutputError: They are more than two, a folder is no finished run, or the file cannot be written.
    """
    from swarm_mj.reports.page import write_report

    records = [each.record if isinstance(each, Flight) else read_run(Path(each)) for each in runs]
    return write_report(records, None if path is None else Path(path))
