"""Distributions of a drawn parameter, by name: points of the unit interval become values through scipy.stats.

Every distribution has `draw`, the quantile function, and `levels`, the values of a grid, with their number, `count`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy import stats

from swarm_mj.scenarios.schema import Section
from swarm_mj.typing import Array

#: Quantiles are asked for at least this far from 0 and 1, so that no tail becomes infinite.
EDGE = 2.0**-53


class Continuous(Section):
    """What continuous distributions share."""

    steps: int = Field(5, ge=2, le=10_000, description="number of values where the method is `grid`")

    @cached_property
    def _law(self) -> Any:
        """The distribution of scipy.stats."""
        return _LAWS[type(self)](self)

    def draw(self, u: float) -> Any:
        """Value at a point of the unit interval."""
        return float(self.quantiles(u))

    def quantiles(self, u: Array | float) -> Array:
        """Values at points of the unit interval, of the same shape."""
        return np.asarray(self._law.ppf(np.clip(u, EDGE, 1.0 - EDGE)), np.float64)

    @property
    def count(self) -> int:
        """Number of levels."""
        return self.steps

    def levels(self) -> list[Any]:
        """Values of a grid: the middles of `steps` equally likely parts."""
        return [self.draw((k + 0.5) / self.steps) for k in range(self.steps)]


class Bounded(Continuous):
    """What continuous distributions between two ends share."""

    low: float
    high: float

    @model_validator(mode="after")
    def _ends_are_ordered(self) -> Self:
        _require_order(self.low, self.high)
        return self


class Uniform(Bounded):
    """Uniform between two ends; a grid takes both of them."""

    distribution: Literal["uniform"]

    def levels(self) -> list[Any]:
        """Equidistant values, both ends included."""
        return [float(v) for v in np.linspace(self.low, self.high, self.steps)]


class LogUniform(Bounded):
    """Uniform in the logarithm between two positive ends; a grid takes both of them."""

    distribution: Literal["log_uniform"]
    low: float = Field(gt=0)
    high: float = Field(gt=0)

    def levels(self) -> list[Any]:
        """Values at equal ratios, both ends included."""
        return [float(v) for v in np.geomspace(self.low, self.high, self.steps)]


class Normal(Continuous):
    """Gaussian."""

    distribution: Literal["normal"]
    mean: float
    std: float = Field(gt=0)


class TruncatedNormal(Bounded):
    """Gaussian cut off at two ends; `mean` and `std` are those before the cut."""

    distribution: Literal["truncated_normal"]
    mean: float
    std: float = Field(gt=0)


class LogNormal(Continuous):
    """The logarithm is Gaussian, with mean ln(median) and standard deviation sigma."""

    distribution: Literal["lognormal"]
    median: float = Field(gt=0)
    sigma: float = Field(gt=0)


class Triangular(Bounded):
    """A triangle over two ends with its top at `mode`."""

    distribution: Literal["triangular"]
    mode: float

    @model_validator(mode="after")
    def _mode_is_between_the_ends(self) -> Self:
        between = self.low <= self.mode <= self.high
        _require(between, f"mode = {self.mode:g}", f"must lie between low = {self.low:g} and high = {self.high:g}")
        return self


class OfScipy(Continuous):
    """Any other continuous distribution of scipy.stats, by its name and parameters."""

    distribution: Literal["scipy"]
    name: str = Field(description="for example rayleigh, weibull_min, vonmises")
    parameters: dict[str, float] = Field(default_factory=dict, description="its shape parameters, loc and scale")

    @model_validator(mode="after")
    def _scipy_has_it(self) -> Self:
        found = getattr(stats, self.name, None)
        known = isinstance(found, stats.rv_continuous)
        _require(known, f"name = {self.name}", "must be a continuous distribution of scipy.stats, such as rayleigh")
        try:
            middle = float(self._law.ppf(0.5))
        except (TypeError, ValueError) as error:
            raise ValueError(f"parameters = {self.parameters}: do not fit {self.name}: {error}") from None
        _require(np.isfinite(middle), f"parameters = {self.parameters}", f"are outside the domain of {self.name}")
        return self


#: What each is in scipy.stats.
_LAWS: dict[type[Continuous], Callable[[Any], Any]] = {
    Uniform: lambda own: stats.uniform(own.low, own.high - own.low),
    LogUniform: lambda own: stats.loguniform(own.low, own.high),
    Normal: lambda own: stats.norm(own.mean, own.std),
    TruncatedNormal: lambda own: stats.truncnorm(
        (own.low - own.mean) / own.std, (own.high - own.mean) / own.std, loc=own.mean, scale=own.std
    ),
    LogNormal: lambda own: stats.lognorm(own.sigma, scale=own.median),
    Triangular: lambda own: stats.triang(
        (own.mode - own.low) / (own.high - own.low), loc=own.low, scale=own.high - own.low
    ),
    OfScipy: lambda own: getattr(stats, own.name)(**own.parameters),
}


class Integer(Section):
    """Whole numbers between two ends, both included and equally likely; a grid takes all of them."""

    distribution: Literal["integer"]
    low: int
    high: int

    @model_validator(mode="after")
    def _ends_are_ordered(self) -> Self:
        _require_order(self.low, self.high)
        return self

    def draw(self, u: float) -> int:
        """Value at a point of the unit interval."""
        return int(stats.randint(self.low, self.high + 1).ppf(np.clip(u, EDGE, 1.0 - EDGE)))

    @property
    def count(self) -> int:
        """Number of levels."""
        return self.high - self.low + 1

    def levels(self) -> list[Any]:
        """All of them."""
        return list(range(self.low, self.high + 1))


class Bernoulli(Section):
    """True with a probability; a grid takes false and true."""

    distribution: Literal["bernoulli"]
    probability: float = Field(ge=0, le=1)

    def draw(self, u: float) -> bool:
        """Value at a point of the unit interval."""
        return u >= 1.0 - self.probability

    @property
    def count(self) -> int:
        """Number of levels."""
        return 2

    def levels(self) -> list[Any]:
        """Both."""
        return [False, True]


class Choice(Section):
    """One of some values of any kind, equally likely or by weight; a grid takes all of them."""

    distribution: Literal["choice"]
    values: tuple[Any, ...] = Field(min_length=1, max_length=10_000)
    weights: tuple[Annotated[float, Field(ge=0)], ...] | None = Field(None, description="of the values; null: equal")

    @model_validator(mode="after")
    def _weights_fit(self) -> Self:
        if self.weights is not None:
            fits = len(self.weights) == len(self.values) and sum(self.weights) > 0
            _require(fits, f"weights = {list(self.weights)}", f"must be {len(self.values)} numbers, not all zero")
        return self

    def draw(self, u: float) -> Any:
        """Value at a point of the unit interval."""
        weights = np.ones(len(self.values)) if self.weights is None else np.array(self.weights)
        ends = np.cumsum(weights) / weights.sum()
        # The last value with a weight takes what rounding leaves over.
        last = int(np.flatnonzero(weights)[-1])
        return self.values[min(int(np.searchsorted(ends, u, side="right")), last)]

    @property
    def count(self) -> int:
        """Number of levels."""
        return len(self.values)

    def levels(self) -> list[Any]:
        """All of them."""
        return list(self.values)


Distribution = Annotated[
    Uniform | LogUniform | Normal | TruncatedNormal | LogNormal | Triangular | OfScipy | Integer | Bernoulli | Choice,
    Field(discriminator="distribution"),
]


def draw_all(parameters: Mapping[str, Any], u: Array) -> dict[str, Any]:
    """Values of all parameters at a point of the unit cube, shape (d,)."""
    return {key: law.draw(float(point)) for (key, law), point in zip(parameters.items(), u, strict=True)}


def _require_order(low: float, high: float) -> None:
    _require(low < high, f"high = {high:g}", f"must be above low = {low:g}")


def _require(fits: Any, what: str, allowed: str) -> None:
    if not fits:
        raise ValueError(f"{what}: {allowed}")
