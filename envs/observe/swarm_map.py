"""SwarmMap-v0: a map of the whole body, picture by picture, as a gymnasium environment."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario

from .single import SwarmObserveEnv
from .vector import SwarmObserveVectorEnv

#: What makes `bennu-slow` a stay of four hours, most of a turn of the body: the swarm is let go 4 km away at 0.5 m/s. The
#: epoch is such that the Sun stands over the visit; all three observe, through narrower cameras; pictures count in daylight.
LONG_STAY = (
    "epoch=2018-12-03T12:45:00",
    "duration_s=14400",
    "design.time_of_flight_s=7200",
    "mothership.position_A_m=[0,0,-4000]",
    "behavior.name=adaptable_roles",
    "behavior.imaging_radius_m=6000",
    "camera.half_angle_deg=1",
    "camera.resolution_px=1024",
    "observation.max_gsd_m=0.15",
    "observation.max_incidence_deg=80",
    "observation.interval_s=60",
    "target.cell_size_m=40",
    "physics.wheels=gyrostat",
    "physics.stepper=kernel",
    "physics.timestep_s=0.5",
    "control.period_s=0.5",
)
#: Arguments of `SwarmObserveEnv` that are others here.
DEFAULTS: dict[str, Any] = {"target": "body", "patches": 150, "step_s": 120.0, "reward_weights": {"delivered": 0.0}}


class SwarmMapEnv(SwarmObserveEnv):
    """Three CubeSats pass Bennu within four hours, most of a turn of it, and map all of it in daylight, picture by picture.

    `gymnasium.make("swarm_mj.envs:SwarmMap-v0")` makes it. It is `SwarmObserve-v0` with the whole body as the target and other
    defaults; everything that is not said here, every space, table, info and argument, is documented there.

    ## Action space

    MultiDiscrete([K + n + 3] * n): where each looks for the next two minutes. Entries 0 to K - 1 are patches, K the body's
    centre, then spacecraft 1 to n, Earth, and hold. Patches divide the sphere of directions from the body's centre: the six
    faces of a cube about the axes of A in the order +x, -x, +y, -y, +z, -z, each into k x k equal angles, K = 6 k^2; within a
    face rows go by the later of the two other axes and columns by the earlier one, from their negative ends. A choice looks
    at the mean of the patch's surface. A picture is narrower than a patch when near, and shows several from afar, where its
    resolution may not count.

    ## Observation space

    As of `SwarmObserve-v0`, with K = 150 seen shares.

    ## Reward

    | term | weight | measure of a step |
    |---|---|---|
    | seen | 1 | area seen for the first time over the body's |
    | delivered | 0 | data that Earth received over the nominal volume; give `reward_weights={"delivered": 1.0}` to play both |
    | effort, saturation, approach, loss | as there | |

    A cell counts in a picture that shows half of it, with a ground sampling distance of at most 0.15 m, obliquity included
    (that is from 4.4 km straight down), under a Sun at most 80 deg from its normal, and with nothing of the body in between.
    Shadows that the body casts on itself are left out; `observation.shadows=true` asks for them, and is slower. Pictures are
    taken every minute. Light is judged once for each instant of all flights, the rest by the compiled horizon maps.

    ## Starting state

    The paths are those of the scenario's own target and visiting points; attitudes and rates at release are drawn. With the
    scenario's `faults` and `dispersions` more is drawn.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | None | `bennu-slow` with `swarm_mj.envs.observe.swarm_map.LONG_STAY`; others are mapped the same way |
    | control | `"role"` | or `torque`; `pointing` has no whole body |
    | patches | 150 | K = 6 k^2 |
    | step_s | 120 | length of a step [s] |
    | reward_weights | `{"delivered": 0.0}` | replaces weights by name |
    | target | `"body"` | with `"scenario"` it is `SwarmObserve-v0` |

    ## Baselines, and what it measures

    Seen share of the body, mean over seeds 1 to 5, `swarm_mj.envs.policies.map_baselines`: body's centre 16 %, sweep 43 %,
    random 56 %, greedy 59 %; a camera that sees the whole disc at the same resolution 68 %, which no policy can exceed. Only
    attitudes vary, so that a recorded list is as good (58 to 60 %): it measures plans, as `SwarmObserve-v0` does.

    ## Version history

    v0: first version.
    """

    name = "SwarmMap-v0"

    def __init__(
        self,
        scenario: str | Path | Scenario | None = None,
        control: str = "role",
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        super().__init__(mapped(scenario), control, render_mode, **DEFAULTS | arguments)


class SwarmMapVectorEnv(SwarmObserveVectorEnv):
    """`num_envs` flights of `SwarmMapEnv` at once; arguments as of `SwarmObserveVectorEnv`, with the defaults of that."""

    name = "SwarmMap-v0"

    def __init__(self, num_envs: int = 1, *, scenario: str | Path | Scenario | None = None, **arguments: Any) -> None:
        super().__init__(num_envs, scenario=mapped(scenario), **DEFAULTS | arguments)


def mapped(scenario: str | Path | Scenario | None) -> str | Path | Scenario:
    """The scenario given, or the long stay at Bennu."""
    return _long_stay() if scenario is None else scenario


@cache
def _long_stay() -> Scenario:
    return load_scenario("bennu-slow", LONG_STAY)
