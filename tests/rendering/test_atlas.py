"""What is painted on the body: borders of faces, where faces are cut into cells."""

import numpy as np
import pytest

from swarm_mj.flight.plan import make_plan
from swarm_mj.rendering.model import BORDER, MARGIN, Atlas
from swarm_mj.rendering.palette import GROUND, UNSEEN_BORDER
from swarm_mj.scenarios.loading import load_scenario


@pytest.fixture(scope="module")
def region():
    """A target whose larger faces are cut into several cells."""
    return make_plan(load_scenario("eros-quick", {"target.cell_size_m": 600})).region


def outline(region, group):
    """Ends of the sides of cells of a face that no other cell of it shares, shape (k, 2, 3) [m]."""
    sides = {}
    for face in region.faces[region.target[region.group == group]]:
        for start, end in zip(face, np.roll(face, -1), strict=True):
            sides.setdefault(frozenset((int(start), int(end))), []).append((start, end))
    return region.vertices[[found[0] for found in sides.values() if len(found) == 1]]


def distance_to(segments, points):
    """Distances of points (m, 3) from the nearest of segments (k, 2, 3), shape (m,)."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = np.einsum("mki,ki->mk", points[:, None] - start, way) / np.einsum("ki,ki->k", way, way)
    foot = start + np.clip(share, 0.0, 1.0)[..., None] * way
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def test_a_border_is_as_wide_in_every_cell_of_a_face_also_in_those_that_touch_it_with_a_corner_alone(region):
    assert np.bincount(region.group).max() >= 4
    atlas = Atlas(region)
    columns = int(np.ceil(np.sqrt(region.n_cells + 1)))
    tile = atlas.width // columns
    width = BORDER * np.sqrt(region.total_area / region.n_faces)
    row, column = (axis.ravel() for axis in np.mgrid[0:tile, 0:tile])
    second, third = ((axis + 0.5 - MARGIN) / (tile - 2.0 * MARGIN) for axis in (column, row))
    inside = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0)
    shares = np.stack((1.0 - second - third, second, third), axis=1)[inside]
    for cell in np.flatnonzero(np.bincount(region.group)[region.group] >= 4):
        top, left = (tile * place for place in divmod(int(cell), columns))
        painted = atlas.image[top : top + tile, left : left + tile].reshape(-1, 3)[inside]
        expected = distance_to(outline(region, region.group[cell]), shares @ region.corners_A[cell]) < width
        assert np.array_equal(painted, np.where(expected[:, None], UNSEEN_BORDER, GROUND)), cell


def test_only_cells_that_change_are_painted_anew(region):
    atlas = Atlas(region)
    before, seen = atlas.image.copy(), np.zeros(region.n_cells, bool)
    assert not atlas.show(seen)
    seen[3] = True
    assert atlas.show(seen)
    changed = (atlas.image != before).any(axis=2)
    tile = atlas.width // int(np.ceil(np.sqrt(region.n_cells + 1)))
    assert changed[:tile, 3 * tile : 4 * tile].all() and changed.sum() == tile**2
    seen[3] = False
    assert atlas.show(seen) and np.array_equal(atlas.image, before)
