"""The exceptions of swarm_mj: every foreseeable failure is one of these, with a message that says what to do."""

from collections.abc import Sequence


class SwarmError(Exception):
    """Base of all errors that swarm_mj raises on purpose; the command line prints its message without a traceback."""


class ScenarioError(SwarmError):
    """A scenario file or a `--set` override is wrong; the message names the key, the value and what is allowed."""


class ShapeError(SwarmError):
    """A shape model cannot be used; the message names the face or vertex and the repair."""


class MissionError(SwarmError):
    """The mission cannot be flown as asked: no target, no trajectory, or an impossible geometry."""


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
