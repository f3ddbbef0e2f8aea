"""A flight that is still under way: what a running simulation shows, and what its cameras have seen so far."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from time import perf_counter, sleep

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.observe import observer_from, schedule_from
from swarm_mj.flight.plan import Plan, antennas_from
from swarm_mj.flight.refusals import refuse_turned_cameras_and_companions
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.mission.links import closed_links
from swarm_mj.observation.camera import Motion
from swarm_mj.observation.capture import observe, pictures, watching
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.rendering.frame import Instant, Traffic
from swarm_mj.rendering.replay import trail_points
from swarm_mj.rendering.transfers import BEATS
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.typing import Array, Mask

#: Tolerance of the path that only serves to frame a picture.
PATH_RTOL = 1e-6


def planned_path(plan: Plan) -> Array:
    """Positions in N over the whole flight as planned, evenly spaced in time, shape (m, n, 3) [m].

    Straight lines where the trajectory cannot be integrated to its end.
    """
    times = np.linspace(0.0, plan.scenario.duration_s, trail_points(plan.n))
    try:
        return planned_paths(plan.environment.acceleration_N, plan.deployment, times, rtol=PATH_RTOL)[0]
    except MissionError:
        return plan.deployment.release_r_N + times[:, None, None] * plan.deployment.v0_N


#: Pictures per second of a live view.
RATE = 30.0
#: Speeds to choose from: seconds of flight per second.
SPEEDS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


class Trail:
    """Positions passed so far, at even steps of the flight."""

    def __init__(self, plan: Plan) -> None:
        self._step = plan.scenario.duration_s / trail_points(plan.n)
        self._times: list[float] = []
        self._points: list[Array] = []

    def to(self, t: float, r_BN_N: Array) -> Array:
        """The trail that ends at `r_BN_N` (n, 3) [m] at time `t` [s], shape (m, n, 3); forgets what lies after `t`."""
        while self._times and self._times[-1] >= t:
            self._times.pop()
            self._points.pop()
        past = [*self._points, r_BN_N]
        if not self._times or t - self._times[-1] >= self._step:
            self._times.append(t)
            self._points.append(r_BN_N.copy())
        return np.array(past)


class LiveFlight:
    """A simulation that is flown while one looks on.

    Its pictures are those of `swarm_mj.flight.observe.observe_flight`, taken at the same times and judged by the same observer,
    as far as they count by the scenario's criterion. An observer that draws with OpenGL must be used in one thread: make, fly
    and close the flight in the same one.

    Raises:
        ObserverError: The scenario's observer is not available here.
        ScenarioError: The body has a companion.
    """

    def __init__(self, plan: Plan) -> None:
        refuse_turned_cameras_and_companions(plan.scenario, "a flight that is watched live")
        self.plan = plan
        period = plan.scenario.control.period_s
        self._observer = observer_from(plan.scenario, plan.region)
        self._criterion = plan.scenario.observation
        self._schedule = schedule_from(plan.scenario, period)
        self._last = round(plan.scenario.duration_s / period)
        self._beams, self._body = antennas_from(plan.scenario), occluder_of(plan.shape)
        self.restart()

    def restart(self) -> None:
        """Go back to the deployment."""
        self._simulation = make_simulation(self.plan)
        self._coverage = CoverageMap(self.plan.region.weighted_area, self.plan.n)
        self._trail = Trail(self.plan)
        self._received = np.zeros(self.plan.n, np.bool_)
        self._decide()

    @property
    def over(self) -> bool:
        """Whether the flight has reached its end."""
        return self._simulation.tick >= self._last

    @property
    def time(self) -> float:
        """Time past the epoch [s]."""
        return self._simulation.time

    @property
    def period(self) -> float:
        """Time of one step [s]."""
        return self._simulation.period

    def step(self) -> None:
        """Fly one control period on; nothing happens after the end.

        Raises:
            SimulationError: The flight diverged.
        """
        if not self.over:
            self._simulation.step()
            self._decide()

    @property
    def coverage(self) -> CoverageMap:
        """What the swarm has observed so far, by the scenario's criterion."""
        return self._coverage

    def close(self) -> None:
        """Release the observer; the flight cannot go on."""
        self._observer.close()

    def instant(self) -> Instant:
        """What there is to draw now."""
        state = self._simulation.state
        r_BN_N = state.r_N.copy()
        C_BN, C_AN = dcm(mrp_from_quaternion(state.q_BN)), self.plan.environment.C_AN(self.time)
        link = self._links(r_BN_N, C_BN, C_AN)
        return Instant(
            t=self.time,
            r_BN_N=r_BN_N,
            C_BN=C_BN,
            C_AN=C_AN,
            kind=self._targets.kind.copy(),
            tracked=self._targets.spacecraft.copy(),
            link=link,
            seen=self._coverage.seen,
            trail_N=self._trail.to(self.time, r_BN_N),
            lost=self._simulation.lost.copy(),
            blind=~self._simulation.camera_on,
            traffic=self._traffic(link),
        )

    def _links(self, r_BN_N: Array, C_BN: Array, C_AN: Array) -> Mask:
        """Whose link to what it tracks is closed now, shape (n,)."""
        kind, whom, works = self._targets.kind, self._targets.spacecraft, ~self._simulation.lost
        place = (r_BN_N, np.ascontiguousarray(C_BN), C_AN, self.plan.environment.earth.at(self.time))
        closed = closed_links(self._beams, self._body, kind.astype(np.int64), whom.astype(np.int64), *place)
        return np.asarray(closed & works & np.where(kind == TargetKind.SPACECRAFT, works[np.maximum(whom, 0)], True))

    def _traffic(self, link: Mask) -> Traffic | None:
        """Where those that hold pictures, or were sent some, could send them now; how much is not known while it flies."""
        kind, whom = self._targets.kind, self._targets.spacecraft
        holds = self._coverage.seen_by.any(axis=1)
        inside = np.flatnonzero(link & holds & (kind == TargetKind.SPACECRAFT))
        self._received[whom[inside]] = True
        home = np.flatnonzero(link & (holds | self._received) & (kind == TargetKind.EARTH))
        links = [*((int(j), int(whom[j])) for j in inside), *((int(j), -1) for j in home)]
        beat = self.time * BEATS / self.plan.scenario.duration_s % 1.0
        return Traffic(tuple(links), beat, nan, nan) if links else None

    def _decide(self) -> None:
        self._targets: Targets = self._simulation.decide()
        if self._schedule.due(self._simulation.tick):
            self._take_pictures()

    def _take_pictures(self) -> None:
        now, sun = self.instant(), self.plan.environment.sun
        who = watching(self.plan.n_observers, now.kind, self._simulation.camera_on)
        who &= self._schedule.takers(self._simulation.tick, self.plan.n)
        state = self._simulation.state
        moving = Motion(state.v_N, state.omega_B, self.plan.environment.spin_N)
        for picture in pictures(now.t, who, now.r_BN_N, now.C_BN, now.C_AN, sun.at(now.t), moving):
            seen = observe(self._observer, picture.r_A, picture.C_CA, self._criterion, picture.sun_A, picture.motion)
            self._coverage.add(picture.t, picture.spacecraft, seen)


class Player:
    """Flies a live flight at a chosen speed; what is shown is taken from `now`.

    Attributes:
        paused: Whether the flight stands still.
        speed: Seconds of flight per second.
        restart_asked: Whether to begin again at the next step.
        now: What there is to draw; replaced as a whole, so that other threads may read it.
    """

    def __init__(self, flight: LiveFlight, speed: float) -> None:
        self.flight, self.speed, self.paused, self.restart_asked = flight, speed, False, False
        self.now = flight.instant()
        self._due = 0.0

    def advance(self, elapsed: float, budget: float) -> None:
        """Fly on by the time that passed [s], but work for at most `budget` [s]: a machine too slow for the speed flies slower.

        Raises:
            SimulationError: The flight diverged.
        """
        if self.restart_asked:
            self.restart_asked, self._due = False, 0.0
            self.flight.restart()
        if not self.paused:
            self._due += elapsed * self.speed
            give_up = perf_counter() + budget
            while self._due >= self.flight.period and not self.flight.over and perf_counter() < give_up:
                self.flight.step()
                self._due -= self.flight.period
            self._due = min(self._due, self.flight.period)
        self.now = self.flight.instant()

    def change_speed(self, steps: int) -> None:
        """Choose the next faster (1) or slower (-1) of the speeds."""
        nearest = min(range(len(SPEEDS)), key=lambda k: abs(SPEEDS[k] - self.speed))
        self.speed = SPEEDS[int(np.clip(nearest + steps, 0, len(SPEEDS) - 1))]


def pace(player: Player, go_on: Callable[[], bool], show: Callable[[], None]) -> None:
    """Fly and show what there is to draw at an even rate, as long as `go_on`, asked before every picture, says so."""
    last = perf_counter()
    while go_on():
        start = perf_counter()
        player.advance(start - last, 0.5 / RATE)
        last = start
        show()
        sleep(max(0.0, 1.0 / RATE - (perf_counter() - start)))
