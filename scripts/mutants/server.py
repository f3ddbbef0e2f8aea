"""Runs pytest in forks of a process that has imported all that never changes; started by `trial.Runner`, one at a time.

Importing NumPy, Numba and their like takes longer than most of the tests. Each line of the standard input is a JSON object with
`tree`, `tests`, `output` and `limit_s`, of processor time, as others may need the machine too; the answer is a line with the
exit status of pytest. The packages under test are imported in the fork, from the tree.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import sys
from contextlib import suppress

#: Nothing of the project, and no MuJoCo, which asks the environment for its OpenGL when it is imported.
HEAVY = (
    "numpy", "scipy.integrate", "scipy.optimize", "scipy.spatial.transform", "scipy.stats", "scipy.linalg", "numba",
    "numba.extending", "pytest", "hypothesis.strategies", "pydantic", "yaml", "xarray", "pandas", "trimesh", "shapely",
    "rich.progress",
)  # fmt: skip


def main() -> None:
    """Answer until the input ends."""
    for name in HEAVY:
        with suppress(ImportError):
            importlib.import_module(name)
    for line in sys.stdin:
        asked = json.loads(line)
        child = os.fork()
        if child == 0:
            limit = max(1, round(asked["limit_s"]))
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            _run(asked["tree"], asked["tests"], asked["output"])
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(tree: str, tests: list[str], output: str) -> None:
    """Become pytest in a tree; does not return."""
    status = 3
    try:
        with open(output, "w", buffering=1) as out:
            for stream in (1, 2):
                os.dup2(out.fileno(), stream)
        os.chdir(tree)
        for name in [name for name in sys.modules if name.partition(".")[0] in ("scripts", "swarm_mj")]:
            del sys.modules[name]
        sys.path[0] = tree
        # Results that are kept between runs would hide a fault; machine code lies beside the sources of the tree.
        os.environ.update(PYTHONPATH=tree, SWARM_MJ_CACHE=os.path.join(tree, "build", "cache"))
        import pytest

        status = int(pytest.main(["-x", "-q", "-rfE", "--tb=short", "-p", "no:cacheprovider", *tests]))
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


if __name__ == "__main__":
    main()
