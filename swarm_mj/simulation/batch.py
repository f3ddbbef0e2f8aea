"""Many flights of one swarm at once, on `mujoco.batch.Batch`: bit for bit what `Simulation` flies, with little overhead.

The flights share model, gravity and control law; each has its own state, time and targets. What `Simulation` can do and this
cannot (other gravity fields and control laws, perturbations) is listed by `why_not_batched`; `SeparateFlights` then serves
with the same interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.base import ControlInput, Controller
from swarm_mj.attitude.controllers.sliding_mode import MrpSlidingMode
from swarm_mj.attitude.mrp import quaternion_from_mrp
from swarm_mj.errors import PluginError
from swarm_mj.mission.behaviors import Behavior, SteadyBehavior, SwarmView
from swarm_mj.simulation import batch_kernels
from swarm_mj.simulation.batch_kernels import Flights, Number, World
from swarm_mj.simulation.kernels import Slot
from swarm_mj.simulation.native import load_mujoco
from swarm_mj.simulation.simulation import SPEED_MARGIN, InitialState, Simulation
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.spacecraft.model import NQ, NV

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Where lost spacecraft stand, times their number [m].
PARKED = 1e7
#: Most control periods for which a behaviour is not asked.
LONGEST_REST = 1_000_000
#: Places in MuJoCo's state vector that the kernels read or write, in the order of `World.at`.
_FIELDS = ("qpos", "qvel", "ctrl", "xfrc_applied", "mocap_quat")


def why_not_batched(simulation: Simulation, controller: Controller | None) -> str:
    """What of a simulation the batch does not know, in words; empty if it can fly it.

    Args:
        simulation: One flight, as it would fly alone.
        controller: The control law; None where torques are held.
    """
    if simulation._adverse is not None:
        return "faults, dispersions or a fourth wheel"
    if controller is not None and type(controller) is not MrpSlidingMode:
        return f"the control law {type(controller).__name__}"
    if type(simulation.environment.gravity) is not SphericalHarmonics:
        return f"the gravity field {type(simulation.environment.gravity).__name__}"
    if simulation.environment.perturbed or simulation._gradient_gm > 0.0:
        return "perturbations"
    return ""


class BatchFlights:
    """E flights of one swarm.

    Args:
        simulation: One flight as it would fly alone: model, environment, spacecraft and control period are taken from it.
        count: Number of flights E.
        controller: The control law; None where torques are held, see `torque_B`.
        behaviors: Who points at what in each flight; None where `kind`, `index` and `vector` are set from outside.

    Attributes:
        n: Number of spacecraft.
        kind: `TargetKind` values, shape (E, n).
        index: Spacecraft to follow, shape (E, n).
        vector: Surface point in A [m] or direction in N, shape (E, n, 3).
        torque_B: Torques on the bodies, shape (E, n, 3) [N m]; to be set where they are held.
        tick: Control periods flown, shape (E,).
        finite: False where the flight has diverged, shape (E,).
        causes: Why, by flight.
        lost: Spacecraft lost to faults, of which a batch knows none, shape (E, n).
        blind: Spacecraft whose camera is off or that are lost; none in a batch, shape (E, n).
        effort: Sum of the squares of all motor torques since the caller last set it to zero, shape (E,) [N^2 m^2].
    """

    def __init__(
        self,
        simulation: Simulation,
        count: int,
        controller: Controller | None,
        behaviors: Sequence[Behavior] | None = None,
    ) -> None:
        self.model, self.environment, self.period = simulation.model, simulation.environment, simulation.period
        self.n, self.count = self.model.n, count
        self._hold = round(self.period / self.model.mjmodel.opt.timestep)
        state, self._bound = self._bind()
        self._q, self._v = self._by_spacecraft("qpos", NQ), self._by_spacecraft("qvel", NV)
        self._behaviors, self._memory = behaviors, [None] * count
        self._steady_for = [b.steady_for if isinstance(b, SteadyBehavior) else _no_time for b in behaviors or ()]
        self._ask_at = np.zeros(count, np.int64)  # tick at which the behaviour must be asked again
        self._held = controller is None
        if controller is not None:
            _check_law(controller, simulation)
        self._world = _world(simulation, controller, self._places(state))
        self._flights = _flights(state, count, self.n)
        f = self._flights
        self.kind, self.index, self.vector, self.torque_B = f.targets[:, 0], f.targets[:, 1], f.vector, f.torque_B
        self.tick, self.finite, self.effort = f.tick, f.finite, f.effort
        self.lost, self.blind = np.zeros((count, self.n), np.bool_), np.zeros((count, self.n), np.bool_)
        self.causes = [""] * count

    def _by_spacecraft(self, name: str, size: int) -> Array:
        """A live view of a bound field, shape (E, n, size)."""
        array = self._bound[name]
        strides = (array.strides[0], 8 * size, 8)
        return np.lib.stride_tricks.as_strided(array, (self.count, self.n, size), strides)

    def _bind(self) -> tuple[Array, dict[str, Array]]:
        """State vectors of all flights, and live views of the fields that are read or written."""
        self._batch = Batch(self.model.mjmodel, self.count, 1)
        return np.asarray(self._batch.state), {name: self._batch.bind(name) for name in _FIELDS}

    def _clear(self, e: int) -> None:
        self._batch.reset(ids=[e], stage=mujoco.mjtStage.mjSTAGE_NONE)

    def _places(self, state: Array) -> NDArray[np.int64]:
        start = state.ctypes.data
        return np.array([(array.ctypes.data - start) // 8 for array in self._bound.values()], np.int64)

    @property
    def qpos(self) -> Array:
        """MuJoCo's positions, live, shape (E, nq)."""
        return self._bound["qpos"]

    @property
    def qvel(self) -> Array:
        """MuJoCo's velocities, live, shape (E, nv)."""
        return self._bound["qvel"]

    @property
    def ctrl(self) -> Array:
        """Motor torques, live, shape (E, 3 n) [N m]."""
        return self._bound["ctrl"]

    @property
    def sigma_BR(self) -> Array:
        """Attitude errors at the last decision, shape (E, n, 3)."""
        return self._flights.work[:, Slot.SIGMA_BR]

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """Copy positions and velocities in N [m, m/s], attitudes, body rates and wheel speeds [rad/s], shape (E, n, ...)."""
        r[:], q[:] = self._q[:, :, :3], self._q[:, :, 3:7]
        v[:], omega[:], wheel[:] = self._v[:, :, :3], self._v[:, :, 3:6], self._v[:, :, 6:]

    def reset(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start and forget everything about it."""
        f = self._flights
        self._clear(e)
        qpos, qvel = self._q[e], self._v[e]
        qpos[:, :3], qpos[:, 3:7] = initial.r_BN_N, quaternion_from_mrp(initial.sigma_BN)
        qvel[:, :3], qvel[:, 3:6], qvel[:, 6:9] = initial.v_BN_N, initial.omega_BN_B, initial.wheel_speed
        f.tick[e], f.targets[e, 2:], f.finite[e], f.effort[e], f.peaks[e] = 0, -1, True, 0.0, 0.0
        self._memory[e], self._ask_at[e], self.causes[e] = None, 0, ""

    def park(self, e: int, j: int) -> None:
        """Put a spacecraft that is no more where it disturbs nothing: far out, at rest."""
        self._q[e, j, :3], self._v[e, j] = (PARKED * (1.0 + j), 0.0, 0.0), 0.0
        self._ask_at[e] = 0

    def ask_again(self) -> None:
        """Have all behaviours asked at the next decision, because they have been told something new."""
        self._ask_at[:] = 0

    def decide(self, live: Mask) -> bool:
        """Set forces and motor torques of the coming hold; a flight whose state is not finite is marked in `finite`.

        Args:
            live: Which flights, shape (E,).

        Returns:
            Whether all of them are finite.

        Raises:
            PluginError: A behaviour aims at what is not there.
        """
        if self._behaviors is not None:
            self._ask_behaviors(live)
        return self._judge(self._call(live), live)

    def _call(self, live: Mask) -> int:
        return int(batch_kernels.decide(self._world, self._flights, live, self._held))

    def _judge(self, answer: int, live: Mask) -> bool:
        if answer == batch_kernels.SENSELESS:
            raise PluginError("the behaviour aims at what is not there: an unknown kind, or a spacecraft that is not")
        if answer == batch_kernels.NOT_FINITE:
            for e in np.flatnonzero(live & ~self.finite):
                self.causes[e] = self._divergence(int(e))
        return bool(answer == batch_kernels.FINE)

    def _ask_behaviors(self, live: Mask) -> None:
        assert self._behaviors is not None
        for e in np.flatnonzero(live & (self.tick >= self._ask_at)).tolist():
            t = int(self.tick[e]) * self.period
            q, v = self._q[e].copy(), self._v[e].copy()
            view = SwarmView(t, q[:, :3], v[:, :3], self.environment.C_AN(t), q[:, 3:], v[:, 3:6], v[:, 6:])
            targets, self._memory[e] = self._behaviors[e].targets(view, self._memory[e])
            self.kind[e], self.index[e], self.vector[e] = targets
            rest = self._steady_for[e](view, self._memory[e]) / self.period
            self._ask_at[e] = self.tick[e] + max(1, int(min(rest, LONGEST_REST)))

    def fly(self, periods: int, live: Mask) -> bool:
        """Decide and advance so many control periods of the live flights; one that is not finite stops.

        Returns:
            Whether all of them are finite.
        """
        flying, fine = live, True
        for _ in range(periods):
            if not self.decide(flying):
                flying, fine = flying & self.finite, False
            self.advance(None if fine and flying.all() else flying)
        return fine

    def advance(self, live: Mask | None) -> None:
        """Let MuJoCo integrate one control period of the live flights, None for all, with everything held."""
        if live is None:
            self._batch.step(nstep=self._hold)
            self.tick += 1
        else:
            self._batch.step(ids=np.flatnonzero(live), nstep=self._hold)
            self.tick[live] += 1

    def _divergence(self, e: int) -> str:
        state = np.hstack((self._q[e], self._v[e]))
        name = self.model.names[int(np.argmin(np.isfinite(state).all(axis=1)))]
        return f"the flight diverged: {name} has a state that is not finite at t = {self.tick[e] * self.period:g} s"


def _no_time(view: SwarmView, memory: Any) -> float:
    return 0.0


def _check_law(controller: Controller, simulation: Simulation) -> None:
    """Let the law refuse a control period that is too long for it; the answer depends on nothing that changes in flight."""
    inputs: ControlInput = simulation._inputs
    controller.torque(inputs, None)


def _world(simulation: Simulation, controller: Controller | None, at: NDArray[np.int64]) -> World:
    environment, properties, gravity = simulation.environment, simulation.properties, simulation.environment.gravity
    inputs = simulation._inputs
    numbers = np.zeros(Number.LAW + 7)
    numbers[Number.PHASE0], numbers[Number.SPIN_RATE] = environment.phase0, environment.spin_rate
    numbers[Number.PERIOD], numbers[Number.MASS] = simulation.period, properties.mass
    numbers[Number.WHEEL_INERTIA], numbers[Number.SPEED_GAIN] = properties.wheel_spin_inertia, simulation._speed_gain
    numbers[Number.MAX_TORQUE] = properties.max_wheel_torque
    numbers[Number.MAX_SPEED] = (1.0 - SPEED_MARGIN) * properties.max_wheel_speed
    numbers[Number.RADIUS] = gravity.reference_radius  # type: ignore[attr-defined]
    numbers[Number.Q_P : Number.Q_P + 4] = simulation._q_P
    numbers[Number.LAW :] = _law(controller)
    moving = [simulation._spin_N, environment.earth.position, environment.earth.velocity]
    return World(
        at=np.append(at, simulation.model.mjmodel.nbody),
        hub=simulation._hub,
        numbers=numbers,
        frames=np.array([simulation._C_PN, simulation._axes, simulation._allocation, moving], np.float64),
        inertia=np.array([inputs.inertia_B, inputs.inertia_effective_B]),
        table=gravity._table,  # type: ignore[attr-defined]
        series=gravity._acceleration_series,  # type: ignore[attr-defined]
    )


def _law(controller: Controller | None) -> Array:
    if not isinstance(controller, MrpSlidingMode):
        return np.zeros(7)
    limit = inf if controller.rate_limit is None else controller.rate_limit
    names = ("reaching_rate", "layer", "damping", "disturbance_torque", "inertia_uncertainty")
    return np.array([controller.slope, limit, *(getattr(controller, name) for name in names)], np.float64)


def _flights(state: Any, count: int, n: int) -> Flights:
    return Flights(
        state=np.asarray(state),
        tick=np.zeros(count, np.int64),
        finite=np.ones(count, np.bool_),
        targets=np.full((count, 4, n), -1, np.int64),
        vector=np.zeros((count, n, 3)),
        q=np.zeros((count, 2, n, 4)),
        C=np.zeros((count, 3, 3, 3)),
        work=np.zeros((count, len(Slot), n, 3)),
        torque_B=np.zeros((count, n, 3)),
        peaks=np.zeros((count, n, 3)),
        effort=np.zeros(count),
    )


class LoneFlight(BatchFlights):
    """A batch of one, on an MjData of its own and without a thread pool: whole stretches are flown in compiled code."""

    def __init__(self, simulation: Simulation, controller: Controller | None, behavior: Behavior | None = None) -> None:
        load_mujoco()
        model = simulation.model.mjmodel
        self._data = mujoco.MjData(model)
        super().__init__(simulation, 1, controller, None if behavior is None else [behavior])
        data = self._data
        mocap = data.mocap_quat[simulation.model.asteroid_mocap]
        self._fields = (data.qpos, data.qvel, data.ctrl, data.xfrc_applied, mocap)
        self._addresses = model._address, data._address

    def _bind(self) -> tuple[Array, dict[str, Array]]:
        bound = {name: getattr(self._data, name).reshape(1, -1) for name in _FIELDS}
        return np.zeros((1, 1)), bound  # the kernel is given the fields themselves

    def _clear(self, e: int) -> None:
        mujoco.mj_resetData(self.model.mjmodel, self._data)

    def _call(self, live: Mask, periods: int = 0) -> int:
        model, data = self._addresses
        return int(
            batch_kernels.fly(self._world, self._flights, self._fields, model, data, self._held, self._hold, periods)
        )

    def fly(self, periods: int, live: Mask) -> bool:
        """See `BatchFlights.fly`; compiled as a whole from one question to a behaviour to the next."""
        if not live[0]:
            return True
        fine = True
        while periods and fine:
            stretch = periods
            if self._behaviors is not None:
                self._ask_behaviors(live)
                stretch = min(periods, int(self._ask_at[0] - self.tick[0]))
            fine = self._judge(self._call(live, stretch), live)
            periods -= stretch
        return fine

    def advance(self, live: Mask | None) -> None:
        """See `BatchFlights.advance`."""
        if live is None or live[0]:
            mujoco.mj_step(self.model.mjmodel, self._data, nstep=self._hold)
            self.tick += 1
