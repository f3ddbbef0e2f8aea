"""What SPICE and CCSDS call a small body: NAIF's number and a name in capitals."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

#: NAIF's numbers of asteroids are this plus the number of the asteroid, up to 999999; beyond, the extended schema.
NUMBERED, EXTENDED, LAST_NUMBERED = 2_000_000, 20_000_000, 999_999
#: Number of a body that is no numbered asteroid; NAIF has given it to nobody.
UNNUMBERED: Final = 9_999_999
#: SPICE takes variables of 32 characters; the longest is FRAME_SWARM_..._FIXED.
MAX_CHARACTERS: Final = 14


@dataclass(frozen=True)
class BodyName:
    """What SPICE and CCSDS call the body.

    Attributes:
        code: NAIF's number.
        name: In capitals, without the number of the asteroid, at most `MAX_CHARACTERS`.
    """

    code: int
    name: str

    @classmethod
    def of(cls, name: str) -> BodyName:
        """Of a body as scenarios call it, e.g. `433 Eros`."""
        number, _, rest = name.strip().partition(" ")
        numbered = number.isdecimal() and bool(rest.strip()) and 0 < int(number) < EXTENDED
        words = re.sub(r"[^A-Z0-9]+", "_", (rest if numbered else name).upper()).strip("_")[:MAX_CHARACTERS] or "BODY"
        if not numbered:
            return cls(UNNUMBERED, words)
        return cls((NUMBERED if int(number) <= LAST_NUMBERED else EXTENDED) + int(number), words)

    @property
    def frame(self) -> str:
        """Name of the body-fixed frame A."""
        return f"SWARM_{self.name}_FIXED"

    def is_meant_by(self, text: str) -> bool:
        """Whether a file's text names this body: by name, number or both, or by NAIF's number in either schema."""
        word = re.sub(r"[^A-Z0-9]+", "_", text.upper()).strip("_")
        number = self.code - NUMBERED if self.code < EXTENDED else self.code - EXTENDED
        names = {self.name, str(self.code)}
        if self.code != UNNUMBERED:
            names |= {f"{number}_{self.name}", str(number), str(EXTENDED + number)}
        return word in names
