"""Reading campaigns: packaged ones by name, files by path."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, ValidationError

from swarm_mj.campaigns import maps
from swarm_mj.campaigns.config import Base, Campaign
from swarm_mj.campaigns.distributions import Distribution
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import ScenarioError
from swarm_mj.io.cache import hash_of
from swarm_mj.io.plain import shortened, shown
from swarm_mj.scenarios import loading
from swarm_mj.scenarios.bodies import PACKAGED_SHAPES
from swarm_mj.scenarios.schema import Scenario

#: Flights of a campaign: a year of computing at three seconds each.
MAX_ROWS = 10_000_000


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


def packaged_campaigns() -> list[str]:
    """Names of the packaged campaigns, sorted."""
    folder = resources.files("swarm_mj.scenarios") / "campaigns"
    if not folder.is_dir():
        return []
    return sorted(p.name.removesuffix(".yaml") for p in folder.iterdir() if p.name.endswith(".yaml"))


def packaged_descriptions() -> dict[str, str]:
    """What the packaged campaigns are for, by name."""
    return {
        name: loading.parse_yaml(_packaged_text(name), name).get("description", "") for name in packaged_campaigns()
    }


def _packaged_text(name: str) -> str:
    return (resources.files("swarm_mj.scenarios") / "campaigns" / f"{name}.yaml").read_text("utf-8")


def load_campaign(name_or_path: str | Path, *, runs: int | None = None) -> Resolved:
    """Read a campaign and the scenarios it flies.

    Args:
        name_or_path: A packaged name (see `packaged_campaigns`) or the path of a YAML file.
        runs: Takes the place of the file's `runs`.

    Raises:
        ScenarioError: Missing, unreadable or invalid; the message names the key, the value and what is allowed.
    """
    text, source, folder = _read(str(name_or_path))
    # YAML reads an unquoted date as one; here it stays text, which workers and results are told.
    data = json.loads(json.dumps(loading.parse_yaml(text, source), default=lambda moment: moment.isoformat()))
    if _is_scenario(data):
        raise _scenario_instead(source)
    if runs is not None:
        data["runs"] = runs
    return resolve(data, source, folder)


def resolve(data: dict[str, Any], source: str, folder: Path = Path()) -> Resolved:
    """A campaign from the keys of its file, with the scenarios it flies.

    Args:
        data: As a file has it.
        source: What errors call it.
        folder: Which paths are relative to.

    Raises:
        ScenarioError: As `load_campaign`.
    """
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


def _scenario_instead(source: str) -> ScenarioError:
    return ScenarioError(f"{shortened(source)}: this is a scenario; fly it with `swarm-mj run`")


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
    known = packaged_campaigns()
    if name_or_path not in known:
        if name_or_path in loading.packaged_names():
            raise _scenario_instead(name_or_path)
        raise ScenarioError(
            f"{shortened(name_or_path)}: no such campaign. Packaged: {', '.join(known)}. The name of a file must end in .yaml"
        )
    return _packaged_text(name_or_path), name_or_path, Path()


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
    beside = folder / base.scenario
    source = str(beside) if beside.suffix in {".yaml", ".yml"} else base.scenario
    overrides = {**campaign.overrides, **base.overrides}
    try:
        return loading.load_scenario(
            source, [f"{key}={json.dumps(value, ensure_ascii=False)}" for key, value in overrides.items()]
        )
    except ScenarioError as error:
        raise ScenarioError(f"scenarios, {base.label}: {error}".replace("--set ", "set: ")) from None


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
    single = tuple(label for label, base in bases.items() if maps.serve_once(campaign, label, base, scenario_of))
    replaced = {label: maps.observed_by_buffers(bases[label]) for label in single}
    return resolved._replace(bases={**bases, **replaced}, without_maps=single)


def _hashes(scenarios: Iterable[Scenario]) -> Iterator[tuple[str, str]]:
    """Path and hash of every file that scenarios read besides their own."""
    for scenario in scenarios:
        if scenario.body.shape not in PACKAGED_SHAPES:
            yield scenario.body.shape, _hash_of_file("body.shape", scenario.body.shape)
        if scenario.spacecraft.mjcf is not None:
            yield scenario.spacecraft.mjcf, _hash_of_file("spacecraft.mjcf", scenario.spacecraft.mjcf)


def _hash_of_file(key: str, path: str) -> str:
    try:
        return hash_of(Path(path).read_bytes().hex())
    except OSError as error:
        raise ScenarioError(f"{key} = {path}: cannot be read ({error.strerror})") from None


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
