"""What is drawn anew for every episode, from named distributions; every name has a stream of its own.

Each quantity takes its own column of uniform numbers, so that another distribution for one, or a given value, changes nothing
of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, NoReturn

import numpy as np
from pydantic import TypeAdapter, ValidationError
from scipy.special import ndtri

from swarm_mj.campaigns.distributions import (
    EDGE,
    Bernoulli,
    Choice,
    Continuous,
    Distribution,
    Integer,
    LogUniform,
    Normal,
    Uniform,
)
from swarm_mj.campaigns.loading import explained
from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array

from ..arguments import is_number
from .flybys import ALTITUDES

#: What is drawn: numbers that it takes for each spacecraft, 0 for one of the episode; least and largest allowed value; and
#: the distribution it has where nothing else is asked for.
NAMES: dict[str, tuple[int, float, float, dict[str, Any]]] = {
    "mission": (0, 0, np.inf, {"distribution": "uniform", "low": 0.0, "high": 1.0}),
    "spacecraft": (0, 1, np.inf, {"distribution": "uniform", "low": 0.0, "high": 1.0}),
    "speed": (0, 0.5, 2.0, {"distribution": "log_uniform", "low": 0.55, "high": 1.8}),
    "sun_elevation_deg": (0, 0.0, 90.0, {"distribution": "uniform", "low": 5.0, "high": 50.0}),
    "sun_azimuth_deg": (0, -360.0, 360.0, {"distribution": "uniform", "low": 0.0, "high": 360.0}),
    "visiting_point": (1, 0.0, 1.0, {"distribution": "uniform", "low": 0.0, "high": 1.0}),
    "altitude": (1, ALTITUDES[0], ALTITUDES[-1], {"distribution": "uniform", "low": 0.75, "high": 1.15}),
    "release_error": (3, -1.0, 1.0, {"distribution": "normal", "mean": 0.0, "std": 0.06}),
    "attitude_mrp": (3, -1.0, 1.0, {"distribution": "uniform", "low": -1.0, "high": 1.0}),
    "rate_rad_s": (3, -0.2, 0.2, {"distribution": "uniform", "low": -0.02, "high": 0.02}),
    "loss": (1, 0, 1, {"distribution": "bernoulli", "probability": 0.12}),
    "loss_time": (1, 0.0, 1.0, {"distribution": "uniform", "low": 0.2, "high": 0.8}),
    "camera_off": (1, 0, 1, {"distribution": "bernoulli", "probability": 0.15}),
    "camera_off_time": (1, 0.0, 1.0, {"distribution": "uniform", "low": 0.2, "high": 0.6}),
    "downlink_off": (1, 0, 1, {"distribution": "bernoulli", "probability": 0.15}),
    "downlink_off_time": (1, 0.0, 1.0, {"distribution": "uniform", "low": 0.0, "high": 0.8}),
}
#: Those that are whole numbers, and of them those that happen or do not.
FLAGS = ("loss", "camera_off", "downlink_off")
WHOLE = ("mission", "spacecraft", *FLAGS)
#: What a scenario of one's own says itself; where its episodes differ from those of the catalogue, they are as it says.
OF_SCENARIO = ("mission", "speed", "sun_elevation_deg", "sun_azimuth_deg", "visiting_point", "altitude")
#: How to ask for those, for messages.
CHANCE = "a chance such as {'distribution': 'bernoulli', 'probability': 0.3}"
_ADAPTER: TypeAdapter[Any] = TypeAdapter(Distribution)


class EpisodeDraw(NamedTuple):
    """What an episode of up to n spacecraft is.

    Attributes:
        seed: Of the flight, for what its `dispersions` draw.
        mission: Number of the mission in the pool.
        spacecraft: How many fly.
        speed: Over that of the mission.
        sun_elevation: Of the Sun over the target's horizon [rad].
        sun_azimuth: From north over east [rad].
        visiting_point: Place in the list of the mission's visiting points, 0 to 1, shape (n,).
        altitude: Over the imaging altitude, shape (n,).
        release_error: Of the place at the arrival, over the imaging altitude, shape (n, 3).
        sigma_BN: Attitudes at release, MRP, shape (n, 3); NaN where a scenario draws its own.
        omega_BN_B: Rates at release, shape (n, 3) [rad/s]; NaN as there.
        fails: When spacecraft are lost, cameras go off, and links to Earth go off, as a share of the flight; infinite for
            never, shape (n, 3).
    """

    seed: int
    mission: int
    spacecraft: int
    speed: float
    sun_elevation: float
    sun_azimuth: float
    visiting_point: Array
    altitude: Array
    release_error: Array
    sigma_BN: Array
    omega_BN_B: Array
    fails: Array


class Randomisation:
    """The distributions of an environment's episodes.

    Args:
        given: Replaces distributions by name: a mapping as in a campaign, or a number that always holds.
        missions: Names of the missions in the pool.
        most: Most spacecraft, n.
        own: Whether a scenario of one's own is flown: as it says, and nothing fails, but for what is given.

    Raises:
        ScenarioError: A name is unknown or the scenario's own, a distribution is none, or gives what is not allowed.
    """

    def __init__(
        self, given: Mapping[str, Any] | None, missions: tuple[str, ...], most: int, *, own: bool = False
    ) -> None:
        self._missions, self._most, self._own = missions, most, own
        if given is not None and not isinstance(given, Mapping):
            raise ScenarioError(f"randomise = {given!r}: must be a mapping from names to distributions; {_known()}")
        self._laws: dict[str, Any] = {name: _law(name, default) for name, (*_, default) in NAMES.items()}
        if own:
            self._laws |= {name: self._as_planned(name) for name in NAMES}
        for name, value in (given or {}).items():
            self._check_name(name, "randomise")
            is_law = isinstance(value, Mapping)
            self._laws[name] = self._given_law(name, value) if is_law else self._fixed(name, value, "randomise")
        self._lay_out()

    def _check_name(self, name: str, where: str) -> None:
        if name not in NAMES:
            raise ScenarioError(f"{where}: unknown name {name!r}; {_known()}")
        if self._own and name in OF_SCENARIO:
            allowed = ", ".join(known for known in NAMES if known not in OF_SCENARIO)
            raise ScenarioError(f"{where}: {name} is what scenario= says; with a scenario there are {allowed}")

    def _as_planned(self, name: str) -> Any:
        """What a scenario of one's own has in the place of the usual distribution."""
        planned = {
            "spacecraft": float(self._most),
            "speed": 1.0,
            "altitude": 1.0,
            "attitude_mrp": np.nan,
            "rate_rad_s": np.nan,
        }
        if name.endswith("_time"):
            return _DEFAULTS[name]
        return np.full(self._shape(name), planned.get(name, 0.0))

    def _shape(self, name: str) -> tuple[int, ...]:
        """Of the values of a name."""
        size = NAMES[name][0]
        return (self._most, size)[: min(size, 2)]

    def _lay_out(self) -> None:
        """Give every name its columns of the uniform numbers, and gather what uniform distributions make of theirs."""
        sizes = [max(1, size * self._most) for size, *_ in NAMES.values()]
        ends = np.cumsum(sizes)
        self._columns = {
            name: slice(int(end) - size, int(end)) for name, size, end in zip(NAMES, sizes, ends, strict=True)
        }
        self._low, self._width, self._bounds = np.zeros(ends[-1]), np.zeros(ends[-1]), np.zeros((2, ends[-1]))
        for name, (_, low, high, _) in NAMES.items():
            law, columns = self._laws[name], self._columns[name]
            self._bounds[:, columns] = [[low], [high]]
            if isinstance(law, Uniform):
                self._low[columns], self._width[columns] = law.low, law.high - law.low
        counted = ("mission", "spacecraft")  # by default uniform over what there is
        rest = [name for name in NAMES if name in counted or not isinstance(self._laws[name], Uniform)]
        self._others = {name: self._drawer(name) for name in rest}

    def draw(self, seed: int, given: Mapping[str, Any] | None = None) -> EpisodeDraw:
        """The episode of a flight seed.

        Values that are given by name, a number or one for each spacecraft, take the place of what would be drawn.

        Raises:
            ScenarioError: A name is unknown or a value is not allowed.
        """
        if given is not None and not isinstance(given, Mapping):
            raise ScenarioError(f"reset option draw = {given!r}: must be a mapping from names to values; {_known()}")
        for name in given or {}:
            self._check_name(name, "reset option draw")
        u = np.random.default_rng(seed).random(len(self._low))
        drawn = self._low + self._width * u
        for name, drawer in self._others.items():
            if not given or name not in given:
                drawn[self._columns[name]] = drawer(u[self._columns[name]])
        for name, value in (given or {}).items():
            drawn[self._columns[name]] = self._fixed(name, value, "reset option draw").ravel()
        return self._episode(seed, np.minimum(np.maximum(drawn, self._bounds[0]), self._bounds[1]))

    def _episode(self, seed: int, drawn: Array) -> EpisodeDraw:
        columns = self._columns
        mission, spacecraft, speed, elevation, azimuth = drawn[: columns["visiting_point"].start].tolist()
        vectors = (drawn[columns[name]].reshape(-1, 3) for name in ("release_error", "attitude_mrp", "rate_rad_s"))
        error, sigma_BN, omega_BN_B = vectors
        # Each of what may fail has two columns, whether and when.
        whether, when = drawn[columns["loss"].start :].reshape(3, 2, -1).swapaxes(0, 1)
        return EpisodeDraw(
            seed=seed,
            mission=int(mission),
            spacecraft=int(spacecraft),
            speed=speed,
            sun_elevation=float(np.radians(elevation)),
            sun_azimuth=float(np.radians(azimuth)),
            visiting_point=drawn[columns["visiting_point"]],
            altitude=drawn[columns["altitude"]],
            release_error=error,
            sigma_BN=sigma_BN,
            omega_BN_B=omega_BN_B,
            fails=np.where(whether > 0.5, when, np.inf).T.copy(),
        )

    def _drawer(self, name: str) -> Callable[[Array], Array]:
        """What makes the values of a name out of its uniform numbers."""
        law = self._laws[name]
        if isinstance(law, np.ndarray):
            return lambda u: law.ravel()
        # By default whatever the pool and the swarm hold, equally likely.
        if name == "mission" and law == _DEFAULTS[name]:
            return lambda u: np.floor(u * len(self._missions))
        if name == "spacecraft" and law == _DEFAULTS[name]:
            return lambda u: np.floor(u * self._most) + 1.0
        return lambda u: quantiles(law, u)

    def _fixed(self, name: str, value: Any, where: str) -> Array:
        """A given value as the array that is otherwise drawn."""
        number, shape = self._number(value, where) if name == "mission" else value, self._shape(name)
        array = np.asarray(number, np.float64) if _numeric(number) else np.full(0, np.nan)
        try:
            array = np.broadcast_to(array, shape).copy()
        except ValueError:
            self._refuse(name, value, where, shape)
        if not self._allows(name, array):
            self._refuse(name, value, where, shape)
        return array

    def _given_law(self, name: str, given: Mapping[str, Any]) -> Any:
        """A distribution in the place of the usual one, of which nothing that can be named lies beyond what is allowed."""
        values = given.get("values")
        if name == "mission" and isinstance(values, (list, tuple)):
            given = {**given, "values": [self._number(value, "randomise") for value in values]}
        law = _law(name, given)
        steps = isinstance(law, (Integer, Bernoulli, Choice))
        # Where there are no ends, tails are cut, but not half of it.
        reached = law.levels() if isinstance(law, Choice) else _ends(law) or [law.draw(0.5)]
        usual = name in WHOLE and law == _DEFAULTS[name]
        fits = _numeric(reached) and self._allows(name, np.array(reached, np.float64))
        if not usual and not (fits and (steps or name not in WHOLE)):
            self._refuse(name, dict(given), "randomise", ())
        return law

    def _number(self, mission: Any, where: str) -> Any:
        """Of a mission in the pool, from its name."""
        if not isinstance(mission, str):
            return mission
        if mission not in self._missions:
            pool = ", ".join(self._missions)
            raise ScenarioError(f"{where}: mission {mission!r} is not in this environment's pool: {pool}")
        return self._missions.index(mission)

    def _limits(self, name: str) -> tuple[float, float]:
        """Least and largest allowed value."""
        most = {"mission": len(self._missions) - 1, "spacecraft": self._most}
        return NAMES[name][1], most.get(name, NAMES[name][2])

    def _allows(self, name: str, array: Array) -> bool:
        low, high = self._limits(name)
        inside = np.isfinite(array) & (array >= low) & (array <= high)
        return bool((inside & ((array % 1 == 0) | (name not in WHOLE))).all())

    def _refuse(self, name: str, value: Any, where: str, shape: tuple[int, ...]) -> NoReturn:
        low, high = self._limits(name)
        kind = "whole number" if name in WHOLE else "number"
        allowed = f"a {kind} from {low:g} to {high:g}" + (f", or an array of them of shape {shape}" if shape else "")
        if name == "mission":
            allowed += ", or the name of a mission"
        if where == "randomise":
            law = "a distribution of such, integer or choice" if name in WHOLE else "a distribution of such"
            allowed += f", or {CHANCE if name in FLAGS else law}"
        raise ScenarioError(f"{where}: {name} = {value!r}: must be {allowed}")


def quantiles(law: Any, u: Array) -> Array:
    """Values of a distribution at points of the unit interval, shape (m,); the usual ones without scipy's overhead."""
    if isinstance(law, Uniform):
        return np.asarray(law.low + (law.high - law.low) * u)
    if isinstance(law, LogUniform):
        return np.asarray(law.low * (law.high / law.low) ** u)
    if isinstance(law, Normal):
        return np.asarray(law.mean + law.std * ndtri(np.clip(u, EDGE, 1.0 - EDGE)))
    if isinstance(law, Integer):
        return np.minimum(law.low + np.floor(u * law.count), law.high)
    if isinstance(law, (Bernoulli, Choice)):
        return np.array([law.draw(float(point)) for point in u], np.float64)
    assert isinstance(law, Continuous)
    return law.quantiles(u)


def _ends(law: Any) -> list[float]:
    """Least and largest value of a distribution that has them."""
    if isinstance(law, Bernoulli):
        return [0.0, 1.0]
    return [float(getattr(law, end)) for end in ("low", "high") if hasattr(law, end)]


def _law(name: str, given: Mapping[str, Any]) -> Any:
    try:
        return _ADAPTER.validate_python(dict(given))
    except ValidationError as error:
        first = error.errors()[0]
        told = explained({**first, "loc": ("parameters", name, *first["loc"])}).strip()
        raise ScenarioError(f"randomise: {told.removeprefix('parameters.')}") from None


_DEFAULTS = {name: _law(name, default) for name, (*_, default) in NAMES.items()}


def _known() -> str:
    return f"there are {', '.join(NAMES)}"


def _numeric(value: Any) -> bool:
    if isinstance(value, (list, tuple, np.ndarray)):
        return all(_numeric(part) for part in value)
    return is_number(value) or isinstance(value, (bool, np.bool_))
