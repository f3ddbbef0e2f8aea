"""bsk_rl's examples in a process of their own, timed on request: run by the interpreter of an environment that has bsk_rl.

Every line of standard input asks {"example": name, "seconds": s}; every line of standard output answers. The first line tells
the versions, or why there is no peer. Nothing of swarm_mj is imported: bsk_rl pins a pytest too old for this project's tests.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

PACKAGES = ("bsk_rl", "bsk", "numpy")


class Timed:
    """An environment that is stepped with random actions, and started anew when an episode ends.

    Args:
        env: A GeneralSatelliteTasking.
    """

    def __init__(self, env: Any) -> None:
        self.env, self.episodes, self.ended = env, 0, True
        env.reset(seed=0)
        self.actions = env.action_space
        self.actions.seed(0)

    def run(self, seconds: float) -> dict[str, float]:
        """Step for `seconds` of wall clock, resets included; what both cost apart, and how long was flown."""
        steps = resets = 0
        simulated = 0.0
        stepping, resetting = Clock(), Clock()
        while stepping.wall + resetting.wall < seconds:
            if self.ended:
                resetting.time(self.reset)
                resets += 1
            simulated += stepping.time(self.step)
            steps += 1
        return {
            "steps": steps,
            "simulated_s": simulated,
            "wall_s": stepping.wall,
            "cpu_s": stepping.cpu,
            "resets": resets,
            "reset_cpu_s": resetting.cpu,
        }

    def reset(self) -> None:
        """Start the next episode."""
        self.env.reset(seed=self.episodes)
        self.episodes, self.ended = self.episodes + 1, False

    def step(self) -> float:
        """One step; how long it flew [s]."""
        _, _, terminated, truncated, info = self.env.step(self.actions.sample())
        self.ended = terminated or truncated
        return float(info["d_ts"])


class Clock:
    """Adds up wall clock and processor time [s]."""

    def __init__(self) -> None:
        self.wall = self.cpu = 0.0

    def time(self, work: Callable[[], Any]) -> Any:
        """Do the work and add what it takes."""
        wall, cpu = perf_counter(), process_time()
        done = work()
        self.wall, self.cpu = self.wall + perf_counter() - wall, self.cpu + process_time() - cpu
        return done


def main() -> None:
    """Answer until standard input ends."""
    # Basilisk prints on standard output: answers keep it to themselves.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)

    def answer(content: dict[str, Any]) -> None:
        print(json.dumps(content), file=answers, flush=True)

    with tempfile.TemporaryDirectory() as folder:
        try:
            # The data come first: bsk_rl looks for them when it is imported.
            from benchmarks.bsk_rl import support_data

            support_data.install(Path(folder) / "supportData")
            from Basilisk.architecture import bskLogging

            from benchmarks.bsk_rl.examples import EXAMPLES
        except ImportError as missing:
            answer({"missing": str(missing)})
            return
        bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)
        answer({name: version(name) for name in PACKAGES} | {"python": platform.python_version()})
        timed: dict[str, Timed] = {}
        for line in sys.stdin:
            asked = json.loads(line)
            name = asked["example"]
            if name not in timed:
                timed[name] = Timed(EXAMPLES[name]())
            answer(timed[name].run(asked["seconds"]))


if __name__ == "__main__":
    main()
