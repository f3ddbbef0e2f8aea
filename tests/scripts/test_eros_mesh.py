"""A mesh of Eros for the measured pages flies in the field of the packaged body."""

import numpy as np

from scripts.pages.eros_mesh import eros_at
from swarm_mj.flight.environment import environment_from
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.shape_harmonics import load_eros
from swarm_mj.smallbody.shape_io import load_shape


def test_a_coarse_eros_attracts_as_the_packaged_one(tmp_path):
    shape, overrides = eros_at(10, tmp_path)
    assert len(shape.faces) == 2_000 and len(load_shape(tmp_path / "eros-10.obj").faces) == 2_000
    r_A = np.random.default_rng(0).normal(size=(20, 3)) * 2e4 + 1e4
    sampled, packaged = (
        environment_from(load_scenario("eros-config1", changes), mesh).gravity.acceleration(r_A)
        for changes, mesh in ((overrides, shape), ({}, load_eros()))
    )
    np.testing.assert_array_equal(sampled, packaged)
