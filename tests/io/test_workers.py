"""Processes that share work: what they answer, what they raise, and what is said where one has died."""

import multiprocessing
import subprocess
import sys

import pytest

from swarm_mj.errors import SwarmError
from swarm_mj.io import workers

DIED = "a process that shared the work died with exit status 1: .*`if __name__ == '__main__':`"


def root(x):
    if x < 0:
        raise ValueError(f"{x} has none")
    return x**0.5


def refuse():
    raise SwarmError("not here")


def ask(*questions, begin=list):
    return dict(workers.answers([(q, (q,)) for q in questions], root, workers=2, begin=begin))


def test_every_question_is_answered_and_an_error_comes_back():
    assert ask(0.0, 1.0, 4.0, 9.0) == {0.0: 0.0, 1.0: 1.0, 4.0: 2.0, 9.0: 3.0}
    with pytest.raises(ValueError, match="-1.0 has none"):
        ask(-1.0)


def test_what_the_beginning_raises_comes_back_too():
    with pytest.raises(SwarmError, match="not here"):
        ask(1.0, begin=refuse)


class Stillborn:
    """A process that is dead before it is told anything."""

    exitcode = 1

    def kill(self):
        pass

    def join(self, timeout=None):
        pass


def test_a_process_that_is_dead_before_it_is_told_anything_is_the_same_error(monkeypatch):
    def begin(*_, **__):
        mine, theirs = multiprocessing.Pipe()
        theirs.close()
        return Stillborn(), mine

    monkeypatch.setattr(workers.fork_server, "begin", begin)
    with pytest.raises(SwarmError, match=DIED):
        ask(1.0)


def test_where_processes_run_a_script_again_it_is_told_what_to_do(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from swarm_mj.io import fork_server\nfrom swarm_mj.io.workers import answers\nfork_server.FORKS = False\n"
        "list(answers([(0, (1,))], abs, workers=2, begin=list))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith("swarm_mj.errors.SwarmError: a process that shared the work died") and "__main__" in last
    assert "BrokenPipeError" not in done.stderr
