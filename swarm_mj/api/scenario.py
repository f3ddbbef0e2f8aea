"""Scenarios as users meet them: read by name, path or mapping, shown in notebooks, listed, and in flight step by step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import yaml

from swarm_mj.api.display import figure_html, rows_html
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.io.atomic import atomic_file
from swarm_mj.records.observed import when_text
from swarm_mj.scenarios import catalogue, schema
from swarm_mj.scenarios.itinerary import all_targets, target_text
from swarm_mj.scenarios.keys import Key
from swarm_mj.scenarios.loading import (
    NO_OVERRIDES,
    ScenarioSource,
    checked_overrides,
    design_overrides,
    design_section,
    load_scenario,
)

if TYPE_CHECKING:
    from swarm_mj.simulator.simulation import Simulation

#: What the short table of a scenario shows, by its words.
SHOWN: dict[str, Callable[[schema.Scenario], str]] = {
    "body": lambda s: f"{s.body.name}, gravity by {s.body.gravity.model}",
    "target": lambda s: "; ".join(map(target_text, all_targets(s))),
    "observers visit points": lambda s: ", ".join(map(str, s.design.visiting_points)),
    "imaging altitude": lambda s: f"{s.design.imaging_altitude_m / 1e3:g} km",
    "arrival": lambda s: f"after {s.design.time_of_flight_s:g} s of {s.duration_s:g} s",
    "camera": lambda s: f"half-angle {s.camera.half_angle_deg:g}°, {s.camera.resolution_px} px",
    "counts as observed": lambda s: when_text(s.observation.model_dump()),
    "behaviour": lambda s: s.behavior.name,
    "control law": lambda s: s.control.controller,
    "seed": lambda s: str(s.seed),
}


class Scenario(schema.Scenario):
    """Every number of a mission, checked on reading; immutable. `load` reads one, `swarm_mj.fly` flies it.

    Attributes are the sections of a scenario file (`body`, `target`, `design`, `camera`, ...), each with its keys; see the
    reference of scenario keys for units, defaults and allowed values.
    """

    @classmethod
    def of(cls, scenario: schema.Scenario) -> Scenario:
        """The same scenario with what this class adds."""
        if isinstance(scenario, cls):
            return scenario
        return cls.model_construct(_fields_set=scenario.model_fields_set, **dict(scenario))

    def changed(self, overrides: Mapping[str, Any]) -> Scenario:
        """A scenario with some values changed.

        Args:
            overrides: Values by dotted key, e.g. `{"camera.half_angle_deg": 6}`.

        Raises:
            ScenarioError: A key does not exist or a value is not allowed.
        """
        return load(self, overrides)

    def plan(self) -> Plan:
        """Target, visiting points and trajectories, ready to fly; what `swarm_mj.fly` begins with.

        Raises:
            SwarmError: Shape, target, plug-in or trajectory cannot be had.
        """
        return make_plan(self)

    def save(self, path: str | Path) -> Path:
        """Write the scenario as a YAML file that `load` and the command line read, every key spelled out.

        Raises:
            OutputError: The file cannot be written.
        """
        text = yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False)
        with atomic_file(Path(path)) as partial:
            partial.write_text(text, encoding="utf-8")
        return Path(path)

    def __repr__(self) -> str:
        """One line: what it is, without its numbers."""
        return f"Scenario({self.name!r}, {len(self.design.visiting_points)} observers past {self.body.name})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """For notebooks: a short table and the target with its visiting points."""
        from swarm_mj.figures.target import draw_target

        rows = [(words, look(self)) for words, look in SHOWN.items()]
        return rows_html(self.name, self.description, rows) + figure_html(lambda: draw_target(self.plan()))


def load(
    source: ScenarioSource,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    seed: int | None = None,
    design: str | Path | None = None,
    policy: str | None = None,
) -> Scenario:
    """Read a scenario; `fly`, `design` and all others that take one read what they are given in the same way.

    Args:
        source: A packaged name (see `available`), the path of a YAML file, what such a file holds as a mapping, or a scenario.
        overrides: Values by dotted key, e.g. `{"camera.half_angle_deg": 6}`.
        seed: Of the random initial attitudes, faults and dispersions; None: the scenario's.
        design: A design.json of `swarm_mj.design`, or the name of a packaged design, whose points are visited.
        policy: Who points at what instead of the scenario's behaviour: a policy file, `trained`, or the name of a scripted one.

    Raises:
        ScenarioError: Missing, unreadable or invalid; the message names the key, the value and what is allowed.
        MissionError: There is no such policy.

    Examples:
        >>> load("eros-config2", {"camera.half_angle_deg": 6}).camera.half_angle_deg
        6.0
    """
    asked = {**checked_overrides(overrides), **({} if seed is None else {"seed": seed})}
    if design is not None:
        asked |= {"design.reference": design, **design_overrides(design_section(str(design)))}
    scenario = load_scenario(source, asked)
    if policy is not None:
        from swarm_mj.envs.policies.policy_behavior import policy_overrides

        scenario = load_scenario(source, {**asked, **policy_overrides(policy, scenario)})
    return Scenario.of(scenario)


def available() -> pd.DataFrame:
    """What can be named: scenarios for `load`, campaigns for `campaign`, and installed plug-ins; with kind and description.

    A plug-in that cannot be loaded is listed with the reason.
    """
    return pd.DataFrame(catalogue.available(), columns=catalogue.Named._fields).set_index("name")


def explain(name: str = "") -> pd.DataFrame:
    """Explain keys of a scenario, or the arguments of a plug-in.

    Args:
        name: A section (`camera`, `body.gravity`, `faults.wheel_lost`), a key (`camera.half_angle_deg`) or a plug-in
            (`mrp_sliding_mode`); empty: every key there is.

    Returns:
        One row a key, by its dotted name: type, unit, default, what is allowed, meaning; texts, empty where there is nothing
        to say.

    Raises:
        ScenarioError: There is no such section, key or plug-in.
        PluginError: The plug-in cannot be loaded.
    """
    return pd.DataFrame(catalogue.explained(name), columns=["key", *Key._fields[1:]]).set_index("key")


def simulation(
    scenario: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES, *, geometry: bool = False
) -> Simulation:
    """The simulation of a scenario at its start, to be stepped by hand.

    `sim.step()` decides and integrates one control period; `sim.data` and `sim.model.mjmodel` are MuJoCo's MjData and MjModel,
    live; `sim.time` is the time of the flight [s].

    Args:
        scenario: What to fly, as `load` takes it.
        overrides: Values by dotted key that change it.
        geometry: Whether the model holds shapes, cameras and light as well, for MuJoCo's own viewers and renderer.

    Raises:
        SwarmError: The scenario cannot be flown.
    """
    from swarm_mj.flight.fly import make_simulation

    return make_simulation(make_plan(load(scenario, overrides)), geometry=geometry)


def view(scenario: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES, *, speed: float = 10.0) -> None:
    """Fly a scenario in MuJoCo's viewer until its window is closed; needs a display.

    Args:
        scenario: What to fly, as `load` takes it.
        overrides: Values by dotted key that change it.
        speed: Seconds of flight per second at the start.

    Raises:
        SwarmError: The scenario cannot be flown, no window can be opened, or the speed is out of range.
    """
    from swarm_mj.rendering.viewer import run_view

    run_view(load(scenario, overrides), speed=speed)
