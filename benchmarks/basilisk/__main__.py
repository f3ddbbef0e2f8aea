"""The same swarm in swarm_mj, in Basilisk and by SciPy: python -m benchmarks.basilisk.

Five CubeSats with wheels pass Eros for 1,200 s and turn four times to new directions under the same MRP feedback law. Printed
are the largest differences of position, attitude and wheel speed, for several steps, and the processor times, these for 1 to
1,000 spacecraft too, with memory. Needs Basilisk (pip install 'swarm_mj[benchmark]'); takes about five minutes.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from importlib.metadata import version
from pathlib import Path

from benchmarks.basilisk.page import page
from benchmarks.measure import FOLDER, machine, write_results

ROUNDS = 15


def main() -> None:
    """Compare, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="of the timing (default: %(default)s)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the page there too")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of basilisk.json (default: %(default)s)")
    arguments = parser.parse_args()
    if importlib.util.find_spec("Basilisk") is None:
        parser.exit(0, "skipped: Basilisk is not installed; pip install 'swarm_mj[benchmark]'\n")

    from benchmarks.basilisk.comparison import agreement, timing
    from benchmarks.basilisk.problem import make_problem
    from benchmarks.basilisk.scale import scaling

    problem = make_problem()
    agreed = agreement(problem, report)
    results = {
        "basilisk": version("bsk"),
        "rounds": arguments.rounds,
        "agreement": agreed,
        "timing": timing(problem, agreed["steps"], arguments.rounds, report),
        "scale": scaling(arguments.rounds, report),
    }
    text = page(results, machine())
    print(text)
    print(f"wrote {write_results('basilisk', results, arguments.out)}")
    if arguments.markdown:
        part = arguments.markdown.with_suffix(".part")
        part.write_text(text, encoding="utf-8")
        part.replace(arguments.markdown)
        print(f"wrote {arguments.markdown}")


def report(what: str) -> None:
    """Say what is being done."""
    print(what, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
