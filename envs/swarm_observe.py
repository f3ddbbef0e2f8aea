"""SwarmObserve-v0: one flyby of a small body by a swarm as a gymnasium environment, on the simulation of `swarm-mj run`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import SimulationError
from swarm_mj.flight import initial_state, make_simulation
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.safety import close_approaches
from swarm_mj.observation.observer import ObserverKind
from swarm_mj.planning import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.occultation import segments_blocked

from .arguments import checked_render_mode, checked_share, checked_step, flight_seed
from .controls import check_action, check_level, make_level
from .downlink import Downlink, Radio
from .patches import make_patches
from .pictures import IS_OBSERVING, PictureTaker
from .readings import Readings
from .rewards import SATURATION_FROM, StepMeasures, checked_weights, reward_terms
from .state import SwarmState, is_finite, read_state

Array = NDArray[np.float64]
Observation = NDArray[np.float32]

#: Data aboard below this share of the nominal volume count as delivered.
NOTHING_STORED = 1e-9


class SwarmObserveEnv(gymnasium.Env[Observation, Any]):
    """A swarm of n CubeSats flies past a small body, images a target on it and sends the pictures to Earth.

    One episode is one flyby of a scenario, flown by the same `Simulation`, plug-ins, observers and criteria as
    `swarm-mj run`. Only attitudes are controlled: the trajectories follow from the deployment. Frames: N inertial, A fixed in
    the body, B the spacecraft, camera and dish along its +z (docs/theory.md). n counts the observers and, where the
    scenario's behaviour asks for one, a dedicated communications spacecraft, which comes last.

    ## Action space

    An action is held for one step of `step_s` seconds.

    | control | space | meaning for spacecraft j |
    |---|---|---|
    | `torque` | Box(-1, 1, (3n,)) | entries 3j..3j+2: motor torques of its wheels over their limit (4 mN m by default); the \
scenario's behaviour still decides who observes and who talks, and gives `sigma_BR` |
    | `pointing` | Box(-1, 1, (2n,)) | entries 2j, 2j+1: east and north tangent, seen from the body's centre, of the surface \
point to look at, over the half width of the target's pyramid: (0, 0) is the target's middle, (-1, -1) its south-west corner. \
It is tracked, turning with the body, by the scenario's control law while the scenario's behaviour has spacecraft j observe, \
and ignored while that has it talk |
    | `role` | MultiDiscrete([K + n + 3] * n) | 0..K-1: centre of a patch of the target; K: the body's centre; K+1..K+n: \
spacecraft 1..n (itself: hold); K+n+1: Earth; K+n+2: hold the direction of +z in N. Tracked by the scenario's control law |

    K is the number of patches (16): a square grid on the target's pyramid, row by row from its south-west corner, west to east.

    ## Observation space

    Box, float32, finite; values beyond the bounds are clipped. First a block of 29 numbers for each spacecraft:

    | entries | name | meaning | divided by | bounds |
    |---|---|---|---|---|
    | 0-2 | position | r in A | imaging radius [m] (35 km) | -10, 10 |
    | 3-5 | velocity | relative to the turning body, in A | mothership's distance over time of flight (50 m/s) | -10, 10 |
    | 6-8 | sigma_BR | attitude error, MRP, as the control law saw it last (one control period ago) | 1 | -1, 1 |
    | 9-11 | boresight | unit vector +z of B, in A | 1 | -1, 1 |
    | 12-14 | x_axis | unit vector +x of B, in A | 1 | -1, 1 |
    | 15-17 | rate | omega_BN in B | 0.1 rad/s | -10, 10 |
    | 18-20 | wheel_speed | of the three wheels | top speed | -1, 1 |
    | 21 | imaging | 1 if it is an observer that looks at the body | 1 | 0, 1 |
    | 22 | link | 1 if its radio link was closed at the end of the step | 1 | 0, 1 |
    | 23 | stored | data aboard | nominal volume | 0, 10 |
    | 24-28 | role | one of: body's centre, spacecraft, Earth, surface point, held direction | 1 | 0, 1 |

    then seen share of each of the K patches (0, 1), time left over the duration (0, 1), seen share of the target (0, 1) and
    data delivered over the nominal volume (0, 10). `env.unwrapped.readings.split(observation)` gives them by name.

    ## Reward

    The sum of `info["reward_terms"]`, each its weight (argument `reward_weights`) times:

    | term | weight | measure in a step |
    |---|---|---|
    | seen | 1 | newly seen area over the target's area |
    | delivered | 1 | data that Earth received over the nominal volume |
    | effort | -0.02 | mean of (motor torque / limit)^2, times step over duration |
    | saturation | -0.1 | mean over wheels of (speed / top speed - 0.9) / 0.1 within 0 to 1, times step over duration |
    | approach | -0.1 | share of pairs closer than `safety.min_separation_m` after the grace time, times step over duration |
    | loss | -1 | 1 at an impact on the body or divergence |

    A picture is taken every `observation.interval_s`, and at the visit, by each observer that looks at the body (centre or
    surface point); with the criterion `visit` only the visit counts. It adds data for each cell that nobody saw before: area
    over the foreshortened square of the ground sampling distance, times `bits_per_pixel`. A spacecraft that tracks another
    sends it what is aboard, one that tracks Earth sends to Earth, while the link is closed as in `swarm_mj.mission.links`:
    dish within its beam, the other's antenna too, in range, the body not in between. Earth hears one spacecraft at a time:
    of several, the first in gene order until it has nothing left to send. The nominal volume is that of the whole
    target seen straight down from the imaging altitude.

    ## Starting state

    The scenario's deployment: all at the mothership with solved velocities, wheels at rest, random attitudes and rates in
    the scenario's ranges. They come from a flight seed that `reset` draws from `self.np_random` (or takes from
    `options={"flight_seed": k}`) and gives in `info["flight_seed"]`: `swarm-mj run SCENARIO --set seed=k` starts the same.

    ## Episode end

    Terminated: the target is seen to `complete` percent and all data are delivered; or a spacecraft hits the body; or the
    flight diverges (the observation is then the last finite one). `info["end"]` says `complete`, `impact` or `diverged`.
    Truncated: at the scenario's duration.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | `"eros-observe"` | packaged name, path of a YAML file, or a `Scenario` |
    | control | `"role"` | `torque`, `pointing` or `role` |
    | render_mode | None | None or `"rgb_array"`; for `"human"` gymnasium adds its own window |
    | step_s | 10.0 | length of a step [s]; a multiple of `control.period_s` that divides the duration |
    | patches | 16 | number of patches K, a square number |
    | observer | `"raycast"` | who judges pictures: `raycast`, `faceid` (OpenGL) or `auto` |
    | complete | 99.9 | seen share of the target that counts as complete [%] |
    | reward_weights | None | mapping that replaces weights by name |
    | bits_per_pixel | 1.0 | data of a picture after compression |
    | swarm_rate_bit_s | 1e5 | from a spacecraft to the one it tracks |
    | earth_rate_bit_s | 8e3 | to Earth, all together; the rate of the MarCO CubeSats at Mars |
    | width, height | 640, 480 | of rendered pictures |

    ## Version history

    v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: str | Path | Scenario = "eros-observe",
        control: str = "role",
        render_mode: str | None = None,
        *,
        step_s: float = 10.0,
        patches: int = 16,
        observer: ObserverKind = "raycast",
        complete: float = 99.9,
        reward_weights: Mapping[str, float] | None = None,
        bits_per_pixel: float = 1.0,
        swarm_rate_bit_s: float = 1e5,
        earth_rate_bit_s: float = 8e3,
        width: int = 640,
        height: int = 480,
    ) -> None:
        self._pictures: PictureTaker | None = None
        self._overview: Any = None
        check_level(control)
        self.render_mode, self._size = checked_render_mode(render_mode, self.metadata["render_modes"]), (width, height)
        self._weights = checked_weights(reward_weights)
        radio = Radio(
            bits_per_pixel=bits_per_pixel, swarm_rate_bit_s=swarm_rate_bit_s, earth_rate_bit_s=earth_rate_bit_s
        )
        self._complete = checked_share(complete)
        given = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        self._ticks, self._last_tick = checked_step(given, step_s)
        self._step_s, self._share = step_s, step_s / given.duration_s

        plan = make_plan(given)
        self.patches = make_patches(plan.region, patches)
        pictures = self._pictures = PictureTaker(plan, observer)
        self._level = make_level(control, plan, self.patches, pictures.observer.tracer)
        self.plan = replace(plan, behavior=self._level.behavior, controller=self._level.controller)
        self.simulation = make_simulation(self.plan)
        self._downlink = Downlink(plan, radio, pictures.observer.camera.pixel_angle)
        self.readings = Readings(plan, patches)
        self.observation_space, self.action_space = self.readings.space, self._level.action_space
        self._pairs = np.triu_indices(plan.n, 1)
        self._running = False

    @property
    def reward_weights(self) -> dict[str, float]:
        """Weight of each reward term."""
        return dict(self._weights)

    @property
    def pictures(self) -> PictureTaker:
        """What the swarm has seen in this episode."""
        if self._pictures is None:
            raise gymnasium.error.ClosedEnvironmentError("SwarmObserve-v0 was closed; make it anew")
        return self._pictures

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a flyby; see the class for the starting state.

        Raises:
            ScenarioError: `options` holds something else than a valid `flight_seed`.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31))
        chosen = flight_seed(options, drawn)
        scenario = self.plan.scenario.model_copy(update={"seed": chosen})
        start = initial_state(replace(self.plan, scenario=scenario))
        self._level.reset()
        self.pictures.reset()
        self._downlink.reset()
        # The first decision shows the attitude error; the second reset undoes whatever it left behind.
        self.simulation.reset(start)
        self._targets = self.simulation.decide()
        self.simulation.reset(start)
        self._state = read_state(self.simulation)
        self._running = True
        self._observation = self._observe()
        return self._observation.copy(), self._info() | {"flight_seed": chosen}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly on for one step with the action held.

        Raises:
            gymnasium.error.InvalidAction: The action does not lie in the action space.
            gymnasium.error.ResetNeeded: The episode has ended or has not begun.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded("SwarmObserve-v0: the episode is over or has not begun; call reset first")
        self._level.hold(check_action(self.action_space, action), self._state)
        before = self._state
        try:
            area, effort = self._fly()
        except SimulationError as error:
            return self._result(StepMeasures(loss=1.0), "diverged", {"cause": str(error)})
        self._state = read_state(self.simulation)
        received = self._downlink.transmit(self._state, self._targets, self._step_s)
        hit = self._impacts(before)
        self._observation = self._observe()
        measures = StepMeasures(
            seen=area / self.plan.region.total_area,
            delivered=received / self._downlink.nominal,
            effort=self._share * effort,
            saturation=self._share * self._saturation(),
            approach=self._share * self._close_pairs(before),
            loss=float(hit.any()),
        )
        return self._result(measures, "impact" if hit.any() else "complete" if self._is_complete() else "", {})

    def render(self) -> NDArray[np.uint8] | None:
        """The overview as a picture, shape (height, width, 3), with `render_mode="rgb_array"`.

        Markers are blue where a spacecraft observes, orange where it talks, grey where it holds its attitude.

        Raises:
            ObserverError: OpenGL cannot be loaded.
            gymnasium.error.ResetNeeded: There is nothing to draw before the first `reset`.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        if not hasattr(self, "_state"):
            raise gymnasium.error.ResetNeeded("SwarmObserve-v0: call reset before render")
        if self._overview is None:
            from .drawing import Overview

            self._overview = Overview(self.plan, self.simulation, *self._size)
        kind = self._targets.kind
        talking = np.isin(kind, (TargetKind.SPACECRAFT, TargetKind.EARTH))
        return self._overview.draw(self.simulation, self._state, self._imaging(), talking)

    def close(self) -> None:
        """Release the observer and the OpenGL context; may be called again."""
        if self._overview is not None:
            self._overview.close()
        if self._pictures is not None:
            self._pictures.close()
        self._overview, self._pictures, self._running = None, None, False

    def _fly(self) -> tuple[float, float]:
        """Fly one step; returns newly seen area [m^2] and the mean square of the torques over their limit."""
        area = effort = 0.0
        simulation, limit = self.simulation, self.plan.properties.max_wheel_torque
        for _ in range(self._ticks):
            area += self._decide()
            effort += float(simulation.data.ctrl @ simulation.data.ctrl)
            simulation.advance()
        if simulation.tick == self._last_tick or not is_finite(simulation):
            area += self._decide()  # the last pictures of a flight; a state that is not finite raises
        return area, effort / (self._ticks * 3 * self.plan.n * limit**2)

    def _decide(self) -> float:
        self._targets = self.simulation.decide()
        if not self.pictures.due(self.simulation.tick):
            return 0.0
        area, pixels = self.pictures.take(read_state(self.simulation), self._targets)
        self._downlink.add_pictures(pixels)
        return area

    def _observe(self) -> Observation:
        link, seen = self._downlink, self.pictures.seen
        return self.readings.read(
            self._state,
            self._targets,
            sigma_BR=self._level.controller.sigma_BR,
            imaging=self._imaging(),
            link=link.closed,
            stored=link.stored / link.nominal,
            patch_seen=self.patches.seen_fraction(seen),
            seen=self.pictures.percent / 100.0,
            delivered=link.delivered / link.nominal,
        )

    def _imaging(self) -> NDArray[np.bool_]:
        imaging = IS_OBSERVING[self._targets.kind]
        imaging[self.plan.n_observers :] = False
        return imaging

    def _impacts(self, before: SwarmState) -> NDArray[np.bool_]:
        shape = self.plan.shape
        return segments_blocked(before.r_A, self._state.r_A, shape.vertices, shape.faces, shape.max_radius)

    def _close_pairs(self, before: SwarmState) -> float:
        """Share of the pairs that came too close; the exact test is made only where the triangle inequality allows it."""
        safety, (i, j) = self.plan.scenario.safety, self._pairs
        r_N = np.stack([before.r_BN_N, self._state.r_BN_N])
        relative = r_N[:, j] - r_N[:, i]
        step = relative[1] - relative[0]
        ends, moved = np.sqrt((relative**2).sum(axis=2)), np.sqrt((step**2).sum(axis=1))
        if (0.5 * (ends[0] + ends[1] - moved) > safety.min_separation_m).all():
            return 0.0
        times = np.array([before.t, self._state.t])
        near = close_approaches(times, r_N, closer_than=safety.min_separation_m, after=safety.separation_grace_s)
        return len(near) / max(1, len(i))

    def _saturation(self) -> float:
        fraction = np.abs(self._state.wheel_speed) / self.plan.properties.max_wheel_speed
        return float(np.clip((fraction - SATURATION_FROM) / (1.0 - SATURATION_FROM), 0.0, 1.0).mean())

    def _is_complete(self) -> bool:
        link = self._downlink
        return self.pictures.percent >= self._complete and link.stored.sum() <= NOTHING_STORED * link.nominal

    def _result(
        self, measures: StepMeasures, end: str, more: dict[str, Any]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        terms = reward_terms(measures, self._weights)
        terminated = bool(end)
        truncated = not terminated and self.simulation.tick >= self._last_tick
        self._running = not (terminated or truncated)
        info = self._info() | more | {"reward_terms": terms} | ({"end": end} if end else {})
        return self._observation.copy(), float(sum(terms.values())), terminated, truncated, info

    def _info(self) -> dict[str, Any]:
        link = self._downlink
        return {
            "time_s": self.simulation.time,
            "coverage_percent": self.pictures.percent,
            "delivered_bit": float(link.delivered),
            "stored_bit": link.stored.tolist(),
        }
