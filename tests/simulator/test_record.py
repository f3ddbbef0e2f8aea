"""A flight between two distant samples: in slices, so that it can be interrupted and followed, and the same to the bit."""

import numpy as np
import pytest

from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator import simulation as recording


@pytest.fixture(scope="module")
def plan():
    return make_plan(load_scenario("eros-quick"))


@pytest.fixture
def slow_world(monkeypatch):
    """A clock that every look at it puts forward: each slice seems to take its time."""

    class Clock:
        now = 0.0

        @classmethod
        def perf_counter(cls):
            cls.now += recording.SLICE_S
            return cls.now

    monkeypatch.setattr(recording, "time", Clock)


def test_a_flight_in_slices_is_the_same_to_the_bit(plan, slow_world):
    whole, sliced = make_simulation(plan), make_simulation(plan)
    whole.fly(1200)
    told = []
    sliced.run(600.0, 600.0, told.append)
    assert np.array_equal(whole.state.r_N, sliced.state.r_N) and np.array_equal(whole.state.q_BN, sliced.state.q_BN)
    assert len(told) > 1200 / 64 and told == sorted(told)


def test_what_interrupts_a_long_flight_is_heard_before_the_next_sample(plan, slow_world, monkeypatch):
    simulation = make_simulation(plan)
    checks = iter(range(100))

    def check():
        if next(checks) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(recording.interruption, "check", check)
    with pytest.raises(KeyboardInterrupt):
        simulation.run(600.0, 600.0)
    assert 0 < simulation.tick <= 3 * 64 + 1
