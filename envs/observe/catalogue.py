"""The named missions of SwarmObserve-v0: a body, a place on it, the way past it, and a camera.

Sixteen places on each of four bodies. Those within 40 deg of the longitude 0 are for training, those within 20 deg of 180 deg
for tests; the long bodies have their ends there. No target reaches further than 34 deg from its middle, the corners of a square
of `MOST_HALF_ANGLE_DEG`, and middles of the two kinds are at least 112 deg apart: no place on a body is part of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

from swarm_mj.errors import ScenarioError

from ..arguments import is_whole

BODIES = ("eros", "bennu", "itokawa", "ellipsoid")
#: East longitudes of the targets' middles by split, and their latitudes [deg].
LONGITUDES_DEG = {"train": (-40, -20, 0, 20, 40), "test": (160, 180, 200)}
LATITUDES_DEG = (-15, 15)
#: Half-width of a target in angle from the body's centre, at most [deg].
MOST_HALF_ANGLE_DEG = 25.0
#: Width of the camera's picture over that of a patch.
PICTURE_OVER_PATCH = (1.0, 1.15, 1.3)
#: Headings that differ from the rule, by which the swarm would hit the body after its arrival [deg].
TURNED_DEG = {"itokawa-test-2": 180.0}
#: How many missions an environment flies by default: of each body two.
DEFAULT_COUNT = 8


class MissionSpec(NamedTuple):
    """What makes a mission, by name.

    Attributes:
        name: `BODY-SPLIT-NUMBER`.
        body: A packaged body, or the ellipsoid that stands for 21 Lutetia.
        latitude_deg: Of the target's middle [deg].
        longitude_deg: Of the target's middle, east [deg].
        heading_deg: Which way the swarm passes over it, from north over east [deg].
        picture_over_patch: Width of the camera's picture over that of a patch, straight down.
        split: `train` or `test`.
    """

    name: str
    body: str
    latitude_deg: float
    longitude_deg: float
    heading_deg: float
    picture_over_patch: float
    split: str


def _catalogue() -> dict[str, MissionSpec]:
    found = {}
    for split, longitudes in LONGITUDES_DEG.items():
        places = [(latitude, longitude) for longitude in longitudes for latitude in LATITUDES_DEG]
        for k, (latitude, longitude) in enumerate(places):
            for b, body in enumerate(BODIES):
                name = f"{body}-{split}-{k + 1}"
                # Any rule would do that spreads them: 137.5 deg is the golden angle.
                heading = (137.5 * (k + 0.25 * b) + TURNED_DEG.get(name, 0.0)) % 360.0
                wide = PICTURE_OVER_PATCH[(k + b) % len(PICTURE_OVER_PATCH)]
                found[name] = MissionSpec(name, body, latitude, longitude, heading, wide, split)
    return found


#: All missions by name, the bodies in turn.
CATALOGUE: dict[str, MissionSpec] = _catalogue()
SPLITS = tuple(LONGITUDES_DEG)


def mission_names(split: str) -> list[str]:
    """Names of all missions of a split, the bodies in turn.

    Raises:
        ScenarioError: There is no such split.
    """
    if split not in SPLITS:
        raise ScenarioError(f"split = {split!r}: must be one of {', '.join(SPLITS)}")
    return [name for name, spec in CATALOGUE.items() if spec.split == split]


def chosen_missions(missions: Any, split: str) -> tuple[MissionSpec, ...]:
    """The missions of a split that an environment flies: names; or how many, spread evenly over its places; or "all" of them.

    Raises:
        ScenarioError: A name is unknown or of the other split, or there are not so many.
    """
    offered = mission_names(split)
    if missions == "all":
        missions = len(offered)
    if is_whole(missions):
        missions = int(missions)
        if not 1 <= missions <= len(offered):
            raise ScenarioError(
                f"missions = {missions}: must be from 1 to {len(offered)}, as many as {split} has, or names"
            )
        return tuple(CATALOGUE[offered[k]] for k in _spread(missions, len(offered)))
    names = [missions] if isinstance(missions, str) else list(missions) if isinstance(missions, Sequence) else None
    if not names:
        raise ScenarioError(f"missions = {missions!r}: must be a whole number, 'all', or names such as {offered[0]!r}")
    for name in names:
        if name not in offered:
            known = isinstance(name, str) and name in CATALOGUE
            other = f"is one of split = {CATALOGUE[name].split!r}" if known else "is unknown"
            ranges = ", ".join(f"{body}-{split}-1 to {len(offered) // len(BODIES)}" for body in BODIES)
            near = "".join(f"; did you mean {match!r}?" for match in get_close_matches(str(name), offered, 1))
            raise ScenarioError(f"missions: {name!r} {other}; of split = {split!r} there are {ranges}{near}")
    return tuple(CATALOGUE[name] for name in names)


def _spread(count: int, of: int) -> list[int]:
    """So many whole groups of one mission a body as fit, evenly over the places, then the rest in order."""
    bodies = len(BODIES)
    places, wanted = of // bodies, -(-count // bodies)
    starts = [(k * places) // wanted for k in range(wanted)]
    return [bodies * start + b for start in starts for b in range(bodies)][:count]
