"""How the swarm really leaves the mothership: deployers that fail, and velocities and attitudes that are not as planned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.scenarios.schema_faults import DeploymentVelocity, MissedDeployment
from swarm_mj.simulator.faults.schedule import AT_DEPLOYMENT, Event, ScheduledFault
from swarm_mj.typing import Array


def deployed_velocities(
    planned: Array,
    mothership: Array,
    schedule: Sequence[ScheduledFault],
    errors: Array,
    release_s: Array | None = None,
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


def in_flight(schedule: Sequence[ScheduledFault]) -> list[ScheduledFault]:
    """Those faults that happen after the deployment, in order of time."""
    return [entry for entry in schedule if entry.fault.kind not in AT_DEPLOYMENT]
