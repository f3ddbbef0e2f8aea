"""How the swarm coordinates: its class, 0 to 4, and the parts that make it; see docs/theory/coordination.md."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import ConfigDict, Field, model_validator

from swarm_mj.scenarios.section import Section, Vector3


class Formation(Section):
    """Who keeps where relative to whom, how stiffly, and how far apart; needs thrusters that push in all directions."""

    reference: Literal["plan", "mean", "leader"] = Field(
        "plan",
        description="what places are relative to: the planned path of the swarm; the mean of those that a spacecraft has heard "
        "of; the one of them with the lowest number, which flies free",
    )
    shape: Literal["planned", "cartesian", "natural"] = Field(
        "planned",
        description="planned: each as its own planned path runs; cartesian: at offsets that stay; natural: as relative orbits, "
        "which fly on freely from offsets_m and offset_rates_m_s at start_s",
    )
    frame: Literal["N", "arrival"] = Field(
        "N",
        description="axes of the offsets: N; or those of the mean arrival, fixed in N: x away from the body and across the "
        "flight, y across both, z along the flight",
    )
    offsets_m: tuple[Vector3, ...] | None = Field(
        None, description="one per spacecraft [m]; null: where the plan has each at start_s"
    )
    offset_rates_m_s: tuple[Vector3, ...] | None = Field(
        None, description="one per spacecraft, for natural [m/s]; null: 0 with offsets_m, else as planned"
    )
    start_s: float = Field(
        60.0, ge=0, description="from when on it is held, past the epoch [s], until the flight's end"
    )
    bandwidth_rad_s: float = Field(
        0.02,
        gt=0,
        le=10,
        description="natural frequency of small position errors; at most 0.5 / control.period_s [rad/s]",
    )
    damping: float = Field(1.0, ge=0.3, le=5, description="damping ratio of small position errors [-]")
    dead_band_m: float = Field(5.0, ge=0, description="thrusters stay shut up to this position error [m]")
    min_separation_m: float | None = Field(
        None, ge=0, description="no two may come closer [m]; null: safety.min_separation_m; 0: nothing is done about it"
    )
    margin_m: float = Field(1.0, ge=0, description="added to it, for pulses and attitudes that are not exact [m]")
    message_s: float = Field(
        10.0,
        gt=0,
        le=86_400,
        description="between two messages that tell place and velocity, where reference is not plan [s]",
    )

    @model_validator(mode="after")
    def _offsets_fit(self) -> Self:
        if self.shape == "planned" and (self.offsets_m is not None or self.offset_rates_m_s is not None):
            raise ValueError("offsets_m, offset_rates_m_s: shape = planned takes none; use shape: cartesian or natural")
        if self.shape == "cartesian" and self.offset_rates_m_s is not None:
            raise ValueError("offset_rates_m_s: cartesian offsets stay; use shape: natural")
        if self.offset_rates_m_s is not None and self.offsets_m is None:
            raise ValueError("offset_rates_m_s: needs offsets_m as well")
        if self.offset_rates_m_s is not None and len(self.offset_rates_m_s) != len(self.offsets_m or ()):
            raise ValueError(
                f"offset_rates_m_s: {len(self.offset_rates_m_s)} for {len(self.offsets_m or ())} offsets_m; must be as many"
            )
        return self


class Swarm(Section):
    """What of movement, sensing and communication is coordinated; absent: the behaviour alone decides, as in class 2."""

    model_config = ConfigDict(populate_by_name=True, serialize_by_alias=True)

    level: Literal[0, 1, 2, 3, 4] = Field(
        alias="class",
        description="0: every spacecraft alone, with its own downlink; 1: as 0, formation held; 2: the roles of "
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
        description="who speaks to Earth: each for itself, and no pictures go over crosslinks; as the behaviour says; the one "
        "of the plan, which is not replaced; one that is elected over the links; null: the class's own (own, own, behavior, "
        "plan, election)",
    )
    plan_time_limit_s: float = Field(
        20.0, gt=0, le=86_400, description="after which the plan's solver stops without proof [s]"
    )
    silence_s: float = Field(
        45.0, gt=0, le=86_400, description="after which a spacecraft that is not heard of counts as lost [s]"
    )
    message_loss: float = Field(
        0.05,
        ge=0,
        le=1,
        description="chance that a message over a closed link is lost [-]; pictures are sent again until they are there, which "
        "leaves 1 - message_loss of the rate; at 1 nothing is relayed and nobody elected after the flight",
    )
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
