"""Policies of SwarmObserve-v0 as behaviours of scripted flights, for `swarm-mj fly`.

A policy must know what has been seen and sent so far, which no `SwarmView` tells. The behaviour keeps these totals by itself,
with the same code as the environment: at every control instant it looks at the attitudes it is given, judges the pictures that
are due with the scenario's camera and the horizon maps, and every `step_s` reads its tables and decides. For the same seed it
decides as the policy does in the environment with `scenario=`, unless sensor noise or delay is flown: behaviours are given true
attitudes.

The swarm is the environment's, too: where the scenario's own behaviour brings a dedicated communications spacecraft, that one
flies along and the policy decides for it as for the others. It takes no pictures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.plan import Plan, unchecked_behavior
from swarm_mj.flight.refusals import refuse_turned_cameras_and_companions
from swarm_mj.io.resources import asset_path
from swarm_mj.mission.behaviors import Behavior, SwarmView, TargetKind, Targets
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Mask

from ..arguments import checked_step
from ..observe.config import EnvConfig
from ..observe.flybys import DECISION_S
from ..observe.kinematics import AttitudeEstimate, Kinematics
from ..observe.layout import observed_from
from ..observe.mission import Mission
from ..observe.state import EpisodeState
from .baselines import Policy, scripted_policies
from .policy_files import PACKAGED, open_policy, policy_file, told_arguments

#: Scripted policies by the names that a scenario knows.
NAMES = ("sweep", "greedy", "greedy_ahead")


def policy_overrides(policy: str, scenario: Scenario) -> dict[str, Any]:
    """What has to be set in a scenario for a policy to fly it, with the same swarm as the scenario's own behaviour.

    A policy is a scripted one by name, `trained` for the packaged one, or a file, see `policy_files`.

    Raises:
        MissionError: It is neither a name nor a file.
        PluginError: The scenario's own behaviour, which says what the swarm is, cannot be had.
    """
    if policy not in NAMES and policy != "trained":
        policy_file("--policy", policy, ("trained", *NAMES), MissionError)
    name = "scripted_policy" if policy in NAMES else "trained_policy"
    parameters: dict[str, Any] = {}
    if policy != "trained":
        parameters["policy" if policy in NAMES else "file"] = policy
    if unchecked_behavior(scenario).dedicated_communications:
        parameters["dedicated_communications"] = True
    return {"behavior.name": name, "behavior.parameters": parameters}


@dataclass(frozen=True)
class _PolicyBehavior:
    """What scripted and trained policies have in common.

    Attributes:
        n_observers: Number of spacecraft that observe.
        imaging_radius_m: R_im [m].
        dedicated_communications: Whether one more spacecraft flies along, which takes no pictures.

    Raises:
        MissionError: `dedicated_communications` is neither true nor false.
    """

    name: ClassVar[str]
    n_observers: int
    imaging_radius_m: float
    dedicated_communications: bool = False

    def __post_init__(self) -> None:
        """Refuse what is no answer to a yes-or-no question."""
        told = self.dedicated_communications
        if not isinstance(told, bool):
            raise MissionError(f"behavior.parameters.dedicated_communications = {told!r}: must be true or false")

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        told = f"behavior.name = {self.name!r}: it can fly, but no design can be made with it: it needs attitudes"
        raise MissionError(told)


@dataclass(frozen=True)
class ScriptedPolicy(_PolicyBehavior):
    """One of the scripted policies of `swarm_mj.envs.policies.baselines`.

    Attributes:
        policy: `sweep`, `greedy` or `greedy_ahead`.
        step_s: Time between decisions [s].
        patches: Patches of the target, a square number.

    Raises:
        MissionError: The policy is unknown, or `dedicated_communications` is neither true nor false.
    """

    name = "scripted_policy"
    policy: str = "greedy"
    step_s: float = DECISION_S
    patches: int = 16

    def __post_init__(self) -> None:
        """Refuse unknown policies."""
        super().__post_init__()
        if self.policy not in NAMES:
            raise MissionError(f"behavior.parameters.policy = {self.policy!r}: must be one of {', '.join(NAMES)}")

    def check_scenario(self, scenario: Scenario) -> None:
        """Refuse a scenario whose times do not fit the policy's step, or with a companion."""
        refuse_turned_cameras_and_companions(scenario, "a policy (behavior.name)")
        _check_step(scenario, self.step_s)

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight."""
        config = _config_of(plan, self.step_s, self.patches)
        return PolicyFlight(config, scripted_policies(config)[self.policy])


@dataclass(frozen=True)
class TrainedPolicy(_PolicyBehavior):
    """A policy from a file, see `swarm_mj.envs.policies.policy_files`.

    Attributes:
        file: The file; empty for the one that travels with the package, which reads choice by choice and flies any swarm.
    """

    name = "trained_policy"
    file: str = ""

    @property
    def _path(self) -> str:
        return self.file or str(asset_path(PACKAGED))

    def check_scenario(self, scenario: Scenario) -> None:
        """Refuse a scenario whose times do not fit the policy's step.

        Raises:
            ScenarioError: The file cannot be read, or is of another environment.
            MissionError: The times do not fit.
        """
        refuse_turned_cameras_and_companions(scenario, "a policy (behavior.name)")
        _check_step(scenario, _times(self._path)[0])

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight.

        Raises:
            ScenarioError: The file cannot be read, or was trained for another swarm, other patches or another step.
        """
        config = _config_of(plan, *_times(self._path))
        return PolicyFlight(config, open_policy(self._path, config))


class PolicyFlight:
    """A policy, from tables to choices, at work in one flight; `config` is of an environment of the same flyby."""

    def __init__(self, config: EnvConfig, policy: Policy) -> None:
        self._policy, self._config = policy, config
        self.mission = config.make_mission(0)

    @property
    def dedicated_communications(self) -> bool:
        """See `Behavior`."""
        return self.mission.plan.n > self.mission.plan.n_observers

    def targets(self, view: SwarmView, memory: FollowedEpisode | None) -> tuple[Targets, FollowedEpisode]:
        """See `Behavior`; the memory is the state of the episode, brought up to date in place.

        Raises:
            MissionError: The view tells no attitudes.
        """
        if view.q_BN is None:
            raise MissionError("a policy as behaviour needs attitudes: it can fly, but no design can be made with it")
        followed = FollowedEpisode(self._config, self.mission) if memory is None else memory
        return followed.follow(view, self._policy), followed


class FollowedEpisode(EpisodeState):
    """The state of one flight that something else flies, and what a policy decides in it."""

    flights: _ViewedFlight

    def __init__(self, config: EnvConfig, mission: Mission) -> None:
        n = config.spacecraft
        super().__init__(_ViewedFlight(n, mission.period_s), 1, n, config.patches)
        self.add(mission)
        self.forget(0)
        self.sheet.present[:] = self.sheet.downlink[:] = True
        self.deal(0, mission.yardstick_area(self.totals.target[0], n))

    def follow(self, view: SwarmView, policy: Policy) -> Targets:
        """Bring the episode up to this instant; the targets that hold from now on."""
        mission, flight, begins, one = self.missions[0], self.flights, self.flights.view is None, np.ones(1, np.bool_)
        flight.update(view)
        tick = int(flight.tick[0])
        decides = tick % mission.ticks == 0
        if begins:
            self.update(one)
        elif mission.is_stop[tick] or decides:
            self.arrive(one)
        # Nothing is decided at the end of a flight: the last picture is that of the last step.
        if begins or (decides and tick < mission.last_tick):
            self.update_estimate(one)
            self.show(one)
            self.choose(policy(observed_from(self.tables)), one)
        if mission.is_due[tick]:
            self.take_pictures(one)
        return Targets(*(part[0].copy() for part in flight.held))


class _ViewedFlight:
    """What an `EpisodeState` reads, taken from a `SwarmView`; attitude errors, losses and blindness are not known."""

    def __init__(self, n: int, period: float) -> None:
        self._period = period
        self.view: SwarmView | None = None
        self.tick = np.zeros(1, np.int64)
        self.held = Targets(np.zeros((1, n), np.int64), np.zeros((1, n), np.int64), np.zeros((1, n, 3)))
        self.kind, self.spacecraft, _ = self.held
        self.kind[:] = int(TargetKind.ASTEROID)
        self.sigma_BR = np.zeros((1, n, 3))
        self.off = np.zeros((1, n), np.bool_)

    def update(self, view: SwarmView) -> None:
        """Take the swarm as it is now."""
        self.view = view
        self.tick[0] = round(view.t / self._period)

    def read(self, now: Kinematics, live: Mask) -> None:
        """Copy time and states into an instant."""
        assert self.view is not None
        now.t[0] = self.tick[0] * self._period
        now.r[0], now.v[0], now.q[0] = self.view.r_BN_N, self.view.v_BN_N, self.view.q_BN
        now.omega[0], now.wheel[0] = self.view.omega_BN_B, self.view.wheel_speed

    def know(self, estimate: AttitudeEstimate, live: Mask) -> Mask:
        """What is shown is taken for the truth."""
        return np.zeros(1, np.bool_)


def _times(file: str) -> tuple[float, int]:
    """Length of a decision [s] and number of patches that a policy was trained for, as its file tells."""
    told = told_arguments(file)
    return float(told.get("decision_s", DECISION_S)), int(told.get("patches", 16))


def _config_of(plan: Plan, step_s: float, patches: int) -> EnvConfig:
    """The arguments of an environment that flies the same mission."""
    given = plan.scenario
    # The behaviour says whether one more spacecraft flies along; one that needs an environment must not ask for another.
    name = "dedicated_communications" if plan.n > plan.n_observers else "adaptable_roles"
    behavior = given.behavior.model_copy(update={"name": name, "parameters": {}})
    try:
        return EnvConfig(scenario=given.model_copy(update={"behavior": behavior}), decision_s=step_s, patches=patches)
    except ScenarioError as error:
        raise MissionError(f"behavior.name = {given.behavior.name!r}: {error}") from None


def _check_step(scenario: Scenario, step_s: float) -> None:
    try:
        checked_step(scenario, step_s)
    except ScenarioError as error:
        raise MissionError(f"behavior.name = {scenario.behavior.name!r}: {error}") from None
