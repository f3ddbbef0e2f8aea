"""Corrections of a plan: when they are, what is not as planned, what linear covariance says, and the law that flies them.

At a correction a spacecraft learns its state, with the errors of its navigation, and works out by how much it would miss its
visiting point. It then pushes until the velocity that its accelerometers have gained has taken that miss away. A burn takes
time; so each control period asks for the change of velocity that, given at the middle of what is left of the burn, takes away
what is left of the miss. The burn's errors of size and direction are drawn once for each burn and hidden from the spacecraft.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np
from scipy.interpolate import CubicSpline

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.corrections import Legs, inverse_transition, plan_legs, transitions
from swarm_mj.mission.covariance import FlightErrors, Spread, spread
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_propulsion import Thrusters
from swarm_mj.simulator.faults.dispersions import Stream, stream
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.control.force import ForceView
from swarm_mj.typing import Array, Ints

#: Points between first correction and arrival at which the effect of a push is known; between them by cubic splines.
GRID = 65
#: Rounds in which the middle of a burn and its size are made to fit each other.
ROUNDS = 8


@dataclass(frozen=True, kw_only=True)
class CorrectionAnalysis:
    """Linear covariance of a plan.

    Attributes:
        plan: What is to be flown.
        legs: Planned flights, cut at the corrections.
        errors: What is not as planned.
        spread: What that makes of the arrival and of the burns.
        known: Covariance of what pictures let each know of its state at the arrival, shape (n, 6, 6) [m, m/s]; None: no
            pictures are taken.
        pictures: How many of each one's pictures told something, by way.
        untold: Why pictures told nothing, and how many, of each one.
    """

    plan: Plan
    legs: Legs
    errors: FlightErrors
    spread: Spread
    known: Array | None = None
    pictures: tuple[dict[str, int], ...] = ()
    untold: tuple[dict[str, int], ...] = ()


def analyse_corrections(plan: Plan) -> CorrectionAnalysis:
    """Linear covariance of a plan from release to arrival.

    Raises:
        ScenarioError: See `knots`.
        MissionError: A correction has no solution.
    """
    legs, errors = legs_of(plan), errors_of(plan)
    return CorrectionAnalysis(plan=plan, legs=legs, errors=errors, spread=spread(legs, errors))


def legs_of(plan: Plan) -> Legs:
    """The planned flights, cut at the corrections.

    Raises:
        ScenarioError: See `knots`; or the plan has burns of its own.
        MissionError: A trajectory cannot be integrated.
    """
    deployment, acceleration = plan.deployment, plan.environment.acceleration_N
    if deployment.burns:
        raise ScenarioError(
            "the plan has insertion burns, which linear covariance does not know: set mothership.deployer.max_speed_m_s: null"
        )
    times = knots(plan.scenario, deployment.release_s, deployment.arrival_s)
    return plan_legs(acceleration, deployment.release_r_N, deployment.v0_N, times)


def knots(scenario: Scenario, release_s: Array, arrival_s: Array) -> Array:
    """Release, corrections in order of time, arrival of each spacecraft, shape (n, m + 2) [s].

    Raises:
        ScenarioError: A correction is not between release and arrival, or is where another one is.
    """
    columns = []
    for k, correction in enumerate(scenario.trajectory.corrections):
        after, before = correction.after_release_s, correction.before_arrival_s
        at = release_s + after if after is not None else arrival_s - (before or 0.0)
        outside = np.flatnonzero(~((at > release_s) & (at < arrival_s)))
        if len(outside):
            j = int(outside[0])
            raise ScenarioError(
                f"trajectory.corrections.{k}.{correction.key}: sc{j + 1} flies {arrival_s[j] - release_s[j]:g} s from "
                "release to arrival; must be less than that"
            )
        columns.append(at)
    times = np.sort(np.array(columns).reshape(-1, len(release_s)), axis=0)
    if (np.diff(times, axis=0) < scenario.control.period_s).any():
        raise ScenarioError(
            "trajectory.corrections: two are at the same time for a spacecraft; must lie at least control.period_s = "
            f"{scenario.control.period_s:g} s apart; leave one out"
        )
    return np.vstack((release_s, times, arrival_s)).T


def errors_of(plan: Plan) -> FlightErrors:
    """What the scenario says is not as planned, at release, at corrections and in burns."""
    scenario = plan.scenario
    given, known = scenario.dispersions, scenario.navigation
    return FlightErrors(
        release=_release_covariance(plan),
        position=known.position_m,
        velocity=known.velocity_m_s,
        magnitude=0.01 * given.burn_magnitude_percent,
        pointing=radians(given.burn_pointing_deg),
    )


def _release_covariance(plan: Plan) -> Array:
    """Covariance of each state just after its release, shape (n, 6, 6): the mothership's, carried there, and the deployer's."""
    given, release_s = plan.scenario.dispersions, plan.deployment.release_s
    at_epoch = np.diag(np.repeat((given.mothership_position_m**2, given.mothership_velocity_m_s**2), 3))
    covariance = np.tile(at_epoch, (plan.n, 1, 1))
    if at_epoch.any() and release_s.max() > 0.0:
        carried = _mothership_transitions(plan, np.unique(np.append(0.0, release_s)))
        covariance = np.array([carried[t] @ at_epoch @ carried[t].T for t in release_s])
    covariance[:, 3:, 3:] += given.deployment_velocity_m_s**2 * np.eye(3)
    return covariance


def _mothership_transitions(plan: Plan, times: Array) -> dict[float, Array]:
    deployment = plan.deployment
    start = deployment.r0_N[None], deployment.mothership_velocity_N[None]
    flown = transitions(plan.environment.acceleration_N, *start, times)
    return {float(t): flown.phi[k, 0] for k, t in enumerate(times)}


@dataclass(frozen=True)
class _Memory:
    """What the spacecraft remember."""

    done: Ints  #: corrections that have been begun, shape (n,)
    #: by how much each would miss its visiting point as far as it knows, shape (n, 3) [m]; nan: nothing is to be burnt
    miss: Array
    felt: Array  #: velocity gained by thrust at the last call, shape (n, 3) [m/s]
    t: float  #: time of the last call [s]


class CorrectionLaw:
    """Corrections of n spacecraft; see `ForceLaw`.

    Args:
        legs: The planned flights, cut at the corrections.
        errors: Of navigation and burns; the release's do not matter here.
        environment: Forces of the planned flights.
        thrusters: Their thrust and shortest pulse.
        seed: Of the scenario, from which the errors are drawn.
        optical: Whether what is known of states comes by navigation, and no errors of it are drawn.
    """

    def __init__(
        self,
        legs: Legs,
        errors: FlightErrors,
        environment: Environment,
        thrusters: Thrusters,
        *,
        seed: int,
        optical: bool = False,
    ) -> None:
        self._optical = optical
        self._legs, self._errors, self._seed = legs, errors, seed
        self._thrust, self._least = thrusters.thrust_n, thrusters.min_impulse_bit_n_s
        self._to_arrival = legs.to_arrival
        self._drawn: dict[tuple[int, int], Array] = {}  # by spacecraft and correction, kept because drawing takes long
        self._effect = [_effect_of_pushes(legs, environment, j) for j in range(len(legs.times))]

    def forces(self, view: ForceView, memory: _Memory | None) -> tuple[Array, _Memory]:
        """Forces that the burns of this control period ask for, shape (n, 3) [N]."""
        n = len(self._legs.times)
        if memory is None:
            memory = _Memory(np.zeros(n, np.int64), np.full((n, 3), np.nan), np.zeros((n, 3)), view.t)
        memory = self._begun(view, self._felt(view, memory))
        wish = np.zeros((n, 3))
        for j in np.flatnonzero(np.isfinite(memory.miss[:, 0]) & view.working & (view.propellant > 0.0)):
            wish[j] = self._push(view, memory, int(j))
            if not wish[j].any():
                memory.miss[j] = np.nan
        return wish, memory

    def _felt(self, view: ForceView, memory: _Memory) -> _Memory:
        """Count what the thrusters have given since the last call; what they err by is not felt."""
        miss = memory.miss.copy()
        for j in np.flatnonzero(np.isfinite(miss[:, 0])):
            gained = np.linalg.solve(self._error(int(j), memory.done[j] - 1), view.delta_v_N[j] - memory.felt[j])
            miss[j] += self._effect[j](0.5 * (memory.t + view.t)) @ gained
        return replace(memory, miss=miss, felt=view.delta_v_N, t=view.t)

    def _begun(self, view: ForceView, memory: _Memory) -> _Memory:
        """Begin the corrections that are due; a burn that still lasts is given up for the newer knowledge."""
        legs, done, miss = self._legs, memory.done.copy(), memory.miss
        for j in np.flatnonzero(done < legs.n_corrections):
            k = int(done[j])
            late = view.t - legs.times[j, k + 1]
            if late < -0.5 * view.period:
                continue
            # What navigation by pictures errs by is in the view already.
            error = np.zeros(6)
            if not self._optical:
                error = np.repeat((self._errors.position, self._errors.velocity), 3)
                error = error * stream(self._seed, Stream.NAVIGATION, k, int(j)).standard_normal(6)
            planned = np.concatenate((legs.r_N[j, k + 1] + late * legs.v_N[j, k + 1], legs.v_N[j, k + 1]))
            known = np.concatenate((view.r_BN_N[j], view.v_BN_N[j])) - planned + error
            miss[j], done[j] = self._to_arrival[j, k + 1, :3] @ known, k + 1
        return replace(memory, done=done)

    def _push(self, view: ForceView, memory: _Memory, j: int) -> Array:
        """Force for the coming control period [N]; zeros where the burn is over."""
        left = self._legs.times[j, -1] - view.t
        if left <= 0.0:
            return np.zeros(3)
        middle = view.t
        for _ in range(ROUNDS):
            delta_v = -np.linalg.solve(self._effect[j](middle), memory.miss[j])
            lasts = np.linalg.norm(delta_v) * view.mass[j] / self._thrust
            # Not above half of the time left: a longer burn cannot end before the arrival, but may do what it can.
            middle = view.t + 0.5 * min(max(lasts, view.period), left)
        impulse = delta_v * view.mass[j]
        if np.linalg.norm(impulse) < max(self._least, 1e-12):
            return np.zeros(3)
        return np.asarray(self._error(j, int(memory.done[j]) - 1) @ impulse / view.period)

    def _error(self, j: int, k: int) -> Array:
        """What a burn makes of what is wished, shape (3, 3): too long or short by a share, and turned by a small angle."""
        if (j, k) not in self._drawn:
            self._drawn[j, k] = stream(self._seed, Stream.BURN, k, j).standard_normal(4)
        share, *turn = self._drawn[j, k]
        x, y, z = self._errors.pointing * np.array(turn)
        return (1.0 + self._errors.magnitude * share) * np.eye(3) + np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def correction_law(plan: Plan) -> CorrectionLaw | None:
    """The law that flies a plan's corrections; None: it has none. Raises what `legs_of` raises."""
    scenario, thrusters = plan.scenario, plan.scenario.spacecraft.thrusters
    if not scenario.trajectory.corrections or thrusters is None:
        return None
    optical = scenario.navigation.mode == "optical"
    return CorrectionLaw(
        legs_of(plan), errors_of(plan), plan.environment, thrusters, seed=scenario.seed, optical=optical
    )


def _effect_of_pushes(legs: Legs, environment: Environment, j: int) -> CubicSpline:
    """Phi_rv(arrival, t) of one spacecraft from its first correction to its arrival, (3, 3) [s] as a function of t [s]."""
    times = np.linspace(legs.times[j, 1], legs.times[j, -1], GRID)
    flown = transitions(environment.acceleration_N, legs.r_N[j : j + 1, 1], legs.v_N[j : j + 1, 1], times)
    to_arrival = flown.phi[-1, 0] @ inverse_transition(flown.phi[:, 0], times[-1] - times[0])
    return CubicSpline(times, to_arrival[:, :3, 3:])
