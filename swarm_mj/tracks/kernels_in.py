"""Paths and attitudes of spacecraft about a body from SPICE kernels: SPK and CK, with the text kernels that these need.

Positions are geometric and attitudes SPICE's at the very instants that are asked for; nothing is interpolated here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from swarm_mj.errors import InteropError
from swarm_mj.io.spice import furnished, spice_errors
from swarm_mj.spacecraft.attitude.mrp import quaternions
from swarm_mj.tracks.track import Track
from swarm_mj.typing import Array, Ints, Mask

#: Frame whose axes N has, and what named the kernels, for messages.
N: Final = "ECLIPJ2000"
KEY: Final = "kernels (--kernels)"
#: Most intervals of a coverage that are read.
INTERVALS: Final = 20_000


@dataclass(frozen=True, kw_only=True)
class KernelTrack(Track):
    """What kernels say of one spacecraft.

    Attributes:
        kernels: Files, in the order in which they are loaded.
        windows: Begins and ends of what they cover, seconds of TDB past J2000, shape (w, 2).
        width: Numbers at an instant.
        ask: SPICE's answer at an instant, given SpiceyPy and seconds of TDB past J2000.
    """

    kernels: tuple[str, ...]
    windows: Array
    width: int
    ask: Callable[[Any, float], Array]

    @property
    def first(self) -> int:
        """Instant from which on something is known."""
        return int(np.ceil(self.windows.min() * 1e9))

    @property
    def last(self) -> int:
        """Instant until which something is known."""
        return int(np.floor(self.windows.max() * 1e9))

    def at(self, ns: Ints) -> tuple[Array, Mask]:
        """Values at instants, and where they are known, shapes (q, m) and (q,); NaN where not."""
        et, out = ns / 1e9, np.full((len(ns), self.width), np.nan)
        # At the ends clocks and doubles round by less than a microsecond: the nearest covered instant stands for those there.
        nearest = np.clip(et[:, None], self.windows[:, 0], self.windows[:, 1])
        best = nearest[np.arange(len(ns)), np.abs(nearest - et[:, None]).argmin(axis=1)]
        covered = np.abs(best - et) <= 1e-6
        with furnished(self.kernels, KEY) as spice, spice_errors(self.source, "add the kernels that it needs"):
            for k in np.flatnonzero(covered):
                out[k] = self.ask(spice, float(best[k]))
        return out, covered


def read_kernels(
    kernels: Sequence[Path], spacecraft: Sequence[str], body: str
) -> tuple[list[KernelTrack], list[KernelTrack]]:
    """Paths of spacecraft, and their attitudes where the kernels have some of all.

    Args:
        kernels: Files, in the order in which they are loaded; a meta-kernel serves too.
        spacecraft: SPICE's names or numbers, or `NAME/FRAME` with the frame whose z axis the camera looks along; none: all
            that the SPKs hold with a number below 0, and frames that belong to them.
        body: SPICE's name or number of the body.

    Raises:
        InteropError: A file is refused, or does not know a spacecraft.
    """
    names = tuple(str(kernel) for kernel in kernels)
    with furnished(names, KEY) as spice:
        asked = list(spacecraft) or [str(code) for code in sorted(_objects(spice, "SPK"), reverse=True) if code < 0]
        if not asked:
            remedy = "name one (--spacecraft) or add its SPK"
            raise InteropError(f"{KEY}: no SPK with a spacecraft (a number below 0); {remedy}")
        paths, attitudes = [], []
        for one in asked:
            name, _, frame = one.partition("/")
            code = _code(spice, name)
            title = spice.bodc2s(code)
            windows = _windows(spice, "SPK", code)
            if not len(windows):
                raise InteropError(f"spacecraft = {name}: is in none of the SPKs of {', '.join(names)}")
            shared: dict[str, Any] = {"name": title, "stretches": (), "kernels": names}
            source, ask = f"path of {title} in the SPKs", _position(code, body)
            paths.append(KernelTrack(source, windows=windows, width=3, ask=ask, **shared))
            for place, times in _frames(spice, code, frame):
                source = f"attitude {place} of {title} in the CKs"
                attitudes.append(KernelTrack(source, windows=times, width=4, ask=_attitude(place), **shared))
    if attitudes and len(attitudes) != len(paths):
        raise InteropError(
            f"{KEY}: have {len(attitudes)} attitude frames ({', '.join(one.source.split()[1] for one in attitudes)}) for "
            f"{len(paths)} spacecraft; name one each, --spacecraft NAME/FRAME"
        )
    return paths, attitudes


def _position(code: int, body: str) -> Callable[[Any, float], Array]:
    return lambda spice, et: 1e3 * np.asarray(spice.spkezr(str(code), et, N, "NONE", body)[0][:3])


def _attitude(frame: str) -> Callable[[Any, float], Array]:
    return lambda spice, et: quaternions(np.asarray(spice.pxform(N, frame, et))[None])[0]


def _code(spice: Any, name: str) -> int:
    with spice_errors(f"spacecraft = {name}", "give SPICE's name or number of it, and the FK that names it"):
        return int(spice.bods2c(name))


def _files(spice: Any, kind: str) -> list[str]:
    return [spice.kdata(k, kind)[0] for k in range(spice.ktotal(kind))]


def _objects(spice: Any, kind: str) -> set[int]:
    """Numbers of all that the kernels of a kind hold: bodies of SPKs, structures of CKs."""
    ask = spice.spkobj if kind == "SPK" else spice.ckobj
    return {int(code) for file in _files(spice, kind) for code in ask(file)}


def _windows(spice: Any, kind: str, code: int) -> Array:
    """What kernels of a kind cover of a body or structure, seconds of TDB past J2000, shape (w, 2)."""
    cover = spice.cell_double(2 * INTERVALS)
    for file in _files(spice, kind):
        if kind == "SPK":
            if code in set(spice.spkobj(file)):
                spice.spkcov(file, code, cover)
        elif code in set(spice.ckobj(file)):
            spice.ckcov(file, code, False, "INTERVAL", 0.0, "TDB", cover)
    return np.array([spice.wnfetd(cover, k) for k in range(spice.wncard(cover))]).reshape(-1, 2)


def _frames(spice: Any, code: int, frame: str) -> list[tuple[str, Array]]:
    """Frames of CKs that belong to a spacecraft, or the one that is named, with what is covered of them."""
    found = []
    for structure in sorted(_objects(spice, "CK"), reverse=True):
        try:
            _, name, centre = spice.ccifrm(3, structure)
        except (spice.exceptions.SpiceyError, spice.exceptions.NotFoundError):
            continue  # no FK defines it
        if name == frame or (not frame and centre == code):
            found.append((str(name), _windows(spice, "CK", structure)))
    if frame and not found:
        what = "is in none of the CKs, or no FK defines it"
        raise InteropError(f"spacecraft frame {frame}: {what}; give another, or add them")
    return found
