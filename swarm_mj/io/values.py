"""Plain values from files: how deep, long and large they may be, and how they are shown in messages."""

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

#: Lists and mappings inside each other: the schema needs four, the parameters of a plug-in a few more.
MAX_DEPTH = 20
#: Values of a scenario altogether: room for 100,000 visiting points.
MAX_VALUES = 200_000
#: Whole numbers of this size and more fit no machine integer; of still larger numbers squares and ratios would overflow.
TOO_LARGE = 2**63
#: Larger integers are described in messages, not written [bits].
MAX_SHOWN_BITS = 10_000
#: A key is a word.
MAX_KEY_CHARACTERS = 100

#: Control characters that text may hold.
_LAYOUT = "\n\t\r"


def check_data(
    data: Any,
    source: str = "",
    *,
    most: int = MAX_VALUES,
    too_large: float = math.inf,
    what: str = "scenario",
    refusal: type[Exception] = ScenarioError,
) -> None:
    """Make sure that data of a file, an override or a caller is made of plain values and of believable size.

    Errors begin with the `source`, its origin, or if that is empty with the key. `most`: values that it may hold altogether.
    `too_large`: what every number that is not whole stays below. `what`: it should be, for errors.

    Raises:
        Exception: As `refusal`: it is too deep (or contains itself), too large, or holds a value that no file should.
    """
    # A list of what is still to be seen instead of recursion: depth is what an attacker chooses.
    waiting: list[tuple[str, Any, int]] = [("", data, 0)]
    count = 0
    while waiting:
        key, value, depth = waiting.pop()
        count += 1
        if depth > MAX_DEPTH:
            raise refusal(_begun(source, f"{shortened(key)}: more than {MAX_DEPTH} levels deep (MAX_DEPTH)"))
        if count > most:
            raise refusal(_begun(source, f"more than {most} values (MAX_VALUES); this is not a {what}"))
        if isinstance(value, Mapping | list | tuple):
            waiting.extend((name, inner, depth + 1) for name, inner in _inside(key, value, source, refusal))
            continue
        wrong = _what_is_wrong(value, too_large)
        if wrong:
            raise refusal(_begun(source, f"{key} = {shown(value)}: {wrong}", between=":\n  "))


def _inside(
    key: str, value: Mapping[Any, Any] | list[Any] | tuple[Any, ...], source: str, refusal: type[Exception]
) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        yield from ((key, inner) for inner in value)
        return
    for name, inner in value.items():
        if not isinstance(name, str) or len(name) > MAX_KEY_CHARACTERS or not name.isprintable():
            words = f"key {shown(name)} is no word of at most {MAX_KEY_CHARACTERS} characters"
            raise refusal(_begun(source, f"{shortened(key)}: {words}" if key else words))
        # Only the start of a deep path is ever shown; the whole of it would grow with the square of the depth.
        yield f"{key}.{name}"[:1000] if key else name, inner


def _begun(source: str, words: str, *, between: str = ": ") -> str:
    return f"{source}{between}{words}" if source else words


def _what_is_wrong(value: Any, too_large: float) -> str:
    if value is None or isinstance(value, bool | date | BaseModel):
        return ""
    if isinstance(value, str):
        odd = next((c for c in value if c not in _LAYOUT and unicodedata.category(c) in {"Cc", "Cs"}), None)
        return f"must not hold the character {odd!r}" if odd else ""
    if isinstance(value, Integral):
        return "" if abs(int(value)) < TOO_LARGE else f"must be less than {TOO_LARGE} (2^63) in size"
    if isinstance(value, Real):
        limit = f"must be less than {too_large:g} in size" if math.isfinite(value) else "must be a finite number"
        return "" if abs(float(value)) < too_large else limit
    return f"must be text, a number, a list or a mapping, not {type(value).__name__}"


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
