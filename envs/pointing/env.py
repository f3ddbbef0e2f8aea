"""SwarmPointing-v0: the attitude of one spacecraft of a swarm by motor torques; gymnasium's single and vector environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from swarm_mj.typing import Pixels

from ..arguments import checked_count, checked_render_mode, nothing_to_draw
from ..batch_env import BatchEnv, BatchVectorEnv, must_have_begun, vector_arguments
from .batch import PointingBatch, crossed
from .steps import PointingWeights
from .task import make_pointing_task

NAME = "SwarmPointing-v0"
#: Motor torques of one spacecraft over their limit.
ACTION_SPACE = spaces.Box(-1.0, 1.0, (3,), np.float32)


class SwarmPointingEnv(BatchEnv):
    """One spacecraft of a swarm turns to what it is told to look at, and holds it, by the torques of its wheels' motors.

    `gymnasium.make("swarm_mj.envs:SwarmPointing-v0")` makes it; `gymnasium.make_vec(...)` makes many, each a spacecraft in an
    episode of its own; `swarm_mj.envs.pointing.parallel` has a whole swarm, an agent for each spacecraft. All fly the same
    numbers, bit for bit.

    An episode is a piece of a scenario's flyby: the spacecraft is where it would be then, falls as it would, and sees the
    body turn below it. It is given `holds` references one after the other, each for `hold_s` seconds: first it has to turn to
    it from wherever it looks, then to hold it while the line of sight moves. What is flown is the free gyrostat of
    `physics.stepper: kernel`, in compiled code.

    Frames: N inertial, A fixed in the body, B the spacecraft, camera and dish along its +z. The reference frame R has its +z
    on the line of sight, reached by the shortest turn (docs/theory/attitude_control.md); its rate is that of the line.

    ## Action space

    Box(-1, 1, (3,), float32): torques of the motors on the three wheels over their limit (4 mN m by default), held for one
    step of `step_s` seconds. The body feels the opposite. Wheels at their top speed get no more.

    A torque of 1 for one step of 0.5 s changes the body rate by 1.4 deg/s about x and y and by 8.6 deg/s about z, the long
    axis: with steps of 10 s torques could not control an attitude.

    ## Observation space

    With `observation="state"` Box, float32, (20,); values beyond the bounds are clipped:

    | entries | name | meaning | divided by | bounds |
    |---|---|---|---|---|
    | 0-2 | sigma_BR | attitude error, MRP | 1 | -1, 1 |
    | 3-5 | fine_sigma_BR | the same, of small errors | 0.05 (11 deg) | -1, 1 |
    | 6-8 | omega_BR | rate error in B | 0.1 rad/s | -10, 10 |
    | 9-11 | fine_omega_BR | the same, of small errors | 0.01 rad/s | -1, 1 |
    | 12-14 | wheel_speed | relative to the hub | top speed | -1, 1 |
    | 15-17 | omega_RN | rate of the reference, in B | 0.01 rad/s | -10, 10 |
    | 18 | hold_left | time until the next reference | `hold_s` | 0, 1 |
    | 19 | time_left | time until the end | duration | 0, 1 |

    The errors are those with the reference that holds for the step that begins. `env.unwrapped.task.layout.split(observation)`
    gives the parts by name.

    With `observation="camera"` a Dict: `image`, uint8, (3, 64, 64), what a square camera of `camera_half_angle_deg` along +z
    sees, +x to the right and +y down; and `state`, Box, float32, (11,), which does not tell the reference:

    | channel | meaning |
    |---|---|
    | 0 | grey: 255 times the cosine of the light's angle of incidence; the body casts no shadow on itself |
    | 1 | mask: 255 where the body is, whether lit or not |
    | 2 | nearness: 255 times the body's largest radius over depth along +z, at most 255; 0 in the sky |

    | entries | name | meaning | divided by | bounds |
    |---|---|---|---|---|
    | 0-2 | omega_BN | body rate in B | 0.1 rad/s | -10, 10 |
    | 3-5 | fine_omega_BN | the same, of small rates | 0.01 rad/s | -1, 1 |
    | 6-8 | wheel_speed | as above | top speed | -1, 1 |
    | 9 | hold_left | as above | `hold_s` | 0, 1 |
    | 10 | time_left | as above | duration | 0, 1 |

    ## Reward

    The sum of the weighted terms; with theta the angle between +z and the line of sight at the end of the step, theta_0 the
    tolerance, h the step and T the length of the episode:

    | term | weight | measure of a step |
    |---|---|---|
    | precise | 80 | (h / T) / (1 + theta / theta_0) |
    | coarse | -40 | (h / T) theta / pi |
    | rate | -10 | (h / T) min(1, abs(omega_BR) / 0.1 rad/s) |
    | effort | -5 | (h / T) mean (u / u_max)^2 over wheels and control periods, u the motor torque |

    Perfect pointing from beginning to end would be worth 80. The angle about +z is free; the rate about it is not.

    ## Success

    A reference is held when theta has stayed within `tolerance_deg` for `steady_s` seconds without a break. An episode
    succeeds when each of its references has been held.

    ## Info

    | key | when | meaning |
    |---|---|---|
    | time_s | always | since the scenario's epoch [s] |
    | spacecraft | always | which of the swarm, from 1 |
    | error_deg | always | theta [deg] at the end of the step, of the reference that held in it |
    | on_target | always | share of the steps so far that ended within the tolerance |
    | held | always | references held so far |
    | success | always | whether all have been held |
    | flight_seed | `reset` | seed of the episode |
    | reward_terms | `step` | weighted terms by name |

    ## Starting state

    Drawn from a flight seed, which `reset` draws from `self.np_random` (or takes from `options={"flight_seed": k}`) and gives
    in `info["flight_seed"]`:

    | what | how |
    |---|---|
    | instant of the flyby | every 10 s, as long as the episode fits into the scenario's duration |
    | spacecraft | any of the swarm; `options={"spacecraft": j}` chooses one, from 1 |
    | attitude | +z evenly over the directions within `start_deg` of the body's centre, any angle about it |
    | body rate | each component within +-`rate_deg_s` |
    | wheel speeds | each within +-`wheel_share` of the top speed |
    | references | each any of `references`: `body`, its centre; `surface`, a cell of the scenario's target; `earth`; \
`direction`, one of N |

    The instant follows from the seed alone: flights of one seed with different spacecraft are one swarm. Masses and inertia
    are the scenario's, the same in all episodes of an environment; to train over several, make one environment for each, with
    `overrides={"spacecraft.mass_kg": 9}`.

    ## Episode end

    Truncated after `holds` times `hold_s`. Nothing terminates it.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | `"eros-observe"` | packaged name, path of a YAML file, a dict, or a `Scenario`; faults, dispersions, \
quick slews, thrusters and four wheels are refused; sensors are ideal, whatever it says |
    | observation | `"state"` | `state` or `camera` |
    | render_mode | None | None or `"rgb_array"`: what the camera sees, with a cross on +z |
    | references | None | names of what may have to be looked at; None: all four, with `camera` the body alone |
    | holds | 2 | references in an episode |
    | hold_s | 60 | time for each [s] |
    | step_s | 0.5 | length of a step [s], a multiple of `control.period_s` |
    | tolerance_deg | None | theta_0, above 0; None: 2, with `camera` 5, three pixels |
    | steady_s | 10 | for how long a reference must be held [s]; beyond `hold_s` none can be |
    | start_deg | None | largest angle between +z and the body's centre at the start; None: 180, with `camera` 40 |
    | rate_deg_s | 2 | largest component of the body rate at the start |
    | wheel_share | 0.2 | largest wheel speed at the start, over the top speed |
    | reward_weights | None | mapping that replaces weights by name |
    | camera_half_angle_deg | 45 | of the camera |
    | light | `"sun"` | `sun`, where it is, or `headlight`, at the camera |
    | overrides | {} | changes of the scenario by dotted key, as `sm.fly` takes them |

    ## Version history

    v0: first version.
    """

    name, terms, own_options = NAME, PointingWeights._fields, ("spacecraft",)
    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self._set_up(PointingBatch(make_pointing_task(**arguments), 1), ACTION_SPACE)

    def render(self) -> Pixels | None:
        """What the camera sees, with a cross on +z, shape (384, 384, 3), with `render_mode="rgb_array"`."""
        if nothing_to_draw(self.render_mode):
            return None
        must_have_begun(self._begun, "render", NAME)
        return crossed(self.batch, 0)


class SwarmPointingVectorEnv(BatchVectorEnv):
    """`num_envs` spacecraft; made by `gymnasium.make_vec("swarm_mj.envs:SwarmPointing-v0", ...)`.

    Spaces and rewards are those of `SwarmPointingEnv`, which documents them, and so are the numbers: with the same seeds
    every episode is bit for bit that of the single environment. `reset` takes
    the options `flight_seed` and `spacecraft`, for all or one for each: a swarm is n episodes of one seed,

        envs.reset(options={"flight_seed": 7, "spacecraft": [1, 2, 3, 4, 5]})

    Infos hold arrays over the episodes, with the mask of those to whom they apply under the same name with a leading
    underscore: those that `SwarmPointingEnv` names.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: See `SwarmObserveVectorEnv`.
        render_mode: None or `"rgb_array"`.
        render_flights: How many cameras `render` shows, the first ones.
        arguments: The others of `SwarmPointingEnv`.
    """

    name, terms, own_options = NAME, PointingWeights._fields, ("spacecraft",)

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        render_flights: int = 4,
        **arguments: Any,
    ) -> None:
        count, mode = vector_arguments(num_envs, autoreset_mode)
        self._shown = min(count, checked_count("render_flights", render_flights))
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        self._set_up(PointingBatch(make_pointing_task(**arguments), count), mode, ACTION_SPACE, render_fps=10)

    def render(self) -> tuple[Pixels, ...] | None:
        """What the first `render_flights` cameras see, see `SwarmPointingEnv.render`."""
        if nothing_to_draw(self.render_mode):
            return None
        must_have_begun(bool(self._begun[: self._shown].all()), "render", NAME)
        return tuple(crossed(self.batch, e) for e in range(self._shown))
