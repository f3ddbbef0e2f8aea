"""Files of a result, spoilt systematically: what a hostile hand, a full disk or another program makes of them."""

import io
import json
import struct
import warnings
import zipfile

import h5py
import numpy as np

#: Values that belong nowhere in a record, or to another key.
WRONG = (
    None, True, -1, 0, 10**18, 10**400, 1.5, 1e308, float("nan"), float("inf"), "", "\ud800", "x" * 5000, [], [None], {},
    {"sc1": None}, [[[]]], {"\ud800": 1},
)  # fmt: skip


def places(data, path=()):
    """Ways to every value inside, the whole first; of long lists and tables the first two."""
    yield path
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for k, (key, value) in enumerate(inside):
        if k < 2 or isinstance(data, dict):
            yield from places(value, (*path, key))


def put(data, path, value):
    """A copy with another value in one place; `...` takes the place away."""
    if not path:
        return value
    copy = dict(data) if isinstance(data, dict) else list(data)
    if value is ... and len(path) == 1:
        del copy[path[0]]
    else:
        copy[path[0]] = put(copy[path[0]], path[1:], value)
    return copy


def spoilt_bytes(content):
    """Any file: cut, empty, another one, with a bit turned."""
    yield b""
    yield b"\0"
    yield content[:1]
    yield content[: len(content) // 2]
    yield content[:-1]
    yield content + content
    yield content[::-1]
    for place in np.linspace(0, len(content) - 1, 12).astype(int):
        yield content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :]


def spoilt_json(text):
    """A JSON file with every key missing in turn, and wrong values in their places; three in turn for each, all in all."""
    data = json.loads(text)
    for k, path in enumerate(list(places(data))):
        if path:
            yield json.dumps(put(data, path, ...)).encode()
        for j in range(4):
            yield json.dumps(put(data, path, WRONG[(4 * k + j) % len(WRONG)])).encode()
    yield b"[" * 200_000
    yield b"1" * 100_000
    yield b'{"a": ' * 500 + b"1" + b"}" * 500
    yield b"\xff\xfe{}"
    yield b'{"scenario": NaN}'
    yield json.dumps({**data, "an extra key": {"of": ["another", "version"]}}).encode()
    yield from spoilt_bytes(text)


def npz(arrays, method=zipfile.ZIP_DEFLATED):
    """Bytes of an archive of arrays."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", method) as archive:
        for name, values in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(values), allow_pickle=True)
            archive.writestr(f"{name}.npy", member.getvalue())
    return content.getvalue()


def other_arrays(values):
    """What could stand in the place of an array."""
    yield values[..., :-1] if values.ndim else values[None]
    yield values[None]
    yield values.astype(object)
    yield values.astype("S3")
    yield np.zeros((0, *values.shape[1:]), values.dtype)
    yield np.array(7.0)
    yield values.astype(values.dtype.newbyteorder())
    for wrong in (np.nan, np.inf, -1e300, -7, np.iinfo(values.dtype).max if values.dtype.kind == "i" else 2**31 - 1):
        if values.dtype.kind == "f" or (values.dtype.kind == "i" and isinstance(wrong, int)):
            changed = values.copy()
            with np.errstate(over="ignore"):
                changed[(0,) * values.ndim] = wrong
            yield changed


def spoilt_npz(content):
    """An archive with every array missing or replaced in turn, and the tricks that archives know."""
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    for name, values in arrays.items():
        yield npz({key: one for key, one in arrays.items() if key != name})
        for other in other_arrays(values):
            yield npz({**arrays, name: other})
    yield npz({**arrays, "an extra array": np.array(["of another version"], dtype=object)})
    yield from (npz(arrays, method) for method in (zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    yield from zip_tricks(content, arrays)
    yield from spoilt_bytes(content)


def zip_tricks(content, arrays):
    """Encrypted, of an unknown method, with a name twice, with more than it holds, without an end."""
    for offset, value in ((8, 1), (10, 99), (24, 2**32 - 2), (20, 2**32 - 2), (42, 2**31)):
        changed = bytearray(content)
        place = changed.index(b"PK\1\2") + offset
        form = "<H" if offset < 20 else "<I"
        changed[place : place + struct.calcsize(form)] = struct.pack(form, value)
        yield bytes(changed)
    first = next(iter(arrays))
    twice = io.BytesIO(content)
    with zipfile.ZipFile(twice, "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        archive.writestr(zipfile.ZipInfo(f"{first}.npy"), b"again")
    yield twice.getvalue()
    end = bytearray(content)
    place = end.index(b"PK\5\6") + 12
    end[place : place + 4] = struct.pack("<I", 2**32 - 2)
    yield bytes(end)
    for shape in ((10**9,), (10**18, 10**18), (-1,), (2**63,)):
        yield promising(content, first, shape)


def promising(content, name, shape):
    """An archive in which one array's header promises another shape."""
    header = repr({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    start = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        for info in old.infolist():
            new.writestr(info.filename, start + bytes(1000) if info.filename == f"{name}.npy" else old.read(info))
    return out.getvalue()


def spoilt_telemetry(content, every):
    """A NetCDF file with every variable and attribute missing or replaced in turn, one change in `every`."""

    def changed(change):
        buffer = io.BytesIO(content)
        with h5py.File(buffer, "a") as file:
            change(file)
        return buffer.getvalue()

    changes = []

    with h5py.File(io.BytesIO(content)) as file:
        names, attributes = list(file), list(file.attrs)
        shapes = {name: file[name].shape for name in names}
    for name in names:
        changes.append(lambda file, name=name: file.__delitem__(name))
        for shape, dtype in ((shapes[name][:-1] + (1,), "f8"), ((10**7, 10**4, 3), "f8"), ((), "f8"), (shapes[name], "i8"),
                             (shapes[name], h5py.string_dtype()), (shapes[name], "c16")):  # fmt: skip
            changes.append(lambda file, name=name, shape=shape, dtype=dtype: _replaced(file, name, shape, dtype))
    for name in ("r_BN_N", "sigma_BN", "time", "pointing_error", "wheel_speed"):
        for value in (np.nan, np.inf, -1e300):
            changes.append(lambda file, name=name, value=value: _set(file, name, value))
    for name, value in (("mode", 99), ("mode", -3), ("tracked_spacecraft", 30_000), ("link_closed", 7)):
        changes.append(lambda file, name=name, value=value: _set(file, name, value))
    for name in attributes:
        changes.append(lambda file, name=name: file.attrs.__delitem__(name))
        for value in ("text", np.nan, np.zeros(0), np.arange(5.0)):
            changes.append(lambda file, name=name, value=value: file.attrs.__setitem__(name, value))
    for events in ("[", "{}", '[{"time_s": null}]', "[" * 100_000, '[{"time_s": 1, "spacecraft": [], "kind": 3}]'):
        changes.append(lambda file, events=events: file.attrs.__setitem__("events", events))
    changes.append(lambda file: file.__setitem__("elsewhere", h5py.ExternalLink("/etc/passwd", "/")))
    changes.append(lambda file: file.__setitem__("round", h5py.SoftLink("/round")))
    for attribute, value in (("units", "days since 1900-01-01"), ("scale_factor", 1e300), ("_FillValue", 0.0)):
        changes.append(lambda file, attribute=attribute, value=value: file["time"].attrs.__setitem__(attribute, value))
    yield from (changed(change) for change in changes[::every])
    yield from spoilt_bytes(content)


def _replaced(file, name, shape, dtype):
    del file[name]
    chunks = (1000, 10, 3) if len(shape) == 3 and shape[0] == 10**7 else None
    file.create_dataset(name, shape=shape, dtype=dtype, chunks=chunks)


def _set(file, name, value):
    file[name][(0,) * file[name].ndim] = value
