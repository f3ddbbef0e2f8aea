"""The report of a study: one HTML page that fetches nothing."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from swarm_mj.reports.markup import Content, Html, document, table, tag

#: No script, and nothing from elsewhere.
POLICY = "default-src 'none'; style-src 'unsafe-inline'"
#: Of drawings: pixels a metre, and the edge around.
SCALE, EDGE = 700.0, 30.0
#: Of bars beside their names: height of a row, widths of both.
ROW, NAMES, BARS = 26.0, 190.0, 420.0
#: What Sobol' indices are of.
OUTCOME_WORDS = {
    "can_be_built": "whether a spacecraft can be built",
    "observers": "least number of observers of the lightest swarm",
    "swarm_kg": "least mass of the lightest swarm",
    "send_h": "time in which its pictures are sent, as sized",
}


def study_html(
    name: str, told: Mapping[str, Any], record: Mapping[str, Any], sentences: list[str], there: Mapping[str, str]
) -> str:
    """The page of a study.

    Args:
        name: The requirement's.
        told: Its id, version, date and requirement.
        record: What came out, see `knowledge.record_of`.
        sentences: What it came to in words.
        there: Files beside the page that show what checks name, by the name of their folder.
    """
    facts = f"study {told['id']} by swarm_mj {told['version']}, scenario {told['requirement']['scenario']}"
    parts = [
        _outcome(sentences),
        _relaxed(told["requirement"], record),
        _checks(record, there),
        _spacecraft(record),
        _swarm(record, there),
        _drivers(record),
        _sobol(record),
        _front(record),
        _tried(record),
    ]
    top = tag("header", tag("div", tag("h1", name), tag("p", facts, class_="soft")))
    body = [top, tag("main", [part for part in parts if part is not None], _asked(told["requirement"]))]
    return document(f"swarm_mj: {name}", POLICY, body)


def _section(title: str, *content: Content) -> Html:
    return tag("section", tag("h2", title), *content)


def _svg(shapes: Content, width: float, height: float, words: str) -> Html:
    """A drawing that is as wide as the page at the most; `words` tell it to those who do not see it."""
    view, style = f"0 0 {width:.0f} {height:.0f}", f"max-width:{width:.0f}px"
    return tag("svg", shapes, viewBox=view, width="100%", style=style, role="img", aria_label=words)


def _outcome(sentences: list[str]) -> Html:
    return _section("What it came to", [tag("p", words) for words in sentences])


def _relaxed(requirement: Mapping[str, Any], record: Mapping[str, Any]) -> Html | None:
    """Ways out of a requirement that cannot be met."""
    rows = []
    for way in record["relaxed"]:
        asked = []
        for key in way:
            section, _, inner = key.rpartition(".")
            asked.append(str((requirement[section] if section else requirement)[inner]))
        rows.append((", ".join(way), ", ".join(asked), ", ".join(_number(value) for value in way.values())))
    caption = "Each row alone; these conditions are necessary, not sufficient"
    return (
        _section("What it would take", table(("value", "asked", "it takes"), rows, caption=caption)) if rows else None
    )


def _number(value: Any, digits: int = 4) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}g}" if isinstance(value, float) and isfinite(value) else str(value)


def _checks(record: Mapping[str, Any], there: Mapping[str, str]) -> Html | None:
    if not record["checks"]:
        return None
    rows = []
    for c in record["checks"]:
        asked, reached = c["asked"], c["reached"]
        margin = f"{100.0 * abs(reached - asked) / asked:,.0f} %" if asked and isfinite(reached) else "-"
        evidence = tag("a", c["evidence"], href=there[c["shown"]]) if c["shown"] in there else c["evidence"]
        met = "met" if c["met"] else "NOT MET"
        rows.append((c["requirement"], _number(asked), _number(reached), c["unit"], met, margin, evidence))
    head = ("", "asked", "reached", "unit", "", "margin", "evidence")
    return _section("Requirement by requirement", table(head, rows, caption="As flown and as budgeted"))


def _spacecraft(record: Mapping[str, Any]) -> Html | None:
    sized = record["spacecraft"]
    if sized is None:
        return None
    rows: list[tuple[str, ...]] = [
        (
            p["name"],
            _number(p["number"]),
            _number(p["mass_kg"]),
            _number(p["volume_u"]),
            _number(p["power_w"]),
            p["source"],
        )
        for p in sized["parts"]
    ]
    whole = _number(sized["mass_kg"]), _number(sized["volume_u"]), _number(sized["power_w"])
    rows.append(("with margins; power in the mean of a day", "", *whole, f"panels give {sized['panels_give_w']:.3g} W"))
    head = ("part", "number", "mass [kg]", "volume [U]", "power [W]", "source")
    budgets = table(head, rows, caption="Budgets, each part without margin")
    modes = [
        tuple(_number(value) if key != "name" else value for key, value in mode.items()) for mode in sized["modes"]
    ]
    columns = ("mode", "time [h]", "draws [W]", "panels give [W]", "batteries give [Wh]")
    times = table(columns, modes, caption="Modes, with margin")
    lens = sized["camera"]
    facts = (
        f"Camera: lens of {1e3 * lens['aperture_m']:.3g} mm, f = {1e3 * lens['focal_length_m']:.3g} mm "
        f"(f/{lens['f_number']:.2g}), pixels of {1e6 * lens['pixel_rad']:.3g} urad, half-angle "
        f"{lens['half_angle_deg']:.3g} deg, "
        f"exposures up to {lens['exposure_s']:.2g} s."
    )
    return _section(f"The spacecraft: {sized['kind']}", _drawing(sized), tag("p", facts), budgets, times)


def _swarm(record: Mapping[str, Any], there: Mapping[str, str]) -> Html | None:
    if record["scenario"] is None:
        return None
    design, idle = record["scenario"]["design"], record["spacecraft_count"] - record["observers"]
    facts = [
        ("observers", record["observers"]),
        ("spacecraft that only communicate", idle),
        ("mass of all [kg]", _number(record["swarm_kg"])),
        ("visiting points", ", ".join(map(str, design["visiting_points"]))),
        ("imaging altitude [m]", f"{design['imaging_altitude_m']:,.0f}"),
        ("time of flight from the release [s]", f"{design['time_of_flight_s']:,.0f}"),
    ]
    if "flight" in there:
        facts.append(("its flight", tag("a", "report with pictures and paths", href=there["flight"])))
    return _section("The swarm", table(("", ""), facts, caption="As designed and flown"))


def _drawing(sized: Mapping[str, Any]) -> Html:
    """The spacecraft to scale: the face with the lens, and a side with the optics inside and the panels deployed."""
    (a, b, c), panels = sized["size_m"], sized["panels"]
    lens, long = sized["camera"]["aperture_m"], sized["camera"]["length_m"]
    line = {"fill": "none", "stroke": "currentColor", "stroke_width": 1.5}

    def box(x: float, y: float, wide: float, high: float, **more: Any) -> Html:
        return tag("rect", x=x, y=y, width=SCALE * wide, height=SCALE * high, **{**line, **more})

    shapes, wing = [], 0.1 * SCALE
    aside = (panels + 1) // 2
    left = EDGE + wing * aside
    shapes += [box(EDGE + wing * k, EDGE, 0.1, 0.3, fill="#56b4e9", fill_opacity=0.35) for k in range(aside)]
    shapes.append(box(left, EDGE, b, c))
    shapes += [
        box(left + SCALE * b + wing * k, EDGE, 0.1, 0.3, fill="#56b4e9", fill_opacity=0.35)
        for k in range(panels - aside)
    ]
    # The camera looks downwards out of the lower face.
    shapes.append(
        box(left + 0.5 * SCALE * (b - lens), EDGE + SCALE * (c - long), lens, long, fill="#e69f00", fill_opacity=0.4)
    )
    face = left + SCALE * b + wing * (panels - aside) + 2 * EDGE
    shapes.append(box(face, EDGE, b, a))
    middle = {"cx": face + 0.5 * SCALE * b, "cy": EDGE + 0.5 * SCALE * a, "r": 0.5 * SCALE * lens}
    shapes.append(tag("circle", **{**line, **middle, "fill": "#e69f00", "fill_opacity": 0.4}))
    foot = EDGE + SCALE * c + 20.0
    shapes.append(tag("line", x1=EDGE, y1=foot, x2=EDGE + 0.1 * SCALE, y2=foot, stroke="currentColor", stroke_width=2))
    words = "10 cm; blue: panels, orange: optics; right: the face with the lens"
    shapes.append(tag("text", words, x=EDGE + 0.1 * SCALE + 8, y=foot + 5, fill="currentColor", font_size=14))
    width, height = max(face + SCALE * b, EDGE + 0.1 * SCALE + 480.0) + EDGE, foot + EDGE
    return _svg(shapes, width, height, words)


def _drivers(record: Mapping[str, Any]) -> Html | None:
    rows = record.get("drivers") or []
    known = [mass for one in rows for mass in (one["lower_kg"], one["higher_kg"]) if mass is not None]
    if not known:
        return None
    low, high, now = min(known), max(known), record["least_kg"]
    span, step, names, bars = max(high - low, 1e-9), ROW, NAMES, BARS
    shapes: list[Content] = []

    def at(mass: float) -> float:
        return names + 60.0 + bars * (mass - low) / span

    for k, one in enumerate(rows):
        y = 20.0 + step * k
        shapes.append(tag("text", one["key"], x=0, y=y + 5, fill="currentColor", font_size=14))
        for value, mass, colour, side in (
            (one["lower"], one["lower_kg"], "#0072b2", "lower"),
            (one["higher"], one["higher_kg"], "#e69f00", "higher"),
        ):
            if mass is None:
                where = names + (0.0 if side == "lower" else bars + 130.0)
                shapes.append(tag("text", f"{value:.3g}: none", x=where, y=y + 5, fill=colour, font_size=12))
            elif now is not None:
                first, last = sorted((at(mass), at(now)))
                shapes.append(
                    tag("rect", x=first, y=y - 7, width=max(last - first, 1.5), height=14, fill=colour, opacity=0.8)
                )
    foot = 20.0 + step * len(rows)
    ticks = [(low, at(low))] if span < 1e-6 else [(low, at(low)), (high, at(high))]
    shapes += [
        tag("text", f"{mass:.3g} kg", x=x - 20, y=foot + 8, fill="currentColor", font_size=13) for mass, x in ticks
    ]
    words = "Lower bound of the swarm's mass when each value alone is 1.2 times less (blue) or more (orange)"
    width = names + bars + 220.0
    drawn = _svg(shapes, width, foot + 20.0, words)
    return _section("Which requirement drives", tag("p", words), drawn)


def _sobol(record: Mapping[str, Any]) -> Html | None:
    rows = record.get("sobol") or []
    if not rows:
        return None
    step, names, bars = ROW, NAMES, BARS
    drawings: list[Content] = []
    for outcome in dict.fromkeys(row["outcome"] for row in rows):
        shapes: list[Content] = []
        found = sorted((row for row in rows if row["outcome"] == outcome), key=lambda row: -row["total"])
        for k, row in enumerate(found):
            y = 20.0 + step * k
            shapes.append(tag("text", row["key"], x=0, y=y + 5, fill="currentColor", font_size=14))
            for index, colour, up in (("first", "#0072b2", -4.0), ("total", "#e69f00", 4.0)):
                wide = bars * min(max(row[index], 0.0), 1.0)
                shapes.append(tag("rect", x=names, y=y + up - 3, width=max(wide, 1.5), height=7, fill=colour))
                low, high = (names + bars * min(max(row[f"{index}_{end}"], 0.0), 1.0) for end in ("low", "high"))
                shapes.append(tag("line", x1=low, x2=high, y1=y + up, y2=y + up, stroke="currentColor"))
        foot = 20.0 + step * len(found)
        shapes += [
            tag("text", f"{share:g}", x=names + bars * share - 5, y=foot + 8, fill="currentColor", font_size=13)
            for share in (0.0, 0.5, 1.0)
        ]
        drawings.append(tag("h3", OUTCOME_WORDS[outcome]))
        drawings.append(_svg(shapes, names + bars + 30.0, foot + 20.0, OUTCOME_WORDS[outcome]))
    words = (
        "Sobol' indices: the share of the variance by each value alone (blue) and with its interactions (orange), lines: 95 % "
        "intervals; all values at once and evenly between 1.2 times less and more, by bounds: nothing is flown"
    )
    return _section("What drives, all at once", tag("p", words), drawings)


def _front(record: Mapping[str, Any]) -> Html | None:
    rows = [
        (one["kind"], *(_number(one[key]) for key in ("resolution_m", "mass_kg", "power_w", "send_h", "least_kg")))
        for one in record.get("alternatives") or []
    ]
    head = ("kind", "samples [m]", "mass [kg]", "power [W]", "sent within, as sized [h]", "swarm at least [kg]")
    caption = (
        "Spacecraft for half to twice the resolution that is asked for, with other cameras; no other one is better in "
        "resolution, masses, power and time; sized for the fewest pictures, not flown"
    )
    return _section("Alternatives", table(head, rows, caption=caption)) if rows else None


def _tried(record: Mapping[str, Any]) -> Html:
    rows = [(one["kind"], _number(one["mass_kg"]), _number(one["least_kg"]), one["words"]) for one in record["tried"]]
    head = ("kind", "mass [kg]", "swarm at least [kg]", "what was found")
    return _section("Kinds of spacecraft", table(head, rows, caption="In the order in which they were judged"))


def _asked(requirement: Mapping[str, Any]) -> Html:
    rows = []
    for key, value in requirement.items():
        if isinstance(value, dict) and key != "changes":
            rows += [(f"{key}.{name}", str(inner)) for name, inner in value.items()]
        else:
            rows.append((key, str(value)))
    return _section("The requirement", table(("key", "value"), rows, caption="With defaults"))
