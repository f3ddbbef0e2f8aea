"""The levels at which an agent can act: how the actions of E flights reach them, through the plug-in protocols of any flight.

`torque` takes the place of the control law, `pointing` and `role` that of the behaviour. Each level holds the actions of the
present step, which is the one thing that these plug-ins remember by themselves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import error, spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.mission.behaviors import (
    Behavior,
    MissionBehavior,
    SteadyBehavior,
    SwarmView,
    TargetKind,
    Targets,
    looks_at_body,
)
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.typing import Array, Ints, Mask, kernel

from .patches import Patches, surface_points


class HeldTargets:
    """The behaviour of the level `role`: whatever the action says, in arrays that the level rewrites in place."""

    dedicated_communications: ClassVar[bool] = False

    def __init__(self, kind: Ints, spacecraft: Ints, vector: Array) -> None:
        self._targets = Targets(kind, spacecraft, vector)

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`; nothing is remembered between instants."""
        return self._targets, memory


class AimedTargets:
    """The behaviour of the level `pointing`: the scenario's, but the body is replaced by the points of the action."""

    dedicated_communications: ClassVar[bool] = False

    def __init__(self, inner: Behavior, points_A: Array) -> None:
        self._inner, self._points_A = inner, points_A
        self._steady = inner if isinstance(inner, SteadyBehavior) else None

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`."""
        targets, memory = self._inner.targets(view, memory)
        observing = looks_at_body(targets.kind)
        kind = np.where(observing, int(TargetKind.SURFACE), targets.kind)
        vector = np.where(observing[:, None], self._points_A, targets.vector)
        return Targets(kind, targets.spacecraft, vector), memory

    def steady_for(self, view: SwarmView, memory: Any) -> float:
        """See `SteadyBehavior`: as long as the scenario's, and until the next action."""
        return 0.0 if self._steady is None else self._steady.steady_for(view, memory)


class SpeaksToEarth:
    """The scenario's behaviour, but who is to talk to another spacecraft talks to Earth, which hears one after another.

    The levels `pointing` and `torque` fly it where crosslinks are directed. There a relay hears only those on one side of it,
    and no action of these levels could bring down what the others hold.
    """

    def __init__(self, inner: Behavior) -> None:
        self._inner = inner
        self._steady = inner if isinstance(inner, SteadyBehavior) else None

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self._inner.dedicated_communications

    def for_flight(self, plan: Any) -> Behavior:
        """See `MissionBehavior`."""
        inner = self._inner
        return SpeaksToEarth(inner.for_flight(plan)) if isinstance(inner, MissionBehavior) else self

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """See `Behavior`."""
        targets, memory = self._inner.targets(view, memory)
        kind = np.where(targets.kind == TargetKind.SPACECRAFT, int(TargetKind.EARTH), targets.kind)
        return targets._replace(kind=kind), memory

    def steady_for(self, view: SwarmView, memory: Any) -> float:
        """See `SteadyBehavior`."""
        return 0.0 if self._steady is None else self._steady.steady_for(view, memory)


def deliverable(plan: Plan) -> Behavior:
    """The scenario's behaviour, with which what is aboard comes down whatever the antennas."""
    return plan.behavior if antennas_from(plan.scenario).omnidirectional else SpeaksToEarth(plan.behavior)


class HeldTorque:
    """The control law of the level `torque`: whatever the action says, in an array that the level rewrites in place."""

    def __init__(self, torque_B: Array) -> None:
        self._torque_B = torque_B

    def torque(self, inputs: ControlInput, memory: Array | None) -> tuple[Array, Array | None]:
        """See `Controller`; nothing is remembered."""
        return self._torque_B, memory


class ControlLevel(ABC):
    """How actions become targets or torques, for E flights.

    Attributes:
        action_space: What the agent of one flight may choose.
        held: Targets that hold for the step, shape (E, n, ...); None where a behaviour decides at every instant.
        torque_B: Held torques on the bodies, shape (E, n, 3) [N m]; None where the control law decides.
    """

    action_space: spaces.Space[Any]
    held: Targets | None = None
    torque_B: Array | None = None

    @property
    @abstractmethod
    def remembered(self) -> tuple[NDArray[Any], ...]:
        """Arrays that hold the present actions, each with the number of the flight in front."""

    @abstractmethod
    def behavior(self, e: int) -> Behavior:
        """Who points at what in flight e."""

    def controller(self, e: int, law: Controller) -> Controller:
        """The control law of flight e."""
        return law

    @abstractmethod
    def reset(self, e: int) -> None:
        """Forget the previous action of flight e."""

    @abstractmethod
    def apply(self, actions: NDArray[Any], boresight_N: Array, live: Mask) -> None:
        """Take actions for the step that begins.

        Args:
            actions: In the action space, shape (E, size).
            boresight_N: Where +z looks in N, shape (E, n, 3).
            live: Flights that fly this step, shape (E,); the actions of the others are ignored.
        """


class TorqueLevel(ControlLevel):
    """Normalised motor torques; targets are those of the scenario's behaviour."""

    torque_B: Array

    def __init__(self, plan: Plan, count: int) -> None:
        self._limit, self._axes = plan.properties.max_wheel_torque, plan.properties.wheel_axes_B
        self._behavior = deliverable(plan)
        wheels = len(self._axes)
        self._shape = (count, plan.n, wheels)
        self.torque_B = np.zeros((count, plan.n, 3))
        self.action_space = _unit_box(wheels * plan.n)

    @property
    def remembered(self) -> tuple[NDArray[Any], ...]:
        """See `ControlLevel`."""
        return (self.torque_B,)

    def behavior(self, e: int) -> Behavior:
        """See `ControlLevel`: the scenario's own, see `deliverable`."""
        return self._behavior

    def controller(self, e: int, law: Controller) -> Controller:
        """See `ControlLevel`."""
        return HeldTorque(self.torque_B[e])

    def reset(self, e: int) -> None:
        """See `ControlLevel`."""
        self.torque_B[e] = 0.0

    def apply(self, actions: NDArray[Any], boresight_N: Array, live: Mask) -> None:
        """Motor torques u act on the wheels; the body feels L = -A^T u, with the wheel axes as rows of A."""
        motor = self._limit * np.asarray(actions, np.float64).reshape(self._shape)
        self.torque_B[live] = body_torques(motor, self._axes)[live]


class PointingLevel(ControlLevel):
    """Points of the target for the spacecraft that observe; who observes is the scenario's behaviour's choice."""

    def __init__(self, plan: Plan, count: int, tracer: RayTracer) -> None:
        self._region, self._tracer, self._inner, self._n = plan.region, tracer, deliverable(plan), plan.n
        self.action_space = _unit_box(2 * plan.n)
        self._middle = self._points(np.zeros(2 * plan.n))
        self._points_A = np.tile(self._middle, (count, 1, 1))

    @property
    def remembered(self) -> tuple[NDArray[Any], ...]:
        """See `ControlLevel`."""
        return (self._points_A,)

    def behavior(self, e: int) -> Behavior:
        """See `ControlLevel`."""
        return AimedTargets(self._inner, self._points_A[e])

    def reset(self, e: int) -> None:
        """See `ControlLevel`: the middle of the target."""
        self._points_A[e] = self._middle

    def apply(self, actions: NDArray[Any], boresight_N: Array, live: Mask) -> None:
        """See `ControlLevel`."""
        self._points_A[live] = self._points(np.asarray(actions)[live]).reshape(-1, self._n, 3)

    def _points(self, actions: NDArray[Any]) -> Array:
        return surface_points(self._region, self._tracer, np.asarray(actions, np.float64).reshape(-1, 2))


class Choices(NamedTuple):
    """What a spacecraft may be told to look at.

    Attributes:
        kinds: `TargetKind` values, of which the last is to hold the attitude, shape (c,).
        spacecraft: Whom, from 0, where that is a spacecraft, shape (c,).
        vectors: Points in A where that is one of the target, shape (c, 3) [m].
        itself: Each spacecraft's own place among them, shape (n,).
    """

    kinds: Ints
    spacecraft: Ints
    vectors: Array
    itself: Ints


class RoleLevel(ControlLevel):
    """One of a list of things to look at; the agent decides everything.

    The choices, in this order: the patches of the target, the asteroid's centre, every spacecraft, Earth, hold.

    Attributes:
        choices: For compiled code.
    """

    held: Targets

    def __init__(self, plan: Plan, count: int, patches: Patches) -> None:
        n, parts = plan.n, patches.count
        kinds = np.array(
            [TargetKind.SURFACE] * parts
            + [TargetKind.ASTEROID]
            + [TargetKind.SPACECRAFT] * n
            + [TargetKind.EARTH, TargetKind.DIRECTION],
            np.int64,
        )
        spacecraft = np.concatenate([np.zeros(parts + 1), np.arange(n), [0, 0]]).astype(np.int64)
        vectors = np.vstack([patches.centre_A, np.zeros((n + 3, 3))])
        self.choices = Choices(kinds, spacecraft, vectors, parts + 1 + np.arange(n))
        self._centre = parts
        self.held = Targets(np.zeros((count, n), np.int64), np.zeros((count, n), np.int64), np.zeros((count, n, 3)))
        self.action_space = spaces.MultiDiscrete(np.full(n, len(kinds)))

    @property
    def remembered(self) -> tuple[NDArray[Any], ...]:
        """See `ControlLevel`."""
        return tuple(self.held)

    def behavior(self, e: int) -> Behavior:
        """See `ControlLevel`."""
        return HeldTargets(*(part[e] for part in self.held))

    def reset(self, e: int) -> None:
        """See `ControlLevel`: the asteroid's centre."""
        kind, spacecraft, vector = self.held
        kinds, whom = self.choices.kinds, self.choices.spacecraft
        kind[e], spacecraft[e], vector[e] = kinds[self._centre], whom[self._centre], 0.0

    def apply(self, actions: NDArray[Any], boresight_N: Array, live: Mask) -> None:
        """See `ControlLevel`; a spacecraft told to look at itself holds its attitude."""
        choice = np.array(actions, np.int64).reshape(self.held.kind.shape)
        if not choose_targets(self.choices, choice, boresight_N, live, self.held):
            raise error.InvalidAction(f"choices {choice.tolist()}: must be 0 to {len(self.choices.kinds) - 1}")


@kernel
def choose_targets(choices: Choices, choice: Ints, boresight_N: Array, live: Mask, held: Targets) -> bool:
    """Let targets be what was chosen.

    Args:
        choices: What there is to choose from.
        choice: Their numbers, shape (E, n).
        boresight_N: Where +z looks in N, shape (E, n, 3).
        live: Flights to do so, shape (E,).
        held: Receives the targets, shape (E, n, ...).

    Returns:
        Whether there are such choices; nothing is written if not.
    """
    kinds, spacecraft, vectors, itself = choices
    last = kinds.shape[0] - 1  # to hold the attitude
    for e in range(choice.shape[0]):
        for j in range(choice.shape[1]):
            if choice[e, j] < 0 or choice[e, j] > last:
                return False
    for e in range(choice.shape[0]):
        if not live[e]:
            continue
        for j in range(choice.shape[1]):
            c = last if choice[e, j] == itself[j] else choice[e, j]
            goes_on = c == last and held.kind[e, j] == kinds[last]
            held.kind[e, j], held.spacecraft[e, j] = kinds[c], spacecraft[c]
            if not goes_on:
                for k in range(3):
                    held.vector[e, j, k] = boresight_N[e, j, k] if c == last else vectors[c, k]
    return True


def body_torques(motor: Array, axes_B: Array) -> Array:
    """Torques on the bodies [N m], shape (E, n, 3), of motor torques u on the wheels [N m], shape (E, n, w): L = -A^T u."""
    # Summed wheel by wheel: a product of matrices would round differently with their number.
    torque: Array = -sum(motor[:, :, w, None] * axes_B[w] for w in range(len(axes_B)))
    return torque


LEVELS = ("torque", "pointing", "role")


def make_level(name: str, plan: Plan, count: int, patches: Patches, tracer: RayTracer) -> ControlLevel:
    """The control level of that name for that many flights; `check_level` has accepted it."""
    if name == "torque":
        return TorqueLevel(plan, count)
    if name == "pointing":
        return PointingLevel(plan, count, tracer)
    return RoleLevel(plan, count, patches)


def check_level(name: str) -> None:
    """Refuse unknown control levels.

    Raises:
        ScenarioError: The message lists those that exist.
    """
    if name not in LEVELS:
        raise ScenarioError(f"control = {name!r}: must be one of {', '.join(LEVELS)}")


def check_action(space: spaces.Space[Any], action: Any) -> NDArray[Any]:
    """The action as an array of the space's own type.

    Raises:
        gymnasium.error.InvalidAction: It does not lie in the space.
    """
    try:
        given = np.asarray(action)
        if given.dtype.kind not in "biuf":
            raise TypeError
        with np.errstate(invalid="ignore"):
            array = given.astype(space.dtype, copy=False)
        exact = array is given or space.dtype == np.float32 or np.array_equal(array, given)
    except (TypeError, ValueError, OverflowError):
        exact, array = False, action
    if not exact or not space.contains(array):
        raise error.InvalidAction(f"action {' '.join(repr(action).split())} does not lie in the action space {space}")
    return np.asarray(array)


def _unit_box(size: int) -> spaces.Box:
    return spaces.Box(-1.0, 1.0, (size,), np.float32)
