"""The process in which bsk_rl runs, seen from here."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Any, Self

ROOT = Path(__file__).parents[2]


class PeerMissing(Exception):
    """The interpreter cannot run bsk_rl; the message says why."""


class Peer:
    """bsk_rl's examples in a process of their own, which waits while nothing is asked.

    Args:
        python: Interpreter of an environment with bsk_rl, Basilisk and spiceypy.

    Raises:
        PeerMissing: There is no such interpreter, or it lacks a package.
    """

    def __init__(self, python: str) -> None:
        try:
            self._process = subprocess.Popen(
                [python, "-m", "benchmarks.bsk_rl.peer"],
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        except OSError as error:
            raise PeerMissing(f"{python}: {error.strerror}") from None
        try:
            self.versions: dict[str, str] = self._answer()
        except RuntimeError as error:
            raise PeerMissing(f"{python}: {error}") from None
        if "missing" in self.versions:
            self.close()
            raise PeerMissing(f"{python}: {self.versions['missing']}")

    def measure(self, example: str, seconds: float) -> dict[str, float]:
        """Step an example for `seconds`; see `peer.Timed.run`.

        Raises:
            RuntimeError: The process has ended.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"example": example, "seconds": seconds}) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(
                f"the process of bsk_rl ended with status {self._process.wait()}; its messages stand above"
            )
        return dict(json.loads(line))
