"""The body's rotation, and where the Sun and the Earth stand, by SPICE kernels of the user's.

Positions are geometric (no light time, no aberration), as the built-in ones are. The flight knows uniform rotation about a
fixed axis, and straight lines of Sun and Earth: rotation, positions and velocities are those at the epoch. A body that turns
otherwise by the end of the flight is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.io.spice import furnished, spice_errors
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.typing import Array

#: Angle by which the rotation of the kernels may leave a uniform one about the axis z of A [rad]; 1.6 m on 16 km.
MAX_WANDER: Final = 1e-4
#: Frame whose axes N has.
N: Final = "ECLIPJ2000"


class KernelEphemeris:
    """What kernels say of a body.

    Args:
        kernels: Files, in the order in which they are loaded; text kernels and meta-kernels too.
        name: Of the body in the scenario, e.g. `433 Eros`, which stands for NAIF's 2000433.
        body: SPICE's name or number of it instead; None: by `name`.
        frame: SPICE's name of the body-fixed frame; None: the one that the kernels, or SPICE, give the body.
    """

    def __init__(self, kernels: Sequence[str], name: str, *, body: str | None = None, frame: str | None = None) -> None:
        self.kernels, self.frame = tuple(kernels), frame
        self.body = body or str(BodyName.of(name).code)

    def rotation(self, et: float, duration_s: float) -> tuple[Array, float]:
        """C_AN at an epoch, seconds of TDB past J2000, shape (3, 3), and the rate of the rotation about z of A [rad/s].

        Raises:
            ScenarioError: The kernels do not say, or the body does not turn uniformly about z for `duration_s`.
        """
        with furnished(self.kernels, "ephemerides.kernels", ScenarioError) as spice:
            frame = self._frame(spice)
            with spice_errors(
                f"ephemerides.frame = {frame}",
                "add a PCK or CK with this rotation to ephemerides.kernels, or set ephemerides.rotation: false",
                ScenarioError,
            ):
                C_AN, spin_N = spice.xf2rav(spice.sxform(N, frame, et))
                C_end = spice.pxform(N, frame, et + duration_s)
        rate = float(C_AN[2] @ spin_N)
        c, s = np.cos(rate * duration_s), np.sin(rate * duration_s)
        expected = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ C_AN
        wander = float(np.linalg.norm(C_end - expected)) / np.sqrt(2.0)
        if wander > MAX_WANDER:
            raise ScenarioError(
                f"ephemerides.frame = {frame}: leaves a uniform rotation about its axis z by {wander:.2g} rad within "
                f"duration_s = {duration_s:g}; at most {MAX_WANDER:g}: fly for less time, or set ephemerides.rotation: false"
            )
        return np.asarray(C_AN), rate

    def state_N(
        self,
        target: str,
        et: float,
        key: str = "ephemerides.kernels",
        remedy: str = "add SPKs of body, Sun and Earth that hold at the epoch, or set ephemerides.positions: false",
    ) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the Sun, the Earth or a spacecraft relative to the body in N.

        Args:
            target: SPICE's name or number of it.
            et: Seconds of TDB past J2000.
            key: What named the kernels, for messages.
            remedy: What to do where the kernels do not say.

        Raises:
            ScenarioError: The kernels do not say.
        """
        with (
            furnished(self.kernels, key, ScenarioError) as spice,
            spice_errors(
                f"ephemerides.body = {self.body}: {target} as seen from it at et = {et:.3f} s past J2000 TDB",
                remedy,
                ScenarioError,
            ),
        ):
            state = 1e3 * np.asarray(spice.spkezr(target, et, N, "NONE", self.body)[0])
        return state[:3], state[3:]

    def states_N(self, target: str, ets: Array, key: str, remedy: str) -> Array:
        """The same at many times, shape (k, 6); errors as for `state_N`."""
        what = f"{target} as seen from {self.body} from et = {ets[0]:.3f} to {ets[-1]:.3f} s past J2000 TDB"
        with furnished(self.kernels, key, ScenarioError) as spice, spice_errors(what, remedy, ScenarioError):
            return 1e3 * np.array([spice.spkezr(target, float(et), N, "NONE", self.body)[0] for et in ets])

    def _frame(self, spice: Any) -> str:
        if self.frame is not None:
            if not spice.namfrm(self.frame):
                raise ScenarioError(
                    f"ephemerides.frame = {self.frame}: unknown to SPICE and to the kernels; name a frame such as IAU_EROS, or "
                    "add the FK that defines it"
                )
            return self.frame
        with spice_errors(
            f"ephemerides.body = {self.body}", "give SPICE's name or number of the body, and its frame", ScenarioError
        ):
            by_number = self.body.lstrip("-").isdecimal()
            return str((spice.cidfrm(int(self.body)) if by_number else spice.cnmfrm(self.body))[1])
