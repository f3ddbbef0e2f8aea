"""What the GPU's flights are given by the processor: what they share, and prepared starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.simulator.fast.flights import NEVER, Flights
from swarm_mj.simulator.fast.plain_data import PlainData, size
from swarm_mj.simulator.fast.world import law_of, make_world
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.spacecraft.control.compiled import CompiledLaw
from swarm_mj.spacecraft.model import NQ, NV

from ..observe.actions import RoleLevel
from ..observe.batch import EpisodeBatch
from ..observe.kinematics import AttitudeEstimate, Kinematics, no_kinematics
from ..observe.rewards import no_outcome
from ..observe.task import Task
from ..observe.totals import EpisodeTotals
from .flight import Answer, Constants, Hold, Memory, Plain


def check_task(task: Task) -> CompiledLaw:
    """The control law of a task that the GPU can fly.

    Raises:
        ScenarioError: It cannot; the message names what is in the way.
    """
    config, simulation = task.config, task.simulation
    if config.control != "role":
        raise ScenarioError(f"control = {config.control!r}: flights on the GPU are steered by role; use control='role'")
    if simulation.stepper != "kernel":
        raise ScenarioError(
            f"physics.stepper = {simulation.stepper}: flights on the GPU are stepped by kernel, with physics.wheels: gyrostat"
        )
    if why := simulation.why_not_compiled(task.plan.controller):
        raise ScenarioError(f"the GPU cannot fly {why}; fly on the processor, or leave it out")
    if simulation.injection is not None:
        raise ScenarioError(
            "the GPU cannot fly faults, dispersions or a fourth wheel; fly on the processor, or leave them out"
        )
    state = simulation.state
    if type(state.environment.gravity) is Polyhedron:
        raise ScenarioError(
            "the GPU cannot fly in the field of a polyhedron; use body.gravity.model: spherical_harmonics"
        )
    if task.scene is None or task.criterion.needs_sun:
        raise ScenarioError(
            "the GPU judges pictures by horizon maps alone: use observer='horizon', and no observation.max_incidence_deg, "
            "shadows, max_smear_px or whole cells"
        )
    law = law_of(task.plan.controller)
    assert law is not None  # else Python would fly
    return law


def constants_of(task: Task, level: RoleLevel) -> Constants:
    """What all flights of a task share."""
    state = task.simulation.state
    model = state.model
    assert task.scene is not None
    return Constants(
        world=make_world(state, task.plan.controller)._replace(law=1),
        hold=Hold(
            first_hub=int(model.hub_body[0]),
            timestep=float(model.mjmodel.opt.timestep),
            spin_inertia=float(model.properties.wheel_spin_inertia),
            body_mass=model.mjmodel.body_mass,
            body_inertia=model.mjmodel.body_inertia,
            ctrlrange=model.mjmodel.actuator_ctrlrange,
            wheel_axes_B=model.properties.wheel_axes_B,
        ),
        rotation=task.body_rotation,
        scene=task.scene,
        pictures=task.picture_constants,
        step=task.step_constants(continues_after_impact=False),
        choices=level.choices,
        is_due=task.is_due,
        timesteps=int(state.timesteps),
        ticks=task.ticks,
        last_tick=task.last_tick,
        horizon_terminates=bool(task.config.horizon_terminates),
    )


def memory_of(batch: EpisodeBatch) -> Memory:
    """The one flight of a batch as a device remembers it, copied."""
    state, model = batch.get_state(0), batch.task.simulation.state.model
    rows = [np.asarray(row)[None] for row in state["rows"]]
    taken = iter(rows)

    def take(kind: Any) -> Any:
        return kind(*(next(taken).copy() for _ in kind._fields))

    totals, _, now, estimate = (take(kind) for kind in (EpisodeTotals, Kinematics, Kinematics, AttitudeEstimate))
    own = [np.asarray(row)[None].copy() for row in state["flight"]["rows"]]
    flights, blind = Flights(*own[: len(Flights._fields)]), own[-1]
    data = PlainData(model.mjmodel, np.zeros(size(model.mjmodel)))
    data.numbers[:] = state["flight"]["own"]["data"]
    parts = (data.qpos, data.qvel, data.act, data.ctrl, data.xfrc_applied, data.mocap_quat[model.asteroid_mocap])
    before = Kinematics(*(array.copy() for array in now))
    n = model.n
    return Memory(
        flights=flights,
        qpos=flights.qpos.reshape(1, n, NQ),
        qvel=flights.qvel.reshape(1, n, NV),
        plain=Plain(*(part[None].copy() for part in parts)),
        blind=blind,
        before=before,
        now=now,
        estimate=estimate,
        totals=totals,
        observation=rows[-1].copy(),
    )


def no_answer(task: Task) -> Answer:
    """Of one flight before its first step."""
    n, cells, samples = task.plan.n, task.plan.region.n_cells, 1
    if task.scene is not None:
        samples = task.scene.horizon.points.shape[1]
    observation = np.zeros((1, *task.observation_layout.space.shape), np.float32)
    outcome, wheels = no_outcome(observation, n), len(task.plan.properties.wheel_axes_B)
    one, numbers = np.zeros(1, np.bool_), np.zeros((3, 1))
    return Answer(
        live=~one,
        finite=one.copy(),
        until=np.full(1, NEVER, np.int64),
        at_picture=no_kinematics(1, n, wheels),
        area=numbers[0],
        doubt=np.zeros((1, n), np.bool_),
        doubts=np.zeros(1, np.int64),
        new=np.zeros((1, cells), np.bool_),
        answer=np.zeros((1, samples), np.int8),
        C_CA=np.zeros((1, 3, 3)),
        failed=np.zeros((1, n), np.bool_),
        received=outcome.received,
        hazards=outcome.hazards,
        result=outcome.result,
        over=one.copy(),
        terminated=one.copy(),
        percent=numbers[1],
        delivered=numbers[2],
        refused=one.copy(),
        start=np.zeros(1, np.int64),
        final=observation,
    )


def prepared(batch: EpisodeBatch, flight_seeds: Sequence[int]) -> list[Memory]:
    """Flights at their start, as the processor starts them."""
    starts = []
    for seed in flight_seeds:
        batch.reset(0, seed)
        starts.append(memory_of(batch))
    return starts
