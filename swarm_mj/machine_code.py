"""Functions compiled by Numba whose machine code is kept on disk, also where what lies there is of no use any more.

Numba finds what it kept by the file and line of a function, and reads it before it looks at its age. Machine code of an earlier
version may name types that have gone elsewhere since; its index may be cut off. Both would end the program.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class _Kept(FunctionCache):
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever unpickling may raise
            self.flush()
            return None


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function by Numba when it is first called, as `typing.kernel` says, with more of its options.

    Args:
        function: Python function.
        options: Of `numba.njit`.
    """
    dispatcher = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    dispatcher._cache = _Kept(function)  # what cache=True does with Numba's own class
    return dispatcher
