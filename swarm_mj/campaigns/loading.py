"""Reading campaigns: packaged ones by name, files by path."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
from pydantic import BaseModel, ValidationError

from swarm_mj.campaigns.config import Base, Campaign
from swarm_mj.campaigns.distributions import Distribution
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import ScenarioError, SwarmError
from swarm_mj.flight.environment import load_body_shape
from swarm_mj.flight.targets import target_from, true_target
from swarm_mj.io.cache import hash_of
from swarm_mj.io.records import bytes_of, reading
from swarm_mj.io.values import check_data, shortened, shown
from swarm_mj.plugins import file_of
from swarm_mj.scenarios import loading
from swarm_mj.scenarios.bodies import PACKAGED_SHAPES, packaged_files
from swarm_mj.scenarios.loading import ScenarioSource
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_io import MAX_FILE_BYTES

#: Flights of a campaign: a year of computing at three seconds each.
MAX_ROWS = 10_000_000
#: Keys and sections of a scenario that decide where the target's cells lie.
CELL_KEYS = (
    "body.shape",
    "body.shape_unit",
    "target",
    "design.imaging_altitude_m",
    "camera.half_angle_deg",
    "dispersions.target_m",
)
#: Runs of a scenario whose targets are compared; they are spread over the campaign.
PROBES = 8


class Resolved(NamedTuple):
    """A campaign with all that its file refers to.

    Attributes:
        campaign: The file.
        bases: The scenarios by name, in order, with every value filled in.
        shapes: Hash of every file of a shape or a spacecraft, by path.
        without_maps: Scenarios that ask for horizon maps which would serve one run each; they are observed by face-ID
            buffers instead. Empty in a campaign that was restored.
    """

    campaign: Campaign
    bases: dict[str, Scenario]
    shapes: dict[str, str]
    without_maps: tuple[str, ...] = ()

    def dump(self) -> dict[str, Any]:
        """Plain values, from which `restore` makes the same campaign in another process."""
        return {
            "campaign": self.campaign.model_dump(mode="json", by_alias=True),
            "bases": {name: base.model_dump(mode="json") for name, base in self.bases.items()},
            "shapes": self.shapes,
        }

    def dumps(self) -> str:
        """The same as one line of JSON."""
        return json.dumps(self.dump())


def restore(text: str) -> Resolved:
    """A campaign from what `Resolved.dumps` gave."""
    data = json.loads(text)
    bases = {name: Scenario.model_validate(base) for name, base in data["bases"].items()}
    return Resolved(Campaign.model_validate(data["campaign"]), bases, data["shapes"])


def load_campaign(
    source: ScenarioSource, overrides: Mapping[str, Any] = loading.NO_OVERRIDES, *, runs: int | None = None
) -> Resolved:
    """Read a campaign and the scenarios it flies.

    Args:
        source: A packaged name (see `swarm_mj.available`), the path of a YAML file, or what such a file holds as a mapping. A
            scenario instead, as `load_scenario` takes it, is flown again and again, each time with another seed.
        overrides: Values by dotted key, in all scenarios; they go before the file's `set`.
        runs: Takes the place of the file's `runs`.

    Raises:
        ScenarioError: Missing, unreadable or invalid; the message names the key, the value and what is allowed.
    """
    data, origin, folder = _mapping_of(source)
    if overrides:
        given = data.get("set", {})
        data["set"] = {**(given if isinstance(given, Mapping) else {}), **loading.checked_overrides(overrides)}
    if runs is not None:
        data["runs"] = runs
    return resolve(data, origin, folder)


def _mapping_of(source: ScenarioSource) -> tuple[dict[str, Any], str, Path]:
    """What a campaign's file holds, its origin for errors, and the folder that paths in it are relative to."""
    if isinstance(source, str | Path) and str(source) in loading.packaged_names():
        return _campaign_of(loading.load_scenario(source))
    if isinstance(source, Scenario):
        return _campaign_of(source)
    if isinstance(source, Mapping):
        check_data(source, "campaign")
        data, origin, folder = dict(source), "campaign", Path()
    else:
        text, origin, folder = _read(str(source))
        data = loading.parse_yaml(text, origin)
    if _is_scenario(data):
        return _campaign_of(loading.load_scenario(source))
    # YAML reads an unquoted date as one; here it stays text, which workers and results are told.
    return json.loads(json.dumps(data, default=lambda moment: moment.isoformat())), origin, folder


def _campaign_of(scenario: Scenario) -> tuple[dict[str, Any], str, Path]:
    """A campaign of one scenario, in which nothing but the seed differs."""
    name = f"{scenario.name}-campaign"
    return {"name": name, "scenarios": [{"scenario": scenario.model_dump(mode="json")}]}, name, Path()


def resolve(data: dict[str, Any], source: str, folder: Path = Path()) -> Resolved:
    """A campaign from the keys of its file, `source` in errors, with the scenarios it flies; errors as `load_campaign`."""
    campaign = _validated(data, source)
    scenarios = [_load_base(base, campaign, folder) for base in campaign.scenarios]
    campaign = _with_labels(campaign, scenarios, source)
    bases = dict(zip((base.label for base in campaign.scenarios), scenarios, strict=True))
    resolved = Resolved(campaign, bases, dict(_hashes(bases.values())))
    _try_one_of_each(resolved, source)
    return _without_single_maps(resolved)


def _is_scenario(data: Mapping[str, Any]) -> bool:
    """Whether a mapping has keys of a scenario alone, and none of a campaign alone."""
    ours, theirs = set(_allowed(())), set(Scenario.model_fields)
    return bool(data.keys() & (theirs - ours)) and not data.keys() & (ours - theirs)


def _validated(data: dict[str, Any], source: str) -> Campaign:
    """The campaign of a file, of a size that can be flown."""
    try:
        campaign = Campaign.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(f"{source}:\n{loading.listed(error, explained)}") from None
    rows = Sample(campaign).rows
    if rows > MAX_ROWS:
        raise ScenarioError(
            f"{source}:\n  runs = {campaign.runs}: with method = {campaign.method}, {len(campaign.parameters)} parameters and "
            f"{len(campaign.scenarios)} scenarios these are {rows} flights: at most {MAX_ROWS} (MAX_ROWS)"
        )
    return campaign


def scenario_of(base: Scenario, values: Mapping[str, Any], seed: int) -> Scenario:
    """A base scenario with drawn values and the run's seed.

    Raises:
        ScenarioError: A key is unknown or a value not allowed.
    """
    data = base.model_dump(mode="json")
    for key, value in values.items():
        _put(data, key, value)
    data["seed"] = seed
    return loading.scenario_from(data, f"{base.name} with drawn parameters")


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    node: Any = data
    *parents, last = key.split(".")
    for level, name in enumerate(parents):
        node = node[_index(key, name, node)] if isinstance(node, list) else node.setdefault(name, {})
        if not isinstance(node, (dict, list)):
            raise ScenarioError(
                f"parameters.{key}: {'.'.join(parents[: level + 1])} is a single value, it has no keys inside"
            )
    node[_index(key, last, node) if isinstance(node, list) else last] = value


def _index(key: str, text: str, node: list[Any]) -> int:
    if not node:
        raise ScenarioError(f"parameters.{key}: {text!r} names an entry of a list that is empty")
    if not text.isdecimal() or int(text) >= len(node):
        raise ScenarioError(f"parameters.{key}: {text!r} must be a number from 0 to {len(node) - 1}")
    return int(text)


def _read(name_or_path: str) -> tuple[str, str, Path]:
    """Text, origin for errors, and the folder that paths in it are relative to."""
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml"} or os.sep in name_or_path:
        return loading.file_text(path, "campaign"), str(path), path.parent
    known = packaged_files("campaigns")
    if name_or_path not in known:
        raise ScenarioError(
            f"{shortened(name_or_path)}: no such campaign. Packaged: {', '.join(known)}. The name of a file must end in .yaml"
        )
    return known[name_or_path].read_text("utf-8"), name_or_path, Path()


def _with_labels(campaign: Campaign, scenarios: list[Scenario], source: str) -> Campaign:
    """The campaign with a label for every scenario: its own name where the campaign gives none."""
    bases = tuple(
        base if base.name else base.model_copy(update={"name": scenario.name})
        for base, scenario in zip(campaign.scenarios, scenarios, strict=True)
    )
    labels = [base.label for base in bases]
    for label in labels:
        if labels.count(label) > 1:
            raise ScenarioError(f"{source}: scenarios: two are called {label!r}; give each a name")
    return campaign.model_copy(update={"scenarios": bases})


def _load_base(base: Base, campaign: Campaign, folder: Path) -> Scenario:
    source: str | dict[str, Any] = base.scenario
    if isinstance(source, str) and Path(source).suffix in {".yaml", ".yml"}:
        source = str(folder / source)
    overrides = {**campaign.overrides, **base.overrides}
    try:
        return loading.load_scenario(source, overrides)
    except ScenarioError as error:
        raise ScenarioError(f"scenarios, {base.label}: {error}") from None


def _try_one_of_each(resolved: Resolved, source: str) -> None:
    """Build the first run of every scenario, so that a wrong key is found before anything flies."""
    sample = Sample(resolved.campaign)
    for row in range(len(resolved.bases)):
        trial = sample.trial(row)
        try:
            scenario_of(resolved.bases[trial.scenario], trial.values, trial.seed)
        except ScenarioError as error:
            raise ScenarioError(f"{source}: {error}") from None


def _without_single_maps(resolved: Resolved) -> Resolved:
    """The campaign with face-ID buffers in place of horizon maps that would serve one run each."""
    campaign, bases = resolved.campaign, resolved.bases
    single = tuple(label for label, base in bases.items() if _maps_serve_once(campaign, label, base))
    for label in single:
        observation = bases[label].observation.model_copy(update={"observer": "raster"})
        bases = {**bases, label: bases[label].model_copy(update={"observation": observation})}
    return resolved._replace(bases=bases, without_maps=single)


def _maps_serve_once(campaign: Campaign, label: str, base: Scenario) -> bool:
    """Whether a scenario asks for horizon maps that would serve one run each.

    Where the target's cells differ from run to run, every map would be traced, kept on disk and used for a single run; face-ID
    buffers, drawn by compiled code in about a millisecond each, need none. The answer depends on the campaign alone, so that
    rows stay the same whoever flies them and in whichever order. A campaign that draws `observation.observer` means what it
    draws.
    """
    if base.observation.observer != "horizon" or not base.observation.occlusion:
        return False
    if _is_drawn("observation.observer", campaign):
        return False
    if not (base.dispersions.target_m > 0.0 or any(_is_drawn(key, campaign) for key in CELL_KEYS)):
        return False
    targets = list(_targets(campaign, label, base))
    return len(targets) > 1 and len(set(targets)) == len(targets)


def _is_drawn(key: str, campaign: Campaign) -> bool:
    """Whether a key, its section or something inside it is drawn."""
    return any(f"{key}.".startswith(f"{drawn}.") or drawn.startswith(f"{key}.") for drawn in campaign.parameters)


def _targets(campaign: Campaign, label: str, base: Scenario) -> Iterator[str]:
    """Hashes of the targets of some runs; runs whose values allow none are left out."""
    sample = Sample(campaign)
    shapes: dict[str, ShapeModel] = {}
    place, scenarios = sample.names.index(label), len(sample.names)
    for run in np.unique(np.linspace(0, sample.runs - 1, PROBES).astype(int)):
        trial = sample.trial(int(run) * scenarios + place)
        try:
            yield _target(scenario_of(base, trial.values, trial.seed), shapes)
        except SwarmError:
            continue


def _target(scenario: Scenario, shapes: dict[str, ShapeModel]) -> str:
    body = scenario.body.model_dump_json()
    if body not in shapes:
        shapes[body] = load_body_shape(scenario.body)
    region = true_target(scenario, shapes[body], target_from(scenario, shapes[body]))
    return hash_of(region.vertices, region.faces, region.corners_A)


def _hashes(scenarios: Iterable[Scenario]) -> Iterator[tuple[str, str]]:
    """Path and hash of every file that scenarios read besides their own."""
    for scenario in scenarios:
        if scenario.body.shape not in PACKAGED_SHAPES:
            yield scenario.body.shape, _hash_of_file("body.shape", scenario.body.shape)
        if scenario.spacecraft.mjcf is not None:
            yield scenario.spacecraft.mjcf, _hash_of_file("spacecraft.mjcf", scenario.spacecraft.mjcf)
        if scenario.target.polygon_file is not None:
            yield scenario.target.polygon_file, _hash_of_file("target.polygon_file", scenario.target.polygon_file)
        own = {"control.controller": scenario.control.controller, "behavior.name": scenario.behavior.name}
        for key, name in (own | {"body.gravity.model": scenario.body.gravity.model}).items():
            if (place := file_of(name)) is not None:
                yield str(place[0]), _hash_of_file(key, str(place[0]))


def _hash_of_file(key: str, path: str) -> str:
    with reading(f"{key} = {path}", "give the path of a file", ScenarioError):
        return hash_of(np.frombuffer(bytes_of(Path(path), MAX_FILE_BYTES), np.uint8))


def explained(error: Any) -> str:
    """One error in words: key, value, what is allowed."""
    keys = [part for k, part in enumerate(error["loc"]) if not (k == 2 and error["loc"][0] == "parameters")]
    key = ".".join(map(str, keys))
    if error["type"] == "extra_forbidden":
        allowed = _allowed(error["loc"])
        close = difflib.get_close_matches(str(keys[-1]), allowed, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        return f"  {key}: unknown key.{hint}" + (f" Allowed: {', '.join(allowed)}" if allowed else "")
    if error["type"] == "missing":
        return f"  {key}: missing, a value is required"
    if error["type"] == "union_tag_not_found":
        return f"  {key}.distribution: missing; allowed: {', '.join(_laws())}"
    if error["type"] == "union_tag_invalid":
        return f"  {key}.distribution = {shown(error['ctx']['tag'])}: unknown; allowed: {', '.join(_laws())}"
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "value_error":
        return f"  {key}{'' if message.startswith('.') or not key else '.'}{message}"
    return f"  {key} = {shown(error['input'])}: {message[0].lower()}{message[1:]}"


def _laws() -> dict[str, type[BaseModel]]:
    """The distributions by name."""
    members = get_args(get_args(Distribution)[0])
    return {get_args(member.model_fields["distribution"].annotation)[0]: member for member in members}


def _allowed(loc: tuple[Any, ...]) -> list[str]:
    model: type[BaseModel] = Campaign
    if len(loc) > 1 and loc[0] == "scenarios":
        model = Base
    if len(loc) > 3 and loc[0] == "parameters":
        model = _laws().get(str(loc[2]), Campaign)
    return [field.alias or name for name, field in model.model_fields.items()]
