"""The command line `swarm-mj`.

Commands are imported when the parser is built, after Ctrl-C has a handler, and heavy modules by the commands that need them,
so that help is quick.
"""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from swarm_mj import __version__
from swarm_mj.errors import SwarmError
from swarm_mj.io.interruption import INTERRUPTED, handled
from swarm_mj.io.machine import keep_algebra_on_one_thread

if TYPE_CHECKING:
    import argparse


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status.

    0: done; 1: a check failed; 2: bad input or another named error; 130: interrupted.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # results may lie at such paths, see `_report`
    atexit.register(gc.freeze)  # a search for garbage in machine code and arrays would delay the end by a second
    keep_algebra_on_one_thread()
    if argv is None:  # a program of its own, not a caller's
        # Interpreters that libraries start, as glfw does while it is imported, are to import nothing of the current folder.
        os.environ.setdefault("PYTHONSAFEPATH", "1")
    with handled(_interrupted) as interruption:
        try:
            if argv is None:
                _refuse_settings_of_the_folder()
            arguments = _parser().parse_args(argv)
            return int(arguments.command(arguments) or 0)
        except BaseException as error:
            # What was asked to end may end in any error: Ctrl-C in the middle of a library is often turned into another one.
            if interruption.asked or isinstance(error, KeyboardInterrupt):
                return _interrupted()
            if isinstance(error, SwarmError):
                return _report(2, f"swarm-mj: error: {error}")
            if isinstance(error, MemoryError):
                return _report(2, "swarm-mj: error: not enough memory for this; ask for less")
            if isinstance(error, BrokenPipeError):
                return 0
            if isinstance(error, Exception) and (fault := _opengl_fault()):
                return _report(2, f"swarm-mj: error: {fault}")
            raise


def _refuse_settings_of_the_folder() -> None:
    """See that libraries find no settings in the current folder, with which they would write files and run programs."""
    for name, library in ((".numba_config.yaml", "Numba"), ("matplotlibrc", "Matplotlib")):
        if os.path.lexists(name) and not os.path.isdir(name):  # folders of these names are obeyed by neither
            raise SwarmError(
                f"{name}: {library} would obey this file of the current folder; rename it, or run elsewhere"
            )


def _opengl_fault() -> str:
    """Why MuJoCo cannot be imported with what MUJOCO_GL asks for: a wrong value, or a library that is missing; else nothing."""
    asked = os.environ.get("MUJOCO_GL")
    if asked and "mujoco" not in sys.modules:
        try:
            import mujoco  # noqa: F401
        except Exception as error:
            return (
                f"MUJOCO_GL = {asked!r}: MuJoCo cannot be loaded with it ({error}); unset it or set egl, glfw or osmesa"
            )
    return ""


def _interrupted() -> int:
    return _report(INTERRUPTED, "\nswarm-mj: interrupted; nothing half-written was left behind")


def _report(status: int, words: str) -> int:
    # A path may hold bytes that are no text of this system.
    print(words.encode("utf-8", "backslashreplace").decode(), file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    import argparse

    from swarm_mj.cli import campaign, checks, fly, ideas, names, observe, results, shape

    parser = argparse.ArgumentParser(
        prog="swarm-mj", description="Fly CubeSat swarms past small bodies and measure what their cameras see."
    )
    parser.add_argument("--version", action="version", version=f"swarm-mj {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (fly, campaign, ideas, results, observe, checks, names, shape):
        module.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
