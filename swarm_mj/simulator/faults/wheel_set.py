"""The reaction wheels of a swarm through one flight: their faults, and how the healthy ones share the torque."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from swarm_mj.scenarios.schema_faults import WheelFriction, WheelLost, WheelStuck, WheelWeakened
from swarm_mj.simulator.faults.schedule import ScheduledFault
from swarm_mj.simulator.faults.wheels import WheelState, allocate, drive
from swarm_mj.spacecraft.properties import RPM, SpacecraftProperties
from swarm_mj.typing import Array, Mask


class WheelSet:
    """Wheels of n spacecraft.

    Args:
        properties: Axes and limits.
        inertia_B: True inertia of every spacecraft with its wheels, shape (n, 3, 3) [kg m^2].
        coulomb: Friction, shape (n, w) [N m].
        viscous: Shape (n, w) [N m s/rad].
        state: Receives how they are.
        speed_margin: How far below the limit the limiter aims, relative.

    Attributes:
        motor: Motor torques of the present hold, shape (n, w) [N m].
        bearing: Friction torques, shape (n, w) [N m].
    """

    def __init__(
        self,
        properties: SpacecraftProperties,
        inertia_B: Array,
        coulomb: Array,
        viscous: Array,
        state: WheelState,
        speed_margin: float = 0.0,
    ) -> None:
        self._properties, self._axes = properties, properties.wheel_axes_B
        n, w = coulomb.shape
        self._max_speed = (1.0 - speed_margin) * properties.max_wheel_speed
        self._healthy = np.ones((n, w), np.bool_)
        self.state, self.motor, self.bearing = state, state.motor, state.bearing
        for array in state:
            array[:] = 0
        state.effectiveness[:], state.coulomb[:], state.viscous[:] = 1.0, coulomb, viscous
        state.allocation[:] = _by_all(self._axes.tobytes(), w)
        state.inertia[:] = relative_inertia(properties, inertia_B)

    def get_state(self) -> list[Array | Mask]:
        """What faults have made of the wheels, a copy."""
        return [array.copy() for array in (*self.state, self._healthy)]

    def set_state(self, saved: list[Array | Mask]) -> None:
        """Go on from what `get_state` gave."""
        for array, value in zip((*self.state, self._healthy), saved, strict=True):
            array[:] = value

    def drive(self, torque_B: Array, speed: Array, period: float, dead: Mask, peaks: Array) -> Array:
        """Torque on every wheel about its axis, motor and bearing together, shape (n, w) [N m].

        Args:
            torque_B: That the wheels shall exert on the bodies, shape (n, 3) [N m].
            speed: Of the wheels, shape (n, w) [rad/s].
            period: For which it is held [s].
            dead: Spacecraft without power, shape (n,).
            peaks: Brought up to date, see `Peak`.
        """
        drive(torque_B, self.state, speed, period, self._properties.max_wheel_torque, self._max_speed, dead, peaks)
        return self.motor + self.bearing

    def fail(self, entry: ScheduledFault, speed: Array) -> str:
        """Let a fault happen; returns it in words.

        Args:
            entry: What happens.
            speed: Of the spacecraft's wheels now, shape (w,) [rad/s].
        """
        j, fault, state = entry.spacecraft, entry.fault, self.state
        words = []
        for w in entry.wheels:
            if isinstance(fault, WheelLost):
                state.effectiveness[j, w] = 0.0
                words.append(f"wheel {w + 1} gives no torque")
            elif isinstance(fault, WheelStuck):
                held = speed[w] if fault.speed_rpm is None else fault.speed_rpm * RPM
                state.stuck[j, w], state.stuck_speed[j, w] = True, held
                words.append(f"wheel {w + 1} at {held / RPM:.0f} rpm")
            elif isinstance(fault, WheelWeakened):
                state.effectiveness[j, w] *= fault.factor
                words.append(f"wheel {w + 1} gives {100 * fault.factor:g} %")
            elif isinstance(fault, WheelFriction):
                state.coulomb[j, w] += fault.coulomb_n_m
                state.viscous[j, w] += fault.viscous_n_m_s
                words.append(f"wheel {w + 1}: {fault.coulomb_n_m:g} N m, {fault.viscous_n_m_s:g} N m s/rad more")
        return "; ".join(words)

    def recover(self, entry: ScheduledFault) -> None:
        """End a fault that does not last."""
        j, fault, state = entry.spacecraft, entry.fault, self.state
        for w in entry.wheels:
            if isinstance(fault, WheelWeakened) and fault.factor > 0.0:
                state.effectiveness[j, w] /= fault.factor
            elif isinstance(fault, WheelWeakened):
                state.effectiveness[j, w] = 1.0
            elif isinstance(fault, WheelFriction):
                state.coulomb[j, w] -= fault.coulomb_n_m
                state.viscous[j, w] -= fault.viscous_n_m_s

    def reallocate(self, entry: ScheduledFault) -> str:
        """Leave the failed wheels out from now on; returns what is left in words."""
        j = entry.spacecraft
        self._healthy[j, list(entry.wheels)] = False
        self.state.allocation[j] = allocate(self._axes, self._healthy[j])
        left = self._axes[self._healthy[j]]
        rank = int(np.linalg.matrix_rank(left)) if len(left) else 0
        return f"torque shared by {len(left)} wheels, control about {rank} axes"


@lru_cache(maxsize=8)
def _by_all(axes_B: bytes, w: int) -> Array:
    """See `allocate`, with all wheels healthy; the axes as the bytes of their array."""
    return allocate(np.frombuffer(axes_B).reshape(w, 3), np.ones(w, np.bool_))


def relative_inertia(properties: SpacecraftProperties, inertia_B: Array) -> Array:
    """Inertia that the speed of a wheel relative to its hub meets, 1 / (1/J_s + a.J_eff^-1.a), shape (n, w) [kg m^2]."""
    axes, spin = properties.wheel_axes_B, properties.wheel_spin_inertia
    inverse = np.linalg.inv(inertia_B - spin * axes.T @ axes)
    return 1.0 / (1.0 / spin + np.einsum("wi,nij,wj->nw", axes, inverse, axes))
