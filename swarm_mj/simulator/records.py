"""What goes into a simulation and what comes out: the initial state and the raw samples of a flight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.telemetry import FaultRecord
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """Where and how the swarm starts.

    Attributes:
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        sigma_BN: Attitudes as MRP, shape (n, 3).
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Shape (n, w) [rad/s].
        seed: Of faults and dispersions, where the simulation has any.
        deployment: What went wrong on the way to this state.
    """

    r_BN_N: Array
    v_BN_N: Array
    sigma_BN: Array
    omega_BN_B: Array
    wheel_speed: Array
    seed: int = 0
    deployment: tuple[Event, ...] = ()


@dataclass(frozen=True)
class Record:
    """Raw samples of a flight; `telemetry.dataset` names them.

    Attributes:
        time: Shape (t,) [s].
        vectors: r, v, omega, sigma_BR, wheel speed, wheel torque, line of sight, shape (t, 7, n, 3).
        attitude: q_BN and q_RN, shape (t, 2, n, 4).
        aim: `TargetKind` values and the spacecraft tracked, counted from 0 (-1: none), shape (t, 2, n).
        peaks: Over every control period, not only the samples: largest wheel speed [rad/s], largest motor torque [N m], and
            the time in which a wheel limit cut a torque [s], shape (n, 3).
        faults: What a flight with faults, dispersions or four wheels adds.
    """

    time: Array
    vectors: Array
    attitude: Array
    aim: NDArray[np.int16]
    peaks: Array
    faults: FaultRecord | None = None


def sample_times(duration: float, interval: float) -> Array:
    """Times from 0 to `duration` at every `interval` [s], both ends included."""
    return np.asarray(interval * np.arange(round(duration / interval) + 1), dtype=np.float64)
