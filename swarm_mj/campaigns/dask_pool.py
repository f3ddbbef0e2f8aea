"""Workers of a Dask cluster (https://distributed.dask.org), which need swarm_mj in the same versions and a shared file system.

The cluster flies a run again when it loses the worker; a run that costs it several workers is recorded as failed. When the
scheduler goes, the campaign stops with what is finished.
"""

from __future__ import annotations

import asyncio
import logging
import time
import uuid
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from typing import Any

from swarm_mj.campaigns.flying import Row, failed_row, fly_row
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.values import shortened
from swarm_mj.records.summary import library_versions

#: Runs that the cluster knows of at a time, per thread of its workers.
AHEAD = 3
#: How long to wait for the scheduler, and how often to ask whether it is still there [s].
CONNECT_S, ASK_S = 20.0, 2.0
#: However its client says so: by its status, by a call that fails, by cancelled futures.
LOST = "the connection to the scheduler was lost"


class DaskPool:
    """The workers of a scheduler.

    Args:
        resolved: The campaign.
        telemetry: Folder for telemetry, or None.
        scheduler: Its address, such as tcp://host:8786.

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
        from distributed import wait

        try:
            with self._client.as_current():
                done: Collection[Any] = wait(futures, timeout=ASK_S, return_when="FIRST_COMPLETED").done
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
