"""Plant faults in the code, one at a time, and see whether the tests notice: python -m scripts.mutants [NAME ...].

NAME picks the faults whose list, file or words hold it. Findings are kept in docs/results/mutants.json: an interrupted call
goes on where it was, and only what is new or has changed is run. Every call writes docs/results/mutants.md. Exit status 1
where fewer than 95 % die, one survives without a reason, or one that is called equivalent dies.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue

from rich.console import Console
from rich.table import Table

from scripts.mutants.faults import Fault, read_faults
from scripts.mutants.findings import Finding, finding_of, read_findings, write_findings
from scripts.mutants.page import PAGE, ROOT, by_room, page_of
from scripts.mutants.trees import copy_sources, plant
from scripts.mutants.trial import DIED, SURVIVED, Runner, Trial
from swarm_mj.io import interruption
from swarm_mj.io.atomic import write_text
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.progress import progress_bars

#: Where findings are kept between calls.
KEPT = PAGE.with_suffix(".json")
#: Least share of faults that must die.
ENOUGH = 0.95
#: Where the copy of the sources is kept whose tests have been run, with the machine code of their kernels.
WARM = ROOT / "build" / "mutants"
#: Processor time of the tests of one fault, and of all of them without any fault [s].
LIMIT_S, FIRST_LIMIT_S = 300.0, 3600.0


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m scripts.mutants", description=__doc__.partition(":")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="only faults whose list, file or words hold this")
    parser.add_argument("--jobs", type=int, default=usable_cores(), help="faults at once (default: all cores)")
    parser.add_argument("--afresh", action="store_true", help="run these faults whatever earlier calls found")
    asked = parser.parse_args(arguments)
    console = Console()
    try:
        every = read_faults(ROOT)
    except ValueError as error:
        console.print(str(error), soft_wrap=True, markup=False, highlight=False)
        return 2
    chosen = [
        fault for fault in every if not asked.names or any(name in f"{fault.room}/{fault.name}" for name in asked.names)
    ]
    found, unclear = read_findings(KEPT), dict[str, Trial]()

    def keep(fault: Fault, trial: Trial, tree: Path) -> None:
        finding = finding_of(fault, trial, tree)
        if finding is None:
            unclear[fault.name] = trial
        else:
            found[fault.name] = finding
            write_findings(KEPT, found, every)

    try:
        with interruption.handled():
            _run([f for f in chosen if asked.afresh or not _is_known(f, found)], keep, asked.jobs, console)
    except KeyboardInterrupt:
        console.print("Interrupted; the next call goes on here.")
        return 130
    except RuntimeError as error:
        console.print(str(error), soft_wrap=True, markup=False, highlight=False)
        return 2
    finally:
        write_text(PAGE, page_of(every, found))
    console.print(_table(chosen, found))
    console.print(f"{PAGE.relative_to(ROOT)} written")
    return _verdict(chosen, found, unclear, console)


def _is_known(fault: Fault, found: dict[str, Finding]) -> bool:
    return fault.name in found and found[fault.name].holds(fault, ROOT)


def _run(to_do: list[Fault], keep: Callable[[Fault, Trial, Path], None], jobs: int, console: Console) -> None:
    """Try faults, several at once, and keep what came of each, and of which sources: those in the work may change meanwhile.

    Raises:
        RuntimeError: The tests fail without any fault.
    """
    if not to_do:
        return
    folder, runners = Path(tempfile.mkdtemp(prefix="mutants-")), [Runner() for _ in range(jobs)]
    free, pool = SimpleQueue[Runner](), ThreadPoolExecutor(jobs)
    for runner in runners:
        free.put(runner)
    try:
        warm = folder / "warm"
        with progress_bars(console) as bars:
            bar = bars.add_task("the tests without faults", total=None)
            if WARM.is_dir():
                shutil.copytree(WARM, warm, symlinks=True)
            copy_sources(ROOT, warm)
            _warm_up(pool, runners, warm, to_do)
            _keep(warm)
            bars.update(bar, total=1, completed=1)
            bar = bars.add_task(f"{len(to_do)} faults", total=len(to_do))
            futures = {pool.submit(_try, free, fault, warm, folder): fault for fault in to_do}
            for future in as_completed(futures):
                fault, trial = futures[future], future.result()
                keep(fault, trial, warm)
                bars.advance(bar)
                if trial.outcome != DIED:
                    bars.console.print(f"{trial.outcome}: {fault.name}", soft_wrap=True, markup=False)
    finally:
        for runner in runners:
            runner.end()
        pool.shutdown(cancel_futures=True)
        shutil.rmtree(folder, ignore_errors=True)


def _warm_up(pool: ThreadPoolExecutor, runners: list[Runner], warm: Path, faults: list[Fault]) -> None:
    """Run all tests without faults, which leaves the machine code of all kernels in the tree.

    Raises:
        RuntimeError: One fails.
    """
    tests = sorted({test for fault in faults for test in fault.tests})
    shares = [tuple(tests[k :: len(runners)]) for k in range(len(runners))]
    first = [pool.submit(r.run, warm, share, FIRST_LIMIT_S) for r, share in zip(runners, shares, strict=True) if share]
    for trial in (future.result() for future in first):
        if trial.outcome != SURVIVED:
            raise RuntimeError(f"The tests fail without any fault: {trial.outcome} {trial.test} {trial.words}")


def _keep(warm: Path) -> None:
    """Let the next call begin with this tree, without what the tests have kept on disk, which would hide faults."""
    WARM.parent.mkdir(exist_ok=True)
    made = Path(tempfile.mkdtemp(dir=WARM.parent))
    shutil.copytree(warm, made, symlinks=True, ignore=shutil.ignore_patterns("build"), dirs_exist_ok=True)
    shutil.rmtree(WARM, ignore_errors=True)
    made.rename(WARM)


def _try(free: SimpleQueue[Runner], fault: Fault, warm: Path, folder: Path) -> Trial:
    tree, runner = Path(tempfile.mkdtemp(dir=folder)) / "tree", free.get()
    try:
        plant(fault, warm, tree)
        return runner.run(tree, fault.tests, LIMIT_S)
    finally:
        free.put(runner)
        shutil.rmtree(tree.parent, ignore_errors=True)


def _table(faults: list[Fault], found: dict[str, Finding]) -> Table:
    table = Table("room", "faults", "died", "survived", "equivalent")
    for room, some in by_room(faults).items():
        outcomes = [found[fault.name].outcome if _is_known(fault, found) else "" for fault in some]
        excused = sum(bool(f.equivalent) for f, outcome in zip(some, outcomes, strict=True) if outcome == SURVIVED)
        table.add_row(room, *map(str, (len(some), outcomes.count(DIED), outcomes.count(SURVIVED), excused)))
    return table


def _verdict(faults: list[Fault], found: dict[str, Finding], unclear: dict[str, Trial], console: Console) -> int:
    """Say what is wrong and how many died; returns the exit status."""
    wrong = [f"{name}: {trial.outcome}: {trial.words}" for name, trial in unclear.items()]
    known = {fault: found[fault.name] for fault in faults if _is_known(fault, found)}
    for fault, finding in known.items():
        if finding.outcome == SURVIVED and not fault.equivalent:
            wrong.append(f"{fault.name}: survived {', '.join(fault.tests)}")
        elif finding.outcome != SURVIVED and fault.equivalent:
            wrong.append(f"{fault.name}: is called equivalent, but {finding.test} notices")
    for line in wrong:
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    share = sum(finding.outcome == DIED for finding in known.values()) / max(1, len(faults))
    console.print(f"{100 * share:.1f} % of {len(faults)} faults died; at least {100 * ENOUGH:g} % must")
    return int(bool(wrong) or share < ENOUGH)


if __name__ == "__main__":
    sys.exit(main())
