"""Checks of the installed program as tables: its physics against independent references, and its speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd
from rich.progress import Progress

from swarm_mj.io.progress import using_bars


def validate(only: Sequence[str] = (), *, progress: bool | Progress = False) -> pd.DataFrame:
    """Run the physics checks on the installed program.

    Args:
        only: Names of checks or groups; empty: all.
        progress: Whether to show a progress bar, or the bars to use.

    Returns:
        One row a check: what was measured, against which reference, the tolerance, and whether it passed (None: not run).

    Raises:
        SwarmError: A name is unknown.
    """
    from swarm_mj.verification.physics.registry import choose
    from swarm_mj.verification.physics.runner import run_experiments

    with using_bars(progress) as bars:
        checks = run_experiments(choose(only), bars)
    return pd.DataFrame([asdict(check) for check in checks]).set_index("name")


def bench(only: Sequence[str] = (), *, full: bool = False) -> pd.DataFrame:
    """Measure how fast the installed program is, as ratios side by side; prints nothing.

    Args:
        only: start, loop, observers, designer, environment, pictures or job; empty: all.
        full: More rounds and large cases.

    Returns:
        One row a measurement: median, quartiles, unit, target and whether it is met.

    Raises:
        OutputError: A name is unknown.
    """
    from swarm_mj.verification.performance.runner import measured

    return pd.DataFrame([row.as_json() for row in measured(only, quick=not full)])
