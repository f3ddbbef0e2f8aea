"""Results read back, and reports of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarm_mj.api.design import Design, read_design
from swarm_mj.api.flight import Flight, read_flight
from swarm_mj.io.atomic import result_in


def open(folder: str | Path) -> Flight | Design:
    """The flight or the design in a result folder, as the object that was saved there.

    Args:
        folder: Of `Flight.save`, `Design.save`, `swarm-mj run` or `swarm-mj design`.

    Raises:
        OutputError: There is no finished result, or it was written by a version whose target differs.
    """
    folder = Path(folder)
    found = result_in(folder)
    if found is not None and found.kind == "design":
        return read_design(folder)
    return read_flight(folder)  # which says what is wrong, if anything is


def report(runs: Sequence[Flight | str | Path], path: str | Path | None = None) -> Path:
    """Write the report of a run, or of two side by side: one HTML file that opens in any browser without a network.

    Args:
        runs: One or two flights, or their folders.
        path: Where; None: report.html in the folder of the run, or comparison.html in that of the first of two.

    Raises:
        OutputError: They are more than two, a folder is no finished run, or the file cannot be written.
    """
    from swarm_mj.results.report.page import write_report
    from swarm_mj.results.run_record import read_run

    records = [each.record if isinstance(each, Flight) else read_run(Path(each)) for each in runs]
    return write_report(records, None if path is None else Path(path))
