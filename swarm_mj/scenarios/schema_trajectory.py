"""Corrections of the trajectories, and what a spacecraft knows of itself when it corrects; none by default."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from swarm_mj.scenarios.schema_thrusters import Thrusters
from swarm_mj.scenarios.section import Section


class Correction(Section):
    """A trajectory correction manoeuvre of every spacecraft."""

    after_release_s: float | None = Field(None, gt=0, description="time after the spacecraft's release [s]")
    before_visit_s: float | None = Field(None, gt=0, description="time before its visit [s]; give one of both")

    @model_validator(mode="after")
    def _one_time(self) -> Self:
        if (self.after_release_s is None) == (self.before_visit_s is None):
            given = "none is given" if self.after_release_s is None else "both are given"
            raise ValueError(f"after_release_s, before_visit_s: {given}; must be one of both")
        return self

    @property
    def key(self) -> str:
        """Name and value of the time, for messages."""
        if self.after_release_s is not None:
            return f"after_release_s = {self.after_release_s:g}"
        return f"before_visit_s = {self.before_visit_s:g}"


class Trajectory(Section):
    """What is done on the way."""

    corrections: tuple[Correction, ...] = Field(
        (),
        max_length=20,
        description="burns that bring each spacecraft back to its visiting point at its planned time, as far as it knows "
        "where it is; docs/how-to/corrections.md",
    )


class Navigation(Section):
    """What a spacecraft knows of its own state at a correction; drawn anew for each, from the scenario's seed."""

    position_m: float = Field(0.0, ge=0, le=1e9, description="1 sigma of each component of its position in N [m]")
    velocity_m_s: float = Field(0.0, ge=0, le=1e4, description="1 sigma of each component of its velocity in N [m/s]")


def corrections_can_be_flown(trajectory: Trajectory, thrusters: Thrusters | None) -> None:
    """See that there is something to correct with.

    Raises:
        ValueError: There is not.
    """
    if not trajectory.corrections:
        return
    what = f"trajectory.corrections: {len(trajectory.corrections)} given"
    if thrusters is None:
        raise ValueError(f"{what}, but spacecraft.thrusters is null; give spacecraft.thrusters (its defaults: {{}})")
    if thrusters.layout == "four_z":
        raise ValueError(
            f"{what}, but spacecraft.thrusters.layout = four_z pushes only where it was turned to, and where a correction will "
            "push is not known ahead; must be six, or sites that push in every direction"
        )
