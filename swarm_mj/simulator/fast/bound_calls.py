"""Kernels bound to their arguments, for compiled code to call: nothing is handed over again, and nothing compiled twice.

Every array that Python hands to compiled code costs a third of a microsecond, and the kernel of a flight takes hundreds; and a
kernel that calls another one is compiled with all that the other one calls. So arrays are described once, as words of eight
bytes (addresses, shapes, strides, numbers), and the other kernel is called by the address of its machine code.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.extending import NativeValue, intrinsic, models, register_model, unbox
from numba.np.arrayobj import make_array, populate_array

from swarm_mj.typing import Ints, kernel

_WORD = ir.IntType(64)


class BoundType(types.Type):
    """Of a bound kernel, for Numba.

    Args:
        bound: Types of the arguments that it is bound to, the first ones.
        free: Types of those that are given in the call.
        answer: Of what it returns.
    """

    def __init__(self, bound: Any, free: Any, answer: Any) -> None:
        self.bound, self.free, self.answer = tuple(bound), tuple(free), answer
        super().__init__(name=f"BoundCall({self.bound}, {self.free}, {self.answer})")


class BoundCall:
    """A kernel and the arguments that it will be called with; they live as long as this, and their arrays must not be replaced.

    Args:
        kernel: A compiled function.
        arguments: Arrays, numbers, other bound calls, and tuples of these: its first arguments.
        free: Types of the other ones, `numba.types`.

    Attributes:
        at: Address of the machine code and of the words that describe the arguments, shape (2,).
    """

    def __init__(self, kernel: Any, arguments: tuple[Any, ...], free: tuple[Any, ...] = ()) -> None:
        bound = tuple(map(typeof, arguments))
        kernel.compile((*bound, *free))
        compiled = kernel.overloads[*bound, *free]
        self._kept, self._words = arguments, np.array([*_words(arguments), 0], np.int64)
        machine_code = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        self.at: Ints = np.array([machine_code, self._words.ctypes.data], np.int64)
        self._numba_type_ = BoundType(bound, free, compiled.signature.return_type)

    def __call__(self, *free: Any) -> Any:
        """Call it from Python with the other arguments: what it is bound to is not handed over."""
        return _call_it(self, self.at, free)

    @property
    def kind(self) -> BoundType:
        """What compiled code must know to call it; others of the same kind can be called in its place, see `at`."""
        return self._numba_type_


def _words(value: Any) -> Iterator[int]:
    if isinstance(value, BoundCall):
        yield from value.at.tolist()
    elif isinstance(value, np.ndarray):
        yield from (value.ctypes.data, value.itemsize, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        for part in value:
            yield from _words(part)
    elif isinstance(value, float):
        yield struct.unpack("q", struct.pack("d", value))[0]
    else:
        yield int(value)


class _Reader:
    """Makes values of types again from the words at an address, where code is generated."""

    def __init__(self, context: Any, builder: Any, address: Any) -> None:
        self._context, self._builder, self._read = context, builder, 0
        self._words = builder.inttoptr(address, _WORD.as_pointer())

    def word(self) -> Any:
        place = self._builder.gep(self._words, [_WORD(self._read)])
        self._read += 1
        return self._builder.load(place)

    def value(self, kind: Any) -> Any:
        context, builder = self._context, self._builder
        if isinstance(kind, types.Array):
            return self._array(kind)
        if isinstance(kind, types.BaseTuple):
            return context.make_tuple(builder, kind, [self.value(part) for part in kind])
        if isinstance(kind, BoundType):
            call = cgutils.create_struct_proxy(kind)(context, builder)
            call.function, call.arguments = self.word(), self.word()
            return call._getvalue()
        if isinstance(kind, types.Float):
            return builder.bitcast(self.word(), ir.DoubleType())
        assert isinstance(kind, types.Integer | types.Boolean), kind
        return builder.trunc(self.word(), context.get_value_type(kind))

    def _array(self, kind: Any) -> Any:
        context, builder = self._context, self._builder
        array = make_array(kind)(context, builder)
        data, itemsize = self.word(), self.word()
        shape, strides = ([self.word() for _ in range(kind.ndim)] for _ in range(2))
        data = builder.inttoptr(data, array.data.type)
        # No owner: whoever bound the call keeps the arrays.
        populate_array(array, data, shape, strides, itemsize, None)
        return array._getvalue()


@register_model(BoundType)
class _BoundModel(models.StructModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, [("function", types.int64), ("arguments", types.int64)])


@unbox(BoundType)
def _unbox(kind: Any, given: Any, c: Any) -> Any:
    """Only the type is taken: compiled code reads the addresses from where they are bound, or is given them."""
    return NativeValue(cgutils.create_struct_proxy(kind)(c.context, c.builder)._getvalue())


@intrinsic
def call(typing_context: Any, bound: Any, free: Any) -> tuple[Any, Any]:
    """Call a bound kernel; returns its answer.

    Args:
        typing_context: Numba's.
        bound: The kernel.
        free: The arguments that it is not bound to, a tuple.
    """
    return bound.answer(bound, free), _call


@intrinsic
def call_at(typing_context: Any, like: Any, at: Any, free: Any) -> tuple[Any, Any]:
    """Call another bound kernel of the same kind.

    Args:
        typing_context: Numba's.
        like: One of its kind.
        at: Its addresses, see `BoundCall`, shape (2,).
        free: See `call`.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind, kind_of_at = signature.args[:2]
        array = make_array(kind_of_at)(context, builder, arguments[1])
        words = (builder.load(builder.gep(array.data, [_WORD(k)])) for k in range(2))
        bound = cgutils.create_struct_proxy(kind)(context, builder)
        bound.function, bound.arguments = words
        rest = signature.return_type(kind, signature.args[2])
        return _call(context, builder, rest, (bound._getvalue(), arguments[2]))

    assert at.ndim == 1 and at.layout == "C" and at.dtype == types.int64, at
    return like.answer(like, at, free), generate


def _call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, given = signature.args
    bound = cgutils.create_struct_proxy(kind)(context, builder, arguments[0])
    reader = _Reader(context, builder, bound.arguments)
    values = [reader.value(each) for each in kind.bound]
    for k, (has, wants) in enumerate(zip(given, kind.free, strict=True)):
        values.append(context.cast(builder, builder.extract_value(arguments[1], k), has, wants))
    kinds = (*kind.bound, *kind.free)
    function = context.call_conv.get_function_type(kind.answer, kinds)
    callee = builder.inttoptr(bound.function, function.as_pointer())
    status, answer = context.call_conv.call_function(builder, callee, kind.answer, kinds, values)
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return answer


@kernel
def _call_it(bound: Any, at: Ints, free: Any) -> Any:
    return call_at(bound, at, free)
