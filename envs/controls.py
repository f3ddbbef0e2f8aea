"""The control levels: how an action reaches the simulation, through the same plug-in protocols as any behaviour or control law.

`torque` takes the place of the control law, `pointing` and `role` that of the behaviour. Each level holds the action of the
present step, which is the one thing these plug-ins remember by themselves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from gymnasium import error, spaces
from numpy.typing import NDArray

from swarm_mj.attitude.controllers.base import ControlInput, Controller
from swarm_mj.errors import ScenarioError
from swarm_mj.mission.behaviors import Behavior, SwarmView, TargetKind, Targets
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.planning import Plan

from .patches import Patches, surface_points
from .pictures import IS_OBSERVING
from .state import SwarmState

Array = NDArray[np.float64]


class RecordingController:
    """Hands everything to a control law and keeps the attitude error it was shown."""

    def __init__(self, law: Controller, n: int) -> None:
        self._law, self.sigma_BR = law, np.zeros((n, 3))

    def torque(self, inputs: ControlInput, memory: Any) -> tuple[Array, Any]:
        """See `Controller`."""
        self.sigma_BR = inputs.sigma_BR.copy()
        return self._law.torque(inputs, memory)


class HeldTorque:
    """The control law of the level `torque`: whatever the action says."""

    def __init__(self, n: int) -> None:
        self.torque_B = np.zeros((n, 3))

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """See `Controller`; nothing is remembered."""
        return self.torque_B, memory


class ControlLevel(ABC):
    """How actions become targets or torques.

    Attributes:
        action_space: What the agent may choose.
        behavior: Who points at what, for the simulation.
        controller: The control law, for the simulation; it keeps the attitude error.
        dedicated_communications: Asked of every behaviour; the swarm is planned by then, so that nothing depends on it.
    """

    action_space: spaces.Space[Any]
    behavior: Behavior
    controller: RecordingController
    dedicated_communications: ClassVar[bool] = False

    @abstractmethod
    def reset(self) -> None:
        """Forget the previous action."""

    @abstractmethod
    def hold(self, action: Any, state: SwarmState) -> None:
        """Take an action for the step that begins; it lies in the action space."""


class TorqueLevel(ControlLevel):
    """Normalised motor torques; targets are those of the scenario's behaviour."""

    def __init__(self, plan: Plan) -> None:
        self._limit = plan.properties.max_wheel_torque
        self._axes = plan.properties.wheel_axes_B
        self._held = HeldTorque(plan.n)
        self.behavior, self.controller = plan.behavior, RecordingController(self._held, plan.n)
        self.action_space = _unit_box(3 * plan.n)

    def reset(self) -> None:
        """See `ControlLevel`."""
        self._held.torque_B = np.zeros_like(self._held.torque_B)

    def hold(self, action: Any, state: SwarmState) -> None:
        """Motor torques u act on the wheels; the body feels L = -A^T u, with the wheel axes as rows of A."""
        motor = self._limit * np.asarray(action, np.float64).reshape(-1, 3)
        self._held.torque_B = -motor @ self._axes


class PointingLevel(ControlLevel):
    """Points of the target for the spacecraft that observe; who observes is the scenario's behaviour's choice."""

    def __init__(self, plan: Plan, tracer: RayTracer) -> None:
        self._region, self._tracer, self._inner, self._n = plan.region, tracer, plan.behavior, plan.n
        self.behavior, self.controller = self, RecordingController(plan.controller, plan.n)
        self.action_space = _unit_box(2 * plan.n)
        self.reset()

    def reset(self) -> None:
        """See `ControlLevel`: the middle of the target."""
        self._points_A = surface_points(self._region, self._tracer, np.zeros((self._n, 2)))

    def hold(self, action: Any, state: SwarmState) -> None:
        """See `ControlLevel`."""
        self._points_A = surface_points(self._region, self._tracer, np.asarray(action, np.float64).reshape(-1, 2))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`: the scenario's targets, but the asteroid is replaced by the point of the action."""
        targets, memory = self._inner.targets(view, memory)
        observing = IS_OBSERVING[targets.kind]
        kind = np.where(observing, int(TargetKind.SURFACE), targets.kind)
        vector = np.where(observing[:, None], self._points_A, targets.vector)
        return Targets(kind, targets.spacecraft, vector), memory


class RoleLevel(ControlLevel):
    """One of a list of things to look at; the agent decides everything.

    The choices, in this order: the patches of the target, the asteroid's centre, every spacecraft, Earth, hold.
    """

    def __init__(self, plan: Plan, patches: Patches) -> None:
        n, count = plan.n, patches.count
        self._kinds = np.array(
            [TargetKind.SURFACE] * count
            + [TargetKind.ASTEROID]
            + [TargetKind.SPACECRAFT] * n
            + [TargetKind.EARTH, TargetKind.DIRECTION],
            np.int64,
        )
        self._spacecraft = np.concatenate([np.zeros(count + 1), np.arange(n), [0, 0]]).astype(np.int64)
        self._vectors = np.vstack([patches.centre_A, np.zeros((n + 3, 3))])
        self._self = count + 1 + np.arange(n)
        self._n, self._centre, self._hold = n, count, len(self._kinds) - 1
        self.behavior, self.controller = self, RecordingController(plan.controller, n)
        self.action_space = spaces.MultiDiscrete(np.full(n, len(self._kinds)))
        self.reset()

    def reset(self) -> None:
        """See `ControlLevel`: the asteroid's centre."""
        self._choose(np.full(self._n, self._centre), np.zeros((self._n, 3)))

    def hold(self, action: Any, state: SwarmState) -> None:
        """See `ControlLevel`; a spacecraft told to look at itself holds its attitude."""
        choice = np.array(action, np.int64)
        choice[choice == self._self] = self._hold
        goes_on = (choice == self._hold) & (self._targets.kind == TargetKind.DIRECTION)
        self._choose(choice, np.where(goes_on[:, None], self._targets.vector, state.boresight_N))

    def _choose(self, choice: NDArray[np.int64], direction_N: Array) -> None:
        kind, vector = self._kinds[choice], self._vectors[choice]
        held = kind == TargetKind.DIRECTION
        self._targets = Targets(kind, self._spacecraft[choice], np.where(held[:, None], direction_N, vector))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`; nothing is remembered between instants."""
        return self._targets, memory


LEVELS = ("torque", "pointing", "role")


def make_level(name: str, plan: Plan, patches: Patches, tracer: RayTracer) -> ControlLevel:
    """The control level of that name; `check_level` has accepted it."""
    if name == "torque":
        return TorqueLevel(plan)
    if name == "pointing":
        return PointingLevel(plan, tracer)
    return RoleLevel(plan, patches)


def check_level(name: str) -> None:
    """Refuse unknown control levels.

    Raises:
        ScenarioError: The message lists those that exist.
    """
    if name not in LEVELS:
        raise ScenarioError(f"control = {name!r}: must be one of {', '.join(LEVELS)}")


def check_action(space: spaces.Space[Any], action: Any) -> Any:
    """The action as an array of the space's own type.

    Raises:
        gymnasium.error.InvalidAction: It does not lie in the space.
    """
    try:
        given = np.asarray(action)
        with np.errstate(invalid="ignore"):
            array = given.astype(space.dtype)
        exact = space.dtype == np.float32 or np.array_equal(array, given)
    except (TypeError, ValueError):
        exact, array = False, action
    if not exact or not space.contains(array):
        raise error.InvalidAction(f"action {action!r} does not lie in the action space {space}")
    return array


def _unit_box(size: int) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, (size,), np.float32)
