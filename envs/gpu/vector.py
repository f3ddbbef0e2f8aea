"""SwarmObserve-v0 on a GPU: thousands of flights, one thread each, whose observations never leave the device."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.typing import Ints

from ..arguments import checked_count, checked_options, flight_seed, flight_seeds, refuse_graph
from ..observe.actions import RoleLevel, check_action
from ..observe.batch import EpisodeBatch
from ..observe.rewards import TERMS
from ..observe.task import make_task
from .columns import Columns, Tables
from .device import SIMULATED, make_memory, on_host, placed, require_device
from .kernels import launch, make_kernels
from .starts import check_task, constants_of, memory_of, no_answer, prepared

#: What a GPU flies: wheels as momentum states, stepped without MuJoCo. Stands before the overrides of the caller.
OVERRIDES = ("physics.wheels=gyrostat", "physics.stepper=kernel")
#: Prepared starts, unless there are fewer flights.
STARTS = 1024


class SwarmObserveGpuVectorEnv(VectorEnv[Any, Any, Any]):
    """`num_envs` flights of one scenario on a GPU, at the level `role`.

    Spaces, rewards and ends are those of `SwarmObserveEnv`, and the episodes are those of the processor within 1e-6: the
    kernels are made of the same sources. Wheels are momentum states and steps those of the kernel stepper, whatever the
    scenario says.

    What `reset` and `step` return are arrays on the device, which the next call overwrites: `torch.as_tensor(array)` and
    `jax.numpy.asarray(array)` take them by `__cuda_array_interface__` without a copy. Actions may be such arrays, of int64, or
    NumPy's. An episode that is over is started anew at once (`AutoresetMode.SAME_STEP`), from the next of the prepared starts.

    Infos: `final_obs` (num_envs, F) with its mask `_final_obs`, `coverage_percent`, `delivered_bit` and `reward_terms` (a dict
    of arrays) at the end of the step, and `start` (num_envs,), the number of the start from which each flight flies now; its
    seed is that of `flight_seeds`.

    Args:
        num_envs: Number of flights.
        starts: How many starts the processor prepares at every reset, a millisecond each; None: as many as there are flights,
            at most 1024. Flights take them in turn.
        check_actions: Whether actions on the device are looked at, which waits for the step to be flown. Else a spacecraft of a
            flight with an impossible choice keeps its target.
        arguments: The others of `SwarmObserveEnv`, except those of rendering.

    Raises:
        ScenarioError: There is no GPU, or it cannot fly this; the message names what is in the way.
    """

    def __init__(
        self, num_envs: int = 64, *, starts: int | None = None, check_actions: bool = True, **arguments: Any
    ) -> None:
        self.num_envs, self._check = checked_count("num_envs", num_envs), check_actions
        count = min(self.num_envs, STARTS) if starts is None else checked_count("starts", starts, ", or None")
        require_device()
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}
        self.autoreset_mode = AutoresetMode.SAME_STEP
        arguments["overrides"] = (*OVERRIDES, *arguments.get("overrides", ()))
        self.task = task = make_task(**arguments)
        refuse_graph(task.config.observability)
        law = check_task(task)
        self._single = EpisodeBatch(task, 1)
        level = self._single.level
        assert isinstance(level, RoleLevel)
        self._random = np.random.default_rng()
        #: Seeds of the prepared starts, shape (starts,).
        self.flight_seeds: Ints = np.zeros(count, np.int64)
        self._allocate(memory_of(self._single))
        self._constants = placed(constants_of(task, level), self.memory)
        self._kernels = make_kernels(self._flights, self._answer, law)
        self.single_observation_space = task.observation_layout.space
        self.single_action_space = level.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._begun = False

    def _allocate(self, one: Any) -> None:
        self.memory = make_memory()
        self._columns, answers = Columns(one), Columns(no_answer(self.task))
        self._tables = self._columns.empty(self.num_envs, self.memory)
        self._flights = self._columns.views(self._tables, self.memory)
        tables = Tables(*(self.memory.put(table) for table in answers.filled(self.num_envs)))
        self._answer = answers.views(tables, self.memory)
        self._starts: Tables | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Prepare starts and let every flight begin: flight e from start e, counted around.

        Args:
            seed: Of the first start, the next ones follow, as those of the flights of `SwarmObserveVectorEnv`; None draws on.
            options: `flight_seed`: of all starts, or one for each.

        Raises:
            ScenarioError: A seed or option is not allowed.
        """
        count = len(self.flight_seeds)
        given = checked_options(options)
        chosen = flight_seeds(given.pop("flight_seed", None), count)
        if seed is not None:
            drawn = [int(seeding.np_random(seed + k)[0].integers(2**31)) for k in range(count)]
            self._random = np.random.default_rng(seed)
        else:
            drawn = self._random.integers(2**31, size=count).tolist()
        for k, (own, wanted) in enumerate(zip(drawn, chosen, strict=True)):
            self.flight_seeds[k] = flight_seed(given | ({} if wanted is None else {"flight_seed": wanted}), own)
        tables = self._columns.filled(count)
        for k, start in enumerate(prepared(self._single, self.flight_seeds.tolist())):
            self._columns.write(tables, k, start)
        self._starts = Tables(*(self.memory.put(table) for table in tables))
        everyone = np.arange(self.num_envs) % count
        self.memory.write(self._answer.start, everyone - 1)
        self.memory.write(self._answer.over, np.ones(self.num_envs, np.bool_))
        self._restart()
        self._begun = True
        return self._flights.observation, {"start": self._answer.start}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Fly on for one step with the actions held, shape (num_envs, n).

        Raises:
            gymnasium.error.InvalidAction: The actions do not lie in the action space.
            gymnasium.error.ResetNeeded: No flight has begun.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("SwarmObserve-v0: no episode has begun; call reset first")
        choices, answer = self._choices(actions), self._answer
        # What was the end of the last step is the beginning of this one.
        self._flights = self._flights._replace(before=self._flights.now, now=self._flights.before)
        launch(self._kernels.fly, self.num_envs, self._constants, self._flights, answer, choices)
        launch(self._kernels.end, self.num_envs, self._constants, self._flights, answer)
        self._restart()
        if self._check and not isinstance(actions, np.ndarray) and on_host(answer.refused).any():
            e = int(np.argmax(on_host(answer.refused)))
            raise gymnasium.error.InvalidAction(f"the action of flight {e} does not lie in the action space")
        infos = {
            "final_obs": answer.final,
            "_final_obs": answer.over,
            "coverage_percent": answer.percent,
            "delivered_bit": answer.delivered,
            "reward_terms": dict(zip(TERMS, answer.result.terms, strict=True)),
            "start": answer.start,
        }
        return self._flights.observation, answer.result.reward, answer.terminated, answer.result.truncated, infos

    def _restart(self) -> None:
        # Only arrays within tuples: the simulator copies others to and fro, although they share memory.
        launch(self._kernels.restart, self.num_envs, self._flights, self._answer, self._tables, self._starts)

    def _choices(self, actions: Any) -> Any:
        if hasattr(actions, "__cuda_array_interface__") and not SIMULATED:
            return self.memory.adopt(actions, self.action_space.shape)
        chosen: NDArray[Any] = check_action(self.action_space, actions)
        return self.memory.put(np.ascontiguousarray(chosen, np.int64))

    @property
    def doubts(self) -> Ints:
        """Pictures so far of which the maps could not tell all, by flight, shape (num_envs,).

        The camera was inside the body's bounding sphere: the processor asks a ray tracer there, and may have seen more.
        """
        return np.asarray(on_host(self._answer.doubts))

    def close_extras(self, **kwargs: Any) -> None:
        """Release the observer."""
        self.task.close()
