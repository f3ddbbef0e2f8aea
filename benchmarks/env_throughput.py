"""Environment steps per second, single and vector, against raw `mj_step`: `python benchmarks/env_throughput.py`."""

import argparse

from swarm_mj.verification.performance.runner import run_bench

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer rounds, level `role` only")
    run_bench(["environment"], quick=parser.parse_args().quick)
