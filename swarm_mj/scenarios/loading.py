"""Reading scenarios: packaged ones by name, files by path, what such a file holds, and single values by their dotted keys."""

from __future__ import annotations

import difflib
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from copy import deepcopy
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from swarm_mj.errors import ScenarioError
from swarm_mj.io.records import bytes_of, one_line, reading, record_from
from swarm_mj.io.values import MAX_DEPTH, check_data, shortened, shown
from swarm_mj.plugins import file_of
from swarm_mj.scenarios.bodies import PACKAGED_SHAPES, expanded_body, packaged_body, packaged_files
from swarm_mj.scenarios.coverage_relations import with_ground_resolution
from swarm_mj.scenarios.design_record import DesignRecord
from swarm_mj.scenarios.explaining import explained, listed
from swarm_mj.scenarios.limits import MAX_INTEGER_CHARACTERS, check_work
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_mothership import FILES
from swarm_mj.scenarios.schema_sensors import sensor_class
from swarm_mj.scenarios.schema_sequence import read_sequence

#: What a scenario is read from: a packaged name, the path of a YAML file, what such a file holds, or a scenario.
ScenarioSource = str | Path | Mapping[str, Any] | Scenario
#: No value of a scenario is changed.
NO_OVERRIDES: Mapping[str, Any] = MappingProxyType({})
#: Sections that a name may stand for, and what gives their keys.
NAMED = {"body": packaged_body, "spacecraft.sensors": sensor_class}

#: A scenario is a page of text; anything larger is a mistake or an attack.
MAX_BYTES = 1_000_000

_OPENING = (
    yaml.BlockSequenceStartToken,
    yaml.BlockMappingStartToken,
    yaml.FlowSequenceStartToken,
    yaml.FlowMappingStartToken,
)
_CLOSING = (yaml.BlockEndToken, yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken)


def packaged_names() -> list[str]:
    """Names of the packaged scenarios, sorted."""
    return list(packaged_files())


def packaged(name: str) -> str:
    """Text of a packaged scenario, a start for a file of one's own.

    Raises:
        ScenarioError: There is none of that name; the message lists them.
    """
    known = packaged_files()
    if name not in known:
        if name in packaged_files("campaigns"):
            raise ScenarioError(_is_campaign(name))
        close = difflib.get_close_matches(name, known, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise ScenarioError(
            f"{shortened(name)}: no such scenario.{hint} Packaged: {', '.join(known)}. The name of a file must end in .yaml"
        )
    return known[name].read_text("utf-8")


def _is_campaign(source: str) -> str:
    return f"{source}: this is a campaign; fly it with `swarm-mj campaign {source}`"


def load_scenario(source: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES) -> Scenario:
    """Read a scenario and apply overrides.

    Args:
        source: A packaged name (see `packaged_names`), whatever stands in the current folder; the path of a YAML file; what
            such a file holds, as a mapping, whose paths are relative to the current folder; or a scenario.
        overrides: Values by dotted key, e.g. `{"camera.half_angle_deg": 3}`; numbers, arrays and paths may be NumPy's and
            pathlib's.

    Raises:
        ScenarioError: Missing, unreadable or invalid; the message names the key, the value and what is allowed.
    """
    if isinstance(source, Scenario) and not overrides:
        return source
    data, origin = _mapping_of(source)
    if "scenarios" in data:
        raise ScenarioError(_is_campaign(origin))
    for key, value in checked_overrides(overrides).items():
        _apply(data, key, _plain(value))
    _resolve_design(data)
    return scenario_from(data, origin)


def parse_overrides(texts: Iterable[str]) -> dict[str, Any]:
    """Overrides as the command line gives them, texts `key=value` whose value is YAML, as values by dotted key.

    Raises:
        ScenarioError: A text is not of that form.
    """
    overrides: dict[str, Any] = {}
    for text in texts:
        key, separator, value = text.partition("=")
        if not separator or not key.strip():
            raise ScenarioError(f"--set {shortened(text)}: must read key=value, for example camera.half_angle_deg=3")
        try:
            parsed = _yaml(value)
        except (ValueError, RecursionError) as error:
            raise ScenarioError(f"--set {shortened(text)}: the value is not valid YAML: {error}") from None
        overrides.pop(key.strip(), None)  # the last one is applied, in its place
        overrides[key.strip()] = parsed
    return overrides


def checked_overrides(overrides: Mapping[str, Any]) -> Mapping[str, Any]:
    """Values by dotted key as they were given; what stands in them is looked at when they are applied.

    Raises:
        ScenarioError: They are something else, such as a list of texts.
    """
    if not isinstance(overrides, Mapping) or not all(isinstance(key, str) for key in overrides):
        raise ScenarioError(
            f"overrides = {shown(overrides)}: must be a mapping of dotted keys to values, for example "
            "{'camera.half_angle_deg': 3}"
        )
    return overrides


def _plain(value: Any, depth: int = 0) -> Any:
    """A value as YAML would give it: arrays as lists, numbers of NumPy as Python's, paths as text, sections as mappings."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if hasattr(value, "tolist"):
        return value.tolist()
    if depth > MAX_DEPTH:  # which `check_data` refuses
        return value
    if isinstance(value, list | tuple):
        return [_plain(one, depth + 1) for one in value]
    return {key: _plain(one, depth + 1) for key, one in value.items()} if isinstance(value, Mapping) else value


def _mapping_of(source: ScenarioSource) -> tuple[dict[str, Any], str]:
    """What a scenario holds, paths resolved, and its origin for errors."""
    if isinstance(source, Scenario):
        return source.model_dump(mode="json"), source.name
    if isinstance(source, Mapping):
        check_data(source, "scenario")
        return deepcopy(dict(source)), "scenario"
    if not isinstance(source, str | Path):
        raise ScenarioError(
            f"scenario = {shown(source)}: must be a packaged name, the path of a YAML file, a mapping or a Scenario"
        )
    text, origin, folder = _read(source)
    data = parse_yaml(text, origin)
    if folder is not None:
        _resolve_paths(data, folder)
    return data, origin


def scenario_from(data: Mapping[str, Any], source: str = "scenario") -> Scenario:
    """Check a mapping against the schema and the limits; `source` names its origin in errors."""
    check_data(data, source)
    observation = data.get("observation")
    if isinstance(observation, Mapping) and isinstance(table := observation.get("sequence"), str):
        data = {**data, "observation": {**observation, "sequence": read_sequence(table)}}
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(f"{source}:\n{listed(error, explained)}") from None
    try:
        scenario = with_ground_resolution(scenario)
    except ScenarioError as error:
        raise ScenarioError(f"{source}:\n  {error}") from None
    check_work(scenario, source)
    return scenario


def _resolve_paths(data: dict[str, Any], folder: Path) -> None:
    """Read paths in a scenario file relative to that file; those of `--set` are relative to the current folder.

    What is packaged is meant by its name, whatever stands beside the file.
    """
    for section, key, names in (
        ("body", "shape", PACKAGED_SHAPES),
        ("body", "face_albedo", []),
        ("target", "polygon_file", []),
        ("observation", "sequence", []),
        ("design", "reference", packaged_files("designs", ".json")),
        ("spacecraft", "mjcf", []),
        *(("mothership.ephemeris", key, []) for key in FILES),
        ("companion.body", "shape", PACKAGED_SHAPES),
        ("companion.body", "face_albedo", []),
        ("companion.ephemeris", "spk", []),
    ):
        values = _section(data, section)
        if isinstance(values.get(key), str) and values[key] not in names:
            values[key] = _resolved(values[key], folder)
    for section, key in (
        ("control", "controller"),
        ("body.gravity", "model"),
        ("companion.body.gravity", "model"),
        ("behavior", "name"),
    ):
        values = _section(data, section)
        if isinstance(name := values.get(key), str) and (own := file_of(name)) is not None:
            values[key] = f"{_resolved(str(own[0]), folder)}:{own[1]}"
    states = data.get("initial_states")
    for state in states if isinstance(states, list) else ():
        path = _section(state, "ephemeris") if isinstance(state, dict) else {}
        path |= {key: _resolved(path[key], folder) for key in FILES if isinstance(path.get(key), str)}
    ephemerides = _section(data, "ephemerides")
    if isinstance(ephemerides.get("kernels"), list):
        named = ephemerides["kernels"]
        ephemerides["kernels"] = [_resolved(name, folder) if isinstance(name, str) else name for name in named]


def body_of_file(path: Path) -> dict[str, Any]:
    """The section `body` from a YAML file with its keys, or from that of a scenario; its shape is relative to the file.

    Raises:
        ScenarioError: It cannot be read, or holds no mapping.
    """
    data = parse_yaml(file_text(path, "body"), str(path))
    found = {"body": expanded_body(data.get("body", data))}
    _resolve_paths(found, path.parent)
    return dict(found["body"])


def _section(data: dict[str, Any], path: str) -> dict[str, Any]:
    """A section by its dotted path; empty where there is none."""
    found: Any = data
    for name in path.split("."):
        found = found.get(name) if isinstance(found, dict) else None
    return found if isinstance(found, dict) else {}


def _resolved(name: str, folder: Path) -> str:
    path = folder / name
    return str(path.parent.resolve() / path.name) if os.path.isfile(path) else name


def design_section(reference: str) -> dict[str, Any]:
    """What a design gives the section `design`: `visiting_points` and `observers`; by its packaged name or its design.json.

    Raises:
        ScenarioError: It cannot be read or holds no design.
    """
    design = design_record(reference)
    return {"visiting_points": design["visiting_points"], "observers": design.get("observers", [])}


def design_overrides(section: Mapping[str, Any]) -> dict[str, Any]:
    """What `design_section` gives, as overrides."""
    return {f"design.{key}": section[key] for key in ("visiting_points", "observers")}


def design_record(reference: str) -> dict[str, Any]:
    """The whole record of a design, with its `visiting_points` checked; args and errors as in `design_section`."""
    known = packaged_files("designs", ".json")
    asked = f"design.reference (--design) = {shortened(reference)}"
    try:
        raw = known[reference].read_bytes() if reference in known else bytes_of(Path(reference), MAX_BYTES)
        record_from(raw, Any)
    except (OSError, ValueError) as error:
        raise ScenarioError(
            f"{asked}: neither a packaged design ({', '.join(known)}) nor a design.json of `swarm-mj design` "
            f"({one_line(getattr(error, 'strerror', None) or error)})"
        ) from None
    try:
        design: dict[str, Any] = record_from(raw, DesignRecord)
    except ValueError as error:
        raise ScenarioError(f"{asked}: is no design.json of `swarm-mj design` ({one_line(error)})") from None
    return design


def _resolve_design(data: dict[str, Any]) -> None:
    """Put the points of a design that is named by reference into the scenario; points that are given go first."""
    design = data.get("design")
    if isinstance(design, dict) and isinstance(design.get("reference"), str) and "visiting_points" not in design:
        found = design_section(design["reference"])
        design["visiting_points"] = found["visiting_points"]
        if found["observers"]:
            design.setdefault("observers", found["observers"])


def _read(name_or_path: str | Path) -> tuple[str, str, Path | None]:
    """Text, origin for errors, and the folder of a file; None for what is packaged."""
    path = Path(name_or_path)
    if path.suffix in {".yaml", ".yml"} or (str(name_or_path) not in packaged_names() and os.path.exists(path)):
        return file_text(path, "scenario"), str(path), path.parent
    return packaged(str(name_or_path)), str(name_or_path), None


def file_text(path: Path, what: str, most: int = MAX_BYTES) -> str:
    """Text of a file that the user names; `what` it should be, for errors; `most` bytes that it may have.

    Raises:
        ScenarioError: It cannot be read, is too large or no text.
    """
    with reading(path, f"give a {what} in YAML", ScenarioError):
        return bytes_of(path, most).decode("utf-8")


class _Loader(yaml.SafeLoader):
    """Safe YAML that reads 1e-5 as a number, as YAML 1.2 does, and refuses keys that are given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping; a key given twice is a mistake, not a choice."""
        mapping = super().construct_mapping(node, deep=deep)
        if len(mapping) < len(node.value):
            keys = Counter(self.construct_object(key, deep=True) for key, _ in node.value)
            raise yaml.YAMLError(f"key {shown(keys.most_common(1)[0][0])} is given twice{node.start_mark}")
        return mapping

    def construct_integer(self, node: yaml.ScalarNode) -> int:
        """Build an integer; in hexadecimal, binary, octal or to the base 60 it could be larger than Python can write."""
        if isinstance(node, yaml.ScalarNode) and len(node.value) > MAX_INTEGER_CHARACTERS:
            raise yaml.YAMLError(
                f"{shortened(node.value, 40)}: an integer has at most {MAX_INTEGER_CHARACTERS} characters "
                f"(MAX_INTEGER_CHARACTERS){node.start_mark}"
            )
        return int(self.construct_yaml_int(node))


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_integer)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)$"),
    list("-+.0123456789"),
)


def _yaml(text: str) -> Any:
    """Read YAML without aliases; a ValueError says what is wrong with it."""
    try:
        _check_tokens(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(shortened(str(error), 600)) from None
    except ValueError as error:  # a date or a number that is none
        raise ValueError(shortened(str(error))) from None
    except (AttributeError, LookupError, TypeError, ArithmeticError) as error:
        # What PyYAML's constructors trip over where a tag does not fit its value, as in `!!timestamp soon`.
        raise ValueError(f"a tag (!!type) does not fit its value: {shortened(str(error))}") from None


def _check_tokens(text: str) -> None:
    """Refuse, before anything is built of it, what is no YAML, holds an alias, or is deeper than a scenario may be."""
    depth = 0
    for token in yaml.scan(text):
        # Aliases let a page of text unfold into gigabytes, or contain itself; no scenario needs them.
        if isinstance(token, yaml.AliasToken):
            raise yaml.YAMLError("aliases (*name) are not allowed in scenarios")
        depth += isinstance(token, _OPENING) - isinstance(token, _CLOSING)
        # The parser's time grows with the square of the depth. The outermost level holds the keys and does not count.
        if depth > MAX_DEPTH + 1:
            raise yaml.YAMLError(f"more than {MAX_DEPTH} levels deep (MAX_DEPTH){token.start_mark}")


def parse_yaml(text: str, source: str) -> dict[str, Any]:
    """A mapping from YAML text, read safely; `source` names its origin in errors."""
    try:
        data = _yaml(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{source}: not valid YAML: {error}") from None
    if not isinstance(data, dict):
        raise ScenarioError(f"{source}: must be a mapping of keys to values, not {type(data).__name__}")
    check_data(data, source)
    return data


def _apply(data: dict[str, Any], key: str, value: Any) -> None:
    """Put a value at a dotted key."""
    told = f"{shortened(key)} = {shown(value)}"
    check_data({"value": value}, told)
    *parents, last = key.split(".")
    node = data
    for level, name in enumerate(parents, start=1):
        child = node.setdefault(name, {})
        if (path := ".".join(parents[:level])) in NAMED and isinstance(child, str):
            child = node[name] = _by_name(path, child, told)
        if not isinstance(child, dict):
            what = (
                "a list: give the whole of it" if isinstance(child, list) else "a single value: it has no keys inside"
            )
            raise ScenarioError(f"{told}: {path} is {what}")
        node = child
    node[last] = value


def _by_name(section: str, name: str, told: str) -> dict[str, Any]:
    """The keys of a section that a name stands for, one of which is about to be changed."""
    try:
        return NAMED[section](name)
    except ValueError as error:
        raise ScenarioError(f"{told}: {section} {error}") from None
