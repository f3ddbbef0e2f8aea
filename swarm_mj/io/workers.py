"""Processes of this machine that share work, and are killed at once when nobody waits for their answers any more.

On Linux they are forks of the standard library's fork server, which imports once what they need: importing takes ten times as
long as a short flight. The fork server is an interpreter of its own, without an OpenGL context or threads, which do not survive
a fork. Elsewhere system libraries do not survive one either, and each process is a new interpreter. Nothing heavy is imported
here.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Lock
from types import ModuleType
from typing import Any, TypeVar

from swarm_mj.errors import SwarmError
from swarm_mj.io import interruption
from swarm_mj.io.machine import ONE_THREAD

Key = TypeVar("Key")
#: Who runs jobs, as `run_jobs` does with `workers` processes: called with jobs and `work`, and with `setup` and `arguments`.
Runner = Callable[..., Iterator[tuple[Any, Any]]]

#: Whether processes are forks.
FORKS = sys.platform == "linux"
#: Time between two looks for an interruption that Python lost [s].
LOOK_S = 0.5

#: What new interpreters are told: one core each, and to import nothing of the current folder (`-P`), which is anybody's.
_ALONE = {**dict.fromkeys(ONE_THREAD, "1"), "PYTHONSAFEPATH": "1"}

_CONTEXT: Any = multiprocessing.get_context("forkserver" if FORKS else "spawn")
_STARTING = Lock()


def preload(modules: Sequence[str]) -> None:
    """Let the fork server import modules that are installed, without waiting for it; the first call of this process says which.

    Processes load what the fork server has not.
    """
    if not FORKS:
        return
    with _STARTING:
        _CONTEXT.set_forkserver_preload(list(modules))
        # It opens no window, for which mujoco would get ready. Ctrl-C while it imports is not for it.
        with _environment({**_ALONE, "MUJOCO_GL": "disable"}):
            resource_tracker.ensure_running()  # the call below would start it, and let Ctrl-C through again
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                forkserver.ensure_running()
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin(
    work: Callable[..., object], arguments: tuple[Any, ...], *, modules: Sequence[str]
) -> tuple[BaseProcess, Connection]:
    """Start a process that calls `work(pipe, *arguments)` on one core, is deaf to Ctrl-C, and ends with this process.

    It ends as well, without a word, when `work` finds its pipe closed at the other end. It does not run the user's script
    again, which therefore needs no `if __name__ == "__main__":`. `work` is of the top level of a module, the arguments can be
    pickled; `modules`: what processes should have loaded, see `preload`.

    Returns:
        The process, and this one's end of the pipe.

    Raises:
        OSError: No process can be had.
    """
    preload(modules)
    mine, theirs = _CONTEXT.Pipe()
    try:
        environment = os.environ | dict.fromkeys(ONE_THREAD, "1")
        process = _CONTEXT.Process(target=_live, args=(theirs, environment, work, arguments), daemon=True)
        # Interruptions are not held back: a fork is waited for until the fork server has imported its modules.
        with _STARTING, _environment(_ALONE), _without_main():
            process.start()
    except BaseException:
        mine.close()
        raise
    finally:
        theirs.close()
    return process, mine


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        for name in values:
            if name in before:
                os.environ[name] = before[name]
            else:
                del os.environ[name]


@contextmanager
def _without_main() -> Iterator[None]:
    """Keep `multiprocessing` from running this process's script in a process that is started meanwhile."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _live(
    pipe: Connection, environment: dict[str, str], work: Callable[..., object], arguments: tuple[Any, ...]
) -> None:
    """What a process of `begin` does."""
    # Ctrl-C reaches the whole group of processes; the one that started them decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if FORKS:
        _end_with_parent()
    os.environ.clear()
    os.environ.update(environment)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # nobody listens any more
        work(pipe, *arguments)


def _end_with_parent() -> None:
    """Have the kernel kill this process by SIGIO once the one that asked for it is gone, whatever code runs then.

    PR_SET_PDEATHSIG would tell of the end of the fork server.
    """
    import fcntl

    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel
    fcntl.fcntl(sentinel, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(sentinel, fcntl.F_SETFL, fcntl.fcntl(sentinel, fcntl.F_GETFL) | os.O_ASYNC)
    if wait([sentinel], timeout=0.0):  # it ended before
        os._exit(1)


def run_jobs(
    jobs: Iterable[tuple[Key, tuple[Any, ...]]],
    work: Callable[..., Any],
    *,
    workers: int,
    setup: Callable[..., Any],
    arguments: tuple[Any, ...] = (),
    modules: Sequence[str] | None = None,
) -> Iterator[tuple[Key, Any]]:
    """Results of jobs, pairs of what names a job and its arguments, in the order in which they are done.

    Each process calls `setup(*arguments)` first, which returns its `state`, then `work(state, *job_arguments)`, both of the top
    level of a module. `modules`: see `preload`; default: that of `work`.

    Raises:
        SwarmError: A process died.
        Exception: Whatever `setup` or `work` raises there.
    """
    waiting = iter(jobs)
    running: dict[Connection, Key] = {}
    pool: dict[Connection, BaseProcess] = {}
    try:
        for _ in range(workers):
            process, pipe = begin(_serve, (work, setup), modules=modules or (work.__module__,))
            pool[pipe] = process
            _send(pipe, process, arguments)
            running.update(_next_job(pipe, process, waiting))
        while running:
            interruption.check()
            ready = wait(list(running), timeout=LOOK_S)
            for pipe in [pipe for pipe in running if pipe in ready]:
                key, result = running.pop(pipe), _receive(pipe, pool[pipe])
                running.update(_next_job(pipe, pool[pipe], waiting))
                yield key, result
    finally:
        with interruption.held():
            for process in pool.values():
                process.kill()
            for pipe, process in pool.items():
                process.join()
                pipe.close()


def _next_job(
    pipe: Connection, process: BaseProcess, waiting: Iterator[tuple[Key, tuple[Any, ...]]]
) -> dict[Connection, Key]:
    for key, job in waiting:
        _send(pipe, process, job)
        return {pipe: key}
    return {}


def _send(pipe: Connection, process: BaseProcess, message: Any) -> None:
    try:
        pipe.send(message)
    except OSError:  # nobody is there to read it
        raise _death_of(process) from None


def _receive(pipe: Connection, process: BaseProcess) -> Any:
    try:
        result, error = pipe.recv()
    except (EOFError, OSError):
        raise _death_of(process) from None
    if error is not None:
        raise error
    return result


def _death_of(process: BaseProcess) -> SwarmError:
    process.join(1.0)
    return SwarmError(
        f"a process that shared the work died with exit status {process.exitcode}; if memory is short, ask for fewer workers"
    )


def _serve(pipe: Connection, work: Callable[..., Any], setup: Callable[..., Any]) -> None:
    state, problem = _tried(setup, pipe.recv())
    while True:
        job = pipe.recv()
        pipe.send(_tried(work, (state, *job)) if problem is None else (None, problem))


def _tried(call: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, Exception | None]:
    """What a call gives, or what it raises."""
    try:
        return call(*arguments), None
    except Exception as error:
        return None, error
