"""What is wrong with a scenario, in words: the key, the value and what is allowed."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from swarm_mj.io.values import shown
from swarm_mj.scenarios.keys import section_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import FAULT_KINDS

#: Mistakes that are listed at once.
MAX_ERRORS = 20

#: What a value must be, by the type of pydantic's error; fields in braces come from its context.
MUST_BE = {
    "tuple_type": "a list, in brackets",
    "dict_type": "a section of keys and values",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text; put it in quotes",
    "literal_error": "{expected}",
    "string_pattern_mismatch": "a text that matches {pattern}",
    "string_too_short": "a text of at least {min_length} characters",
    "too_short": "a list of at least {min_length}, not {actual_length}",
    "too_long": "a list of at most {max_length}, not {actual_length}",
}


def listed(error: ValidationError, explain: Callable[[Any], str]) -> str:
    """The mistakes that a schema found, one a line, the first `MAX_ERRORS` in the words of `explain`.

    What a value may be besides, where there is a choice, stands in one line.
    """
    lines: list[str] = []
    for line in map(explain, error.errors()[:MAX_ERRORS]):
        key, must_be, what = line.partition(": must be ")
        if must_be and lines and lines[-1].startswith(key + must_be):
            lines[-1] += "" if lines[-1].endswith(what) else f" or {what}"
        elif line:
            lines.append(line)
    if error.error_count() > MAX_ERRORS:
        lines.append(f"  and {error.error_count() - MAX_ERRORS} more mistakes")
    return "\n".join(lines)


def explained(error: Any, whole: type[BaseModel] = Scenario) -> str:
    """One mistake in a scenario, or another file by its schema, in a line; empty if it only follows from another one."""
    kind, given, context = error["type"], error["input"], error.get("ctx", {})
    unknown = error["loc"][-1:] if kind == "extra_forbidden" else ()
    # Locations of unions hold type names besides keys; keep what leads through the schema. An unknown key may be any word.
    path = [part for part in error["loc"][: len(error["loc"]) - len(unknown)] if not _is_union_branch(part)]
    key = ".".join(str(part) for part in (*path, *unknown)) or "(whole)"
    if unknown:
        return f"  {key}: unknown key. {_allowed_keys(_model_at(path, whole), str(unknown[0]))}"
    if kind == "union_tag_not_found":
        return f"  {key}.kind: missing; allowed: {', '.join(FAULT_KINDS)}"
    if kind == "union_tag_invalid":
        return f"  {key}.kind = {shown(context['tag'])}: unknown; allowed: {', '.join(FAULT_KINDS)}"
    if kind == "missing" and isinstance(given, (list, tuple)):
        # The location ends in the number of the value that is not there.
        key = ".".join(str(part) for part in path[:-1])
        length = _fixed_length(_model_at(path[:-2], whole).model_fields[str(path[-2])].annotation)
        return f"  {key} = {shown(given)}: must be a list of {length}, not {len(given)}"
    if kind == "missing":
        return f"  {key}: missing, a value is required"
    if kind == "value_error":
        message = error["msg"].removeprefix("Value error, ")
        separator = "" if key == "(whole)" else " " if message.startswith("=") else "."
        return f"  {'' if key == '(whole)' else key}{separator}{message}"
    if kind == "too_short" and len(given) >= context["min_length"]:
        return ""  # what it holds is wrong, and has its own line
    return f"  {key} = {shown(given)}: {_must_be(error, path, whole)}"


def _must_be(error: Any, path: Sequence[str | int], whole: type[BaseModel]) -> str:
    kind = error["type"]
    if kind == "model_type":
        return f"must be a section with the keys {', '.join(_model_at(path, whole).model_fields)}"
    if kind == "model_attributes_type":
        return f"must be a section with the key kind: {', '.join(FAULT_KINDS)}"
    if kind in MUST_BE:
        return "must be " + MUST_BE[kind].format_map(error.get("ctx", {}))
    message = error["msg"].replace("Input should be ", "must be ")
    return f"{message[0].lower()}{message[1:]}"


def _is_union_branch(part: str | int) -> bool:
    return isinstance(part, str) and (
        "[" in part
        or part in {"float", "int", "str", "tuple", "none", "literal", "constrained-float", "constrained-int"}
    )


def _allowed_keys(model: type[BaseModel], unknown: str) -> str:
    """The keys of a section, and the one that an unknown key may have been meant for."""
    allowed = list(model.model_fields)
    close = difflib.get_close_matches(unknown, allowed, n=1)
    hint = f"Did you mean {close[0]!r}? " if close else ""
    return f"{hint}Allowed: {', '.join(allowed)}"


def _model_at(path: Sequence[str | int], model: type[BaseModel]) -> type[BaseModel]:
    """The section that stands at a path."""
    if len(path) > 2 and path[0] == "faults":
        # Number in the list, then kind.
        model, path = FAULT_KINDS[str(path[2])], path[3:]
    for key in path:
        if isinstance(key, str):  # else the number of a section in a list
            model = section_of(model.model_fields[key].annotation) or model
    return model


def _fixed_length(annotation: Any) -> int:
    """Values of the tuple in an annotation; 0 if it holds none of fixed length."""
    inner = get_args(annotation)
    if get_origin(annotation) is tuple and inner[-1] is not Ellipsis:
        return len(inner)
    return max(map(_fixed_length, inner), default=0)
