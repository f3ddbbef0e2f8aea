"""Linear covariance with pictures: what navigation will know along the planned paths, and what corrections make of that.

Along each planned path pictures are made and measured from where the spacecraft is to be, for the geometry and noise of each;
nothing is drawn but the noise of the pictures. With x the deviation from the plan and e the error of what is known of it, a
correction burns gain (x + e). Both, and how they go together, are carried to the arrival: e by the filter, x along the path.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.optical import OpticalNavigator, first_sigmas
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.trajectory_corrections import CorrectionAnalysis, errors_of, legs_of
from swarm_mj.mission.covariance import FlightErrors, Spread, burn_covariance
from swarm_mj.mission.trajectories import Progress
from swarm_mj.navigation.filter import SwarmFilter
from swarm_mj.navigation.picture import Fix
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import Picture
from swarm_mj.simulator.faults.dispersions import Stream, stream
from swarm_mj.simulator.flights import NEVER
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Array

#: Spacecraft whose knowledge is worked out for designs, at most.
WORKED_OUT = 6


def analyse_optical(plan: Plan, progress: Progress | None = None) -> CorrectionAnalysis:
    """Linear covariance of a plan with pictures from release to arrival, each spacecraft for itself, without ranges.

    Raises:
        ScenarioError: See `knots`; or the scenario does not navigate by pictures.
        MissionError: A correction has no solution.
    """
    if plan.scenario.navigation.mode != "optical":
        raise ScenarioError(
            f"navigation.mode = {plan.scenario.navigation.mode}: must be optical for covariance with pictures; give "
            "--set navigation.mode=optical"
        )
    legs, errors = legs_of(plan), errors_of(plan)
    navigator, m, n = OpticalNavigator(plan), legs.n_corrections, plan.n
    at_arrival, before = np.empty((m + 1, n, 6, 6)), np.empty((m, n, 6, 6))
    delta_v, known = np.empty((m, n, 3, 3)), np.empty((n, 6, 6))
    pictures: list[dict[str, int]] = []
    untold: list[dict[str, int]] = []
    gain, to_arrival = (legs.gain if m else np.empty((n, 0, 3, 6))), legs.to_arrival
    for j in range(n):
        r_N, v_N = legs.r_N[j, :1], legs.v_N[j, :1]
        sigma = first_sigmas(plan.scenario.navigation.optical, r_N, v_N)
        start = navigator.filter_at(legs.times[j, 0], np.hstack((r_N, v_N)), sigma)
        along = _Along(navigator, start, j)
        D, X = errors.release[j].copy(), np.zeros((6, len(start.x)))
        at_arrival[0, j] = to_arrival[j, 0] @ D @ to_arrival[j, 0].T
        for k in range(m + 1):
            M = along.fly(legs.times[j, k + 1])
            phi = legs.phi[j, k]
            D, X = phi @ D @ phi.T, phi @ X @ M.T
            if k == m:
                break
            P, G = along.filter.covariance(0), gain[j, k]
            before[k, j] = D
            own = X[:, :6]
            wished = G @ (D + P + own + own.T) @ G.T
            delta_v[k, j] = wished
            burnt = np.eye(6)
            burnt[3:] += G
            push = np.zeros((6, 6))
            push[3:] = G
            noise = np.zeros((6, 6))
            noise[3:, 3:] = burn_covariance(wished, errors)
            whole = along.filter.P
            D = burnt @ D @ burnt.T + push @ P @ push.T + burnt @ own @ push.T + push @ own.T @ burnt.T + noise
            # What is known errs by what the burn errs by, with the sign of an estimate less a truth.
            X = burnt @ X + push @ whole[:6]
            X[3:, 3:6] -= noise[3:, 3:]
            along.filter.push(0, np.zeros(6), noise)
            at_arrival[k + 1, j] = to_arrival[j, k + 1] @ D @ to_arrival[j, k + 1].T
        known[j] = along.filter.covariance(0)
        pictures.append(along.used)
        untold.append(along.refused)
        if progress is not None:
            progress((j + 1) / n)
    # What burns err by is in these covariances already.
    told = FlightErrors(release=errors.release)
    return CorrectionAnalysis(
        plan=plan,
        legs=legs,
        errors=told,
        spread=Spread(at_arrival=at_arrival, before=before, delta_v=delta_v),
        known=known,
        pictures=tuple(pictures),
        untold=tuple(untold),
    )


def known_at_arrivals(plan: Plan) -> Array:
    """Covariance of what pictures let each spacecraft know of its state at its arrival, shape (n, 6, 6) [m, m/s].

    It is worked out for some of them that arrive far apart; the others know as much as the nearest of those, along the same
    axes: the direction from the body, the normal of the passage, and what is across both.
    """
    deployment, navigator = plan.deployment, OpticalNavigator(plan)
    r_N = deployment.destination_N
    v_N = r_N - deployment.release_r_N
    chosen = [0]
    while len(chosen) < min(WORKED_OUT, plan.n_observers):
        apart = np.linalg.norm(r_N[: plan.n_observers, None] - r_N[chosen], axis=2).min(axis=1)
        chosen.append(int(apart.argmax()))
    known = []
    for j in chosen:
        first = deployment.release_r_N[j : j + 1], deployment.v0_N[j : j + 1]
        sigma = first_sigmas(plan.scenario.navigation.optical, *first)
        along = _Along(navigator, navigator.filter_at(float(deployment.release_s[j]), np.hstack(first), sigma), j)
        along.fly(float(deployment.arrival_s[j]))
        axes = np.kron(np.eye(2), _passage_axes(r_N[j], v_N[j]))
        known.append(axes @ along.filter.covariance(0) @ axes.T)
    found = np.empty((plan.n, 6, 6))
    for j in range(plan.n):
        axes = np.kron(np.eye(2), _passage_axes(r_N[j], v_N[j]))
        found[j] = axes.T @ known[int(np.linalg.norm(r_N[chosen] - r_N[j], axis=1).argmin())] @ axes
    return found


def _passage_axes(r: Array, v: Array) -> Array:
    """Direction from the body, what is across that and the normal, and the normal of a passage, rows, shape (3, 3)."""
    away, normal = r / np.linalg.norm(r), np.cross(r, v)
    normal /= np.linalg.norm(normal)
    return np.array([away, np.cross(normal, away), normal])


class DrawnKnowledge:
    """Navigates without pictures: what is known errs by one draw from a covariance; see `simulator.simulation.Navigator`.

    Errors of position grow and shrink with those of velocity, so that they are as drawn at the arrivals.

    Args:
        covariance: Of what each knows at its arrival, shape (n, 6, 6) [m, m/s].
        arrival_s: When that is, shape (n,) [s].
        seed: Of the draws.
    """

    def __init__(self, covariance: Array, arrival_s: Array, seed: int) -> None:
        self.due, self._arrival_s = 0, arrival_s
        drawn = np.array([stream(seed, Stream.FIRST_KNOWLEDGE, j).standard_normal(6) for j in range(len(covariance))])
        values, vectors = np.linalg.eigh(covariance)
        self._off = np.einsum("nkl,nl->nk", vectors * np.sqrt(np.maximum(values, 0.0))[:, None], drawn)

    def reset(self, simulation: Simulation) -> None:
        """Begin a flight."""
        self.look(simulation)

    def look(self, simulation: Simulation) -> None:
        """Write what is known."""
        flights, t = simulation.state.flights, simulation.time
        flights.off_v_N[0] = self._off[:, 3:]
        flights.off_r_N[0] = self._off[:, :3] + (t - self._arrival_s)[:, None] * self._off[:, 3:]
        flights.guessed_at[0], flights.guessing[0], self.due = t, True, NEVER

    def sampled(self, simulation: Simulation) -> dict[str, NDArray[Any]]:
        """Nothing."""
        return {}

    def record(self) -> list[dict[str, Any]]:
        """Nothing."""
        return []


class _Along:
    """Pictures along a planned path.

    Attributes:
        filter: What is known so far.
        used: How many pictures told something, by way.
        refused: How many did not, by reason.
    """

    def __init__(self, navigator: OpticalNavigator, start: SwarmFilter, j: int) -> None:
        self.filter, self.used, self.refused = start, dict[str, int](), dict[str, int]()
        self._navigator, self._j = navigator, j
        # At the release, cameras do not point at the body yet.
        self._due = start.t + navigator.seconds_to_next(start.r_N, start.v_N)
        # What is believed errs at first as in a flight of this seed, then by what pictures leave of that: by it cameras point,
        # and from there pictures are searched for what is predicted.
        self._error = np.zeros(len(start.x))
        drawn = stream(navigator.plan.scenario.seed, Stream.FIRST_KNOWLEDGE, j).standard_normal(6)
        self._error[:6] = np.sqrt(np.diag(start.covariance(0))[:6]) * drawn

    def fly(self, end: float) -> Array:
        """Go on to a later time [s]; gives how errors of the state then go with those at the beginning."""
        each, late = self.filter, self._navigator.plan.scenario.navigation.optical.delay_s
        M = np.eye(len(each.x))
        # Pictures that are read out too late tell nothing by then.
        while self._due <= end - late:
            M = self._go(each.advance(max(self._due, each.t))) @ M
            M = self._go(self._look(each.t)) @ M
            self._due = each.t + self._navigator.seconds_to_next(each.r_N, each.v_N)
        return self._go(each.advance(end)) @ M

    def _go(self, change: Array) -> Array:
        self._error = change @ self._error
        return change

    def _look(self, t: float) -> Array:
        """Take a picture; gives how errors of the state after it go with those before."""
        each, plan, before = self.filter, self._navigator.plan, self.filter.S.copy()
        if self._j >= plan.n_observers:
            return np.eye(len(each.x))
        C_AN = plan.environment.C_AN(t)
        place, aim = C_AN @ each.r_N[0], -C_AN @ self._error[:3]
        # How a flight turns the camera about its line of sight is not known: the body goes out over a side, not a corner.
        across, down, _ = look_at(place, aim).C_CA @ -place
        pose = look_at(place, aim, roll=float(np.arctan2(down, across)))
        picture = Picture(t, self._j, pose.r_A, pose.C_CA, C_AN @ plan.environment.sun.at(t))
        believed_r_A = pose.r_A + C_AN @ self._error[:3]
        fix = self._navigator.measured(picture, believed_r_A, each.position_sigma(0))
        if not isinstance(fix, Fix):
            self.refused[fix.why] = self.refused.get(fix.why, 0) + 1
            return np.eye(len(each.x))
        self.used[fix.kind] = self.used.get(fix.kind, 0) + 1
        each.use_fix(0, fix._replace(y=np.zeros_like(fix.y)), C_AN)
        return _shrinkage(before, each.S)


def _shrinkage(before: Array, after: Array) -> Array:
    """1 - K H, which is P_after P_before^-1, of the roots of both, in even units, on the states that are uncertain."""
    size = np.linalg.norm(before, axis=1)
    on = np.flatnonzero(size > 0.0)
    first, then = before[on] / size[on, None], after[on] / size[on, None]
    found = np.eye(len(size))
    found[np.ix_(on, on)] = np.linalg.solve(first @ first.T, then @ then.T).T * size[on, None] / size[on]
    return found
