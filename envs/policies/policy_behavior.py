"""Policies of the control level `role` as behaviours of scripted flights, for `swarm-mj run`.

A policy must know what has been seen and sent so far, which no `SwarmView` tells. The behaviour keeps these totals by itself,
with the same code as the environment: at every control instant it looks at the attitudes it is given, judges the pictures that
are due with the scenario's camera and the horizon maps, and every `step_s` reads its observation and decides. For the same
seed it decides as the policy does in the environment, unless sensor noise or delay is flown: behaviours are given true
attitudes.

The swarm is the environment's, too: where the scenario's own behaviour brings a dedicated communications spacecraft, that one
flies along and the policy decides for it as for the others. It takes no pictures.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.plan import Plan, unchecked_behavior
from swarm_mj.io.resources import asset_path
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Array32, Ints, Mask

from ..arguments import checked_step
from ..observe.actions import RoleLevel
from ..observe.episode_state import EpisodeState
from ..observe.observations import LAYOUT
from ..observe.radio import transmit
from ..observe.task import Task, make_task
from .baselines import POLICIES
from .policy import ENVIRONMENT, ArrayPolicy, load_policy
from .provenance import check_provenance

Act = Callable[[Array32], Ints]

#: The trained policy that travels with the package.
PACKAGED = "policies/eros-observe.npz"

#: Scripted policies by the names that a scenario knows.
SCRIPTED = {name.replace(" ", "_"): policy for name, policy in POLICIES.items()}


def policy_overrides(policy: str, scenario: Scenario) -> list[str]:
    """What has to be set in a scenario for a policy to fly it, with the same swarm as the scenario's own behaviour.

    Args:
        policy: A scripted one by name, `trained` for the packaged one, or a file of `swarm_mj.envs.policies.policy`.
        scenario: As it is without the policy.

    Raises:
        MissionError: It is neither a name nor a file.
        PluginError: The scenario's own behaviour, which says what the swarm is, cannot be had.
    """
    if policy not in SCRIPTED and policy != "trained" and not Path(policy).is_file():
        raise MissionError(f"--policy {policy!r}: no such file, and no name; names are trained, {', '.join(SCRIPTED)}")
    name = "scripted_policy" if policy in SCRIPTED else "trained_policy"
    parameters: dict[str, Any] = {}
    if policy != "trained":
        parameters["policy" if policy in SCRIPTED else "file"] = policy
    if unchecked_behavior(scenario).dedicated_communications:
        parameters["dedicated_communications"] = True
    return [f"behavior.name={name}", f"behavior.parameters={json.dumps(parameters)}"]


@dataclass(frozen=True)
class ScriptedPolicy:
    """One of the scripted policies of `swarm_mj.envs.policies.baselines`.

    Attributes:
        n_observers: Number of spacecraft that observe.
        imaging_radius_m: R_im [m].
        policy: `body_centre`, `target_centre`, `sweep`, `greedy` or `greedy_ahead`.
        step_s: Time between decisions [s].
        dedicated_communications: Whether one more spacecraft flies along, which takes no pictures.

    Raises:
        MissionError: The policy is unknown, or `dedicated_communications` is neither true nor false.
    """

    n_observers: int
    imaging_radius_m: float
    policy: str = "greedy"
    step_s: float = 10.0
    dedicated_communications: bool = False

    def __post_init__(self) -> None:
        """Refuse unknown policies."""
        if self.policy not in SCRIPTED:
            raise MissionError(f"behavior.parameters.policy = {self.policy!r}: must be one of {', '.join(SCRIPTED)}")
        _check_dedicated(self.dedicated_communications)

    def check_scenario(self, scenario: Scenario) -> None:
        """Refuse a scenario whose times do not fit the policy's step."""
        _check_step(scenario, self.step_s)

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight."""
        task = _task_of(plan, self.step_s)
        return PolicyFlight(task, partial(SCRIPTED[self.policy], task))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise _needs_a_flight("scripted_policy")


@dataclass(frozen=True)
class TrainedPolicy:
    """A policy from a file of `swarm_mj.envs.policies.policy`.

    Attributes:
        n_observers: Number of spacecraft that observe.
        imaging_radius_m: R_im [m].
        file: The file; empty for the one that travels with the package, trained for `eros-observe`.
        dedicated_communications: Whether one more spacecraft flies along, which takes no pictures.

    Raises:
        MissionError: `dedicated_communications` is neither true nor false.
    """

    n_observers: int
    imaging_radius_m: float
    file: str = ""
    dedicated_communications: bool = False

    def __post_init__(self) -> None:
        """Refuse what is no answer to a yes-or-no question."""
        _check_dedicated(self.dedicated_communications)

    def check_scenario(self, scenario: Scenario) -> None:
        """Refuse a scenario with another number of spacecraft than trained for, or whose times do not fit the policy's step.

        Raises:
            ScenarioError: So it is, the file cannot be read, or it is of another environment or layout of observations.
            MissionError: The times do not fit.
        """
        about = self._policy().about
        check_provenance(about, ENVIRONMENT, LAYOUT)
        trained = about.get("spacecraft")
        if trained != self.n_observers + self.dedicated_communications:
            message = (
                f"behavior.name = 'trained_policy': trained for {trained} spacecraft, but design.visiting_points of "
                f"{scenario.name} gives {self.n_observers}"
            )
            if self.dedicated_communications:
                message += " and behavior.parameters.dedicated_communications = true one more"
            elif trained == self.n_observers + 1:
                message += "; behavior.parameters.dedicated_communications = true would add one"
            raise ScenarioError(message)
        _check_step(scenario, float(about["step_s"]))

    def _policy(self) -> ArrayPolicy:
        return load_policy(self.file or str(asset_path(PACKAGED)))

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight.

        Raises:
            ScenarioError: The file cannot be read, or was trained for another swarm or target grid.
        """
        policy = self._policy()
        task = _task_of(plan, float(policy.about["step_s"]), policy.geometry.count)
        return PolicyFlight(task, policy.for_task(task).act)

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise _needs_a_flight("trained_policy")


class PolicyFlight:
    """A policy at work in one flight.

    Args:
        task: Of an environment of the same mission, at the control level `role`.
        act: From an observation to an action.
    """

    def __init__(self, task: Task, act: Act) -> None:
        self.task, self._act = task, act

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.task.plan.behavior.dedicated_communications

    def targets(self, view: SwarmView, memory: FollowedEpisode | None) -> tuple[Targets, FollowedEpisode]:
        """See `Behavior`; the memory is the state of the episode, brought up to date in place.

        Raises:
            MissionError: The view tells no attitudes.
        """
        if view.q_BN is None:
            raise MissionError("a policy as behaviour needs attitudes: it can fly, but no design can be made with it")
        followed = FollowedEpisode(self.task) if memory is None else memory
        return followed.follow(view, self._act), followed


class FollowedEpisode(EpisodeState):
    """The state of one flight that something else flies, and what a policy decides in it.

    Args:
        task: Of an environment of the same mission, at the control level `role`.
    """

    flights: _ViewSource

    def __init__(self, task: Task) -> None:
        plan = task.plan
        self._level = RoleLevel(plan, 1, task.patches)
        self._level.reset(0)
        self._radio = task.radio_constants, task.occluder
        super().__init__(task, _ViewSource(plan.n, plan.scenario.control.period_s, self._level.held))

    def follow(self, view: SwarmView, act: Act) -> Targets:
        """Bring the episode up to this instant; the targets that hold from now on."""
        task, begins = self.task, self.flights.view is None
        self.flights.update(view)
        tick, everyone = int(self.flights.tick[0]), np.ones(1, np.bool_)
        # Nothing is decided at the end of a flight: the last picture is that of the last step.
        if begins or (tick % task.ticks == 0 and tick < task.last_tick):
            self._shift_instants()
            self._update_kinematics(self.now, everyone)
            if not begins:
                transmit(*self._radio, self.now, self._tracking(), self.totals, everyone, np.zeros(1))
            self._observe(everyone)
            self._level.apply(act(self.observation[0])[None], self.now.C_BN[:, :, 2], everyone)
        if task.is_due[tick]:
            self._take_pictures(everyone, np.zeros(1))
        return Targets(*(part[0].copy() for part in self._level.held))


class _ViewSource:
    """What an `EpisodeState` reads, taken from a `SwarmView`; attitude errors, losses and blindness are not known.

    Args:
        n: Number of spacecraft.
        period: Time between two decisions [s].
        held: Targets, rewritten in place by who decides, shape (1, n, ...).
    """

    def __init__(self, n: int, period: float, held: Targets) -> None:
        self.count, self.period = 1, period
        self.view: SwarmView | None = None
        self.tick = np.zeros(1, np.int64)
        self.kind, self.index, _ = held
        self.sigma_BR = np.zeros((1, n, 3))
        self.lost, self.blind = np.zeros((1, n), np.bool_), np.zeros((1, n), np.bool_)

    def update(self, view: SwarmView) -> None:
        """Take the swarm as it is now."""
        self.view = view
        self.tick[0] = round(view.t / self.period)

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """See `Batch`."""
        assert self.view is not None
        r[0], v[0], q[0] = self.view.r_BN_N, self.view.v_BN_N, self.view.q_BN
        omega[0], wheel[0] = self.view.omega_BN_B, self.view.wheel_speed

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """See `Batch`: what is shown is taken for the truth."""
        return np.zeros(1, np.bool_)


def _task_of(plan: Plan, step_s: float, patches: int = 16) -> Task:
    """The task of an environment that flies the same mission."""
    given = plan.scenario
    # The level `role` asks no behaviour, but the behaviour says whether one more spacecraft flies along; one that needs a
    # task must not ask for another.
    name = "dedicated_communications" if plan.n > plan.n_observers else "adaptable_roles"
    behavior = given.behavior.model_copy(update={"name": name, "parameters": {}})
    try:
        return make_task(scenario=given.model_copy(update={"behavior": behavior}), step_s=step_s, patches=patches)
    except ScenarioError as error:
        raise MissionError(f"behavior.name = {given.behavior.name!r}: {error}") from None


def _check_step(scenario: Scenario, step_s: float) -> None:
    try:
        checked_step(scenario, step_s)
    except ScenarioError as error:
        raise MissionError(f"behavior.name = {scenario.behavior.name!r}: {error}") from None


def _check_dedicated(given: Any) -> None:
    if not isinstance(given, bool):
        raise MissionError(f"behavior.parameters.dedicated_communications = {given!r}: must be true or false")


def _needs_a_flight(name: str) -> MissionError:
    return MissionError(f"behavior.name = {name!r}: it can fly, but no design can be made with it: it needs attitudes")
