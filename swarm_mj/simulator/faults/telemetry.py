"""What a flight with faults adds to the telemetry."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.simulator.faults.state import FaultState
from swarm_mj.typing import Array


class FaultRecord:
    """Samples of a flight with faults.

    Args:
        samples: Number of samples.
        n: Number of spacecraft.
        n_wheels: Of each.

    Attributes:
        wheels: Speed [rad/s], motor torque and friction torque [N m], shape (t, 3, n, w).
        imperfect_knowledge: Whether the controller was given anything else than the true attitude.
    """

    def __init__(self, samples: int, n: int, n_wheels: int) -> None:
        self.wheels = np.zeros((samples, 3, n, n_wheels))
        self._flags = np.zeros((samples, 2, n), np.int8)
        self._knowledge = np.zeros((samples, n))
        self._bias = np.zeros((samples, 2, n, 3))
        self._estimating = self.imperfect_knowledge = False

    def keep(self, row: int, flight: FaultState, wheel_speed: Array, q_BN: Array) -> None:
        """Write one sample.

        Args:
            row: Its number.
            flight: At this instant.
            wheel_speed: Shape (n, w) [rad/s].
            q_BN: True attitudes, shape (n, 4).
        """
        self.wheels[row] = wheel_speed, flight.wheels.motor, flight.wheels.bearing
        self._flags[row] = ~flight.lost, flight.camera_on & ~flight.lost
        self._estimating = flight.sensing.estimating
        if flight.sensing.active:
            self.imperfect_knowledge = True
            self._knowledge[row] = flight.sensing.knowledge_error(q_BN)
        if self._estimating:
            self._bias[row] = flight.sensing.gyro_bias, flight.sensing.gyro_bias_estimate

    def variables(self) -> dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]:
        """Variables for the telemetry: dimensions, values, attributes."""
        flags = {"units": "1", "frame": "none", "flag_values": np.array([0, 1], np.int8)}
        place, wheels, vector = ("time", "spacecraft"), ("time", "spacecraft", "wheel"), ("time", "spacecraft", "xyz")
        found: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]] = {
            "operational": (
                place,
                self._flags[:, 0],
                {**flags, "long_name": "whether the spacecraft works", "flag_meanings": "lost operational"},
            ),
            "camera_on": (
                place,
                self._flags[:, 1],
                {**flags, "long_name": "whether the camera takes pictures", "flag_meanings": "off on"},
            ),
            "wheel_friction_torque": (
                wheels,
                self.wheels[:, 2],
                _units("N m", "B", "torque of the bearing on the wheel, held from this sample on"),
            ),
            "attitude_knowledge_error": (
                place,
                self._knowledge,
                _units("rad", "none", "angle between the true attitude and the one given to the controller"),
            ),
        }
        if self._estimating:
            found["gyro_bias"] = (vector, self._bias[:, 0], _units("rad s-1", "B", "true bias of the gyro"))
            found["gyro_bias_estimate"] = (
                vector,
                self._bias[:, 1],
                _units("rad s-1", "B", "the filter's estimate of it"),
            )
        return found


def _units(units: str, frame: str, long_name: str) -> dict[str, Any]:
    return {"units": units, "frame": frame, "long_name": long_name}
