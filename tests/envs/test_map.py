"""SwarmObserve-v0 with the whole body as its target: sphere patches, daylight that moves, tables in the body's own frame."""

import numpy as np
import pytest
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.tables import PAIRS, PATCHES

from swarm_mj.errors import ScenarioError
from swarm_mj.observation.capture import lit_cells
from swarm_mj.scenarios.loading import load_scenario

K = 24


@pytest.fixture(scope="module")
def scenario():
    """A map in coarse cells, whose maps of horizons are quickly made."""
    return load_scenario("bennu-map", {"target.cell_size_m": 120})


@pytest.fixture(scope="module")
def flown(scenario):
    """An episode in which everyone takes what is worth most, decision by decision: tables and new cells by instant."""
    episodes = Episodes(EnvConfig(scenario=scenario, target="body", patches=K, decision_s=120.0), 1)
    episodes.reset({0: 1})
    tables, dark = [episodes.entities()], 0
    mission = episodes.mission_of(0)
    taken = episodes.take_pictures

    def watched(due):
        nonlocal dark
        before = episodes.totals.seen[0].copy()
        taken(due)
        new, t = episodes.totals.seen[0] & ~before, float(episodes.now.t[0])
        sun_A = mission.plan.environment.C_AN(t) @ mission.plan.environment.sun.at(t)
        dark += int((new & ~lit_cells(mission.observer, mission.criterion, sun_A)).sum())

    episodes.take_pictures = watched
    for _ in range(120):
        pairs = tables[-1]["pairs"][0]
        worth = np.maximum(pairs[..., 0], 0.5 * pairs[..., 1])
        choice = np.where(worth.max(axis=1) > 0.0, worth.argmax(axis=1), pairs[..., 2].argmin(axis=1))
        result = episodes.fly(choice[None], np.ones(1, np.bool_))
        tables.append(episodes.entities())
        if result.end[0] or result.truncated[0]:
            break
    yield episodes, tables, dark
    episodes.close()


def test_a_swarm_maps_much_of_the_lit_body_and_no_cell_in_the_dark(flown):
    episodes, _, dark = flown
    region = episodes.mission_of(0).plan.region
    share = float(episodes.totals.area[0] / region.total_area)
    yardstick = float(episodes.sheet.yardstick_area[0] / region.total_area)
    assert dark == 0 and 0.15 < share <= yardstick < 1.0
    # Nobody sees what lies on the other side: cells were seen in all directions but from the night side.
    assert len({int(k) for k in episodes.mission_of(0).patches.of_cell[episodes.totals.seen[0]]}) > 12


def test_patches_of_the_table_cover_the_sphere_and_look_outwards(flown):
    episodes, tables, _ = flown
    patches, mission = tables[0]["patches"][0].astype(float), episodes.mission_of(0)
    place, normal = patches[:, 2:5] * mission.altitude_m, patches[:, 5:8]
    assert place == pytest.approx(mission.patches.centre_A, abs=1e-2)
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert ((place * normal).sum(axis=1) > 0.7 * np.linalg.norm(place, axis=1)).all()
    assert np.linalg.norm((patches[:, PATCHES.index("area")][:, None] * normal).sum(axis=0)) < 0.05 * K
    faces = np.argmax(np.abs(place), axis=1) * 2 + (place[np.arange(K), np.argmax(np.abs(place), axis=1)] < 0.0)
    assert faces.tolist() == np.repeat(np.arange(6), 4).tolist()


def test_only_patches_that_face_camera_and_sun_are_worth_a_picture(flown):
    episodes, tables, _ = flown
    mission, limit = episodes.mission_of(0), np.cos(np.radians(80.0))
    environment, compared, worthless = mission.plan.environment, 0, 0
    for k, table in enumerate(tables[:-12:8]):
        t = 120.0 * 8 * k + 60.0
        sun_A = environment.C_AN(t) @ environment.sun.at(t)
        incidence = table["patches"][0, :, 5:8] @ (sun_A / np.linalg.norm(sun_A))
        worth = table["pairs"][0, :, :, PAIRS.index("worth")]
        sure, unlit = np.abs(incidence - limit) > 1e-3, incidence < limit
        assert not worth[:, unlit & sure].any()
        compared, worthless = compared + (worth > 0.0).sum(), worthless + unlit.sum()
    assert compared > 20 and worthless > 20


def test_numbers_of_patches_that_do_not_divide_a_sphere_are_refused(scenario):
    with pytest.raises(ScenarioError, match="patches = 25: must be six times a square number"):
        Episodes(EnvConfig(scenario=scenario, target="body", patches=25, decision_s=120.0), 1).reset({0: 1})
