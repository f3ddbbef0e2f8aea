"""What a policy was trained for, as its file tells it: environment, arguments, layout of the observation, package."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import PositiveInt

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.io.arrays import Declared, arrays_in
from swarm_mj.io.records import Record, reading, record_from
from swarm_mj.scenarios.schema import Scenario


class Provenance(Record):
    """What files written since 0.2 tell; empty in older ones.

    Attributes:
        environment: Its id.
        arguments: Those of the environment that are not the defaults, the scenario by its name.
        layout: Version of the observation's layout.
        package: Version of swarm_mj.
    """

    environment: str = ""
    arguments: dict[str, Any] = {}
    layout: PositiveInt = 1
    package: str = ""


def provenance_of(environment: str, layout: int, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """What a file should tell of a policy trained now; arguments in values that JSON has."""
    plain = json.loads(json.dumps(dict(arguments), default=_plain))
    return {"environment": environment, "arguments": plain, "layout": layout, "package": __version__}


def check_provenance(about: Mapping[str, Any], environment: str, layout: int, policy: str = "policy") -> None:
    """Refuse a policy of another environment or of another layout; an older file, which does not tell, passes.

    Args:
        about: What the file tells.
        environment: Id of that in which it should fly.
        layout: Version of the observation's layout there.
        policy: What the message calls it.

    Raises:
        ScenarioError: The message names what differs.
    """
    told, written = about.get("environment", ""), about.get("package") or "an older version"
    if told and told != environment:
        raise ScenarioError(
            f"{policy}: trained for environment = {told!r}, but it is {environment!r} here; fly it in {told} or train one for "
            f"{environment}"
        )
    if about.get("layout", layout) != layout:
        raise ScenarioError(
            f"{policy}: trained for layout = {about['layout']} of the observation (swarm_mj {written}), but it is {layout} "
            f"here (swarm_mj {__version__}); train it anew"
        )


class _Named(Provenance):
    """What tells the environment of any `.npz`."""

    format: int


def refuse_other_environment(file: str | Path, environment: str) -> None:
    """Refuse an `.npz` of a policy for another environment, before its arrays are looked at.

    Raises:
        ScenarioError: The message names the environment that the file is for; or the file is none of a policy.
    """
    with reading(f"policy {file}", "give a policy that a program of this package wrote", ScenarioError):
        about = record_from(str(arrays_in(Path(file), {"about": Declared("U")})["about"]), _Named)
    told = about.get("environment") or environment
    if told != environment:
        raise ScenarioError(f"policy {file}: trained for environment = {told!r}, but it is {environment!r} here")


def _plain(value: Any) -> Any:
    return value.name if isinstance(value, Scenario) else str(value)
