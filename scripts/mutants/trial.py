"""Run tests in a copy of the sources, and what came of it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from scripts.pages import ROOT
from swarm_mj.io.machine import ONE_THREAD

#: Outcomes. BROKEN: what was planted is no program; such a fault says nothing about the tests.
DIED, SURVIVED, TIME_LIMIT, BROKEN = "died", "survived", "time limit", "broken"
#: Would lead past the copies' own folders, or cost every run the time to read all sources.
NOT_OURS = ("NUMBA_CACHE_DIR", "PYTEST_ADDOPTS", "PYTHONDONTWRITEBYTECODE", "PYTHONPATH")
#: A busy machine takes so much longer than the processor time of a test.
WAITING = 20.0
#: Errors that a compiler or the interpreter raises, and no physics.
_NO_PROGRAM = re.compile(
    r"\b(SyntaxError|NameError|UnboundLocalError|ImportError|TypingError|LoweringError|AttributeError)\b"
)
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+::.+?)(?: - (.*))?$", re.MULTILINE)


@dataclass(frozen=True)
class Trial:
    """What came of a fault.

    Attributes:
        outcome: DIED, SURVIVED, TIME_LIMIT or BROKEN.
        test: The test that noticed; empty: none.
        words: What the tests said last.
        seconds: How long they took.
    """

    outcome: str
    test: str
    words: str
    seconds: float


class Runner:
    """Runs tests, one call after the other, in forks of one server; see `server`."""

    def __init__(self) -> None:
        self._server: subprocess.Popen[str] | None = None
        self._ended = self._late = False

    def run(self, tree: Path, tests: tuple[str, ...], limit_s: float) -> Trial:
        """Run tests in a tree until the first one fails.

        Args:
            tree: See `copy_sources`; the packages under test are imported from there.
            tests: Files or ids.
            limit_s: After so much processor time [s] they are ended, and where they only wait, after `WAITING` times as long.

        Raises:
            RuntimeError: The runner was ended, or the server died.
        """
        if self._ended:
            raise RuntimeError("the runner was ended")
        start, output = time.monotonic(), tree / "build" / f"output-{id(self)}.txt"
        output.parent.mkdir(exist_ok=True)
        server = self._server = self._server or _start()
        assert server.stdin is not None and server.stdout is not None
        self._late = False
        timer = threading.Timer(WAITING * limit_s, self._give_up)
        timer.start()
        try:
            server.stdin.write(
                json.dumps({"tree": str(tree), "tests": tests, "output": str(output), "limit_s": limit_s}) + "\n"
            )
            server.stdin.flush()
            answer = server.stdout.readline()
        finally:
            timer.cancel()
        seconds = round(time.monotonic() - start, 1)
        if not answer:
            self._server = None
            if self._late:
                return Trial(TIME_LIMIT, "", f"waited longer than {WAITING * limit_s:g} s", seconds)
            raise RuntimeError(f"the server of {tree} ended by itself")
        return Trial(*judge(int(answer), output.read_text(errors="replace")), seconds)

    def end(self) -> None:
        """End the tests that run, and run none any more."""
        self._ended = True
        if self._server is not None:
            _kill(self._server)

    def _give_up(self) -> None:
        self._late = True
        if self._server is not None:
            _kill(self._server)


def judge(status: int, output: str) -> tuple[str, str, str]:
    """Outcome, the test that failed, and its words, from what pytest answers."""
    if status in (-signal.SIGXCPU, -signal.SIGKILL):
        return TIME_LIMIT, "", "took more processor time than is allowed"
    if status == 0:
        return SURVIVED, "", output.strip().rpartition("\n")[2]
    failed = _FAILED.search(output)
    errors = "\n".join(line for line in output.splitlines() if line.startswith(("E  ", "FAILED", "ERROR")))
    if status != 1 or failed is None or _NO_PROGRAM.search(errors):
        return BROKEN, "", (errors or output)[-600:]
    return DIED, failed[1], failed[2] or ""


def _start() -> subprocess.Popen[str]:
    kept = {name: value for name, value in os.environ.items() if name not in NOT_OURS}
    return subprocess.Popen(
        [sys.executable, "-m", "scripts.mutants.server"],
        cwd=ROOT,
        env={**kept, **dict.fromkeys(ONE_THREAD, "1"), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _kill(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
