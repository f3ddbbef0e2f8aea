"""Write docs/results/scenarios.md, packaged scenarios by two readings: python -m scripts.pages.scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import swarm_mj as sm
from scripts.pages import RESULTS
from swarm_mj.io.atomic import write_text
from swarm_mj.observation.coverage import percent_digits
from swarm_mj.records.observed import causes_text

PAGE = RESULTS / "scenarios.md"
#: The looser reading, that of a picture rather than of a map that a mission can use.
LOOSE: Mapping[str, Any] = {
    "observation.light": "ignored",
    "observation.max_emission_deg": 90,
    "observation.min_pixels": 0,
    "data.pictures": "first",
    "data.product": "cells",
    "spacecraft.sensors": "ideal",
}
#: `eros-quick` with its target in the night.
NIGHT: Mapping[str, Any] = {"epoch": "2018-01-01T05:53:00"}
#: Flights besides the packaged ones: words, scenario and changes.
OTHERS: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
    ("`eros-config1` with the sensors of a CubeSat", "eros-config1", {"spacecraft.sensors": "cubesat"}),
    ("`eros-config2` with the sensors of a CubeSat", "eros-config2", {"spacecraft.sensors": "cubesat"}),
    ("`eros-quick` half a rotation later", "eros-quick", NIGHT),
)

HEAD = (
    "scenario", "reading", "sensors", "observed [%]", "delivered [%]", "GSD observed [m]", "GSD delivered [m]",
    "incidence [deg]", "not observed", "pointing error at arrival [deg]",
)  # fmt: skip
TEXT = """# Packaged scenarios

What the packaged scenarios observe and deliver, written by `python -m scripts.pages.scenarios`, which flies each twice: as it
is, and by a looser reading, in which dark ground counts, ground however oblique or small, the first picture of a face is kept,
the pixels of its cells alone are sent, and sensors are perfect (`{loose}`). GSD and incidence are least, median and most over
the cells that are observed or delivered; shares are of the target's area.

{rows}

A night target delivers nothing and says so: `eros-quick` half a rotation later is dark, and `swarm-mj design eros-quick --set
epoch={night}` is refused with these words:

> {refusal}
"""


def main() -> None:
    """Fly all and write the page."""
    found, rows = sm.available(), [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for name in found.index[found["kind"] == "scenario"]:
        rows += [row(f"`{name}`", name, {}), row("", name, LOOSE)]
        print(*rows[-2:], sep="\n", flush=True)
    for words, name, changes in OTHERS:
        rows.append(row(words, name, changes))
        print(rows[-1], flush=True)
    loose = ", ".join(f"{key}={value}" for key, value in LOOSE.items())
    write_text(PAGE, TEXT.format(rows="\n".join(rows), loose=loose, refusal=refusal(), night=NIGHT["epoch"]))
    print(f"wrote {PAGE}")


def row(words: str, name: str, changes: Mapping[str, Any]) -> str:
    """A line of the table."""
    summary = sm.fly(name, changes).summary
    pointing = max(summary["pointing_error_deg_arrival"].values(), default=None)
    cells = (
        words,
        "looser" if changes is LOOSE else "as it is",
        summary["sensors"],
        percent_digits(summary["coverage_percent"]),
        percent_digits(summary["delivered_percent"]),
        *(spread(summary.get(key)) for key in ("gsd_m", "gsd_delivered_m", "incidence_deg")),
        causes_text(summary) or "-",
        "-" if pointing is None else f"{pointing:.2g}",
    )
    return f"| {' | '.join(cells)} |"


def spread(values: Mapping[str, float] | None) -> str:
    """Least, median and most."""
    return ", ".join(f"{values[key]:.3g}" for key in ("min", "median", "max")) if values else "-"


def refusal() -> str:
    """Why a dark target has no design."""
    try:
        sm.design("eros-quick", NIGHT)
    except sm.SwarmError as error:
        return str(error)
    raise SystemExit("eros-quick at NIGHT is refused no longer: mend the page")


if __name__ == "__main__":
    main()
