"""What the sections of a scenario are made of: an immutable model that refuses unknown keys, and bounded vectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field

from swarm_mj.errors import ScenarioError

#: Of a position [m], up to some 7 au: two days before a fast flyby a mothership is 1e9 m away.
Component = Annotated[float, Field(ge=-1e12, le=1e12)]
Vector3 = Annotated[tuple[Component, Component, Component], Field(description="three components")]
#: Arguments of a plug-in by name.
Parameters = dict[str, Any]


class Section(BaseModel):
    """Base of all sections: immutable, strict about unknown keys and non-finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some fields replaced, by their names and unchecked, as pydantic has it.

        Raises:
            ScenarioError: A name is no field, for instance a dotted key, which pydantic would store and nobody read.
        """
        for key in update or {}:
            if key not in type(self).model_fields:
                words = f"{key} is no key of {type(self).__name__.lower()}: must be one of {', '.join(type(self).model_fields)}"
                raise ScenarioError(
                    f"model_copy: {words}; dotted keys go to changed(), e.g. .changed({{'{key}': ...}})"
                )
        return super().model_copy(update=update, deep=deep)
