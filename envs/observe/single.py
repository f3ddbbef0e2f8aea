"""SwarmObserve-v0: one flyby of a small body by a swarm as a gymnasium environment, on the simulation of `swarm-mj run`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import gymnasium

from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Array32, Pixels

from ..arguments import checked_render_mode, checked_size, flight_seed, refuse_graph
from ..snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from .actions import check_action
from .batch import EpisodeBatch
from .config import EnvConfig
from .observations import ObservationLayout
from .rendering import EpisodeRenderer, Window
from .rewards import TERMS
from .state import SwarmState
from .task import make_task

Observation = Array32


class SwarmObserveEnv(RebuiltOnCopy, gymnasium.Env[Observation, Any]):
    """A swarm of n CubeSats flies past a small body, images a target on it and sends the pictures to Earth.

    `gymnasium.make("swarm_mj.envs:SwarmObserve-v0")` makes it; where gymnasium is imported before swarm_mj,
    `"swarm_mj:SwarmObserve-v0"` does too.

    One episode is one flyby of a scenario, flown by the same `Simulation`, plug-ins, observers and criteria as
    `swarm-mj run`. Only attitudes are controlled: the trajectories follow from the deployment. Frames: N inertial, A fixed in
    the body, B the spacecraft, camera and dish along its +z (docs/theory/overview.md). n counts the observers and, where the
    scenario's behaviour asks for one, a dedicated communications spacecraft, which comes last. w counts the reaction wheels of
    a spacecraft: 3, or 4 with `spacecraft.wheel_layout: pyramid` as in `eros-faults`.

    ## Action space

    An action is held for one step of `step_s` seconds.

    | control | space | meaning for spacecraft j |
    |---|---|---|
    | `torque` | Box(-1, 1, (w n,)) | entries w j..w j + w - 1: motor torques of its wheels over their limit (4 mN m by \
default); the scenario's behaviour still decides who observes and who talks, and gives `sigma_BR` |
    | `pointing` | Box(-1, 1, (2n,)) | entries 2j, 2j+1: east and north tangent, seen from the body's centre, of the surface \
point to look at, over the half width of the target's pyramid: (0, 0) is the target's middle, (-1, -1) its south-west corner. \
It is tracked, turning with the body, by the scenario's control law while the scenario's behaviour has spacecraft j observe, \
and ignored while that has it talk |
    | `role` | MultiDiscrete([K + n + 3] * n) | 0..K-1: centre of a patch of the target; K: the body's centre; K+1..K+n: \
spacecraft 1..n (itself: hold); K+n+1: Earth; K+n+2: hold the direction of +z in N. Tracked by the scenario's control law |

    With four wheels, or where faults have put wheels out, the torque on the body that these motor torques would exert is shared
    anew by the wheels that work, with the least sum of squares; three healthy wheels get what the action says. Wheels at their
    top speed get no more.

    At the levels `torque` and `pointing` the scenario's behaviour decides who talks to whom. With directed crosslinks
    (`link.crosslink.antenna: hemispherical`) a relay hears only those on one side of it; there who is to talk to another
    spacecraft talks to Earth itself, one after another, so that at every level what was seen can be delivered.

    K is the number of patches (16): a square grid on the target's pyramid, row by row from its south-west corner, west to east.

    ## Observation space

    Box, float32, finite; values beyond the bounds are clipped. First a block of 26 + w numbers for each spacecraft, 29 with the
    usual three wheels:

    | entries | name | meaning | divided by | bounds |
    |---|---|---|---|---|
    | 0-2 | position | r in A | imaging radius [m] (35 km) | -10, 10 |
    | 3-5 | velocity | relative to the turning body, in A | mothership's distance over time of flight (50 m/s) | -10, 10 |
    | 6-8 | sigma_BR | attitude error, MRP, as the control law saw it last (one control period ago) | 1 | -1, 1 |
    | 9-11 | boresight | unit vector +z of B, in A | 1 | -1, 1 |
    | 12-14 | x_axis | unit vector +x of B, in A | 1 | -1, 1 |
    | 15-17 | rate | omega_BN in B | 0.1 rad/s | -10, 10 |
    | 18 to 17+w | wheel_speed | of the w wheels | top speed | -1, 1 |
    | 18+w | imaging | 1 if it is an observer that looks at the body, and its camera works | 1 | 0, 1 |
    | 19+w | link | 1 if its radio link was closed at the end of the step | 1 | 0, 1 |
    | 20+w | stored | data aboard | nominal volume | 0, 10 |
    | 21+w to 25+w | role | one of: body's centre, spacecraft, Earth, surface point, held direction | 1 | 0, 1 |

    then seen share of each of the K patches (0, 1), time left over the duration (0, 1), seen share of the target (0, 1) and
    data delivered over the nominal volume (0, 10). `env.unwrapped.observation_layout.split(observation)` gives them by name.

    The agent is given what the spacecraft knows. Where the scenario flies noise or delay of the sensors (its `faults` and
    `dispersions`), boresight, x_axis and rate are those of the estimated attitude and the measured rate that the flight
    software has at the end of the step, sigma_BR is the error by its estimate, and "hold" holds where it believes +z to point.
    Positions, velocities and wheel speeds are the truth, since no errors of navigation and tachometers are modelled. Pictures,
    links, rewards, `state`, `info` and rendering follow the truth. Without noise and delay estimate and truth are the same.

    ## Reward

    The sum of `info["reward_terms"]`, each its weight (argument `reward_weights`) times its measure of the step, a pure number.
    Step h and duration T of the flight in s.

    | term | weight | measure of a step |
    |---|---|---|
    | seen | 1 | dA / A: area of the cells seen for the first time over that of the target [m^2] |
    | delivered | 1 | dD / D: data that Earth received over the nominal volume [bit] |
    | effort | -0.02 | (h / T) mean (u / u_max)^2 over wheels and control periods, u the motor torque [N m] |
    | saturation | -0.1 | (h / T) mean over wheels of min(1, max(0, (abs(W) / W_max - 0.9) / 0.1)), W the wheel speed at the \
end of the step [rad/s] |
    | approach | -0.1 | (h / T) c / (n (n - 1) / 2), c the pairs that come closer than `safety.min_separation_m` in the step, \
if it begins at or after `safety.separation_grace_s`; the motion within it is taken as straight |
    | loss | -1 | 1 at an impact on the body or divergence |

    The nominal volume D is that of the whole target seen straight down from the imaging altitude H with the pixel angle p of
    the camera: `bits_per_pixel` A / (H p)^2.

    A picture is taken every `observation.interval_s`, and at the visit, by each observer that looks at the body (centre or
    surface point); with the criterion `visit` only the visit counts. It adds data for each cell that nobody saw before: area
    over the foreshortened square of the ground sampling distance, times `bits_per_pixel`. A spacecraft that tracks another
    sends it what is aboard, one that tracks Earth sends to Earth, while the link is closed as in `swarm_mj.mission.links`:
    in range, the body not in between, and to Earth the dish within its beam. Crosslinks close whichever way the spacecraft are
    turned; with `link.crosslink.antenna: hemispherical` the sender's dish and the other's antenna must have each other within
    their beams. Earth hears one spacecraft at a time: of several, the first in gene order until it has nothing left to send.
    Whether a link is closed, and its rate, is judged at the end of the step, for all of it.

    By default rates are constant and Earth always hears, so that rewards can be compared between scenarios and versions. With
    `swarm_rate_bit_s=None` a crosslink carries what the budget of `link.crosslink` closes over the distance. With
    `earth_rate_bit_s=None` Earth hears what the budget of `link.earth` closes to the best station of `link.ground` that sees
    the body at the time (2 kbit/s in `eros-observe`, 2.7 au away); while none does, no link to Earth is closed. Every link
    has its whole rate: `access`, `duplex` and `channels` of the scenario are for `swarm-mj run`.

    A spacecraft holds `data.storage_bit` (32 Gbit, 10,000 times the nominal volume of `eros-observe`). What a picture brings
    beyond that is lost, though its cells count as seen, and a receiver takes no more than it has room for. At any time
    `seen_bit` = sum of `stored_bit` + `delivered_bit` + `lost_bit`; what is aboard a spacecraft that is no more stays in
    `stored_bit`.

    ## Info

    | key | when | meaning |
    |---|---|---|
    | time_s | always | since the epoch [s] |
    | coverage_percent | always | seen share of the target [%] |
    | delivered_bit | always | received by Earth so far [bit] |
    | stored_bit | always | aboard each spacecraft, a list of n [bit] |
    | seen_bit | always | brought by all pictures so far [bit] |
    | lost_bit | always | of that, found no room aboard [bit] |
    | flight_seed | `reset` | seed of the flight |
    | reward_terms | `step` | weighted terms by name |
    | end | an end by itself | see below |
    | cause | divergence | which spacecraft, and what is not finite |

    ## What it measures

    How good a plan for one flyby is, not feedback: with `eros-observe` only initial attitudes and rates vary, they have settled
    before the first picture, and a recorded list of actions flown again without looking scores nearly as well as the policy it
    was taken from (docs/results/learning.md). Faults, dispersions and sensor noise of a scenario make it otherwise; in
    `SwarmObserve-v1` lists of actions lose: learn there. gymnasium warns that v0 is out of date because of it; v0 stays as it
    is, for scenarios of one's own and for scores to compare with.

    ## Starting state

    The scenario's deployment: all at the mothership with solved velocities, wheels at rest, random attitudes and rates in
    the scenario's ranges. With the scenario's `faults` and `dispersions`, what goes wrong is drawn anew for every episode. All
    of it comes from a flight seed that `reset` draws from `self.np_random` (or takes from `options={"flight_seed": k}`) and
    gives in `info["flight_seed"]`: `swarm-mj run SCENARIO --set seed=k` starts the same.

    One thing is not drawn anew: the true place of the target. `dispersions.target_m` shifts it once for each environment, by
    the scenario's own `seed`, since patches, cells and horizon maps belong to the place (about 10 s of one core to work out).
    To train over many places, make one environment for each, with another scenario seed:
    `scenario=load_scenario("eros-observe", ["dispersions.target_m=300", "seed=7"])`. With `target_m` above zero
    `swarm-mj run` shifts the target by k, too, so that it starts the same only where k is the scenario's seed.

    ## Episode end

    Terminated: the target is seen to `complete` percent and all data are delivered; or a spacecraft hits the body; or all are
    lost to faults; or the flight diverges (the observation is then the last finite one). `info["end"]` says `complete`,
    `impact`, `lost` or `diverged`.
    Truncated: at the scenario's duration; with `horizon_terminates` terminated, with `info["end"]` `horizon`.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | `"eros-observe"` | packaged name, path of a YAML file, or a `Scenario` |
    | control | `"role"` | `torque`, `pointing` or `role` |
    | render_mode | None | None, `"rgb_array"`, or `"human"` for a window, drawn at every reset and step (needs pygame) |
    | step_s | None | length of a step [s]; a multiple of `control.period_s` that divides the duration; None: 10 s, at the \
level `torque` `control.period_s`, because an attitude cannot be controlled by torques held for 10 s |
    | patches | 16 | number of patches K, a square number |
    | observer | `"horizon"` | the judge of pictures: `horizon` (maps, constant time), `raycast`, `faceid`, `raster` or `auto` |
    | complete | 99.9 | seen share of the target that counts as complete [%] |
    | reward_weights | None | mapping that replaces weights by name |
    | bits_per_pixel | 1.0 | data of a picture after compression |
    | swarm_rate_bit_s | 1e5 | from a spacecraft to the one it tracks; None: by the scenario's link budget |
    | earth_rate_bit_s | 8e3 | to Earth, all together; the rate of the MarCO CubeSats at Mars; None: by the scenario's link \
budget and stations |
    | observability | full | what agents of the multi-agent environment know, `full` or `graph`; here one agent decides for \
all, and only `full` is allowed |
    | overrides | () | changes of the scenario, a list of texts `key=value` as of `swarm-mj run --set`; goes through \
`spec.to_json()`, which a `Scenario` does not |
    | horizon_terminates | False | whether the duration ends a flight as terminated, `info["end"]` being `horizon`, for tools \
that know no truncation; the observation holds the time left |
    | target | `"scenario"` | what is to be seen: the scenario's target, or the whole `"body"`, in `patches` = 6 k^2, see \
`SwarmMapEnv` |
    | width, height | 640, 480 | of rendered pictures |

    ## Version history

    v0: first version. In 0.2 of the package the flights are the same; `imaging` is 0 while a fault has the camera off,
    and a step at the level `torque` is one control period unless asked otherwise; `readings` became
    `observation_layout`, `setting` became `task`, and `flybys` became `batch`. Crosslinks are omnidirectional by default, so
    that at `torque` and `pointing` the scripted relay hears everybody; with directed ones there is no relay at these two levels
    any more, since it heard two of five. The level `role` is as before.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}
    name = "SwarmObserve-v0"

    def __init__(
        self,
        scenario: str | Path | Scenario = EnvConfig.scenario,
        control: str = EnvConfig.control,
        render_mode: str | None = None,
        *,
        width: int = 640,
        height: int = 480,
        **arguments: Any,
    ) -> None:
        self.made_of = {"scenario": scenario, "control": control, "render_mode": render_mode, **arguments}
        self.made_of |= {"width": width, "height": height}
        self._batch: EpisodeBatch | None = None
        self._window: Window | None = None
        self._size = width, height = checked_size("width", width), checked_size("height", height)
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.task = make_task(scenario=scenario, control=control, **arguments)
        refuse_graph(self.task.config.observability)
        self._batch = batch = EpisodeBatch(self.task, 1)
        self._renderer = EpisodeRenderer([(batch, 0)], width, height)
        self.plan, self.patches = self.task.plan, self.task.patches
        self.observation_layout = self.task.observation_layout
        self.observation_space, self.action_space = self.observation_layout.space, batch.level.action_space
        self._running = self._begun = False

    @property
    def reward_weights(self) -> dict[str, float]:
        """Weight of each reward term."""
        return dict(zip(TERMS, self.task.reward_scales, strict=True))

    @property
    def batch(self) -> EpisodeBatch:
        """The episode, as a batch of one.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError(f"{self.name} was closed; make it anew")
        return self._batch

    @property
    def readings(self) -> ObservationLayout:
        """The name of `observation_layout` in 0.1; gone in 0.3."""
        warnings.warn(
            "readings is now observation_layout; the old name goes with 0.3", DeprecationWarning, stacklevel=2
        )
        return self.observation_layout

    @property
    def state(self) -> SwarmState:
        """The swarm now."""
        return self.batch.swarm_state(0)

    @property
    def first_seen_s(self) -> Array:
        """When the swarm first saw each cell of the target in this episode, NaN for never, shape (n_cells,) [s]."""
        return self.batch.totals.first_seen[0].copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a flyby; see the class for the starting state.

        Raises:
            ScenarioError: `options` holds something else than a valid `flight_seed`.
        """
        super().reset(seed=seed)
        chosen = flight_seed(options, int(self.np_random.integers(2**31)))
        self.batch.reset(0, chosen)
        self._running = self._begun = True
        if self.render_mode == "human":
            self.render()
        return self.batch.observation[0].copy(), self.batch.info(0) | {"flight_seed": chosen}

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly on for one step with the action held.

        Raises:
            gymnasium.error.InvalidAction: The action does not lie in the action space.
            gymnasium.error.ResetNeeded: The episode has ended or has not begun.
        """
        if not self._running:
            raise gymnasium.error.ResetNeeded(f"{self.name}: the episode is over or has not begun; call reset first")
        batch = self.batch
        result = batch.step(check_action(self.action_space, action)[None])
        terminated, truncated = bool(result.end[0]), bool(result.truncated[0])
        self._running = not (terminated or truncated)
        if self.render_mode == "human":
            self.render()
        observation, info = batch.observation[0].copy(), batch.step_info(0, result)
        return observation, float(result.reward[0]), terminated, truncated, info

    def get_state(self) -> FlightState:
        """Where the flight stands, to go back to by `set_state`, here or in any other environment made with the same arguments.

        It can be pickled. The random numbers of the resets to come are part of it. One takes some 18 KiB with `eros-observe`.

        Raises:
            gymnasium.error.ResetNeeded: There is no flight before the first `reset`.
            SimulationError: The scenario flies thrusters, whose state cannot be taken.
        """
        must_have_begun(self._begun, "get_state")
        return take_state(self.batch, 0, running=self._running, random=self.np_random)

    def set_state(self, state: FlightState) -> tuple[Observation, dict[str, Any]]:
        """Go on from a state: the same actions give the same observations, rewards and infos as there, bit for bit.

        Returns:
            Observation and info of that instant.

        Raises:
            ScenarioError: It is no such state, or was taken from an environment with other arguments.
        """
        self._running = restore_state(self.batch, 0, self.np_random, state).running
        self._begun = True
        return self.batch.observation[0].copy(), self.batch.info(0)

    def _standing(self) -> dict[str, Any]:
        names = ("spec", "action_space", "observation_space", "_np_random", "_np_random_seed")
        kept = {name: getattr(self, name) for name in names}
        return {"kept": kept, "flight": self.get_state() if self._begun and self.batch else None}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        if standing["flight"] is not None:
            self.set_state(standing["flight"])

    def render(self) -> Pixels | None:
        """The overview as a picture, shape (height, width, 3), with `render_mode="rgb_array"`; `"human"` shows it in a window.

        Raises:
            ObserverError: OpenGL cannot be loaded, or there is no display for the window.
            gymnasium.error.ResetNeeded: There is nothing to draw before the first `reset`.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        if not self._begun:
            raise gymnasium.error.ResetNeeded(f"{self.name}: call reset before render")
        _ = self.batch
        picture = self._renderer.draw()
        if self.render_mode == "rgb_array":
            return picture
        if self._window is None:
            self._window = Window(*self._size, self.metadata["render_fps"])
        self._window.show(picture)
        return None

    def close(self) -> None:
        """Release the observer and the OpenGL context; may be called again."""
        if self._batch is not None:
            self._renderer.close()
            self.task.close()
        if self._window is not None:
            self._window.close()
        self._batch, self._window, self._running = None, None, False
