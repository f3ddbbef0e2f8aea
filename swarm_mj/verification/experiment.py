"""What a check is: a measured deviation from an independent reference, and the bound that it has to keep."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from inspect import cleandoc
from typing import Any, TypeVar

T = TypeVar("T")
Measure = TypeVar("Measure", bound="Callable[[Bench], float]")


class NotRun(Exception):
    """A check cannot be run on this machine; the message says why."""


class Bench:
    """What several checks of one validation share, made at first use: flights, shapes, views."""

    def __init__(self) -> None:
        self._made: dict[Callable[..., Any], Any] = {}

    def once(self, make: Callable[[Bench], T]) -> T:
        """Return what `make` returned when it was first asked for."""
        if make not in self._made:
            self._made[make] = make(self)
        return self._made[make]


@dataclass(frozen=True)
class Bound:
    """What a measured number has to keep.

    Attributes:
        name: Name for `--only`; its first word is the group.
        what: What is measured.
        reference: What it is compared with.
        tolerance: Upper bound on the measured number.
        unit: Unit of both.
    """

    name: str
    what: str
    reference: str
    tolerance: float
    unit: str


@dataclass(frozen=True)
class Check(Bound):
    """Outcome of one check.

    Attributes:
        measured: The number; None if there is none.
        passed: Whether the bound is kept; None if the check was not run.
        note: Why it was not run, or how it broke down.
    """

    measured: float | None
    passed: bool | None
    note: str


@dataclass(frozen=True)
class Experiment(Bound):
    """A check that can be run.

    Attributes:
        measure: Returns the number; may raise `NotRun`.
        package: Optional package that the reference needs, by its import name.
    """

    measure: Callable[[Bench], float]
    package: str | None = field(default=None, kw_only=True)

    @property
    def group(self) -> str:
        """First word of the name."""
        return self.name.split("-")[0]

    def run(self, bench: Bench) -> Check:
        """Measure and judge; a breakdown of the program counts as a failure, not as the end of the validation."""
        if self.package is not None and importlib.util.find_spec(self.package) is None:
            return self._check(None, None, f"not run: package {self.package} is not installed; the extra dev brings it")
        try:
            measured = float(self.measure(bench))
        except NotRun as reason:
            return self._check(None, None, f"not run: {reason}")
        except Exception as error:  # whatever a faulty program raises, the other checks still have to be run
            return self._check(None, False, f"{type(error).__name__}: {error}")
        if not math.isfinite(measured):
            return self._check(None, False, f"measured {measured}")
        return self._check(measured, measured <= self.tolerance, "")

    def _check(self, measured: float | None, passed: bool | None, note: str) -> Check:
        stated = {each.name: getattr(self, each.name) for each in fields(Bound)}
        return Check(**stated, measured=measured, passed=passed, note=note)


#: All checks, in the order in which they are run.
EXPERIMENTS: list[Experiment] = []


def experiment(
    name: str,
    reference: str,
    tolerance: float,
    unit: str = "1",
    *,
    what: str | None = None,
    package: str | None = None,
) -> Callable[[Measure], Measure]:
    """Make a check of a function that measures a deviation; arguments as in `Bound` and `Experiment`.

    What is measured is what the first paragraph of the function's docstring says, unless `what` says it.
    """

    def add(measure: Measure) -> Measure:
        words = what or cleandoc(measure.__doc__ or "").split("\n\n")[0].rstrip(".")
        stated = (name, words, reference, tolerance, unit)
        EXPERIMENTS.append(Experiment(*stated, measure, package=package))
        return measure

    return add
