"""The progress bars of long work."""

from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from swarm_mj.io import interruption


class Bars(Progress):
    """Bars that stand from the first task on, and whose every movement notices an interruption that Python lost."""

    _begun = False

    def start(self) -> None:
        """Show the bars, if there is one: what is refused before any work begins says so without an empty line."""
        self._begun = True
        if self.task_ids:
            super().start()

    def stop(self) -> None:
        """Leave the bars as they stand."""
        self._begun = False
        if self.live.is_started:
            super().stop()

    def add_task(self, *arguments: Any, **keywords: Any) -> TaskID:
        """Begin a bar; arguments as in rich."""
        interruption.check()
        task = super().add_task(*arguments, **keywords)
        if self._begun:
            self.start()
        return task

    def update(self, *arguments: Any, **keywords: Any) -> None:
        """Move a bar; arguments as in rich."""
        interruption.check()
        super().update(*arguments, **keywords)

    def advance(self, *arguments: Any, **keywords: Any) -> None:
        """Move a bar by some steps; arguments as in rich."""
        interruption.check()
        super().advance(*arguments, **keywords)


def progress_bars(console: Console, quiet: bool = False) -> Progress:
    """Bars with elapsed and remaining time; none if quiet."""
    return Bars(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=quiet,
    )
