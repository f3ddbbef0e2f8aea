"""The flight in Basilisk: spacecraft with balanced wheels, spherical harmonics of a rotating planet, its own flight software.

Modules per spacecraft: spacecraft, reactionWheelStateEffector; simpleNav without errors, inertial3D, attTrackingError,
mrpFeedback, rwMotorTorque. Integrator: Basilisk's default, RK4. https://avslab.github.io/basilisk
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from Basilisk.architecture import bskLogging, messaging
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
from Basilisk.simulation import (
    gravityEffector,
    planetEphemeris,
    reactionWheelStateEffector,
    simpleNav,
    spacecraft,
    sphericalHarmonicsGravityModel,
)
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.basilisk.problem import DURATION_S, K_N_M, LEG_S, P_N_M_S, PERIOD_S, Flight, Problem
from swarm_mj.smallbody.gravity import SphericalHarmonics
from swarm_mj.spacecraft.properties import RPM

Array = NDArray[np.float64]

DYNAMICS, SOFTWARE = "dynamics", "software"


@dataclass
class Peer:
    """The flight in Basilisk, ready to run.

    Attributes:
        sim: Basilisk's simulation.
        legs: MRPs of the reference attitudes, shape (legs, n, 3).
        leg: The one that is flown.
        crafts: The spacecraft.
        wheels: Their wheels.
        guidance: The modules that hold the reference attitudes, one per spacecraft.
        states: Recorders of the spacecraft's states, empty where nothing is recorded.
        speeds: Recorders of wheel speeds.
        parts: What Python must keep alive.
    """

    sim: Any
    problem: Problem
    legs: list[list[list[float]]]
    leg: int = 0
    crafts: list[Any] = field(default_factory=list)
    wheels: list[Any] = field(default_factory=list)
    guidance: list[Any] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)
    speeds: list[Any] = field(default_factory=list)
    parts: list[Any] = field(default_factory=list)

    def fly_to(self, end: float) -> None:
        """Fly on until `end` [s]; every leg ends one control period early, so that its last command stands when it ends."""
        while self.leg + 1 < len(self.legs) and end >= (self.leg + 1) * LEG_S:
            self._execute((self.leg + 1) * LEG_S - PERIOD_S)
            self.leg += 1
            self.aim()
        self._execute(end)

    def aim(self) -> None:
        """Give the references of this leg to the guidance."""
        for module, attitude in zip(self.guidance, self.legs[self.leg], strict=True):
            module.sigma_R0N = attitude

    def _execute(self, end: float) -> None:
        self.sim.ConfigureStopTime(macros.sec2nano(end))
        self.sim.ExecuteSimulation()

    def state(self) -> Flight:
        """Where the swarm is now, a flight of one sample."""
        messages = [craft.scStateOutMsg.read() for craft in self.crafts]
        attitude = Rotation.from_mrp([message.sigma_BN for message in messages]).as_quat(scalar_first=True)
        return Flight(
            r_N=np.array([[message.r_CN_N for message in messages]]),
            attitude=attitude[None],
            wheel_speed=np.array([[wheel.rwSpeedOutMsg.read().wheelSpeeds[:3] for wheel in self.wheels]]),
        )


def make(problem: Problem, timestep: float, record: bool) -> Peer:
    """Build and initialise the flight."""
    bskLogging.setDefaultLogLevel(bskLogging.BSK_WARNING)
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask(DYNAMICS, macros.sec2nano(timestep)))
    process.addTask(sim.CreateNewTask(SOFTWARE, macros.sec2nano(PERIOD_S)))
    peer = Peer(sim, problem, [[attitude.as_mrp().tolist() for attitude in leg] for leg in problem.references])
    planet, rotation = eros(problem)
    sim.AddModelToTask(DYNAMICS, rotation, 300)
    peer.parts += [planet, rotation]
    for j in range(problem.n):
        add_spacecraft(peer, j, planet, record)
    sim.InitializeSimulation()
    peer.aim()
    return peer


def eros(problem: Problem) -> tuple[Any, Any]:
    """The field of Eros and the module that turns it."""
    gravity, environment = problem.environment.gravity, problem.environment
    assert isinstance(gravity, SphericalHarmonics)
    planet = gravityEffector.GravBodyData()
    planet.planetName, planet.mu, planet.radEquator = "eros", gravity.gm, gravity.reference_radius
    planet.isCentralBody = True
    field_ = sphericalHarmonicsGravityModel.SphericalHarmonicsGravityModel()
    field_.radEquator, field_.maxDeg = gravity.reference_radius, gravity.degree
    field_.cBar = [row[: k + 1].tolist() for k, row in enumerate(gravity.c)]
    field_.sBar = [row[: k + 1].tolist() for k, row in enumerate(gravity.s)]
    planet.gravityModel = field_
    rotation = planetEphemeris.PlanetEphemeris()
    rotation.ModelTag = "eros"
    rotation.setPlanetNames(planetEphemeris.StringVector(["eros"]))
    orbit = planetEphemeris.ClassicElements()
    orbit.a, orbit.e, orbit.i, orbit.Omega, orbit.omega, orbit.f = 2e11, 0.1, 0.1, 0.0, 0.0, 0.0
    rotation.planetElements = planetEphemeris.classicElementVector([orbit])
    # The planet stands at the origin; only its rotation matters. Basilisk: C_AN = R3(sidereal time) R2(90 deg - declination)
    # R3(right ascension), angles of the pole in N.
    pole = environment.C_AN(0.0)[2]
    ascension, declination = np.arctan2(pole[1], pole[0]), np.arcsin(pole[2])
    tilted = Rotation.from_euler("ZY", [ascension, 0.5 * np.pi - declination])
    turned = environment.C_AN(0.0) @ tilted.as_matrix()
    rotation.rightAscension = planetEphemeris.DoubleVector([ascension])
    rotation.declination = planetEphemeris.DoubleVector([declination])
    rotation.lst0 = planetEphemeris.DoubleVector([np.arctan2(turned[0, 1], turned[0, 0])])
    rotation.rotRate = planetEphemeris.DoubleVector([environment.spin_rate])
    rotation.zeroBase = "eros"
    planet.planetBodyInMsg.subscribeTo(rotation.planetOutMsgs[0])
    return planet, rotation


def add_spacecraft(peer: Peer, j: int, planet: Any, record: bool) -> None:
    """Hub, wheels and flight software of spacecraft j."""
    properties, start, sim = peer.problem.properties, peer.problem.initial, peer.sim
    craft = spacecraft.Spacecraft()
    craft.ModelTag = f"sc{j}"
    craft.hub.mHub, craft.hub.r_BcB_B = properties.mass, [[0.0], [0.0], [0.0]]
    craft.hub.IHubPntBc_B = properties.inertia_B.tolist()
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = column(start.r_BN_N[j]), column(start.v_BN_N[j])
    craft.hub.sigma_BNInit, craft.hub.omega_BN_BInit = column(start.sigma_BN[j]), column(start.omega_BN_B[j])
    craft.gravField.gravBodies = spacecraft.GravBodyVector([planet])
    wheels, factory = reactionWheelStateEffector.ReactionWheelStateEffector(), simIncludeRW.rwFactory()
    wheels.ModelTag = f"wheels{j}"
    for axis, speed in zip(properties.wheel_axes_B, start.wheel_speed[j], strict=True):
        factory.create(
            "custom",
            axis.tolist(),
            Js=properties.wheel_spin_inertia,
            Omega=float(speed / RPM),
            u_max=properties.max_wheel_torque,
            Omega_max=properties.max_wheel_speed / RPM,
            RWModel=messaging.BalancedWheels,
        )
    factory.addToSpacecraft(wheels.ModelTag, wheels, craft)
    sim.AddModelToTask(DYNAMICS, wheels, 200)
    sim.AddModelToTask(DYNAMICS, craft, 100)
    add_software(peer, j, craft, wheels, factory.getConfigMessage())
    if record:
        for recorders, message in ((peer.states, craft.scStateOutMsg), (peer.speeds, wheels.rwSpeedOutMsg)):
            recorders.append(message.recorder(macros.sec2nano(PERIOD_S)))
            sim.AddModelToTask(DYNAMICS, recorders[-1], 1)
    peer.crafts.append(craft)
    peer.wheels.append(wheels)
    peer.parts.append(factory)


def add_software(peer: Peer, j: int, craft: Any, wheels: Any, wheel_message: Any) -> None:
    """Navigation, guidance, control and the wheels' command."""
    navigation, guidance = simpleNav.SimpleNav(), inertial3D.inertial3D()
    error, law, motors = attTrackingError.attTrackingError(), mrpFeedback.mrpFeedback(), rwMotorTorque.rwMotorTorque()
    inertia = peer.problem.properties.inertia_effective_B
    vehicle = messaging.VehicleConfigMsg().write(messaging.VehicleConfigMsgPayload(ISCPntB_B=inertia.ravel().tolist()))
    navigation.scStateInMsg.subscribeTo(craft.scStateOutMsg)
    error.attNavInMsg.subscribeTo(navigation.attOutMsg)
    error.attRefInMsg.subscribeTo(guidance.attRefOutMsg)
    law.K, law.P, law.Ki, law.integralLimit, law.controlLawType = K_N_M, P_N_M_S, -1.0, 0.0, 1
    law.guidInMsg.subscribeTo(error.attGuidOutMsg)
    law.vehConfigInMsg.subscribeTo(vehicle)
    law.rwParamsInMsg.subscribeTo(wheel_message)
    law.rwSpeedsInMsg.subscribeTo(wheels.rwSpeedOutMsg)
    motors.controlAxes_B = np.eye(3).ravel().tolist()
    motors.vehControlInMsg.subscribeTo(law.cmdTorqueOutMsg)
    motors.rwParamsInMsg.subscribeTo(wheel_message)
    wheels.rwMotorCmdInMsg.subscribeTo(motors.rwMotorTorqueOutMsg)
    for k, module in enumerate((navigation, guidance, error, law, motors)):
        module.ModelTag = f"{type(module).__name__}{j}"
        peer.sim.AddModelToTask(SOFTWARE, module, 90 - k)
    peer.guidance.append(guidance)
    peer.parts += [navigation, error, law, motors, vehicle, wheel_message]


def column(values: Array) -> list[list[float]]:
    """A vector as Basilisk wants it."""
    return [[float(value)] for value in values]


def fly(problem: Problem, timestep: float) -> Flight:
    """Fly and record every control period."""
    peer = make(problem, timestep, record=True)
    peer.fly_to(DURATION_S)
    sigma = np.array([log.sigma_BN for log in peer.states])
    attitude = Rotation.from_mrp(sigma.reshape(-1, 3)).as_quat(scalar_first=True)
    return Flight(
        r_N=np.swapaxes([log.r_CN_N for log in peer.states], 0, 1),
        attitude=np.swapaxes(attitude.reshape(*sigma.shape[:2], 4), 0, 1),
        wheel_speed=np.swapaxes([log.wheelSpeeds[:, :3] for log in peer.speeds], 0, 1),
    )


def ready(problem: Problem, timestep: float) -> Callable[[], object]:
    """A function that flies the whole flight without recording it; set-up is done."""
    peer = make(problem, timestep, record=False)
    return lambda: peer.fly_to(DURATION_S)
