"""Processes of this machine that share work, and are killed at once when nobody waits for their answers any more."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any, TypeVar

from swarm_mj.errors import SwarmError
from swarm_mj.io import fork_server, interruption

Key = TypeVar("Key")

#: Time between two looks for an interruption that Python lost [s].
LOOK_S = 0.5


def answers(
    questions: Iterable[tuple[Key, tuple[Any, ...]]],
    answer: Callable[..., Any],
    *,
    workers: int,
    begin: Callable[..., object],
    arguments: tuple[Any, ...] = (),
) -> Iterator[tuple[Key, Any]]:
    """Answers to questions, in the order in which they are found.

    Args:
        questions: Pairs of what names a question and the arguments of `answer`.
        answer: What each process calls for a question; of the top level of a module.
        workers: Number of processes.
        begin: What each calls first.
        arguments: Of `begin`.

    Raises:
        SwarmError: A process died.
        Exception: Whatever `begin` or `answer` raises there.
    """
    waiting = iter(questions)
    asked: dict[Connection, Key] = {}
    pool: dict[Connection, fork_server.Worker] = {}
    try:
        for _ in range(workers):
            process, pipe = fork_server.begin(_work, (answer,), modules=(answer.__module__,))
            pool[pipe] = process
        for pipe, process in pool.items():
            _tell(pipe, process, (begin, arguments))
            asked.update(_ask(pipe, process, waiting))
        while asked:
            interruption.check()
            heard = set(wait(list(asked), timeout=LOOK_S))
            for pipe in [pipe for pipe in asked if pipe in heard]:
                key, found = asked.pop(pipe), _hear(pipe, pool[pipe])
                asked.update(_ask(pipe, pool[pipe], waiting))
                yield key, found
    finally:
        for pipe, process in pool.items():
            process.kill()
            process.join()
            pipe.close()


def _ask(
    pipe: Connection, process: fork_server.Worker, waiting: Iterator[tuple[Key, tuple[Any, ...]]]
) -> dict[Connection, Key]:
    for key, question in waiting:
        _tell(pipe, process, question)
        return {pipe: key}
    return {}


def _tell(pipe: Connection, process: fork_server.Worker, message: Any) -> None:
    try:
        pipe.send(message)
    except OSError:  # nobody is there to read it
        raise _death_of(process) from None


def _hear(pipe: Connection, process: fork_server.Worker) -> Any:
    try:
        found, error = pipe.recv()
    except (EOFError, OSError):
        raise _death_of(process) from None
    if error is not None:
        raise error
    return found


def _death_of(process: fork_server.Worker) -> SwarmError:
    process.join(1.0)
    return SwarmError(
        f"a process that shared the work died with exit status {process.exitcode}: in a script of your own call this below "
        "`if __name__ == '__main__':`, which keeps its processes from running it again; if memory is short, ask for fewer "
        "workers"
    )


def _work(pipe: Connection, answer: Callable[..., Any]) -> None:
    begin, arguments = pipe.recv()
    _, problem = _tried(begin, arguments)
    while True:
        question = pipe.recv()
        pipe.send(_tried(answer, question) if problem is None else (None, problem))


def _tried(call: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, Exception | None]:
    """What a call gives, or what it raises."""
    try:
        return call(*arguments), None
    except Exception as error:
        return None, error
