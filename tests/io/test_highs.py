"""HiGHS in a thread: its answers, its limit of time, and an interruption while it works."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

from swarm_mj.io import highs


def set_cover(n, seed=1):
    """A program in which n sets cover n / 2 cells; with 400 of them it takes minutes."""
    rng = np.random.default_rng(seed)
    return {
        "c": 1.0 + 0.01 * rng.random(n),
        "constraints": LinearConstraint((rng.random((n // 2, n)) < 20.0 / n).astype(float), 1.0, np.inf),
        "bounds": Bounds(0.0, 1.0),
        "integrality": np.ones(n),
        "options": {"mip_rel_gap": 0.0},
    }


def test_answers_are_those_of_scipy_and_errors_come_back():
    program = set_cover(60)
    assert np.array_equal(highs.solve(program, None).x, milp(**program).x)
    linear = {"c": [1.0, 1.0], "A_ub": [[-1.0, -2.0]], "b_ub": [-2.0], "options": {}}
    assert highs.solve(linear, 10.0, by=linprog).fun == pytest.approx(1.0)
    with pytest.raises(ValueError, match="bounds"):
        highs.solve(program | {"bounds": Bounds(np.zeros(7), np.ones(7))}, None)


def test_the_limit_of_time_holds_and_who_waits_is_told_how_long(monkeypatch):
    monkeypatch.setattr(highs, "LOOK_S", 0.05)
    waited = []
    answer = highs.solve(set_cover(400), 0.5, waited.append)
    assert answer.status == 1 and waited and waited == sorted(waited)
    assert not [thread for thread in threading.enumerate() if thread.name == "HiGHS"]


SOLVE = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # those in the background of a script are born deaf to it
from swarm_mj.io import highs
from tests.io.test_highs import set_cover
print("begun", flush=True)
highs.solve(set_cover(400), None)
"""


def test_an_interruption_ends_the_program_at_once():
    process = subprocess.Popen([sys.executable, "-c", SOLVE], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert said.rstrip().endswith("KeyboardInterrupt")
    assert process.returncode == -signal.SIGINT and not os.path.exists(f"/proc/{process.pid}")
