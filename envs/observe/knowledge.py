"""What each spacecraft of an episode knows of the others where only what has reached it counts: `knowledge="graph"`.

At the end of every step all who hear one another, directly or through others, tell all they know. Who is out of reach, or lost,
stays in the others' minds as it was last heard of. What agent i is shown are the tables of an episode in which all is as i
believes it to be.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.coordination.graph import graph_at
from swarm_mj.dataflow.contacts import Instant, radios_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.typing import Ints

from .kinematics import Tracking, no_estimate, no_kinematics
from .layout import Observed, observed_from
from .state import EpisodeState
from .table_kernels import write_tables
from .tables import EpisodeArrays, no_sheet, no_tables
from .totals import no_totals


class GraphKnowledge:
    """What the n spacecraft of one episode know: n beliefs about it, one a row.

    Args:
        episode: The state of an episode that has begun, the first of `EpisodeState`.

    Attributes:
        beliefs: How each believes all to stand.
    """

    def __init__(self, episode: EpisodeState) -> None:
        n, wheels = episode.n, episode.now.wheel.shape[2]
        self._episode, self.tables = episode, no_tables(n, n, episode.patches)
        nothing = np.zeros((n, n), np.int64)
        self.beliefs = EpisodeArrays(
            now=no_kinematics(n, n, wheels),
            estimate=no_estimate(n, n),
            tracking=Tracking(nothing, nothing.copy(), np.zeros((n, n, 3)), np.zeros((n, n), np.bool_)),
            totals=no_totals(n, n, episode.totals.seen.shape[1]),
            sheet=no_sheet(n, n),
        )

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All that is known; written to, it is known instead."""
        return tuple(array for part in (*self.beliefs, self.tables) for array in part)

    @property
    def observed(self) -> Observed:
        """What each is shown, as the tables of n episodes by name."""
        return observed_from(self.tables)

    def begin(self) -> None:
        """All are together, and know one another."""
        self._learn([np.arange(self._episode.n)])

    def tell(self) -> None:
        """Let those who hear one another now tell one another all they know; who hears nobody knows only itself."""
        groups = groups_of(self._episode)
        alone = set(range(self._episode.n)) - {int(j) for group in groups for j in group}
        self._learn([*groups, *(np.array([j]) for j in sorted(alone))])

    def _learn(self, groups: Iterable[Ints]) -> None:
        episode, mine = self._episode, self.beliefs
        truth = EpisodeArrays(episode.now, episode.estimate, episode.tracking, episode.totals, episode.sheet)
        mine.now.t[:], mine.now.C_AN[:] = truth.now.t[0], truth.now.C_AN[0]
        mine.sheet.possible_area[:], mine.sheet.sun_A[:] = truth.sheet.possible_area[0], truth.sheet.sun_A[0]
        mine.totals.target[:] = truth.totals.target[0]
        earthward = truth.totals.closed[0] & (truth.tracking.kind[0] == TargetKind.EARTH)
        area = episode.missions[episode.mission[0]].patches.cell_area
        for group in groups:
            among = np.ix_(group, group)
            parts: list[tuple[Any, Any]] = list(zip(mine, truth, strict=True))
            for believed, true in parts:
                for name in believed._fields:
                    ours, theirs = getattr(believed, name), getattr(true, name)
                    if ours.shape[:2] == (episode.n, episode.n) and name not in ("target", "seen", "first_by", "C_AN"):
                        ours[among] = theirs[0][group]
            seen = mine.totals.seen[group].any(axis=0) | np.isin(truth.totals.first_by[0], group)
            mine.totals.seen[group] = seen
            known = mine.totals.delivered[group].max()
            mine.totals.delivered[group] = truth.totals.delivered[0] if earthward[group].any() else known
            mine.totals.area[group] = area[seen[: len(area)]].sum()
        everyone = np.ones(episode.n, np.bool_)
        write_tables(episode.constants.tables, np.repeat(episode.mission[:1], episode.n), mine, everyone, self.tables)


def groups_of(episode: EpisodeState) -> list[Ints]:
    """Spacecraft of the first episode that hear one another, directly or through others, by the scenario's radios."""
    now, plan, n = episode.now, episode.missions[episode.mission[0]].plan, episode.n
    earth_N, none = plan.environment.earth.at(float(now.t[0])), np.zeros(n, np.int64)
    works = ~episode.totals.lost[0]
    instant = Instant(now.r[0], now.C_BN[0], now.C_AN[0], earth_N, none, none, works)
    return graph_at(radios_from(plan.scenario.link, plan.antennas.beams), occluder_of(plan.shape), instant).components
