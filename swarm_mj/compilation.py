"""Decorators of compiled functions: Numba, its options, and where machine code is kept.

Numba is imported when the first function is decorated.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from swarm_mj import __version__

#: Another one after an upgrade: the package's version and when its files were written.
INSTALLATION = f"{__version__}-{Path(__file__).with_name('__init__.py').stat().st_mtime_ns:x}"

_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function by Numba when it is first called, and keep the machine code on disk beside the function's own file.

    It runs without Python's global lock, and divides as NumPy does: by zero to inf or nan instead of an exception. It gets no
    wrapper for C, which nobody calls and which takes a tenth of the time of compiling.
    """
    return _compiled(function, _nrt=True)  # whoever calls it: one without the runtime would pass its own choice on


def allocation_free(function: Callable[..., Any]) -> Any:
    """The same for a kernel that makes no arrays and returns none: it counts no references to those that it is given.

    Numba counts one for every row that is looked at, which takes a tenth of the time of a flight.
    """
    return _compiled(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """Write a part of a kernel out where it is called, instead of compiling it as a function of its own.

    For parts with one or two callers that are given many arrays: the machine code is the same, and takes less time to compile.
    """
    return _compiled(function, inline="always")


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile as `kernel` says, with more options of `numba.njit`.

    Numba finds what it kept by this name and reads it before it looks at its age. After an upgrade it would fail on types that
    have since moved, so that each installation has names of its own.
    """
    from numba import njit

    function.__qualname__ += f"-{INSTALLATION}"
    return njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, cache=True, **options)(function)


def jittable(function: _Function) -> _Function:
    """Let compiled code call a plain function as well, so that one statement of a rule serves arrays and kernels alike.

    In Python it stays what it is and takes NumPy's arrays; a kernel that calls it gets it compiled for numbers. Its body must
    therefore be valid for both: `&` and `|` instead of `and` and `or`.

    What only kernels call compiles in half the time so, without a way in from Python and without files of its own; but it is
    compiled again for every kernel that is. A long function that several kernels call is better a kernel.
    """
    from numba.extending import register_jitable

    return register_jitable(error_model="numpy")(function)
