"""What a check is: a measured deviation from an independent reference, and the bound that it has to keep."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

T = TypeVar("T")


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


@dataclass(frozen=True, kw_only=True)
class Check:
    """Outcome of one check.

    Attributes:
        name: Name for `--only`.
        what: What was measured.
        reference: What it was compared with.
        tolerance: Bound on the measured number.
        at_least: Whether the bound is a lower one; else it is an upper one.
        measured: The number; None if there is none.
        unit: Unit of tolerance and measured number.
        passed: Whether the bound is kept; None if the check was not run.
        note: Why it was not run, or how it broke down.
    """

    name: str
    what: str
    reference: str
    tolerance: float
    at_least: bool
    measured: float | None
    unit: str
    passed: bool | None
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A check that can be run.

    Attributes:
        name: Name for `--only`; its first word is the group.
        what: What is measured.
        reference: What it is compared with.
        tolerance: Bound on the measured number.
        unit: Unit of both.
        measure: Returns the number; may raise `NotRun`.
        at_least: Whether the bound is a lower one.
        package: Optional package that the reference needs, by its import name.
    """

    name: str
    what: str
    reference: str
    tolerance: float
    unit: str
    measure: Callable[[Bench], float]
    at_least: bool = False
    package: str | None = None

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
        kept = measured >= self.tolerance if self.at_least else measured <= self.tolerance
        return self._check(measured, kept, "")

    def _check(self, measured: float | None, passed: bool | None, note: str) -> Check:
        return Check(
            name=self.name,
            what=self.what,
            reference=self.reference,
            tolerance=self.tolerance,
            at_least=self.at_least,
            measured=measured,
            unit=self.unit,
            passed=passed,
            note=note,
        )
