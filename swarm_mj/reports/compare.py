"""What came out of two runs, line by line, with what differs marked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from swarm_mj.observation.coverage import rounded_down
from swarm_mj.records.run_record import RunRecord
from swarm_mj.records.summary import working
from swarm_mj.reports.markup import Html, table, tag
from swarm_mj.reports.sections import P_TO, findings_list, section, short


class Outcome(NamedTuple):
    """One line of the comparison: how to read it from a summary and how to write it."""

    label: str | Html
    value: Callable[[dict[str, Any]], float | None]
    form: str

    def text(self, value: float | None) -> str:
        """A value as it is written; `e` is the form of numbers of any size."""
        if value is None:
            return "–"
        return short(value) if self.form == "e" else format(value, self.form)


def _share(key: str) -> Callable[[dict[str, Any]], float | None]:
    return lambda summary: None if summary.get(key) is None else float(rounded_down(summary[key]))


def _largest(key: str) -> Callable[[dict[str, Any]], float | None]:
    return lambda summary: max(summary[key].values(), default=None)


def _largest_at_end(summary: dict[str, Any]) -> float | None:
    """The largest pointing error of the spacecraft that still work at the end [deg]."""
    return max(working(summary, "pointing_error_deg_final").values(), default=None)


OUTCOMES = (
    Outcome("spacecraft", lambda s: s["spacecraft"], "g"),
    Outcome("of them observers", lambda s: s["observers"], "g"),
    Outcome(Html(f"{P_TO} [%]"), _share("coverage_percent"), ".2f"),
    Outcome("the same, whole passage [%]", _share("coverage_percent_passage"), ".2f"),
    Outcome("delivered to Earth [%]", _share("delivered_percent"), ".2f"),
    Outcome("all that was seen on Earth at t [s]", lambda s: s.get("time_to_all_data_s"), ".0f"),
    Outcome("pointing error before a switch, largest [deg]", _largest("pointing_error_deg_before_switch"), "e"),
    Outcome("pointing error at the end, largest [deg]", _largest_at_end, "e"),
    Outcome("spacecraft lost by the end", lambda s: len(s.get("lost", ())), "g"),
    Outcome("fastest wheel [% of limit]", lambda s: 100.0 * s["max_wheel_speed_fraction"], ".1f"),
    Outcome("largest wheel torque [% of limit]", lambda s: 100.0 * s["max_wheel_torque_fraction"], ".1f"),
    Outcome("wheels at their limits, longest [s]", _largest("wheel_saturation_s"), "g"),
    Outcome("links closed at the end", lambda s: s["links_closed_final"], "g"),
    Outcome("link closed, best spacecraft [% of time]", _largest("link_closed_percent"), ".1f"),
    Outcome("deployment Δv, largest [m/s]", _largest("deployment_delta_v_m_s"), ".2f"),
    Outcome("near-collisions", lambda s: len(s["near_collisions"]), "g"),
    Outcome("target faces", lambda s: s["target_faces"], "g"),
)


def comparison_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    """The outcome of two runs side by side; lines whose written numbers differ are marked."""
    rows, classes = [], []
    for outcome in OUTCOMES:
        first, second = (outcome.value(run.summary) for run in runs)
        texts = [outcome.text(value) for value in (first, second)]
        rows.append((outcome.label, *texts, _difference(outcome, first, second) if texts[0] != texts[1] else "same"))
        classes.append("differs" if texts[0] != texts[1] else "same")
    head = ("", *labels, "B minus A")
    notes = [
        [tag("h3", label), found]
        for run, label in zip(runs, labels, strict=True)
        if (found := findings_list(run)) is not None
    ]
    caption = "Outcome; lines that differ are marked with ≠"
    return section(
        "summary", "Outcome", table(head, rows, caption=caption, class_="numeric", row_classes=classes), notes
    )


def _difference(outcome: Outcome, first: float | None, second: float | None) -> str:
    if first is None or second is None:
        return "–"
    change = second - first
    return f"{'+' if change > 0 else '−'}{outcome.text(abs(change))}"
