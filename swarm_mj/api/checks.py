"""Checks of the installed program as a table: its physics against independent references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import pandas as pd

from swarm_mj.io.progress import Shown, using_bars


def validate(only: Sequence[str] = (), *, progress: Shown = None) -> pd.DataFrame:
    """Run the physics checks on the installed program.

    Args:
        only: Names of checks or groups; empty: all.
        progress: Whether to show a progress bar, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Returns:
        One row a check: what was measured, against which reference, the tolerance, and whether it passed (None: not run).

    Raises:
        SwarmError: A name is unknown.
    """
    from swarm_mj.verification.runner import choose, run_experiments

    with using_bars(progress) as bars:
        checks = run_experiments(choose(only), bars)
    return pd.DataFrame([asdict(check) for check in checks]).set_index("name")
