"""The flight in Basilisk: spacecraft about a rotating planet, and one with wheels that get the torques of the flight."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
from Basilisk.architecture import bskLogging, messaging
from Basilisk.simulation import (
    gravityEffector,
    planetEphemeris,
    pointMassGravityModel,
    reactionWheelStateEffector,
    spacecraft,
    sphericalHarmonicsGravityModel,
)
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.agreement.coefficients import rows
from benchmarks.agreement.job import Job, work

Array = NDArray[np.float64]
TASK = "dynamics"
RPM = 2.0 * pi / 60.0


def column(values: Array) -> list[list[float]]:
    """A vector as Basilisk wants it."""
    return [[float(value)] for value in values]


def simulation(step_s: float) -> Any:
    """An empty one; Basilisk's integrator is RK4."""
    bskLogging.setDefaultLogLevel(bskLogging.BSK_WARNING)
    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("process").addTask(sim.CreateNewTask(TASK, macros.sec2nano(step_s)))
    return sim


def planet(job: Job, sim: Any) -> tuple[Any, Any]:
    """The body's field, and the module that turns it; Basilisk's inertial frame is E."""
    made = gravityEffector.GravBodyData()
    made.planetName, made.mu, made.isCentralBody = "body", job.facts["gm"], True
    if job.facts["terms"]:
        field = sphericalHarmonicsGravityModel.SphericalHarmonicsGravityModel()
        field.radEquator = made.radEquator = job.facts["radius"]
        field.cBar, field.sBar = rows(job.facts["terms"])
        field.maxDeg = len(field.cBar) - 1
        made.gravityModel = field
    else:
        made.gravityModel = pointMassGravityModel.PointMassGravityModel()
    ra, dec, w, rate = job.angles("exported")
    rotation = planetEphemeris.PlanetEphemeris()
    rotation.ModelTag = "body"
    rotation.setPlanetNames(planetEphemeris.StringVector(["body"]))
    orbit = planetEphemeris.ClassicElements()  # any: the planet is the origin
    orbit.a, orbit.e, orbit.i, orbit.Omega, orbit.omega, orbit.f = 2e11, 0.1, 0.1, 0.0, 0.0, 0.0
    rotation.planetElements = planetEphemeris.classicElementVector([orbit])
    # Basilisk counts from the meridian of the pole's right ascension: R3(lst0) R2(90 deg - dec) R3(ra).
    rotation.rightAscension = planetEphemeris.DoubleVector([ra])
    rotation.declination = planetEphemeris.DoubleVector([dec])
    rotation.lst0 = planetEphemeris.DoubleVector([w + pi / 2])
    rotation.rotRate = planetEphemeris.DoubleVector([rate])
    rotation.zeroBase = "body"
    made.planetBodyInMsg.subscribeTo(rotation.planetOutMsgs[0])
    sim.AddModelToTask(TASK, rotation, 300)
    return made, rotation


def paths(job: Job, step_s: float) -> Array:
    """States in E, shape (t, n, 6); the times asked are multiples of their first."""
    sim, every = simulation(step_s), macros.sec2nano(float(job.asked["times"][1]))
    body, rotation = planet(job, sim)
    logs, parts = [], [body, rotation]
    for j, start in enumerate(job.asked["start_E"]):
        craft = spacecraft.Spacecraft()
        craft.ModelTag = f"sc{j}"
        craft.hub.mHub = 8.0
        craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = column(start[:3]), column(start[3:])
        craft.gravField.gravBodies = spacecraft.GravBodyVector([body])
        sim.AddModelToTask(TASK, craft, 100)
        logs.append(craft.scStateOutMsg.recorder(every))
        sim.AddModelToTask(TASK, logs[-1], 1)
        parts.append(craft)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(float(job.asked["times"][-1])))
    sim.ExecuteSimulation()
    states = [np.hstack([log.r_CN_N, log.v_CN_N]) for log in logs]
    return np.swapaxes(states, 0, 1)


def turning(job: Job) -> Array:
    """C_AE at the times asked, shape (k, 3, 3)."""
    sim = simulation(1.0)
    _, rotation = planet(job, sim)
    sim.InitializeSimulation()
    out = []
    for t in job.asked["turn_times"].tolist():
        sim.ConfigureStopTime(macros.sec2nano(t))
        sim.ExecuteSimulation()
        out.append(rotation.planetOutMsgs[0].read().J20002Pfix)
    return np.array(out)


def attitude(job: Job, step_s: float) -> tuple[Array, Array]:
    """Quaternions (w, x, y, z) of B relative to N and wheel speeds [rad/s] under the torques of the flight, (t, 4), (t, 3)."""
    wheels, torques = job.facts["wheels"], job.asked["torques"]
    sim, craft = simulation(step_s), spacecraft.Spacecraft()
    craft.ModelTag = "sc"
    craft.hub.mHub, craft.hub.r_BcB_B = wheels["mass"], [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = wheels["inertia_B"]
    craft.hub.sigma_BNInit = column(Rotation.from_quat(job.asked["q0"], scalar_first=True).as_mrp())
    craft.hub.omega_BN_BInit = column(job.asked["omega0"])
    effector, factory = reactionWheelStateEffector.ReactionWheelStateEffector(), simIncludeRW.rwFactory()
    effector.ModelTag = "wheels"
    for axis, speed in zip(wheels["axes_B"], job.asked["wheel_speed0"], strict=True):
        factory.create(
            "custom", axis, Js=wheels["spin_inertia"], Omega=float(speed / RPM), u_max=wheels["max_torque"],
            Omega_max=wheels["max_speed"] / RPM, RWModel=messaging.BalancedWheels,
        )  # fmt: skip
    factory.addToSpacecraft(effector.ModelTag, effector, craft)
    payload = messaging.ArrayMotorTorqueMsgPayload()
    command = messaging.ArrayMotorTorqueMsg().write(payload)
    effector.rwMotorCmdInMsg.subscribeTo(command)
    sim.AddModelToTask(TASK, effector, 200)
    sim.AddModelToTask(TASK, craft, 100)
    sim.InitializeSimulation()
    q, speeds = [job.asked["q0"]], [job.asked["wheel_speed0"]]
    for k, u in enumerate(torques[:-1]):
        payload.motorTorque = u.tolist()
        command.write(payload, macros.sec2nano(k * wheels["period_s"]))
        sim.ConfigureStopTime(macros.sec2nano((k + 1) * wheels["period_s"]))
        sim.ExecuteSimulation()
        q.append(Rotation.from_mrp(craft.scStateOutMsg.read().sigma_BN).as_quat(scalar_first=True))
        speeds.append(np.array(effector.rwSpeedOutMsg.read().wheelSpeeds[:3]))
    return np.array(q), np.array(speeds)


def compute(job: Job) -> dict[str, Any]:
    """All that is asked."""
    out: dict[str, Any] = {"path": paths(job, job.facts["basilisk_step_s"]), "C_AE_exported": turning(job)}
    if "wheels" in job.facts:
        out["q_BN"], out["wheel_speed"] = attitude(job, 0.1)
    return out


if __name__ == "__main__":
    work("basilisk", compute)
