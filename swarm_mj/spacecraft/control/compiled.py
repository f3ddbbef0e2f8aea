"""Control laws that compiled code can call, so that whole stretches of a flight need no Python.

A controller may offer the arithmetic of its law as a function of arrays (`CompiledController`). Numba compiles it once into
a C function of a fixed signature, and the flight's kernels call it by its address: one kernel, kept in Numba's cache, serves
every law, plug-ins included.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from llvmlite import ir
from numba import cfunc, types
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from swarm_mj.errors import PluginError
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.typing import Array, kernel

_numbers, _vectors, _tensors = (types.Array(types.float64, dimensions, "C") for dimensions in (1, 2, 3))
_SIGNATURE = types.void(*[_vectors] * 6, *[_tensors] * 2, _numbers, _vectors)


class CompiledLaw(NamedTuple):
    """A control law without memory, for compiled code.

    Attributes:
        write_torque: Function in the subset of Python that Numba compiles, of `sigma_BR`, `omega_BR_B`, `omega_BN_B`,
            `omega_RN_B`, `domega_RN_B`, `wheel_momentum_B`, `inertia_B`, `inertia_effective_B` as in `ControlInput`,
            `numbers`, and `torque_B`, shape (n, 3) [N m], into which it writes the torques that `Controller.torque` returns.
            It must not raise: nobody would hear of it in compiled code.
        numbers: The law's parameters, shape (any,).
    """

    write_torque: Callable[..., Any]
    numbers: Array


@runtime_checkable
class CompiledController(Protocol):
    """A controller whose law is offered for compiled code."""

    def compiled(self) -> CompiledLaw | None:
        """The law, which must give the same torques as `torque`; None where it needs memory or cannot be offered."""
        ...


@cache
def compile_law(write_torque: Callable[..., Any]) -> Any:
    """Compile the function of a `CompiledLaw`; kept for the life of the process, and in Numba's cache beyond it.

    Raises:
        PluginError: Numba cannot compile it.
    """
    function = getattr(write_torque, "py_func", write_torque)
    on_disk = Path(getattr(inspect.getmodule(function), "__file__", None) or "").is_file()
    try:
        return cfunc(_SIGNATURE, cache=on_disk, error_model="numpy")(function)
    except (NumbaError, TypeError) as error:
        reason = " ".join([line.strip() for line in str(error).splitlines() if line.strip()][:2])
        raise PluginError(
            f"the compiled law {function.__module__}.{function.__qualname__} cannot be compiled: {reason}; its arguments are "
            "those that CompiledLaw names"
        ) from None


@intrinsic
def call_law(
    typing_context: Any,
    address: Any,
    sigma_BR: Any,
    omega_BR_B: Any,
    omega_BN_B: Any,
    omega_RN_B: Any,
    domega_RN_B: Any,
    wheel_momentum_B: Any,
    inertia_B: Any,
    inertia_effective_B: Any,
    numbers: Any,
    torque_B: Any,
) -> tuple[Any, Any]:
    """Call the compiled law at an address; within compiled code alone."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        parameters = [context.get_value_type(each) for each in _SIGNATURE.args]
        kind = ir.FunctionType(context.get_value_type(types.void), parameters)
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, *_SIGNATURE.args), generate


def address_of(law: CompiledLaw) -> int:
    """Address of the compiled function of a law; valid for the life of the process."""
    return int(compile_law(law.write_torque).address)


def torque_by(law: CompiledLaw, inputs: ControlInput) -> Array:
    """The torques of a law's compiled function, which flights and their decisions in Python so share, shape (n, 3) [N m]."""
    torque_B = np.empty_like(inputs.sigma_BR)
    _call(address_of(law), *(np.array(each, np.float64, order="C") for each in inputs[:8]), law.numbers, torque_B)
    return torque_B


@kernel
def _call(
    address: int,
    sigma_BR: Array,
    omega_BR_B: Array,
    omega_BN_B: Array,
    omega_RN_B: Array,
    domega_RN_B: Array,
    wheel_momentum_B: Array,
    inertia_B: Array,
    inertia_effective_B: Array,
    numbers: Array,
    torque_B: Array,
) -> None:
    call_law(
        address,
        sigma_BR,
        omega_BR_B,
        omega_BN_B,
        omega_RN_B,
        domega_RN_B,
        wheel_momentum_B,
        inertia_B,
        inertia_effective_B,
        numbers,
        torque_B,
    )


def numbers_of(law: CompiledLaw) -> Array:
    """The law's parameters as the kernels take them.

    Raises:
        PluginError: They are not a row of numbers.
    """
    try:
        numbers = np.ascontiguousarray(law.numbers, np.float64)
    except (TypeError, ValueError):
        raise PluginError(f"CompiledLaw.numbers = {law.numbers!r}: give a row of numbers") from None
    if np.ndim(law.numbers) != 1:
        raise PluginError(f"CompiledLaw.numbers has shape {np.shape(law.numbers)}: give a row of numbers")
    return numbers
