"""Processes of this machine that begin with everything loaded: forks of one that has imported it once.

Importing takes ten times as long as a short flight, so that processes which each did it for themselves would do little else.
A fork of this process would share its OpenGL context and its threads, which do not survive one; the process that is forked, see
`fork_server_main.py`, has neither. Elsewhere than on Linux system libraries do not survive a fork either, and each process is a
new interpreter that imports for itself. Nothing heavy is imported here.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any, Protocol

from swarm_mj.io.cores import ONE_THREAD
from swarm_mj.io.interruption import held

#: Whether processes may be forks.
FORKS = sys.platform == "linux"
#: What the process that is forked runs; it finds modules where this one does.
_SERVE = "import sys; sys.path[:] = {path!r}; from swarm_mj.io.fork_server_main import serve; serve({fd}, {modules!r})"
#: Numbers go through pipes as so many bytes.
NUMBER = 8


class Worker(Protocol):
    """A process that works for this one."""

    @property
    def pid(self) -> int | None:
        """Its number."""

    @property
    def exitcode(self) -> int | None:
        """How it ended, as `multiprocessing.Process` tells it; None: it has not."""

    def kill(self) -> None:
        """End it at once."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended, or for so long [s]."""


def begin(
    work: Callable[..., object], arguments: tuple[Any, ...], *, modules: Sequence[str]
) -> tuple[Worker, Connection]:
    """Start a process that calls `work(pipe, *arguments)` on one core, deaf to Ctrl-C, and ends with it.

    It ends as well, without a word, when `work` finds its pipe closed at the other end.

    Args:
        work: Of the top level of a module.
        arguments: What can be pickled.
        modules: What processes should have loaded; those that are forks of one that is there already load what it has not.

    Returns:
        The process, and this one's end of the pipe.
    """
    mine, theirs = multiprocessing.Pipe()
    try:
        if FORKS:
            with suppress(OSError):  # where none can be had, a new interpreter is
                with one_thread():
                    fork = _fork_server(modules).fork(theirs)
                    mine.send((dict(os.environ), os.getcwd(), list(sys.path), work, arguments))
                return fork, mine
        with held(), one_thread():  # half-started it could not be killed
            context = multiprocessing.get_context("spawn")
            process = context.Process(target=live, args=(theirs, work, arguments), daemon=True)
            process.start()
        return process, mine
    except BaseException:
        mine.close()
        raise
    finally:
        theirs.close()


def live(pipe: Connection, work: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """What a process of `begin` does."""
    # Ctrl-C reaches the whole group of processes; the one that started them decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):  # nobody listens any more
        work(pipe, *arguments)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes that are started meanwhile keep to one core."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        _restore(before)


def _restore(before: Mapping[str, str | None]) -> None:
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


class _ForkServer:
    """The process that is forked, and the socket over which it is asked to."""

    def __init__(self, modules: Sequence[str]) -> None:
        self._socket, theirs = socket.socketpair()
        code = _SERVE.format(path=sys.path, fd=theirs.fileno(), modules=tuple(modules))
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                # It opens no window, for which mujoco would get ready.
                env=os.environ | {"MUJOCO_GL": "disable"},
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,  # Ctrl-C while it imports is not for it
            )

    @property
    def is_there(self) -> bool:
        return self._process.poll() is None

    def fork(self, pipe: Connection) -> _Fork:
        """Ask for a process with this end of a pipe; does not wait for it.

        Raises:
            OSError: The fork server is gone.
        """
        told, tell = os.pipe()
        try:
            socket.send_fds(self._socket, [b"1"], [pipe.fileno(), tell])
        except BaseException:
            os.close(told)
            raise
        finally:
            os.close(tell)
        return _Fork(told)

    def end(self) -> None:
        """End it and all its processes."""
        self._socket.close()
        self._process.kill()
        self._process.wait()


class _Fork:
    """A process of the fork server, which tells of its birth and of its end through a pipe."""

    def __init__(self, told: int) -> None:
        self._told: int | None = told
        self._pid: int | None = None
        self._exitcode: int | None = None

    def __del__(self) -> None:
        self._close()

    @property
    def pid(self) -> int | None:
        self._hear(0.0)
        return self._pid

    @property
    def exitcode(self) -> int | None:
        self._hear(0.0)
        return self._exitcode

    def kill(self) -> None:
        """End it at once; one that is not born yet ends when it finds its pipe closed."""
        self._hear(0.0)
        # One whose end was told is not meant: its number may be another process's by now.
        if self._pid is not None and self._exitcode is None:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)

    def join(self, timeout: float | None = None) -> None:
        """See `Worker.join`; nobody waits for one that is not born yet."""
        if self.pid is not None:
            self._hear(timeout)

    def _hear(self, timeout: float | None) -> None:
        """Hear what is told; without a limit of time, until all is."""
        while self._told is not None and select.select([self._told], [], [], timeout)[0]:
            told = os.read(self._told, NUMBER)
            if not told:
                self._exitcode = -signal.SIGKILL  # with the fork server
            elif self._pid is None:
                self._pid = int.from_bytes(told, "little")
                continue
            else:
                self._exitcode = int.from_bytes(told, "little", signed=True)
            self._close()

    def _close(self) -> None:
        if self._told is not None:
            os.close(self._told)
            self._told = None


#: The fork server of this process, by its number: a fork of this process has none.
_SERVERS: dict[int, _ForkServer] = {}
_MAKING = Lock()


def _fork_server(modules: Sequence[str]) -> _ForkServer:
    with _MAKING:
        found = _SERVERS.get(os.getpid())
        if found is None or not found.is_there:
            _SERVERS[os.getpid()] = found = _ForkServer(modules)
        return found


@atexit.register
def _end() -> None:
    if (fork_server := _SERVERS.pop(os.getpid(), None)) is not None:
        fork_server.end()
