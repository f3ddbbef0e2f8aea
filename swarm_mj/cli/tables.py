"""Short tables for the screen: what came out of runs and designs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from swarm_mj.cli.common import narrowest
from swarm_mj.observation.coverage import percent_digits, percent_text, rounded_up_digits
from swarm_mj.records.observed import causes_text, criterion_text, mapped_texts
from swarm_mj.records.summary import working

#: Told only of runs whose pictures were planned.
PLANNED = "planned by the plan of pictures [%]; bound; gap"
#: Told only of runs that navigate by pictures.
NAVIGATED = "positions by pictures at the arrival, error; 3 sigma, at most [m]"


def results_tables(console: Console, summaries: Sequence[dict[str, Any]]) -> Iterator[Table]:
    """As many short tables as it takes to have none wider than the terminal; a single one where nobody looks at one."""
    part: list[dict[str, Any]] = []
    for summary in summaries:
        wide = console.is_terminal and narrowest(console, results_table([*part, summary]))[0] > console.width
        if part and wide:
            yield results_table(part)
            part = []
        part.append(summary)
    yield results_table(part)


def results_table(summaries: Sequence[dict[str, Any]]) -> Table:
    """A short table: one column a run."""
    table = Table(title="Results", title_justify="left")
    table.add_column("")
    for summary in summaries:
        table.add_column(summary["scenario"], justify="right")
    blurred = (
        {"motion blur at the arrival, median / worst [px]": _blurred}
        if any("motion_blur_px_arrival" in s for s in summaries)
        else {}
    )
    mapped = {label: partial(_mapped, label) for summary in summaries for label in mapped_texts(summary)}
    planned = {PLANNED: _planned} if any("picture_plan" in summary for summary in summaries) else {}
    navigated = {NAVIGATED: _navigated} if any("optical" in summary for summary in summaries) else {}
    for label, cell in (_OBSERVED | planned | mapped | _ROWS | navigated | blurred).items():
        table.add_row(escape(label), *(cell(summary) for summary in summaries))
    return table


def _worst(errors: dict[str, float]) -> str:
    return f"{max(errors.values()):.3g}" if errors else "-"


def _spread(values: dict[str, float]) -> str:
    return " / ".join(f"{value:.3g}" for value in values.values()) or "-"


def _sampled(summary: dict[str, Any]) -> str:
    required, reached = summary.get("ground_resolution_m"), _spread(summary["gsd_m"])
    return reached if required is None else f"{reached}; D {required:g}"


def _mapped(label: str, summary: dict[str, Any]) -> str:
    return mapped_texts(summary).get(label, "-")


def _blurred(summary: dict[str, Any]) -> str:
    return _spread(summary.get("motion_blur_px_arrival", {}))


def _delivered(summary: dict[str, Any]) -> str:
    """What arrives, and where that is less than what was seen, why."""
    percent = summary.get("delivered_percent")
    if percent is None:
        return "-"
    parts = [f"{rounded_up_digits(part['percent'])} by {part['reason']}" for part in summary["not_delivered"][:3]]
    bound = summary["delivered_percent_bound"]
    best = f"at most {rounded_up_digits(bound)}" if bound is not None and bound - percent > 0.005 else ""
    words = [best, f"not: {', '.join(parts)}" if parts else ""]
    return "; ".join([percent_digits(percent), *filter(None, words)])


def _planned(summary: dict[str, Any]) -> str:
    plan = summary.get("picture_plan")
    if plan is None:
        return "-"
    return f"{percent_digits(plan['planned_percent'])}; {plan['bound_percent']:.2f}; {plan['gap_percent']:.2f}"


def _navigated(summary: dict[str, Any]) -> str:
    told = summary.get("optical", {})
    return "; ".join(_worst(told.get(f"position_{what}_m_arrival", {})) for what in ("error", "3_sigma"))


def _complete(summary: dict[str, Any]) -> str:
    full, earliest = (summary.get(key) for key in ("time_to_all_data_s", "time_to_all_data_s_bound"))
    return "-" if full is None else f"{full:.0f}" + ("" if earliest is None else f"; {earliest:.0f}")


def _released(summary: dict[str, Any]) -> str:
    """The largest speed, and that of the deployer where it is beyond."""
    beyond = f" (deployer: {summary['deployer_max_speed_m_s']:g})" if summary.get("deployment_findings") else ""
    return f"{max(summary['deployment_delta_v_m_s'].values()):.2f}{beyond}"


def _crew(summary: dict[str, Any]) -> str:
    lost = f", {len(summary['lost'])} lost" if summary["lost"] else ""
    return f"{summary['spacecraft']} ({summary['observers']}){lost}"


#: Rows before those of plans and quality classes, and those after them.
_OBSERVED: dict[str, Callable[[dict[str, Any]], str]] = {
    "spacecraft (of them observers)": _crew,
    "target faces": lambda s: str(s["target_faces"]),
    "criterion, camera half-angle": lambda s: f"{criterion_text(s)}, {s['camera_half_angle_deg']:g} deg",
    "observed area P_TO [%]": lambda s: percent_digits(s["coverage_percent"]),
    "the same, whole passage [%]": lambda s: percent_digits(s["coverage_percent_passage"]),
    "not observed, by cause": lambda s: causes_text(s) or "-",
}
_ROWS: dict[str, Callable[[dict[str, Any]], str]] = {
    "of the target delivered to Earth [%]": _delivered,
    "all that was seen on Earth, t [s]; by the best of these slots": _complete,
    "GSD observed, min / median / max [m]": _sampled,
    "GSD delivered, min / median / max [m]": lambda s: _spread(s.get("gsd_delivered_m", {})),
    "incidence of sunlight, min / median / max [deg]": lambda s: _spread(s["incidence_deg"]),
    "pointing error before a switch, at most [deg]": lambda s: _worst(s["pointing_error_deg_before_switch"]),
    "pointing error at the arrival, at most [deg]": lambda s: _worst(s.get("pointing_error_deg_arrival", {})),
    "sensors; attitude known at the arrival, at worst to [deg]": lambda s: (
        f"{s.get('sensors', '-')}; {_worst(s.get('attitude_knowledge_error_deg_arrival', {}))}"
    ),
    "pointing error at the end, at most [deg]": lambda s: _worst(working(s, "pointing_error_deg_final")),
    "wheel speed, at most [% of limit]": lambda s: f"{100 * s['max_wheel_speed_fraction']:.0f}",
    "links closed at the end": lambda s: f"{s['links_closed_final']} of {s['spacecraft']}",
    "deployment delta-v, at most [m/s]": _released,
    "measured by": lambda s: s["observer"],
    "wall time [s]": lambda s: f"{sum(s['wall_s'].values()):.1f}",
}


def design_table(record: dict[str, Any]) -> Table:
    """The proof and the genetic algorithm side by side, from a design's record."""
    table = Table(title="Design", title_justify="left")
    for heading in ("", "observers", "P_TO [%]", "points", "explored", "seconds"):
        table.add_column(escape(heading), justify="left" if heading in ("", "points") else "right")
    proof = record["proof"]
    proven = {"optimal": "proven", "interrupted": "interrupted"}.get(proof["status"])
    proven = proven or f"at least {proof['lower_bound']:g}"
    table.add_row(
        proven, str(proof["minimum"]), percent_digits(proof["covered_percent"]), _numbers(proof["visiting_points"]), "-",
        f"{proof['seconds']:.2f}",
    )  # fmt: skip
    names = {"repair": "GA, repair", "plain": "GA, plain"}
    for name, result in record["genetic"].items():
        table.add_row(
            names[name],
            str(result["n_observers"]),
            percent_digits(result["covered_percent"]) + ("" if result["feasible"] else " (too little)"),
            _numbers(result["gene_map"][1:]),
            f"{result['designs_explored']:,}",
            f"{result['seconds']:.2f}",
        )
    table.caption = (
        f"{_gap_words(record)}; selected: {_observers(record['n_observers'])} by the {record['selected_by']}. Criterion: "
        f"{record['criterion']['criterion']}, {record['camera']['half_angle_deg']:g} deg half-angle{_class_words(record)}"
        f"{_arrival_words(record)}{_release_words(record)}"
    )
    return table


def _release_words(record: dict[str, Any]) -> str:
    """What the selected design was free to choose, and how many of it the deployer cannot release."""
    chosen, fast = record["candidates"], record["beyond_deployer"]
    words = "" if chosen == list(map(str, record["visiting_points"])) else f". Selected: {', '.join(chosen)}"
    if fast:
        words += f". {fast} of {record['n_observers']} leave at up to {max(record['delta_v_m_s']):.3g} m/s, beyond "
        words += f"mothership.deployer.max_speed_m_s = {record['deployer_max_speed_m_s']:g}"
    return words


def _class_words(record: dict[str, Any]) -> str:
    """Which quality class P_TO is of, and what nobody maps and why; empty without one."""
    if (asked := record.get("quality_class")) is None:
        return ""
    causes = ", ".join(f"{share:.3g} % {words}" for words, share in record["not_mappable"].items())
    words = f". P_TO is what is mapped at class {asked['name']}; seen at all: {percent_text(record['seen_percent'])}"
    return f"{words}; no set of candidates maps {causes}" if causes else words


def _arrival_words(record: dict[str, Any]) -> str:
    """When the maps are on Earth, where that was asked for."""
    if (limit := record.get("deliver_within_h")) is None:
        return ""
    selected = _by_when(record["delivered_by_h"], record["delivered_in_time"])
    evolved = [
        f"{name}: {_by_when(record['genetic_delivered_by_h'][name], in_time)}"
        for name, in_time in record["genetic_delivered_in_time"].items()
    ]
    return (
        f". Whole map on Earth within {limit:g} h of the epoch: selected {selected} (genetic algorithm, {', '.join(evolved)}); "
        f"{record['designs_flown']} designs were flown"
    )


def _by_when(hours: float | None, in_time: bool | None) -> str:
    if in_time is None:
        return "not checked"
    return ("never" if hours is None else f"by {hours:.3f} h") + ("" if in_time else ", not met")


def _gap_words(record: dict[str, Any]) -> str:
    """How the genetic algorithm's design compares with the proof, or why it does not."""
    gap = record["gap"]
    if record.get("certainty"):
        chance = record["certainty"][0]
        if chance["promised"] is None:
            return f"no design for probability {chance['probability']:g} yet: this one allows for no losses"
        return f"probability {chance['promised']:.4f} promised for {chance['probability']:g} asked for"
    if gap is None and record.get("genetic_delivered_in_time", {}).get("repair") is False:
        return "the genetic algorithm's design is not on Earth in time"
    if gap is None:
        why = f"the design was interrupted ({record['interrupted']})" if record["interrupted"] else "the time was up"
        return f"nothing proven: {why}"
    return "the genetic algorithm covers too little" if gap < 0 else f"gap of the genetic algorithm to the proof: {gap}"


def paths_table(record: dict[str, Any]) -> Table:
    """The selected paths of a design, each with its place in the B-plane."""
    table = Table(title="Selected paths", title_justify="left")
    for heading in ("path", "B.T [km]", "B.R [km]", "v_inf [m/s]", "delta-v [m/s]"):
        table.add_column(escape(heading), justify="left" if heading == "path" else "right")
    for words, plane, delta_v in zip(record["candidates"], record["b_plane"], record["delta_v_m_s"], strict=True):
        place = ["-" if plane[key] is None else f"{plane[key] / 1e3:.3f}" for key in ("b_t_m", "b_r_m")]
        speed = "bound" if plane["v_infinity_m_s"] is None else f"{plane['v_infinity_m_s']:.4g}"
        table.add_row(escape(words), *place, speed, f"{delta_v:.2f}")
    table.caption = "B-plane of the two-body orbit at the release, pole: z of the ecliptic"
    return table


def certainty_table(record: dict[str, Any]) -> Table:
    """What probabilities cost in spacecraft, and what flights with other seeds say of the promise."""
    table = Table(title="Cost of certainty", title_justify="left")
    for heading in ("asked for", "observers", "at least", "promised (95 %)", "candidates"):
        table.add_column(escape(heading), justify="left" if heading == "candidates" else "right")
    for level in record["certainty"]:
        promised = "-" if level["promised"] is None else f"{level['promised']:.4f}"
        if record["realisations"] and level["low"] is not None:
            promised += f" ({level['low']:.4f} to {level['high']:.4f})"
        count = "none found" if level["n_observers"] is None else str(level["n_observers"])
        table.add_row(
            f"{level['probability']:g}", count, str(level["lower_bound"]), promised, _numbers(level["candidates"])
        )
    nominal = record["nominal_minimum"]
    table.caption = f"{'-' if nominal is None else _observers(nominal)} where nothing happens{verified_words(record)}"
    return table


def verified_words(record: dict[str, Any]) -> str:
    """What a campaign of the design says of the promise; empty where none was flown."""
    if (flown := record.get("verified")) is None:
        return ""
    failed = f", {flown['failed']} failed" if flown["failed"] else ""
    return (
        f". {flown['covered']} of {flown['flights']} flights with other seeds saw enough{failed}: "
        f"{flown['covered'] / flown['flights']:.4f} ({flown['low']:.4f} to {flown['high']:.4f}), the promise of "
        f"{flown['promised']:.4f} lies {'inside' if flown['inside'] else 'outside'}"
    )


def growth_table(compared: pd.DataFrame) -> Table:
    """The proven minimum under each extension, see `Design.compared`."""
    table = Table(title="Beyond the paper: the proven minimum", title_justify="left")
    for heading in ("change", "observers", "points, or why not"):
        table.add_column(heading, justify="right" if heading == "observers" else "left")
    for change, row in compared.iterrows():
        count = "-" if pd.isna(row["observers"]) else str(row["observers"])
        table.add_row(escape(str(change)), count, escape(row["points_or_why_not"]))
    return table


def _observers(count: int) -> str:
    return f"{count} observer" if count == 1 else f"{count} observers"


def _numbers(points: Sequence[int]) -> str:
    return " ".join(map(str, points))
