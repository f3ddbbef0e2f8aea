"""Several spacecraft side by side: numbers of eight at once, for kernels whose arithmetic is the same for each.

A processor divides eight numbers in little more than the time of one, but compilers see it in the simplest loops alone. So
`Lanes` is a number to kernels, a vector register to the processor: the functions of `algebra` take it as they take floats.
Every lane is rounded as the number alone would be (nothing is contracted or reordered), so that results do not depend on how
many spacecraft there are. Where rules differ between cases, `select` picks by lane, and `some` tells whether a case occurs.

The functions of this module are what they are in Python, for one spacecraft at a time, on a GPU too, where every flight has a
thread; Numba's code for the processor takes `WIDTH` at once.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model
from numba.np.arrayobj import make_array

from swarm_mj.typing import Array, Mask

#: Numbers side by side.
WIDTH = 8
_HALF, _WORD = ir.IntType(32), ir.IntType(64)
_FLOATS, _FLAGS = ir.VectorType(ir.DoubleType(), WIDTH), ir.VectorType(ir.IntType(1), WIDTH)


class LanesType(types.Type):
    """Of eight numbers, for Numba."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class FlagsType(types.Type):
    """Of eight truth values, for Numba."""

    def __init__(self) -> None:
        super().__init__(name="Flags")


LANES, FLAGS = LanesType(), FlagsType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, _FLOATS)


@register_model(FlagsType)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, kind: Any) -> None:
        super().__init__(dmm, kind, _FLAGS)


def _teach(function: Any, accepts: Any, kinds: Any, write: Any) -> None:
    """Teach Numba a function.

    Args:
        function: What kernels call.
        accepts: From the types of the arguments to that of the answer; None where it is not meant.
        kinds: Lists of argument types for which code is written.
        write: Writes it: from context, builder, types and values to the answer.
    """

    @infer_global(function)
    class Known(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            answer = accepts(*args)
            return None if answer is None else signature(answer, *args)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return write(context, builder, signature.args, arguments)

    for each in kinds:
        lower_builtin(function, *each)(generate)


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    """A number in every lane, where it is not one of lanes."""
    if kind == LANES:
        return value
    whole = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), value, _HALF(0))
    return builder.shuffle_vector(whole, whole, ir.Constant(ir.VectorType(_HALF, WIDTH), [0] * WIDTH))


_PAIRS = [(LANES, LANES), (LANES, types.float64), (types.float64, LANES)]


def _teach_pair(function: Any, answer: Any, write: Any) -> None:
    """A function of two numbers, of which one at least is of lanes."""

    def both(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
        return write(builder, *(_spread(builder, *each) for each in zip(values, kinds, strict=True)))

    _teach(function, lambda *args: answer if args in _PAIRS else None, _PAIRS, both)


_teach_pair(operator.add, LANES, lambda builder, a, b: builder.fadd(a, b))
_teach_pair(operator.sub, LANES, lambda builder, a, b: builder.fsub(a, b))
_teach_pair(operator.mul, LANES, lambda builder, a, b: builder.fmul(a, b))
_teach_pair(operator.truediv, LANES, lambda builder, a, b: builder.fdiv(a, b))
_function: Any
for _function, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _teach_pair(_function, FLAGS, lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b))
_teach_pair(operator.ne, FLAGS, lambda builder, a, b: builder.fcmp_unordered("!=", a, b))
# As Numba has them of floats: the first one stays unless the second one is beyond.
_teach_pair(min, LANES, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", b, a), b, a))
_teach_pair(max, LANES, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", b, a), b, a))


def _teach_one(function: Any, name: str) -> None:
    """A function of one number, by the name of LLVM's; empty: its negative."""

    def write(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
        if not name:
            return builder.fneg(values[0])
        kind = ir.FunctionType(_FLOATS, [_FLOATS])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64"), values)

    _teach(function, lambda *args: LANES if args == (LANES,) else None, [(LANES,)], write)


_teach_one(operator.neg, "")
for _function, _name in ((abs, "fabs"), (math.sqrt, "sqrt"), (math.cos, "cos"), (math.sin, "sin")):
    _teach_one(_function, _name)


def _teach_one_by_one(function: Any, count: int) -> None:
    """A function of so many numbers that no processor has, lane by lane."""
    alone = signature(types.float64, *[types.float64] * count)

    def write(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
        call, lanes = context.get_function(function, alone), ir.Constant(_FLOATS, ir.Undefined)
        for lane in range(WIDTH):
            answer = call(builder, [builder.extract_element(value, _HALF(lane)) for value in values])
            lanes = builder.insert_element(lanes, answer, _HALF(lane))
        return lanes

    _teach(function, lambda *args: LANES if args == (LANES,) * count else None, [(LANES,) * count], write)


for _function, _count in ((math.atan2, 2), (math.exp, 1), (math.log, 1)):
    _teach_one_by_one(_function, _count)
for _function, _name in ((operator.and_, "and_"), (operator.or_, "or_")):
    _teach(
        _function,
        lambda *args: FLAGS if args == (FLAGS, FLAGS) else None,
        [(FLAGS, FLAGS)],
        lambda context, builder, kinds, values, name=_name: getattr(builder, name)(*values),
    )


class _Rows:
    """Every `step`-th row of an array from one on, where code is written; the first one again where there are no more."""

    def __init__(self, context: Any, builder: Any, kinds: Any, values: Any) -> None:
        self._builder = builder
        self._array = make_array(kinds[0])(context, builder, values[0])
        words = [context.cast(builder, *each, types.int64) for each in zip(values[1:], kinds[1:], strict=True)]
        (first, step), self._inner = words[:2], words[2:]
        self._strides = cgutils.unpack_tuple(builder, self._array.strides)
        if kinds[0].layout == "C":
            self._strides[-1] = _WORD(context.get_abi_sizeof(context.get_data_type(kinds[0].dtype)))
        count = cgutils.unpack_tuple(builder, self._array.shape)[0]
        self._first, step = (builder.mul(number, self._strides[0]) for number in (first, step))
        end = builder.mul(count, self._strides[0])
        self._row = [self._first]
        for _ in range(1, WIDTH):
            self._row.append(builder.add(self._row[-1], step))
        self._there = [builder.icmp_signed("<", row, end) for row in self._row]

    def _pointer(self, row: Any, inner: Any) -> Any:
        """Where an entry stands, from the bytes to its row and its places in it."""
        builder = self._builder
        for index, stride in zip(inner, self._strides[1:], strict=True):
            row = builder.add(row, builder.mul(index, stride))
        return cgutils.pointer_add(builder, self._array.data, row)

    def read(self) -> Any:
        """The entry of all lanes as a vector."""
        builder, values = self._builder, []
        for row, there in zip(self._row, self._there, strict=True):
            values.append(builder.load(self._pointer(builder.select(there, row, self._first), self._inner)))
        lanes = ir.Constant(ir.VectorType(values[0].type, WIDTH), ir.Undefined)
        for lane, value in enumerate(values):
            lanes = builder.insert_element(lanes, value, _HALF(lane))
        return _as_lanes(builder, lanes)

    def write(self, values: Any) -> None:
        """Entries one after the other, of the lanes that have a row; of the array itself if that has one dimension."""
        builder, end = self._builder, self._builder.append_basic_block("written")
        for lane, (row, there) in enumerate(zip(self._row, self._there, strict=True)):
            block = builder.append_basic_block("row")
            builder.cbranch(there, block, end)
            builder.position_at_end(block)
            for i, value in enumerate(values):
                inner = [_WORD(i)] if len(self._strides) == 2 else []
                at = row if inner else builder.add(row, builder.mul(_WORD(i), self._strides[0]))
                builder.store(builder.extract_element(value, _HALF(lane)), self._pointer(at, inner))
        builder.branch(end)
        builder.position_at_end(end)


def _as_lanes(builder: Any, values: Any) -> Any:
    """Numbers as they are; truth values, of a byte each, as bits."""
    return values if values.type == _FLOATS else builder.icmp_unsigned("!=", values, ir.Constant(values.type, None))


def room(n: int) -> int:
    """Places for n spacecraft in arrays that `abreast` reads: whole groups of `WIDTH`."""
    return -(-n // WIDTH) * WIDTH


def width() -> int:
    """As many spacecraft as are taken at once, the step of a loop over them."""
    return 1


def number(values: Array, first: int, step: int) -> Any:
    """Every `step`-th number from one on, for as many spacecraft as are taken at once; the first where there are no more."""
    return values[first]


def column(rows: Array, first: int, step: int, k: int) -> Any:
    """The same of entry k of rows."""
    return rows[first, k]


def cell(tensors: Array, first: int, step: int, k: int, m: int) -> Any:
    """The same of an entry of matrices."""
    return tensors[first, k, m]


def abreast(values: Array | Mask, first: int) -> Any:
    """The same of numbers or truth values side by side, in a contiguous array of shape (`room(n)`,)."""
    return values[first]


def chosen(flags: Mask, first: int, step: int) -> Any:
    """The same of truth values."""
    return flags[first]


def put_numbers(array: Array, first: int, step: int, values: tuple[Any, ...]) -> None:
    """Write numbers one after the other from every `step`-th place on, for the spacecraft that there are."""
    for k in range(len(values)):
        array[first + k] = values[k]


def put_columns(rows: Array, first: int, step: int, values: tuple[Any, ...]) -> None:
    """Write the first entries of every `step`-th row, for the spacecraft that there are."""
    for k in range(len(values)):
        rows[first, k] = values[k]


def put_abreast(rows: Array, first: int, values: tuple[Any, ...]) -> None:
    """Write the first rows of an array of shape (rows, `room(n)`), from one place on, whether there is a spacecraft or not."""
    for k in range(len(values)):
        rows[k, first] = values[k]


def select(flags: Any, a: Any, b: Any) -> Any:
    """The number a where a flag is set, otherwise b."""
    return a if flags else b


def some(flags: Any) -> bool:
    """Whether any flag is set."""
    return bool(flags)


def every(flags: Any) -> bool:
    """Whether all flags are set."""
    return bool(flags)


def _read(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return _Rows(context, builder, kinds, values).read()


def _write(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    _Rows(context, builder, kinds[:-1], values[:-1]).write(cgutils.unpack_tuple(builder, values[-1]))
    return context.get_dummy_value()


def _contiguous(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    """An array and a place in it."""
    array = make_array(kinds[0])(context, builder, values[0])
    return array, context.cast(builder, values[1], kinds[1], types.int64)


def _read_abreast(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    array, first = _contiguous(context, builder, kinds, values)
    kind = ir.VectorType(array.data.type.pointee, WIDTH).as_pointer()
    at = builder.bitcast(builder.gep(array.data, [first]), kind)
    return _as_lanes(builder, builder.load(at, align=context.get_abi_sizeof(array.data.type.pointee)))


def _write_abreast(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    array, first = _contiguous(context, builder, kinds, values)
    stride = cgutils.unpack_tuple(builder, array.strides)[0]
    entries = zip(cgutils.unpack_tuple(builder, values[2]), kinds[2].types, strict=True)
    for k, (value, kind) in enumerate(entries):
        row = cgutils.pointer_add(builder, array.data, builder.mul(_WORD(k), stride))
        at = builder.bitcast(builder.gep(row, [first]), _FLOATS.as_pointer())
        builder.store(_spread(builder, value, kind), at, align=8)
    return context.get_dummy_value()


def _select(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    a, b = (_spread(builder, *each) for each in zip(values[1:], kinds[1:], strict=True))
    return builder.select(values[0], a, b)


def _some(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    whole = ir.IntType(WIDTH)
    return builder.icmp_unsigned("!=", builder.bitcast(values[0], whole), whole(0))


def _every(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    whole = ir.IntType(WIDTH)
    return builder.icmp_unsigned("==", builder.bitcast(values[0], whole), whole((1 << WIDTH) - 1))


def _teach_here(function: Any, answer: Any, kinds: tuple[Any, ...], write: Any) -> None:
    """A function of this module, by the kinds of its arguments."""

    def accepts(*args: Any) -> Any:
        fits = len(args) == len(kinds) and all(isinstance(each, kind) for each, kind in zip(args, kinds, strict=True))
        return answer if fits else None

    _teach(function, accepts, [kinds], write)


_INT = types.Integer
_AT = (types.Array, _INT, _INT)
_teach_here(width, types.int64, (), lambda context, builder, kinds, values: _WORD(WIDTH))
for _function, _inner in ((number, ()), (column, (_INT,)), (cell, (_INT, _INT))):
    _teach_here(_function, LANES, (*_AT, *_inner), _read)
_teach_here(chosen, FLAGS, _AT, _read)
for _function in (put_numbers, put_columns):
    _teach_here(_function, types.none, (*_AT, types.BaseTuple), _write)
for _kinds in ((LanesType, LanesType), (LanesType, types.Float), (types.Float, LanesType), (types.Float, types.Float)):
    _teach_here(select, LANES, (FlagsType, *_kinds), _select)
_teach_here(some, types.boolean, (FlagsType,), _some)
_teach_here(every, types.boolean, (FlagsType,), _every)
_teach(
    abreast,
    lambda *args: (FLAGS if args[0].dtype == types.boolean else LANES) if len(args) == 2 else None,
    [(types.Array, _INT)],
    _read_abreast,
)
_teach_here(put_abreast, types.none, (types.Array, _INT, types.BaseTuple), _write_abreast)
