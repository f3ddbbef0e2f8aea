"""Who points at what: the rules of the paper, row by row."""

import numpy as np
import pytest

from swarm_mj import plugins
from swarm_mj.errors import MissionError, PluginError
from swarm_mj.mission.behaviors import (
    STRONGEST_PULL,
    AdaptableRoles,
    DedicatedCommunications,
    SwarmView,
    TargetKind,
    elect_medoid,
)

INSIDE, OUTSIDE = 30e3, 40e3


def view(*radii):
    r = np.zeros((len(radii), 3))
    r[:, 0] = radii
    return SwarmView(0.0, r, np.zeros_like(r), np.eye(3))


def test_configuration_1_observers_turn_to_the_relay_outside_and_the_relay_to_earth_always():
    behavior = DedicatedCommunications(3, 35e3)
    targets, memory = behavior.targets(view(INSIDE, OUTSIDE, INSIDE, INSIDE), None)
    kinds = [TargetKind.ASTEROID, TargetKind.SPACECRAFT, TargetKind.ASTEROID, TargetKind.EARTH]
    assert targets.kind.tolist() == kinds
    assert targets.spacecraft[1] == 3
    targets, _ = behavior.targets(view(OUTSIDE, OUTSIDE, OUTSIDE, OUTSIDE), memory)
    assert targets.kind.tolist() == [TargetKind.SPACECRAFT] * 3 + [TargetKind.EARTH]


def test_configuration_2_all_observe_inside_and_the_first_relays_outside():
    behavior = AdaptableRoles(3, 35e3)
    targets, memory = behavior.targets(view(INSIDE, INSIDE, INSIDE), None)
    assert targets.kind.tolist() == [TargetKind.ASTEROID] * 3
    assert memory is None
    targets, memory = behavior.targets(view(OUTSIDE, INSIDE, OUTSIDE), memory)
    assert targets.kind.tolist() == [TargetKind.EARTH, TargetKind.ASTEROID, TargetKind.SPACECRAFT]
    assert targets.spacecraft[2] == 0


def test_the_imaging_radius_itself_counts_as_inside():
    targets, _ = DedicatedCommunications(1, 35e3).targets(view(35e3, 35e3), None)
    assert targets.kind[0] == TargetKind.ASTEROID


def test_the_medoid_is_elected_once_when_the_first_leaves_and_stays():
    behavior = AdaptableRoles(4, 35e3, election="medoid")
    positions = view(31e3, 33e3, 34e3, 36e3)
    targets, memory = behavior.targets(positions, None)
    assert memory == elect_medoid(positions.r_BN_N) == 1
    assert targets.spacecraft[3] == 1
    # Later the middle is elsewhere, but the election is over.
    targets, memory = behavior.targets(view(60e3, 36e3, 61e3, 62e3), memory)
    assert memory == 1
    assert targets.kind[1] == TargetKind.EARTH


def test_the_medoid_minimises_the_sum_of_distances():
    rng = np.random.default_rng(0)
    for _ in range(20):
        r = rng.normal(size=(7, 3))
        sums = [sum(np.linalg.norm(a - b) for b in r) for a in r]
        assert elect_medoid(r) == int(np.argmin(sums))


def test_behaviors_do_not_touch_what_they_returned_before():
    behavior = DedicatedCommunications(2, 35e3)
    first, memory = behavior.targets(view(INSIDE, INSIDE, INSIDE), None)
    copy = first.kind.copy()
    behavior.targets(view(OUTSIDE, OUTSIDE, OUTSIDE), memory)
    assert np.array_equal(first.kind, copy)


def test_an_unknown_election_and_an_unknown_behavior_name_what_exists():
    with pytest.raises(MissionError, match="first, medoid"):
        AdaptableRoles(3, 35e3, election="loudest")
    with pytest.raises(PluginError, match="adaptable_roles, body_tracking, dedicated_communications, .*target_sweep"):
        plugins.find(plugins.BEHAVIORS, "nobody")
    with pytest.raises(PluginError, match="volume"):
        plugins.create(plugins.BEHAVIORS, "adaptable_roles", {"volume": 3}, 5, 35e3)
    with pytest.raises(PluginError, match=r"parameters\.surface_radius_m is missing: must be given"):
        plugins.create(plugins.BEHAVIORS, "target_sweep", {"rows": 3}, 5, 35e3)


@pytest.mark.parametrize("kind", [DedicatedCommunications, AdaptableRoles])
def test_an_answer_lasts_as_long_as_the_behavior_says(kind):
    """Straight and strongly pulled passages: the first change comes after the time given, and not long after it."""
    rng = np.random.default_rng(4)
    behavior, n = kind(3, 20e3), 4 if kind is DedicatedCommunications else 3
    tight = []
    for _ in range(200):
        r, v = rng.normal(0, 15e3, (n, 3)), rng.normal(0, 30.0, (n, 3))
        pull = rng.normal(0, 1, (n, 3))
        pull *= rng.uniform(0, STRONGEST_PULL, (n, 1)) / np.linalg.norm(pull, axis=1, keepdims=True)
        start = SwarmView(0.0, r, v, np.eye(3))
        before, memory = behavior.targets(start, None)
        lasts = behavior.steady_for(start, memory)
        assert lasts >= 0
        times = np.linspace(0.0, 6.0 * lasts + 1e-3, 300)
        changed = []
        for t in times:
            then = SwarmView(t, r + t * v + 0.5 * t * t * pull, v + t * pull, np.eye(3))
            after, kept = behavior.targets(then, memory)
            same = kept == memory and all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
            assert same or t >= lasts
            changed.append(not same)
        if any(changed):
            tight.append(lasts / times[np.argmax(changed)])
    assert len(tight) > 20
    assert max(tight) > 0.5
