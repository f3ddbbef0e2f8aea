"""The device that CUDA offers, or simulates, and its memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import error
from numba import cuda
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError

#: Whether CUDA is simulated.
SIMULATED = "simulator" in cuda.jit.__module__


def why_no_device() -> str:
    """Why nothing can be flown on a GPU; empty where it can."""
    if SIMULATED:
        return ""
    try:
        if cuda.is_available():
            return "" if "numba_cuda" in str(cuda.__file__) else "numba-cuda is not installed"
    except ImportError as problem:  # a driver without its bindings
        return str(problem)
    return "CUDA finds none"


def require_device() -> None:
    """Refuse where there is no GPU.

    Raises:
        ScenarioError: The message says why, and what to do.
    """
    if why := why_no_device():
        raise ScenarioError(
            f"no GPU to fly on: {why}; install swarm_mj[gpu] where there is an NVIDIA GPU, use SwarmObserveVectorEnv, or set "
            "NUMBA_ENABLE_CUDASIM=1 to try a few flights in CUDA's simulator"
        )


def device_name() -> str:
    """What the device is called."""
    if SIMULATED:
        return "CUDA's simulator"
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


class HostMemory:
    """The processor's, as CUDA's simulator uses it; tables and views as `Memory` says."""

    def empty(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> NDArray[Any]:
        """See `Memory`."""
        return np.zeros(shape, dtype)

    def put(self, table: NDArray[Any]) -> NDArray[Any]:
        """See `Memory`."""
        return np.array(table, order="C")

    def write(self, array: NDArray[Any], values: NDArray[Any]) -> None:
        """See `Memory`."""
        array[...] = values

    def view(self, table: NDArray[Any], rows: slice, shape: tuple[int, ...]) -> NDArray[Any]:
        """See `Memory`."""
        return np.moveaxis(table[rows].reshape(*shape, table.shape[1]), -1, 0)

    def adopt(self, array: Any, shape: tuple[int, ...] | None) -> Any:
        """See `Memory`."""
        return array


class DeviceMemory:
    """The GPU's."""

    def empty(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> Any:
        """See `Memory`."""
        return cuda.device_array(shape, dtype)

    def put(self, table: NDArray[Any]) -> Any:
        """See `Memory`."""
        return cuda.to_device(np.array(table, order="C"))

    def write(self, array: Any, values: NDArray[Any]) -> None:
        """See `Memory`."""
        array.copy_to_device(np.ascontiguousarray(values, array.dtype))

    def view(self, table: Any, rows: slice, shape: tuple[int, ...]) -> Any:
        """See `Memory`."""
        dtype, count = np.dtype(table.dtype), table.shape[1]
        # Of the numbers of one flight the last lie closest, and between two numbers those of all other flights.
        between = [count * int(np.prod(shape[axis + 1 :])) for axis in range(len(shape))]
        address = int(table.__cuda_array_interface__["data"][0]) + rows.start * count * dtype.itemsize
        interface = {
            "shape": (count, *shape),
            "strides": tuple(dtype.itemsize * step for step in (1, *between)),
            "typestr": dtype.str,
            "data": (address, False),
            "version": 3,
        }
        return cuda.from_cuda_array_interface(interface, owner=table)

    def adopt(self, array: Any, shape: tuple[int, ...] | None) -> Any:
        """See `Memory`."""
        adopted = cuda.as_cuda_array(array)
        if adopted.shape != shape or adopted.dtype != np.int64:
            raise error.InvalidAction(f"actions of shape {adopted.shape}, {adopted.dtype}: give {shape} of int64")
        return adopted


def make_memory() -> Any:
    """The memory of the device, see `Memory`."""
    return HostMemory() if SIMULATED else DeviceMemory()


def placed(value: Any, memory: Any) -> Any:
    """Named tuples with their arrays copied to the device; numbers stay."""
    if isinstance(value, tuple):
        return type(value)(*(placed(each, memory) for each in value))
    return memory.put(value) if isinstance(value, np.ndarray) else value


def on_host(array: Any) -> NDArray[Any]:
    """An array of the device as NumPy's, once it is ready."""
    return np.asarray(array.copy_to_host() if hasattr(array, "copy_to_host") else array)
