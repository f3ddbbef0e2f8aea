"""Every key of a scenario with type, unit, default, allowed values and meaning, read off the schema.

The page of scenario keys and `swarm-mj explain` are made of it.
"""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import yaml
from annotated_types import Ge, Gt, Interval, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import FAULT_KINDS

#: Unit of a key by the end of its name, the longest end first.
UNITS = {
    "m3_s2": "m³/s²",
    "deg_per_day": "deg/day",
    "deg_h_sqrt_h": "deg/h/√h",
    "deg_sqrt_h": "deg/√h",
    "m_s_sqrt_h": "m/s/√h",
    "viscous_n_m_s": "N m s/rad",
    "n_m_s": "N m s",
    "kg_m2": "kg m²",
    "kg_m3": "kg/m³",
    "n_m": "N m",
    "bit_n_s": "N s",
    "bit_s": "bit/s",
    "db_k": "dB/K",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "deg_h": "deg/h",
    "within_h": "h",
    "range_rpm": "rpm",
    "m2": "m²",
    "A_m": "m",
    "arcsec": "arcsec",
    "percent": "%",
    "deg": "deg",
    "rad": "rad",
    "rpm": "rpm",
    "px": "px",
    "bit": "bit",
    "dbi": "dBi",
    "db": "dB",
    "au": "au",
    "jd": "d",
    "kg": "kg",
    "m": "m",
    "s": "s",
    "w": "W",
    "thrust_n": "N",
}
#: Names of types in tables.
TYPES = {float: "number", int: "whole number", bool: "true or false", str: "text", type(None): "null"}


class Key(NamedTuple):
    """One key of the schema as a reader sees it."""

    name: str
    type: str
    unit: str
    default: str
    allowed: str
    meaning: str


def find_keys(path: str = "") -> list[tuple[str, Key]]:
    """Keys at or below a dotted path, or all, each with its whole dotted name; those of faults are at `faults.KIND`.

    Raises:
        ScenarioError: The schema has no such section or key.
    """
    found = [
        (".".join(filter(None, (where, key.name))), key) for where, section in all_sections() for key in keys(section)
    ]
    chosen = [(name, key) for name, key in found if f"{name}.".startswith(f"{path}.") or not path]
    if not chosen:
        names = [name for name, _ in found]
        likely = [name for name in names if name.rsplit(".", 1)[-1] == path.rsplit(".", 1)[-1]]
        likely = likely or difflib.get_close_matches(path, [*names, *(name.rsplit(".", 1)[0] for name in names)], n=1)
        hint = f"; did you mean {' or '.join(likely)}?" if likely else ""
        tops = ", ".join(dict.fromkeys(name.split(".")[0] for name in names))
        raise ScenarioError(
            f"{path!r} is neither a section nor a key of a scenario; at the top level there are {tops}{hint}"
        )
    return chosen


def all_sections() -> list[tuple[str, type[BaseModel]]]:
    """Every section with its dotted path: the top level as "", the kinds of faults as `faults.KIND`."""
    kinds = [(f"faults.{kind}", fault) for kind, fault in FAULT_KINDS.items()]
    return [("", Scenario), *sections(Scenario), *kinds]


def sections(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every section below a model with its dotted path, in the order of the schema; faults have a chapter of their own."""
    for name, field in model.model_fields.items():
        section = section_of(field.annotation)
        if section is not None and name != "faults":
            inner = f"{path}.{name}" if path else name
            yield inner, section
            yield from sections(section, inner)


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The section that a field holds, alone or in a list; None if it holds plain values."""
    for kind in (annotation, *get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def keys(model: type[BaseModel]) -> list[Key]:
    """Keys of a section that hold values, in the order of the schema."""
    fields = {name: field for name, field in model.model_fields.items() if _is_plain(field) and name != "kind"}
    return [_key(field.alias or name, field) for name, field in fields.items()]


def _is_plain(field: FieldInfo) -> bool:
    section = section_of(field.annotation)
    return section is None or get_origin(field.annotation) is tuple


def _key(name: str, field: FieldInfo) -> Key:
    description = field.description or _inner_description(field.annotation)
    unit = unit_of(name, description)
    return Key(
        name=name,
        type=_type(field.annotation),
        unit=unit,
        default="required" if field.is_required() else f"`{default_text(field)}`",
        allowed=_allowed(field),
        meaning=description.replace(f" [{_in_ascii(unit)}]", "", 1),
    )


def unit_of(name: str, description: str) -> str:
    """The unit that the end of a key's name says, or else brackets in its description; empty for counts and words."""
    by_name = next((unit for end, unit in UNITS.items() if f"_{name}".endswith(f"_{end}")), "")
    return by_name or next((unit for unit in ("-", *UNITS.values()) if f" [{_in_ascii(unit)}]" in description), "")


def _in_ascii(unit: str) -> str:
    """A unit as descriptions write it."""
    return unit.replace("²", "^2").replace("³", "^3").replace("√h", "sqrt(h)")


def _type(annotation: Any) -> str:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(inner[0])
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(kind) for kind in inner))
    if origin is Literal:
        return "word"
    if origin is tuple and inner[-1] is Ellipsis:
        return f"list of {_plural(_type(inner[0]))}"
    if origin is tuple:
        return f"{len(inner)} {_plural(_type(inner[0]))}"
    if origin is dict:
        return "mapping"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "section"
    return TYPES.get(annotation, str(annotation))


def _plural(word: str) -> str:
    return word if word.endswith("s") else f"{word}s"


def default_text(field: FieldInfo) -> str:
    """A field's default as a file would give it, or `required`."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if isinstance(value, tuple):
        value = list(value)
    shown = yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("\n").removesuffix("\n...")
    return str(shown)


def _allowed(field: FieldInfo) -> str:
    words = [f"`{word}`" for word in _words(field.annotation)]
    bounds = _bounds(field.metadata) or next(filter(None, map(_bounds, _inner_metadata(field.annotation))), "")
    return ", ".join([*words, *([bounds] if bounds else [])])


def _words(annotation: Any) -> Iterator[str]:
    if get_origin(annotation) is Literal:
        yield from map(str, get_args(annotation))
    else:
        for inner in get_args(annotation):
            yield from _words(inner)


def _inner_metadata(annotation: Any) -> Iterator[list[Any]]:
    """Bounds inside unions and lists, outermost first."""
    if get_origin(annotation) is Annotated:
        yield _spread(annotation.__metadata__)
    for inner in get_args(annotation):
        yield from _inner_metadata(inner)


def _spread(metadata: tuple[Any, ...]) -> list[Any]:
    return [part for item in metadata for part in (item.metadata if isinstance(item, FieldInfo) else [item])]


def _inner_description(annotation: Any) -> str:
    """The description that an alias such as `Vector3` carries."""
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(item, FieldInfo) and item.description:
            return item.description
    return ""


def _bounds(metadata: list[Any]) -> str:
    """Bounds in words, such as "> 0, <= 1"."""
    words = []
    for item in metadata:
        match item:
            case Gt(gt=low):
                words.append(f"> {_number(low)}")
            case Ge(ge=low):
                words.append(f"≥ {_number(low)}")
            case Lt(lt=high):
                words.append(f"< {_number(high)}")
            case Le(le=high):
                words.append(f"≤ {_number(high)}")
            case MinLen(min_length=least):
                words.append(f"at least {least}")
            case MaxLen(max_length=most):
                words.append(f"at most {most:,}")
            case Interval():
                words += [word for word in [_bounds(list(item))] if word]
            case _ if getattr(item, "pattern", None):
                words.append(f"matches `{item.pattern}`")
    return ", ".join(words)


def _number(value: Any) -> str:
    return "2^63" if value == 2**63 else f"{value:,.15g}"
