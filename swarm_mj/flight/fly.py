"""A plan flown: initial states, simulation, telemetry with radio links."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import xarray as xr
import yaml
from scipy.spatial.transform import Rotation

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.burns import fly_burns
from swarm_mj.flight.coordination import parts_chosen, record_coordination
from swarm_mj.flight.formation import fly_formation, record_formation
from swarm_mj.flight.plan import Plan
from swarm_mj.flight.trajectory_corrections import CorrectionLaw, correction_law
from swarm_mj.mission.behaviors import ELECTIONS, BodyOnApproach, MissionBehavior
from swarm_mj.mission.links import links_closed
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.scenarios.schema_sensors import IDEAL
from swarm_mj.simulator.faults.dispersions import attitude_turns, extra_rates, mothership_error, velocity_errors
from swarm_mj.simulator.faults.schedule import FaultModel, deployed_velocities, draw_schedule
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import Navigator, Simulation
from swarm_mj.simulator.state import InitialState, Release
from swarm_mj.simulator.telemetry import VARIABLES, dataset, working
from swarm_mj.spacecraft.attitude.mrp import add_mrp, dcm, mrp_from_quaternion
from swarm_mj.spacecraft.model import SwarmModel, build_model
from swarm_mj.spacecraft.mounting import aiming_of
from swarm_mj.spacecraft.own_model import build_own_model
from swarm_mj.spacecraft.properties import RPM
from swarm_mj.typing import Array, Mask

Progress = Callable[[float], None]


def initial_state(plan: Plan) -> InitialState:
    """The swarm at its release: one point, solved velocities, random attitudes and rates from the scenario's seed."""
    spacecraft, n = plan.scenario.spacecraft, plan.n
    rng = np.random.default_rng(plan.scenario.seed)
    rate, known = spacecraft.initial_rate_range_rpm * RPM, bool(plan.scenario.initial_states)
    start = InitialState(
        r_BN_N=plan.deployment.release_r_N if known else np.broadcast_to(plan.deployment.r0_N, (n, 3)),
        v_BN_N=plan.deployment.v0_N,
        sigma_BN=rng.uniform(-spacecraft.initial_mrp_range, spacecraft.initial_mrp_range, (n, 3)),
        omega_BN_B=rng.uniform(-rate, rate, (n, 3)),
        wheel_speed=np.zeros((n, plan.properties.n_wheels)),
        seed=plan.scenario.seed,
    )
    return _aboard(plan, start if fault_model_from(plan.scenario) is None else _deployed(plan, start))


def _aboard(plan: Plan, start: InitialState) -> InitialState:
    """The same at the epoch, with those that are released later still aboard the mothership."""
    deployment = plan.deployment
    if not deployment.release_s.any():
        return start
    later = (deployment.release_s > 0.0)[:, None]
    # What the mothership errs by is carried along until the release, and is no part of the push.
    _, off_v_N = mothership_error(plan.scenario.dispersions, plan.scenario.seed)
    return replace(
        start,
        v_BN_N=np.where(later, deployment.mothership_velocity_N + off_v_N, start.v_BN_N),
        omega_BN_B=np.where(later, 0.0, start.omega_BN_B),
        release=Release(
            tick=np.rint(deployment.release_s / plan.scenario.control.period_s).astype(np.int64),
            push_N=start.v_BN_N - deployment.release_mothership_v_N - off_v_N,
            omega_BN_B=start.omega_BN_B,
        ),
    )


def _deployed(plan: Plan, planned: InitialState) -> InitialState:
    """The start after faults and dispersions of the deployment."""
    scenario, n, seed = plan.scenario, plan.n, plan.scenario.seed
    given, sigma_BN = scenario.dispersions, planned.sigma_BN
    schedule = draw_schedule(
        scenario.faults, seed, n=n, n_wheels=plan.properties.n_wheels, duration_s=scenario.duration_s
    )
    velocity, events = deployed_velocities(
        planned.v_BN_N,
        plan.deployment.release_mothership_v_N,
        schedule,
        velocity_errors(given, seed, n),
        plan.deployment.release_s,
    )
    if given.attitude_deg > 0.0:
        turns = Rotation.from_rotvec(attitude_turns(given, seed, n)).as_quat(scalar_first=True)
        sigma_BN = add_mrp(mrp_from_quaternion(turns), sigma_BN)
    off_r_N, off_v_N = mothership_error(given, seed)
    return replace(
        planned,
        r_BN_N=planned.r_BN_N + off_r_N,
        v_BN_N=velocity + off_v_N,
        sigma_BN=sigma_BN,
        omega_BN_B=planned.omega_BN_B + extra_rates(given, seed, n),
        deployment=tuple(events),
    )


def fault_model_from(scenario: Scenario) -> FaultModel | None:
    """What the scenario says may go wrong, and by what sensors err; None: nothing, all is as planned."""
    losses, sensors = bool(scenario.faults) or scenario.dispersions != Dispersions(), scenario.spacecraft.sensors
    if not losses and sensors == IDEAL:
        return None
    # A behaviour that holds elections itself replaces a lost relay by its own rule.
    election = scenario.behavior.parameters.get("election", "medoid")
    by_class = scenario.swarm is not None and parts_chosen(scenario.swarm)["relay"] != "behavior"
    return FaultModel(
        faults=scenario.faults,
        dispersions=scenario.dispersions,
        duration_s=scenario.duration_s,
        sensors=sensors,
        losses=losses,
        election=None if by_class else election if election in ELECTIONS else "medoid",
    )


def make_simulation(plan: Plan, *, geometry: bool = False, navigator: Navigator | None = None) -> Simulation:
    """The simulation of a plan, at its start.

    Args:
        plan: What to fly.
        geometry: Whether the model holds shapes, cameras and light as well, for MuJoCo's own viewers and renderer; flying needs
            none of them, and the pictures of swarm_mj are drawn from a model of their own. A spacecraft from a file keeps
            all of it in any case.
        navigator: Who tells where the spacecraft are; None: as `navigation.mode` says.
    """
    scenario, model = plan.scenario, model_of(plan, geometry=geometry)
    behavior = plan.behavior.for_flight(plan) if isinstance(plan.behavior, MissionBehavior) else plan.behavior
    if scenario.navigation.mode == "optical" and navigator is None:
        from swarm_mj.flight.optical import OpticalNavigator

        behavior, navigator = BodyOnApproach(behavior, plan.n_observers), OpticalNavigator(plan)
    simulation = Simulation(
        FlightSetup(
            model=model,
            environment=plan.environment,
            period=scenario.control.period_s,
            gravity_gradient=scenario.perturbations.gravity_gradient_torque,
            fault_model=fault_model_from(scenario),
            minimum_time_slews=scenario.control.slew == "time_optimal",
            aiming=aiming_of(scenario.camera, scenario.control.second_axis),
        ),
        behavior,
        plan.controller,
        force_law=correction_law(plan),
        shape=plan.shape,
        navigator=navigator,
    )
    fly_burns(simulation, plan.deployment)
    _check_nozzles(simulation)
    fly_formation(simulation, plan)
    simulation.reset(initial_state(plan))
    return simulation


def _check_nozzles(simulation: Simulation) -> None:
    """Corrections push wherever they must.

    Raises:
        ScenarioError: The thrusters cannot.
    """
    propulsion = simulation.propulsion
    if isinstance(simulation.force_law, CorrectionLaw) and propulsion and not propulsion.allocation.reaches_all:
        raise ScenarioError(
            "trajectory.corrections: the thruster_ sites of spacecraft.mjcf do not push in every direction, and where a "
            "correction will push is not known ahead; add nozzles, or leave the corrections out"
        )


def model_of(plan: Plan, *, geometry: bool = False) -> SwarmModel:
    """The plan's swarm in MuJoCo; `geometry` as in `make_simulation`."""
    scenario, sun_N = plan.scenario, plan.environment.sun.position.tolist()
    timestep = scenario.physics.timestep_s
    if plan.own is not None:
        return build_own_model(plan.n, plan.own, shape=plan.shape, timestep=timestep, sun_N=sun_N)
    return build_model(
        plan.n,
        shape=plan.shape,
        properties=plan.properties,
        timestep=timestep,
        camera_half_angle_deg=scenario.camera.half_angle_deg,
        sun_N=sun_N,
        geometry=geometry,
        stepper=scenario.physics.stepper,
    )


def simulate(plan: Plan, progress: Progress | None = None, navigator: Navigator | None = None) -> xr.Dataset:
    """Fly the plan; returns telemetry with radio links; `navigator` as in `make_simulation`.

    Raises:
        SimulationError: The flight diverged.
    """
    scenario = plan.scenario
    simulation = make_simulation(plan, navigator=navigator)
    record = simulation.run(scenario.duration_s, scenario.telemetry.interval_s, progress)
    aiming = simulation.setup.aiming
    telemetry = dataset(record, plan.names, plan.environment, plan.properties, aiming)
    telemetry.attrs |= provenance(plan)
    record_coordination(telemetry, simulation.behavior)
    record_formation(telemetry, plan, simulation)
    telemetry.attrs |= {"stepper": simulation.stepper}
    closed = links_closed(
        antennas=plan.antennas,
        shape=plan.shape,
        mode=telemetry["mode"].values,
        tracked=telemetry["tracked_spacecraft"].values,
        r_BN_N=telemetry["r_BN_N"].values,
        C_BN=dcm(telemetry["sigma_BN"].values),
        C_AN=asteroid_attitudes(telemetry),
        earth_N=np.array([plan.environment.earth.at(t) for t in record.time]),
    )
    if (companion := plan.environment.companion) is not None:
        places = np.array([companion.position(t) for t in record.time])
        closed &= links_closed(
            antennas=plan.antennas,
            shape=companion.shape,
            mode=telemetry["mode"].values,
            tracked=telemetry["tracked_spacecraft"].values,
            r_BN_N=telemetry["r_BN_N"].values - places[:, None],
            C_BN=dcm(telemetry["sigma_BN"].values),
            C_AN=np.array([companion.C_AN(t) for t in record.time]),
            earth_N=np.array([plan.environment.earth.at(t) for t in record.time]) - places,
        )
    if plan.deployment.release_s.any():
        left = record.time[:, None] >= plan.deployment.release_s * (1.0 - 1e-12)
        telemetry["released"] = VARIABLES["released"].of(left)
    if simulation.injection is not None or "released" in telemetry:
        closed &= _both_work(telemetry)
    if simulation.injection is not None:
        telemetry.attrs["events"] = json.dumps(
            [{**asdict(event), "spacecraft": plan.names[event.spacecraft]} for event in simulation.events]
        )
    telemetry["link_closed"] = VARIABLES["link_closed"].of(closed)
    if simulation.navigator is not None:
        telemetry.attrs["navigation"] = json.dumps(simulation.navigator.record())
    return telemetry


def provenance(plan: Plan) -> dict[str, Any]:
    """Where a flight's telemetry comes from, for its attributes: epoch, body, scenario and version."""
    scenario = plan.scenario
    gm = getattr(plan.environment.gravity, "gm", None)
    return {
        "scenario": scenario.name,
        "scenario_yaml": yaml.safe_dump(scenario.model_dump(mode="json"), sort_keys=False),
        "epoch_tdb": scenario.epoch,
        "body": scenario.body.name,
        "body_gravity_model": scenario.body.gravity.model,
        **({} if gm is None else {"body_gm_m3_s2": float(gm)}),
        "swarm_mj_version": __version__,
    }


def _both_work(telemetry: xr.Dataset) -> Mask:
    """Whether a spacecraft and the one that it tracks are operational, shape (time, spacecraft)."""
    works, tracked = working(telemetry), telemetry["tracked_spacecraft"].values
    return works & np.where(tracked < 0, True, np.take_along_axis(works, np.maximum(tracked, 0), axis=1))


def asteroid_attitudes(telemetry: xr.Dataset) -> Array:
    """Rotations from N to A at every sample, shape (time, 3, 3)."""
    return dcm(telemetry["sigma_AN"].values)
