"""The process that is forked for others, see `fork_server.py`: it imports, then forks for every message on its socket.

A message is one byte with two files: the pipe of the new process, and one that is told its number and how it ended. When the
socket closes, whoever asked is gone, and all end. Nothing here opens a GL context or starts a thread.
"""

from __future__ import annotations

import gc
import importlib
import os
import select
import signal
import socket
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection

from swarm_mj.io.fork_server import NUMBER, live


def serve(fd: int, modules: Sequence[str]) -> None:
    """Fork for every message until the socket closes.

    Args:
        fd: The socket.
        modules: What is imported first; what is not installed is left out.
    """
    for name in modules:
        with suppress(ImportError):
            importlib.import_module(name)
    gc.collect()
    gc.freeze()  # what is there stays, and processes need not look at it
    ear, mouth = os.pipe()
    os.set_blocking(mouth, False)
    signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    tell: dict[int, int] = {}  # for every process, where its end is told
    asked = socket.socket(fileno=fd)
    while True:
        ready = select.select([asked.fileno(), ear], [], [])[0]
        if ear in ready:
            os.read(ear, 4096)
            _tell_of_ends(tell)
        if asked.fileno() in ready:
            files = _heard(asked)
            if files is None:
                break
            child = os.fork()
            if not child:
                for other in (fd, ear, mouth, *tell.values(), files[1]):
                    os.close(other)
                _become(files[0])
            os.close(files[0])
            tell[child] = files[1]
            _write(files[1], child)
    for child in tell:
        os.kill(child, signal.SIGKILL)


def _heard(asked: socket.socket) -> list[int] | None:
    """The files that come with a message; None: there are none any more."""
    try:
        message, files, _, _ = socket.recv_fds(asked, 1, 2)
    except ConnectionError:
        return None
    return files if message else None


def _tell_of_ends(tell: dict[int, int]) -> None:
    while tell:
        child, status = os.waitpid(-1, os.WNOHANG)
        if not child:
            return
        _write(tell[child], os.waitstatus_to_exitcode(status))
        os.close(tell.pop(child))


def _write(file: int, number: int) -> None:
    with suppress(OSError):  # nobody wants to know
        os.write(file, number.to_bytes(NUMBER, "little", signed=True))


def _become(file: int) -> None:
    """Be the process that was asked for; does not return."""
    status = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with Connection(file) as pipe, suppress(EOFError, OSError):
            environment, folder, path, work, arguments = pipe.recv()
            os.environ.clear()
            os.environ.update(environment)
            os.chdir(folder)
            sys.path[:] = path
            live(pipe, work, arguments)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
