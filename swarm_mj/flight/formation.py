"""A scenario's formation in flight: its structure from the plan, the force law, and what came of it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

from swarm_mj.coordination.formation.law import FormationLaw, Messaging
from swarm_mj.coordination.formation.structure import Structure, nodes, offset_structure, planned_structure
from swarm_mj.coordination.formation.tracking import Tracking
from swarm_mj.coordination.graph import Graph
from swarm_mj.dataflow.network import Access
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.coordination import FORMATION_AIRTIME, add_messages, links_of
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import SwarmView
from swarm_mj.mission.covariance import arrival_axes
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.scenarios.schema_swarm import Formation
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.telemetry import VARIABLES
from swarm_mj.spacecraft.control.force import ForceView, SumOfForces
from swarm_mj.typing import Array, Mask

#: Variables and attribute of the telemetry.
ERROR, BITS, RECORD = "formation_error", "formation_bits", "formation"


def structure_of(plan: Plan, formation: Formation) -> Structure:
    """Where every spacecraft of a plan has to be.

    Raises:
        ScenarioError: The formation does not fit the plan.
    """
    scenario, deployment, gravity = plan.scenario, plan.deployment, plan.environment.acceleration_N
    _check(plan, formation)
    times = nodes(scenario.duration_s)
    planned = planned_structure(gravity, times, *planned_paths(gravity, deployment, times), formation.start_s)
    if formation.shape == "planned" or (formation.shape == "natural" and formation.offsets_m is None):
        return planned
    if formation.offsets_m is None:
        return offset_structure(planned, times, planned.offsets(formation.start_s)[0], None)
    arrival = float(deployment.arrival_s.mean())
    axes = np.eye(3)
    if formation.frame == "arrival":
        axes = arrival_axes(planned.centre(arrival)[None], planned.centre(arrival, 1)[None])[0]
    offsets = np.array(formation.offsets_m) @ axes
    if formation.shape == "cartesian":
        return offset_structure(planned, times, offsets, None)
    rates = (
        np.zeros_like(offsets) if formation.offset_rates_m_s is None else np.array(formation.offset_rates_m_s) @ axes
    )
    return offset_structure(planned, times, offsets, rates)


def _check(plan: Plan, formation: Formation) -> None:
    if formation.offsets_m is not None and len(formation.offsets_m) != plan.n:
        raise ScenarioError(
            f"swarm.formation.offsets_m: {len(formation.offsets_m)} places for {plan.n} spacecraft; must be one for each of "
            f"{', '.join(plan.names)}"
        )
    if plan.deployment.burns:
        raise ScenarioError("swarm.formation: a plan with burns cannot hold one; leave the burns or the formation out")
    last = float(plan.deployment.release_s.max())
    if formation.start_s < last:
        raise ScenarioError(
            f"swarm.formation.start_s = {formation.start_s:g}: must not be before the last release, at {last:g} s"
        )


def fly_formation(simulation: Simulation, plan: Plan) -> None:
    """Let the thrusters of a simulation hold the plan's formation as well, if there is one.

    Raises:
        ScenarioError: It does not fit the plan, or the thrusters.
    """
    swarm, propulsion = plan.scenario.swarm, simulation.propulsion
    if swarm is None or swarm.formation is None or propulsion is None:
        return
    formation = swarm.formation
    if not propulsion.allocation.reaches_all:
        raise ScenarioError(
            "swarm.formation: the thruster_ sites of spacecraft.mjcf do not push in every direction; add nozzles, or leave the "
            "formation out"
        )
    tracking = Tracking(bandwidth=formation.bandwidth_rad_s, damping=formation.damping, dead_band=formation.dead_band_m)
    tracking.check_period(simulation.period)
    least = plan.scenario.safety.min_separation_m if formation.min_separation_m is None else formation.min_separation_m
    graph = links_of(plan, swarm)

    def links(view: ForceView) -> Graph:
        C_AN = simulation.environment.C_AN(view.t)
        seen = SwarmView(
            t=view.t, r_BN_N=view.r_BN_N, v_BN_N=view.v_BN_N, C_AN=C_AN, q_BN=view.q_BN, working=view.working
        )
        return graph(seen, simulation.state.targets)

    law = FormationLaw(
        structure_of(plan, formation),
        tracking,
        links,
        force=propulsion.thrusters.thrust_n * propulsion.allocation.strength,
        least_impulse=propulsion.thrusters.min_impulse_bit_n_s,
        reference=formation.reference,
        separation=least + formation.margin_m if least > 0.0 else 0.0,
        messaging=Messaging(
            every_s=formation.message_s,
            silence_s=swarm.silence_s,
            seed=plan.scenario.seed,
            access=Access(plan.scenario.link.crosslink.access),
        ),
    )
    before = simulation.force_law
    simulation.force_law = law if before is None else SumOfForces([before, law])


def formation_law(simulation: Simulation) -> FormationLaw | None:
    """The law that holds a simulation's formation; None: there is none."""
    law = simulation.force_law
    laws = law.laws if isinstance(law, SumOfForces) else (law,)
    return next((one for one in laws if isinstance(one, FormationLaw)), None)


def formation_error(structure: Structure, reference: str, times: Array, r_BN_N: Array, works: Mask) -> Array:
    """Distance of each from its true place in the formation, shape (t, n) [m].

    Args:
        structure: Who should be where.
        reference: 'plan'; 'mean' of those that work; or 'leader', of these the one with the lowest number.
        times: Shape (t,) [s].
        r_BN_N: Places, shape (t, n, 3) [m].
        works: Who is not lost, shape (t, n).
    """
    error = r_BN_N - structure.path(times)
    if reference != "plan":
        weight = works.astype(np.float64)
        if reference == "leader":
            weight = np.eye(works.shape[1])[np.argmax(works, axis=1)]
        total = np.maximum(weight.sum(axis=1, keepdims=True), 1.0)
        error = error - np.einsum("tj,tjk->tk", weight / total, error)[:, None]
    return np.linalg.norm(error, axis=2)


def record_formation(telemetry: xr.Dataset, plan: Plan, simulation: Simulation) -> None:
    """Add how well a formation was held, and what that takes by plan; nothing where there is none."""
    law = formation_law(simulation)
    if law is None:
        return
    times = telemetry["time"].values
    works: Mask = np.ones((len(times), plan.n), np.bool_)
    if "operational" in telemetry:
        works = telemetry["operational"].values == 1
    error = formation_error(law.structure, law.reference, times, telemetry["r_BN_N"].values, works)
    telemetry[ERROR] = VARIABLES[ERROR].of(error)
    record = _by_plan(plan, law, law.force / plan.properties.mass)
    if law.log is not None:
        record["braked_s"] = (law.log.braked * simulation.period).tolist()
        record["leaders"] = law.log.leaders
        if law.reference != "plan":
            add_messages(telemetry, law.log, BITS, FORMATION_AIRTIME)
    telemetry.attrs[RECORD] = json.dumps(record)


def _by_plan(plan: Plan, law: FormationLaw, most: float) -> dict[str, Any]:
    """What joining and holding take without disturbances, and what there is."""
    structure = law.structure
    start, end = structure.start_s, plan.scenario.duration_s
    times = np.linspace(start, end, 401)
    holding = np.linalg.norm([structure.holding(t) for t in times], axis=2)
    r, v = planned_paths(plan.environment.acceleration_N, plan.deployment, np.unique([0.0, start, end]))
    at = 0 if start == 0.0 else 1
    r_wanted, v_wanted = structure.states(start)
    away, astray = np.linalg.norm(r[at] - r_wanted, axis=1), np.linalg.norm(v[at] - v_wanted, axis=1)
    tracking = law.tracking
    speed = np.minimum(0.5 * tracking.bandwidth / tracking.damping * away, np.sqrt(most * away))
    thrusters = plan.properties.thrusters
    assert thrusters is not None
    full = plan.properties.mass
    return {
        "start_s": start,
        "end_s": end,
        "dead_band_m": tracking.dead_band,
        "join_m_s": (astray + 2.0 * speed).tolist(),
        "hold_m_s": np.trapezoid(holding, times, axis=0).tolist(),
        "most_needed_m_s2": holding.max(axis=0).tolist(),
        "thrust_m_s2": most,
        "tank_m_s": thrusters.exhaust_speed * float(np.log(full / (full - thrusters.propellant_kg))),
    }
