"""Turns the processor's compiled functions into functions of a GPU: the same sources, no second copy of any of them.

A function is copied with globals of its own, in which whatever it calls of this package is replaced by a device function made
the same way. A few things are replaced by others: functions that only a processor can call (`substitutes`), NumPy's functions
of numbers by those of `math`, and enumerations by modules of whole numbers, which index arrays on a device.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

#: What numba-cuda compiles of a number, by NumPy's name.
_OF_NUMBERS = {
    "isfinite": math.isfinite,
    "sqrt": math.sqrt,
    "cos": math.cos,
    "sin": math.sin,
    "arctan2": math.atan2,
    "pi": math.pi,
}


class DeviceCode:
    """Makes device functions, each once.

    Args:
        decorate: What makes a device function of a Python function, such as `cuda.jit(device=True)`.
        substitutes: Functions to take in place of others.
        compiled: Whether they are compiled; in CUDA's simulator they stay what they are in Python.
    """

    def __init__(
        self, decorate: Callable[[Any], Any], substitutes: Mapping[Any, Any], *, compiled: bool = True
    ) -> None:
        self._decorate, self._compiled = decorate, compiled
        self._substitutes = {id(_plain(there)): _plain(here) for there, here in substitutes.items()}
        self._made: dict[Any, Any] = {}
        self._numpy = _module("numpy", _OF_NUMBERS)

    def of(self, function: Any) -> Any:
        """The device function of a function, compiled or not."""
        source = self._substitutes.get(id(_plain(function)), _plain(function))
        if source not in self._made:
            copy = self.copied(source)
            self._made[source] = self._decorate(copy)
        return self._made[source]

    def copied(self, source: Any, **names: Any) -> FunctionType:
        """A copy of a plain function that calls device functions, for kernels, which are decorated in another way.

        Args:
            source: The function.
            names: Functions that it finds among its globals besides.
        """
        found = source.__globals__ | names
        copy = FunctionType(source.__code__, found, source.__name__, source.__defaults__, source.__closure__)
        copy.__module__, copy.__qualname__ = source.__module__, source.__qualname__
        for name in _names(source.__code__):
            if name in found:
                found[name] = self._replaced(found[name], source)
        return copy

    def _replaced(self, value: Any, source: Any) -> Any:
        plain = _plain(value)
        if id(plain) in self._substitutes or (isinstance(plain, FunctionType) and _package(plain) in _own(source)):
            return self.of(plain)
        if self._compiled and value is np:
            return self._numpy
        if self._compiled and isinstance(value, type) and issubclass(value, IntEnum):
            return _module(value.__name__, {member.name: int(member) for member in value})
        return value


def slicer(like: Any) -> Callable[[Any, int], Any]:
    """Write a function `(arrays, e)` for device code: the same nested named tuples with row e alone of every array.

    A thread sees its own flight as a batch of one, and so calls what the processor calls for many.

    Args:
        like: Named tuples of arrays, or of such tuples.
    """
    kinds: dict[str, Any] = {}

    def written(value: Any, name: str) -> str:
        if not isinstance(value, tuple):
            return f"{name}[e : e + 1]"
        kind: Any = type(value)
        kinds[kind.__name__] = kind
        return f"{kind.__name__}({', '.join(written(getattr(value, each), f'{name}.{each}') for each in kind._fields)})"

    text = f"def row(arrays, e):\n    return {written(like, 'arrays')}\n"
    exec(text, kinds)  # names of fields alone
    row: Callable[[Any, int], Any] = kinds["row"]
    row.__module__ = __name__
    return row


def _plain(function: Any) -> Any:
    """The Python function under a compiled one."""
    return getattr(function, "py_func", function)


def _package(function: Any) -> str:
    return str(function.__module__).partition(".")[0]


def _own(source: Any) -> set[str]:
    """Packages whose functions are translated where a function calls them: this one, and that of a plug-in itself."""
    return {_package(_plain), _package(source)}


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function may look up among its globals."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _module(name: str, members: Mapping[str, Any]) -> ModuleType:
    made = ModuleType(name)
    vars(made).update(members)
    return made
