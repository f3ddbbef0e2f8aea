"""The command `run`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from swarm_mj.cli.common import DEFAULT_OUT, DEFAULT_SCENARIOS, add_common, overrides_of


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    run = commands.add_parser(
        "run",
        help="fly one or more scenarios and write their results",
        description="Fly scenarios: trajectories, attitude, observed area, telemetry and figures, one folder each.",
    )
    run.add_argument(
        "scenario",
        nargs="*",
        default=list(DEFAULT_SCENARIOS),
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {' '.join(DEFAULT_SCENARIOS)})",
    )
    run.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"result folder (default: {DEFAULT_OUT}/NAME; of several scenarios: the folder that holds theirs)",
    )
    run.add_argument(
        "--design", metavar="DESIGN", help="fly this design: a design.json of `swarm-mj design`, or a packaged name"
    )
    run.add_argument(
        "--policy",
        metavar="NAME_OR_FILE",
        help="who points at what: a policy file of examples/train_sb3.py, trained (the packaged one), body_centre, "
        "target_centre, sweep, greedy or greedy_ahead",
    )
    add_common(run, seed_of="the random initial attitudes")
    run.add_argument("--no-report", action="store_true", help="write no report.html")
    run.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    from swarm_mj.cli.runner import run_many
    from swarm_mj.scenarios.loading import load_scenario, read_design

    overrides = overrides_of(arguments)
    if arguments.design is not None:
        points = read_design(arguments.design)
        overrides += [f"design.reference={json.dumps(arguments.design)}", f"design.visiting_points={points}"]
    scenarios = [load_scenario(name, overrides) for name in arguments.scenario]
    if arguments.policy is not None:
        overrides_for = import_module("swarm_mj.envs.policy_behavior").policy_overrides
        scenarios = [
            load_scenario(name, overrides + overrides_for(arguments.policy, scenario))
            for name, scenario in zip(arguments.scenario, scenarios, strict=True)
        ]
    single = arguments.out is not None and len(scenarios) == 1
    parent = arguments.out or DEFAULT_OUT
    folders = [parent if single else parent / scenario.name for scenario in scenarios]
    run_many(
        scenarios,
        folders,
        figures=not arguments.no_figures,
        pdf=arguments.pdf,
        report=not arguments.no_report,
        quiet=arguments.quiet,
    )
    _print_findings(folders)
    return 0


def _print_findings(folders: Sequence[Path]) -> None:
    """Say what the summary alone does not tell, as the report does."""
    from swarm_mj.results.report.sections import run_findings
    from swarm_mj.results.run_record import read_run

    for folder in folders:
        run = read_run(folder)
        for remark in run_findings(run):
            print(f"{run.summary['scenario']}: {remark}")
