"""How the swarm really leaves the mothership: deployers that fail, and velocities and attitudes that are not as planned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.scenarios.schema_faults import DeploymentVelocity, MissedDeployment
from swarm_mj.simulator.faults.schedule import AT_DEPLOYMENT, Event, ScheduledFault
from swarm_mj.typing import Array


def deployed_velocities(
    planned: Array, mothership: Array, schedule: Sequence[ScheduledFault], errors: Array
) -> tuple[Array, list[Event]]:
    """Velocities after deployment.

    Args:
        planned: In N, shape (n, 3) [m/s].
        mothership: Its velocity in N, shape (3,) [m/s].
        schedule: What happens; only faults of the deployment matter here.
        errors: Added to every velocity, shape (n, 3) [m/s].

    Returns:
        Velocities in N, shape (n, 3) [m/s], and what happened.
    """
    velocity, events = planned + errors, []
    for entry in schedule:
        j, fault = entry.spacecraft, entry.fault
        if isinstance(fault, DeploymentVelocity):
            before = velocity[j].copy()
            velocity[j] = mothership + fault.factor * (velocity[j] - mothership) + np.array(fault.error_m_s)
            change = float(np.linalg.norm(velocity[j] - before))
            events.append(Event(0.0, j, fault.kind, f"velocity off by {change:.3g} m/s"))
    for entry in schedule:
        if isinstance(entry.fault, MissedDeployment):
            velocity[entry.spacecraft] = mothership
            events.append(Event(0.0, entry.spacecraft, entry.fault.kind, "stays in its deployer"))
    return velocity, events


def in_flight(schedule: Sequence[ScheduledFault]) -> list[ScheduledFault]:
    """Those faults that happen after the deployment, in order of time."""
    return [entry for entry in schedule if entry.fault.kind not in AT_DEPLOYMENT]
