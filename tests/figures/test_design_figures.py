"""Pictures of a design, on problems whose answer is plain: n points, each of which alone sees one share of the target."""

import re

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import rgb_to_hsv, to_rgb

from swarm_mj.designer.candidates.visibility import Candidate, Visibility
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.genetic import GeneticSettings, evolve
from swarm_mj.designer.pareto import ParetoFront
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.study import Study
from swarm_mj.figures.design_figures import COMPOSERS, draw_all
from swarm_mj.figures.palette import ORANGE, SKY_BLUE

from .sheets import assert_labels_do_not_overlap, assert_nothing_is_cut_off


@pytest.fixture(scope="module")
def study_of(quick_plan):
    """A function that makes the study of a problem that needs n spacecraft."""

    def make(n, later=0.0):
        region = quick_plan.region
        share = np.arange(region.n_cells) * n // region.n_cells
        sees = share == np.arange(n)[:, None]
        points = np.arange(1, n + 1)
        candidates = [Candidate(int(p), 0, 14_000.0, 600.0, later * (p % 2)) for p in points]
        seen = Visibility(
            candidates=candidates,
            sees=sees,
            area=region.area,
            delta_v=np.ones(n),
            beyond=np.zeros(n, bool),
            point_A=np.zeros((n, 3)),
            b_plane=np.full((n, 3), np.nan),
            region=region,
        )
        problem = CoverProblem(sees=sees, area=region.area, tolerance_percent=0.0, max_observers=max(20, n))
        settings = GeneticSettings(max_generations=5)
        front = ParetoFront(
            n_observers=points,
            delta_v=1.0 * points,
            uncovered_percent=100.0 * (1.0 - points / n),
            points=[points[:k] for k in points],
            explored=n,
            seconds=0.0,
        )
        return Study(
            scenario=quick_plan.scenario,
            visibility=seen,
            problem=problem,
            exact=solve_exact(problem),
            genetic={name: evolve(problem, settings) for name in ("repair", "plain")},
            front=front,
            wall_s={},
        )

    return make


@pytest.fixture(scope="module")
def study(study_of):
    return study_of(4)


@pytest.mark.parametrize("n", [1, 4, 30])
@pytest.mark.parametrize("name", sorted(COMPOSERS))
def test_designs_of_any_size_fit_on_the_page(study_of, name, n):
    figure = COMPOSERS[name](study_of(n))
    assert_nothing_is_cut_off(figure)
    if name != "gene_map":  # a table, whose words stand in cells of their own
        assert_labels_do_not_overlap(figure)


def test_gene_map_has_the_papers_rows_and_the_selected_points(study):
    (table,) = COMPOSERS["gene_map"](study).axes[0].tables
    rows = [[table[row, column].get_text().get_text() for column in range(-1, 5)] for row in range(4)]
    assert [row[0] for row in rows] == ["description", "symbol", "domain", "selected"]
    assert rows[1][1:] == ["$N_{Obs}$", "$p_{1}$", "$p_{2}$", "$p_{3}$", "$p_{4}$"]
    assert rows[2][1:] == ["1 to 20", *["1 to 4"] * 4]
    assert rows[3][1:] == ["4", "1", "2", "3", "4"]


def test_history_ends_at_the_proven_minimum(study):
    ax = COMPOSERS["history"](study).axes[0]
    best = {line.get_label(): line.get_ydata() for line in ax.lines}
    assert best["proven minimum"][0] == 4
    assert best["best, with repair and pruning"][-1] == 4


def test_cells_are_coloured_by_how_many_see_them(study):
    ax = COMPOSERS["cover"](study).axes[0]
    (cells,) = [c for c in ax.collections if isinstance(c, PolyCollection)]
    hue = rgb_to_hsv(cells.get_facecolor()[:, :3])[:, 0]
    assert hue == pytest.approx(rgb_to_hsv(to_rgb(SKY_BLUE))[0], abs=1e-6)  # each is seen by one
    assert rgb_to_hsv(to_rgb(ORANGE))[0] != pytest.approx(hue[0], abs=1e-2)
    assert [text.get_text() for text in ax.figure.legends[0].texts] == ["seen by 1", "visited point", "point tried"]


def test_front_is_drawn_design_by_design(study):
    ax = COMPOSERS["pareto"](study).axes[0]
    drawn = {int(line.get_label()): line.get_xydata()[0] for line in ax.lines if re.fullmatch(r"\d+", line.get_label())}
    assert drawn[1] == pytest.approx([1.0, 25.0])
    assert drawn[4] == pytest.approx([4.0, 100.0])


def test_pictures_without_a_front_and_with_pdf(study, tmp_path):
    draw_all(tmp_path, Study(**{**study.__dict__, "front": None}), pdf=True)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {f"{name}.{kind}" for name in ("history", "gene_map", "cover") for kind in ("png", "pdf")}


@pytest.mark.parametrize(("n", "later"), [(1, 0.0), (12, 0.0), (30, 0.0), (12, 7200.0)])
def test_words_of_the_gene_map_fit_their_cells(study_of, n, later):
    figure = COMPOSERS["gene_map"](study_of(n, later))
    selected = [
        cell.get_text().get_text() for (row, _), cell in figure.axes[0].tables[0].get_celld().items() if row == 3
    ]
    assert any("released at" in " ".join(words.split()) for words in selected) == (later > 0.0)
    figure.draw_without_rendering()
    for cell in figure.axes[0].tables[0].get_celld().values():
        word, box = cell.get_text().get_window_extent(), cell.get_window_extent()
        assert word.width < box.width
        assert word.height < box.height
