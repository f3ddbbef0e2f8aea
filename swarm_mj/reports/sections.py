"""The parts of the page that are text: outcome, spacecraft, design, parameters, versions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel

from swarm_mj.figures.palette import MODE_STYLES
from swarm_mj.figures.units import instant, time_axis
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.coverage import percent_digits, percent_text, rounded_up_digits
from swarm_mj.records.findings import findings, proof_differences
from swarm_mj.records.modes import runs
from swarm_mj.records.observed import causes_text, mapped_texts
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports.markup import Content, Html, join, table, tag
from swarm_mj.scenarios.itinerary import target_name
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.shape_check import shown_size

#: Of more spacecraft the page does not tell how each passed.
MAX_PASSAGES = 12
#: Phase angles of a passage that it tells, by their keys in the summary.
PHASES = {"start": "at first", "closest": "then", "end": "in the end"}

P_TO = Html("observed area P<sub>TO</sub>")
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
CRITERION = {"passage": "in the whole passage", "arrival": "at the instant of the arrival"}
#: Axes of the angles, in words.
ORBIT_AXES = {"ecliptic": "of the ecliptic", "equatorial": "of EME2000", "body_equator": "of the body's equator"}


def section(name: str, title: str, *content: Content) -> Html:
    """A part of the page with a heading that links can point to."""
    return tag("section", tag("h2", title, id=f"{name}-title"), *content, id=name, aria_labelledby=f"{name}-title")


def summary_section(run: RunRecord) -> Html:
    """The numbers a reader asks for first, and what to know before believing them."""
    summary = run.summary
    late = summary["pointing_error_deg_before_switch"]
    lost = f", {len(summary['lost'])} lost by the end" if summary.get("lost") else ""
    size = shown_size(1e6 * summary["target_area_km2"], 2).replace("^2", "²")
    numbers = [
        (P_TO, percent_text(summary["coverage_percent"]), _criterion(summary)),
        *_planned(summary),
        *_delivered(summary),
        ("observed, whole passage", percent_text(summary["coverage_percent_passage"]), f"{summary['images']} pictures"),
        *((label, share, "by geometry and light of its looks") for label, share in mapped_texts(summary).items()),
        *_sampled(summary),
        *_blurred(summary),
        ("spacecraft", str(summary["spacecraft"]), f"{summary['observers']} of them observe{lost}"),
        _pointed(summary),
        *_navigated(summary),
        ("pointing error before a switch", f"{short(max(late.values()))}°" if late else "–", "largest of the swarm"),
        ("fastest wheel", f"{100 * summary['max_wheel_speed_fraction']:.0f} %", "of its limit"),
        ("links closed at the end", f"{summary['links_closed_final']} of {summary['spacecraft']}", "spacecraft"),
        ("deployment Δv, at most", f"{max(summary['deployment_delta_v_m_s'].values()):.2f} m/s", "of one spacecraft"),
        ("target", size, ", ".join(filter(None, (summary.get("target"), f"{summary['target_faces']} faces")))),
    ]
    cards = [tag("div", tag("dt", name), tag("dd", value, tag("small", note))) for name, value, note in numbers]
    return section("summary", "Summary", tag("dl", cards, class_="numbers"), findings_list(run))


def _criterion(summary: dict[str, Any]) -> str:
    """What counts, and of what does not the cause."""
    light = ", light ignored" if summary.get("light") == "ignored" else ", sunlit"
    missing = causes_text(summary)
    light += ", by weighted area" if summary.get("weighted") else ""
    return CRITERION[summary["criterion"]] + light + (f"; not observed: {missing}" if missing else "")


def _planned(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """What the plan of pictures shows, and at most could show, where there is one."""
    plan = summary.get("picture_plan")
    if plan is None:
        return []
    bound = "proven best" if plan["proven"] else f"at most {plan['bound_percent']:.2f} % possible"
    taken = f"; {plan['as_planned']} of {plan['taken']} pictures as planned" if plan.get("taken") is not None else ""
    return [("planned by its plan of pictures", percent_text(plan["planned_percent"]), bound + taken)]


def _delivered(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """What of the target reaches Earth, and when the last of it, where that was computed."""
    percent, full = summary.get("delivered_percent"), summary.get("time_to_all_data_s")
    if percent is None:
        return []
    missing = f"{rounded_up_digits(summary['coverage_percent'] - percent)} % stays out there"
    cards = [("delivered to Earth", percent_text(percent), missing if full is None else "all that was seen")]
    if full is not None:
        name = "all that was seen on Earth" if summary.get("time_to_full_map_s") is None else "map complete on Earth"
        cards.append((name, f"t = {instant(full, time_axis(full))}", "by what the swarm runs alone"))
    return cards


def _sampled(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Ground sampling distance and light of what was seen, and of what arrives."""
    seen, sent, light = (summary.get(key) for key in ("gsd_m", "gsd_delivered_m", "incidence_deg"))
    if not seen:
        return []
    note = f"{short(seen['min'])} to {short(seen['max'])} m"
    note += f"; delivered {short(sent['median'])} m, to {short(sent['max'])} m" if sent else ""
    note += f"; sunlight at {short(light['median'])}°, to {short(light['max'])}°" if light else ""
    return [("ground sampling distance, median", f"{short(seen['median'])} m", note)]


def _blurred(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """How far faces moved over the detector at the arrival, where the camera has an exposure."""
    blur = summary.get("motion_blur_px_arrival")
    if not blur:
        return [] if blur is None else [("motion blur", "–", "no picture at the arrival")]
    return [("motion blur", f"{short(blur['median'])} px", f"median at the arrival; worst {short(blur['max'])} px")]


def _pointed(summary: dict[str, Any]) -> tuple[str, str, str]:
    """The largest pointing error at the arrival, and what sensors know the attitude by, and how well."""
    error, known = (summary.get(f"{key}_deg_arrival") for key in ("pointing_error", "attitude_knowledge_error"))
    error, known = (f"{short(max(found.values()))}°" if found else "" for found in (error, known))
    note = f"sensors: {summary.get('sensors', '–')}" + (f", which know it to {known}" if known else "")
    return "pointing error at the arrival", error or "–", note


def _navigated(summary: dict[str, Any]) -> list[tuple[str, str, str]]:
    """By how much positions were known wrongly at the arrivals, where they come from pictures."""
    told = summary.get("optical")
    if told is None:
        return []
    error, sigma = (max(told[f"position_{what}_m_arrival"].values()) for what in ("error", "3_sigma"))
    used, missed = sum(told["used"].values()), sum(one["count"] for one in told["not_used"])
    note = f"at the arrivals, worst; 3 sigma up to {short(sigma)} m; {used} of {used + missed} measurements used"
    return [("position by pictures, error", f"{short(error)} m", note)]


def findings_list(run: RunRecord) -> Html | None:
    """What limits the trust in a run's numbers."""
    found = [tag("li", text) for text in findings(run)]
    return tag("ul", found, class_="remarks") if found else None


def spacecraft_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    """A table of the spacecraft of each run."""
    return section("spacecraft", "Spacecraft", [_spacecraft_table(*pair) for pair in zip(runs, labels, strict=True)])


def _spacecraft_table(run: RunRecord, label: str) -> Html:
    summary = run.summary
    head = (
        "spacecraft", "sent to", "Δv [m/s]", "closest to centre [km]", "observed [%]", "error before switch [deg]",
        "error at end [deg]", "wheels at limit [s]", "link closed [%]", "turns",
    )  # fmt: skip
    rows = []
    for j, name in enumerate(run.names):
        before, lost_at = summary["pointing_error_deg_before_switch"].get(name), run.lost_at(j)
        rows.append(
            (
                name,
                run.role(j) + ("" if lost_at is None else f"; lost at {lost_at:g} s"),
                f"{summary['deployment_delta_v_m_s'][name]:.2f}",
                f"{summary['least_distance_to_centre_km'][name]:.4g}",
                percent_digits(summary["coverage_percent_by_spacecraft"][name]) if j < run.n_observers else "–",
                "–" if before is None else short(before),
                short(summary["pointing_error_deg_final"][name]) if lost_at is None else "lost",
                f"{summary['wheel_saturation_s'][name]:g}",
                f"{summary['link_closed_percent'][name]:.1f}",
                _target_changes(run, j),
            )
        )
    return table(head, rows, caption=f"Spacecraft of {label}", class_="numeric crew")


def _target_changes(record: RunRecord, j: int) -> str:
    """When spacecraft j chose another target, or was lost, and what came then, in words; the first three."""
    changes = runs(record.telemetry, j)[1:]
    words = []
    for change in changes[:3]:
        whom = int(record.telemetry["tracked_spacecraft"].values[np.searchsorted(record.times, change.start), j])
        by_name = change.mode == TargetKind.SPACECRAFT and whom >= 0
        followed = f" with {record.names[whom]}" if by_name else ""
        words.append(f"{change.start:g} s: {MODE_STYLES[change.mode].meaning}{followed}")
    return "; ".join([*words, f"{len(changes) - 3} more"] if len(changes) > 3 else words) or "none"


def design_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    """Who visits which point, and why no smaller swarm would do."""
    parts = []
    for run, label in zip(runs, labels, strict=True):
        orbit = None if run.scenario.initial_states else _mothership_orbit(run.summary)
        parts += [tag("h3", label) if len(runs) > 1 else None, orbit, _design(run)]
    return section("design", "Design", parts)


def _design(run: RunRecord) -> Html:
    design = run.scenario.design
    if run.scenario.initial_states:
        told = list(run.summary["encounters"].items())[:MAX_PASSAGES]
        return tag(
            "p", "On their way at the epoch, without mothership and design: ", "; ".join(map(_passage, told)), "."
        )
    points = ", ".join(map(str, design.visiting_points))
    words = (
        f"{len(design.visiting_points)} observers visit the points {points} of the target's "
        f"{run.summary['target_vertices']}, {design.imaging_altitude_m / 1e3:g} km above them, "
        f"{design.time_of_flight_s:g} s after deployment."
    )
    if stops := run.summary.get("itinerary"):
        words = f"{len(stops)} observers: " + "; ".join(
            f"{name} visits point {stop['point']} of target {target_name(stop['target'])}, "
            f"{stop['altitude_m'] / 1e3:g} km above it, "
            f"{stop['time_of_flight_s']:g} s after its release at {stop['release_s']:g} s"
            for name, stop in stops.items()
        )
        if shares := run.summary.get("coverage_percent_by_target"):
            words += ". Observed of each target: " + ", ".join(
                f"{target_name(k)} {percent_text(share)}" for k, share in enumerate(shares)
            )
        words += "."
    if run.design is None or "proof" not in run.design:
        why = "These points were given; the run has no record of a design with a proof. The fewest are found by "
        return join([tag("p", words), tag("p", why, tag("code", "swarm-mj design"), ".")])
    return join([tag("p", words), _proof(run, run.design)])


def _passage(told: tuple[str, dict[str, Any]]) -> str:
    name, how = told
    phases = (f"{how[f'phase_{when}_deg']:.1f} deg {words}" for when, words in PHASES.items())
    return (
        f"{name} is nearest to the body's centre at {how['closest_approach_s']:g} s, {_km(how['distance_m'])} away, at "
        f"{_speed(how['speed_m_s'])}; its phase angle is {', '.join(phases)}"
    )


def _proof(run: RunRecord, record: dict[str, Any]) -> Html:
    proof, other = record["proof"], proof_differences(run)
    each = f", each face by at least {record['fold']}," if record["fold"] > 1 else ""
    task = (
        f"{100 - record['tolerance_percent']:g} % of the target's area{each} from any of the {record['candidates_count']} "
        "candidate points"
    )
    if proof["status"] == "optimal":
        proven = "Proven for what the design was made for" if other else "Proven"
        words = f"{proven}: fewer than {proof['minimum']} observers cannot see {task}."
    elif proof["status"] == "interrupted":
        words = f"Not proven to be the fewest that see {task}: the design was interrupted."
    else:
        words = f"Not proven to be the fewest: at least {proof['lower_bound']:g} observers are needed to see {task}."
    names = {"repair": "genetic algorithm with repair", "plain": "genetic algorithm"}
    first = "best so far" if proof["status"] == "interrupted" else "exact solver"
    rows = [_method(first, proof, proof["minimum"], proof["visiting_points"], "–")]
    for name, found in record["genetic"].items():
        explored = f"{found['designs_explored']:,}"
        rows.append(_method(names.get(name, name), found, found["n_observers"], found["gene_map"][1:], explored))
    head = ("method", "observers", Html("P<sub>TO</sub> [%]"), "points", "designs explored", "time [s]")
    flown = f"Flown: the design of the {record['selected_by']}."
    warning = (
        f"The proof does not hold for this run, which differs from what the design was made for: {'; '.join(other)}."
    )
    return join(
        [
            tag("p", warning, class_="warning") if other else None,
            tag("p", tag("strong", words), " ", flown),
            table(head, rows, caption="How the design was found", class_="numeric method"),
        ]
    )


def _method(name: str, found: dict[str, Any], n: int, points: Sequence[int], explored: str) -> tuple[str, ...]:
    """The row of a way to find designs."""
    return (
        name,
        str(n),
        percent_digits(found["covered_percent"]),
        " ".join(map(str, points)),
        explored,
        f"{found['seconds']:.2f}",
    )


def flat_parameters(scenario: Scenario) -> dict[str, Any]:
    """Every parameter by its dotted key."""
    flat: dict[str, Any] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, dict) and value:
            for key, child in value.items():
                walk(f"{prefix}.{key}" if prefix else str(key), child)
        else:
            flat[prefix] = value

    walk("", scenario.model_dump(mode="json"))
    return flat


def parameters_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    """All parameters, by section; of two runs, those that differ first of all."""
    flats = [flat_parameters(run.scenario) for run in runs]
    keys = list(dict.fromkeys(key for flat in flats for key in flat))
    if len(runs) == 1:
        return section("parameters", "Parameters", _grouped(keys, flats[0]), _versions(runs, labels))
    differing = [key for key in keys if flats[0].get(key) != flats[1].get(key)]
    rows = [(key, *(_value(flat.get(key)) for flat in flats)) for key in keys]
    classes = ["differs" if key in differing else "same" for key in keys]
    box = tag("input", type="checkbox", id="only-differences", checked=True)
    return section(
        "parameters",
        "Parameters",
        tag("p", f"{len(differing)} of {len(keys)} parameters differ. ", tag("label", box, " show only these")),
        table(("parameter", *labels), rows, caption="Parameters of the scenarios as flown", row_classes=classes),
        _versions(runs, labels),
    )


def _grouped(keys: Sequence[str], flat: dict[str, Any]) -> list[Html]:
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for key in keys:
        name = key.split(".")[0] if "." in key else "scenario"
        groups.setdefault(name, []).append((key, _value(flat[key]), meaning(key)))
    head = ("parameter", "value", "meaning")
    return [
        tag("details", tag("summary", name), table(head, rows, caption=f"Parameters of {name}"))
        for name, rows in groups.items()
    ]


def meaning(key: str) -> str:
    """What the schema says of a parameter."""
    model: type[BaseModel] | None = Scenario
    words = ""
    for part in key.split("."):
        field = model.model_fields.get(part) if model else None
        if field is None:
            return words
        words = field.description or ""
        inner = field.annotation
        model = inner if isinstance(inner, type) and issubclass(inner, BaseModel) else None
    return words


def _versions(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    libraries = list(dict.fromkeys(name for run in runs for name in run.summary["versions"]))
    rows = [(name, *(run.summary["versions"].get(name, "–") for run in runs)) for name in libraries]
    classes = ["differs" if len(set(row[1:])) > 1 else None for row in rows]
    content = table(
        ("program or library", *labels), rows, caption="Versions that made the numbers", row_classes=classes
    )
    return tag("details", tag("summary", "versions"), content, open=len(runs) > 1)


def _value(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return str(value) if value != {} else "none"


def short(value: float) -> str:
    """A number of any size as the page's script writes it: 3 digits, below 0.01 two and a power of ten, like 1.2·10⁻⁵."""
    if value == 0.0 or abs(value) >= 0.01:
        return f"{float(f'{value:.3g}'):.15g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(SUPERSCRIPT)}"


#: What is said of a hyperbola; a run lacks what has no finite value.
OF_HYPERBOLA = {
    "axes", "v_infinity_m_s", "v_infinity_longitude_deg", "v_infinity_latitude_deg", "closest_approach_s",
    "periapsis_radius_m", "turn_angle_deg",
}  # fmt: skip


def _mothership_orbit(summary: dict[str, Any]) -> Html | None:
    """How the mothership comes, a paragraph; None where the run does not tell."""
    way = summary.get("mothership") or {}
    if not way:
        return None
    words = f"The mothership begins {_km(way['distance_m'])} from the centre, at {_speed(way['speed_m_s'])}. "
    told = {key for key, value in way.items() if value is not None}
    if way.get("orbit") == "hyperbola":
        words += _hyperbola(way) if told >= OF_HYPERBOLA else ""
    elif way.get("orbit") == "radial":
        if "apoapsis_radius_m" in told:
            words += f"It rises or falls straight, osculating then, to {_km(way['apoapsis_radius_m'])} from the centre at most."
    elif told >= {"orbit", "eccentricity", "periapsis_radius_m"}:
        words += (
            f"Its orbit, osculating then, is {'a' if way['orbit'] == 'parabola' else 'an'} {way['orbit']} of eccentricity "
            f"{way['eccentricity']:.4g} with periapsis {_km(way['periapsis_radius_m'])} from the centre."
        )
    return join([tag("p", words)])


def _hyperbola(way: dict[str, Any]) -> str:
    axes = ORBIT_AXES.get(way["axes"], way["axes"])
    b = [_km(way[key]) for key in ("b_t_m", "b_r_m") if way.get(key) is not None]
    b_plane = f", B·T = {b[0]} and B·R = {b[1]}" if len(b) == 2 else ""
    late = way["closest_approach_s"]
    when = f"{abs(late):,.5g} s {'after' if late >= 0.0 else 'before'} the epoch"
    return (
        f"Its orbit, osculating then, is a hyperbola: v∞ = {_speed(way['v_infinity_m_s'])} towards longitude "
        f"{way['v_infinity_longitude_deg']:.2f}°, latitude {way['v_infinity_latitude_deg']:.2f}° in the axes {axes}{b_plane}; "
        f"periapsis {_km(way['periapsis_radius_m'])} from the centre, {when}; the body turns the velocity by "
        f"{way['turn_angle_deg']:.3g}°."
    )


def _km(metres: float) -> str:
    return f"{metres / 1e3:,.5g} km"


def _speed(metres_per_second: float) -> str:
    return f"{metres_per_second:,.4g} m/s" if metres_per_second < 1e3 else f"{metres_per_second / 1e3:.4g} km/s"


def propulsion_section(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html | None:
    """What thrusters gave and tanks have left; None where no run has thrusters."""
    tables = [_propulsion_table(run, label) for run, label in zip(runs, labels, strict=True) if has_thrusters(run)]
    return section("propulsion", "Propulsion", tables) if tables else None


def has_thrusters(run: RunRecord) -> bool:
    """Whether a run's spacecraft have thrusters."""
    return bool(run.summary.get("propellant_used_kg"))


def _propulsion_table(run: RunRecord, label: str) -> Html:
    keys = {"planned_burns_m_s": 1.0, "thrust_delta_v_m_s": 1.0, "propellant_used_kg": 1e3, "propellant_left_kg": 1e3}
    columns = [(run.summary.get(key, {}), factor) for key, factor in keys.items()]
    rows = [
        (name, *(short(factor * values[name]) if name in values else "–" for values, factor in columns))
        for name in run.names
    ]
    head = ("spacecraft", "planned burns [m/s]", "Δv by thrust [m/s]", "propellant used [g]", "propellant left [g]")
    return table(head, rows, caption=f"Thrusters and tanks of {label}", class_="numeric crew")
