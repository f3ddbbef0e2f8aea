"""Jobs on the workers of a Dask cluster (https://distributed.dask.org), which have swarm_mj in the same versions."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from itertools import count, islice
from typing import Any, TypeVar

from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io import interruption
from swarm_mj.io.values import shortened

Key = TypeVar("Key")

#: Jobs that the cluster knows of at a time, per thread of its workers.
AHEAD = 3
#: How long to wait for the scheduler, and how often to ask whether it is still there [s].
CONNECT_S, ASK_S = 20.0, 2.0
#: However its client says so: by its status, by a call that fails, by cancelled futures.
LOST = "the connection to the scheduler was lost"
#: What threads of workers have set up for the jobs of one call of `Cluster.run_jobs`.
_READY = threading.local()


class WorkersLost(SwarmError):
    """A job cost every worker that tried it."""


class Cluster:
    """The workers of a scheduler, which need swarm_mj in the same versions and a shared file system.

    Args:
        scheduler: Its address, such as tcp://host:8786.
        versions: Gives the versions that must agree.
        kept: What to do when the scheduler goes, and what is kept then, in words.

    Raises:
        OutputError: Nobody answers there, or its workers lack swarm_mj or run other versions.
    """

    def __init__(self, scheduler: str, versions: Callable[[], dict[str, str]], kept: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise OutputError("--scheduler needs Dask: pip install 'swarm_mj[cluster]'") from None
        self._address, self._versions, self._kept = scheduler, versions, kept
        self._prefix = f"swarm_mj-{uuid.uuid4().hex}"
        self._set_up: tuple[tuple[Any, ...], str, Any] = (), "", ()
        self._numbers, self._threads, self._asked = count(), 0, float("-inf")
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
        ours = self._versions()
        try:
            answers = self._client.run(self._versions)
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

    def finished(self, jobs: Iterable[tuple[Key, tuple[Any, ...]]]) -> Iterator[tuple[Key, Any]]:
        """Futures of jobs, pairs of what names a job and a function with its arguments, in the order in which they are done.

        Raises:
            OutputError: The cluster is gone.
        """
        ahead, running = iter(jobs), dict[Any, Key]()
        while True:
            interruption.check()
            for name, job in islice(ahead, max(0, self._room() - len(running))):
                key = f"{self._prefix}-{next(self._numbers)}"
                running[self._client.submit(*job, key=key, pure=False)] = name
            if not running:
                return
            for future in self._finished(list(running)):
                yield running.pop(future), future

    def run_jobs(
        self,
        jobs: Iterable[tuple[Key, tuple[Any, ...]]],
        work: Callable[..., Any],
        *,
        setup: Callable[..., Any],
        arguments: tuple[Any, ...] = (),
    ) -> Iterator[tuple[Key, Any]]:
        """As `workers.run_jobs`, for which each thread of the workers sets up once."""
        last, token, shared = self._set_up
        if len(last) != len(arguments) or any(a is not b for a, b in zip(last, arguments, strict=True)):
            token, shared = uuid.uuid4().hex, self._shared(arguments)
            self._set_up = arguments, token, shared
        for name, future in self.finished((name, (_work, token, work, setup, shared, job)) for name, job in jobs):
            yield name, self.result_of(future)

    def _shared(self, arguments: tuple[Any, ...]) -> Any:
        """Arguments for all workers, sent once."""
        try:
            return self._client.scatter([arguments], broadcast=True, hash=False)[0]
        except (CancelledError, OSError) as error:  # a TimeoutError is one of them: there is no worker
            raise self._gone(error or "it has no workers") from None

    def _room(self) -> int:
        """How many jobs the cluster should know of now; workers may come and go."""
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

    def result_of(self, future: Any) -> Any:
        """What a job came to.

        Raises:
            WorkersLost: It cost every worker that tried it.
            SwarmError: What it raised, or the cluster is gone.
        """
        from distributed import KilledWorker

        if future.status == "finished":
            return future.result()
        error = future.exception() if future.status == "error" else None
        if isinstance(error, SwarmError):
            raise error
        if isinstance(error, KilledWorker):
            raise WorkersLost(
                f"--scheduler {self._address}: the cluster lost every worker that tried a job; {self._kept}"
            )
        raise self._gone(error or future.status)

    def _require_scheduler(self) -> None:
        if self._client.status != "running":
            raise self._gone(LOST)

    def _gone(self, reason: object) -> OutputError:
        return OutputError(f"--scheduler {self._address}: the cluster is gone or cannot go on ({reason}); {self._kept}")

    def close(self) -> None:
        """Leave the cluster; jobs that have not finished are given up."""
        with suppress(Exception):  # whatever state the cluster is in, there is nothing left to lose
            self._client.close(timeout=1.0)


def _work(token: str, work: Callable[..., Any], setup: Callable[..., Any], shared: tuple[Any, ...], job: Any) -> Any:
    """A job on a worker, whose threads keep what they have set up until they are given other work."""
    if getattr(_READY, "token", None) != token:
        _READY.state, _READY.token = setup(*shared), token
    return work(_READY.state, *job)


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
