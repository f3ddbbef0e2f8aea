"""HiGHS in a process of its own, which is killed when nobody waits for it: it hears no signals, however long it works."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import IO, Any

from scipy.optimize import milp

from swarm_mj.errors import MissionError
from swarm_mj.io import interruption

#: What takes no longer is solved here: starting a process takes as long [s].
HERE_S = 1.0
#: Time between two looks at the other process [s].
LOOK_S = 0.2


def solve(
    program: dict[str, Any],
    time_limit_s: float | None,
    waiting: Callable[[float], None] | None = None,
    *,
    by: Callable[..., Any] = milp,
) -> Any:
    """The answer of `scipy.optimize.milp`, or of `linprog` where there are no whole numbers.

    Args:
        program: Its arguments, without the limit of time.
        time_limit_s: When to stop [s]; None: never.
        waiting: Called now and then with the seconds that have passed.
        by: `milp` or `linprog`.

    Raises:
        MissionError: The other process died.
    """
    start = time.perf_counter()
    here = HERE_S if time_limit_s is None else min(HERE_S, time_limit_s)
    answer = _solved(by, program, here)
    if answer.status != 1 or here == time_limit_s:
        return answer
    left = None if time_limit_s is None else time_limit_s - here
    # Not multiprocessing: that would run a script of the user's again where it has no `if __name__ == "__main__"`.
    with _question(by, program, left) as question:
        process = subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import answer_to_stdin; answer_to_stdin()"],
            stdin=question,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
            start_new_session=True,  # Ctrl-C is for the one that waits
        )
    try:
        while True:
            interruption.check()
            try:
                said, _ = process.communicate(timeout=LOOK_S)
                break
            except subprocess.TimeoutExpired:
                if waiting is not None:
                    waiting(time.perf_counter() - start)
    finally:
        process.kill()
        process.wait()
    if process.returncode != 0 and not said:
        raise MissionError(f"the solver died with exit status {process.returncode}: ask for less, or for more memory")
    return pickle.loads(said)


def answer_to_stdin() -> None:
    """Solve what stands in the standard input, and write the answer to the standard output."""
    sys.stdout.buffer.write(pickle.dumps(_solved(*pickle.load(sys.stdin.buffer))))


def _question(*asked: Any) -> IO[bytes]:
    """A file without a name: what a pipe does not hold at once, `communicate` forgets when its time is up."""
    file = tempfile.TemporaryFile()
    pickle.dump(asked, file)
    file.seek(0)
    return file


def _solved(by: Callable[..., Any], program: dict[str, Any], limit: float | None) -> Any:
    options = {**program["options"], **({} if limit is None else {"time_limit": limit})}
    return by(**{**program, "options": options})
