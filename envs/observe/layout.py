"""What agents of SwarmObserve-v0 are shown and what they choose among, from the tables: all patches, or their candidates.

Either takes the tables of E episodes by name, as `Episodes.entities` gives them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array32, Ints

from .tables import GENERAL, PAIRS, SPACECRAFT, Tables

Observed = Mapping[str, NDArray[Any]]
#: Of the table of patches the first columns stand in the flat observation: what changes, `unseen`, and `lit`.
FLAT_PATCHES = 2
#: Columns of a candidate: those of the pair, and the unseen share of the patch.
CANDIDATE = ("worth", "worth_next", "angle", "best", "others", "claimed", "unseen")
#: Columns of the tables that a row of `choice_rows` holds; those of the spacecraft stand twice, of whom chooses and of whom it
#: would relay to.
OF_SPACECRAFT = (
    *("alive", "camera", "downlink", "imaging", "relaying", "talking", "holding", "link", "stored", "earth_in_sight"),
    *("attitude_error", "rate", "in_reach", "in_reach_next"),
)
OF_GENERAL = ("time_left", "seen", "delivered", "alive", "half_width", "picture", "turn", "heard")
#: What sort of choice it is, one of them 1.
KINDS = ("patch", "earth", "relay")
OF_PATCH = 2
#: Numbers of a row.
CHOICE_SIZE = 2 * len(OF_SPACECRAFT) + len(OF_GENERAL) + len(KINDS) + len(PAIRS) + OF_PATCH

#: Where they stand in the tables.
SPACECRAFT_COLUMNS = [SPACECRAFT.index(name) for name in OF_SPACECRAFT]
GENERAL_COLUMNS = [GENERAL.index(name) for name in OF_GENERAL]
_PAIR = {name: k for k, name in enumerate(PAIRS)}
_CANDIDATE_COLUMNS = [_PAIR[name] for name in CANDIDATE[:-1]]
_ALIVE, _DOWNLINK = SPACECRAFT.index("alive"), SPACECRAFT.index("downlink")


def observed_from(tables: Tables) -> dict[str, NDArray[Any]]:
    """The tables of E episodes by name, with `alive` and `action_mask`; no copies."""
    return {
        "spacecraft": tables.spacecraft,
        "patches": tables.patches,
        "pairs": tables.pairs,
        "general": tables.general,
        "alive": tables.spacecraft[:, :, 0].astype(np.int8),
        "action_mask": tables.mask,
    }


class FlatLayout:
    """Which numbers of a flat observation are which: parts by name, row by row, one after the other.

    Args:
        shapes: Of the parts by name, in their order.

    Attributes:
        shapes: Of the parts by name.
        size: Numbers in all.
    """

    def __init__(self, shapes: dict[str, tuple[int, ...]]) -> None:
        self.shapes = shapes
        self.size = sum(int(np.prod(shape)) for shape in shapes.values())

    def joined(self, parts: Observed) -> Array32:
        """Parts of E episodes by name as rows, shape (E, F), of each part the first columns as they have a place here."""
        rows = [parts[name][..., : shape[-1]] for name, shape in self.shapes.items()]
        return np.concatenate([part.reshape(len(part), -1) for part in rows], axis=1)

    def split(self, flat: NDArray[np.floating]) -> dict[str, NDArray[np.floating]]:
        """The parts of E flat observations by name, shape (E, F); of one, shape (F,), with E = 1."""
        rows = np.atleast_2d(flat)
        parts, start = {}, 0
        for name, shape in self.shapes.items():
            size = int(np.prod(shape))
            parts[name] = rows[:, start : start + size].reshape(len(rows), *shape)
            start += size
        return parts


class Interface(ABC):
    """What stands between the tables and an agent.

    Attributes:
        layout: Of the flat observation.
        choices: Choices of a spacecraft, C.
    """

    layout: FlatLayout
    choices: int

    @abstractmethod
    def shown(self, observed: Observed) -> dict[str, NDArray[Any]]:
        """The observation `entities`: parts of E episodes by name, with `alive` and `action_mask`, shape (E, n, C)."""

    def flat(self, observed: Observed) -> Array32:
        """The observation `flat`, shape (E, F)."""
        return self.layout.joined(self.shown(observed))

    @abstractmethod
    def decoded(self, observed: Observed, chosen: NDArray[Any]) -> Ints:
        """Choices, shape (E, n), as numbers among all patches, Earth and relays."""


class AllPatches(Interface):
    """Choices of a spacecraft are all K patches, Earth, and relays to each of n spacecraft.

    Args:
        n: Most spacecraft.
        patches: Number of patches K.
    """

    def __init__(self, n: int, patches: int) -> None:
        shapes: dict[str, tuple[int, ...]] = {"spacecraft": (n, len(SPACECRAFT)), "pairs": (n, patches, len(PAIRS))}
        self.layout = FlatLayout(shapes | {"patches": (patches, FLAT_PATCHES), "general": (len(GENERAL),)})
        self.choices = patches + 1 + n

    def shown(self, observed: Observed) -> dict[str, NDArray[Any]]:
        """The tables as they are."""
        return dict(observed)

    def decoded(self, observed: Observed, chosen: NDArray[Any]) -> Ints:
        """The choices as they are."""
        return np.asarray(chosen, np.int64)


class Candidates(Interface):
    """Choices of a spacecraft are the R patches that are worth most to it, the best first, and, last, to send what is aboard.

    A patch that is in reach half a decision ahead comes before one that will be a whole one later, and that before those that
    come nearest to it. Who hears Earth sends there, who does not relays to the first who does.

    Args:
        n: Most spacecraft.
        patches: Number of patches K.
        count: Number of candidates R, at most K.
    """

    def __init__(self, n: int, patches: int, count: int) -> None:
        shapes: dict[str, tuple[int, ...]] = {"spacecraft": (n, len(SPACECRAFT_COLUMNS))}
        shapes |= {"candidates": (n, count, len(CANDIDATE)), "general": (len(GENERAL_COLUMNS),)}
        self.layout, self.choices, self._count = FlatLayout(shapes), count + 1, count

    def shown(self, observed: Observed) -> dict[str, NDArray[Any]]:
        """Spacecraft, candidates and general with the columns `OF_SPACECRAFT` and `OF_GENERAL`, see `CANDIDATE`."""
        order, pairs = self._order(observed), observed["pairs"]
        unseen = np.broadcast_to(observed["patches"][:, None, :, :1], (*pairs.shape[:3], 1))
        columns = np.concatenate([pairs[..., _CANDIDATE_COLUMNS], unseen], axis=3)
        mask = np.take_along_axis(observed["action_mask"], order, axis=2)
        return {
            "spacecraft": observed["spacecraft"][:, :, SPACECRAFT_COLUMNS],
            "candidates": np.take_along_axis(columns, order[..., None], axis=2),
            "general": observed["general"][:, GENERAL_COLUMNS],
            "alive": observed["alive"],
            # To send is to turn to Earth for whom has nothing aboard.
            "action_mask": np.concatenate([mask, np.ones_like(mask[:, :, :1])], axis=2),
        }

    def decoded(self, observed: Observed, chosen: NDArray[Any]) -> Ints:
        """The patches of that rank now, and Earth or a relay for the last choice, shape (E, n)."""
        order, K = self._order(observed), observed["pairs"].shape[2]
        ranks = np.minimum(np.asarray(chosen, np.int64), self._count - 1)
        patch = np.take_along_axis(order, ranks[..., None], axis=2)[..., 0]
        spacecraft = observed["spacecraft"]
        hears = (spacecraft[:, :, _DOWNLINK] > 0.5) & (spacecraft[:, :, _ALIVE] > 0.5)
        first = hears.argmax(axis=1)[:, None]
        send = np.where(hears | ~hears.any(axis=1, keepdims=True), K, K + 1 + first)
        return np.where(np.asarray(chosen) < self._count, patch, send)

    def _order(self, observed: Observed) -> Ints:
        """The best R patches of each spacecraft, shape (E, n, R)."""
        pairs = observed["pairs"].astype(np.float64)
        now, later, gsd = (pairs[..., _PAIR[name]] for name in ("worth", "worth_next", "gsd"))
        # Neither worth is above 5, and no gsd above 2.
        key = np.where(now > 0.0, 20.0 + now, np.where(later > 0.0, 10.0 + later, 2.0 - gsd))
        return np.argsort(-key, axis=2, kind="stable")[:, :, : self._count]


def local_parts(shown: Observed) -> dict[str, NDArray[Any]]:
    """What each spacecraft is told of a team's observation, parts of E episodes, by name, shape (E, n, ...), or views.

    Its own rows of spacecraft and of pairs or candidates, the rows of the others in cyclic order, and what concerns all.
    """
    spacecraft, own = shown["spacecraft"], "pairs" if "pairs" in shown else "candidates"
    n = spacecraft.shape[1]
    others = (np.arange(n)[:, None] + 1 + np.arange(n - 1)) % n
    parts = {"self": spacecraft, own: shown[own], "others": spacecraft[:, others]}
    of_all = {name: shown[name][:, None] for name in ("patches", "general") if name in shown}
    return parts | {name: np.broadcast_to(part, (len(part), n, *part.shape[2:])) for name, part in of_all.items()}


def local_rows(shown: Observed) -> Array32:
    """The same as one row for each spacecraft, shape (E, n, L)."""
    E, n = shown["spacecraft"].shape[:2]
    return np.concatenate([part.reshape(E, n, -1) for part in local_parts(shown).values()], axis=2)


def choice_rows(observed: Observed) -> Array32:
    """What is known of every choice, shape (E, n, C, `CHOICE_SIZE`), for networks that judge choices one by one.

    Zero is what does not belong to a choice of its kind. Places and directions are left out: what they mean for a choice is in
    its worth, and nothing of the forty missions of training can be learnt by heart.

    Args:
        observed: Tables of E episodes by name, as the observation `entities` has them.
    """
    spacecraft, pairs = observed["spacecraft"][:, :, SPACECRAFT_COLUMNS], observed["pairs"]
    E, n, K, width = pairs.shape
    out = np.zeros((E, n, K + 1 + n, CHOICE_SIZE), np.float32)
    each = spacecraft.shape[2]
    own, general, kind, to, pair = np.cumsum([0, each, len(OF_GENERAL), len(KINDS), each])
    out[..., own:general] = spacecraft[:, :, None]
    out[..., general:kind] = observed["general"][:, None, None, GENERAL_COLUMNS]
    out[:, :, :K, kind] = out[:, :, K, kind + 1] = out[:, :, K + 1 :, kind + 2] = 1.0
    # To relay to oneself is to hold: nobody else is concerned.
    others = ~np.eye(n, dtype=np.bool_)[None, :, :, None]
    out[:, :, K + 1 :, to:pair] = np.where(others, spacecraft[:, None], 0.0)
    out[:, :, :K, pair : pair + width] = pairs
    out[:, :, :K, pair + width :] = observed["patches"][:, None, :, :OF_PATCH]
    return out


def make_interface(n: int, patches: int, candidates: int | None) -> Interface:
    """By the environment's arguments of these names."""
    return AllPatches(n, patches) if candidates is None else Candidates(n, patches, candidates)
