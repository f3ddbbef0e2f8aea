"""Who flies the runs: processes of this machine, or the workers of a Dask cluster (https://distributed.dask.org).

A pool takes row numbers and gives rows in the order in which they finish. Every worker is told the campaign, never results;
only the process that started the campaign writes. A run that costs several workers is recorded as failed.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import time
import uuid
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol

from swarm_mj.campaigns.flying import Row, failed_row, fly_row
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.values import shortened
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
#: Runs that the cluster knows of at a time, per thread of its workers.
AHEAD = 3
#: How long to wait for the scheduler, and how often to ask whether it is still there [s].
CONNECT_S, ASK_S = 20.0, 2.0
#: However its client says so: by its status, by a call that fails, by cancelled futures.
LOST = "the connection to the scheduler was lost"


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
    """The workers of a scheduler, which need swarm_mj in the same versions and a shared file system.

    When the scheduler, named by its address such as tcp://host:8786, goes, the campaign stops with what is finished.

    Raises:
        OutputError: Nobody answers there, or its workers lack swarm_mj or run other versions.
    """

    def __init__(self, resolved: Resolved, telemetry: str | None, scheduler: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise OutputError("--scheduler needs Dask: pip install 'swarm_mj[cluster]'") from None
        self._text, self._telemetry, self._address = resolved.dumps(), telemetry, scheduler
        self._sample = Sample(resolved.campaign)
        self._prefix = f"swarm_mj-{uuid.uuid4().hex}"
        self._threads, self._asked = 0, float("-inf")
        for name in ("distributed", "distributed.client", "distributed.comm", "distributed.core"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said below, once
        try:
            _knock(scheduler)
            self._client: Any = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except Exception as error:  # of whatever kind Dask finds fit for an address
            raise OutputError(
                f"--scheduler {shortened(scheduler)}: no Dask scheduler answers ({shortened(str(error))}); "
                "give its address, such as tcp://host:8786"
            ) from None
        self._check_versions()

    def _check_versions(self) -> None:
        ours = library_versions()
        try:
            answers = self._client.run(library_versions)
        except Exception as error:  # of whatever kind a worker fails with
            self.close()
            raise OutputError(
                f"--scheduler {self._address}: a worker does not say which swarm_mj it has ({shortened(str(error))}); "
                f"install version {ours['swarm_mj']} there"
            ) from None
        for worker, theirs in answers.items():
            other = {name: (theirs.get(name), own) for name, own in ours.items() if theirs.get(name) != own}
            if other:
                self.close()
                words = ", ".join(f"{name} {there} there, {here} here" for name, (there, here) in other.items())
                raise OutputError(f"--scheduler {self._address}: worker {worker} has other versions: {words}")

    def results(self, rows: Sequence[int]) -> Iterator[Row]:
        """See `Pool.results`."""
        ahead = iter(rows)
        running: dict[Any, int] = {}
        while True:
            for row in islice(ahead, max(0, self._room() - len(running))):
                key = f"{self._prefix}-{row}"
                running[self._client.submit(fly_row, self._text, self._telemetry, row, key=key, pure=False)] = row
            if not running:
                return
            for future in self._finished(list(running)):
                yield self._row(future, running.pop(future))

    def _room(self) -> int:
        """How many runs the cluster should know of now; workers may come and go."""
        if time.monotonic() - self._asked > ASK_S:
            self._require_scheduler()
            try:
                self._threads = sum(self._client.nthreads().values())
            except (CancelledError, OSError):  # a TimeoutError is one of them
                raise self._gone(LOST) from None
            self._asked = time.monotonic()
        return AHEAD * max(1, self._threads)

    def _finished(self, futures: list[Any]) -> Collection[Any]:
        import distributed

        try:
            with self._client.as_current():
                done: Collection[Any] = distributed.wait(futures, timeout=ASK_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            self._require_scheduler()
            return ()
        except (CancelledError, OSError):
            raise self._gone(LOST) from None
        return done

    def _row(self, future: Any, row: int) -> Row:
        from distributed import KilledWorker

        if future.status == "finished":
            return dict(future.result())
        error = future.exception() if future.status == "error" else None
        if isinstance(error, SwarmError):
            raise error
        if isinstance(error, KilledWorker):
            return failed_row(self._sample.trial(row), "the cluster lost every worker that tried it")
        raise self._gone(error or future.status)

    def _require_scheduler(self) -> None:
        if self._client.status != "running":
            raise self._gone(LOST)

    def _gone(self, reason: object) -> OutputError:
        return OutputError(
            f"--scheduler {self._address}: the cluster is gone or cannot go on ({reason}); every finished run is kept: "
            "go on with --resume"
        )

    def close(self) -> None:
        """See `Pool.close`."""
        with suppress(Exception):  # whatever state the cluster is in, there is nothing left to lose
            self._client.close(timeout=1.0)


def _knock(scheduler: str) -> None:
    """Connect to an address and hang up: a client that is made for a bad one stays and cannot be closed."""
    from distributed import Security
    from distributed.comm import connect

    async def connect_once() -> None:
        comm = await connect(scheduler, timeout=CONNECT_S, **Security().get_connection_args("client"))
        await comm.close()

    # In a thread of its own: notebooks run an event loop in this one.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, connect_once()).result()
