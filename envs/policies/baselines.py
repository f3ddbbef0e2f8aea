"""Scripted policies for SwarmObserve-v0: what a trained agent has to beat.

Each takes the tables of E episodes by name, as the observation `entities` has them and `FlatLayout.split` gives them of a flat
one, and returns choices, shape (E, n). `fly` flies one over flight seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array, Ints

from ..observe.config import EnvConfig
from ..observe.episodes import Episodes
from ..observe.layout import Observed
from ..observe.rewards import TERMS
from ..observe.tables import GENERAL, PAIRS, SPACECRAFT

Policy = Callable[[Observed], Ints]

_SEEN, _DELIVERED = TERMS.index("seen"), TERMS.index("delivered")
_COLUMN = {name: k for k, name in enumerate(SPACECRAFT)}
_PAIR = {name: k for k, name in enumerate(PAIRS)}
_GENERAL = {name: k for k, name in enumerate(GENERAL)}
#: Someone else takes a patch that is taken only where nothing else is left.
TAKEN = 1e-3
#: Share of a flight that the sweep stays on a patch, and looks at all; with a half or 0.7 it comes to less.
DWELL, LOOKS = 1.0 / 30.0, 0.6
#: Decisions of a flight where nothing else is said: 20 s in 600 s.
DECISIONS = 30


#: The best list of choices that hill climbing from the sweep (`scripts/pages/open_loop.py`) found on flight seeds 0 to 127 of
#: the default pool of missions, one row a spacecraft; 287 changes were tried and 71 kept.
OPEN_LOOP = (
    "0 1 7 1 12 1 7 0 9 1 7 13 0 4 2 7 15 1 3 16 16 16 16 16 16 16 16 16 16 16",
    "14 4 10 10 5 1 14 2 9 7 1 3 12 11 3 13 2 5 1 14 7 15 7 16 16 16 16 16 16 16",
    "10 11 6 3 3 12 0 13 1 12 0 15 5 4 8 3 14 4 15 11 16 16 16 16 16 16 16 16 16 16",
)


class Flown(NamedTuple):
    """What episodes came to, or at most could, each of shape (m,).

    Attributes:
        score: Sum of rewards.
        seen: Of which for seen area.
        delivered: Of which for delivered data.
    """

    score: Array
    seen: Array
    delivered: Array


def random_choices(seed: int = 0) -> Policy:
    """Any choice, equally likely."""
    rng = np.random.default_rng(seed)

    def choose(observed: Observed) -> Ints:
        E, n, patches, _ = observed["pairs"].shape
        return rng.integers(0, patches + 1 + n, (E, n))

    return choose


def open_loop(actions: NDArray[Any] | None = None) -> Policy:
    """A list of choices, step by step, shape (steps, n), whatever is seen; the clock alone is looked at. None: `OPEN_LOOP`."""
    listed = np.array([row.split() for row in OPEN_LOOP]).T if actions is None else np.asarray(actions)
    listed = listed.astype(np.int64)

    def choose(observed: Observed) -> Ints:
        if observed["pairs"].shape[1] != listed.shape[1]:
            raise ScenarioError(
                f"open loop: lists choices of {listed.shape[1]} spacecraft, not of {observed['pairs'].shape[1]}"
            )
        left = observed["general"][:, _GENERAL["time_left"]].astype(np.float64)
        step = np.rint((1.0 - left) * len(listed)).astype(np.int64)
        return np.asarray(listed[np.minimum(step, len(listed) - 1)])

    return choose


def sweep(observed: Observed) -> Ints:
    """Everyone goes through the patches row by row, to and fro, each starting at another place, then talks to Earth."""
    E, n, patches, _ = observed["pairs"].shape
    k = round(patches**0.5)
    order = np.arange(patches).reshape(k, k)
    order[1::2] = order[1::2, ::-1].copy()
    elapsed = 1.0 - observed["general"][:, _GENERAL["time_left"]].astype(np.float64)
    step = np.rint(elapsed / DWELL).astype(np.int64)
    place = (step[:, None] + np.arange(n) * patches // n) % patches
    return np.where((elapsed < LOOKS - 1e-6)[:, None], order.ravel()[place], patches)


def greedy(observed: Observed) -> Ints:
    """One after another takes the patch whose picture is worth most now, a different one; with none in reach, data are sent."""
    return _greedy(observed, None)


def greedy_ahead(observed: Observed, decisions: int = DECISIONS) -> Ints:
    """The same, but patches that leave reach come first, and who has least to see talks while the time is short.

    It must be told the `decisions` of a flight, of which the tables know nothing.
    """
    return _greedy(observed, decisions)


def _greedy(observed: Observed, decisions: int | None) -> Ints:
    """The greedy rule, and with the number of decisions of a flight the one that looks ahead."""
    pairs = observed["pairs"].astype(np.float64)
    E, n, patches, _ = pairs.shape
    out = np.empty((E, n), np.int64)
    for e in range(E):
        worth, later = pairs[e, :, :, _PAIR["worth"]].copy(), pairs[e, :, :, _PAIR["worth_next"]].copy()
        if decisions is not None:
            # What nobody reaches a step later is worth half as much again.
            worth *= 1.0 + 0.5 * (later.max(axis=0) <= 0.0)
        spacecraft = observed["spacecraft"][e]
        talker = -1 if decisions is None else _talker(observed, e, worth, decisions)
        for j in range(n):
            if spacecraft[j, _COLUMN["alive"]] < 0.5:
                out[e, j] = patches + 1 + j
                continue
            k = int(worth[j].argmax())
            if worth[j, k] > 0.0 and j != talker:
                out[e, j] = k
                worth[:, k] *= TAKEN
                later[:, k] *= TAKEN
            else:
                out[e, j] = _otherwise(spacecraft, j, later[j], pairs[e, j, :, _PAIR["gsd"]])
                if out[e, j] < patches:
                    later[:, out[e, j]] *= TAKEN
    return out


def _talker(observed: Observed, e: int, worth: Array, decisions: int) -> int:
    """Who gives up its picture to send: where what is aboard takes the time that is left, the one with least to see; or -1."""
    spacecraft, general = observed["spacecraft"][e], observed["general"][e]
    stored = spacecraft[:, _COLUMN["stored"]]
    able = (
        (stored > 0.0) & (spacecraft[:, _COLUMN["downlink"]] > 0.5) & (spacecraft[:, _COLUMN["earth_in_sight"]] > 0.5)
    )
    capacity = general[_GENERAL["heard"]] * general[_GENERAL["time_left"]] * decisions
    if not able.any() or stored.sum() < 0.8 * capacity:
        return -1
    return int(np.where(able, worth.max(axis=1), np.inf).argmin())


def _otherwise(spacecraft: NDArray[Any], j: int, later: Array, gsd: Array) -> int:
    """With nothing in reach: send to Earth, or to the first who is heard there, or turn to what will be reached."""
    n, patches = len(spacecraft), len(later)
    if spacecraft[j, _COLUMN["stored"]] > 0.0:
        if spacecraft[j, _COLUMN["downlink"]] > 0.5:
            return patches
        heard = (spacecraft[:, _COLUMN["downlink"]] > 0.5) & (np.arange(n) != j)
        if heard.any():
            return patches + 1 + int(heard.argmax())
    if spacecraft[j, _COLUMN["camera"]] < 0.5:
        return patches + 1 + j
    return int(later.argmax() if later.max() > 0.0 else gsd.argmin())


def scripted_policies(config: EnvConfig) -> dict[str, Policy]:
    """Those that need nothing else, by name, for an environment of these arguments."""
    return {"sweep": sweep, "greedy": greedy, "greedy_ahead": partial(greedy_ahead, decisions=config.decisions)}


def fly(episodes: Episodes, policy: Policy, seeds: Sequence[int], draw: Mapping[str, Any] | None = None) -> Flown:
    """One episode for each flight seed, as many at once as `episodes` has room for; `draw` as in `Episodes.begin`.

    Raises:
        ScenarioError: There are no seeds.
    """
    if np.ndim(seeds) != 1 or not len(seeds):
        raise ScenarioError(f"seeds = {seeds!r}: must be a sequence of at least one flight seed, such as range(8)")
    parts = [
        _fly(episodes, policy, seeds[start : start + episodes.count], draw)
        for start in range(0, len(seeds), episodes.count)
    ]
    return Flown(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _fly(episodes: Episodes, policy: Policy, seeds: Sequence[int], draw: Mapping[str, Any] | None) -> Flown:
    episodes.reset({e: int(seed) for e, seed in enumerate(seeds)}, draw)
    score, seen, delivered = (np.zeros(episodes.count) for _ in range(3))
    live = np.arange(episodes.count) < len(seeds)
    while live.any():
        result = episodes.fly(policy(episodes.entities()), live)
        score += result.reward
        seen += result.terms[:, _SEEN]
        delivered += result.terms[:, _DELIVERED]
        live = live & (result.end == 0) & ~result.truncated
    return Flown(*(values[: len(seeds)] for values in (score, seen, delivered)))
