"""Everything that docs/results/performance.md shows: `python -m benchmarks.performance`; takes about fifteen minutes."""

from pathlib import Path

from swarm_mj.verification.performance.record import FOLDER
from swarm_mj.verification.performance.runner import run_bench

if __name__ == "__main__":
    run_bench(quick=False, as_json=FOLDER / "performance.json", markdown=Path("docs/results/performance.md"))
