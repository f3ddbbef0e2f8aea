"""The formation that a swarm holds with its thrusters; see docs/theory/formation.md."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

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
    frame: Literal["N", "visit"] = Field(
        "N",
        description="axes of the offsets: N; or those of the mean visit, fixed in N: x away from the body and across the "
        "flight, y across both, z along the flight",
    )
    offsets_m: tuple[Vector3, ...] | None = Field(
        None, description="one per spacecraft [m]; null: where the plan has each at start_s"
    )
    offset_rates_m_s: tuple[Vector3, ...] | None = Field(
        None, description="one per spacecraft, for natural [m/s]; null: 0 with offsets_m, else as planned"
    )
    start_s: float = Field(60.0, ge=0, description="from when on it is held, past the epoch [s]")
    end_s: float | None = Field(None, gt=0, description="until when [s]; null: the end of the flight")
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
        if self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(f"end_s = {self.end_s:g}: must be after start_s = {self.start_s:g}")
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
