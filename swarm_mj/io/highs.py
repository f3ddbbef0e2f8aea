"""HiGHS in a thread of its own: it hears no signals, and whoever waits for it does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from scipy.optimize import milp

from swarm_mj.io import interruption

#: Time between two looks at the solver [s].
LOOK_S = 0.2


def solve(
    program: dict[str, Any],
    time_limit_s: float | None,
    waiting: Callable[[float], None] | None = None,
    *,
    by: Callable[..., Any] = milp,
) -> Any:
    """The answer of `scipy.optimize.milp`, or of `linprog` where there are no whole numbers, to a program: their arguments.

    It stops after `time_limit_s`, None: never. `waiting` is called now and then with the seconds that have passed. After an
    interruption the thread goes on until its limit of time or the end of this process, whichever comes first.

    Raises:
        Exception: What `by` raises.
    """
    options = program["options"] | ({} if time_limit_s is None else {"time_limit": time_limit_s})
    answers: list[Any] = []

    def work() -> None:
        try:
            answers.append(by(**program | {"options": options}))
        except BaseException as error:
            answers.append(error)

    start = time.perf_counter()
    thread = threading.Thread(target=work, name="HiGHS", daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(LOOK_S)
        interruption.check()
        if waiting is not None and thread.is_alive():
            waiting(time.perf_counter() - start)
    (answer,) = answers
    if isinstance(answer, BaseException):
        raise answer
    return answer
