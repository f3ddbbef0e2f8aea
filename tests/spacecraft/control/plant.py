"""A test plant: rigid bodies with three reaction wheels, integrated with NumPy alone, all cases at once.

It shares no code with the library: hub and wheels are written down from Euler's equation for the total angular
momentum, the attitude is a quaternion, and Runge-Kutta 4 runs within each control period, over which the motor torques
are held.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swarm_mj.spacecraft.attitude.guidance import (
    LineOfSight,
    Reference,
    TrackingError,
    attitude_error,
    pointing_error,
    track_line_of_sight,
)
from swarm_mj.spacecraft.control import ControlInput, Controller, MrpSlidingMode

Floats = NDArray[np.float64]

#: 8 kg, 0.1 x 0.1 x 0.34 m, uniform: hub and locked wheels.
INERTIA = np.diag([0.0837333333, 0.0837333333, 0.0133333333])
#: Wheel of the class of the Blue Canyon RWP015: 15 mN m s at 6000 rpm, 4 mN m.
WHEEL_SPEED = 6000 * 2 * np.pi / 60
WHEEL_MOMENTUM = 0.015
WHEEL_INERTIA = WHEEL_MOMENTUM / WHEEL_SPEED
WHEEL_TORQUE = 0.004


@dataclass
class State:
    """q_BN (n, 4), omega_BN_B (n, 3) and the wheels' speeds relative to the body about x, y, z (n, 3)."""

    q: Floats
    omega: Floats
    wheels: Floats

    @classmethod
    def random(cls, rng: np.random.Generator, n: int) -> "State":
        """Return attitudes anywhere and rates within 0.2 rpm per axis, wheels at rest."""
        q = rng.normal(size=(n, 4))
        rate = 0.2 * 2 * np.pi / 60
        return cls(unit(q), rng.uniform(-rate, rate, (n, 3)), np.zeros((n, 3)))


@dataclass
class Plant:
    """True inertia of hub and locked wheels, and the external torque L_ext(t, state) in B."""

    inertia: Floats = field(default_factory=lambda: INERTIA)
    external: Callable[[float, State], Floats] = lambda t, state: np.zeros_like(state.omega)

    def __post_init__(self) -> None:
        """The inverse of the inertia without that of the wheels about their axes, once."""
        self.inverse = np.linalg.inv(self.inertia - WHEEL_INERTIA * np.eye(3))

    def momentum_N(self, state: State) -> Floats:
        """Return the total angular momentum in N."""
        return rotate(state.q, state.omega @ self.inertia + WHEEL_INERTIA * state.wheels)

    def derivative(self, t: float, state: State, motor: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the time derivatives of q, omega and wheels under motor torques (n, 3)."""
        total = state.omega @ self.inertia + WHEEL_INERTIA * state.wheels
        push = np.where((np.abs(state.wheels) >= WHEEL_SPEED) & (motor * state.wheels > 0), 0.0, motor)
        torque = self.external(t, state) - cross(state.omega, total) - push
        omega_dot = torque @ self.inverse
        q_dot = 0.5 * multiply(state.q, np.concatenate([np.zeros((len(state.q), 1)), state.omega], axis=1))
        return q_dot, omega_dot, push / WHEEL_INERTIA - omega_dot

    def advance(self, t: float, state: State, motor: Floats, duration: float, steps: int) -> State:
        """Return the state after `duration` with the motor torques held."""
        h = duration / steps
        for k in range(steps):
            now = t + k * h
            k1 = self.derivative(now, state, motor)
            k2 = self.derivative(now + h / 2, moved(state, k1, h / 2), motor)
            k3 = self.derivative(now + h / 2, moved(state, k2, h / 2), motor)
            k4 = self.derivative(now + h, moved(state, k3, h), motor)
            mean = tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True))
            state = moved(state, mean, h)
            state.q = unit(state.q)
        return state


@dataclass
class Flight:
    """What was recorded at each control instant; arrays of shape (steps, n, ...)."""

    time: Floats
    sigma_BR: Floats
    omega_BR: Floats
    pointing: Floats
    wheels: Floats
    torque: Floats
    asked: Floats
    momentum_N: Floats
    final: State


#: A target: time -> (rho, rho_dot, rho_ddot), each (n, 3).
Target = Callable[[float], tuple[Floats, Floats, Floats]]


def fixed_direction(direction: Floats) -> Target:
    """Return a target at rest, 1e11 m away."""
    zero = np.zeros_like(direction)
    return lambda t: (1e11 * direction, zero, zero)


def fly(
    controller: Controller,
    state: State,
    target: Target,
    duration: float,
    *,
    period: float = 0.5,
    plant: Plant | None = None,
    model: Floats = INERTIA,
    steps: int | None = None,
) -> Flight:
    """Close the loop; `model` is the locked inertia that the controller believes in, (3, 3) or (n, 3, 3)."""
    plant = plant or Plant()
    steps = steps or max(1, round(period / 0.1))
    n = len(state.q)
    inertia = np.ascontiguousarray(np.broadcast_to(model, (n, 3, 3)))
    effective = inertia - WHEEL_INERTIA * np.eye(3)
    q_RN, restart, memory = np.empty((n, 4)), np.ones(n, dtype=bool), None
    reference = Reference(q_RN, *(np.empty((n, 3)) for _ in range(3)))
    error = TrackingError(*(np.empty((n, 3)) for _ in range(4)))
    los, (sigma, omega_BR, omega_RN, domega) = reference.los_N, error
    rows: list[tuple[Floats, ...]] = []
    times = period * np.arange(round(duration / period) + 1)
    for t in times:
        track_line_of_sight(LineOfSight(*target(float(t))), state.q, restart, reference)
        restart[:] = False
        attitude_error(state.q, state.omega, reference, error)
        wheel_momentum = WHEEL_INERTIA * state.wheels
        asked, memory = controller.torque(
            ControlInput(sigma, omega_BR, state.omega, omega_RN, domega, wheel_momentum, inertia, effective, period),
            memory,
        )
        torque = np.clip(asked, -WHEEL_TORQUE, WHEEL_TORQUE)
        rows.append(
            (
                sigma.copy(),
                omega_BR.copy(),
                pointing_error(state.q, los),
                state.wheels,
                torque,
                asked.copy(),
                plant.momentum_N(state),
            )
        )
        state = plant.advance(float(t), state, -torque, period, steps)
    return Flight(times, *(np.array(column) for column in zip(*rows, strict=True)), final=state)


def moved(state: State, rates: tuple[Floats, ...], h: float) -> State:
    """Return the state moved along its derivatives by h."""
    return State(state.q + h * rates[0], state.omega + h * rates[1], state.wheels + h * rates[2])


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b, rows (n, 3); np.cross takes longer for few rows than all the rest of a step."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def multiply(a: Floats, b: Floats) -> Floats:
    """Return Hamilton's product of quaternions (n, 4)."""
    scalar = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    return np.concatenate([scalar, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + cross(a[:, 1:], b[:, 1:])], axis=1)


def rotate(q: Floats, v: Floats) -> Floats:
    """Return R(q) v."""
    t = 2 * cross(q[:, 1:], v)
    return v + q[:, :1] * t + cross(q[:, 1:], t)


def unit(rows: Floats) -> Floats:
    """Return the rows scaled to unit length."""
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def sliding_variable(law: MrpSlidingMode, sigma: Floats, omega: Floats) -> Floats:
    """Return s of the law's docstring, of rows (..., 3) of attitude and rate errors."""
    limit = np.inf if law.rate_limit is None else law.rate_limit
    size = np.linalg.norm(sigma, axis=-1, keepdims=True)
    return omega + law.slope * sigma / np.hypot(1.0, law.slope * size / limit)
