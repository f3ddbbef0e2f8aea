"""Stepping of swarms against `mj_step`, and what may not be left out where a model holds more than free bodies."""

import mujoco
import numpy as np
import pytest

from swarm_mj.errors import SimulationError
from swarm_mj.simulator.fast import c_functions
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.simulator.fast.mj_memory import MJ_STEP, STAGED, STAGED_CONSTANT_INERTIA
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft import template
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties

N = 3


@pytest.fixture(scope="module")
def tetrahedron():
    vertices = 1e3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return ShapeModel(vertices, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def tumbling(swarm):
    """Spacecraft that tumble with fast wheels under motor torques, forces and torques."""
    rng, model, data = np.random.default_rng(7), swarm.mjmodel, mujoco.MjData(swarm.mjmodel)
    wheels = swarm.properties.n_wheels
    qpos, qvel = np.zeros((N, 7 + wheels)), rng.normal(scale=50.0, size=(N, 6 + wheels))
    qpos[:, :3], qpos[:, 3:7] = rng.normal(scale=20e3, size=(N, 3)), rng.normal(size=(N, 4))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    qvel[:, :3], qvel[:, 3:6] = rng.normal(scale=10.0, size=(N, 3)), rng.normal(scale=0.05, size=(N, 3))
    swarm.set_state(data, qpos, qvel)
    data.ctrl[:] = rng.uniform(-6e-3, 6e-3, model.nu)  # beyond the limit of 4 mN m, too
    data.xfrc_applied[swarm.hub_body] = rng.normal(scale=1e-3, size=(N, 6))
    return data


def method_of(swarm):
    """How a swarm is stepped."""
    return Integrator(swarm, mujoco.MjData(swarm.mjmodel)).batch[0]["method"]


def stepped(swarm, steps, method=None):
    data = tumbling(swarm)
    integrator = Integrator(swarm, data)
    if method is not None:
        integrator.batch["method"] = method
    integrator.step(steps)
    return data


def largest_difference(swarm, ours, theirs):
    """Of positions and quaternions, and of velocities and body rates; angles and speeds of wheels apart, for they are large."""
    width = 7 + swarm.properties.n_wheels
    q, v = np.abs(ours.qpos - theirs.qpos).reshape(N, width), np.abs(ours.qvel - theirs.qvel).reshape(N, width - 1)
    return max(q[:, :7].max(), v[:, :6].max()), max(q[:, 7:].max(), v[:, 6:].max())


@pytest.mark.parametrize("method", [STAGED, STAGED_CONSTANT_INERTIA])
@pytest.mark.parametrize("layout", ["orthogonal", "pyramid"])
def test_the_step_is_that_of_mj_step_to_rounding(tetrahedron, layout, method):
    swarm = build_model(N, shape=tetrahedron, properties=SpacecraftProperties(wheel_layout=layout))
    assert method_of(swarm) == STAGED_CONSTANT_INERTIA
    theirs = tumbling(swarm)
    mujoco.mj_step(swarm.mjmodel, theirs, nstep=40)
    ours = stepped(swarm, 40, method)
    body, wheels = largest_difference(swarm, ours, theirs)
    assert body < 1e-9 and wheels < 1e-8
    assert ours.time == pytest.approx(theirs.time)


def _off_balance(part):
    """A wheel whose centre of mass is off its axis: the inertia matrix then turns with it."""
    part.body("wheel_y").ipos = [0.002, 0.0, 0.0]


def _off_centre(part):
    """A hub whose centre of mass is off the free joint."""
    part.body("cubesat").ipos = [0.0, 0.01, 0.0]


@pytest.mark.parametrize("disturb", [_off_balance, _off_centre])
def test_an_inertia_that_depends_on_the_state_is_found_anew_at_every_stage(tetrahedron, disturb, monkeypatch):
    make_part = template._cubesat

    def made(*arguments):
        part = make_part(*arguments)
        disturb(part)
        return part

    monkeypatch.setattr(template, "_cubesat", made)
    monkeypatch.setattr(template, "examine_spacecraft", lambda *arguments: [])  # the guard refuses such a spacecraft
    swarm = build_model(N, shape=tetrahedron)
    assert method_of(swarm) == STAGED
    theirs = tumbling(swarm)
    mujoco.mj_step(swarm.mjmodel, theirs, nstep=40)
    assert largest_difference(swarm, stepped(swarm, 40), theirs)[0] < 1e-9
    # That it matters at all:
    assert largest_difference(swarm, stepped(swarm, 40, STAGED_CONSTANT_INERTIA), theirs)[0] > 1e-6


def _damp(model):
    model.dof_damping[8] = 1e-6


def _spring(model):
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SPRING)
    model.jnt_stiffness[1] = 1e-4


def _air(model):
    model.opt.density = 1.2


def _euler(model):
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER


def _contacts(model):
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _back_emf(model):
    model.actuator_biastype[0] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[0, 2] = -1e-5


@pytest.mark.parametrize("add", [_damp, _spring, _air, _euler, _contacts, _back_emf])
def test_a_model_in_which_anything_else_acts_is_stepped_by_mj_step(tetrahedron, add):
    swarm = build_model(N, shape=tetrahedron)
    plain = stepped(swarm, 40).qvel.copy()
    add(swarm.mjmodel)
    assert method_of(swarm) == MJ_STEP
    theirs = tumbling(swarm)
    mujoco.mj_step(swarm.mjmodel, theirs, nstep=40)
    ours = stepped(swarm, 40)
    assert np.array_equal(ours.qvel, theirs.qvel) and ours.time == theirs.time
    if add is not _contacts:
        assert not np.allclose(ours.qvel, plain, rtol=0, atol=1e-9)


def test_callbacks_are_called(tetrahedron):
    swarm, calls = build_model(N, shape=tetrahedron), []
    mujoco.set_mjcb_passive(lambda model, data: calls.append(data.time))
    try:
        stepped(swarm, 2)
    finally:
        mujoco.set_mjcb_passive(None)
    assert len(calls) == 8


def test_gyrostats_among_which_something_else_acts_are_refused(tetrahedron):
    swarm = build_model(N, shape=tetrahedron, wheels="gyrostat")
    _damp(swarm.mjmodel)
    with pytest.raises(
        SimulationError, match=r"physics\.wheels = gyrostat.*sc2_free: a damper.*physics\.wheels: bodies"
    ):
        Integrator(swarm, mujoco.MjData(swarm.mjmodel))


def test_a_model_without_geometry_moves_the_same(tetrahedron):
    for wheels in ("bodies", "gyrostat"):
        seen, bare = (build_model(N, shape=tetrahedron, wheels=wheels, geometry=shown) for shown in (True, False))
        assert seen.mjmodel.ngeom > 0 and seen.mjmodel.ncam > 0 and seen.mjmodel.nsensor > 0
        assert bare.mjmodel.ngeom == bare.mjmodel.ncam == bare.mjmodel.nsensor == bare.mjmodel.nmesh == 0
        one, other = stepped(seen, 20), stepped(bare, 20)
        assert np.array_equal(one.qpos, other.qpos) and np.array_equal(one.qvel, other.qvel)


def test_a_missing_library_is_named_with_where_it_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(c_functions.mujoco, "__file__", str(tmp_path / "mujoco/__init__.py"))
    monkeypatch.setattr(c_functions.sys, "prefix", str(tmp_path / "prefix"))
    with pytest.raises(SimulationError, match=r"MuJoCo's library.*mujoco.*prefix/lib"):
        c_functions.load_mujoco.__wrapped__()
    (tmp_path / "prefix/lib").mkdir(parents=True)
    (tmp_path / "prefix/lib/libmujoco.so.4").write_text("not a library")
    with pytest.raises(RuntimeError):
        c_functions.load_mujoco.__wrapped__()
