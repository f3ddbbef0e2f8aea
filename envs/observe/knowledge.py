"""What each spacecraft of an episode knows of the others where only what has reached it counts: `knowledge="graph"`.

At the end of every step all who hear one another, directly or through others, tell all they know; light takes milliseconds
between them. Who is out of reach stays in the others' minds as it was last heard of, and flies straight on from there. Who is
silent where it should be heard directly, by its place and the map of the body, is taken for lost. What agent i is shown are the
tables of an episode in which all is as i believes it to be.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.coordination.graph import Graph, graph_at
from swarm_mj.dataflow.contacts import Instant, radios_from
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import Tracking, no_estimate, no_kinematics
from .layout import Observed, observed_from
from .state import EpisodeState
from .table_kernels import write_tables
from .tables import EpisodeArrays, no_sheet, no_tables
from .totals import no_totals


class GraphKnowledge:
    """What the n spacecraft of one episode know: n beliefs about it, one a row.

    The episode is the first of the `EpisodeState` that is given, and has begun.

    Attributes:
        beliefs: How each believes all to stand.
    """

    def __init__(self, episode: EpisodeState) -> None:
        n, wheels = episode.n, episode.now.wheel.shape[2]
        self._episode, self.tables = episode, no_tables(n, n, episode.patches)
        self._plan = plan = episode.missions[episode.mission[0]].plan
        self._radios, self._body = radios_from(plan.scenario.link, plan.antennas), occluder_of(plan.shape)
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
        self._learn([np.arange(self._episode.n)], np.zeros((self._episode.n,) * 2, np.bool_))

    def tell(self) -> None:
        """Let those who hear one another now tell one another all they know; who hears nobody knows only itself."""
        episode, mine, lost = self._episode, self.beliefs.now, self._episode.totals.lost[0]
        # Without news a spacecraft is taken to fly straight on.
        mine.r[:] += mine.v * (episode.now.t[0] - mine.t[:, None, None])
        mine.r_A[:] = mine.r @ episode.now.C_AN[0].T
        silent = lost & ~self.beliefs.totals.lost & ~lost[:, None]
        for i in np.flatnonzero(silent.any(axis=1)):
            r_N = np.where(lost[:, None], mine.r[i], episode.now.r[0])
            silent[i] &= self._graph(r_N, np.ones(episode.n, np.bool_)).adjacency[i]
        groups = self._graph(episode.now.r[0], ~lost).components
        self._learn([*groups, *(np.array([j]) for j in np.flatnonzero(lost))], silent)

    def _graph(self, r_N: Array, works: Mask) -> Graph:
        """Who hears whom from these places, shape (n, 3) [m]."""
        episode, none = self._episode, np.zeros(self._episode.n, np.int64)
        earth_N = self._plan.environment.earth.at(float(episode.now.t[0]))
        at = Instant(r_N, episode.now.C_BN[0], episode.now.C_AN[0], earth_N, none, none, works)
        return graph_at(self._radios, self._body, at)

    def _learn(self, groups: Iterable[Ints], silent: Mask) -> None:
        """Let groups share what they know, and what each takes for lost, shape (n, n), because it should be heard."""
        episode, mine = self._episode, self.beliefs
        truth = EpisodeArrays(episode.now, episode.estimate, episode.tracking, episode.totals, episode.sheet)
        mine.now.t[:], mine.now.C_AN[:] = truth.now.t[0], truth.now.C_AN[0]
        for name in ("yardstick_area", "yardstick_bit", "sun_A"):
            getattr(mine.sheet, name)[:] = getattr(truth.sheet, name)[0]
        mine.totals.target[:] = truth.totals.target[0]
        area = episode.missions[episode.mission[0]].patches.cell_area
        for group in groups:
            # Who is silent told all that it had until then.
            known = np.union1d(group, np.flatnonzero(silent[group].any(axis=0)))
            among = np.ix_(group, known)
            parts: list[tuple[Any, Any]] = list(zip(mine, truth, strict=True))
            for believed, true in parts:
                for name in believed._fields:
                    ours, theirs = getattr(believed, name), getattr(true, name)
                    if ours.shape[:2] == (episode.n, episode.n) and name not in ("target", "seen", "first_by", "C_AN"):
                        ours[among] = theirs[0][known]
            seen = mine.totals.seen[group].any(axis=0) | np.isin(truth.totals.first_by[0], known)
            mine.totals.seen[group] = seen
            mine.totals.delivered[group] = mine.totals.delivered[group].max(axis=0)
            mine.totals.area[group] = area[seen[: len(area)]].sum()
        everyone = np.ones(episode.n, np.bool_)
        write_tables(episode.constants.tables, np.repeat(episode.mission[:1], episode.n), mine, everyone, self.tables)
