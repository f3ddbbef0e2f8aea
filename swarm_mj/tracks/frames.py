"""Inertial frames of files, by name, and how they are turned against N.

N has the axes of SPICE's ECLIPJ2000: EME2000 (SPICE's J2000) turned about x by the obliquity of IAU 1976, 84381.448 arcsec.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final

import numpy as np

from swarm_mj.errors import InteropError
from swarm_mj.typing import Array

#: As SPICE has it [rad]; `constants.OBLIQUITY_J2000_DEG`, which turns poles, is rounded by 0.04 arcsec.
OBLIQUITY: Final = 84_381.448 / 3600.0 * pi / 180.0
#: From components in N to components in EME2000, shape (3, 3).
C_EN: Final = np.array([[1.0, 0.0, 0.0], [0.0, cos(OBLIQUITY), -sin(OBLIQUITY)], [0.0, sin(OBLIQUITY), cos(OBLIQUITY)]])
C_EN.setflags(write=False)
#: Frames that files may be in: from N to each. ICRF is taken for EME2000, as SPICE does; they differ by 0.02 arcsec.
FROM_N: Final = {
    **dict.fromkeys(("EME2000", "J2000", "ICRF", "GCRF"), C_EN),
    **dict.fromkeys(("ECLIPJ2000", "ECLIPTICJ2000"), np.eye(3)),
}


def axes_of_pole(name: str, pole_N: Array) -> Array:
    """Axes by their name in a scenario, of a body with that pole, shape (3,): the rows are x, y, z in N, shape (3, 3)."""
    if name == "ecliptic":
        return np.eye(3)
    if name == "equatorial":
        return C_EN
    node = np.cross(C_EN[2], pole_N)
    # The node has no direction where the body's equator is that of EME2000: the equinox then.
    node = C_EN[0] - (C_EN[0] @ pole_N) * pole_N if np.linalg.norm(node) < 1e-9 else node
    node = node / np.linalg.norm(node)
    return np.stack([node, np.cross(pole_N, node), pole_N])


def from_N(name: str, where: str) -> Array:
    """From components in N to components in the frame of that name, shape (3, 3); `where`: file and key, for messages.

    Raises:
        InteropError: There is no such frame here.
    """
    if (C := FROM_N.get(name.strip().upper())) is None:
        allowed = f"allowed are {', '.join(FROM_N)}: write the file in one of them"
        raise InteropError(f"{where} = {name}: unknown frame; {allowed}")
    return C
