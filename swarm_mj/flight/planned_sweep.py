"""Planned sweeps: narrow cameras led over the target by a plan of their pictures, which is made anew when a picture fails.

Before release the pictures of all are planned together by the table of the encounter (`swarm_mj.coordination.encounter`),
within what storage holds and, where delivered area is sought, what the links carry from the last picture until the end of
`data.horizon_s`. Every picture counts as a whole frame there, whatever `data.product` sends of it, and each crosslink as if it
had the channel for itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from swarm_mj.coordination.coordinated_behavior import CoordinatedBehavior, PicturePlan
from swarm_mj.dataflow.contacts import samples_of
from swarm_mj.errors import MissionError
from swarm_mj.flight.coordination import coordination_plan, succession_of
from swarm_mj.flight.downlink import MOST_LINKS, contacts_of, frame_pixels, samples_per_slot, slot_edges
from swarm_mj.flight.encounter_table import TOLERANCE, encounter_of, together
from swarm_mj.flight.post_flight import Course, post_flight_instants
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.scenarios.schema_swarm import Swarm

OBJECTIVES = ("mapped", "delivered")


@dataclass(frozen=True)
class PlannedSweep:
    """Each spacecraft takes the pictures of a plan, and plans anew what is left when one does not show what it should.

    Afterwards all turn to the planned relay, and that one to Earth.

    Attributes:
        n_observers: Number of spacecraft.
        imaging_radius_m: Plays no part: the plan says who looks where when.
        objective: 'mapped', most area, or 'delivered', most area of as many pictures as the links carry.
        time_limit_s: After which the solver stops without proof [s].
        tolerance: Pointing error below which a picture may be taken after a slew, of the camera's half-angle. With less, more
            pictures show just what they were to, and fewer are taken.
        messages: Whether the swarm tells each other what it has seen: who falls silent is then replaced, in the plan and as the
            relay. Without, each repairs its own pictures alone.

    Raises:
        MissionError: A value is impossible.
    """

    n_observers: int
    imaging_radius_m: float
    objective: str = "mapped"
    time_limit_s: float = 20.0
    tolerance: float = TOLERANCE
    messages: bool = False
    dedicated_communications: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        if self.objective not in OBJECTIVES:
            raise MissionError(
                f"behavior.parameters.objective = {self.objective!r}: must be one of {', '.join(OBJECTIVES)}"
            )
        if not 0.0 < self.tolerance <= 1.0:
            raise MissionError(f"behavior.parameters.tolerance = {self.tolerance}: must be above 0 and at most 1")
        if not (isfinite(self.time_limit_s) and self.time_limit_s > 0.0):
            raise MissionError(f"behavior.parameters.time_limit_s = {self.time_limit_s}: must be a positive number")

    def for_flight(self, plan: Any) -> Behavior:
        """See `MissionBehavior`."""
        encounter = encounter_of(plan, self.tolerance)
        stored = (plan.scenario.data.storage_bit // picture_bit(plan.scenario),) * plan.n_observers
        found = together(encounter, self.time_limit_s, stored)
        succession = succession_of(plan, found.pictures, encounter.slot_s[-1])
        if self.objective == "delivered":
            each, most = pictures_carried(plan, int(np.argmin(succession)), encounter.slot_s)
            found = together(encounter, self.time_limit_s, tuple(np.minimum(stored, each).tolist()), most)
        swarm = plan.scenario.swarm or Swarm(level=2)
        parts = {"sensing": "plan", "relay": "election" if self.messages else "plan"}
        picture_plan = PicturePlan(encounter, found, self.objective, repaired=True)
        return CoordinatedBehavior(coordination_plan(plan, swarm, parts, picture_plan, succession))

    def targets(self, view: SwarmView, memory: Any) -> tuple[Targets, Any]:
        """Not before `for_flight`.

        Raises:
            MissionError: Always.
        """
        raise MissionError("behavior.name = planned_sweep: must know its mission; use for_flight(plan) first")


def picture_bit(scenario: Any) -> int:
    """Data of a whole picture as it is stored and sent [bit]."""
    return max(round(scenario.data.sent_bits_per_pixel * frame_pixels(scenario)), 1)


def pictures_carried(plan: Any, relay: int, slot_s: Any) -> tuple[list[int], int]:
    """Whole pictures that each observer can bring to a relay, and that one to Earth, after the last slot of an encounter.

    Paths are those planned, antennas point as after a flight, and nobody fails.
    """
    scenario = plan.scenario
    edges_s = slot_edges(scenario, slot_s[-1:], MOST_LINKS // plan.n**2)
    times = samples_of(edges_s, samples_per_slot(scenario)).ravel()
    r_N = planned_paths(plan.environment.acceleration_N, plan.deployment, np.append(0.0, times), rtol=1e-7)[0][1:]
    course = Course(times, r_N, np.ones(r_N.shape[:2], np.bool_))
    attitude = np.tile(np.eye(3), (plan.n, 1, 1))
    instants = post_flight_instants(plan, attitude, course, np.full((len(times), 1), relay))
    contacts, frame_bit = contacts_of(plan, edges_s, instants), picture_bit(scenario)
    to_relay = contacts.swarm_bit[:, : plan.n_observers, relay].sum(axis=0) // frame_bit
    most = int(contacts.earth_bit[:, relay].sum()) // frame_bit
    to_relay[relay : relay + 1] = most
    return to_relay.tolist(), most
