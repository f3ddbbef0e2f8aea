"""The reward, term by term, and how an episode ends; `SwarmObserveEnv` has the table of terms.

Both terms are shares of what release, paths and light allow if nothing fails. They know nothing of failures to come, so that
neither does anybody who learns from them, and their sums do not depend on the length of a decision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Mask

from ..batch_env import StepOutcome
from .tables import EpisodeSheet
from .totals import EpisodeTotals


class RewardWeights(NamedTuple):
    """Weight of each term's measure, over yardsticks that follow from the release, see `SwarmObserveEnv`.

    Attributes:
        seen: Of newly seen area over the area that straight paths pass.
        delivered: Of data that Earth received over those of that area straight down from H.
    """

    seen: float = 1.0
    delivered: float = 1.0


#: Names of the terms in their order.
TERMS = RewardWeights._fields
#: How an episode can end by itself; 0 goes on.
ENDS = ("", "complete", "lost", "diverged", "horizon")
_COMPLETE, _LOST, _DIVERGED, _HORIZON = range(1, len(ENDS))
#: Share of the area that counts as complete by which sums may miss it for rounding.
ROUNDING = 1e-9


def no_result(count: int) -> StepOutcome:
    """Of a step of that many flights that nothing has come of."""
    nothing = np.zeros(count)
    return StepOutcome(np.zeros((count, len(TERMS))), nothing, np.zeros(count, np.int64), np.zeros(count, np.bool_))


def measures(totals: EpisodeTotals, sheet: EpisodeSheet) -> Array:
    """What E episodes have come to so far, over the yardsticks, in the order of `TERMS`, shape (E, terms)."""
    return np.stack([totals.area / sheet.yardstick_area, totals.delivered.sum(axis=1) / sheet.yardstick_bit], axis=1)


def write_ends(
    totals: EpisodeTotals, sheet: EpisodeSheet, finite: Mask, over: Mask, live: Mask, result: StepOutcome
) -> None:
    """Write `end` and `truncated` of the flights that began the step live, from what they have come to and what they are.

    `finite` are those with a finite state, `over` those that have flown for their whole duration; masks are of shape (E,).
    """
    flies = ~totals.lost
    sent = np.where(flies, totals.stored, 0.0).sum(axis=1) < 1.0
    complete = (totals.area >= sheet.complete_area * (1.0 - ROUNDING)) & sent
    end = np.select([~finite, complete, ~flies.any(axis=1)], [_DIVERGED, _COMPLETE, _LOST], 0)
    result.end[live], result.truncated[live] = end[live], (over & (end == 0))[live]


def horizon_ended(result: StepOutcome) -> StepOutcome:
    """The same with flights that are over by their duration reported as ended, not as truncated."""
    end = np.where(result.truncated, _HORIZON, result.end)
    return result._replace(end=end, truncated=np.zeros_like(result.truncated))
