"""Compare two result folders bit for bit: python -m scripts.compare OLD NEW.

Of runs telemetry, coverage and summary, of designs sightings, record and summary. Times and versions may differ; what only the
new one has is named and allowed. Exit status 1 if anything differs.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.io.records import read_record
from swarm_mj.records.run_files import read_coverage
from swarm_mj.simulator.telemetry import read_telemetry

#: Keys whose values depend on the machine and the day.
VARYING = {"wall_s", "seconds", "versions"}


def main() -> int:
    """Compare the folders of the command line; returns the exit status."""
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    old, new = map(Path, sys.argv[1:])
    found = list(differences(old, new))
    print("\n".join(found) if found else f"{new}: bit for bit as {old}")
    return int(bool(found))


def differences(old: Path, new: Path) -> Iterator[str]:
    """What differs, one sentence each."""
    if (old / "telemetry.nc").exists():
        variables = [
            {str(k): v.values for k, v in read_telemetry(f / "telemetry.nc").variables.items()} for f in (old, new)
        ]
        yield from _arrays("telemetry.nc", *variables)
    for name, read in (("coverage.npz", read_coverage), ("sightings.npz", np.load)):
        if (old / name).exists():
            yield from _arrays(name, read(old / name), read(new / name))
    for name in ("summary.json", "design.json"):
        if (old / name).exists():
            yield from _values(name, *(read_record(f / name, dict, "write it anew") for f in (old, new)))


def _arrays(name: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    for key, values in old.items():
        if key not in new:
            yield f"{name}: {key} is missing"
        elif not np.array_equal(values, new[key], equal_nan=values.dtype.kind == "f"):
            yield f"{name}: {key} differs"


def _values(path: str, old: Any, new: Any) -> Iterator[str]:
    if not isinstance(old, dict) or not isinstance(new, dict):
        if old != new:
            yield f"{path}: {old!r} is now {new!r}"
        return
    for key in old.keys() - VARYING:
        if key not in new:
            yield f"{path}.{key} is missing"
        else:
            yield from _values(f"{path}.{key}", old[key], new[key])


if __name__ == "__main__":
    sys.exit(main())
