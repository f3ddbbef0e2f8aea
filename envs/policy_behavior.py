"""Policies of the control level `role` as behaviours of scripted flights, for `swarm-mj run`.

A policy must know what has been seen and sent so far, which no `SwarmView` tells. The behaviour keeps these books by itself,
with the same code as the environment: at every control instant it looks at the attitudes it is given, judges the pictures that
are due with the scenario's camera and the horizon maps, and every `step_s` reads its observation and decides. For the same
seed it decides as the policy does in the environment.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.planning import Plan
from swarm_mj.resources import asset_path
from swarm_mj.simulation.batch import BatchFlights

from .baselines import POLICIES
from .flybys import Flybys
from .policy import load_policy
from .setting import Setting, make_setting

Array = NDArray[np.float64]
Act = Callable[[NDArray[np.float32]], NDArray[np.int64]]

#: The trained policy that travels with the package.
PACKAGED = "policies/eros-observe.npz"


#: Scripted policies by the names that a scenario knows.
SCRIPTED = {name.replace(" ", "_"): policy for name, policy in POLICIES.items()}


def policy_overrides(policy: str) -> list[str]:
    """What has to be set in a scenario for a policy to fly it.

    Args:
        policy: A scripted one by name, `trained` for the packaged one, or a file of `swarm_mj.envs.policy`.

    Raises:
        MissionError: It is neither a name nor a file.
    """
    if policy not in SCRIPTED and policy != "trained" and not Path(policy).is_file():
        raise MissionError(f"--policy {policy!r}: no such file, and no name; names are trained, {', '.join(SCRIPTED)}")
    if policy in SCRIPTED:
        return ["behavior.name=scripted_policy", f"behavior.parameters={json.dumps({'policy': policy})}"]
    parameters = {} if policy == "trained" else {"file": policy}
    return ["behavior.name=trained_policy", f"behavior.parameters={json.dumps(parameters)}"]


@dataclass(frozen=True)
class ScriptedPolicy:
    """One of the scripted policies of `swarm_mj.envs.baselines`.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: R_im [m].
        policy: `body_centre`, `target_centre`, `sweep`, `greedy` or `greedy_ahead`.
        step_s: Time between decisions [s].

    Raises:
        MissionError: The policy is unknown.
    """

    n_observers: int
    imaging_radius_m: float
    policy: str = "greedy"
    step_s: float = 10.0
    dedicated_communications: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse unknown policies."""
        if self.policy not in SCRIPTED:
            raise MissionError(f"behavior.parameters.policy = {self.policy!r}: must be one of {', '.join(SCRIPTED)}")

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight."""
        setting = _setting(plan, self.step_s)
        return PolicyFlight(setting, partial(SCRIPTED[self.policy], setting))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise _needs_a_flight("scripted_policy")


@dataclass(frozen=True)
class TrainedPolicy:
    """A policy from a file of `swarm_mj.envs.policy`.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: R_im [m].
        file: The file; empty for the one that travels with the package, trained for `eros-observe`.
    """

    n_observers: int
    imaging_radius_m: float
    file: str = ""
    dedicated_communications: ClassVar[bool] = False

    def for_flight(self, plan: Plan) -> Behavior:
        """The behaviour of one flight.

        Raises:
            ScenarioError: The file cannot be read, or was trained for another swarm or target grid.
        """
        policy = load_policy(self.file or str(asset_path(PACKAGED)))
        setting = _setting(plan, float(policy.about["step_s"]), policy.geometry.count)
        policy.check(setting)
        return PolicyFlight(setting, policy.act)

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise _needs_a_flight("trained_policy")


class PolicyFlight:
    """A policy at work in one flight.

    Args:
        setting: Of an environment of the same mission, at the control level `role`.
        act: From an observation to an action.
    """

    dedicated_communications: ClassVar[bool] = False

    def __init__(self, setting: Setting, act: Act) -> None:
        self.setting, self._act = setting, act

    def targets(self, view: SwarmView, memory: Followed | None) -> tuple[Targets, Followed]:
        """See `Behavior`; the memory is the books of the flight, brought up to date in place.

        Raises:
            MissionError: The view tells no attitudes.
        """
        if view.q_BN is None:
            raise MissionError("a policy as behaviour needs attitudes: it can fly, but no design can be made with it")
        followed = Followed(self.setting) if memory is None else memory
        return followed.follow(view, self._act), followed


class Followed(Flybys):
    """The books of one flight that something else flies.

    Args:
        setting: Of an environment of the same mission, at the control level `role`.
    """

    flights: Any

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting, 1)
        self.level.reset(0)
        self._give_held()

    def _make_flights(self) -> BatchFlights:
        self.batched, self.why_separate = True, ""
        return _Viewed(self.setting)  # type: ignore[return-value]

    def follow(self, view: SwarmView, act: Act) -> Targets:
        """Bring the books up to this instant; the targets that hold from now on."""
        setting, begins = self.setting, self.flights.view is None
        self.flights.look_at(view)
        tick, everyone = int(self.flights.tick[0]), np.ones(1, np.bool_)
        # Nothing is decided at the end of a flight: the last picture is that of the last step.
        if begins or (tick % setting.ticks == 0 and tick < setting.last_tick):
            self._before, self.now = self.now, self._before
            self._look(self.now, everyone)
            self._end_step(everyone, 0.0 if begins else setting.step_s)
            self.level.hold(act(self.observation[0])[None], self.now.C_BN[:, :, 2], everyone)
            self._give_held()
        if setting.is_due[tick]:
            self._take_pictures(everyone, np.zeros(1))
        flights = self.flights
        return Targets(flights.kind[0].copy(), flights.index[0].copy(), flights.vector[0].copy())


class _Viewed:
    """What `Flybys` reads of a simulation, taken from a `SwarmView`; attitude errors, losses and blindness are not known."""

    def __init__(self, setting: Setting) -> None:
        n = setting.plan.n
        self.period = setting.plan.scenario.control.period_s
        self.view: SwarmView | None = None
        self.tick = np.zeros(1, np.int64)
        self.kind, self.index = np.zeros((1, n), np.int64), np.zeros((1, n), np.int64)
        self.vector, self.sigma_BR = np.zeros((1, n, 3)), np.zeros((1, n, 3))
        self.lost, self.blind = np.zeros((1, n), np.bool_), np.zeros((1, n), np.bool_)

    def look_at(self, view: SwarmView) -> None:
        """Take the swarm as it is now."""
        self.view = view
        self.tick[0] = round(view.t / self.period)

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """See `BatchFlights`."""
        assert self.view is not None
        r[0], v[0], q[0] = self.view.r_BN_N, self.view.v_BN_N, self.view.q_BN
        omega[0], wheel[0] = self.view.omega_BN_B, self.view.wheel_speed


def _setting(plan: Plan, step_s: float, patches: int = 16) -> Setting:
    """The setting of an environment that flies the same mission."""
    given = plan.scenario
    # The level `role` asks no behaviour, and one that needs a setting must not ask for another.
    behavior = given.behavior.model_copy(update={"name": "adaptable_roles", "parameters": {}})
    try:
        return make_setting(given.model_copy(update={"behavior": behavior}), step_s=step_s, patches=patches)
    except ScenarioError as error:
        raise MissionError(f"behavior.name = {given.behavior.name!r}: {error}") from None


def _needs_a_flight(name: str) -> MissionError:
    return MissionError(f"behavior.name = {name!r}: it can fly, but no design can be made with it: it needs attitudes")
