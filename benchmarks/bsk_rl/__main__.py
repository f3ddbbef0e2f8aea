"""Environment steps per second beside bsk_rl's examples with five satellites: python -m benchmarks.bsk_rl.

bsk_rl pins a pytest too old for this project's tests, so it runs in an environment of its own:

    python -m venv peer && peer/bin/pip install bsk bsk_rl spiceypy
    python -m benchmarks.bsk_rl --peer-python peer/bin/python

Takes about five minutes.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.bsk_rl.link import Peer, PeerMissing
from benchmarks.bsk_rl.page import page
from benchmarks.measure import FOLDER, machine, write_results
from swarm_mj.io.atomic import write_text

ROUNDS, SECONDS = 15, 3.0


def main() -> None:
    """Compare, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--peer-python", default=sys.executable, metavar="FILE", help="interpreter that has bsk_rl (default: this one)"
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="default: %(default)s")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each work in a round (default: %(default)s)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the page there too")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder of bsk_rl.json (default: %(default)s)")
    arguments = parser.parse_args()
    try:
        with Peer(arguments.peer_python) as peer:
            # Only now: it compiles, and there may be no peer.
            from benchmarks.bsk_rl.comparison import compare

            results = compare(peer, arguments.rounds, arguments.seconds, report)
    except PeerMissing as missing:
        parser.exit(
            0,
            f"skipped: bsk_rl cannot be run ({missing}); make it an environment of its own, "
            "pip install bsk bsk_rl spiceypy, and name its interpreter by --peer-python\n",
        )
    text = page(results, machine())
    print(text)
    print(f"wrote {write_results('bsk_rl', results, arguments.out)}")
    if arguments.markdown:
        write_text(arguments.markdown, text)
        print(f"wrote {arguments.markdown}")


def report(what: str) -> None:
    """Say what is being done."""
    print(what, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
