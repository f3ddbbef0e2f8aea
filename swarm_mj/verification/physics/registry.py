"""All checks in the order of the table."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

from swarm_mj.errors import SwarmError
from swarm_mj.verification.physics import (
    attitude,
    control,
    coverage,
    ephemerides,
    gravity,
    links,
    orbits,
    target,
    trajectories,
)
from swarm_mj.verification.physics.experiment import Experiment

EXPERIMENTS: tuple[Experiment, ...] = (
    *gravity.EXPERIMENTS,
    *orbits.EXPERIMENTS,
    *trajectories.EXPERIMENTS,
    *attitude.EXPERIMENTS,
    *control.EXPERIMENTS,
    *ephemerides.EXPERIMENTS,
    *target.EXPERIMENTS,
    *coverage.EXPERIMENTS,
    *links.EXPERIMENTS,
)


def choose(only: Sequence[str]) -> list[Experiment]:
    """Checks by name or by group (the first word of a name), in the order of the table; all if none is named.

    Raises:
        SwarmError: A name is unknown; the message lists all.
    """
    known = {name for experiment in EXPERIMENTS for name in (experiment.name, experiment.group)}
    for name in only:
        if name not in known:
            close = get_close_matches(name, known, 1)
            guess = f"; did you mean {close[0]}?" if close else ""
            groups = ", ".join(dict.fromkeys(experiment.group for experiment in EXPERIMENTS))
            names = ", ".join(experiment.name for experiment in EXPERIMENTS)
            raise SwarmError(f"--only {name}: no such check{guess} Groups: {groups}. Checks: {names}")
    return [e for e in EXPERIMENTS if not only or e.name in only or e.group in only]
