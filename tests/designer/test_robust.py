"""The fewest spacecraft for a probability: against enumeration of all designs and all losses."""

from itertools import combinations, product

import numpy as np
import pytest

from swarm_mj.designer.robust import Realisation, RobustSearch


def random_realisations(seed, *, n=8, cells=12, count=1, partly=False):
    """Random sightings of n candidates, realisations of a design problem that differ a little, with unequal chances of loss."""
    rng = np.random.default_rng(seed)
    base, area = rng.random((n, cells)) < 0.45, rng.uniform(0.5, 1.5, cells)
    found = []
    for _ in range(count):
        full = base ^ (rng.random((n, cells)) < (0.04 if count > 1 else 0.0))
        lost = full & (rng.random((n, cells)) < 0.3) if partly else np.zeros_like(full)
        found.append(Realisation(full, lost, rng.uniform(0.0, 0.3, n), area))
    return found


def by_enumeration(realisations, chosen, tolerance_percent):
    """P(S) as the sum over all that may be lost, with areas instead of whole units."""
    total = 0.0
    for full, lost, chance, area in realisations:
        for gone in product([False, True], repeat=len(chosen)):
            weight = np.prod([chance[j] if g else 1.0 - chance[j] for j, g in zip(chosen, gone, strict=True)])
            seen = np.any([lost[j] if g else full[j] for j, g in zip(chosen, gone, strict=True)], axis=0)
            total += weight * (100.0 * area[~seen].sum() / area.sum() <= tolerance_percent + 1e-9)
    return total / len(realisations)


def search_of(realisations, tolerance_percent, most=20):
    return RobustSearch(realisations=realisations, tolerance_percent=tolerance_percent, max_observers=most)


CASES = [
    {},
    {"partly": True},
    {"tolerance": 12.0},
    {"tolerance": 12.0, "partly": True},
    {"count": 3},
    {"count": 3, "partly": True, "tolerance": 5.0},
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_fewest_for_a_probability_equal_enumeration_of_all_designs_and_losses(case):
    given = {key: value for key, value in case.items() if key != "tolerance"}
    tolerance, feasible = case.get("tolerance", 0.0), 0
    for seed in range(6):
        realisations = random_realisations(seed, **given)
        search = search_of(realisations, tolerance)
        designs = [c for n in range(1, 9) for c in combinations(range(8), n)]
        chances = {c: by_enumeration(realisations, c, tolerance) for c in designs}
        assert search.bound >= max(chances.values()) - 1e-12
        for asked in (0.3, 0.6, 0.8, 0.95):
            least = min((len(c) for c, chance in chances.items() if chance >= asked), default=None)
            level = search.fewest(asked, 60.0)
            if least is None:
                assert level.points is None
                assert level.bound == 9
                continue
            feasible += 1
            assert len(level.points) == level.bound == least
            assert level.proven
            chosen = tuple(int(p) - 1 for p in level.points)
            assert level.promised == pytest.approx(chances[chosen], abs=1e-12)
            assert level.promised >= asked
    assert feasible >= 8
