"""The command `navigate`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.cli.common import add_command, add_overrides, add_quiet, bars_for, overrides_of, show_table, tell

if TYPE_CHECKING:
    from rich.table import Table

    from swarm_mj.api.navigate import Navigation


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    navigate = add_command(
        commands,
        "navigate",
        _navigate,
        "tell how far from its visiting point each spacecraft will be, and what corrections burn",
        "Linear covariance from release to visit: errors of the mothership, the deployer, navigation and burns "
        "(dispersions, navigation) carried through trajectory.corrections. See docs/how-to/corrections.md.",
    )
    navigate.add_argument("scenario", metavar="NAME_OR_FILE", help="packaged name or YAML file")
    add_overrides(navigate, "dispersions.deployment_velocity_m_s=0.1")
    navigate.add_argument(
        "--runs",
        type=int,
        default=0,
        metavar="N",
        help="check with N flights under all forces, e.g. 1000 (default: none)",
    )
    navigate.add_argument("--out", type=Path, metavar="FILE", help="write all numbers there as JSON")
    add_quiet(navigate)


def _navigate(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.navigate import navigate

    with bars_for(arguments) as bars:
        found = navigate(arguments.scenario, overrides_of(arguments), runs=arguments.runs, progress=bars)
    show_table(bars.console, _table(found))
    lines = [f"{found.scenario.name}: {words}" for words in found.findings]
    if arguments.out is not None:
        lines.append(f"numbers in {found.save(arguments.out)}")
    tell(bars.console, *lines)
    return 0


def _table(found: Navigation) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    # A unit in brackets would be taken for a style.
    # Broken by hand, so that it fits into 80 columns with no number cut or broken.
    title = f"{found.scenario.name}: at the arrival, after so many burns"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("", no_wrap=True)
    for name in ("burns", "at\n[s]", "3 sigma\n[m]", "99 %\n[m]", "sigma\nR T S\n[m]"):
        table.add_column(escape(name), justify="right", no_wrap=True)
    for name in ("delta-v\nmean,\n99 %\n[m/s]", "offset\n99 %\n[deg]", "in\ncamera\n[%]"):
        table.add_column(escape(name), justify="right", no_wrap=True)
    for (name, k), row in found.table.astype(object).iterrows():
        sigma = "\n".join(f"{row[f'sigma_{axis}_m']:.3g}" for axis in "RTS")
        burn = f"{row['delta_v_mean_m_s']:.3g}\n{row['delta_v_99_m_s']:.3g}" if k else ""
        seen = [_shown(row[key], digits) for key, digits in (("offset_99_deg", ".3g"), ("in_camera_percent", ".1f"))]
        at = f"{row['time_s']:g}" if k else ""
        table.add_row(
            name, str(k), at, f"{row['position_3_sigma_m']:.4g}", f"{row['position_99_m']:.4g}", sigma, burn, *seen
        )
    return table


def _shown(value: float | None, digits: str) -> str:
    return "" if value is None or value != value else format(value, digits)
