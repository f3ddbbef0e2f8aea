"""Mass properties of a CubeSat with reaction wheels, in its body frame B."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.typing import Array

#: The three wheels stand on the z axis, one third below, at and above the centre of mass, so that theirs is there too.
WHEEL_STATIONS_M = (-0.05, 0.0, 0.05)

#: Spin axes by layout, as rows in B. Any three wheels of the layouts with four still turn the spacecraft about every axis.
WHEEL_AXES = {
    "orthogonal": np.eye(3),
    "orthogonal_and_skew": np.vstack((np.eye(3), np.full(3, 1.0 / np.sqrt(3.0)))),
    "pyramid": np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, 1.0]]) / np.sqrt(3.0),
}

RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True, kw_only=True)
class SpacecraftProperties:
    """A uniform box with three or four wheels inside.

    Attributes:
        mass: Whole spacecraft, wheels included [kg].
        size: Edges of the box [m].
        wheel_mass: One wheel [kg].
        wheel_spin_inertia: One wheel about its spin axis [kg m^2].
        wheel_transverse_inertia: One wheel about a diameter [kg m^2].
        max_wheel_torque: [N m].
        max_wheel_speed: [rad/s].
        wheel_layout: See `WHEEL_AXES`.
        thrusters: Counted inside the mass and inertia with their propellant; None: none.
    """

    mass: float = 8.0
    size: tuple[float, float, float] = (0.1, 0.1, 0.34)
    wheel_mass: float = 0.13
    wheel_spin_inertia: float = 2.387e-5
    wheel_transverse_inertia: float = 1.545e-5
    max_wheel_torque: float = 0.004
    max_wheel_speed: float = 6000.0 * RPM
    wheel_layout: str = "orthogonal"
    thrusters: Thrusters | None = None

    @property
    def n_wheels(self) -> int:
        """Number of wheels w."""
        return len(WHEEL_AXES[self.wheel_layout])

    @property
    def wheel_labels(self) -> tuple[str, ...]:
        """What the wheels are called: x, y, z, or by their numbers."""
        return ("x", "y", "z") if self.n_wheels == 3 else tuple(str(k + 1) for k in range(self.n_wheels))

    @property
    def wheel_axes_B(self) -> Array:
        """Spin axes as rows, shape (w, 3)."""
        return WHEEL_AXES[self.wheel_layout].copy()

    @property
    def wheel_stations_m(self) -> tuple[float, ...]:
        """Where the wheels stand on the z axis, evenly about the centre of mass [m]."""
        if self.n_wheels == len(WHEEL_STATIONS_M):
            return WHEEL_STATIONS_M
        low, high = WHEEL_STATIONS_M[0], WHEEL_STATIONS_M[-1]
        return tuple(float(z) for z in np.linspace(low, high, self.n_wheels))

    @cached_property
    def inertia_B(self) -> Array:
        """Inertia of hub and locked wheels about the centre of mass, shape (3, 3) [kg m^2]: that of the uniform box."""
        x, y, z = self.size
        return np.diag(self.mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y]))

    @cached_property
    def inertia_effective_B(self) -> Array:
        """Inertia that a motor torque turns: without the wheels' spin inertia, shape (3, 3) [kg m^2]."""
        return self.inertia_B - self.wheel_spin_inertia * self.wheel_axes_B.T @ self.wheel_axes_B

    @cached_property
    def hub_inertia(self) -> Array:
        """Principal inertia of the hub alone, shape (3,) [kg m^2]; of orthogonal wheels."""
        hub = np.diag(self.inertia_B).copy()
        for axis, z in zip(self.wheel_axes_B, self.wheel_stations_m, strict=True):
            hub -= self.wheel_transverse_inertia + (self.wheel_spin_inertia - self.wheel_transverse_inertia) * axis**2
            hub -= self.wheel_mass * z * z * np.array([1.0, 1.0, 0.0])
        return hub

    @property
    def wheels_inertia_B(self) -> Array:
        """Inertia of all wheels about the centre of mass, locked, shape (3, 3) [kg m^2]."""
        spin, transverse = self.wheel_spin_inertia, self.wheel_transverse_inertia
        axes = self.wheel_axes_B
        own = self.n_wheels * transverse * np.eye(3) + (spin - transverse) * axes.T @ axes
        return own + self.wheel_mass * sum(z * z for z in self.wheel_stations_m) * np.diag([1.0, 1.0, 0.0])

    @property
    def hub_mass(self) -> float:
        """Mass of the hub alone [kg]."""
        return self.mass - self.n_wheels * self.wheel_mass
