"""Hands arrays of the device to other libraries by DLPack, with their strides and without a copy.

`torch.from_dlpack(exported(array))`; `jax.numpy.from_dlpack` and `cupy.from_dlpack` alike. What is received shares its memory
with the environment, which writes to it at the next step.
"""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

import numpy as np
from numba import cuda

#: Kinds of devices.
PROCESSOR, CUDA = 1, 2
#: Codes of types by NumPy's kinds.
_CODES = {"i": 0, "u": 1, "f": 2, "b": 6}
_NAME = b"dltensor"


class _Tensor(ctypes.Structure):
    _fields_: ClassVar = [
        ("data", ctypes.c_void_p),
        ("device_type", ctypes.c_int32),
        ("device_id", ctypes.c_int32),
        ("ndim", ctypes.c_int32),
        ("code", ctypes.c_uint8),
        ("bits", ctypes.c_uint8),
        ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.POINTER(ctypes.c_int64)),
        ("byte_offset", ctypes.c_uint64),
    ]


_Deleter = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_Destructor = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


class _Managed(ctypes.Structure):
    _fields_: ClassVar = [("tensor", _Tensor), ("context", ctypes.c_void_p), ("deleter", _Deleter)]


#: What stands behind each tensor that somebody holds, by its address.
_HELD: dict[int, tuple[Any, ...]] = {}


@_Deleter
def _release(address: int) -> None:
    _HELD.pop(address, None)


_new, _valid, _pointer = (getattr(ctypes.pythonapi, f"PyCapsule_{name}") for name in ("New", "IsValid", "GetPointer"))
_new.restype, _new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, _Destructor)
_valid.restype, _valid.argtypes = ctypes.c_int, (ctypes.c_void_p, ctypes.c_char_p)
_pointer.restype, _pointer.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p)


@_Destructor
def _forget(capsule: int) -> None:
    # Whoever took the tensor has renamed the capsule, and calls the deleter himself.
    if _valid(capsule, _NAME):
        _release(_pointer(capsule, _NAME))


class Exported:
    """An array as DLPack's producer.

    Args:
        array: With an interface as `__cuda_array_interface__` describes it.
        interface: That interface.
        device: Kind and number of the device.
    """

    def __init__(self, array: Any, interface: dict[str, Any], device: tuple[int, int]) -> None:
        self._array, self._interface, self._device = array, interface, device

    def __dlpack_device__(self) -> tuple[int, int]:
        """Kind and number of the device."""
        return self._device

    def __dlpack__(self, *, stream: int | None = None, **wishes: Any) -> Any:
        """The tensor in a capsule; of the later protocol's wishes none is heeded, which it allows.

        Args:
            stream: On which the receiver works: what was launched here is waited for, unless it is the same or -1.
            wishes: `max_version`, `dl_device`, `copy`.
        """
        if self._device[0] == CUDA and stream not in (None, -1, 1):
            cuda.synchronize()
        given, dtype = self._interface, np.dtype(self._interface["typestr"])
        shape = given["shape"]
        strides = given.get("strides") or np.zeros(shape, dtype).strides
        sizes = (ctypes.c_int64 * len(shape))(*shape)
        steps = (ctypes.c_int64 * len(shape))(*(step // dtype.itemsize for step in strides))
        managed = _Managed()
        tensor = managed.tensor
        tensor.data, (tensor.device_type, tensor.device_id) = given["data"][0], self._device
        tensor.ndim, tensor.code, tensor.bits, tensor.lanes = len(shape), _CODES[dtype.kind], 8 * dtype.itemsize, 1
        tensor.shape, tensor.strides, managed.deleter = sizes, steps, _release
        address = ctypes.addressof(managed)
        _HELD[address] = (managed, sizes, steps, self._array)
        return _new(address, _NAME, _forget)


def exported(array: Any) -> Any:
    """An array of the environment for `from_dlpack`; in CUDA's simulator it is one of NumPy's."""
    if isinstance(array, np.ndarray):
        return array
    return Exported(array, array.__cuda_array_interface__, (CUDA, int(cuda.get_current_device().id)))
