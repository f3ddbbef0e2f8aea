"""The sliding mode law over a whole flight against an independent integration of its equations."""

import pytest

from swarm_mj.verification.control import largest_angle, slew
from swarm_mj.verification.experiment import Bench


@pytest.mark.slow
def test_the_sliding_mode_flight_of_ten_minutes_is_what_its_equations_give():
    flight = slew(Bench(), 600.0)
    assert len(flight.time) == 1201
    assert largest_angle(flight, 600.0) < 1e-6
