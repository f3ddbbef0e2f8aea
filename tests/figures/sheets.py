"""What the tests of figures share: swarms of any size, and how a drawn page is judged."""

from dataclasses import replace
from itertools import combinations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from swarm_mj.observation.coverage import CoverageMap
from tests.records.deliveries import with_delivery


def swarm_of(flown, n):
    """The quick flight with its first spacecraft copied n times."""
    plan, telemetry, result = flown
    points = (12,) * n
    scenario = plan.scenario.model_copy(
        update={"design": plan.scenario.design.model_copy(update={"visiting_points": points})}
    )
    of_each = ("v0_N", "destination_N", "miss_m", "release_s", "arrival_s", "release_r_N", "release_mothership_v_N")
    first = {name: getattr(plan.deployment, name)[:1] for name in of_each}
    deployment = replace(plan.deployment, **{name: np.repeat(rows, n, axis=0) for name, rows in first.items()})
    many = replace(plan, scenario=scenario, deployment=deployment, points_A=np.repeat(plan.points_A[:1], n, axis=0))
    copies = telemetry.isel(spacecraft=[0] * n).assign_coords(spacecraft=list(many.names))
    seen = with_coverage(result, np.repeat(result.coverage.first_seen_by_s[:1], n, axis=0))
    return with_delivery((many, copies, seen), mute=range(0, n - 1, 3))


def with_coverage(result, first_seen_by_s):
    """A result in which each spacecraft first saw each cell at the given times, shape (n, cells); none is delivered."""
    coverage = CoverageMap(result.coverage.area, len(first_seen_by_s))
    coverage.first_seen_by_s[:] = first_seen_by_s
    return replace(result, coverage=coverage, passage=coverage, delivery=None)


def assert_nothing_is_cut_off(figure: Figure, *, is_drawn=False):
    """Figures that are saved are drawn once, and a second drawing would hide what only then finds its place."""
    if not is_drawn:
        figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert min(drawn.x0, drawn.y0) >= -0.01
    assert drawn.x1 <= width + 0.01
    assert drawn.y1 <= height + 0.01


def assert_labels_do_not_overlap(figure: Figure):
    boxes = [(text.get_text(), text.get_window_extent()) for text in visible_texts(figure)]
    clashes = [
        (a, b)
        for (a, first), (b, second) in combinations(boxes, 2)
        if min(first.x1, second.x1) - max(first.x0, second.x0) > 1.0
        and min(first.y1, second.y1) - max(first.y0, second.y0) > 1.0
    ]
    assert len(boxes) > 5
    assert clashes == []


def visible_texts(figure: Figure):
    """Labels, titles, ticks and legends that are drawn; marks placed among the data are left out."""
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text() and not isinstance(t, Annotation)]
    hidden = {t for ax in figure.axes if not ax.get_visible() for t in ax.findobj(Text)}
    for ax in figure.findobj(lambda artist: hasattr(artist, "xaxis")):
        for axis in (ax.xaxis, ax.yaxis):
            drawn = set(axis._update_ticks()) if ax.axison else set()
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if tick not in drawn:
                    hidden |= set(tick.findobj(Text))
    return [text for text in texts if text not in hidden]
