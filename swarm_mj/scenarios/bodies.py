"""Packaged bodies: a scenario may say `body: bennu`, which stands for all keys of `swarm_mj/scenarios/bodies/bennu.yaml`."""

from __future__ import annotations

from difflib import get_close_matches
from importlib import resources
from typing import Any

import yaml

#: Shapes that a scenario names: packaged ones, and the ellipsoid of `body.semi_axes_m`.
PACKAGED_SHAPES = ("eros", "bennu", "itokawa", "ellipsoid")


def packaged_bodies() -> list[str]:
    """Names of the packaged bodies, sorted."""
    folder = resources.files("swarm_mj.scenarios") / "bodies"
    return sorted(p.name.removesuffix(".yaml") for p in folder.iterdir() if p.name.endswith(".yaml"))


def packaged_body(name: str) -> dict[str, Any]:
    """The section `body` that a name stands for.

    Raises:
        ValueError: There is no such body; the message lists them.
    """
    known = packaged_bodies()
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(f"= {name!r} is no packaged body: {hint}there are {', '.join(known)}; or give its keys")
    text = (resources.files("swarm_mj.scenarios") / "bodies" / f"{name}.yaml").read_text("utf-8")
    body: dict[str, Any] = yaml.safe_load(text)
    return body


def expanded_body(given: Any) -> Any:
    """A body by name as its keys; anything else as it is."""
    return packaged_body(given) if isinstance(given, str) else given
