"""Flights that have begun and are closed at the end of a test, whether or not it passes."""

import pytest

from .flights import Flights


@pytest.fixture
def begin():
    """Begin flights of a kind from three seeds; a single environment takes the first. Arguments are the environment's."""
    begun = []

    def begin(kind, *, seeds=(1, 2, 3), **arguments):
        begun.append(Flights(kind, **arguments))
        begun[-1].reset(*seeds)
        return begun[-1]

    yield begin
    for flights in begun:
        flights.close()
