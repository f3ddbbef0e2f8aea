"""The commands `observe` and `navigate`: what a flight from files saw, and how far a planned one will stray."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.cli.common import add_command, add_overrides, add_quiet, bars_for, overrides_of, show_table, tell

if TYPE_CHECKING:
    from rich.table import Table

    from swarm_mj.api.navigate import Navigation


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    observe = add_command(
        commands,
        "observe",
        _observe,
        "judge what a flight saw that was flown elsewhere, by its OEM and AEM or SPK and CK",
        "Occlusion-true coverage of a flight that was flown elsewhere, by CCSDS ephemeris messages (KVN) or SPICE kernels.",
    )
    observe.add_argument(
        "--oem", action="append", default=[], type=Path, metavar="FILE", help="path of a spacecraft; may be repeated"
    )
    observe.add_argument(
        "--aem",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="its attitude; as many as OEM, in their order",
    )
    observe.add_argument(
        "--kernels",
        nargs="+",
        default=[],
        type=Path,
        metavar="FILE",
        help="SPICE kernels instead: SPK, CK, and the text kernels that they need, or a meta-kernel",
    )
    observe.add_argument(
        "--spacecraft",
        nargs="+",
        default=[],
        metavar="NAME",
        help="SPICE's names or numbers of the observers, or NAME/FRAME with the camera's frame (default: all of the SPKs)",
    )
    where = observe.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--body",
        metavar="NAME",
        help="eros, bennu, itokawa or lutetia, a YAML file with the keys of body, or a shape file",
    )
    where.add_argument(
        "--scenario", metavar="NAME_OR_FILE", help="scenario with body, target, camera, criterion, epoch and duration"
    )
    observe.add_argument("--camera", type=float, metavar="DEG", help="half-angle of the camera, camera.half_angle_deg")
    observe.add_argument(
        "--pointing",
        choices=("nadir", "target"),
        default="nadir",
        help="without an AEM: at the body's centre (default) or at the target's",
    )
    add_overrides(observe, "target.longitude_deg=30")
    observe.add_argument("--out", type=Path, metavar="DIR", help="write observation.json and coverage.npz there")
    add_quiet(observe)
    navigate = add_command(
        commands,
        "navigate",
        _navigate,
        "tell how far from its visiting point each spacecraft will be, and what corrections burn",
        "Linear covariance from release to arrival: errors of the mothership, the deployer, navigation and burns "
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
    navigate.add_argument(
        "--optical",
        action="store_true",
        help="what is known at corrections comes by pictures of the body, made and measured along the planned paths",
    )
    navigate.add_argument("--out", type=Path, metavar="FILE", help="write all numbers there as JSON")
    add_quiet(navigate)


def _observe(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.observe import observe
    from swarm_mj.observation.coverage import percent_text
    from swarm_mj.records.observed import observed_findings, when_text

    camera = {} if arguments.camera is None else {"camera.half_angle_deg": arguments.camera}
    with bars_for(arguments) as bars:
        seen = observe(
            arguments.oem,
            arguments.aem,
            kernels=arguments.kernels,
            spacecraft=arguments.spacecraft,
            scenario=arguments.scenario,
            body=arguments.body,
            overrides=overrides_of(arguments) | camera,
            pointing=arguments.pointing,
            progress=bars,
        )
    summary = seen.summary
    lines = [
        f"observed area P_TO: {percent_text(summary['coverage_percent'])} {when_text(summary)}, "
        f"{percent_text(summary['coverage_percent_passage'])} in the whole passage, {summary['images']} pictures",
        *(f"{name}: {percent_text(share)}" for name, share in summary["coverage_percent_by_spacecraft"].items()),
        *observed_findings(summary),
        *seen.notes,
    ]
    if arguments.out is not None:
        lines.append(f"files in {seen.save(arguments.out)}")
    tell(bars.console, *lines)
    return 0


def _navigate(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.navigate import navigate

    with bars_for(arguments) as bars:
        found = navigate(
            arguments.scenario,
            overrides_of(arguments),
            runs=arguments.runs,
            optical=arguments.optical,
            progress=bars,
        )
    if found.covariance_N.any() or not arguments.optical:
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
