import numpy as np
import pytest

from swarm_mj.figures.drawing import composers
from swarm_mj.figures.run_figures import draw
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import add_coverage, observe_flight
from swarm_mj.smallbody.shape import ShapeModel
from tests.records.deliveries import with_delivery
from tests.records.estimates import with_pictures
from tests.records.thrusts import with_thrust


@pytest.fixture(scope="session")
def flown(quick_plan):
    telemetry = simulate(quick_plan)
    result = observe_flight(quick_plan, telemetry)
    add_coverage(telemetry, result)
    return with_delivery((quick_plan, with_pictures(with_thrust(telemetry)), result), mute=(0,), cell_bit=90_000)


@pytest.fixture(scope="session")
def composed(flown):
    """Every figure, laid out and rendered once."""
    figures = {name: compose(*flown) for name, compose in composers(flown[1]).items()}
    for figure in figures.values():
        figure.draw_without_rendering()
    return figures


@pytest.fixture(scope="session")
def written(flown, tmp_path_factory):
    """A folder with every figure, and one of them as PDF too."""
    folder = tmp_path_factory.mktemp("figures")
    for name in composers(flown[1]):
        draw(name, folder, *flown, pdf=name == "operation")
    return folder


@pytest.fixture(scope="session")
def cube():
    """A cube of 2 m about the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return ShapeModel(corners, np.array(faces), "cube")
