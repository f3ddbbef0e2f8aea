"""The campaign file: which scenarios are flown how often, with which parameters drawn from which distributions."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from swarm_mj.campaigns.distributions import Distribution
from swarm_mj.scenarios.schema import Section

#: What is recorded of every run unless the file says otherwise; see `swarm_mj.campaigns.flying`.
RECORD = (
    "coverage_percent",
    "coverage_percent_passage",
    "pointing_error_deg_arrival.max",
    "pointing_error_deg_p95",
    "pointing_error_deg_before_switch.max",
    "pointing_error_deg_final.max",
    "max_wheel_speed_fraction",
    "wheel_saturation_s.max",
    "link_closed_percent.mean",
    "links_closed_final",
    "delivered_percent",
    "time_to_all_data_s",
    "deployment_delta_v_m_s.max",
    "near_collisions",
    "lost",
    "images",
)

#: Columns of the results that every campaign has; see `swarm_mj.campaigns.store`.
FIXED_COLUMNS = ("row", "run", "scenario", "seed", "status", "error", "covered", "spacecraft", "events", "wall_s")


class Base(Section):
    """A scenario that the campaign flies."""

    model_config = ConfigDict(populate_by_name=True)

    name: str = Field(
        "", pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]*$|^$", description="in results; default: the scenario's"
    )
    scenario: str | dict[str, Any] = Field(
        description="packaged name, path of a scenario file relative to the campaign file, or what such a file holds"
    )
    overrides: dict[str, Any] = Field(default_factory=dict, alias="set", description="values by dotted key")

    @model_validator(mode="before")
    @classmethod
    def _a_name_alone_will_do(cls, value: Any) -> Any:
        return {"scenario": value} if isinstance(value, str) else value

    @property
    def label(self) -> str:
        """What results call it; until the scenario is read, by its file where the campaign gives no name."""
        given = self.scenario
        return self.name or (PurePath(given).stem if isinstance(given, str) else str(given.get("name", "scenario")))


class Campaign(Section):
    """A whole campaign."""

    model_config = ConfigDict(populate_by_name=True)

    name: str = Field(
        min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", description="what results and their folder are called"
    )
    description: str = Field("", description="one line on what the campaign is")
    seed: int = Field(0, ge=0, lt=2**63, description="of all draws and of the seeds of the runs")
    runs: int = Field(
        100,
        ge=1,
        le=10_000_000,
        description="flights of each scenario; of each point of a grid; of the two base samples where the method is saltelli",
    )
    method: Literal["monte_carlo", "latin_hypercube", "sobol", "grid", "saltelli"] = Field(
        "monte_carlo",
        description="how parameters are drawn; sobol is a scrambled Sobol' sequence; saltelli the scheme of samples that "
        "Sobol' indices need: runs x (parameters + 3) flights",
    )
    paired: bool = Field(
        False, description="whether run k of every scenario has the same seed and drawn values; not with saltelli"
    )
    scenarios: tuple[Base, ...] = Field(min_length=1, max_length=1000, description="what is flown, each `runs` times")
    overrides: dict[str, Any] = Field(
        default_factory=dict, alias="set", description="values by dotted key, in all scenarios"
    )
    parameters: dict[str, Distribution] = Field(
        default_factory=dict,
        description="what is drawn: dotted key of the scenario (components by number), distribution",
    )
    record: tuple[str, ...] = Field(RECORD, min_length=1, description="what is kept of every run's summary")
    telemetry: bool = Field(False, description="also keep every run's telemetry as NetCDF")
    time_limit_s: float | None = Field(
        None, gt=0, description="a local run that takes longer is stopped and has failed"
    )

    @field_validator("parameters")
    @classmethod
    def _keys_may_be_drawn(cls, value: dict[str, Any]) -> dict[str, Any]:
        for key, law in value.items():
            if key in ("seed", "name", "description"):
                raise ValueError(f".{key}: cannot be drawn; every run gets a seed of its own from the campaign's seed")
            if key in FIXED_COLUMNS:
                raise ValueError(
                    f".{key}: cannot be drawn as a whole, for a column of the results has that name; draw values inside it"
                )
            designs = getattr(law, "values", ()) if key == "design" else ()
            if key == "design.reference" or any(isinstance(one, dict) and "reference" in one for one in designs):
                raise ValueError(
                    f".{key}: a design cannot be drawn by its reference; list one scenario per design instead"
                )
        return value

    @model_validator(mode="after")
    def _numbers_fit_together(self) -> Self:
        if self.method in ("sobol", "saltelli") and self.runs & (self.runs - 1):
            raise ValueError(f"runs = {self.runs}: must be a power of 2 where method = {self.method}")
        if self.paired and self.method == "saltelli":
            raise ValueError(
                "paired = true: must be false where method = saltelli, which compares parameters, not scenarios"
            )
        if self.method in ("grid", "saltelli") and not self.parameters:
            raise ValueError(f"parameters: at least one is needed where method = {self.method}")
        return self
