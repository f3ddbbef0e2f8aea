"""Checks of the environment's arguments; every refusal is a `ScenarioError` that says what is allowed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import Any, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.io.machine import available_bytes
from swarm_mj.rendering.canvas import LEAST_SIDE, MOST_SIDE
from swarm_mj.scenarios.schema import Scenario, is_multiple

#: Largest seed of a flight; infos hold seeds as 64-bit integers.
MAX_SEED = 2**63 - 1
Record = TypeVar("Record")


def record_of(kind: type[Record], name: str, given: Mapping[str, Any]) -> Record:
    """The record of the arguments of an environment of that name, a dataclass that checks them.

    Raises:
        ScenarioError: One is unknown, or not allowed.
    """
    known = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    for argument in given:
        if argument not in known:
            near = "".join(f"; did you mean {match}?" for match in get_close_matches(argument, known, 1))
            raise ScenarioError(
                f"{name}: unknown argument {argument}{near}; beside those of rendering and vectors it takes {', '.join(known)}"
            )
    return kind(**given)


def checked_render_mode(mode: str | None, modes: Sequence[str]) -> str | None:
    """The render mode, if it is None or one of those given."""
    if mode is not None and mode not in modes:
        raise ScenarioError(f"render_mode = {mode!r}: must be None or one of {', '.join(modes)}")
    return mode


def is_number(value: Any) -> bool:
    """Whether it is a finite number, not a text that looks like one nor a truth value."""
    return (
        isinstance(value, (int, float, np.integer, np.floating))
        and not isinstance(value, bool)
        and bool(np.isfinite(value))
    )


def is_whole(value: Any) -> bool:
    """Whether it is a whole number by type, not a truth value."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def nothing_to_draw(mode: str | None) -> bool:
    """Whether `render` has no mode to draw in, which is warned of."""
    if mode is None:
        gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
    return mode is None


def agent_names(prefix: Any, n: int) -> list[str]:
    """Of n spacecraft as agents, their numbers from 1 after a prefix."""
    if not isinstance(prefix, str) or not prefix:
        raise ScenarioError(f"agent_prefix = {prefix!r}: must be a text such as 'sc' or 'sc_'")
    return [f"{prefix}{j + 1}" for j in range(n)]


def checked_whole(what: str, value: Any, low: int, high: float, must: str) -> int:
    """A whole number within bounds; `must` tells of them, after "must be".

    Raises:
        ScenarioError: It is none, or beyond them.
    """
    if not is_whole(value) or not low <= value <= high:
        raise ScenarioError(f"{what} = {value!r}: must be {must}")
    return int(value)


def checked_count(name: str, value: Any, otherwise: str = "") -> int:
    """A number of things, at least 1; `otherwise` tells what else is allowed."""
    return checked_whole(name, value, 1, np.inf, f"a whole number of at least 1{otherwise}")


def checked_episodes(value: Any, most: int) -> int:
    """How many test episodes are flown: at least two, for an interval; None: all."""
    return most if value is None else checked_whole("episodes", value, 2, most, f"from 2 to {most}")


def checked_index(e: Any, count: int) -> int:
    """The number of a flight."""
    if not is_whole(e) or not 0 <= e < count:
        raise ScenarioError(f"flight {e!r}: must be a whole number from 0 to {count - 1}")
    return int(e)


def checked_size(name: str, value: Any) -> int:
    """Width or height of a picture [px]."""
    low, high = LEAST_SIDE, MOST_SIDE
    return checked_whole(name, value, low, high, f"a whole number of pixels from {low} to {high}")


def checked_share(percent: float) -> float:
    """The share of the target that counts as complete [%]."""
    if not is_number(percent) or not 0.0 < percent <= 100.0:
        raise ScenarioError(f"complete = {percent!r}: must be a number above 0 and at most 100 percent")
    return percent


def checked_rate(name: str, value: Any) -> float:
    """A positive number, such as a time or a data rate."""
    if not (is_number(value) and value > 0.0):
        raise ScenarioError(f"{name} = {value!r}: must be a positive number")
    return float(value)


def checked_numbers(name: str, given: Any, names: Sequence[str]) -> dict[str, float]:
    """The argument of that name as a mapping from some of `names` to numbers; None: of none."""
    if given is not None and not isinstance(given, Mapping):
        raise ScenarioError(
            f"{name} = {given!r}: must be a mapping from names to numbers; there are {', '.join(names)}"
        )
    for key, value in (given or {}).items():
        if key not in names:
            raise ScenarioError(f"{name}: unknown {key!r}; there are {', '.join(names)}")
        if not is_number(value):
            raise ScenarioError(f"{name}[{key!r}] = {value!r}: must be a finite number")
    return {key: float(value) for key, value in (given or {}).items()}


def checked_step(scenario: Scenario, step_s: float, name: str = "step_s") -> tuple[int, int]:
    """Control periods in a step of that length [s], an argument of that name, and in the flight."""
    period, duration = scenario.control.period_s, scenario.duration_s
    if (
        not is_number(step_s)
        or not step_s > 0.0
        or not is_multiple(step_s, period)
        or not is_multiple(duration, step_s)
    ):
        raise ScenarioError(
            f"{name} = {step_s!r}: must be a number, a whole multiple of control.period_s = {period:g} s, and divide the "
            f"scenario's duration_s = {duration:g} s"
        )
    return round(step_s / period), round(duration / period)


def refuse_more_than_fit(count: int, each: int) -> None:
    """Refuse more episodes than memory holds, where each takes so much, an upper estimate [B].

    Raises:
        ScenarioError: They do not fit; the message says how many would.
    """
    free = available_bytes()
    if free is not None and count * each > free:
        raise ScenarioError(
            f"num_envs = {count}: so many flights take about {count * each / 2**30:.1f} GiB, {each / 2**20:.2f} MiB each, and "
            f"{free / 2**30:.1f} GiB are free; at most {free // each} fit here"
        )


def checked_truth(name: str, value: Any) -> bool:
    """A truth value."""
    if not isinstance(value, (bool, np.bool_)):
        raise ScenarioError(f"{name} = {value!r}: must be True or False")
    return bool(value)


def refuse_extra_targets(scenario: Scenario) -> None:
    """The environment knows one target, one altitude and one time of flight, from a release at the epoch."""
    if scenario.design.observers or scenario.design.release_s:
        key = "observers" if scenario.design.observers else "release_s"
        raise ScenarioError(
            f"design.{key}: {scenario.name} gives spacecraft their own targets, altitudes, times of flight or releases, which "
            "the environment does not know; leave design.observers empty and design.release_s at 0"
        )
    if extra := scenario.designer.extra_targets:
        raise ScenarioError(
            f"designer.extra_targets: {scenario.name} has {len(extra)} targets besides its own, which the environment would "
            "ignore; make one environment for each with target.latitude_deg, ..., and leave designer.extra_targets empty"
        )


def checked_options(options: Any) -> dict[str, Any]:
    """The options of `reset` as a dict of one's own."""
    if options is not None and not isinstance(options, Mapping):
        raise ScenarioError(f"reset options = {options!r}: must be a mapping from names to values, or None")
    return dict(options or {})


def flight_seed(options: dict[str, Any] | None, drawn: int, others: Sequence[str] = ()) -> int:
    """The seed that `reset` options ask for, else the one drawn; `others` are options that somebody else has taken."""
    given = checked_options(options)
    seed = given.pop("flight_seed", drawn)
    if given:
        allowed = ", ".join(["flight_seed", *others])
        raise ScenarioError(f"reset options {sorted(map(str, given))}: unknown; allowed: {allowed}")
    return checked_whole("reset option flight_seed", seed, 0, MAX_SEED, f"a whole number from 0 to {MAX_SEED}")


def flight_seeds(wanted: Any, count: int) -> list[Any]:
    """The `reset` option `flight_seed` by flight, None where a seed is to be drawn; `flight_seed` checks each."""
    if isinstance(wanted, np.ndarray):
        wanted = wanted.tolist()
    if not isinstance(wanted, (list, tuple)):
        return [wanted] * count
    if len(wanted) != count:
        raise ScenarioError(
            f"reset option flight_seed = {wanted!r}: must be a whole number from 0 to {MAX_SEED}, or one for each of the "
            f"{count} flights, not {len(wanted)}"
        )
    return list(wanted)


def first_seeds(seed: Any, count: int) -> list[int | None]:
    """The `seed` of `reset` by flight, None where the flight's own random numbers go on."""
    if seed is None:
        return [None] * count
    if is_whole(seed) and seed >= 0:
        return [int(seed) + e for e in range(count)]
    seeds = list(seed) if isinstance(seed, (list, tuple, np.ndarray)) and np.ndim(seed) == 1 else [seed] * count
    if len(seeds) != count:
        raise ScenarioError(f"seed: {len(seeds)} values for {count} flights; give one number, or one for each")
    for own in seeds:
        if own is not None and (not is_whole(own) or own < 0):
            raise ScenarioError(f"seed = {own!r}: must be a whole number of at least 0, a list of them, or None")
    return [None if own is None else int(own) for own in seeds]


def check_action(space: spaces.Space[Any], action: Any) -> NDArray[Any]:
    """The action as an array of the space's own type.

    Raises:
        gymnasium.error.InvalidAction: It does not lie in the space.
    """
    try:
        given = np.asarray(action)
        if given.dtype.kind not in "biuf":
            raise TypeError
        with np.errstate(invalid="ignore"):
            array = given.astype(space.dtype, copy=False)
        exact = array is given or space.dtype == np.float32 or np.array_equal(array, given)
    except (TypeError, ValueError, OverflowError):
        exact, array = False, action
    if not exact or not space.contains(array):
        raise gymnasium.error.InvalidAction(
            f"action {' '.join(repr(action).split())} does not lie in the action space {space}"
        )
    return np.asarray(array)
