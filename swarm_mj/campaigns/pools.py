"""Who flies the runs: processes of this machine, or the workers of a Dask cluster (https://distributed.dask.org).

A pool takes row numbers and gives rows in the order in which they finish. Every worker is told the campaign, never results;
only the process that started the campaign writes. A run that costs several workers is recorded as failed.
"""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from swarm_mj.campaigns.flying import Row, failed_row, fly_row
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.cluster import Cluster, WorkersLost
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.workers import begin
from swarm_mj.records.summary import library_versions

#: A run during which this many workers died is recorded as failed.
MAX_DEATHS = 3
#: Workers that die before their first run, one after another, before the campaign gives up.
MAX_FAILED_STARTS = 5
#: What every run needs, some of which is imported when the first one flies. Dask is asked for by xarray, where it is installed.
PRELOADED = (
    __name__,
    "swarm_mj.smallbody.gravity.factory",
    "swarm_mj.observation.horizon",
    "swarm_mj.observation.raster",
    "swarm_mj.observation.raycast",
    "dask.array",
)


class Pool(Protocol):
    """Flies runs of a campaign somewhere; their telemetry goes to a folder, or nowhere."""

    def results(self, rows: Sequence[int]) -> Iterator[Row]:
        """Rows as they finish.

        Raises:
            SwarmError: The campaign cannot go on.
        """
        ...

    def close(self) -> None:
        """Stop; runs that have not finished are given up."""
        ...


class LocalPool:
    """Processes of this machine, each with one run at a time.

    A process that dies takes only its own run with it: the run is flown again, and recorded as failed when it has cost
    `MAX_DEATHS` processes. Without a number of workers there is one per core.
    """

    def __init__(self, resolved: Resolved, telemetry: str | None, workers: int | None = None) -> None:
        self._text, self._telemetry = resolved.dumps(), telemetry
        self._sample, self._limit = Sample(resolved.campaign), resolved.campaign.time_limit_s
        self._size = workers or usable_cores()
        self._workers: list[_Worker] = []
        self._failed_starts = 0

    def results(self, rows: Sequence[int]) -> Iterator[Row]:
        """See `Pool.results`."""
        waiting, deaths = deque(rows), dict.fromkeys(rows, 0)
        while waiting or any(worker.row is not None for worker in self._workers):
            self._keep_busy(waiting)
            wait([w.pipe for w in self._workers], timeout=self._patience())
            for worker in list(self._workers):
                row = self._receive(worker, waiting, deaths)
                if row is not None:
                    yield row

    def _keep_busy(self, waiting: deque[int]) -> None:
        busy = sum(worker.row is not None for worker in self._workers)
        while len(self._workers) < min(self._size, busy + len(waiting)):
            self._workers.append(_Worker(self._text, self._telemetry))
        for worker in self._workers:
            if worker.ready and worker.row is None and waiting:
                worker.send(waiting)

    def _receive(self, worker: _Worker, waiting: deque[int], deaths: dict[int, int]) -> Row | None:
        """A row, if a worker has finished one; a worker that is late or dead is retired."""
        if not worker.pipe.poll():  # what is finished counts, however late it is heard
            return self._retire(worker, True, waiting, deaths) if worker.overdue(self._limit) else None
        kind, value = worker.receive()
        if kind == "ready":
            worker.ready, self._failed_starts = True, 0
            return None
        if kind == "row":
            worker.row = None
            return dict(value)
        if kind == "error":
            raise value
        return self._retire(worker, False, waiting, deaths)

    def _retire(self, worker: _Worker, overdue: bool, waiting: deque[int], deaths: dict[int, int]) -> Row | None:
        """End a worker; its run is flown again, or its row says why it has failed."""
        worker.stop()
        self._workers.remove(worker)
        if not worker.ready:
            self._failed_starts += 1
            if self._failed_starts >= MAX_FAILED_STARTS:
                raise OutputError(f"worker processes end before they start ({worker.ending}); see the messages above")
        if worker.row is None:
            return None
        if overdue:
            return failed_row(self._sample.trial(worker.row), f"took longer than time_limit_s = {self._limit:g}")
        deaths[worker.row] += 1
        if deaths[worker.row] < MAX_DEATHS:
            waiting.appendleft(worker.row)
            return None
        return failed_row(
            self._sample.trial(worker.row), f"its process died {MAX_DEATHS} times, the last time {worker.ending}"
        )

    def _patience(self) -> float | None:
        if self._limit is None:
            return None
        starts = [worker.started for worker in self._workers if worker.row is not None]
        return max(0.0, min(starts) + self._limit - time.monotonic()) + 0.01 if starts else None

    def close(self) -> None:
        """See `Pool.close`."""
        for worker in self._workers:
            worker.process.kill()  # all at once: each takes a while to end on a machine with much to do
        for worker in self._workers:
            worker.stop()
        self._workers.clear()


class _Worker:
    """One process and the pipe to it."""

    def __init__(self, text: str, telemetry: str | None) -> None:
        self.process, self.pipe = begin(_work, (text, telemetry), modules=PRELOADED)
        self.ready, self.started = False, 0.0
        self.row: int | None = None

    def send(self, waiting: deque[int]) -> None:
        self.row, self.started = waiting.popleft(), time.monotonic()
        with suppress(OSError):  # it has died; its end of the pipe says so when it is listened to
            self.pipe.send(self.row)

    def receive(self) -> tuple[str, Any]:
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            return "dead", None
        return kind, value

    def overdue(self, limit: float | None) -> bool:
        return limit is not None and self.row is not None and time.monotonic() - self.started > limit

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()

    @property
    def ending(self) -> str:
        code = self.process.exitcode or 0
        return f"by signal {signal.Signals(-code).name}" if code < 0 else f"with exit status {code}"


def _work(pipe: Connection, text: str, telemetry: str | None) -> None:
    """A worker's life: rows in, results out, until nobody listens any more."""
    pipe.send(("ready", None))
    while True:
        row = pipe.recv()
        try:
            pipe.send(("row", fly_row(text, telemetry, row)))
        except SwarmError as error:
            pipe.send(("error", error))


class DaskPool:
    """The workers of a scheduler, see `Cluster`; when it goes, the campaign stops with what is finished."""

    def __init__(self, resolved: Resolved, telemetry: str | None, scheduler: str) -> None:
        self._text, self._telemetry = resolved.dumps(), telemetry
        self._sample = Sample(resolved.campaign)
        kept = "every finished run is kept: go on with --resume"
        self._cluster = Cluster(scheduler, library_versions, kept)

    def results(self, rows: Sequence[int]) -> Iterator[Row]:
        """See `Pool.results`."""
        for row, future in self._cluster.finished((row, (fly_row, self._text, self._telemetry, row)) for row in rows):
            try:
                yield dict(self._cluster.result_of(future))
            except WorkersLost:
                yield failed_row(self._sample.trial(row), "the cluster lost every worker that tried it")

    def close(self) -> None:
        """See `Pool.close`."""
        self._cluster.close()
