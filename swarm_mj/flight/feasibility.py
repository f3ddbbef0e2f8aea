"""A scenario held against its encounter before it flies: can the wheels follow, are pictures sharp, and do they join?

What cannot work at all is an error that names the limit, the number and the remedy. What may fall short is a finding. Checked
at the arrival of each observer, from its state there; around it the path counts as straight. Errors only where the behaviour is
known to look at the body (`KNOWN`): what a behaviour of one's own looks at is its own affair.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import degrees, inf, pi, sqrt

import numpy as np

from swarm_mj.errors import ScenarioError, at_least, at_most
from swarm_mj.flight.observe import camera_from, schedule_from
from swarm_mj.mission.behaviors import AdaptableRoles, DedicatedCommunications
from swarm_mj.mission.sweep import TargetSweep
from swarm_mj.mission.target import TargetRegion
from swarm_mj.mission.trajectories import Deployment, propagate
from swarm_mj.observation.camera import CameraMotion, look_at, motion_blur_px
from swarm_mj.observation.capture import limits_of, sight
from swarm_mj.scenarios.constants import GRAVITATIONAL_CONSTANT
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.slew import slew_time, turning_limits
from swarm_mj.spacecraft.properties import RPM, SpacecraftProperties
from swarm_mj.typing import Array

#: Behaviours that look at the body, or at the target, inside the imaging radius and nowhere else.
KNOWN = (AdaptableRoles, DedicatedCommunications, TargetSweep)
#: Tolerance of paths that only serve to know how fast they are flown.
ROUGH = 1e-6
#: Share of the radius from which a mesh that is off its centre is worth a remark; mean densities of small bodies [kg/m^3].
OFF_CENTRE, DENSITIES = 0.01, (300.0, 8000.0)
#: Farthest that a path may go astray because gravity is held for a control period [m].
GRAVITY_DRIFT_M = 1.0
#: Farthest that a line of sight may turn within a control period [rad]: torques are held as long.
TURN_IN_A_PERIOD = 0.1
#: Pictures whose motion blur is looked at, at most, of each observer.
MOST_PICTURES = 200


@dataclass(frozen=True, kw_only=True)
class ArrivalGeometry:
    """Each observer at its arrival; n observers."""

    r_N: Array  #: positions [m], shape (n, 3)
    v_N: Array  #: velocities [m/s], shape (n, 3)
    a_N: Array  #: accelerations [m/s^2], shape (n, 3)
    t: Array  #: times of the arrivals past the epoch [s], shape (n,)
    rate: Array  #: rate of the line of sight to the body's centre [rad/s], shape (n,)
    acceleration: Array  #: its angular acceleration [rad/s^2], shape (n,)
    #: largest rate about the arrival, v / b of the straight line [rad/s], inside the imaging radius, shape (n,)
    peak_rate: Array
    peak_acceleration: Array  #: the same of the acceleration [rad/s^2], shape (n,)


def arrival_geometry(
    deployment: Deployment, environment: Environment, n: int, imaging_radius_m: float
) -> ArrivalGeometry:
    """How the first n spacecraft pass the body at their arrivals."""
    v_N = np.empty((n, 3))
    for j in range(n):
        span = np.array([deployment.release_s[j], deployment.arrival_s[j]])
        start = deployment.release_r_N[j : j + 1], deployment.v0_N[j : j + 1]
        v_N[j] = propagate(environment.acceleration_N, *start, span, rtol=ROUGH)[1][-1, 0]
    r_N, t = deployment.destination_N[:n], deployment.arrival_s[:n]
    a_N = np.array([environment.acceleration_N(float(t[j]), r_N[j : j + 1])[0] for j in range(n)])
    rate, acceleration = sight_rates(r_N, v_N, a_N)
    around = [_around(r_N[j], v_N[j], imaging_radius_m) for j in range(n)]
    peaks = np.array([[motion.max() for motion in sight_rates(line, v_N[j], 0.0)] for j, line in enumerate(around)])
    return ArrivalGeometry(
        r_N=r_N,
        v_N=v_N,
        a_N=a_N,
        t=t,
        rate=rate,
        acceleration=acceleration,
        peak_rate=np.maximum(peaks[:, 0], rate),
        peak_acceleration=np.maximum(peaks[:, 1], acceleration),
    )


def sight_rates(r_N: Array, v_N: Array, a_N: Array | float) -> tuple[Array, Array]:
    """Rate [rad/s] and angular acceleration [rad/s^2] of the line of sight to the body's centre, shape (n,)."""
    square = np.sum(r_N * r_N, axis=1)
    omega = np.cross(r_N, v_N) / square[:, None]
    closing = np.sum(r_N * v_N, axis=1) / square
    change = np.cross(r_N, np.broadcast_to(a_N, r_N.shape)) / square[:, None] - 2.0 * closing[:, None] * omega
    return np.linalg.norm(omega, axis=1), np.linalg.norm(change, axis=1)


def _around(r_N: Array, v_N: Array, radius: float) -> Array:
    """Places on the straight line through an arrival, inside the imaging radius and where its angle moves, shape (k, 3)."""
    speed = float(np.linalg.norm(v_N))
    if speed == 0.0:
        return r_N[None]
    middle, passing = -(r_N @ v_N) / speed**2, np.linalg.norm(np.cross(r_N, v_N)) / speed
    t = middle + 3.0 * passing / speed * np.linspace(-1.0, 1.0, 241)
    line = r_N + t[:, None] * v_N
    inside = line[np.linalg.norm(line, axis=1) <= radius]
    return inside if len(inside) else r_N[None]


@dataclass(frozen=True, kw_only=True)
class EncounterCheck:
    """A scenario and its plan, held against the encounter."""

    scenario: Scenario  #: what is asked for
    behavior: object  #: who points at what
    properties: SpacecraftProperties  #: of every spacecraft
    environment: Environment  #: of the body
    region: TargetRegion  #: the target
    deployment: Deployment  #: the trajectories
    least_radius: Array  #: least distance of each observer to the body's centre [m], shape (n,)

    @cached_property
    def arrival(self) -> ArrivalGeometry:
        """How the observers pass the body."""
        radius = self.scenario.behavior.imaging_radius_m
        return arrival_geometry(self.deployment, self.environment, len(self.least_radius), radius)

    @property
    def known(self) -> bool:
        """Whether it is known where the behaviour looks."""
        return isinstance(self.behavior, KNOWN)

    def findings(self) -> tuple[str, ...]:
        """What may fall short, one sentence each.

        Raises:
            ScenarioError: It cannot work: no observer comes where pictures are taken, none can be turned as fast as it must be
                at its arrival, or all cells blur in all pictures.
        """
        if self.known:
            self._require_inside()
        return (*self._of_body(), *self._of_wheels(), *self._of_steps(), *self._of_pictures(), *self._of_motion_blur())

    def _of_body(self) -> list[str]:
        """Origin and density of the body."""
        mesh, gm, found = self.region.mesh, getattr(self.environment.gravity, "gm", None), []
        away = float(np.linalg.norm(mesh.centroid))
        if (share := away / mesh.max_radius) > OFF_CENTRE:
            found.append(
                f"{mesh.name}: the centre of its volume lies {away:.3g} m from the origin ({100.0 * share:.2g} % of its "
                "radius), which paths and gravity take for the centre of mass; shift the mesh if it is not"
            )
        density = (gm or 0.0) / (GRAVITATIONAL_CONSTANT * mesh.volume)
        if gm and not DENSITIES[0] <= density <= DENSITIES[1]:
            found.append(
                f"{mesh.name}: a mean density of {density:.3g} kg/m^3 follows from its mesh and gravity; small bodies have "
                f"{DENSITIES[0]:g} to {DENSITIES[1]:g}: see units of body.gravity.parameters and body.shape_unit"
            )
        return found

    def _require_inside(self) -> None:
        scenario, met = self.scenario, self.arrival
        radius = scenario.behavior.imaging_radius_m
        at_arrival = scenario.observation.criterion == "arrival"
        distance = float((np.linalg.norm(met.r_N, axis=1) if at_arrival else self.least_radius).min())
        if distance > radius:
            raise ScenarioError(
                f"behavior.imaging_radius_m = {radius:g}: no observer is inside it "
                f"{'at the arrival' if at_arrival else 'at any time'}, so that no picture counts; the nearest comes to "
                f"{at_least(distance, 6)} m of the body's centre: must be at least that, or lower design.imaging_altitude_m"
            )

    def _of_wheels(self) -> list[str]:
        """Rates and accelerations against what the wheels give."""
        scenario, met = self.scenario, self.arrival
        worst, best = turning_limits(self.properties)
        # Momentum that is aboard from the start may add to that of the wheels, or take from it.
        tumbling = sqrt(3.0) * scenario.spacecraft.initial_rate_range_rpm * RPM
        found = []
        for what, unit, key, spare in (
            ("rate", "rad/s", "max_speed_rpm", tumbling),
            ("acceleration", "rad/s^2", "max_torque_n_m", 0.0),
        ):
            now, peak = getattr(met, what), getattr(met, f"peak_{what}")
            surely, utmost = getattr(worst, what), getattr(best, what)
            if self.known and now.min() > utmost + spare:
                raise ScenarioError(
                    f"spacecraft.wheel.{key} = {getattr(scenario.spacecraft.wheel, key):g}: at the arrival the line of sight "
                    f"has an angular {what} of {now.min():.3g} {unit}, and the wheels give the spacecraft {utmost:.3g} {unit} "
                    f"at most; raise it, design.imaging_altitude_m or design.time_of_flight_s (a slower flyby)"
                )
            if peak.max() > surely - spare:
                less = f", and the initial tumbling may take {spare:.3g} {unit} of that" if spare else ""
                found.append(
                    f"the line of sight reaches an angular {what} of {peak.max():.3g} {unit} near the arrival; about the worst "
                    f"axis across the camera's the wheels give {surely:.3g} {unit} (about the best {utmost:.3g}){less}: raise "
                    f"spacecraft.wheel.{key}, design.imaging_altitude_m or design.time_of_flight_s"
                )
        return found

    def _of_steps(self) -> list[str]:
        """What holding forces and torques for a control period does to path and pointing."""
        met, period, found = self.arrival, self.scenario.control.period_s, []
        # Held at the middle of each period, gravity is wrong by its change: T^2 / 24 of velocity and T^2 / 12 of place.
        pull = float(np.linalg.norm(met.a_N, axis=1).max())
        if (drift := period**2 / 8.0 * pull) > GRAVITY_DRIFT_M:
            found.append(
                f"control.period_s = {period:g}: gravity of {pull:.3g} m/s^2 held as long may lead paths {at_least(drift)} m "
                f"astray; at most {at_most(period * sqrt(GRAVITY_DRIFT_M / drift))} s keeps them within {GRAVITY_DRIFT_M:g} m"
            )
        if (turn := period * float(met.peak_rate.max())) > TURN_IN_A_PERIOD:
            found.append(
                f"control.period_s = {period:g}: the line of sight turns by {at_least(degrees(turn))} deg while a torque is "
                f"held; at most {at_most(period * TURN_IN_A_PERIOD / turn)} s keeps that within "
                f"{degrees(TURN_IN_A_PERIOD):.3g} deg"
            )
        return found

    def _of_pictures(self) -> list[str]:
        """The interval of pictures against the passage and the footprint; the way in against the turn to the body."""
        scenario, met = self.scenario, self.arrival
        behavior, interval, found = scenario.behavior, scenario.observation.interval_s, []
        radius = (
            inf if behavior.name == "body_tracking" else behavior.imaging_radius_m
        )  # that tracks it however far it is
        entry_s, passage = zip(*(_passage(met.r_N[j], met.v_N[j], radius) for j in range(len(met.t))), strict=True)
        if scenario.observation.criterion == "passage" and not scenario.observation.sequence:
            if (shortest := min(passage)) < interval:
                found.append(
                    f"observation.interval_s = {interval:g}: an observer is inside behavior.imaging_radius_m = {radius:g} for "
                    f"{shortest:.3g} s, which leaves at most one picture besides that at the target point; take pictures more "
                    "often or widen the radius"
                )
            surface = float(np.linalg.norm(self.region.centroid_A, axis=1).mean())
            height = np.linalg.norm(met.r_N, axis=1) - surface
            turned = np.linalg.norm(
                np.cross(met.r_N, met.v_N) / np.sum(met.r_N**2, axis=1)[:, None] - self.environment.spin_N, axis=1
            )
            moved, wide = interval * surface * turned, 2.0 * height * camera_from(scenario).tan_half_angle
            if (moved > wide).any():
                j = int(np.argmax(moved / wide))
                found.append(
                    f"observation.interval_s = {interval:g}: the ground moves by {moved[j]:.3g} m from picture to picture at "
                    f"the arrival, and a picture is {wide[j]:.3g} m wide: pictures do not join; at most "
                    f"{at_most(interval * wide[j] / moved[j])} s"
                )
        least = slew_time(pi, turning_limits(self.properties)[0])
        inside = np.linalg.norm(met.r_N, axis=1) < radius
        late = [int(j) for j in np.flatnonzero(inside) if entry_s[j] < least and met.t[j] > entry_s[j]]
        if late:
            j = min(late, key=lambda j: entry_s[j])
            needed = float(np.linalg.norm(met.r_N[j] - least * met.v_N[j]))
            found.append(
                f"behavior.imaging_radius_m = {radius:g}: it is crossed {entry_s[j]:.3g} s before the arrival, and half a turn "
                f"about the worst axis takes the wheels {at_least(least)} s; {at_least(needed)} m gives that time"
            )
        return found

    def _of_motion_blur(self) -> list[str]:
        """The commanded motion blur of cells against its limit."""
        met, limit = self.arrival, self.scenario.observation.max_motion_blur_px
        if limit is None:
            return []
        motion_blur = [self._motion_blur(float(met.t[j]), met.r_N[j], met.v_N[j]) for j in range(len(met.t))]
        shown = np.concatenate([one[~np.isnan(one)] for one in motion_blur])
        if not len(shown) or shown.max() <= limit:
            return []
        exposure = self.scenario.camera.exposure_s or 0.0
        if self.known and shown.min() > limit and self._all_motion_blur():
            raise ScenarioError(
                f"observation.max_motion_blur_px = {limit:g}: every face blurs more in every picture, by {shown.min():.3g} to "
                f"{shown.max():.3g} px at the arrival; camera.exposure_s = {exposure:g}: must be at most "
                f"{at_most(exposure * limit / shown.min())}, or raise max_motion_blur_px"
            )
        share = 100.0 * float(np.mean(shown > limit))
        return [
            f"observation.max_motion_blur_px = {limit:g}: {share:.0f} % of the faces in pictures of the arrival blur more, "
            f"up to {shown.max():.3g} px; camera.exposure_s = {at_most(exposure * limit / shown.max())} would keep all of them"
        ]

    def _all_motion_blur(self) -> bool:
        """Whether every cell blurs more than the limit in every qualifying image, by the commanded rates."""
        scenario, deployment, forces = self.scenario, self.deployment, self.environment.acceleration_N
        if scenario.observation.criterion == "arrival":
            return True
        limit = scenario.observation.max_motion_blur_px or inf
        schedule = schedule_from(scenario, scenario.telemetry.interval_s)
        ticks = (
            schedule.ticks(round(scenario.duration_s / scenario.telemetry.interval_s)) * scenario.telemetry.interval_s
        )
        for j in range(len(self.least_radius)):
            release = float(deployment.release_s[j])
            times = np.concatenate(([release], ticks[ticks > release]))
            start = deployment.release_r_N[j : j + 1], deployment.v0_N[j : j + 1]
            r_N, v_N = (states[1:, 0] for states in propagate(forces, *start, times, rtol=ROUGH))
            inside = np.flatnonzero(np.linalg.norm(r_N, axis=1) <= scenario.behavior.imaging_radius_m)
            for k in inside[:: 1 + len(inside) // MOST_PICTURES]:
                motion_blur = self._motion_blur(float(times[k + 1]), r_N[k], v_N[k])
                if (motion_blur[~np.isnan(motion_blur)] <= limit).any():
                    return False
        return True

    def _motion_blur(self, t: float, r_N: Array, v_N: Array) -> Array:
        """Of the cells in a picture towards the body's centre [px], NaN where it does not show one, shape (cells,)."""
        region, camera = self.region, camera_from(self.scenario)
        C_AN, spin_N = self.environment.C_AN(t), self.environment.spin_N
        pose = look_at(C_AN @ r_N, np.zeros(3))
        omega_N = np.cross(r_N, v_N) / (r_N @ r_N)
        motion = CameraMotion(C_AN @ (v_N - np.cross(spin_N, r_N)), pose.C_CA @ (C_AN @ (omega_N - spin_N)))
        limits = limits_of(self.scenario.observation, camera, region)
        distance, height = sight(region, pose.r_A)
        shown = (height > 0.0) & (distance <= limits.max_range) & camera.contains(pose.to_camera(region.centroid_A))
        return np.where(shown, motion_blur_px(region, camera, pose.r_A, pose.C_CA, motion), np.nan)


def _passage(r_N: Array, v_N: Array, radius: float) -> tuple[float, float]:
    """Times on a straight line from the entry to the arrival, and from the entry to the exit [s]; infinite where it rests."""
    speed = float(np.linalg.norm(v_N))
    if speed == 0.0:
        return inf, inf
    along, passing = float(r_N @ v_N) / speed, float(np.linalg.norm(np.cross(r_N, v_N))) / speed
    half = sqrt(max(radius**2 - passing**2, 0.0))
    return (half + along) / speed, 2.0 * half / speed
