"""The MuJoCo model of a swarm of spacecraft from a file of one's own: nothing of the file is taken out.

N copies of the file stand around the body, each under its prefix. The file's options hold (contacts, constraints, solver, a
medium), but for these: RK4 with the scenario's timestep, no uniform gravity, and no reset after a divergence. Spacecraft do not
touch each other: all of a swarm leave the mothership from one point.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import mujoco
import numpy as np

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.elastic import largest_timestep
from swarm_mj.spacecraft.elements import joints_of, name_of, qvel_indices, subtree_of
from swarm_mj.spacecraft.layout import Layout, resolve_layout, spacecraft_names
from swarm_mj.spacecraft.model import SwarmModel, scene
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft, load_part, small_motions
from swarm_mj.spacecraft.template import compile_spec
from swarm_mj.typing import Ints

#: A swarm of more bodies: the model is compiled for hours.
MAX_BODIES = 20_000
#: Pairs of bodies that are kept from touching, at most.
MAX_EXCLUDES = 200_000
#: What the file's options do not decide.
_OURS = mujoco.mjtDisableBit.mjDSBL_GRAVITY | mujoco.mjtDisableBit.mjDSBL_AUTORESET


def build_own_model(
    n: int, own: OwnSpacecraft, *, shape: ShapeModel, timestep: float, sun_N: Sequence[float] = (1.0, 0.0, 0.0)
) -> SwarmModel:
    """Assemble and compile n spacecraft of one's own around a body.

    Args:
        n: Number of spacecraft, at least 1.
        own: What was read of the file.
        shape: The body's mesh in A [m].
        timestep: Integration step [s].
        sun_N: Direction to the Sun in N; lights the scene.

    Raises:
        MissionError: MuJoCo cannot build it, or the file has changed meanwhile.
        ScenarioError: The timestep is too long for its springs, or the swarm too large.
    """
    if n < 1:
        raise MissionError(f"a swarm needs at least one spacecraft, not {n}")
    part = load_part(own.path)
    alone = compile_spec(part.copy())
    _check_timestep(own, timestep)
    _check_size(alone, own, n)
    names = spacecraft_names(n)
    spec = scene(shape, timestep, np.asarray(sun_N, float))
    _take_options(spec, part)
    for key in list(part.keys):
        part.delete(key)  # `OwnSpacecraft` has read the start; keyframes of a swarm would be of another length
    for name in names:
        spec.attach(part.copy(), frame=spec.worldbody.add_frame(), prefix=f"{name}_")
    _keep_apart(spec, alone, names)
    model = compile_spec(spec)
    layout = resolve_layout(model, names, hub=own.hub, wheels=own.wheels)
    _check_copies(model, alone, layout, own)
    return SwarmModel(
        mjmodel=model,
        names=names,
        layout=layout,
        asteroid_mocap=int(model.body("asteroid").mocapid[0]),
        properties=own.properties,
        own=own,
    )


def _check_timestep(own: OwnSpacecraft, timestep: float) -> None:
    modes = small_motions(own)
    if (limit := largest_timestep(modes)) <= timestep:
        fastest = modes[0]
        raise ScenarioError(
            f"physics.timestep_s = {timestep:g}: joint {fastest.joint} of {own.path} moves with {fastest.frequency_hz:.3g} Hz "
            f"(eigenvalue {fastest.eigenvalue:.3g} 1/s), which RK4 cannot follow: must be less than {limit:.3g}, and a fifth "
            "of that to be exact"
        )


def _check_size(alone: mujoco.MjModel, own: OwnSpacecraft, n: int) -> None:
    bodies = alone.nbody - 1
    if n * bodies > MAX_BODIES:
        raise ScenarioError(
            f"spacecraft.mjcf = {own.path}: {n} spacecraft of {bodies} bodies: at most {MAX_BODIES} bodies (MAX_BODIES)"
        )


def _take_options(spec: mujoco.MjSpec, part: mujoco.MjSpec) -> None:
    """Fly by the options of the file, but for those that are the scenario's."""
    timestep, integrator = float(spec.option.timestep), int(spec.option.integrator)
    spec.option = part.option
    for option in (spec.option, part.option):  # attaching warns when parent and child differ
        option.timestep, option.integrator, option.gravity = timestep, integrator, np.zeros(3)
        option.disableflags = int(option.disableflags) | int(_OURS)


def _keep_apart(spec: mujoco.MjSpec, alone: mujoco.MjModel, names: Sequence[str]) -> None:
    """Exclude contacts between different spacecraft.

    Raises:
        ScenarioError: There are too many pairs.
    """
    touching = sorted({int(alone.geom_bodyid[g]) for g in np.flatnonzero(alone.geom_contype | alone.geom_conaffinity)})
    if alone.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        return
    bodies = [name_of(alone, "body", body) for body in touching]
    if len(names) * (len(names) - 1) // 2 * len(bodies) ** 2 > MAX_EXCLUDES:
        raise ScenarioError(
            f"{len(names)} spacecraft with {len(bodies)} bodies each that may touch: too many pairs to keep apart; give geoms "
            'that need not touch contype="0" and conaffinity="0", or disable contact in the file\'s option'
        )
    for one, other in combinations(names, 2):
        for a in bodies:
            for b in bodies:
                spec.add_exclude(name=f"{one}_{a}-{other}_{b}", bodyname1=f"{one}_{a}", bodyname2=f"{other}_{b}")


#: What must be the same in every copy, by what it belongs to.
_BY_BODY = (
    "body_mass",
    "body_inertia",
    "body_pos",
    "body_quat",
    "body_ipos",
    "body_iquat",
    "body_jntnum",
    "body_geomnum",
)
_BY_JOINT = ("jnt_type", "jnt_pos", "jnt_axis", "jnt_stiffness", "jnt_limited", "jnt_range")
_BY_DOF = ("dof_damping", "dof_armature", "dof_frictionloss")
_COUNTS = ("nu", "na", "nsensor", "nsensordata", "neq", "ntendon", "npair", "ngeom")


def _check_copies(model: mujoco.MjModel, alone: mujoco.MjModel, layout: Layout, own: OwnSpacecraft) -> None:
    """See that every copy is the spacecraft of the file.

    Raises:
        MissionError: One is not: MuJoCo has merged or changed something on the way.
    """
    bodies = list(subtree_of(alone, alone.body(own.hub).id))
    joints = [j for body in bodies for j in joints_of(alone, body)]
    theirs = np.array([[j for body in row for j in joints_of(model, int(body))] for row in layout.bodies])
    scene_geoms = int((model.geom_bodyid == model.body("asteroid").id).sum())
    found = {name: getattr(model, name) - (scene_geoms if name == "ngeom" else 0) for name in _COUNTS}
    wrong = [name for name in _COUNTS if found[name] != len(layout.hub_body) * getattr(alone, name)]
    for names, rows, row in ((_BY_BODY, layout.bodies, bodies), (_BY_JOINT, theirs, joints)):
        wrong += [name for name in names if rows.shape[1] != len(row) or not _same(model, alone, name, rows, row)]
    dofs = [k for j in joints for k in qvel_indices(alone, j)]
    wrong += [name for name in _BY_DOF if not _same(model, alone, name, layout.all_qvel, dofs)]
    if wrong:
        raise MissionError(
            f"spacecraft.mjcf = {own.path}: in a swarm MuJoCo builds it otherwise than alone ({', '.join(wrong)}); leave out "
            "compiler options that merge or drop parts (fusestatic, discardvisual)"
        )


def _same(model: mujoco.MjModel, alone: mujoco.MjModel, name: str, rows: Ints, row: list[int]) -> bool:
    ours, theirs = getattr(model, name)[rows], getattr(alone, name)[row]
    return bool(ours.shape[1:] == theirs.shape and np.allclose(ours, theirs, rtol=1e-12, atol=1e-15))
