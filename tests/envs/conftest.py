"""What several tests of the environments need: the environment at the level `role`, flights that have begun, a policy."""

import gymnasium
import pytest

from swarm_mj.observation.gl_context import gl_available

from .flights import ID, Flights, random_network


@pytest.fixture(scope="session")
def roles():
    """The environment of `eros-observe` at the level `role`, which many tests reset."""
    env = gymnasium.make(ID).unwrapped
    yield env
    env.close()


@pytest.fixture(scope="session")
def gl():
    """Skip where there is no OpenGL."""
    available, reason = gl_available()
    if not available:
        pytest.skip(reason)


@pytest.fixture
def begin():
    """Begin flights of a kind from three seeds, closed at the end of the test whether or not it passes.

    A single environment takes the first seed. Arguments are the environment's.
    """
    begun = []

    def begin(kind, *, seeds=(1, 2, 3), **arguments):
        begun.append(Flights(kind, **arguments))
        begun[-1].reset(*seeds)
        return begun[-1]

    yield begin
    for flights in begun:
        flights.close()


@pytest.fixture(scope="session")
def random_policy(roles):
    """A policy of a random network."""
    return random_network(roles.task)
