"""The arguments of SwarmDownlink-v0, checked: mission, power, and what is drawn for every episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, TypeVar

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.loading import ScenarioSource, checked_overrides
from swarm_mj.scenarios.schema import is_multiple

from ..arguments import checked_count, checked_numbers, checked_rate

#: What `reset` and `step` may give as observation.
OBSERVATIONS = ("flat", "dict")
#: Longest episode in decisions, so that its tables can be held.
MOST_SLOTS = 2000


@dataclass(frozen=True, kw_only=True)
class Power:
    """Battery, panels and what takes power; a 6U CubeSat of MarCO's class.

    Attributes:
        battery_J: Capacity: 40 Wh, a class of 6U batteries.
        panel_1au_W: Of the panels that face the Sun at 1 au: 35 W of two wings (MarCO). It falls with the square of distance.
        base_W: What is always on, the receivers included.
        earth_W: More while sending to Earth: Iris takes 33.7 W for 4 W of radio frequency (Kobayashi 2017, SSC17-II-04).
        crosslink_W: More while sending to another spacecraft: a UHF transmitter of 1 W, class.
        slew_J: A turn between the Sun and Earth, by wheels.
        slew_s: How long it takes; nothing is sent to Earth meanwhile.
        restart: Share of the capacity from which a spacecraft whose battery was empty obeys again.
    """

    battery_J: float = 144e3
    panel_1au_W: float = 35.0
    base_W: float = 5.0
    earth_W: float = 33.7
    crosslink_W: float = 3.0
    slew_J: float = 200.0
    slew_s: float = 120.0
    restart: float = 0.2


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What an episode draws, from which ranges; all uniform unless said otherwise.

    Attributes:
        start_s: Latest beginning after the arrival [s].
        drift_m_s: Spread of each component of each spacecraft's departure from the plan, normal [m/s].
        charge: Least charge at the beginning, of the capacity; the most is 1.
        products: Least number of data products; the most is the argument `products`.
        later: Share of them, on average, that are asked for only during the episode, in its first two thirds.
        size_bit: Least size, log-uniform [bit].
        size_most_bit: Largest size [bit].
        density: Most valuable bit over least valuable bit, log-uniform.
        lifetime: Shortest time until a product expires, of the horizon.
        lifetime_most: Longest.
        unequal: Concentration of the Dirichlet draw of how products are shared out: the less, the more on one spacecraft.
        pass_s: Shortest pass of the ground antenna that is allotted to the swarm [s].
        pass_most_s: Longest pass [s].
        gap_most_s: Longest time between two passes; the shortest is none [s].
        radio_fails: Probability that a spacecraft's radio to Earth fails in the episode.
        panel_fails: Probability that one of a spacecraft's two panels fails.
        lost: Probability that a spacecraft is lost.
    """

    start_s: float = 21_600.0
    drift_m_s: float = 1.0
    charge: float = 0.3
    products: float = 12.0
    later: float = 0.5
    size_bit: float = 1e6
    size_most_bit: float = 8e6
    density: float = 10.0
    lifetime: float = 0.1
    lifetime_most: float = 0.6
    unequal: float = 1.0
    pass_s: float = 3600.0
    pass_most_s: float = 14_400.0
    gap_most_s: float = 14_400.0
    radio_fails: float = 0.2
    panel_fails: float = 0.2
    lost: float = 0.05


class DownlinkWeights(NamedTuple):
    """Weight of each reward term.

    Attributes:
        delivered: Of the value of products that came to Earth whole, over that of all products of the episode.
        expired: Of the value of products that expired or were lost.
        empty: Of the number of batteries that became empty.
    """

    delivered: float = 1.0
    expired: float = -0.2
    empty: float = -0.05


@dataclass(frozen=True, kw_only=True)
class DownlinkConfig:
    """What makes one environment different from another; `SwarmDownlinkEnv` explains each argument.

    Raises:
        ScenarioError: A value is not allowed.
    """

    scenario: ScenarioSource = "eros-observe"
    step_s: float = 600.0
    horizon_s: float = 86_400.0
    products: int = 24
    storage_bit: float = 4e7
    observation: str = "flat"
    power: Mapping[str, float] | None = None
    draw: Mapping[str, float] | None = None
    reward_weights: Mapping[str, float] | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what is not allowed."""
        checked_overrides(self.overrides)
        for name in ("step_s", "horizon_s", "storage_bit"):
            checked_rate(name, getattr(self, name))
        slots = round(self.horizon_s / self.step_s)
        if not is_multiple(self.horizon_s, self.step_s) or not 1 <= slots <= MOST_SLOTS:
            raise ScenarioError(
                f"horizon_s = {self.horizon_s!r}: must be a whole multiple of step_s = {self.step_s:g} s, at most {MOST_SLOTS}"
            )
        checked_count("products", self.products)
        if self.observation not in OBSERVATIONS:
            raise ScenarioError(f"observation = {self.observation!r}: must be one of {', '.join(OBSERVATIONS)}")
        _ = self.powers, self.draws, self.weights

    @property
    def slots(self) -> int:
        """Decisions of an episode T."""
        return round(self.horizon_s / self.step_s)

    @property
    def powers(self) -> Power:
        """With what `power` replaces."""
        power = _replaced(Power(), "power", self.power)
        if not power.battery_J > 0.0 or power.slew_s >= self.step_s or power.restart > 1.0:
            raise ScenarioError("power: battery_J must be > 0, slew_s less than step_s, and restart at most 1")
        return power

    @property
    def draws(self) -> Draw:
        """With what `draw` replaces."""
        draw = _replaced(Draw(), "draw", self.draw)
        ordered = {"size_bit": "size_most_bit", "lifetime": "lifetime_most", "pass_s": "pass_most_s"}
        for low, high in ordered.items():
            if not 0.0 < getattr(draw, low) <= getattr(draw, high):
                raise ScenarioError(
                    f"draw[{low!r}] = {getattr(draw, low)!r}: must be > 0 and at most {high} = {getattr(draw, high)!r}"
                )
        for name in ("charge", "later", "radio_fails", "panel_fails", "lost"):
            if getattr(draw, name) > 1.0:
                raise ScenarioError(f"draw[{name!r}] = {getattr(draw, name)!r}: must be 0 to 1")
        if draw.density < 1.0 or draw.unequal <= 0.0 or round(draw.products) < 1:
            raise ScenarioError("draw: density and products must be at least 1, and unequal > 0")
        return replace(draw, products=float(min(round(draw.products), self.products)))

    @property
    def weights(self) -> DownlinkWeights:
        """With what `reward_weights` replaces."""
        return DownlinkWeights(**checked_numbers("reward_weights", self.reward_weights, DownlinkWeights._fields))


_Values = TypeVar("_Values", Power, Draw)


def _replaced(values: _Values, name: str, given: Any) -> _Values:
    checked = checked_numbers(name, given, [item.name for item in fields(values)])
    for key, value in checked.items():
        if value < 0.0:
            raise ScenarioError(f"{name}[{key!r}] = {value!r}: must not be negative")
    return replace(values, **checked)
