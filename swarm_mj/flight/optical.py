"""Navigation by pictures in a flight: cameras look at the body, filters make of it where the spacecraft are.

Every so often each spacecraft whose camera works takes a picture, by the detector and the light of `pictures`, from where it
truly is. What it tells is measured against a prediction from where it is believed to be, by the attitude that its star tracker
and gyro give, and goes into a filter. Known positions less true ones are written into the flight, and whoever decides
(guidance, behaviours, corrections) is shown the known ones. Aboard the mothership nothing is measured.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from math import ceil, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.pictures import PictureMaker
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.trajectory_corrections import errors_of, knots
from swarm_mj.mission.behaviors import looks_at_body
from swarm_mj.mission.covariance import burn_covariance
from swarm_mj.mission.trajectories import AccelerationN
from swarm_mj.navigation.filter import FilterNoise, SwarmFilter
from swarm_mj.navigation.measure import measure
from swarm_mj.navigation.picture import TAKEN_SAMPLES, Fix, Predictor, Rejected, SeenPicture
from swarm_mj.observation.camera import CameraMotion, CameraPose
from swarm_mj.observation.capture import Picture
from swarm_mj.observation.photometry import needed_surface
from swarm_mj.observation.shading import ShadedBody
from swarm_mj.scenarios.schema_navigation import OpticalNavigation
from swarm_mj.scenarios.schema_sensors import Sensors
from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, Stream, stream
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.telemetry import correlated
from swarm_mj.smallbody.simplify import simplify
from swarm_mj.spacecraft.attitude.estimation import sense
from swarm_mj.spacecraft.mounting import nominal_mount, true_mount
from swarm_mj.typing import Array

#: Least time between two pictures of a spacecraft for navigation [s].
SHORTEST_S = 1.0
#: What is known at first where the scenario does not say: shares of distance and speed, and at most [m, m/s].
FIRST_SHARE, FIRST_MOST = 0.01, (1e5, 0.1)
#: Nearer to each other, as just after their release, spacecraft do not range [m].
LEAST_RANGE_M = 10.0
#: What is told of a measurement that the filter refuses.
WILD = "too far from what was believed"


@dataclass(frozen=True)
class PictureRecord:
    """What became of a picture for navigation.

    Attributes:
        t: When it was taken [s].
        spacecraft: Whose, by name.
        kind: How it was measured: `centroid`, `limb`, `landmarks`, or what was tried last; `range` between two spacecraft.
        why: Why it was not used; empty: it was.
        nis: Innovation squared over its covariance, where it got that far.
        dof: Number of its components.
        diameter_px: Of the body on it.
        points_A: Landmarks that were found again, in the frame of the body as it is believed [m].
    """

    t: float
    spacecraft: str
    kind: str
    why: str = ""
    nis: float | None = None
    dof: int = 0
    diameter_px: float = 0.0
    points_A: tuple[tuple[float, ...], ...] = ()


@dataclass(eq=False)
class OpticalNavigator:
    """Navigates the spacecraft of a plan; see `simulator.simulation.Navigator`.

    Args:
        plan: What is flown.

    Attributes:
        due: Tick of the next pictures.
        records: What became of all pictures so far, in order.
    """

    plan: Plan
    due: int = 0
    records: list[PictureRecord] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Make what the pictures of all flights share."""
        plan, scenario = self.plan, self.plan.scenario
        asked = scenario.navigation.optical
        for key, given in (("companion", scenario.companion), ("camera.gimbal", scenario.camera.gimbal)):
            if given is not None:
                raise ScenarioError(
                    f"{key}: navigation by pictures knows one body, and cameras that do not turn by themselves; leave it out, "
                    "or navigation.mode: assumed"
                )
        self._maker = PictureMaker(plan)
        surface = needed_surface(scenario.body)
        vertices, faces = np.array(plan.shape.vertices), np.array(plan.shape.faces)
        if asked.model_faces is not None and asked.model_faces < len(faces):
            model = simplify(vertices, faces.astype(np.int64), asked.model_faces)
            vertices, faces = model.vertices, model.faces.astype(np.int32)
        radius = float(np.linalg.norm(vertices, axis=1).max())
        self._predictor = Predictor(ShadedBody(vertices, faces, surface), radius)
        sensors = scenario.spacecraft.sensors
        self._noise = FilterNoise(
            acceleration=asked.velocity_walk_m_s_sqrt_h / 60.0,
            attitude=known_attitude(sensors, scenario.control.period_s),
            # What the camera is turned by besides the spacecraft does not know; as if each axis were by as much.
            mount=float(
                np.hypot(
                    sensors.star_tracker_bias_arcsec * ARCSEC, radians(max(map(abs, scenario.camera.misalignment_deg)))
                )
            ),
            gm=0.01 * asked.gm_percent,
            rotation=radians(asked.rotation_deg),
            spin=0.01 * asked.spin_percent * abs(plan.environment.spin_rate),
        )
        self._gm = float(getattr(plan.environment.gravity, "gm", 0.0))
        self._errors, period = errors_of(plan), scenario.control.period_s
        self._burn_ticks: list[int] = []
        if scenario.trajectory.corrections:
            times = knots(scenario, plan.deployment.release_s, plan.deployment.arrival_s)[:, 1:-1]
            self._burn_ticks = sorted({round(float(t) / period) for t in times.ravel()})

    def reset(self, simulation: Simulation) -> None:
        """Begin a flight: what is known at its start, and of the body, is drawn."""
        plan, state = self.plan, simulation.state
        asked, seed, n = plan.scenario.navigation.optical, plan.scenario.seed, plan.n
        sigma = first_sigmas(asked, state.r_N, state.v_N)
        drawn = np.array([stream(seed, Stream.FIRST_KNOWLEDGE, j).standard_normal(6) for j in range(n)])
        start = np.hstack((state.r_N, state.v_N)) + sigma * drawn
        # The truth is the scenario's; what is believed of the body errs.
        body = stream(seed, Stream.BODY_KNOWLEDGE).standard_normal(5)
        self._turned, self._spun = self._noise.rotation * body[:3], self._noise.spin * float(body[3])
        gm_ratio = 1.0 + self._noise.gm * float(body[4])
        groups = [list(range(n))] if asked.range_m is not None and n > 1 else [[j] for j in range(n)]
        self._filters = [self.filter_at(0.0, start[who], sigma[who], gm_ratio) for who in groups]
        self._place = {j: (g, who.index(j)) for g, who in enumerate(groups) for j in who}
        self._waiting: list[_Event] = []
        # When, and what thrust had given by then: in all [m/s], as vectors [m/s], and how far that had carried each [m].
        self._felt = 0.0, np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3))
        self._aboard, self._next = ~state.released.copy(), 0
        self.due, self.records = 0, []
        self._write(simulation)

    def look(self, simulation: Simulation) -> None:
        """Count what the thrusters gave; take pictures and ranges where they are due; write what is known."""
        tick, t = simulation.tick, simulation.time
        self._note_pushes(simulation)
        if tick >= self._next:
            self._next = tick + self._ticks_to_next(simulation)
            self._waiting += self._pictures(simulation)
            self._waiting += [_Event(t, i, other=j, range_m=d) for i, j, d in self._ranges(simulation)]
        self._use_what_is_known_by(t)
        self._write(simulation)
        soon = [k for k in self._burn_ticks if k > tick][:1]
        # When what was seen is read out; no sooner than the next period, whatever rounding says.
        late = self.plan.scenario.navigation.optical.delay_s
        soon += [max(ceil((one.t + late) / simulation.period - 1e-6), tick + 1) for one in self._waiting]
        self.due = min([self._next, *soon])

    def sampled(self, simulation: Simulation) -> dict[str, NDArray[Any]]:
        """Estimates and what their filters believe of them."""
        r_N, v_N = simulation.state.known()
        # As estimates go on by their velocities until the next look, so do their covariances.
        carry = np.hstack((np.eye(3), (simulation.time - self._written) * np.eye(3)))
        sigma, shares = correlated(carry @ self._covariance @ carry.T)
        return {
            "r_BN_N_estimate": r_N,
            "v_BN_N_estimate": v_N,
            "r_BN_N_sigma": sigma,
            "r_BN_N_correlation": shares,
        }

    def record(self) -> list[dict[str, Any]]:
        """What became of all pictures, as plain data."""
        return [asdict(one) for one in self.records]

    def _ticks_to_next(self, simulation: Simulation) -> int:
        """Control periods until the next pictures."""
        return max(1, round(self.seconds_to_next(*simulation.state.known()) / simulation.period))

    def seconds_to_next(self, r_N: Array, v_N: Array) -> float:
        """Time from pictures to the next [s], by what is known of positions and velocities, shape (n, 3) each."""
        asked = self.plan.scenario.navigation.optical
        passing = np.linalg.norm(r_N, axis=1) / np.maximum(np.linalg.norm(v_N, axis=1), 1e-9)
        return max(min(asked.interval_s, asked.interval_share * float(passing.min())), SHORTEST_S)

    def filter_at(self, t: float, start: Array, sigma: Array, gm_ratio: float = 1.0) -> SwarmFilter:
        """The filter of k spacecraft that begins at a time [s].

        Args:
            t: Past the epoch [s].
            start: Believed states in N, shape (k, 6) [m, m/s].
            sigma: 1 sigma of each component, shape (k, 6) [m, m/s].
            gm_ratio: Believed gravitational parameter over the true one [-].
        """
        P = np.array([np.diag(each**2) for each in sigma])
        forces, gm = _believed_forces(self.plan, gm_ratio), self._gm * gm_ratio
        spin_N = self.plan.environment.spin_N
        return SwarmFilter(forces, gm, spin_N, self._noise, t, start[:, :3], start[:, 3:], P)

    def measured(self, picture: Picture, believed_r_A: Array, position_sigma: float) -> Fix | Rejected:
        """What a picture would tell, its attitude known, that is believed to be taken from elsewhere [m], shape (3,)."""
        seen = self._seen(picture, picture.pose).at(believed_r_A)
        return measure(seen, self._predictor, self.plan.scenario.navigation.optical, position_sigma)

    def _seen(self, picture: Picture, pose: CameraPose) -> SeenPicture:
        """A picture taken, as navigation is given it with a believed pose."""
        exposed, lens = self._maker.take(picture, fewest=TAKEN_SAMPLES), self._maker.lens
        diameter_px = self._predictor.diameter_at(float(np.linalg.norm(picture.r_A)), lens)
        psf_px = self.plan.scenario.camera.detector.psf_sigma_px
        return SeenPicture.of(exposed, lens, psf_px, diameter_px, pose, picture.sun_A)

    def _note_pushes(self, simulation: Simulation) -> None:
        """Remember what releases, and thrust since the last look, changed, as accelerometers have it."""
        state, propulsion, plan, t = simulation.state, simulation.propulsion, self.plan, simulation.time
        for j in np.flatnonzero(self._aboard & state.released):
            push = plan.deployment.v0_N[j] - plan.deployment.release_mothership_v_N[j]
            error = plan.scenario.dispersions.deployment_velocity_m_s**2 * np.eye(3)
            self._note_push(float(plan.deployment.release_s[j]), int(j), np.zeros(3), push, error, 0.0)
        self._aboard &= ~state.released
        if propulsion is None:
            return
        seen_t, seen_all, seen_v, seen_r = self._felt
        self._felt = t, propulsion.delta_v.copy(), propulsion.delta_v_N.copy(), propulsion.displacement_N
        gained, carried = self._felt[2] - seen_v, self._felt[3] - seen_r - seen_v * (t - seen_t)
        for j in np.flatnonzero(self._felt[1] > seen_all):
            error = burn_covariance(np.outer(gained[j], gained[j]), self._errors)
            self._note_push(t, int(j), carried[j], gained[j], error, t - seen_t)

    def _note_push(self, t: float, j: int, carried_N: Array, gained_N: Array, error: Array, within_s: float) -> None:
        """A change of velocity [m/s] with the covariance of its error, and how far it has carried the spacecraft by t [m].

        It came `within_s` before, at the most.
        """
        ago = min(float(np.linalg.norm(carried_N)) / max(float(np.linalg.norm(gained_N)), 1e-300), within_s)
        by = np.vstack((ago * np.eye(3), np.eye(3)))
        self._waiting.append(_Event(t, j, change_N=np.concatenate((carried_N, gained_N)), covariance=by @ error @ by.T))

    def _pictures(self, simulation: Simulation) -> list[_Event]:
        """The pictures of this instant, as far as cameras work and look at the body."""
        state, plan, t = simulation.state, self.plan, simulation.time
        camera, environment = plan.scenario.camera, plan.environment
        working = simulation.camera_on & state.released & looks_at_body(simulation.state.targets.kind)
        working[plan.n_observers :] = False
        C_AN, sun_N = environment.C_AN(t), environment.sun.at(t)
        q_known, sigma = self._known_attitudes(simulation)
        taken = []
        for j in np.flatnonzero(working):
            C_BN = Rotation.from_quat(state.q_BN[j], scalar_first=True).as_matrix().T
            C_CN = true_mount(camera) @ C_BN
            omega_C = true_mount(camera) @ state.omega_B[j] - C_CN @ environment.spin_N
            v_A = C_AN @ (state.v_N[j] - np.cross(environment.spin_N, state.r_N[j]))
            motion = CameraMotion(v_A, omega_C)
            picture = Picture(t, int(j), C_AN @ state.r_N[j], C_CN @ C_AN.T, C_AN @ (sun_N - state.r_N[j]), motion)
            C_known = (
                nominal_mount(camera.boresight_B) @ Rotation.from_quat(q_known[j], scalar_first=True).as_matrix().T
            )
            pose = CameraPose(np.zeros(3), C_known @ C_AN.T @ self._misturned(t).T)
            taken.append(_Event(t, int(j), picture=self._seen(picture, pose), attitude=float(sigma[j])))
        return taken

    def _misturned(self, t: float) -> Array:
        """Rotation in A by which the body is believed to be turned otherwise, shape (3, 3)."""
        environment = self.plan.environment
        phi_N = self._turned + environment.C_PN[2] * (self._spun * t)
        return Rotation.from_rotvec(environment.C_AN(t) @ phi_N).as_matrix().T

    def _known_attitudes(self, simulation: Simulation) -> tuple[Array, Array]:
        """Attitudes as star tracker and gyro give them now, shape (n, 4), and their errors about each axis, (n,) [rad]."""
        injection, state = simulation.injection, simulation.state
        if injection is None or not injection.sensing.active:
            return state.q_BN, np.zeros(len(state.q_BN))
        # The sensors are read with the picture; the decision of this instant goes by the same reading.
        injection.prepare_sensors()
        knowledge, period = injection.sensing.knowledge, simulation.period
        sense(simulation.tick, state.q_BN, state.omega_B, period, knowledge)
        # Late ones are carried on by the rate that was read with them.
        late = knowledge.delay * period
        turned = Rotation.from_rotvec(knowledge.omega_BN_B * late[:, None])
        q_BN = (Rotation.from_quat(knowledge.q_BN, scalar_first=True) * turned).as_quat(scalar_first=True)
        if not injection.sensing.estimating:
            return q_BN, np.zeros(len(q_BN))
        P, gyro = knowledge.state.covariance, knowledge.sensors.gyro_noise
        angle, cross, bias = (
            np.trace(block, axis1=1, axis2=2) / 3.0 for block in (P[:, :3, :3], P[:, :3, 3:], P[:, 3:, 3:])
        )
        # What the gyro erred by in its last period is in the attitude already, but for what the star tracker took away.
        kept = 1.0 - np.minimum(angle / knowledge.assumed[2] ** 2, 1.0)
        carried = late * (late * bias - 2.0 * cross + gyro**2 * (late / period + 2.0 * kept))
        return q_BN, np.sqrt(angle + carried)

    def _ranges(self, simulation: Simulation) -> list[tuple[int, int, float]]:
        """Ranges between spacecraft in reach of each other that the body does not part, of one group."""
        scenario, state, t = self.plan.scenario, simulation.state, simulation.time
        sigma = scenario.navigation.optical.range_m
        if sigma is None:
            return []
        found, r_N, most_m = [], state.r_N, scenario.link.max_range_m or np.inf
        working = ~state.lost & state.released
        for i in np.flatnonzero(working):
            for j in np.flatnonzero(working[i + 1 :]) + i + 1:
                between = r_N[j] - r_N[i]
                distance = float(np.linalg.norm(between))
                if distance < LEAST_RANGE_M:
                    continue
                along = float(np.clip(-(r_N[i] @ between) / distance**2, 0.0, 1.0))
                if distance > most_m or np.linalg.norm(r_N[i] + along * between) < self._predictor.radius:
                    continue
                rng = stream(scenario.seed, Stream.RANGE, int(i), int(j), round(1e3 * t))
                found.append((int(i), int(j), distance + sigma * float(rng.standard_normal())))
        return found

    def _use_what_is_known_by(self, t: float) -> None:
        """Have the filters use, in order of when it happened, what is known by now."""
        # Pushes wait as pictures do: the filters stand at the time of those that are read out.
        known = t - self.plan.scenario.navigation.optical.delay_s
        ready = [one for one in self._waiting if one.t <= known + 1e-9]
        self._waiting = [one for one in self._waiting if one.t > known + 1e-9]
        for event in sorted(ready, key=lambda one: one.t):
            g, j = self._place[event.spacecraft]
            each = self._filters[g]
            each.advance(max(event.t, each.t))
            if event.picture is not None:
                self._use_picture(event, each, j)
            elif event.other is not None:
                update = each.use_range(
                    j, self._place[event.other][1], event.range_m, self.plan.scenario.navigation.optical.range_m or 0.0
                )
                self._note(event, "range", "" if update.accepted else WILD, update.nis, 1)
            else:
                assert event.change_N is not None and event.covariance is not None
                each.push(j, event.change_N, event.covariance)
        for each in self._filters:
            each.advance(max(known, each.t))

    def _use_picture(self, event: _Event, each: SwarmFilter, j: int) -> None:
        assert event.picture is not None
        C_AN = self.plan.environment.C_AN(event.t)
        # The believed body is turned otherwise than the true one: its frame is that of the believed attitude.
        believed_AN = self._misturned(event.t) @ C_AN
        seen = event.picture
        sun_A = believed_AN @ C_AN.T @ seen.sun_A
        seen = replace(seen, sun_A=sun_A).at(believed_AN @ each.r_N[j])
        diameter = self._predictor.diameter_px(seen)
        fix = measure(seen, self._predictor, self.plan.scenario.navigation.optical, each.position_sigma(j))
        if not isinstance(fix, Fix):
            self._note(event, fix.kind, fix.why, None, 0, diameter)
            return
        update = each.use_fix(j, fix, believed_AN, event.attitude)
        points = tuple(tuple(point) for point in np.round(fix.points_A, 3).tolist())
        self._note(event, fix.kind, "" if update.accepted else WILD, update.nis, update.dof, diameter, points)

    def _note(
        self,
        event: _Event,
        kind: str,
        why: str,
        nis: float | None,
        dof: int,
        diameter_px: float = 0.0,
        points_A: tuple[tuple[float, ...], ...] = (),
    ) -> None:
        name = self.plan.names[event.spacecraft]
        name = name if event.other is None else f"{name}-{self.plan.names[event.other]}"
        self.records.append(
            PictureRecord(
                t=event.t,
                spacecraft=name,
                kind=kind,
                why=why,
                nis=nis,
                dof=dof,
                diameter_px=round(diameter_px, 2),
                points_A=points_A,
            )
        )

    def _write(self, simulation: Simulation) -> None:
        """Tell the flight what is known."""
        flights, state, t = simulation.state.flights, simulation.state, simulation.time
        if all(each.t >= t - 1e-9 for each in self._filters) and not self._waiting:
            now = self._filters
        else:
            now = [each.coast(t, self._pushes(g)) for g, each in enumerate(self._filters)]
        self._written, self._covariance = t, np.empty((self.plan.n, 6, 6))
        for j, (g, own) in self._place.items():
            flights.off_r_N[0, j] = now[g].r_N[own] - state.r_N[j]
            flights.off_v_N[0, j] = now[g].v_N[own] - state.v_N[j]
            self._covariance[j] = now[g].covariance(own)
        flights.guessed_at[0], flights.guessing[0] = t, True

    def _pushes(self, g: int) -> list[tuple[float, int, Array]]:
        """Changes of position and velocity of a group that its filter does not know yet."""
        return [
            (one.t, self._place[one.spacecraft][1], one.change_N)
            for one in sorted(self._waiting, key=lambda one: one.t)
            if one.change_N is not None and self._place[one.spacecraft][0] == g
        ]


@dataclass(frozen=True, eq=False)
class _Event:
    """Something for a filter: a picture, a range or a push.

    Attributes:
        t: When it happened [s].
        spacecraft: Whose, from 0.
        picture: What it took; None: it is something else.
        attitude: White error of its camera's attitude about each axis [rad]; None: likewise.
        other: To whom it ranged, from 0; None: likewise.
        range_m: That range [m].
        change_N: Of its position and velocity by thrust or release, shape (6,) [m, m/s]; None: likewise.
        covariance: Of that, shape (6, 6).
    """

    t: float
    spacecraft: int
    picture: SeenPicture | None = None
    attitude: float | None = None
    other: int | None = None
    range_m: float = 0.0
    change_N: Array | None = None
    covariance: Array | None = None


def known_attitude(sensors: Sensors, period: float) -> float:
    """White error of an attitude by star tracker and gyro about each axis, once their filter has settled [rad]."""
    tracker = sensors.star_tracker_noise_arcsec * ARCSEC
    if tracker == 0.0:
        return 0.0
    gyro = sensors.gyro_angular_random_walk_deg_sqrt_h * DEG_PER_SQRT_HOUR
    walk = sensors.gyro_rate_random_walk_deg_h_sqrt_h * DEG_PER_HOUR / 60.0
    # Of attitude and bias, in units of the tracker's error; a bias that never walks is soon known.
    gyro, walk = gyro / tracker, max(walk, 1e-6 * gyro, 1e-12) / tracker
    F, H = np.array([[1.0, -period], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = np.array(
        [
            [gyro**2 * period + walk**2 * period**3 / 3.0, -0.5 * walk**2 * period**2],
            [-0.5 * walk**2 * period**2, walk**2 * period],
        ]
    )
    before = float(solve_discrete_are(F.T, H.T, Q, np.eye(1))[0, 0])
    return tracker * float(np.sqrt(before / (1.0 + before)))


def first_sigmas(asked: OpticalNavigation, r_N: Array, v_N: Array) -> Array:
    """What is known at the start, 1 sigma of each component of the states, shape (n, 6) [m, m/s]."""
    found = np.empty((len(r_N), 6))
    for given, most, of, columns in (
        (asked.initial_position_m, FIRST_MOST[0], r_N, slice(0, 3)),
        (asked.initial_velocity_m_s, FIRST_MOST[1], v_N, slice(3, 6)),
    ):
        share = np.minimum(FIRST_SHARE * np.linalg.norm(of, axis=1), most)
        found[:, columns] = (share if given is None else np.full(len(of), given))[:, None]
    return found


def _believed_forces(plan: Plan, gm_ratio: float) -> AccelerationN:
    """Forces with a body that pulls otherwise by a share."""
    environment = plan.environment
    if gm_ratio == 1.0:
        return environment.acceleration_N

    def believed(t: float, r_N: Array) -> Array:
        C_AN = environment.C_AN(t)
        pull: Array = environment.attraction_A(r_N @ C_AN.T) @ C_AN
        total: Array = environment.acceleration_N(t, r_N) + (gm_ratio - 1.0) * pull
        return total

    return believed
