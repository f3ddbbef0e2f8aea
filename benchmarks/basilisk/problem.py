"""The flight that all programs fly: five CubeSats pass Eros and turn four times to directions of their own.

Frames as everywhere: N ecliptic J2000 about the body's centre, A fixed in the body, B in the spacecraft, R the reference. SI.
The law is that of Basilisk's module mrpFeedback without integral term and with omega_BN in the gyroscopic term
(controlLawType 1; Schaub and Junkins, Analytical Mechanics of Space Systems, section 8.4),

    L = omega x (J_eff omega + h) + J_eff (domega_RN - omega x omega_RN) - K sigma_BR - P omega_BR,

h the wheels' absolute axial momentum, J_eff the inertia without the wheels' spin inertias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swarm_mj.flight.fly import initial_state
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.state import InitialState
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.model import Stepper
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.verification.control import aligned

Array = NDArray[np.float64]

DURATION_S, PERIOD_S, LEG_S = 1200.0, 0.5, 300.0
#: Torque per MRP and per rate.
K_N_M, P_N_M_S = 1e-3, 2e-2
WHEEL_SPEED_RAD_S = 100.0
SEED = 7
#: The peer, and who steps in our program.
STEPPERS: tuple[Stepper, ...] = ("mujoco", "kernel")
PROGRAMS = ("basilisk", *STEPPERS)
#: The step [s] at which costs are compared, the same in both programs.
EQUAL_STEP_S = 0.1


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One flight.

    Attributes:
        plan: The scenario `eros-config2`, for gravity, rotation, mass properties and start; with as many spacecraft as asked.
        initial: Start of the swarm; wheels already turn.
        directions_N: What +z points at in each leg, unit vectors, shape (legs, n, 3).
    """

    plan: Plan
    initial: InitialState
    directions_N: Array

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return self.plan.n

    @property
    def environment(self) -> Environment:
        """Gravity and rotation."""
        return self.plan.environment

    @property
    def properties(self) -> SpacecraftProperties:
        """Mass and wheels."""
        return self.plan.properties

    @property
    def references(self) -> list[list[Rotation]]:
        """Reference attitudes by leg and spacecraft: each reached from the one before on the shortest way."""
        now, legs = [Rotation.from_mrp(sigma) for sigma in self.initial.sigma_BN], []
        for directions in self.directions_N:
            now = [aligned(attitude, direction) for attitude, direction in zip(now, directions, strict=True)]
            legs.append(now)
        return legs


@dataclass(frozen=True, kw_only=True)
class Flight:
    """States at every control period.

    Attributes:
        r_N: Positions, shape (t, n, 3) [m].
        attitude: Quaternions (w, x, y, z) of B relative to N, shape (t, n, 4).
        wheel_speed: Shape (t, n, 3) [rad/s].
    """

    r_N: Array
    attitude: Array
    wheel_speed: Array


@dataclass(frozen=True, kw_only=True)
class Difference:
    """The largest differences of two flights.

    Attributes:
        position_m: Distance [m].
        attitude_rad: Angle [rad].
        wheel_speed: Relative to the fastest wheel of the flight.
    """

    position_m: float
    attitude_rad: float
    wheel_speed: float


def make_problem(n: int | None = None) -> Problem:
    """The flight, the same on every call.

    Args:
        n: Number of spacecraft, which pass the visiting points 1, 2, ... and again; None: the scenario's own five.
    """
    plan = make_plan(load_scenario("eros-config2")) if n is None else _plan_of(n)
    start = initial_state(plan)
    rng = np.random.default_rng(SEED)
    directions = rng.normal(size=(round(DURATION_S / LEG_S), plan.n, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    wheels = rng.uniform(-WHEEL_SPEED_RAD_S, WHEEL_SPEED_RAD_S, (plan.n, 3))
    initial = InitialState(
        r_BN_N=np.array(start.r_BN_N),
        v_BN_N=start.v_BN_N,
        sigma_BN=start.sigma_BN,
        omega_BN_B=start.omega_BN_B,
        wheel_speed=wheels,
    )
    return Problem(plan=plan, initial=initial, directions_N=directions)


def _plan_of(n: int) -> Plan:
    n_points = make_plan(load_scenario("eros-config2")).region.n_visiting
    points = [1 + j % n_points for j in range(n)]
    scenario = load_scenario("eros-config2", {"design.visiting_points": points})
    # Spacecraft with a common point fly one orbit; only attitudes, directions and wheels tell them apart.
    return make_plan(scenario, check_separation=False)


def difference(one: Flight, other: Flight) -> Difference:
    """The largest differences over all times and spacecraft."""
    # A quaternion and its negative are one attitude; the chord is accurate where the angle is small.
    chord = np.minimum(
        np.linalg.norm(one.attitude - other.attitude, axis=-1), np.linalg.norm(one.attitude + other.attitude, axis=-1)
    )
    return Difference(
        position_m=float(np.linalg.norm(one.r_N - other.r_N, axis=-1).max()),
        attitude_rad=float(4.0 * np.arcsin(np.minimum(1.0, 0.5 * chord)).max()),
        wheel_speed=float(np.abs(one.wheel_speed - other.wheel_speed).max() / np.abs(other.wheel_speed).max()),
    )
