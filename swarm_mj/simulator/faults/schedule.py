"""Which fault happens to which spacecraft at what time: the scenario's list, with its chances and random times drawn.

Those of the deployment change how the swarm leaves the mothership, all others happen in flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema_faults import DeploymentVelocity, Dispersions, Fault, MissedDeployment
from swarm_mj.scenarios.schema_sensors import IDEAL, Sensors
from swarm_mj.simulator.faults.dispersions import Stream, stream
from swarm_mj.typing import Array

#: Faults of the deployment: they change how the flight begins and have no time.
AT_DEPLOYMENT = ("missed_deployment", "deployment_velocity")
#: Stands for the spacecraft that relays to Earth when the time has come.
RELAY = -1


@dataclass(frozen=True, kw_only=True)
class FaultModel:
    """What a scenario says may go wrong, and by what its sensors err."""

    faults: tuple[Fault, ...]  #: see `swarm_mj.scenarios.schema_faults`
    dispersions: Dispersions  #: the same
    duration_s: float  #: of the flight [s]
    sensors: Sensors = IDEAL
    #: whether who hits the body or diverges is lost and the others fly on; else the flight ends with an error
    losses: bool = True
    #: rule by which the swarm replaces a lost relay; None: by none, or by what its behaviour knows
    election: str | None = "medoid"


@dataclass(frozen=True)
class Event:
    """Something that went wrong in flight, was found out, or was answered."""

    time_s: float  #: past the epoch [s]
    spacecraft: int  #: number, counted from 0
    kind: str  #: A kind of fault, or what followed: `impact`, `diverged`, `elected`, `detected`, `over`
    detail: str = ""  #: in words


@dataclass(frozen=True)
class ScheduledFault:
    """A fault that will happen."""

    time_s: float  #: when [s]; 0 at deployment
    spacecraft: int  #: to whom, counted from 0, or `RELAY`
    wheels: tuple[int, ...]  #: to which wheels, counted from 0; empty where the fault is of no wheel
    over_s: float  #: when it is over [s]; infinite: never
    fault: Fault  #: its parameters


def draw_schedule(
    faults: Sequence[Fault], seed: int, *, n: int, n_wheels: int, duration_s: float
) -> tuple[ScheduledFault, ...]:
    """Draw what happens in one flight.

    Args:
        faults: The scenario's list.
        seed: Of the scenario; the same seed gives the same schedule.
        n: Number of spacecraft.
        n_wheels: Of each spacecraft.
        duration_s: Of the flight [s]; random times fall into it.

    Returns:
        The faults that happen, in order of time; of equal times in the order of the list.
    """
    found = []
    for number, fault in enumerate(faults):
        for j in _victims(fault, stream(seed, Stream.FAULT, number), n):
            rng = stream(seed, Stream.FAULT, number, j + 1)
            # All are drawn whether they are used or not, so that a changed probability moves no time.
            chance, moment, which = rng.random(3)
            if chance < fault.probability:
                found.append(_scheduled(fault, j, moment, which, n_wheels, duration_s))
    return tuple(sorted(found, key=lambda f: f.time_s))


def deployed_velocities(
    planned: Array, mothership: Array, schedule: Sequence[ScheduledFault], errors: Array, release_s: Array | None = None
) -> tuple[Array, list[Event]]:
    """Velocities after deployment.

    Args:
        planned: In N, shape (n, 3) [m/s].
        mothership: Its velocity in N at their releases, shape (3,) or (n, 3) [m/s].
        schedule: What happens; only faults of the deployment matter here.
        errors: Added to every velocity, shape (n, 3) [m/s].
        release_s: When each is released, shape (n,) [s]; None: at the epoch.

    Returns:
        Velocities in N, shape (n, 3) [m/s], and what happened.
    """
    velocity, events = planned + errors, []
    mothership = np.broadcast_to(mothership, planned.shape)
    when = np.zeros(len(planned)) if release_s is None else release_s
    for entry in schedule:
        j, fault = entry.spacecraft, entry.fault
        if isinstance(fault, DeploymentVelocity):
            before = velocity[j].copy()
            velocity[j] = mothership[j] + fault.factor * (velocity[j] - mothership[j]) + np.array(fault.error_m_s)
            change = float(np.linalg.norm(velocity[j] - before))
            events.append(Event(float(when[j]), j, fault.kind, f"velocity off by {change:.3g} m/s"))
    for entry in schedule:
        if isinstance(entry.fault, MissedDeployment):
            velocity[entry.spacecraft] = mothership[entry.spacecraft]
            events.append(
                Event(float(when[entry.spacecraft]), entry.spacecraft, entry.fault.kind, "stays in its deployer")
            )
    return velocity, events


def check_faults(faults: Sequence[Fault], *, n: int, n_wheels: int, duration_s: float) -> None:
    """Refuse faults that cannot happen to this swarm.

    Raises:
        ScenarioError: A spacecraft or wheel does not exist, or a time lies outside the flight; the message names the key.
    """
    for number, fault in enumerate(faults):
        name, wheel = getattr(fault, "spacecraft", "any"), getattr(fault, "wheel", "any")
        if name.startswith("sc") and int(name[2:]) > n:
            raise ScenarioError(f"faults.{number}.spacecraft = {name}: must be one of sc1 to sc{n}, all or any")
        if isinstance(wheel, int) and wheel > n_wheels:
            raise ScenarioError(f"faults.{number}.wheel = {wheel}: must be 1 to {n_wheels}, all or any")
        latest = max(getattr(fault, "at_s", None) or 0.0, *(getattr(fault, "between_s", None) or (0.0,)), 0.0)
        if latest > duration_s:
            raise ScenarioError(f"faults.{number}: {latest:g} s lies after the end, duration_s = {duration_s:g}")


def _victims(fault: Any, rng: np.random.Generator, n: int) -> list[int]:
    name = getattr(fault, "spacecraft", None)
    if name is None:
        return [RELAY]
    if name == "all":
        return list(range(n))
    return [int(rng.integers(n)) if name == "any" else int(name[2:]) - 1]


def _scheduled(fault: Any, j: int, moment: float, which: float, n_wheels: int, duration_s: float) -> ScheduledFault:
    time = 0.0
    if fault.kind not in AT_DEPLOYMENT:
        first, last = fault.between_s or (0.0, duration_s)
        time = first + moment * (last - first) if fault.at_s is None else fault.at_s
    lasts = getattr(fault, "duration_s", None)
    wheel = getattr(fault, "wheel", None)
    wheels: tuple[int, ...] = ()
    if wheel is not None:
        drawn = min(int(which * n_wheels), n_wheels - 1)
        wheels = tuple(range(n_wheels)) if wheel == "all" else (drawn if wheel == "any" else wheel - 1,)
    return ScheduledFault(
        time_s=time, spacecraft=j, wheels=wheels, over_s=inf if lasts is None else time + lasts, fault=fault
    )
