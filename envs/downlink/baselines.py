"""Scripted policies of SwarmDownlink-v0: what a trained agent has to beat, and a list that does not look."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array, Array32, Ints

from .batch import PRODUCT, DownlinkBatch, no_tables
from .slot import EARTH, IDLE, SWARM
from .world import DownlinkTask

#: The observation of one episode by tables.
Tables = Mapping[str, NDArray[Any]]
DownlinkPolicy = Callable[[DownlinkTask, Tables], Ints]

#: Share of the battery's capacity above which the greedy rule lets a spacecraft talk to Earth.
RESERVE = 0.18


def split(task: DownlinkTask, observation: Array32) -> dict[str, NDArray[Any]]:
    """A flat observation by tables, shape (F,)."""
    parts, start = {}, 0
    for name, table in no_tables(1, task.n, task.config.products)._asdict().items():
        parts[name] = observation[start : start + table.size].reshape(table.shape[1:])
        start += table.size
    return parts


def random_policy(seed: int) -> DownlinkPolicy:
    """Any allowed choice, alike likely."""
    rng = np.random.default_rng(seed)

    def choose(task: DownlinkTask, tables: Tables) -> Ints:
        return np.array([rng.choice(np.flatnonzero(allowed)) for allowed in tables["action_mask"]], np.int64)

    return choose


def round_robin(task: DownlinkTask, tables: Tables) -> Ints:
    """One after another talks to Earth, a slot each; who may not is left out; the others charge."""
    slots, may = task.config.slots, tables["action_mask"][:, EARTH] > 0
    turn = round(slots * (1.0 - float(tables["swarm"][0])))
    choice = np.full(task.n, IDLE, np.int64)
    for i in (turn + np.arange(task.n)) % task.n:
        if may[i]:
            choice[i] = EARTH
            break
    return choice


def greedy(task: DownlinkTask, tables: Tables) -> Ints:
    """Earth hears who holds the most valuable bits and has the charge; who has data and cannot talk hands them on.

    A bit is worth its product's value over what is still missing of it on Earth, if there is time for that. While no pass is
    on, and beside who talks, a spacecraft that the antenna does not hear or whose battery is low sends to the one with most
    charge that can.
    """
    best, spacecraft, mask = _best_bits(task, tables), tables["spacecraft"], tables["action_mask"] > 0
    charge, hears = spacecraft[:, 0].astype(np.float64), spacecraft[:, 4] > 0.0
    passing = tables["swarm"][1] > 0.0 and bool(hears.any())
    choice = np.full(task.n, IDLE, np.int64)
    able = (spacecraft[:, 7] > 0.0) & (spacecraft[:, 6] == 0.0) & (hears | (not passing))
    speaks = np.flatnonzero(mask[:, EARTH] & (charge > RESERVE) & (best > 0.0))
    speaker = int(speaks[np.argmax(best[speaks])]) if len(speaks) else -1
    if speaker >= 0:
        choice[speaker] = EARTH
    for i in np.flatnonzero(best > 0.0):
        if i == speaker or (able[i] and charge[i] > 2.0 * RESERVE):
            continue
        others = [
            j
            for j in np.flatnonzero(mask[i, SWARM:])
            if able[j] and charge[j] > max(2.0 * RESERVE, charge[i] * able[i])
        ]
        if others:
            choice[i] = SWARM + max(others, key=lambda j: (charge[j], -j))
    return choice


def _best_bits(task: DownlinkTask, tables: Tables) -> Array:
    """Most value per missing bit among what is aboard each spacecraft and can be on Earth in time, shape (n,)."""
    products, config = tables["products"].astype(np.float64), task.config
    missing_bit = np.maximum(products[:, 2] * config.draws.size_most_bit, 1.0)
    in_time = products[:, 3] * config.slots * task.best_earth_bit >= missing_bit
    worth = np.where((products[:, 0] > 0.0) & in_time, products[:, 1] / missing_bit, 0.0)
    aboard = products[:, PRODUCT:] > 0.0
    return np.asarray((worth[:, None] * aboard).max(axis=0, initial=0.0))


def recorded(actions: Sequence[Ints]) -> DownlinkPolicy:
    """A list of actions, one for each slot, whatever happens; what is not allowed is idle."""

    def choose(task: DownlinkTask, tables: Tables) -> Ints:
        turn = round(task.config.slots * (1.0 - float(tables["swarm"][0])))
        return np.asarray(actions[min(turn, len(actions) - 1)])

    return choose


def fly_downlink(
    task: DownlinkTask, policy: DownlinkPolicy, seeds: Sequence[int], actions: list[Ints] | None = None
) -> tuple[Array, Array]:
    """One episode from each flight seed; `actions` receives the choices of the last one.

    Returns:
        Rewards and values delivered, each of shape (len(seeds),).
    """
    batch, total, value = DownlinkBatch(task, 1), np.zeros(len(seeds)), np.zeros(len(seeds))
    for k, seed in enumerate(seeds):
        batch.reset({0: seed})
        flown: list[Ints] = []
        over = False
        while not over:
            tables = {name: table[0] for name, table in batch.tables._asdict().items()}
            flown.append(policy(task, tables))
            result = batch.step(flown[-1][None])
            total[k] += result.reward[0]
            over = bool(result.end[0] or result.truncated[0])
        value[k] = batch.state.delivered[0]
        if actions is not None:
            actions[:] = flown
    return total, value
