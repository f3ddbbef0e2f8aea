"""SwarmDownlink-v0: after an encounter, who talks when; gymnasium's single and vector environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from ..arguments import checked_render_mode, record_of
from ..batch_env import BatchEnv, BatchVectorEnv, vector_arguments
from .batch import DOWNLINK_ENDS, DownlinkBatch
from .config import DownlinkConfig, DownlinkWeights
from .world import DownlinkTask

#: As gymnasium knows it.
NAME = "SwarmDownlink-v0"


class SwarmDownlinkEnv(BatchEnv):
    """After (and while) n spacecraft fly past a small body, decide every ten minutes who talks to whom, for a day.

    `gymnasium.make("swarm_mj.envs:SwarmDownlink-v0")` makes it. Data products are asked for, are aboard one spacecraft, have a
    size, a value and a time at which they expire; each counts when all of it is on Earth. Earth hears one spacecraft at a
    time, only while a pass of an antenna is allotted to the swarm and its station sees the body, at the rate that the link
    budget of `swarm_mj.dataflow` closes; crosslinks carry what that says over the distance. Talking to Earth turns the panels
    off the Sun and takes more than they bring. Radios and panels fail and new products are asked for without notice, so that
    a list of actions made beforehand loses to looking.

    ## Action space

    MultiDiscrete([n + 2] * n), one choice for each spacecraft, held for one slot of `step_s`.

    | choice | name | what the spacecraft does |
    |---|---|---|
    | 0 | idle | turns its panels to the Sun and charges |
    | 1 | Earth | turns its dish to Earth and sends |
    | 2 to n + 1 | spacecraft 1 to n | sends to that spacecraft, panels to the Sun: crosslinks are omnidirectional |

    `info["action_mask"]`, shape (n, n + 2), has 1 where a choice has an effect now; the others are taken as idle. Sending
    needs data aboard, a working radio, a link that carries something in this slot, and a receiver with room; to Earth charge
    and income for the turn and what is always on, too.

    ## What happens in a slot

    Whoever sends, sends the products aboard in the order of their value by bit. Of several that chose Earth, it hears the
    first in gene order until that has nothing left, then the next (`link.ground.channels` says how many at once). Crosslinks
    share time as `link.crosslink.access` says. What a spacecraft receives it can send on from the next slot on, and takes no
    more than it has room for. A turn to Earth takes `slew_s` of the slot, and `slew_J` both ways. A transmitter takes power
    only while it sends.

    Panels bring `panel_1au_W` over the square of the Sun's distance in au; nothing in the body's shadow; while the dish points
    at Earth the sine of the angle between the Sun and Earth of it, since their normals lie across the dish's axis (4 % with
    `eros-observe`). A spacecraft whose battery is empty stops sending and stays idle until it is charged to `restart`. A
    product for which there is no room when it is asked for is lost, and so is one of which a part is aboard a spacecraft that
    is lost; what is left of it elsewhere, and of products that expired, is deleted.

    Bits are whole numbers: at any time `made_bit` = sum of `stored_bit` + `delivered_bit` + `lost_bit`. Charge changes by
    what the panels bring, less what is spent and what the battery has no room for, plus what was needed and not there.

    ## Observation space

    With `observation="dict"` these tables, with `"flat"` (default) all of them in a row, in this order, as float32. Numbers
    are clipped at 10. K is the argument `products`; `swarm_mj.envs.downlink.baselines.split` gives a flat one by name.

    | table | shape | columns |
    |---|---|---|
    | spacecraft | (n, 8 + n) | charge over capacity; data over `storage_bit`; what panels bring in this slot facing the \
Sun, and facing Earth, over what they bring in full light at the arrival; what Earth hears in this slot over the best; dish \
at Earth; obeys nobody since its battery was empty; not lost; what it can send to spacecraft 1 to n over the best |
    | products | (K, 5 + n) | open (else all are 0); K times its share of the value; bits missing on Earth over the largest \
size; time until it expires over the horizon; share on Earth; share aboard spacecraft 1 to n |
    | swarm | (5,) | time left; a station hears in this slot; rest of this pass; time from its end to the next pass, each \
over the horizon; value on Earth |
    | action_mask | (n, n + 2) | see above |

    ## Reward

    The sum of `info["reward_terms"]`, each its weight (argument `reward_weights`) times its measure.

    | term | weight | measure of a slot |
    |---|---|---|
    | delivered | 1 | value of products whose last bit came to Earth, over that of all products of the episode |
    | expired | -0.2 | the same of those that expired or were lost |
    | empty | -0.05 | batteries that became empty |

    ## Starting state, and what is drawn

    The plan's own trajectories after the arrival, from the force model of the scenario. Drawn for each episode from a flight
    seed (`options={"flight_seed": k}`, else from `self.np_random`; told in `info["flight_seed"]`), by ranges that the
    argument `draw` replaces by name:

    | name | default | what |
    |---|---|---|
    | start_s | 21600 | latest beginning after the arrival; the earliest is the arrival [s] |
    | drift_m_s | 1 | spread of each spacecraft's departure from the plan, each component, normal [m/s] |
    | charge | 0.3 | least charge; the most is 1 |
    | products | 12 | least number of products; the most is K |
    | later | 0.5 | share of them that are asked for within the first two thirds, not at the start |
    | size_bit, size_most_bit | 1e6, 8e6 | size, log-uniform [bit] |
    | density | 10 | most over least valuable bit, log-uniform |
    | lifetime, lifetime_most | 0.1, 0.6 | until a product expires, of the horizon; none outlives it |
    | unequal | 1 | Dirichlet concentration of the shares of the spacecraft in the products |
    | pass_s, pass_most_s, gap_most_s | 3600, 14400, 14400 | allotted passes and the gaps between them [s] |
    | radio_fails, panel_fails, lost | 0.2, 0.2, 0.05 | probability for each spacecraft: its radio to Earth, one of its two \
panels, all of it |

    and the hour of the day at which the arrival falls, which decides which stations see the body when.

    ## Info

    `time_s`, `delivered_value` (0 to 1), `delivered_bit`, `stored_bit` (n), `made_bit`, `lost_bit`, `charge_J` (n),
    `action_mask`; `flight_seed` at a reset, `reward_terms` at a step, `end` where an episode ended by itself.

    ## Episode end

    Terminated: nothing is left to deliver and nothing more will be asked for (`complete`), or all spacecraft are lost
    (`lost`). Truncated: after `horizon_s`.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | `"eros-observe"` | packaged name, path of a YAML file, a dict, or a `Scenario`; crosslinks must be \
omnidirectional; attitudes are not flown, so that its sensors play no part |
    | step_s, horizon_s | 600, 86400 | length of a slot and of an episode [s] |
    | products | 24 | most products K |
    | storage_bit | 4e7 | that each spacecraft has for products [bit] |
    | observation | `"flat"` | or `"dict"` |
    | power | None | mapping that replaces, by name, battery_J 144e3, panel_1au_W 35, base_W 5, earth_W 33.7, crosslink_W 3, \
slew_J 200, slew_s 120, restart 0.2 |
    | draw | None | see above |
    | reward_weights | None | replaces weights by name |
    | overrides | {} | changes of the scenario by dotted key, as `sm.fly` takes them |

    ## Baselines

    Value delivered on average over the 30 flight seeds 0 to 29, `swarm_mj.envs.downlink.baselines`: random 0.19, round robin
    0.52, greedy 0.80. What greedy chose in one episode, flown again as a list in the others: 0.15 to 0.28. `value_bound` of
    `swarm_mj.envs.downlink.bound` proves, for few slots and products, what no policy can exceed.

    ## What is left out

    Receiving takes no power of its own, only a spacecraft's own shadow-casting body counts (no penumbra), attitudes are as
    chosen for the whole slot, and links and light are looked at twice in a slot.

    ## Version history

    v0: first version.
    """

    name, terms, ends = NAME, DownlinkWeights._fields, DOWNLINK_ENDS
    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, render_mode: str | None = None, **arguments: Any) -> None:
        self.render_mode = checked_render_mode(render_mode, [])
        task = DownlinkTask(record_of(DownlinkConfig, NAME, arguments))
        self._set_up(DownlinkBatch(task, 1), choices_of(task))

    def action_masks(self) -> Any:
        """Masks in a row, as MaskablePPO of sb3-contrib asks for them, shape (n (n + 2),)."""
        return self.batch.tables.action_mask[0].ravel().copy()


class SwarmDownlinkVectorEnv(BatchVectorEnv):
    """`num_envs` episodes of one mission; made by `gymnasium.make_vec("swarm_mj.envs:SwarmDownlink-v0", ...)`.

    Spaces, rewards and ends are those of `SwarmDownlinkEnv`, which documents them, and so are the numbers, bit for bit. Infos
    hold arrays over the episodes, with the mask of those to whom they apply under the same name with a leading underscore.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: `NextStep`, `SameStep` or `Disabled`, see `SwarmObserveVectorEnv`.
        render_mode: None.
        arguments: The others of `SwarmDownlinkEnv`.
    """

    name, terms, ends = NAME, DownlinkWeights._fields, DOWNLINK_ENDS

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        count, mode = vector_arguments(num_envs, autoreset_mode)
        self.render_mode = checked_render_mode(render_mode, [])
        task = DownlinkTask(record_of(DownlinkConfig, NAME, arguments))
        self._set_up(DownlinkBatch(task, count), mode, choices_of(task))


def choices_of(task: DownlinkTask) -> spaces.MultiDiscrete:
    """The action space of an episode."""
    return spaces.MultiDiscrete(np.full(task.n, task.n + 2))
