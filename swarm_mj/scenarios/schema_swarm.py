"""How the swarm coordinates: its class, 0 to 4, and the parts that make it; see docs/theory/coordination.md."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import ConfigDict, Field, model_validator

from swarm_mj.scenarios.schema_formation import Formation
from swarm_mj.scenarios.section import Section


class Swarm(Section):
    """What of movement, sensing and communication is coordinated; absent: the behaviour alone decides, as in class 2."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True
    )

    level: Literal[0, 1, 2, 3, 4] = Field(
        alias="class",
        description="0: every spacecraft alone, with its own downlink; 1: formation held, no shared sensing; 2: the roles of "
        "the behaviour; 3: sensing and relay planned together before the encounter, losses are not repaired; 4: replanned in "
        "flight by the swarm over its own links",
    )
    sensing: Literal["own", "behavior", "plan", "auction"] | None = Field(
        None,
        description="who looks where: each for itself; as the behaviour says; by the plan made before; by auction in flight; "
        "null: the class's own (own, own, behavior, plan, auction)",
    )
    relay: Literal["own", "behavior", "plan", "election"] | None = Field(
        None,
        description="who speaks to Earth: each for itself; as the behaviour says; the one of the plan; one that is elected "
        "over the links; null: the class's own (own, own, behavior, plan, election)",
    )
    plan_time_limit_s: float = Field(
        20.0, gt=0, le=86_400, description="after which the plan's solver stops without proof [s]"
    )
    silence_s: float = Field(
        45.0, gt=0, le=86_400, description="after which a spacecraft that is not heard of counts as lost [s]"
    )
    message_loss: float = Field(0.05, ge=0, le=1, description="chance that a message over a closed link is lost [-]")
    processing_s: float = Field(0.1, ge=0, le=3600, description="what a message takes aboard, beside its way [s]")
    formation: Formation | None = Field(
        None, description="what the thrusters hold; null: all coast; docs/theory/formation.md"
    )

    @model_validator(mode="after")
    def _alone_without_formation(self) -> Self:
        if self.level == 0 and self.formation is not None:
            raise ValueError(
                "formation: class 0 coordinates no movement; use class 1 or higher, or leave formation out"
            )
        return self
