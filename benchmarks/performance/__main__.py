"""How fast the program is on this machine: `python -m benchmarks.performance`, about fifteen minutes, or `make bench`, quick.

Without options it writes docs/results/performance.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.measure import FOLDER
from benchmarks.performance.runner import GROUPS, run_bench
from swarm_mj.errors import SwarmError

PAGE = Path("docs/results/performance.md")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.performance", description=__doc__)
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help=f"{', '.join(GROUPS)}; may be repeated"
    )
    parser.add_argument("--quick", action="store_true", help="fewer rounds, small cases, and no files unless named")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write machine and rows as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the rows as a Markdown page")
    arguments = parser.parse_args()
    whole = not arguments.quick and not arguments.only
    as_json = arguments.json or (FOLDER / "performance.json" if whole else None)
    markdown = arguments.markdown or (PAGE if whole else None)
    try:
        run_bench(arguments.only, quick=arguments.quick, as_json=as_json, markdown=markdown)
    except SwarmError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
