"""What the sections of a scenario are made of: an immutable model that refuses unknown keys, and bounded vectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ModelWrapValidatorHandler, model_validator

from swarm_mj.errors import ScenarioError
from swarm_mj.io.values import TOO_LARGE, check_data, shown

#: Of a position [m], up to some 7 au: two days before a fast flyby a mothership is 1e9 m away.
Component = Annotated[float, Field(ge=-1e12, le=1e12)]
Vector3 = Annotated[tuple[Component, Component, Component], Field(description="three components")]
#: Axes in which angles are given; z is the pole of the B-plane.
Axes = Literal["ecliptic", "equatorial", "body_equator"]
AXES = (
    "ecliptic: N, ecliptic and equinox of J2000; equatorial: EME2000, where longitude and latitude are right ascension and "
    "declination; body_equator: z along the body's pole, x along the ascending node of its equator on that of EME2000"
)
#: How a plug-in of the user's own is named.
YOUR_OWN = "your own: its name, or FILE.py:CLASS relative to the scenario's file"
#: Arguments of a plug-in by name.
Parameters = dict[str, Any]


#: Kinds of plain values, which do not stand for each other.
_KINDS = {bool: "true or false", float: "a number", str: "text"}


def _kind(value: Any) -> type | None:
    return next((kind for kind, of in ((bool, bool), (float, (int, float)), (str, str)) if isinstance(value, of)), None)


def _changed(given: Any, validated: Any) -> tuple[Any, type] | None:
    """The first plain value, in a tuple, that became one of another kind, and which kind that is."""
    if isinstance(given, list | tuple) and isinstance(validated, tuple):
        return next((odd for pair in zip(given, validated, strict=False) if (odd := _changed(*pair))), None)
    before, after = _kind(given), _kind(validated)
    return (given, after) if before and after and before is not after else None


def named(name: str, known: Mapping[str, Mapping[str, Any]], model: type[BaseModel]) -> dict[str, Any]:
    """The values of a section that stands under a name.

    Args:
        name: As it was given.
        known: Sections by name, by what they change.
        model: The section, whose keys could be given instead.

    Raises:
        ValueError: There is no such name; the message lists those that are.
    """
    if name not in known:
        raise ValueError(f"= {name!r}: must be {' or '.join(known)}, or a mapping of {', '.join(model.model_fields)}")
    return dict(known[name])


class Section(BaseModel):
    """Base of all sections: immutable, strict about unknown keys and non-finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="wrap")
    @classmethod
    def _kinds_are_kept(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Refuse text and true or false in the place of a number, and the other way round, which pydantic would convert."""
        section = handler(data)
        # After the bounds of the fields, which say more.
        values = {field.alias or name: getattr(section, name) for name, field in cls.model_fields.items()}
        check_data(values, too_large=TOO_LARGE, refusal=ValueError)
        for name, field in cls.model_fields.items() if isinstance(data, Mapping) else ():
            if (key := field.alias or name) in data and (odd := _changed(data[key], getattr(section, name))):
                given, kind = odd
                raise ValueError(f"{key} = {shown(data[key])}: must be {_KINDS[kind]}, not {shown(given)}")
        return section

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
