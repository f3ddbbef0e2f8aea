"""Figures of a campaign: what is written on them can be read."""

from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from swarm_mj.campaign.figures import MAX_SCENARIOS, _bars, _shown


def test_no_grid_line_runs_through_the_chance_over_a_bar():
    figure = Figure()
    ax = figure.subplots()
    _bars(ax, {"two-fold": {"probability": 0.948, "wilson": (0.93, 0.961)}})
    figure.draw_without_rendering()
    (text,) = ax.texts
    ground, words = text.get_bbox_patch(), text.get_window_extent()
    assert text.get_text() == "94.8 %" and to_hex(ground.get_facecolor()) == "#ffffff"
    box = ground.get_window_extent()
    assert box.x0 <= words.x0 and box.y0 <= words.y0 and box.x1 >= words.x1 and box.y1 >= words.y1
    assert text.get_zorder() > max(line.get_zorder() for line in ax.get_ygridlines())


def test_a_diagram_that_cannot_show_every_scenario_says_so():
    few, many = ({f"s{k}": k for k in range(count)} for count in (MAX_SCENARIOS, MAX_SCENARIOS + 3))
    assert _shown(few, "Observed area") == (few, "Observed area")
    assert _shown(many, "Observed area") == (few, "Observed area, 8 of 11")
