"""What some users of a scenario do not know, refused by its key with what to do: each says who they are."""

from __future__ import annotations

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario


def refuse_turned_cameras_and_companions(scenario: Scenario, what: str) -> None:
    """Refuse what is known only where a whole flight is judged: a companion, and cameras that do not look along +z.

    Raises:
        ScenarioError: The scenario has one.
    """
    if scenario.companion is not None:
        raise ScenarioError(f"companion: {what} knows one body alone; leave companion out, or fly without it")
    camera = scenario.camera
    if not camera.as_the_body:
        key = "gimbal" if camera.gimbal else "misalignment_deg" if any(camera.misalignment_deg) else "boresight_B"
        raise ScenarioError(f"camera.{key}: {what} takes pictures along +z alone; leave it out")


def refuse_sequence(scenario: Scenario, what: str) -> None:
    """Refuse a scenario whose pictures are taken by a table where they can only be taken at equal intervals.

    Raises:
        ScenarioError: It has one.
    """
    if scenario.observation.sequence:
        raise ScenarioError(
            f"observation.sequence: {what} takes pictures every observation.interval_s; leave the sequence out"
        )


def refuse_known_states(scenario: Scenario, what: str) -> None:
    """Refuse spacecraft that are on their way where paths from a mothership are chosen.

    Raises:
        ScenarioError: There are some.
    """
    if scenario.initial_states:
        raise ScenarioError(
            f"initial_states: {what} chooses paths from a mothership; say by mothership.approach how that comes, and leave "
            "initial_states out"
        )
