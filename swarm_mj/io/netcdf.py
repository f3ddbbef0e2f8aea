"""NetCDF-4 files of results, checked by their headers before a value is read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.arrays import MAX_BYTES, Declared, check_shapes, check_values
from swarm_mj.io.records import reading, require_file

#: Attributes of the file or of one variable, each [bytes]: room for a scenario.
MAX_ATTRIBUTE_BYTES = 2_000_000
#: All names along one dimension together [bytes].
MAX_NAMES_BYTES = 1_000_000


def read_netcdf(
    path: Path,
    declared: Mapping[str, Declared],
    attributes: Mapping[str, Declared],
    remedy: str,
    *,
    sizes: Mapping[str, int] | None = None,
    error: type[SwarmError] = OutputError,
) -> xr.Dataset:
    """Read a whole file into memory, once its headers are found to fit.

    `declared`: variables that it must hold; others, as of plug-ins, are kept. `attributes`: of numbers, that the whole file
    must have. `remedy`: what to do about a file that does not fit. `sizes`: of dimensions that are known from elsewhere.

    Raises:
        SwarmError: As `error`: it cannot be read or does not fit; one line names file, variable, value and what is allowed.
    """
    with reading(path, remedy, error):
        require_file(path, MAX_BYTES)
        known = _check_headers(path, declared, sizes)
        # Said outright, since xarray warns of its default where a foreign file has dimensions without a name.
        with xr.open_dataset(path, engine="h5netcdf", phony_dims="access", decode_times=False) as file:
            _check_dims(file, declared)
            data = file.load()
        check_values({name: data[name].values for name in declared if name in data}, declared, known)
        _check_names(data, declared)
        _check_attributes(data, attributes)
        return data


def _check_headers(path: Path, declared: Mapping[str, Declared], sizes: Mapping[str, int] | None) -> dict[str, int]:
    """Check types, shapes, memory and where the values lie; gives the sizes of the dimensions."""
    with h5py.File(path, "r") as file:
        _check_attribute_sizes("the file", file.attrs)
        variables = {name: variable for name in file if (variable := _variable(file, name)) is not None}
        known = check_shapes({name: (v.dtype, v.shape) for name, v in variables.items()}, declared, sizes)
        # What is unpacked at once of each variable.
        check_shapes({name: (v.dtype, v.chunks) for name, v in variables.items() if v.chunks}, {})
        for name, variable in variables.items():
            if _is_text(variable.dtype):
                _check_text_size(name, variable)
    return known


def _variable(file: h5py.File, name: str) -> h5py.Dataset | None:
    """A variable whose values lie in the file itself; None for a group, which is not read."""
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name} is a link, must be a variable of this file")
    variable = file[name]
    if not isinstance(variable, h5py.Dataset):
        return None
    if variable.external or variable.is_virtual:
        raise ValueError(f"{name} has its values in another file, must have them in this one")
    if variable.shape is None or (variable.dtype.kind not in "fiuS" and not _is_text(variable.dtype)):
        raise ValueError(f"{name} holds {variable.dtype}, must hold numbers or text")
    _check_attribute_sizes(name, variable.attrs)
    return variable


def _is_text(dtype: np.dtype[Any]) -> bool:
    return h5py.check_string_dtype(dtype) is not None


def _check_attribute_sizes(owner: str, attributes: h5py.AttributeManager) -> None:
    for name in attributes:
        shape = attributes.get_id(name).shape or ()
        size = math.prod(shape) * attributes.get_id(name).dtype.itemsize
        if size > MAX_ATTRIBUTE_BYTES:
            raise ValueError(f"attribute {name} of {owner} has {size} bytes, at most {MAX_ATTRIBUTE_BYTES}")


def _check_text_size(name: str, variable: h5py.Dataset) -> None:
    """Names may be of any length, and the same long one may stand for all."""
    if len(variable.shape) != 1:
        raise ValueError(f"{name} has the shape {variable.shape}, must be a list of names")
    total = 0
    for k in range(variable.shape[0]):
        total += len(variable[k])
        if total > MAX_NAMES_BYTES:
            raise ValueError(f"{name} holds more than {MAX_NAMES_BYTES} bytes of names (MAX_NAMES_BYTES)")


def _check_dims(file: xr.Dataset, declared: Mapping[str, Declared]) -> None:
    for name, what in declared.items():
        if name in file.variables and file.variables[name].dims != what.dims:
            raise ValueError(f"{name} is along {file.variables[name].dims}, must be along {what.dims}")


def _check_names(data: xr.Dataset, declared: Mapping[str, Declared]) -> None:
    for name, what in declared.items():
        if what.dtype != "O" or name not in data:
            continue
        names = data[name].values.tolist()
        if not all(isinstance(one, str) and one.isprintable() for one in names) or len(set(names)) < len(names):
            raise ValueError(f"{name} = {names}: must be different names")


def _check_attributes(data: xr.Dataset, attributes: Mapping[str, Declared]) -> None:
    arrays = {name: np.atleast_1d(np.asarray(data.attrs[name])) for name in attributes if name in data.attrs}
    sizes = check_shapes({name: (values.dtype, values.shape) for name, values in arrays.items()}, attributes)
    check_values(arrays, attributes, sizes)
