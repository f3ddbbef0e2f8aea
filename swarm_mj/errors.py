"""The exceptions of swarm_mj: every foreseeable failure is one of these, with a message that says what to do."""

import math
from collections.abc import Callable, Sequence


def at_most(value: float, digits: int = 2) -> str:
    """A limit of so many digits for a message that says "at most", rounded down, so that what is told keeps it."""
    return _cut(value, digits, math.floor)


def at_least(value: float, digits: int = 3) -> str:
    """A limit of so many digits for a message that says "at least", rounded up."""
    return _cut(value, digits, math.ceil)


def _cut(value: float, digits: int, towards: Callable[[float], int]) -> str:
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    scale = digits - 1 - math.floor(math.log10(abs(value)))
    cut = towards(float(f"{value * 10.0**scale:.12g}"))  # what rounding makes of a whole number is one
    return f"{cut * 10.0**-scale if scale < 0 else cut / 10.0**scale:.12g}"


class SwarmError(Exception):
    """Base of all errors that swarm_mj raises on purpose; the command line prints its message without a traceback."""


class ScenarioError(SwarmError):
    """A scenario file or a `--set` override is wrong; the message names the key, the value and what is allowed."""


class ShapeError(SwarmError):
    """A shape model cannot be used; the message names the face or vertex and the repair."""


class MissionError(SwarmError):
    """The mission cannot be flown as asked: no target, no trajectory, or an impossible geometry."""


class TooFewObserversError(MissionError):
    """More observers are needed than are allowed.

    Attributes:
        needed: How many, at the least.
    """

    def __init__(self, message: str, needed: int) -> None:
        super().__init__(message)
        self.needed = needed


class PathError(MissionError):
    """Some of the paths of a mission cannot be flown.

    Attributes:
        reason: Why not, in a few words.
        spacecraft: Whose paths, counted from 0.
    """

    def __init__(self, message: str, reason: str = "", spacecraft: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.reason, self.spacecraft = reason, tuple(spacecraft)


class SimulationError(SwarmError):
    """The simulation left its domain (NaN, impact, divergence); the message gives time, spacecraft and cause."""


class ObserverError(SwarmError):
    """The requested way of observing is not available on this machine."""


class OutputError(SwarmError):
    """A result cannot be written; nothing that existed before was touched."""


class PluginError(SwarmError):
    """A plug-in name is unknown or the plug-in does not fit its protocol."""


class InteropError(SwarmError):
    """A file for or from another program cannot be written, read or believed; names file, key, value and the remedy."""
