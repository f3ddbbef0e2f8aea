"""The time axis of a history: even, or with a short encounter inside a long flight drawn wider, so that it can be read."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from swarm_mj.figures.palette import GREY
from swarm_mj.figures.style import ARRIVAL_DASHES, TICK_PT, label, tidy
from swarm_mj.figures.units import TimeAxis, instant, time_axis
from swarm_mj.flight.plan import Plan
from swarm_mj.scenarios.itinerary import arrival_times
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Indices

#: Samples beyond this number differ by less than a pixel.
MAX_SAMPLES = 20_000
#: An encounter shorter than this share of the flight is drawn wider, and then takes this share of the axis.
SHORT, STRETCHED = 0.125, 0.55
#: The least share of the axis for what lies before or after it.
LEAST = 0.08
#: How much before and after the encounter is drawn wider with it: half its length, and time enough to turn [s].
AROUND, TURNING_S = 0.5, 120.0
#: Of an encounter that comes nowhere near the imaging radius: distances up to this many times the least.
NEAR = 2.0
#: Width of a letter of a mark, over its size, and the least room between two marks [in].
LETTER, BETWEEN_IN = 0.62, 0.1
MINUS = "\N{MINUS SIGN}"
#: How the borders of a wider part are drawn.
BORDER_DOTS = (0, (1, 2))


@dataclass(frozen=True, kw_only=True)
class TimeScale:
    """Times of a flight on the page.

    Attributes:
        axis: The unit.
        duration_s: Of the flight [s].
        arrival_s: When the arrival is [s].
        encounter_s: Begin and end of the part that is drawn wider [s]; None: the axis is even.
        brief_before: Whether little is to be told of the time before that part.
    """

    axis: TimeAxis
    duration_s: float
    arrival_s: float
    encounter_s: tuple[float, float] | None
    brief_before: bool = False

    def on_page(self, t: Array) -> Array:
        """Places on the axis, from 0 at its begin to 1 at its end, of times [s]; both of shape (...,)."""
        return np.interp(t, *self._knots())

    def from_page(self, place: Array) -> Array:
        """Times [s] at places on the axis, the inverse of `on_page`."""
        return np.interp(place, *self._knots()[::-1])

    def middle(self, start_s: float, end_s: float) -> float:
        """The time that stands midway between two others on the page [s]."""
        return float(self.from_page(0.5 * (self.on_page(np.array(start_s)) + self.on_page(np.array(end_s)))))

    def share(self, start_s: float, end_s: float) -> float:
        """Share of the axis that a stretch of time takes."""
        return float(self.on_page(np.array(end_s)) - self.on_page(np.array(start_s)))

    def samples(self, times: Array, limit: int = MAX_SAMPLES) -> Indices:
        """Which of the samples at increasing times [s] to draw: at most about `limit`, evenly spaced on the page."""
        if len(times) <= limit:
            return np.arange(len(times))
        wanted = self.from_page(np.linspace(0.0, 1.0, limit))
        return np.unique(np.clip(np.searchsorted(times, wanted), 0, len(times) - 1))

    def draw(self, ax: Axes, colour: str = GREY, *, zorder: float = 1.5, brief: bool = False) -> None:
        """Mark arrival and borders, and let the horizontal axis span the flight and say so, in the common look."""
        self.draw_arrival(ax, colour, zorder=zorder)
        self.show(ax, brief=brief)
        self.draw_borders(ax)
        tidy(ax)
        self.name(ax)

    def show(self, ax: Axes, *, brief: bool = False) -> None:
        """Let the horizontal axis, which is in `axis` units, span the flight; briefly: with few marks."""
        unit = self.axis.seconds
        ax.set_xlim(0.0, self.duration_s / unit)
        if self.encounter_s is None:
            ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
            return
        ax.set_xscale("function", functions=(lambda x: self._beyond(x * unit), lambda p: self._back(p) / unit))
        marks = self._marks(brief, ax.get_window_extent().width / ax.figure.dpi)
        words = {t / unit: word for t, word in marks}
        ax.xaxis.set_major_locator(FixedLocator(list(words)))
        ax.xaxis.set_minor_locator(NullLocator())
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, _: words.get(x, "")))

    def name(self, ax: Axes, *, brief: bool = False) -> None:
        """Name the axis; briefly where there is little room."""
        label(ax, x=f"time [{self.axis.unit}]" if brief else f"time since deployment [{self.axis.unit}]")

    def draw_arrival(self, ax: Axes, colour: str = GREY, *, top: float = 1.0, zorder: float = 1.5) -> None:
        """Mark the arrival, up to a share `top` of the height."""
        at = self.arrival_s / self.axis.seconds
        ax.axvline(at, ymax=top, color=colour, linewidth=1.0, linestyle=ARRIVAL_DASHES, zorder=zorder)

    def draw_borders(self, ax: Axes) -> None:
        """Mark the begin and the end of the part that is drawn wider."""
        for t in self.encounter_s or ():
            if 0.0 < t < self.duration_s:
                ax.axvline(t / self.axis.seconds, color=GREY, linewidth=1.0, linestyle=BORDER_DOTS, zorder=1.4)

    def handles(self) -> list[Line2D]:
        """Legend entries of what `draw_arrival` in grey and `draw_borders` draw."""
        return [arrival_handle(GREY), *self.border_handles()]

    def border_handles(self) -> list[Line2D]:
        """Legend entries of what `draw_borders` draws."""
        if self.encounter_s is None:
            return []
        return [Line2D([], [], color=GREY, linewidth=1.0, linestyle=BORDER_DOTS, label="in between: drawn wider")]

    def instant(self, t: float) -> str:
        """A time [s] in words: since deployment, or before and after the arrival where that says more."""
        if self.encounter_s is None or t == self.arrival_s or not self.encounter_s[0] <= t <= self.encounter_s[1]:
            return instant(t, self.axis)
        after = t - self.arrival_s
        return f"arrival {'+' if after > 0.0 else MINUS} {instant(abs(after), time_axis(abs(after)))}"

    def _knots(self) -> tuple[Array, Array]:
        """Times [s] and places on the axis between which it is even."""
        if self.encounter_s is None:
            return np.array([0.0, self.duration_s]), np.array([0.0, 1.0])
        start, end = self.encounter_s
        outside = np.array([start, self.duration_s - end])
        shares = (1.0 - STRETCHED) * outside / outside.sum()
        if self.brief_before:
            shares = np.array([0.0, min(1.0 - STRETCHED, STRETCHED * outside[1] / (end - start))])
        shares = np.where(outside > 0.0, np.maximum(shares, LEAST), 0.0)
        places = np.cumsum([0.0, shares[0], STRETCHED, shares[1]])
        return np.array([0.0, start, end, self.duration_s]), places / places[-1]

    def _beyond(self, t: Array) -> Array:
        """`on_page`, going on evenly before and after the flight, where Matplotlib may ask too."""
        t = np.asarray(t, float)
        return self.on_page(t) + np.minimum(t, 0.0) + np.maximum(t - self.duration_s, 0.0)

    def _back(self, place: Array) -> Array:
        place = np.asarray(place, float)
        return self.from_page(place) + np.minimum(place, 0.0) + np.maximum(place - 1.0, 0.0)

    def _marks(self, brief: bool, width_in: float) -> list[tuple[float, str]]:
        """Times [s] with their words on an axis of a width [in]: since deployment, and around the arrival in the wider part.

        Of marks that would run into each other the one nearer to the arrival stays, then the begin of the flight.
        """
        assert self.encounter_s is not None
        unit, (start, end) = self.axis.seconds, self.encounter_s
        marks = [(self.arrival_s, "arrival")]
        inner = TimeAxis(1.0, "s") if end - start < 600.0 else TimeAxis(60.0, "min")
        around = MaxNLocator(2 if brief else 6 if self.brief_before else 4, steps=[1, 2, 5, 10]).tick_values(
            (start - self.arrival_s) / inner.seconds, (end - self.arrival_s) / inner.seconds
        )
        inside = [] if brief else [float(tick) for tick in sorted(around, key=abs) if tick]
        for t, word in [
            (self.arrival_s + tick * inner.seconds, f"{tick:+g} {inner.unit}".replace("-", MINUS)) for tick in inside
        ]:
            if start <= t <= end and self._is_clear(t, word, marks, width_in):
                marks.append((t, word))
        locator = MaxNLocator(2 if brief else 4, steps=[1, 2, 5, 10])
        outside = locator.tick_values((end if self.brief_before else 0.0) / unit, self.duration_s / unit)
        for t in sorted({0.0, *(float(tick) * unit for tick in outside if tick >= 0.0)}, key=lambda t: (t > 0.0, t)):
            word = f"{t / unit:g}"
            if not start <= t <= end and t <= self.duration_s and self._is_clear(t, word, marks, width_in):
                marks.append((t, word))
        return sorted(marks)

    def _is_clear(self, t: float, word: str, marks: list[tuple[float, str]], width_in: float) -> bool:
        """Whether a word at a time [s] stands clear of others on an axis of a width [in]."""
        letter_in = LETTER * TICK_PT / 72.0
        return all(
            abs(self.share(t, at)) * width_in > 0.5 * letter_in * (len(word) + len(other)) + BETWEEN_IN
            for at, other in marks
        )


def arrival_handle(colour: str) -> Line2D:
    """Legend entry of what `TimeScale.draw_arrival` draws."""
    return Line2D([], [], color=colour, linewidth=1.0, linestyle=ARRIVAL_DASHES, label="arrival")


def time_scale(plan: Plan, telemetry: xr.Dataset) -> TimeScale:
    """The time axis that suits a flight."""
    scenario = plan.scenario
    return TimeScale(
        axis=time_axis(scenario.duration_s),
        duration_s=scenario.duration_s,
        arrival_s=float(arrival_times(scenario).max()),
        encounter_s=_encounter(plan, telemetry),
    )


def delivery_scale(plan: Plan, telemetry: xr.Dataset, busy_s: float, end_s: float) -> TimeScale:
    """The time axis that suits a flight and what comes after it until `end_s`.

    If it is short, the part until `busy_s`, while data move, is drawn wider, or else the flight or its encounter alone.
    """
    flight = time_scale(plan, telemetry)
    start, end = flight.encounter_s or (0.0, flight.duration_s)
    end_s = max(end_s, flight.duration_s)
    parts = [(start, max(last, end)) for last in (min(busy_s, end_s), end)]
    wider = next((part for part in parts if part[1] - start < SHORT * end_s), None)
    return replace(flight, axis=time_axis(end_s), duration_s=end_s, encounter_s=wider, brief_before=True)


def arrival_words(scenario: Scenario, axis: TimeAxis) -> str:
    """When the arrival is, in words; of several arrivals, from when to when."""
    arrivals = arrival_times(scenario)
    first, last = float(arrivals.min()), float(arrivals.max())
    if first == last:
        return f"the arrival, t = {instant(first, axis)}"
    return f"each at its arrival, t = {instant(first, axis)} to {instant(last, axis)}"


def _encounter(plan: Plan, telemetry: xr.Dataset) -> tuple[float, float] | None:
    """The time in which a spacecraft is inside the imaging region, with what is around it; None where that is no short one."""
    times, scenario = telemetry["time"].values, plan.scenario
    distance = np.linalg.norm(telemetry["r_BN_N"].values, axis=2).min(axis=1)
    near = times[distance <= max(scenario.behavior.imaging_radius_m, NEAR * float(distance.min()))]
    arrivals = arrival_times(scenario)
    first, last = min(float(near[0]), float(arrivals.min())), max(float(near[-1]), float(arrivals.max()))
    room = max(AROUND * (last - first), TURNING_S)
    start, end = max(first - room, 0.0), min(last + room, scenario.duration_s)
    return (start, end) if end - start < SHORT * scenario.duration_s else None
