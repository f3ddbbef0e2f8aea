"""Sections of a scenario about who visits which point, when and how high."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, model_validator

from swarm_mj.scenarios.section import Section

#: Where an observer looks inside the imaging radius.
Aim = Literal["centre", "point"]


class Visit(Section):
    """What one observer does; keys that are absent or null take the common values of `design`."""

    target: int = Field(0, ge=0, description="0: the scenario's target; k: entry k of designer.extra_targets, from 1")
    visiting_point: int | None = Field(
        None, ge=1, description="of that target, numbered from 1; null: this observer's entry of design.visiting_points"
    )
    imaging_altitude_m: float | None = Field(None, gt=0, description="of its point above the mesh vertex [m]")
    time_of_flight_s: float | None = Field(None, gt=0, description="from its release to its visiting point [s]")
    release_s: float | None = Field(
        None, ge=0, description="time past the epoch at which the mothership releases it [s]"
    )
    aim: Aim | None = Field(None, description="where it looks, see design.aim")


class Design(Section):
    """Who visits which point, when and how high."""

    reference: str | None = Field(
        None,
        description="a design that `swarm-mj design` made: packaged name, or path of its design.json; read when no "
        "visiting_points are given",
    )
    visiting_points: tuple[int, ...] = Field(
        (7, 25, 31, 34, 38),
        min_length=1,
        max_length=100_000,
        description="one point per observer, numbered from 1 in mesh order: the vertices of the original mesh inside the "
        "target's pyramid or on its planes; corners that clipping makes are none",
    )
    imaging_altitude_m: float = Field(14_000.0, gt=0, description="of a visiting point above its mesh vertex [m]")
    projection: Literal["radial", "normal"] = Field(
        "radial",
        description="whether points are lifted away from the body's centre or along the vertex normal; not said by the paper",
    )
    time_of_flight_s: float = Field(600.0, gt=0, description="from the mothership to the visiting point [s]")
    release_s: float = Field(0.0, ge=0, description="time past the epoch at which spacecraft leave the mothership [s]")
    aim: Aim = Field(
        "centre",
        description="where observers look inside the imaging radius when the behaviour has them look at the body's centre: "
        "there, or at the mesh vertex below their own visiting point",
    )
    observers: tuple[Visit, ...] = Field(
        (),
        max_length=100_000,
        description="one entry per observer with its own target, point, altitude, time of flight or release; empty: all take "
        "the values above; see docs/how-to/itinerary.md",
    )

    @model_validator(mode="before")
    @classmethod
    def _points_of_observers(cls, data: Any) -> Any:
        """Points that only the observers' entries name are the design's."""
        if not isinstance(data, dict) or "visiting_points" in data:
            return data
        entries = data.get("observers")
        if not isinstance(entries, list | tuple) or not entries or not all(isinstance(e, dict) for e in entries):
            return data
        points = [entry.get("visiting_point") for entry in entries]
        if None in points:
            k = points.index(None)
            raise ValueError(f"observers.{k}.visiting_point: must be given where there are no visiting_points")
        return {**data, "visiting_points": points}

    @model_validator(mode="after")
    def _observers_fit_their_points(self) -> Self:
        if not self.observers:
            return self
        if len(self.observers) != len(self.visiting_points):
            raise ValueError(
                f"observers: has {len(self.observers)} entries and visiting_points {len(self.visiting_points)}: must be as "
                "many, or give only one of the two"
            )
        for k, (arrival, point) in enumerate(zip(self.observers, self.visiting_points, strict=True)):
            if arrival.visiting_point not in (None, point):
                raise ValueError(
                    f"observers.{k}.visiting_point = {arrival.visiting_point}: must be {point} as in visiting_points, or give "
                    "only one of the two"
                )
        return self
