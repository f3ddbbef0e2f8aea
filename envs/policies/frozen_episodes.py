"""Test episodes that no training looked at, for any environment: what all of them do alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from swarm_mj.errors import ScenarioError

from .evaluation import Progress


class FrozenEpisodes(ABC):
    """Ready to be flown by one policy after another; a context manager."""

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release what they hold."""
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Release what they hold; they cannot be flown any more."""

    @property
    @abstractmethod
    def decisions(self) -> int:
        """How far `progress` of `score` counts."""

    @abstractmethod
    def policy(self, name_or_file: str | Path) -> Any:
        """A scripted policy by name, or that of a file, see `score`."""

    @abstractmethod
    def score(self, name_or_file: str | Path, progress: Progress | None = None) -> Any:
        """Of a scripted policy by name, or of that of a file.

        Raises:
            ScenarioError: It is neither, or the file's policy cannot fly there; the message names why.
        """

    @property
    def preparations(self) -> int:
        """How far `progress` of `prepare` counts; 0: there is nothing to prepare."""
        return 0

    def prepare(self, progress: Progress | None = None) -> None:
        """Work out what takes long and every score needs; here nothing."""
        if progress is not None:
            progress(self.preparations)

    def check(self, names_or_files: Sequence[str | Path]) -> None:
        """Refuse those that cannot fly there, see `score`."""
        for name_or_file in names_or_files:
            self.policy(name_or_file)


def policy_file(name_or_file: str | Path, names: Iterable[str]) -> Path:
    """A file of a policy that is there.

    Raises:
        ScenarioError: It is not; the message says what names there are.
    """
    path = Path(name_or_file)
    if not path.is_file():
        raise ScenarioError(f"policy {str(path)!r}: no such file, and no name; names are {', '.join(names)}")
    return path
