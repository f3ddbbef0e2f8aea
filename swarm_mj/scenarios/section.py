"""What the sections of a scenario are made of: an immutable model that refuses unknown keys, and bounded vectors."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

#: Of a position [m], up to some 7 au: two days before a fast flyby a mothership is 1e9 m away.
Component = Annotated[float, Field(ge=-1e12, le=1e12)]
Vector3 = Annotated[tuple[Component, Component, Component], Field(description="three components")]
#: Arguments of a plug-in by name.
Parameters = dict[str, Any]


class Section(BaseModel):
    """Base of all sections: immutable, strict about unknown keys and non-finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
