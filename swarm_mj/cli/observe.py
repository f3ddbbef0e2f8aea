"""The command `observe`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.cli.common import add_command, add_overrides, add_quiet, bars_for, overrides_of, tell


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
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


def _observe(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.observe import observe
    from swarm_mj.observation.coverage import percent_text
    from swarm_mj.records.observed import criterion_text, observed_findings

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
        f"observed area P_TO: {percent_text(summary['coverage_percent'])} in the {criterion_text(summary)}, "
        f"{percent_text(summary['coverage_percent_passage'])} in the whole passage, {summary['images']} pictures",
        *(f"{name}: {percent_text(share)}" for name, share in summary["coverage_percent_by_spacecraft"].items()),
        *observed_findings(summary),
        *seen.notes,
    ]
    if arguments.out is not None:
        lines.append(f"files in {seen.save(arguments.out)}")
    tell(bars.console, *lines)
    return 0
