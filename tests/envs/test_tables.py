"""Tables and rewards of SwarmObserve-v0 against plain geometry in the target's frame, finite differences and sums."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.flybys import CROSSING_S, DURATION_S, EARTH_BIT_S, REACH
from swarm_mj.envs.observe.rewards import TERMS
from swarm_mj.envs.observe.tables import GENERAL, PAIRS, PATCHES, SPACECRAFT
from swarm_mj.envs.policies.baselines import greedy

#: One mission over a body that turns; who fails does so late.
MADE = {"missions": ["ellipsoid-train-1"], "randomise": {"loss": 0.0, "camera_off": 0.0, "spacecraft": 3}}


def part(table, names, *wanted):
    """Columns by name, in double precision."""
    return np.stack([table[..., names.index(name)].astype(float) for name in wanted], axis=-1)


@pytest.fixture(scope="module")
def flown():
    """Tables and terms of four episodes of the greedy rule, decision by decision."""
    episodes, live = Episodes(EnvConfig(**MADE), 4), np.ones(4, bool)
    episodes.reset({e: 40 + e for e in range(4)})
    tables, terms, facts = [episodes.entities()], [], [episodes.infos()]
    for _ in range(20):
        terms.append(episodes.step(greedy(tables[-1]), live).terms)
        tables.append(episodes.entities())
        facts.append(episodes.infos())
    mission = episodes.mission_of(0)
    episodes.close()
    return tables, terms, facts, mission


def test_velocities_are_the_rates_of_places_on_the_turning_body():
    episodes, live = Episodes(EnvConfig(**MADE | {"decision_s": 1.0}), 2), np.ones(2, bool)
    episodes.reset({0: 40, 1: 41})
    seen = []
    for _ in range(3):
        seen.append(episodes.entities()["spacecraft"])
        episodes.step(np.full((2, 3), 16), live)
    mission = episodes.mission_of(0)
    axes, centre, H = mission.axes_A, mission.centre_A, mission.altitude_m
    now = part(episodes.entities()["spacecraft"], SPACECRAFT, "east", "north", "up")[0]
    assert now == pytest.approx((episodes.now.r_A[0] - centre) @ axes.T / H, abs=1e-6)
    places = [part(table, SPACECRAFT, "east", "north", "up") for table in seen]
    rate = 0.5 * (places[2] - places[0]) * CROSSING_S
    assert part(seen[1], SPACECRAFT, "v_east", "v_north", "v_up") == pytest.approx(rate, abs=2e-4)
    episodes.close()


def test_the_worth_of_a_picture_is_its_area_and_its_pixels_ahead(flown):
    tables, _, _, mission = flown
    compared, H = 0, mission.altitude_m
    spin, middle = (
        mission.axes_A @ (0.0, 0.0, mission.plan.environment.spin_rate),
        mission.axes_A @ mission.centre_A / H,
    )
    for table in tables:
        spacecraft, patches, pairs, general = (table[name] for name in ("spacecraft", "patches", "pairs", "general"))
        r = part(spacecraft, SPACECRAFT, "east", "north", "up")
        v = part(spacecraft, SPACECRAFT, "v_east", "v_north", "v_up") / CROSSING_S
        centre, normal = part(patches, PATCHES, "east", "north", "up"), part(patches, PATCHES, *PATCHES[5:8])
        # Earth hears a volume that is known: the yardstick follows from its share.
        yardstick = EARTH_BIT_S * 20.0 / mission.nominal_bit / part(general, GENERAL, "heard")[:, 0]
        area = part(patches, PATCHES, "unseen", "area").prod(axis=-1) / 16.0 / yardstick[:, None]
        for ahead, name in ((10.0, "worth"), (30.0, "worth_next")):
            # Straight on among the stars, while the body turns.
            there = middle + r + ahead * (v + np.cross(spin, middle + r))
            there = Rotation.from_rotvec(-ahead * spin).apply(there.reshape(-1, 3)).reshape(r.shape) - middle
            way = there[:, :, None] - centre[:, None]
            distance = np.linalg.norm(way, axis=3)
            cosine = (way * normal[:, None]).sum(axis=3) / distance
            gsd = distance / np.maximum(cosine, 1e-3) / REACH
            worth = 4.0 * area[:, None] * (1.0 + cosine / distance**2) * (gsd <= 1.0)
            sure = abs(gsd - 1.0) > 1e-3
            assert part(pairs, PAIRS, name)[..., 0][sure] == pytest.approx(np.minimum(worth, 5.0)[sure], rel=1e-3)
            compared += (worth[sure] > 0.0).sum()
        mine = part(pairs, PAIRS, "worth")[..., 0]
        others = [np.delete(mine, j, axis=1).max(axis=1) for j in range(3)]
        assert np.array_equal(part(pairs, PAIRS, "others")[..., 0], np.stack(others, axis=1))
    assert compared > 100


def test_patches_that_are_or_come_in_reach_are_those_of_the_mask(flown):
    waits = 0
    for table in flown[0]:
        soon, peak = (part(table["pairs"], PAIRS, *names) for names in (("worth", "worth_next"), ("peak",)))
        assert np.array_equal(table["action_mask"][:, :, :16], peak[..., 0] > 0.0)
        assert (table["action_mask"][:, :, :16] >= (soon[..., :1] > 0.0).any(axis=-1)).all()
        waits += (table["action_mask"][:, :, :16] > (soon > 0.0).any(axis=-1)).sum()
        stored, downlink = (part(table["spacecraft"], SPACECRAFT, name)[..., 0] for name in ("stored", "downlink"))
        assert np.array_equal(table["action_mask"][:, :, 16], (stored > 0.0) & (downlink > 0.5))
    assert waits > 100


def test_rewards_add_up_to_what_was_seen_and_sent_over_the_yardsticks(flown):
    tables, terms, facts, _ = flown
    seen, delivered = (np.sum([term[:, TERMS.index(name)] for term in terms], axis=0) for name in ("seen", "delivered"))
    general = tables[-1]["general"]
    assert seen == pytest.approx(facts[-1]["coverage_percent"] / 100.0, abs=1e-9)
    assert part(general, GENERAL, "seen")[:, 0] == pytest.approx(seen, abs=1e-6)
    volume = EARTH_BIT_S * 20.0 / part(general, GENERAL, "heard")[:, 0]
    assert delivered == pytest.approx(facts[-1]["delivered_bit"] / volume, rel=1e-5)
    assert part(general, GENERAL, "delivered")[:, 0] == pytest.approx(delivered, rel=1e-5)
    stored = part(tables[-1]["spacecraft"], SPACECRAFT, "stored")[..., 0].sum(axis=1)
    assert stored == pytest.approx(facts[-1]["seen_bit"] / volume - delivered, abs=1e-5)  # nothing was lost
    assert (seen > 0.1).all() and (delivered > 0.05).any()
    assert part(general, GENERAL, "time_left")[:, 0] == pytest.approx(1.0 - 400.0 / DURATION_S)
