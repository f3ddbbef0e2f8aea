"""Control laws that compiled code can call, so that whole stretches of a flight need no Python.

A controller may offer the arithmetic of its law as a function of arrays (`CompiledController`). Numba compiles it once into
a C function of a fixed signature, and the flight's kernels are given it: one kernel, kept in Numba's cache, serves every law,
plug-ins included.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numba import cfunc, types
from numba.core.errors import NumbaError
from numba.extending import typeof_impl

from swarm_mj.compilation import kernel
from swarm_mj.errors import PluginError
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.typing import Array

_numbers, _vectors, _tensors = (types.Array(types.float64, dimensions, "C") for dimensions in (1, 2, 3))
_SIGNATURE = types.void(*[_vectors] * 6, *[_tensors] * 2, _numbers, _vectors)
_LAW = types.FunctionType(_SIGNATURE)


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


class LawFunction(types.WrapperAddressProtocol):
    """A compiled law as an argument of kernels, which call it as a function.

    Numba takes its own C functions too, but works their type out anew at every call, for as long as a decision takes.

    Args:
        function: The C function.
    """

    def __init__(self, function: Any) -> None:
        self._function = function

    def __wrapper_address__(self) -> int:
        """Address of the C function."""
        return int(self._function.address)

    def signature(self) -> Any:
        """Types of its arguments."""
        return _SIGNATURE


@typeof_impl.register(LawFunction)
def _type_of_law(law: LawFunction, context: Any) -> Any:
    return _LAW


@runtime_checkable
class CompiledController(Protocol):
    """A controller whose law is offered for compiled code."""

    def compiled(self) -> CompiledLaw | None:
        """The law, which must give the same torques as `torque`; None where it needs memory or cannot be offered."""
        ...


@cache
def compile_law(write_torque: Callable[..., Any]) -> LawFunction:
    """Compile the function of a `CompiledLaw`; kept for the life of the process, and in Numba's cache beyond it.

    Raises:
        PluginError: Numba cannot compile it.
    """
    function = getattr(write_torque, "py_func", write_torque)
    on_disk = Path(getattr(inspect.getmodule(function), "__file__", None) or "").is_file()
    try:
        return LawFunction(cfunc(_SIGNATURE, cache=on_disk, error_model="numpy")(function))
    except (NumbaError, TypeError) as error:
        reason = " ".join([line.strip() for line in str(error).splitlines() if line.strip()][:2])
        raise PluginError(
            f"the compiled law {function.__module__}.{function.__qualname__} cannot be compiled: {reason}; its arguments are "
            "those that CompiledLaw names"
        ) from None


def torque_by(law: CompiledLaw, inputs: ControlInput) -> Array:
    """The torques of a law's compiled function, which flights and their decisions in Python so share, shape (n, 3) [N m]."""
    torque_B = np.empty_like(inputs.sigma_BR)
    _call(
        compile_law(law.write_torque),
        *(np.array(each, np.float64, order="C") for each in inputs[:8]),
        law.numbers,
        torque_B,
    )
    return torque_B


@kernel
def _call(
    law: Any,
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
    law(
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


def _do_nothing(
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
    """Leave the torques that are held."""


def no_law() -> LawFunction:
    """What stands for the law where torques are held."""
    return compile_law(_do_nothing)


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
