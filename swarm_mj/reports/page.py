"""The page: everything that a report shows, in one HTML file that fetches nothing.

plotly's own script is part of the file, compressed, so that it opens without a network; a content security policy forbids
every connection.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import plotly
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from swarm_mj import __version__
from swarm_mj.errors import OutputError
from swarm_mj.figures.palette import GROUND, MODE_STYLES, ORANGE, SKY_BLUE
from swarm_mj.figures.units import note_of_omission, time_axis
from swarm_mj.io.atomic import write_text
from swarm_mj.io.records import writing
from swarm_mj.mission.behaviors import looks_at_body
from swarm_mj.observation.coverage import rounded_down
from swarm_mj.records.modes import LOST
from swarm_mj.records.run_record import RunRecord
from swarm_mj.reports import COMPARISON_NAME, REPORT_NAME
from swarm_mj.reports.compare import comparison_section
from swarm_mj.reports.delivery import box_id, delivery_figures, delivery_section
from swarm_mj.reports.globe import globe_figure, globe_id, globe_section
from swarm_mj.reports.markup import Content, Html, document, join, own, table, tag
from swarm_mj.reports.plots import INK, plot_run, plot_two
from swarm_mj.reports.replay import Limits, Replay, f32, make_replay, packed
from swarm_mj.reports.scene import MAX_NAMED, MAX_PATHS, in_the_dark, path_points, scene_figure
from swarm_mj.reports.sections import (
    design_section,
    has_thrusters,
    parameters_section,
    propulsion_section,
    section,
    spacecraft_section,
    summary_section,
)
from swarm_mj.scenarios.itinerary import last_arrival_s

#: Files of the page's own behaviour, in order.
SCRIPTS = ("mesh.js", "names.js", "scene.js", "page.js")
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)
#: Where plotly's script hands its outermost function over, and how that begins.
FUNCTION = "() => {"
HANDED_OVER = f"? self : this, {FUNCTION}"
#: How much faster than the flight the replay may run.
SPEEDS = (1, 10, 30, 60, 120, 300, 1000, 3000, 10000)
#: Axes of the 3-D picture, centred at the body; the first are chosen at first.
AXES = ("inertial", "body-fixed")
#: How long a whole replay takes at the speed chosen at first, about [s].
REPLAY_S = 30.0


def write_report(runs: Sequence[RunRecord], out: Path | None = None) -> Path:
    """Write the report of a run, or of two side by side.

    Args:
        runs: One or two runs, see `read_run`.
        out: Where to write it; by default report.html in the run's folder, or comparison.html in the first of two.

    Returns:
        The path of the file.

    Raises:
        OutputError: They are more than two, or the file cannot be written.
    """
    if not 1 <= len(runs) <= 2:
        raise OutputError(f"a report shows one run or two side by side, not {len(runs)}")
    path = out or runs[0].folder / (REPORT_NAME if len(runs) == 1 else COMPARISON_NAME)
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; --out must name a file")
    text = report_html(runs)
    with writing(path, "choose another file with --out"):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    return path


def report_html(runs: Sequence[RunRecord]) -> str:
    """The whole page of one run or two."""
    limits = Limits() if len(runs) == 1 else Limits(values=40_000, faces=10_000, spacecraft=400, rays=200_000)
    replays = [make_replay(run, limits) for run in runs]
    labels = _labels(runs)
    title = labels[0] if len(runs) == 1 else f"{labels[0]} and {labels[1]}"
    scripts = [own(name) for name in SCRIPTS]
    data = Html(safe_json(page_data(runs, replays, labels)))
    body = [
        _header(runs, labels),
        tag("main", _sections(runs, replays, labels)),
        _time_bar(runs),
        tag("script", data, type="application/json", id="report-data"),
        tag("script", Html(packed_plotly()), type="application/zlib", id="plotly"),
        [tag("script", Html(script)) for script in scripts],
    ]
    return document(f"swarm_mj: {title}", POLICY, body)


@cache
def packed_plotly() -> str:
    """The script of plotly, compressed (zlib) and in base64: the page is smaller by 40 % and ready sooner.

    Its outermost function gets parentheses. Browsers put off the parsing of a function that is only handed over, and so
    would parse nearly the whole script twice.
    """
    script = get_plotlyjs()
    start, end = script.find(HANDED_OVER), script.rfind("}));")
    if 0 <= start < end:
        head = start + len(HANDED_OVER) - len(FUNCTION)
        script = f"{script[:head]}({script[head : end + 1]}){script[end + 1 :]}"
    return base64.b64encode(zlib.compress(script.encode())).decode("ascii")


def _labels(runs: Sequence[RunRecord]) -> list[str]:
    """What to call the runs: by scenario, of two also by letter, and by folder if that does not tell them apart."""
    names = [str(run.summary["scenario"]) for run in runs]
    if len(runs) == 1:
        return names
    if names[0] == names[1]:
        names = [f"{name} ({run.folder.resolve().name})" for name, run in zip(names, runs, strict=True)]
    return [f"{letter}: {name}" for letter, name in zip("AB", names, strict=True)]


def _header(runs: Sequence[RunRecord], labels: Sequence[str]) -> Html:
    words: list[Content] = []
    for run, label in zip(runs, labels, strict=True):
        prefix = tag("strong", label, " ") if len(runs) > 1 else None
        words.append(tag("p", prefix, run.scenario.description))
        facts = f"{run.scenario.body.name}, epoch {run.scenario.epoch} TDB, seed {run.scenario.seed}"
        words.append(tag("p", facts, class_="soft"))
    known = any(run.delivery is not None for run in runs)
    pushed = ("propulsion",) if any(map(has_thrusters, runs)) else ()
    parts = (
        "summary",
        "replay",
        "map",
        *(("delivery",) if known else ()),
        "spacecraft",
        *pushed,
        "design",
        "parameters",
    )
    title = labels[0] if len(runs) == 1 else "Two runs side by side"
    theme = tag("button", "◐ Theme", id="theme", type="button", aria_label="Switch between light and dark")
    links = [tag("a", part.capitalize(), href=f"#{part}") for part in parts]
    missing = tag("p", "The replay and the plots need JavaScript; the tables do not.", class_="warning")
    top = tag("header", tag("div", tag("h1", title), words), theme)
    return join([top, tag("nav", links, aria_label="Parts of this page"), tag("noscript", missing)])


def _sections(runs: Sequence[RunRecord], replays: Sequence[Replay], labels: Sequence[str]) -> list[Html]:
    first = summary_section(runs[0]) if len(runs) == 1 else comparison_section(runs, labels)
    return [
        first,
        _replay_section(runs, replays, labels),
        globe_section(runs, labels),
        delivery_section(runs, labels) or Html(""),
        spacecraft_section(runs, labels),
        propulsion_section(runs, labels) or Html(""),
        design_section(runs, labels),
        parameters_section(runs, labels),
        tag("p", f"Written by swarm_mj {__version__}, drawn by plotly {plotly.__version__}.", class_="soft"),
    ]


def _replay_section(runs: Sequence[RunRecord], replays: Sequence[Replay], labels: Sequence[str]) -> Html:
    two = len(runs) > 1
    scenes = [_scene_box(k, *parts, two) for k, parts in enumerate(zip(replays, labels, strict=True))]
    words = "Pointing error, wheel speed, observed share and links over time"
    plots = [tag("div", id="plots", role="img", aria_label=words), tag("div", id="cursor", hidden=True)]
    now = [_now_table(*parts) for parts in zip(range(len(runs)), runs, replays, labels, strict=True)]
    columns = [tag("div", scenes, class_="scenes"), tag("div", plots, class_="plots")]
    stage = tag("div", columns, class_="stage two" if two else "stage")
    return section("replay", "Replay", _choices(runs), stage, tag("div", now, class_="nows"))


def _scene_box(number: int, replay: Replay, label: str, two: bool) -> Html:
    words = f"3-D replay of {label}. Arrow keys turn it, plus and minus zoom."
    role: dict[str, Any] = {"tabindex": 0, "role": "application", "aria_label": words, "data_scene": number}
    picture = tag("div", id=f"scene-{number}", class_="plot3d", **role)
    labels = tag("div", id=f"labels-{number}", class_="labels", aria_hidden="true")
    view = tag("div", picture, labels, class_="view3d")
    return tag("figure", tag("h3", label) if two else None, view, _camera_buttons(number), _key(replay))


CAMERA_VIEWS = (
    ("overview", "All", "Show the whole flight"),
    ("near", "Near", "Show the flight near the body"),
    ("swarm", "Swarm", "Show the target and the spacecraft where they are now"),
    ("target", "Target", "Look straight down on the target"),
    ("closer", "+", "Zoom in"),
    ("away", "−", "Zoom out"),
    ("left", "◂", "Turn left"),
    ("right", "▸", "Turn right"),
    ("up", "▴", "Turn up"),
    ("down", "▾", "Turn down"),
)


def _camera_buttons(number: int) -> Html:
    buttons = [
        tag("button", face, type="button", data_view=name, data_run=number, aria_label=words, title=words)
        for name, face, words in CAMERA_VIEWS
    ]
    return tag("div", buttons, class_="camera", role="group", aria_label="Camera")


def _key(replay: Replay) -> Html:
    entries = [(SKY_BLUE, "", "target, observed so far"), (ORANGE, "", "target, not yet observed")]
    entries += [(in_the_dark(GROUND), "", "night side; colours of the target are darker there")]
    entries += [
        (MODE_STYLES[m].line_colour, "line", f"{'' if m >= LOST else '+z: '}{MODE_STYLES[m].meaning}")
        for m in np.unique(replay.mode)
    ]
    spots = [tag("li", tag("i", class_=kind or None, style=f"--colour:{c}"), text) for c, kind, text in entries]
    return tag("ul", spots, class_="key", aria_label="Colours")


def _now_table(number: int, run: RunRecord, replay: Replay, label: str) -> Html:
    """The state at the instant shown; the script fills it."""
    head = ("spacecraft", "+z", "pointing error [deg]", "fastest wheel [rpm]", "link", "observed [%]")
    shown = replay.shown[replay.rows]
    caption = f"{label} at the time shown{note_of_omission(run.n, shown)}"
    rows = [(run.names[j], *[""] * 5) for j in shown]
    return table(head, rows, caption=caption, class_="numeric now", id_=f"now-{number}")


def _time_bar(runs: Sequence[RunRecord]) -> Html:
    duration = max(float(run.times[-1]) for run in runs)
    default = min(SPEEDS, key=lambda speed: abs(speed - duration / REPLAY_S))
    speeds = [tag("option", f"{s}×", value=s, selected=s == default) for s in SPEEDS]
    parts: list[Content] = [
        tag("button", tag("span", "►", class_="face", aria_hidden="true"), id="play", type="button", aria_label="Play"),
        tag("input", type="range", id="slider", min=0, max=1, value=0, step=1, aria_label="Time"),
        tag("output", id="clock", for_="slider"),
        tag("span", "observed ", tag("output", id="share", for_="slider")),
        tag("label", "speed ", tag("select", speeds, id="speed")),
    ]
    return tag("div", parts, class_="timebar", role="group", aria_label="Time of the replay")


def _choices(runs: Sequence[RunRecord]) -> Html:
    """What the replay shows besides the flight."""
    parts = [
        tag("label", tag("input", type="checkbox", id="views", checked=True), " borders of pictures"),
        tag("label", tag("input", type="checkbox", id="directions"), " Sun and Earth"),
        tag("label", "axes ", tag("select", [tag("option", word, value=word) for word in AXES], id="axes")),
    ]
    arrival = [run.scenario.observation.criterion == "arrival" for run in runs]
    if any(arrival):
        own = "at the arrival" if all(arrival) else "as each run counts"
        options = [tag("option", own, value="own"), tag("option", "in the whole passage", value="passage")]
        parts.append(tag("label", "faces count as observed ", tag("select", options, id="criterion")))
    return tag("div", parts, class_="choices")


def page_data(runs: Sequence[RunRecord], replays: Sequence[Replay], labels: Sequence[str]) -> dict[str, Any]:
    """What the page's script works with."""
    figure = plot_run(runs[0], replays[0]) if len(runs) == 1 else plot_two(runs, replays, labels)
    longest = max(float(run.times[-1]) for run in runs)
    modes = [
        {"meaning": style.meaning, "colour": style.line_colour, "observing": bool(looks_at_body(mode))}
        for mode, style in enumerate(MODE_STYLES)
    ]
    return {
        "ink": INK,
        "axis_seconds": time_axis(longest).seconds,
        "arrival_s": last_arrival_s(runs[0].scenario),
        "modes": modes,
        "plots": _plain(figure),
        "ways": {globe_id(k): _plain(globe_figure(run)) for k, run in enumerate(runs)}
        | {box_id(k, name): _plain(way) for k, run in enumerate(runs) for name, way in delivery_figures(run).items()},
        "runs": [_run_data(*pair) for pair in zip(runs, replays, strict=True)],
    }


def _run_data(run: RunRecord, replay: Replay) -> dict[str, Any]:
    scene = dict(replay.scene)
    kept = scene.pop("target_kept")
    scene["first_seen"] = packed(run.coverage["first_seen_s"][kept])
    scene["first_seen_passage"] = packed(run.coverage["first_seen_s_passage"][kept])
    shares = ("percent", "percent_passage", "percent_by", "percent_by_passage")
    return {
        "names": [run.names[j] for j in replay.shown],
        "body": run.scenario.body.name,
        "observers": int((replay.shown < run.n_observers).sum()),
        "rows": replay.rows.tolist(),
        "times": packed(replay.times),
        "pointing": f32(replay.pointing_deg),
        "wheel": f32(replay.wheel_rpm),
        "mode": packed(replay.mode),
        "link": packed(replay.link),
        **{name: f32(rounded_down(getattr(replay, name))) for name in shares},
        "path_points": path_points(len(replay.times)).tolist(),
        "max_paths": MAX_PATHS,
        "max_named": MAX_NAMED,
        "figure": _plain(scene_figure(run, replay)),
        "scene": scene,
    }


def _plain(figure: go.Figure) -> Any:
    figure.update_layout(template="none")
    return json.loads(figure.to_json())


def safe_json(data: Any) -> str:
    """JSON that no text inside can turn into markup."""
    text = json.dumps(data, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
