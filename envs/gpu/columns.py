"""Memory of E flights, the flight innermost: neighbouring threads read neighbouring numbers, which a GPU fetches together.

All numbers of a type stand in one table, a column per flight, and arrays are strided views of it. So a flight is started anew
by copying columns, whatever there is in them.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class Tables(NamedTuple):
    """All that E flights are, by type; shape (any, E) each.

    Attributes:
        numbers: Double precision.
        whole: Whole numbers.
        flags: Booleans.
        singles: Single precision.
        small: Whole numbers of a byte.
    """

    numbers: Any
    whole: Any
    flags: Any
    singles: Any
    small: Any


_TYPES = Tables(*map(np.dtype, (np.float64, np.int64, np.bool_, np.float32, np.int8)))


class Memory(Protocol):
    """Where tables stand."""

    def empty(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> Any:
        """A table of anything."""
        ...

    def put(self, table: NDArray[Any]) -> Any:
        """A copy of an array there, C-contiguous."""
        ...

    def write(self, array: Any, values: NDArray[Any]) -> None:
        """Copy values into an array there whose numbers lie side by side."""
        ...

    def view(self, table: Any, rows: slice, shape: tuple[int, ...]) -> Any:
        """Rows of a table, shape (r, E), as an array of shape (E, *shape)."""
        ...

    def adopt(self, array: Any, shape: tuple[int, ...] | None) -> Any:
        """Somebody's array of whole numbers on the device, of that shape, without a copy."""
        ...


class Columns:
    """Where each array of one flight stands in tables.

    Args:
        one: Of a single flight: named tuples, nested as may be, of arrays with 1 in front. Arrays that share memory in whole
            share it here, too, whatever their shapes.
    """

    def __init__(self, one: Any) -> None:
        self._one = one
        self._rows: dict[tuple[int, int], slice] = {}
        self._tops = dict.fromkeys(_TYPES, 0)
        self._place(one)

    def _place(self, value: Any) -> None:
        if isinstance(value, tuple):
            for each in value:
                self._place(each)
        elif _key(value) not in self._rows:
            top = self._tops[value.dtype]
            self._rows[_key(value)] = slice(top, top + value.size)
            self._tops[value.dtype] += value.size

    def _height(self, dtype: np.dtype[Any]) -> int:
        """Rows of a table; one where nothing is in it, because drivers know no empty memory."""
        return max(1, self._tops[dtype])

    def filled(self, count: int) -> Tables:
        """Tables of that many flights on the processor, each as the one given."""
        tables = Tables(*(np.zeros((self._height(dtype), count), dtype) for dtype in _TYPES))
        self.write(tables, slice(None), self._one)
        return tables

    def empty(self, count: int, memory: Memory) -> Tables:
        """Tables of that many flights there, of anything."""
        return Tables(*(memory.empty((self._height(dtype), count), dtype) for dtype in _TYPES))

    def write(self, tables: Tables, e: Any, value: Any) -> None:
        """Write flight e: of the same shape as the one given."""
        self._write(tables, e, self._one, value)

    def _write(self, tables: Tables, e: Any, one: Any, value: Any) -> None:
        if isinstance(one, tuple):
            for inner, given in zip(one, value, strict=True):
                self._write(tables, e, inner, given)
        else:
            table, rows = tables[_TYPES.index(one.dtype)], self._rows[_key(one)]
            column = np.asarray(value, one.dtype).reshape(-1)
            table[rows, e] = column[:, None] if isinstance(e, slice) else column

    def views(self, tables: Tables, memory: Memory) -> Any:
        """The named tuples with arrays of all flights of the tables."""
        return self._views(self._one, tables, memory)

    def _views(self, one: Any, tables: Tables, memory: Memory) -> Any:
        if isinstance(one, tuple):
            return type(one)(*(self._views(each, tables, memory) for each in one))
        return memory.view(tables[_TYPES.index(one.dtype)], self._rows[_key(one)], one.shape[1:])


def _key(array: NDArray[Any]) -> tuple[int, int]:
    return int(array.__array_interface__["data"][0]), array.nbytes
