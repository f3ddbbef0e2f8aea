"""Packaged files, and bodies: `body: bennu` stands for all keys of `swarm_mj/scenarios/bodies/bennu.yaml`."""

from __future__ import annotations

from difflib import get_close_matches
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

import yaml

#: Shapes that a scenario names: packaged ones, and the ellipsoid of `body.semi_axes_m`.
PACKAGED_SHAPES = ("eros", "bennu", "itokawa", "dumbbell", "ellipsoid")


def packaged_files(folder: str = "", suffix: str = ".yaml") -> dict[str, Traversable]:
    """Files of a folder below `swarm_mj/scenarios` by the names that scenarios and commands give them, sorted."""
    files = (resources.files("swarm_mj.scenarios") / folder).iterdir()
    return dict(sorted((file.name.removesuffix(suffix), file) for file in files if file.name.endswith(suffix)))


def packaged_bodies() -> list[str]:
    """Names of the packaged bodies, sorted."""
    return list(packaged_files("bodies"))


def packaged_body(name: str) -> dict[str, Any]:
    """The section `body` that a name stands for.

    Raises:
        ValueError: There is no such body; the message lists them.
    """
    known = packaged_files("bodies")
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(f"= {name!r} is no packaged body: {hint}there are {', '.join(known)}; or give its keys")
    body: dict[str, Any] = yaml.safe_load(known[name].read_text("utf-8"))
    return body


def expanded_body(given: Any) -> Any:
    """A body by name as its keys; anything else as it is."""
    return packaged_body(given) if isinstance(given, str) else given
