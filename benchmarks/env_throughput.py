"""Environment steps per second, single and vector, against raw `mj_step`: `python benchmarks/env_throughput.py`."""

from swarm_mj.bench.runner import run_bench

if __name__ == "__main__":
    run_bench(["environment"], quick=False)
