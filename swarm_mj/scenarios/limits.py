"""Limits on what a scenario may hold and ask for, so that a mistyped or hostile one is refused and not suffered.

A schema says what each value may be; here stand the bounds of the whole: how deep and long a mapping may be, and how much
time and memory its flight may take.
"""

from __future__ import annotations

import math
import reprlib
import unicodedata
from collections.abc import Iterator, Mapping
from datetime import date
from numbers import Integral, Real
from typing import Any

from pydantic import BaseModel

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema import Scenario

#: Lists and mappings inside each other: the schema needs four, the parameters of a plug-in a few more.
MAX_DEPTH = 20
#: Values of a scenario altogether: room for 100,000 visiting points.
MAX_VALUES = 200_000
#: Whole numbers of this size and more fit no machine integer.
MAX_INTEGER = 2**63
#: An integer's characters in a file, in any notation: room for values that are refused by name for their size.
MAX_INTEGER_CHARACTERS = 1_000
#: Larger integers are described in messages, not written [bits].
MAX_SHOWN_BITS = 10_000
#: A key is a word.
MAX_KEY_CHARACTERS = 100
#: A flight of more spacecraft: the model is compiled for hours.
MAX_SPACECRAFT = 5_000
#: Steps of the integration times spacecraft, about a day of computing at 8 us each.
MAX_SPACECRAFT_STEPS = 10_000_000_000
#: Samples of telemetry times spacecraft, each about 300 bytes and held three times while it is written.
MAX_SPACECRAFT_SAMPLES = 10_000_000
#: Designs of the genetic algorithm that are held at once.
MAX_POPULATION = 100_000

#: Control characters that text may hold.
_LAYOUT = "\n\t\r"


def check_plain(data: Mapping[Any, Any], source: str) -> None:
    """Make sure that a mapping is made of plain values and of believable size.

    Args:
        data: What a YAML file, an override or a caller gives.
        source: Its origin, for errors.

    Raises:
        ScenarioError: It is too deep (or contains itself), too large, or holds a value that no scenario can.
    """
    # A list of what is still to be seen instead of recursion: depth is what an attacker chooses.
    waiting: list[tuple[str, Any, int]] = [("", data, 0)]
    count = 0
    while waiting:
        key, value, depth = waiting.pop()
        count += 1
        if depth > MAX_DEPTH:
            raise ScenarioError(f"{source}: {shortened(key)}: more than {MAX_DEPTH} levels deep (MAX_DEPTH)")
        if count > MAX_VALUES:
            raise ScenarioError(f"{source}: more than {MAX_VALUES} values (MAX_VALUES); this is not a scenario")
        if isinstance(value, Mapping | list | tuple):
            waiting.extend((name, inner, depth + 1) for name, inner in _inside(key, value, source))
            continue
        wrong = _what_is_wrong(value)
        if wrong:
            raise ScenarioError(f"{source}:\n  {key} = {shown(value)}: {wrong}")


def _inside(key: str, value: Mapping[Any, Any] | list[Any] | tuple[Any, ...], source: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        yield from ((key, inner) for inner in value)
        return
    for name, inner in value.items():
        if not isinstance(name, str) or len(name) > MAX_KEY_CHARACTERS or not name.isprintable():
            where = f"{source}: {shortened(key)}" if key else source
            raise ScenarioError(f"{where}: key {shown(name)} is no word of at most {MAX_KEY_CHARACTERS} characters")
        # Only the start of a deep path is ever shown; the whole of it would grow with the square of the depth.
        yield f"{key}.{name}"[:1000] if key else name, inner


def _what_is_wrong(value: Any) -> str:
    if value is None or isinstance(value, bool | date | BaseModel):
        return ""
    if isinstance(value, str):
        odd = next((c for c in value if c not in _LAYOUT and unicodedata.category(c) in {"Cc", "Cs"}), None)
        return f"must not hold the character {odd!r}" if odd else ""
    if isinstance(value, Integral):
        return "" if abs(int(value)) < MAX_INTEGER else f"must be less than {MAX_INTEGER} (2^63) in size"
    if isinstance(value, Real):
        return "" if math.isfinite(value) else "must be a finite number"
    return f"must be text, a number, a list or a mapping, not {type(value).__name__}"


def check_work(scenario: Scenario, source: str) -> None:
    """Make sure that a scenario's flight can be held in memory and ends in the lifetime of a computer's owner.

    Raises:
        ScenarioError: It asks for more than a limit allows; the message names the keys and the limit.
    """
    n = len(scenario.design.visiting_points) + 1
    flight, physics = f"duration_s = {scenario.duration_s:g}", scenario.physics.timestep_s
    interval = scenario.telemetry.interval_s
    if n > MAX_SPACECRAFT:
        raise ScenarioError(
            f"{source}: design.visiting_points names {n - 1} spacecraft: at most {MAX_SPACECRAFT - 1} (MAX_SPACECRAFT)"
        )
    if n * scenario.duration_s / physics > MAX_SPACECRAFT_STEPS:
        raise ScenarioError(
            f"{source}: {flight} of {n} spacecraft in steps of physics.timestep_s = {physics:g}: at most "
            f"{MAX_SPACECRAFT_STEPS:g} steps of a spacecraft (MAX_SPACECRAFT_STEPS)"
        )
    if n * scenario.duration_s / interval > MAX_SPACECRAFT_SAMPLES:
        raise ScenarioError(
            f"{source}: {flight} of {n} spacecraft sampled every telemetry.interval_s = {interval:g}: at most "
            f"{MAX_SPACECRAFT_SAMPLES:g} samples of a spacecraft (MAX_SPACECRAFT_SAMPLES)"
        )
    if scenario.designer.population > MAX_POPULATION:
        raise ScenarioError(
            f"{source}: designer.population = {scenario.designer.population}: at most {MAX_POPULATION} (MAX_POPULATION)"
        )


class _Short(reprlib.Repr):
    """Beginnings of values; integers that Python refuses to write (sys.set_int_max_str_digits) are described."""

    def repr_int(self, x: int, level: int) -> str:
        if x.bit_length() > MAX_SHOWN_BITS:
            return f"{'-' if x < 0 else ''}(an integer of {x.bit_length()} bits)"
        return super().repr_int(x, level)


_REPR = _Short()
_REPR.maxlevel, _REPR.maxdict, _REPR.maxlist, _REPR.maxtuple = 4, 8, 12, 12
_REPR.maxstring, _REPR.maxother, _REPR.maxlong = 120, 120, 60


def shown(value: Any) -> str:
    """A value as it stands in a message: its beginning, if it is long."""
    return _REPR.repr(value)


def shortened(text: str, characters: int = 200) -> str:
    """Text of a message: its beginning, if it is long."""
    return text if len(text) <= characters else f"{text[:characters]}... ({len(text)} characters)"
