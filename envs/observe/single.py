"""SwarmObserve-v0: flybys that differ from episode to episode, as a gymnasium environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Pixels

from ..arguments import checked_render_mode, checked_size, record_of
from ..batch_env import BatchEnv, must_have_begun
from .catalogue import DEFAULT_COUNT
from .config import EnvConfig
from .episodes import Episodes
from .rendering import EpisodeRenderer, PygameWindow
from .rewards import ENDS, TERMS

NAME = "SwarmObserve-v0"


def config_of_one_agent(arguments: dict[str, Any]) -> EnvConfig:
    """The arguments of an environment in which one agent decides for all, and knows all.

    Raises:
        ScenarioError: An argument is unknown or not allowed, or there would be something that the agent does not know.
    """
    config = record_of(EnvConfig, NAME, arguments)
    if config.knowledge != "full":
        raise ScenarioError(
            f"knowledge = {config.knowledge!r}: must be full where one agent decides for all; "
            "SwarmObserveParallelEnv has an agent for each spacecraft"
        )
    return config


class SwarmObserveEnv(BatchEnv):
    """A swarm of CubeSats flies past a small body that differs from episode to episode, images it and sends it to Earth.

    `gymnasium.make("swarm_mj.envs:SwarmObserve-v0")` makes it; where gymnasium is imported before swarm_mj,
    `"swarm_mj:SwarmObserve-v0"` does too.

    Only attitudes are controlled: the trajectories follow from the release. Body, place, light, paths, number and health of the
    spacecraft are drawn anew, and a recorded list of actions loses (`baselines.open_loop`): what pays is to look.

    ## Missions

    `catalogue.CATALOGUE` names 64: sixteen places on each of Eros, Bennu, Itokawa and an ellipsoid the size of 21 Lutetia.
    Places within 40 deg of longitude 0 are for training, those within 20 deg of 180 deg for tests; no part of a body
    belongs to both. Lengths go with the imaging altitude H, times are the same for all: released 3 1/3 H ahead, over the
    target 200 s later at H / 60 s, 600 s in all. Cameras see about a patch at a time. A picture is taken every 10 s; cells
    count by the project's default criterion (half of it in view; Sun at most 85 deg and camera at most 80 deg from its
    normal, not in the body's shadow; four pixels) where the ground sampling distance is at most 1.25 times that straight
    down from H. Spacecraft fly with reaction wheels as momentum states, by the kernel stepper, and turn by the sliding-mode
    law. A mission takes half a second to work out once, and is kept in the cache; on a new machine the first episode also
    waits while kernels are compiled, half a minute or so, once.

    ## A flyby of one's own

    `scenario="eros-observe"`, a path, a dict or a `Scenario` pins the environment to one flyby: paths, criterion, H, light,
    link budget, sensors, faults and dispersions are its own, times go with the time in which its swarm flies as far as H.
    The Sun is where it is, and counts unless `observation.light` is ignored. An episode starts as
    `swarm-mj fly SCENARIO --set seed=FLIGHT_SEED` does; of what is drawn there are `spacecraft`, `release_error`,
    `attitude_mrp`, `rate_rad_s` and the failures, as planned unless `randomise` or `draw` says otherwise. It flies by the
    kernel stepper, whatever the scenario's `physics` says, and what that cannot fly is refused by name. A scenario says
    itself how many spacecraft fly; a dedicated communications spacecraft comes last, and takes no pictures.

    `target="body"` makes the whole body the target, as for a map of it in hours: `scenario="bennu-map"`, `patches=150`,
    `decision_s=120`. Patches divide the sphere of directions from the body's centre: the six faces of a cube about the axes of
    A in the order +x, -x, +y, -y, +z, -z, each into k x k equal angles, K = 6 k^2; within a face rows go by the later of the
    two other axes and columns by the earlier one, from their negative ends. Tables are then told in A, from the body's centre.

    ## What is drawn

    By `randomise={name: distribution}`, as in campaigns, or a number that always holds.
    `reset(options={"draw": {name: value}})` gives values for one episode: a number, or one for each spacecraft. Changing
    one leaves all others as they were. Whether something fails is 0 or 1; a chance is a distribution,
    `{"loss": {"distribution": "bernoulli", "probability": 0.3}}`. What lies beyond what is allowed is refused; of
    distributions without ends the tails are cut there.

    | name | default | allowed | meaning |
    |---|---|---|---|
    | mission | any of the pool | those of the pool | its number in `batch.pool.names`, or its name |
    | spacecraft | any from 1 to `max_spacecraft` | these | how many fly; the others are lost from the start |
    | speed | 0.55 to 1.8, log-uniform | 0.5 to 2 | over that of the mission: when the target is passed |
    | sun_elevation_deg, sun_azimuth_deg | 5 to 50, any | 0 to 90, -360 to 360 | of the Sun over the target, from north over \
east, for the whole flight; dark and shadowed cells do not count |
    | visiting_point | 0 to 1 | 0 to 1 | which of the points that the trajectory designer offers, for each spacecraft |
    | altitude | 0.75 to 1.15 | 0.75 to 1.25 | of the arrival, over H, for each |
    | release_error | normal, 0.06 | -1 to 1 | of the velocity, over H / 200 s: of the place 200 s later, over H; three \
numbers for each |
    | attitude_mrp, rate_rad_s | -1 to 1, -0.02 to 0.02 | -1 to 1, -0.2 to 0.2 | at release, three numbers for each |
    | loss, camera_off, downlink_off | chances 0.12, 0.15, 0.15 | 0 or 1 | whether a spacecraft is lost, its camera or Earth \
link off |
    | loss_time, camera_off_time, downlink_off_time | 0.2 to 0.8, 0.2 to 0.6, 0 to 0.8 | 0 to 1 | when, as a share of the \
flight; it happens when the next picture is due, before it is taken |

    Flight seeds from 2^31 on are kept for tests: environments draw lower ones and refuse these; `swarm-mj score` flies them.

    ## Action space

    MultiDiscrete([K + 1 + n] * n) with n the most spacecraft of an episode and K = `patches`, held for `decision_s` seconds. Of
    spacecraft j: 0..K-1 look at a patch; K talk to Earth; K+1..K+n relay to spacecraft 1..n (itself: hold the attitude).
    Patches are numbered row by row from the south-west. 20 s are enough to turn from a patch to the next and take a
    picture, and short against the one or two minutes over the target; between target and Earth it takes three or four
    decisions. Pictures are due 10 and 20 s after a decision, the second as the next one begins: who no longer looks then
    takes none. `info["action_mask"]`, shape (n, K + 1 + n), says what makes sense: unseen patches in reach at one of
    ten instants, from half a decision to nine and a half ahead (who waits for the near picture may point there already),
    Earth and relays for whom has data and is heard; to hold is always allowed, and all that who is no more may do. Other
    choices are flown as they are.

    With `candidates=R` each spacecraft chooses among the R patches that are worth most to it, the best first (0..R-1), and to
    send what is aboard to Earth or to the first who hears Earth (R); MultiDiscrete([R + 1] * n). Plain networks learn that
    sooner, as a number stands for how good a patch is and not for where it lies. It also means that a list of such choices
    does look: always 0 is a rule.

    ## Observation space

    `entities`, the default: a Dict of `spacecraft` (n, 24), `patches` (K, 9), `pairs` (n, K, 9), `general` (14), `alive` (n)
    and `action_mask`. `flat`: a Box of spacecraft, pairs, the first two columns of patches, and general; `batch.layout.split`
    takes it apart. `pixels`: a Dict of `state`, as `flat`, and `image`, uint8, (n, 3, 64, 64), what each camera sees as the
    step ends, +x of the spacecraft to the right and +y down; poses are the true ones, whatever sensors are flown:

    | channel | meaning |
    |---|---|
    | 0 | grey: light by the body's law (`body.photometry`; Lambert's where it has none), with the shadows that it casts on \
itself, exposed so that the brightest pixel of a picture is 255; `body.face_albedo` is left out |
    | 1 | mask: 255 where the cell of the target has been seen by anybody |
    | 2 | nearness: 255 times the body's largest radius over depth along +z, at most 255; 0 in the sky |

    The mesh is that of the target's cells, unsimplified. Of the tables:

    Frame: east, north, up at the target's middle, turning with the body. Units: H, 60 s, the target's area,
    the yardsticks A and D, see Reward. Columns are named in `tables.SPACECRAFT`, `PATCHES`, `PAIRS` and `GENERAL`:

    | table | columns |
    |---|---|
    | spacecraft | alive, camera and downlink work; images, relays, talks to Earth, holds; link closed; data aboard; Earth in \
sight; place, velocity and boresight (3 each); attitude error; rate over 0.1 rad/s; fastest wheel over its top speed; \
whether any patch is in reach half a decision ahead, and a whole one later. All zero for who is no more |
    | patches | unseen and lit share; place and normal (3 each); area over the mean |
    | pairs | what a picture would be worth half a decision ahead, and a whole one later; ground sampling distance over the \
limit; angle from the boresight over 90 deg; worth over that of its best patch; most that it is worth to another; largest \
of the shares (worth over that of the best patch) that spacecraft of lower number have there; largest worth from now to nine \
decisions later, and the decisions until then over ten |
    | general | time left; seen; delivered; share alive; half-width over H; picture over the target's half-width; turn of the \
body in 60 s; share of the data that Earth hears in a decision; directions of Sun and Earth (3 each) |

    With `candidates=R` there are `candidates` (n, R, 7), see `layout.CANDIDATE`, in the place of pairs and patches, and of the
    columns of spacecraft and general `layout.OF_SPACECRAFT` and `OF_GENERAL`: no places and directions.

    How a spacecraft knows them, and whoever hears it over the crosslinks, on which light takes milliseconds:

    | columns | from |
    |---|---|
    | camera, downlink, images, relays, talks, holds, stored, attitude error, boresight, rate, wheel speed | its own sensors, \
memory and telemetry, with the errors of `dispersions` |
    | place, velocity | its navigation, which is taken as perfect |
    | link closed, delivered | its attitude, maps and ephemerides: what it sends meanwhile counts as heard, as no answer from \
Earth comes in time |
    | unseen, seen | its pictures, matched with the map of the body |
    | alive | who is silent where it should be heard is taken for lost |
    | Earth in sight, lit, all of pairs, turn, picture, heard, half-width, Sun, Earth, time left | clock, ephemerides, maps of \
the body and of its horizons, link budget |

    In missions of the catalogue all hear one another at all times, so that one agent for all is told what each spacecraft
    knows, bit for bit. In those of one's own that need not be so: `SwarmObserveParallelEnv` shows each what has reached it, and
    the tables here are then more than any of them knows. Nothing depends on what will fail later. Told to programs and not for
    agents: `flight_seed`, and with it the future.

    There is no battery: no flight of ten minutes models power; `SwarmDownlink-v0` has batteries, panels and eclipses.

    ## Reward

    The sum of `info["reward_terms"]`, each its weight (argument `reward_weights`) times its measure of the step, a pure number:

    | term | weight | measure of a step |
    |---|---|---|
    | seen | 1 | dA / A: area of the cells seen for the first time over the yardstick A |
    | delivered | 1 | dD / D: bits that Earth received over the yardstick D; in `sm.fly` delivered is area |

    A are the lit cells that some spacecraft passes within reach on a straight path from its release, if nothing fails (at
    least a fifth of the target), and D their data straight down from H. Failures are left out of them: otherwise what a
    step brings would tell, by what it is divided by, who will fail. An episode in which much fails brings less, as a
    mission does. To see all of A brings 1, and gravity may lead past a little more; to deliver it brings 1 where every cell
    was pictured straight down from H: pictures from below H hold more, those from afar or aslant less. The leaderboard
    (docs/results/leaderboard.md) has a bound for each test episode, which knows what fails and ignores turning and the
    footprint.

    A picture adds data for each cell that nobody saw before: area over the foreshortened square of the ground sampling
    distance, times the bits of a pixel. A spacecraft that tracks another sends it what is aboard, one that tracks Earth sends
    to Earth, while the link is closed as in `swarm_mj.mission.links`. Links are judged whenever pictures are due and at the
    ends of decisions: in between one carries the mean of both instants, so that what is sent does not depend on the length of a
    decision. Earth hears one spacecraft at a time: in flybys of the catalogue at 8 kbit/s, so that a whole target takes four
    minutes where it is flat, eleven in the roughest place, and between spacecraft 100 kbit/s; in those of one's own by the link
    budget of `link.crosslink`, `link.earth` and `link.ground`. A spacecraft holds `data.storage_bit`; what a picture brings
    beyond that is lost, though its cells count as seen. At any time `seen_bit` = sum of `stored_bit` + `delivered_bit` +
    `lost_bit`.

    A spacecraft that hits the body is lost, and the others fly on.

    ## Info

    | key | when | meaning |
    |---|---|---|
    | time_s | always | since the epoch [s] |
    | coverage_percent | always | seen area over the yardstick A [%] |
    | delivered_bit | always | received by Earth so far [bit] |
    | stored_bit | always | aboard each spacecraft, a list of n [bit] |
    | seen_bit | always | brought by all pictures so far [bit] |
    | lost_bit | always | of that, found no room aboard [bit] |
    | alive | always | who still flies, a list of n |
    | mission | always | its number |
    | action_mask | always | choices that make sense, shape (n, C) |
    | flight_seed | `reset` | seed of the flight |
    | reward_terms | `step` | weighted terms by name |
    | end | an end by itself | see below |
    | cause | divergence | which spacecraft, and what is not finite |

    ## Episode end

    Terminated: all that is lit is seen, out of reach or not, and delivered; or nobody is left; or the flight diverges.
    `info["end"]` says `complete`, `lost` or `diverged`. Truncated: at the duration; with `horizon_terminates` terminated, with
    `info["end"]` `horizon`.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | missions | 8 | names, how many spread over places and bodies, or "all" |
    | split | "train" | or "test" |
    | scenario | None | a flyby of one's own in the place of those of the catalogue, see above |
    | target | "scenario" | what is to be seen of that: its target, or the whole "body" |
    | max_spacecraft | None | n, at most 12; 3 where nothing else is said |
    | patches | 16 | K, a square number; up to 49 fit every mission; from 64 on some are refused, where a patch would hold no \
cell |
    | candidates | None | R, at most K, or None for all patches |
    | decision_s | 20 | length of a step [s]: whole control periods (1 s) that divide the duration (600 s) |
    | observation | "entities" | or "flat" or "pixels" |
    | camera_half_angle_deg | None | of the cameras of `pixels`; None for the mission's |
    | light | "sun" | of `pixels`, or `"headlight"`, from the camera |
    | knowledge | "full" | here one agent decides for all and only "full" is allowed; agents of the multi-agent environment \
know what has reached them ("graph"), or, as a privilege, "full" |
    | observer | "horizon" | the judge of pictures: `horizon` (maps, constant time); with `scenario=` also `raycast`, \
`faceid`, `raster` or `auto` |
    | randomise | None | distributions by name |
    | dispersions | None | masses, wheels and gravity that differ from flight to flight, keys of a scenario's \
`dispersions` such as `mass_percent`, `wheel_coulomb_n_m`; a scenario has its own |
    | sensors | "ideal" | of attitude, as `spacecraft.sensors` of a scenario, which has its own: scores are those of ideal \
ones, `"cubesat"` flies noise and a filter |
    | reward_weights | None | replaces weights by name |
    | complete | 99.9 | share of the target, seen or dark, that counts as complete [%] |
    | horizon_terminates | False | whether the duration ends a flight as terminated |
    | render_mode | None | None, `"rgb_array"`, or `"human"` for a window, drawn at every reset and step (needs pygame) |
    | width, height | 640, 480 | of rendered pictures |
    """

    name, terms, ends, own_options = NAME, TERMS, ENDS, ("draw",)
    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}

    def __init__(
        self,
        missions: Any = DEFAULT_COUNT,
        split: str = "train",
        render_mode: str | None = None,
        *,
        width: int = 640,
        height: int = 480,
        **arguments: Any,
    ) -> None:
        self._window: PygameWindow | None = None
        self._size = checked_size("width", width), checked_size("height", height)
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.config = config_of_one_agent({"missions": missions, "split": split, **arguments})
        episodes = Episodes(self.config, 1)
        self._renderer = EpisodeRenderer(episodes, 1, *self._size)
        self._set_up(episodes, episodes.action_space)

    @property
    def reward_weights(self) -> dict[str, float]:
        """Weight of each reward term."""
        return dict(zip(TERMS, self.config.weights, strict=True))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; see the class for what is drawn.

        Raises:
            ScenarioError: `options` holds something else than a valid `flight_seed` and a valid `draw`.
        """
        begun = super().reset(seed=seed, options=options)
        self._show()
        return begun

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly on for one step with the choices held, see `BatchEnv.step`."""
        flown = super().step(action)
        self._show()
        return flown

    def _info(self) -> dict[str, Any]:
        return self.batch.info(0)

    def action_masks(self) -> NDArray[np.int8]:
        """`info["action_mask"]`, as MaskablePPO of sb3-contrib asks for it, shape (n, C)."""
        must_have_begun(self._begun, "action_masks", NAME)
        return self.batch.action_mask[0].copy()

    def render(self) -> Pixels | None:
        """The overview as a picture, shape (height, width, 3), with `render_mode="rgb_array"`; `"human"` shows it in a window.

        Raises:
            ObserverError: OpenGL cannot be loaded, or there is no display for the window.
            gymnasium.error.ResetNeeded: There is nothing to draw before the first `reset`.
        """
        _ = self.batch
        pictures = self._renderer.render(self.render_mode, self._begun, NAME)
        if pictures is None or self.render_mode == "rgb_array":
            return None if pictures is None else pictures[0]
        if self._window is None:
            self._window = PygameWindow(*self._size, self.metadata["render_fps"], NAME)
        self._window.show(pictures[0])
        return None

    def _show(self) -> None:
        """Where there is a window."""
        if self.render_mode == "human":
            self.render()

    def close(self) -> None:
        """Release observers, OpenGL context and window; may be called again."""
        super().close()
        if self._window is not None:
            self._window.close()
        self._window = None
