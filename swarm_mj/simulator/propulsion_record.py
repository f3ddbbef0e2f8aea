"""What a flight with thrusters adds to the telemetry."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.simulator.propulsion import Propulsion

Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]


class PropulsionRecord:
    """Samples of thrust, tanks and velocity gained.

    Args:
        samples: Number of samples.
        n: Number of spacecraft.
    """

    def __init__(self, samples: int, n: int) -> None:
        self._thrust = np.zeros((samples, n, 3))
        self._scalars = np.zeros((3, samples, n))

    def keep(self, row: int, propulsion: Propulsion) -> None:
        """Take a sample; the force of the coming hold has been set."""
        self._thrust[row] = propulsion.force_N
        self._scalars[:, row] = propulsion.propellant, propulsion.mass, propulsion.delta_v

    def variables(self) -> dict[str, Variable]:
        """Variables for the telemetry: dimensions, values, attributes."""
        place = ("time", "spacecraft")
        words = {
            "propellant_kg": ("kg", "propellant left in the tank"),
            "mass_kg": ("kg", "mass with what is left in the tank"),
            "delta_v_m_s": ("m s-1", "velocity gained by thrust so far, in whatever direction"),
        }
        found: dict[str, Variable] = {
            "thrust_N": (
                (*place, "xyz"),
                self._thrust,
                {"units": "N", "frame": "N", "long_name": "mean force of the thrusters, held from this sample on"},
            )
        }
        for (name, (units, long_name)), values in zip(words.items(), self._scalars, strict=True):
            found[name] = place, values, {"units": units, "frame": "none", "long_name": long_name}
        return found
