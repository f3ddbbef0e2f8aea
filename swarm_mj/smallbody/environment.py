"""Everything that acts on a spacecraft near the body, at any time of the flight: rotation, gravity, Sun and Earth.

Times are seconds past the scenario's epoch; vectors are in N unless named A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.plugins import as_array, call
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.companion import Companion
from swarm_mj.smallbody.gravity.base import Gravity
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.perturbations import Sunlight, solar_radiation_pressure, solar_tide
from swarm_mj.smallbody.rotation import spin_dcm
from swarm_mj.typing import Array


@dataclass(frozen=True)
class LinearMotion:
    """A heliocentric body seen from the asteroid, on a straight line during the flight.

    Attributes:
        position: At the epoch [m].
        velocity: [m/s].
    """

    position: Array
    velocity: Array

    def at(self, t: ArrayLike) -> Array:
        """Position at `t` seconds past the epoch [m], shape (3,); (n, 3) of n times."""
        return self.position + np.multiply.outer(t, self.velocity)


@dataclass(frozen=True, kw_only=True)
class Environment:
    """The body's surroundings during one flight.

    Attributes:
        gravity: Field in frame A.
        C_PN: Constant rotation from N to the pole frame P (z along the pole), shape (3, 3).
        phase0: Prime meridian angle at the epoch [rad].
        spin_rate: [rad/s].
        sun: Position of the Sun relative to the asteroid in N.
        earth: Position of Earth relative to the asteroid in N.
        solar_tide: Whether the Sun's tide acts.
        srp_area_per_mass: Sunlit area over mass [m^2/kg]; 0 switches radiation pressure off.
        srp_reflectivity: Coefficient C_R.
        companion: One more body; None: there is none.
    """

    gravity: Gravity
    C_PN: Array
    phase0: float
    spin_rate: float
    sun: LinearMotion
    earth: LinearMotion
    solar_tide: bool = False
    srp_area_per_mass: float = 0.0
    srp_reflectivity: float = 1.3
    companion: Companion | None = None

    @property
    def spin_N(self) -> Array:
        """Angular velocity of A relative to N, in N, shape (3,) [rad/s]."""
        return self.spin_rate * self.C_PN[2]

    def C_AN(self, t: float) -> Array:
        """Rotation from N to A at `t`, shape (3, 3)."""
        return spin_dcm(self.C_PN, self.phase0 + self.spin_rate * t)

    def acceleration_N(self, t: float, r_BN_N: Array) -> Array:
        """Acceleration of bodies at `r_BN_N`, shape (n, 3) [m], in N [m/s^2]."""
        C_AN = self.C_AN(t)
        return self.attraction_A(r_BN_N @ C_AN.T) @ C_AN + self.perturbing_acceleration_N(t, r_BN_N)

    def attraction_A(self, r_A: Array) -> Array:
        """Acceleration by the body's own gravity at `r_A`, shape (n, 3) [m], in A [m/s^2].

        Raises:
            PluginError: The field fails, or answers something else than its protocol says.
        """
        answer = call(self.gravity, "gravity field", "acceleration", r_A)
        what = "the gravity field {} answers an acceleration that"
        return as_array(answer, r_A.shape, np.float64, self.gravity, what)

    def in_cells(self) -> Environment:
        """The same where places that differ by rounding share gravity that is dear, see `Polyhedron.in_cells`."""
        return replace(self, gravity=self.gravity.in_cells) if isinstance(self.gravity, Polyhedron) else self

    def perturbing_acceleration_N(self, t: float, r_BN_N: Array) -> Array:
        """Companion, tide and radiation pressure at `r_BN_N`, shape (n, 3) [m], in N [m/s^2]."""
        total = np.zeros_like(r_BN_N) if self.companion is None else self.companion.acceleration_N(t, r_BN_N)
        if self.solar_tide:
            total += solar_tide(r_BN_N, self.sun.at(t), constants.GM_SUN)
        return total + self.pressure_acceleration_N(t, r_BN_N)

    @property
    def sunlight(self) -> Sunlight:
        """What of the Sun acts, for kernels."""
        return Sunlight(
            float(constants.GM_SUN if self.solar_tide else 0.0),
            float(max(self.srp_area_per_mass, 0.0)),
            float(self.srp_reflectivity),
        )

    def pressure_acceleration_N(self, t: float, r_BN_N: Array) -> Array:
        """Radiation pressure alone at `r_BN_N`, shape (n, 3) [m], in N [m/s^2]; zero where it is off."""
        if not self.srp_area_per_mass > 0.0:
            return np.zeros_like(r_BN_N)
        return solar_radiation_pressure(r_BN_N, self.sun.at(t), self.srp_area_per_mass, 1.0, self.srp_reflectivity)
