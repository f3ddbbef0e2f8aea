"""What readers rely on in the record of a design, design.json: the points to fly, and what a report says of the proof."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import FailFast, Field, NonNegativeFloat, PositiveInt

from swarm_mj.io.records import Record

#: Numbers of visiting points, at least one.
Points = Annotated[list[int], FailFast(), Field(min_length=1)]
#: Three coordinates.
Place = Annotated[list[float], Field(min_length=3, max_length=3)]


class Proof(Record):
    """The answer of the exact solver."""

    minimum: PositiveInt
    lower_bound: float
    status: str
    visiting_points: Annotated[list[int], FailFast()]
    covered_percent: float
    seconds: NonNegativeFloat


class Genetic(Record):
    """The answer of a genetic algorithm; a gene map begins with its length."""

    n_observers: int
    gene_map: Annotated[list[int], FailFast()]
    covered_percent: float
    designs_explored: int
    seconds: NonNegativeFloat


class MadeFor(Record):
    """What decides the candidates of a design, by dotted key; what is not named here is compared as it is."""

    volume_m3: float = Field(default=0.0, alias="body.volume_m3")
    area_m2: float = Field(default=0.0, alias="body.area_m2")
    behavior: str = Field(default="", alias="behavior.name")


class Certainty(Record):
    """The fewest spacecraft for one probability; no numbers where no design was found."""

    probability: float
    lower_bound: int
    n_observers: int | None = None
    promised: float | None = None
    low: float | None = None
    high: float | None = None
    candidates: Annotated[list[int], FailFast()] = []


class Verified(Record):
    """Flights of a design with other seeds, and Wilson's interval of the share that saw enough."""

    flights: PositiveInt
    failed: int
    covered: int
    low: float
    high: float
    promised: float
    inside: bool


class DesignRecord(Record):
    """design.json, see `swarm_mj.records.design_files.design_record`."""

    visiting_points: Points
    proof: Proof
    genetic: dict[Literal["repair", "plain"], Genetic]
    selected_by: str
    candidates_count: int
    tolerance_percent: float
    fold: int
    scenario: str = ""
    n_observers: PositiveInt = 1
    covered_percent: float = 0.0
    observers: Annotated[list[dict[str, Any]], FailFast()] = []
    gap: int | None = 0
    criterion: dict[str, Any] = {}
    camera: dict[str, Any] = {}
    made_for: MadeFor | None = None
    deliver_within_h: float | None = None
    delivered_by_h: float | None = None
    delivered_in_time: bool | None = None
    genetic_delivered_by_h: dict[str, float | None] = {}
    genetic_delivered_in_time: dict[str, bool | None] = {}
    designs_flown: int = 0
    b_plane: Annotated[list[dict[str, float | None]], FailFast()] = []
    probability: float | None = None
    nominal_minimum: int | None = None
    certainty: Annotated[list[Certainty], FailFast()] = []
    verified: Verified | None = None
    visiting_points_A_m: Annotated[list[Place], FailFast()] = []
